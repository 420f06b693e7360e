//! OpenEXR's C core (`libOpenEXRCore`): writing of one-part scan-line files with ZIP compression.
//!
//! The safe surface is [`Writer`]. Chunks (16 lines each) are packed and deflated by the C core's
//! encoding pipeline on rayon's threads and written in order by the calling thread, so the bytes of
//! a file do not depend on the number of threads. Messages of the C core, which prints them by
//! default, become the error strings.
//!
//! The structures of the headers and of the library agree because the library's SONAME changes with
//! them (3.1: `libOpenEXRCore-3_1.so.30`).

#[allow(
    missing_docs,
    non_camel_case_types,
    non_snake_case,
    non_upper_case_globals,
    dead_code,
    clippy::all,
    reason = "bindgen's output: C's names, and more of them than are used"
)]
mod raw {
    include!(concat!(env!("OUT_DIR"), "/openexr.rs"));
}

mod data;
mod writer;

#[cfg(test)]
mod tests;

pub use data::{Channel, Samples, Window};
pub use writer::{Result, Writer};
