//! Light sources: emissive triangles, the environment, punctual lights and measured luminaires, and
//! the sampling of all of them.

mod bounds;
mod distant;
mod emission;
mod environment;
mod ies;
mod lanes;
mod lights;
mod polygon;
mod punctual;
mod simd;
mod sky;
mod source;
mod tree;
mod triangle;

pub use emission::{Emission, EmissionSampler, LightEnd};
pub use ies::{IesFault, IesProfile, Photometry};
pub use lights::Lights;
pub use polygon::polygon_irradiance;
pub use sky::{Sky, SkyKind, SunKind};
pub use source::{
    Emitter, EnvironmentMap, LUMINOUS_EFFICACY, LightSample, LightSource, PunctualLight,
};
pub use triangle::TriangleLight;
