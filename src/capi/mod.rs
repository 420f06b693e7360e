//! The C library: the functions that `ffi/include/lumicache.h` declares. docs/CAPI.md is their
//! manual.
//!
//! Every exported function is a few lines around [`status::guard`](self), which lets no panic out
//! and turns failures into the calling thread's error. Handles are numbers of a table, never
//! addresses: [`lumi_device_release`] and its like find out when they are stale. Structs of the
//! host are read once, by their size, into values; arrays of the host are checked once and then
//! read by index. Nothing below knows of C.

#![allow(non_camel_case_types, reason = "the types are those of the header")]
#![allow(
    clippy::missing_safety_doc,
    reason = "the header and docs/CAPI.md say what the caller owes, function by function"
)]

mod status;
mod abi;
mod handles;
mod pool;
mod device;
mod describe;
mod host;
mod scene;
mod load;
mod cache;
mod records;
mod query;
mod build;
mod render;

pub use abi::*;
pub use build::*;
pub use cache::*;
pub use device::*;
pub use load::*;
pub use query::*;
pub use records::*;
pub use render::*;
pub use scene::*;
pub use status::*;
