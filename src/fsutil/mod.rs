//! Files: what may be read, and writing that leaves the old file or the new one.

mod read;
mod write;

pub use read::{open, read, remember_what_is_read};
pub use write::{check_distinct, check_writable, write_atomically, write_atomically_with};
