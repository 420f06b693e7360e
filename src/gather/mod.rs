//! The hemisphere gather that every caching scheme shares: where rays go, what they bring back, and
//! the estimates made from it.
//!
//! A gather knows no scene. It fills the directions of a [`Bundle`], a [`RadianceProbe`] fills in
//! what each ray sees, and the pure functions of [`HemisphereSamples`] turn that into irradiance,
//! its error, distances to the surroundings and gradients. Local directions are in the frame of the
//! surface point: z is the shading normal.

mod strata;
mod lobe;
mod probe;
mod samples;
mod distances;
mod irradiance;
mod mesh;
mod translation;
mod harmonics;
mod hits;
mod sources;

pub use harmonics::{Coefficients, RadianceDerivatives, RadianceGradient};
pub use hits::StoredHit;
pub use irradiance::Gradient;
pub use lobe::LobeCoefficients;
pub use mesh::{Derivatives, Hessian, TriangleRadiance};
pub use probe::{
    Arrival, Arriving, Bundle, Deeper, DirectLight, HitChange, HitKind, Joint, LightChoice,
    NoDeeper, RadianceProbe, irradiance_of,
};
pub use samples::HemisphereSamples;
pub use sources::PointSources;
pub use strata::{Density, Layout};
pub use translation::TranslationalGradient;
