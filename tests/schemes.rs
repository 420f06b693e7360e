//! schemes.
