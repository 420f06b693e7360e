//! The triangulated hemisphere, and Hessians of irradiance.

mod edges;
mod hessians;
mod triangulation;

pub use hessians::{Derivatives, Hessian};
pub use triangulation::{Mesh, TriangleRadiance};
