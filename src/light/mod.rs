//! Light sources: emissive triangles, the environment, punctual lights and measured luminaires, and
//! the sampling of all of them.

mod bounds;
mod ies;
mod polygon;
mod simd;
mod source;
mod environment;
mod distant;
mod punctual;
mod sky;
mod pattern;
mod triangle;
mod lanes;
mod tree;
mod lights;
mod emission;

pub use emission::{Emission, EmissionSampler, Focus, LightEnd};
pub use ies::{IesFault, IesProfile, Photometry};
pub use lights::Lights;
pub use pattern::Pattern;
pub use polygon::polygon_irradiance;
pub use sky::{Sky, SkyKind, SunKind};
pub use source::{
    Emitter, EnvironmentMap, LUMINOUS_EFFICACY, LightSample, LightSource, PunctualLight, versine,
};
pub use triangle::TriangleLight;
