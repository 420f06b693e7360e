//! A scene that a host keeps, as the cache sees it: the host traces and shades batches of rays, and
//! a probe gathers from the answers.
//!
//! Gathers run on more threads than there are processors. Each gather hands its rays to an
//! [`Exchange`] and sleeps until they are answered, so that the rays of many gathers go to the host
//! in one call. The calling thread serves the host, or several threads do where the host allows it.
//! The answers to a gather do not depend on the other gathers in its batch.

mod batch;
mod host;
mod exchange;
mod probe;
mod world;

pub use batch::Batch;
pub use exchange::{Exchange, run};
pub use host::{Description, Host};
pub use probe::{HostProbe, surface_point};
