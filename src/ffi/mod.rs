//! ffi.

#[cfg(feature = "openexr")]
pub mod openexr;
