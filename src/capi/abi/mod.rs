//! What both sides of the boundary agree on: versions, structs and constants of the header, and the
//! arrays in the host's memory.

mod common;
mod views;
mod scene;
mod cache;

pub use cache::*;
pub use common::*;
pub use scene::*;
pub(super) use views::*;
