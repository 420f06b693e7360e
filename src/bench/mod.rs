//! Measurements: the tracers against each other, and the caching schemes against references.

pub mod accel;
pub mod report;
mod page;
mod search;
pub mod experiment;
