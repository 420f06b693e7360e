//! Lights without extent, as the glTF extensions `KHR_lights_punctual` and `EXT_lights_ies` define
//! them.

use super::source::{PunctualLight, weight};
use crate::math::{Color, Frame, INV_PI, PI, Vec2, Vec3};

/// The light that reaches a point from a light without extent.
pub(super) struct PunctualIncidence {
    pub wi: Vec3,
    pub distance: f32,
    /// Irradiance on a surface across `wi`.
    pub irradiance: Color,
}

impl PunctualLight {
    /// What reaches `p`, occlusion aside; `None` at the light itself, beyond its range and outside
    /// its cone.
    pub(super) fn incidence(&self, p: Vec3) -> Option<PunctualIncidence> {
        let Some(position) = self.position() else {
            let (Self::Directional { direction, irradiance }
            | Self::Disc { direction, irradiance, .. }) = *self
            else {
                return None;
            };
            return Some(PunctualIncidence { wi: -direction, distance: f32::INFINITY, irradiance });
        };
        let to_light = position - p;
        let squared = to_light.length_squared();
        let distance = squared.sqrt();
        let window = self.window(distance);
        if !(squared > 0.0 && window > 0.0) {
            return None;
        }
        let wi = to_light / distance;
        let intensity = self.intensity(-wi);
        (intensity != Color::ZERO).then(|| PunctualIncidence {
            wi,
            distance,
            irradiance: intensity * (window / squared),
        })
    }

    /// World position of a light that has one.
    pub(super) fn position(&self) -> Option<Vec3> {
        match *self {
            Self::Point { position, .. }
            | Self::Spot { position, .. }
            | Self::Ies { position, .. } => Some(position),
            Self::Directional { .. } | Self::Disc { .. } => None,
        }
    }

    /// What its range leaves of a light after `distance`, the recommended window max(0, 1 -
    /// (d/range)⁴).
    pub(super) fn window(&self, distance: f32) -> f32 {
        match *self {
            Self::Point { range, .. } | Self::Spot { range, .. } | Self::Ies { range, .. } => {
                (1.0 - (distance / range).powi(4)).max(0.0)
            }
            Self::Directional { .. } | Self::Disc { .. } => 1.0,
        }
    }

    /// Radiant intensity along a unit direction; zero for a light without a position.
    pub(super) fn intensity(&self, towards: Vec3) -> Color {
        match *self {
            Self::Point { intensity, .. } => intensity,
            // The recommended falloff: the square of a ramp from the outer to the inner cone, with
            // a floor against equal angles.
            Self::Spot { direction, intensity, cos_inner, cos_outer, .. } => {
                let ramp = (towards.dot(direction) - cos_outer) / (cos_inner - cos_outer).max(1e-3);
                intensity * ramp.clamp(0.0, 1.0).powi(2)
            }
            Self::Ies { from_world, scale, ref profile, .. } => {
                scale * profile.intensity(from_world * towards)
            }
            Self::Directional { .. } | Self::Disc { .. } => Color::ZERO,
        }
    }

    /// A direction in which a light with a position shines, drawn uniformly over the sphere or the
    /// cone, or by a luminaire's intensity.
    pub(super) fn sample_direction(&self, u: Vec2) -> Option<Vec3> {
        let cone = |axis: Vec3, cos_outer: f32| {
            let cos = 1.0 - u.y * (1.0 - cos_outer);
            let sin = (1.0 - cos * cos).max(0.0).sqrt();
            let (s, c) = (2.0 * PI * u.x).sin_cos();
            Frame::from_normal(axis).to_world(Vec3::new(sin * c, sin * s, cos))
        };
        match *self {
            Self::Point { .. } => Some(cone(Vec3::Z, -1.0)),
            Self::Spot { direction, cos_outer, .. } => Some(cone(direction, cos_outer)),
            Self::Ies { from_world, ref profile, .. } => {
                profile.sample(u).map(|d| from_world.transpose() * d)
            }
            Self::Directional { .. } | Self::Disc { .. } => None,
        }
    }

    /// Density per steradian of [`PunctualLight::sample_direction`].
    pub(super) fn direction_density(&self, towards: Vec3) -> f32 {
        match *self {
            Self::Point { .. } => 0.25 * INV_PI,
            Self::Spot { direction, cos_outer, .. } if towards.dot(direction) >= cos_outer => {
                0.5 * INV_PI / (1.0 - cos_outer)
            }
            Self::Ies { from_world, ref profile, .. } => profile.pdf(from_world * towards),
            Self::Spot { .. } | Self::Directional { .. } | Self::Disc { .. } => 0.0,
        }
    }

    /// For a disc: the direction to its centre, irradiance and angular radius.
    pub(super) fn disc(&self) -> Option<(Vec3, Color, f32)> {
        match *self {
            Self::Disc { direction, irradiance, radius } => Some((-direction, irradiance, radius)),
            _ => None,
        }
    }

    /// Irradiance at `p`, on a surface with normal `n` or across the light, by which lights are
    /// chosen.
    pub(super) fn importance(&self, p: Vec3, n: Option<Vec3>) -> f32 {
        self.incidence(p)
            .map_or(0.0, |i| weight(i.irradiance) * n.map_or(1.0, |n| n.dot(i.wi).max(0.0)))
    }

    /// Radiant intensity of a point or spot light, the mean over all directions for a luminaire,
    /// irradiance of a directional light.
    pub(super) fn strength(&self) -> Color {
        match *self {
            Self::Point { intensity, .. } | Self::Spot { intensity, .. } => intensity,
            Self::Ies { scale, ref profile, .. } => scale * (profile.flux() * (0.25 * INV_PI)),
            Self::Directional { irradiance, .. } | Self::Disc { irradiance, .. } => irradiance,
        }
    }

    /// Radiant power of a light that has a place; that of a directional light through a disc of
    /// area 1.
    pub(super) fn power(&self) -> Color {
        let solid_angle = match *self {
            Self::Point { .. } | Self::Ies { .. } => 4.0 * PI,
            // The integral of the falloff over the cone: all of the inner cone and a third of the
            // ring.
            Self::Spot { cos_inner, cos_outer, .. } => {
                2.0 * PI * (1.0 - cos_inner + (cos_inner - cos_outer).max(0.0) / 3.0)
            }
            Self::Directional { .. } | Self::Disc { .. } => 1.0,
        };
        self.strength() * solid_angle
    }
}
