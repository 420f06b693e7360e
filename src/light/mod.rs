//! Light sources: emissive triangles, the environment and punctual lights, and the sampling of all of them.

use crate::math::{Affine3A, Color, Vec3};

/// A light without extent (KHR_lights_punctual), already in world space and in radiometric numbers as the scene file has them.
#[derive(Clone, Copy, Debug, PartialEq)]
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
        /// Cosine of the inner half angle, where the fall-off begins.
        cos_inner: f32,
        /// Cosine of the outer half angle, where it ends.
        cos_outer: f32,
    },
    /// Parallel light.
    Directional {
        /// Unit direction in which the light travels.
        direction: Vec3,
        /// Irradiance on a surface across the light.
        irradiance: Color,
    },
}

/// An equirectangular environment: radiance from infinity. Row 0 is the zenith (+Y); with no rotation the middle column is seen along -Z, and +X lies to its right.
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
