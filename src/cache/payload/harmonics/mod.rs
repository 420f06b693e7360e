//! Incident radiance in harmonics.

mod vectors;
mod placement;
mod record;
mod projector;
mod estimate;

pub use placement::Reflector;
pub use projector::{Projection, Projector};
pub use record::Harmonics;
