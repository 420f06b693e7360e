//! What records hold of the light at a point: [`Irradiance`] for diffuse surfaces, or
//! [`Harmonics`], which also hold incident radiance for glossy ones.

mod axes;
mod irradiance;
mod kind;
mod harmonics;

pub use axes::{Axes, Change, Direct, DirectSamples, Quadratic};
pub use harmonics::{Harmonics, Projection, Projector, Reflector};
pub use irradiance::{Curve, Irradiance, Lit};
pub use kind::{Appearance, Lobes, Payload, Seen};
