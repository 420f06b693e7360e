//! Light transport: the path tracer that everything is measured against, the probe that gathers in our own scene, and shading from the cache.

mod path;
mod probe;

pub use path::{PathTracer, Start};
pub use probe::SceneProbe;

use crate::math::Color;

/// The light of one camera sample, split as the output layers are; the five sum to the beauty. Albedo is multiplied in.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Radiance {
    /// Light that reached the first surface straight from a source and left by its diffuse lobe.
    pub diffuse_direct: Color,
    /// All other light that left by the diffuse lobe.
    pub diffuse_indirect: Color,
    /// As `diffuse_direct` for every other lobe, transmission too.
    pub glossy_direct: Color,
    /// As `diffuse_indirect` for every other lobe.
    pub glossy_indirect: Color,
    /// Emitted by the first surface, or the background.
    pub emission: Color,
}

impl Radiance {
    /// The beauty.
    pub fn total(&self) -> Color {
        self.diffuse_direct + self.diffuse_indirect + self.glossy_direct + self.glossy_indirect + self.emission
    }
}
