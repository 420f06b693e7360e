//! Measurements: the tracers against each other, and the caching schemes against references.

pub mod accel;
mod page;
pub mod report;
