//! Files that ask for memory, work or other files.
