//! Incident radiance in harmonics.

mod vectors;
mod placement;
mod record;
mod projector;
mod estimate;

pub use placement::{RadianceMetric, RadiancePlacement, Reflector};
pub use projector::{Projection, Projector};
pub use record::Harmonics;
pub use vectors::{HitStorage, Storage};
