//! What a scene says of its lights, and a direction towards one of them.

use super::ies::IesProfile;
use crate::math::{Affine3A, Color, Mat3, Vec3};
use glam::DVec3;
use std::sync::Arc;

/// Lumens per watt of monochromatic light of 555 nm: takes photometric numbers to radiometric ones.
/// Blender's exporter multiplies by it.
pub const LUMINOUS_EFFICACY: f32 = 683.0;

/// A triangle that emits, as the scene names it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Emitter {
    /// Index of the instance.
    pub instance: u32,
    /// Triangle inside the instance's mesh.
    pub triangle: u32,
    /// Mean radiance over the triangle. It steers sampling; where it is zero the triangle is never
    /// chosen.
    pub radiance: Color,
    /// True if both faces emit, false if the front face alone does.
    pub double_sided: bool,
}

/// What a [`LightSample`] was taken from.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum LightSource {
    /// A point of an emissive triangle.
    Triangle {
        /// Index of the instance.
        instance: u32,
        /// Triangle inside the instance's mesh.
        triangle: u32,
        /// Weight of the second vertex, in the mesh's own order.
        u: f32,
        /// Weight of the third vertex.
        v: f32,
    },
    /// The environment, or a disc in front of it.
    Environment,
    /// A light without extent: its index among the punctual lights of the scene.
    Punctual(u32),
}

/// A direction towards a light, with everything that the estimate of its contribution `f cosθ
/// radiance / pdf` needs, visibility aside.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LightSample {
    /// Unit world direction from the receiver to the light.
    pub wi: Vec3,
    /// Distance to the light, infinite for the environment and for directional lights.
    pub distance: f32,
    /// Radiance towards the receiver; the mean over the triangle for an emissive triangle. For a
    /// delta light, the irradiance on a surface across `wi`.
    pub radiance: Color,
    /// Density per steradian, choice of the light included. For a delta light, the probability of
    /// its choice.
    pub pdf: f32,
    /// True if the light has no extent, so that no other technique finds it.
    pub delta: bool,
    /// Where the sample lies.
    pub source: LightSource,
}

/// How much a colour counts when lights are chosen: the mean of its channels, so that a blue lamp
/// is not starved; 0 unless positive and finite.
pub(super) fn weight(color: Color) -> f32 {
    let mean = (color.x + color.y + color.z) / 3.0;
    if mean.is_finite() { mean.max(0.0) } else { 0.0 }
}

/// `1 - cos angle` of an angle in radians. Unlike the cosine it tells narrow cones apart.
pub fn versine(angle: f32) -> f32 {
    2.0 * (0.5 * angle).sin().powi(2)
}

/// A light that is no part of the geometry (KHR_lights_punctual, EXT_lights_ies, the sun), already
/// in world space and in the numbers that the scene file has.
#[derive(Clone, Debug, PartialEq)]
pub enum PunctualLight {
    /// Radiates `intensity` in all directions.
    Point {
        /// World position.
        position: Vec3,
        /// Radiant intensity, per steradian.
        intensity: Color,
        /// Distance at which the light is cut off, infinite by default.
        range: f32,
    },
    /// As a point light, within a cone.
    Spot {
        /// World position.
        position: Vec3,
        /// Unit axis of the cone, away from the light.
        direction: Vec3,
        /// Radiant intensity inside the inner cone.
        intensity: Color,
        /// Distance at which the light is cut off, infinite by default.
        range: f32,
        /// [`versine`] of the inner half angle, where the fall-off begins.
        inner: f32,
        /// [`versine`] of the outer half angle, where it ends.
        outer: f32,
    },
    /// A luminaire: a point whose intensity over direction was measured.
    Ies {
        /// World position.
        position: Vec3,
        /// World to the profile's frame: orthogonal, a reflection where the scene mirrors the
        /// luminaire.
        from_world: Mat3,
        /// Factor on the profile's candela.
        scale: Color,
        /// Distance at which the light is cut off, infinite by default.
        range: f32,
        /// The distribution.
        profile: Arc<IesProfile>,
    },
    /// Parallel light.
    Directional {
        /// Unit direction in which the light travels.
        direction: Vec3,
        /// Irradiance on a surface across the light.
        irradiance: Color,
    },
    /// A disc at infinity such as the sun's, of the same radiance all over. Unlike the others it
    /// has an extent, is seen, and samples of it count as the environment's.
    Disc {
        /// Unit direction in which the light from its centre travels.
        direction: Vec3,
        /// Irradiance on a surface across the light.
        irradiance: Color,
        /// Angular radius in radians, above 0 and below π/2.
        radius: f32,
    },
}

impl PunctualLight {
    /// Moves the light, if it has a place.
    pub fn shift(&mut self, by: DVec3) {
        match self {
            Self::Point { position, .. }
            | Self::Spot { position, .. }
            | Self::Ies { position, .. } => *position = (position.as_dvec3() + by).as_vec3(),
            Self::Directional { .. } | Self::Disc { .. } => {}
        }
    }
}

/// An equirectangular environment: radiance from infinity. Row 0 is the zenith (+Y); with no
/// rotation the middle column is seen along +X and +Z lies to its right, as in Blender and
/// three.js.
#[derive(Clone, Debug)]
pub struct EnvironmentMap {
    /// Columns.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// Radiance, row by row from the top.
    pub pixels: Vec<Color>,
    /// Multiplied into the pixels.
    pub scale: f32,
    /// World to map; a rotation.
    pub from_world: Affine3A,
}
