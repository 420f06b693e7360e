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
            // The recommended falloff: the square of a ramp from the outer to the inner cone. Its
            // floor of 1e-3 against equal angles would darken all of a narrow cone; such cones have
            // a sharp edge instead.
            Self::Spot { direction, intensity, inner, outer, .. } => {
                let off_axis = versine_between(towards, direction);
                if off_axis <= inner {
                    intensity
                } else if off_axis < outer {
                    intensity * ((outer - off_axis) / (outer - inner)).powi(2)
                } else {
                    Color::ZERO
                }
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
        let cone = |axis: Vec3, outer: f32| {
            let versine = u.y * outer;
            let sin = (versine * (2.0 - versine)).max(0.0).sqrt();
            let (s, c) = (2.0 * PI * u.x).sin_cos();
            Frame::from_normal(axis).to_world(Vec3::new(sin * c, sin * s, 1.0 - versine))
        };
        match *self {
            Self::Point { .. } => Some(cone(Vec3::Z, 2.0)),
            Self::Spot { direction, outer, .. } => Some(cone(direction, outer)),
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
            Self::Spot { direction, outer, .. } if versine_between(towards, direction) <= outer => {
                0.5 * INV_PI / outer
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
            Self::Spot { inner, outer, .. } => 2.0 * PI * (inner + (outer - inner).max(0.0) / 3.0),
            Self::Directional { .. } | Self::Disc { .. } => 1.0,
        };
        self.strength() * solid_angle
    }
}

/// `1 - cos` of the angle between unit vectors, which the dot product loses where they nearly
/// agree.
fn versine_between(a: Vec3, b: Vec3) -> f32 {
    0.5 * (a - b).length_squared()
}

#[cfg(test)]
mod tests {
    use super::super::versine;
    use super::*;

    fn spot(cos_inner: f32, cos_outer: f32) -> PunctualLight {
        PunctualLight::Spot {
            position: Vec3::new(0.0, 2.0, 0.0),
            direction: -Vec3::Y,
            intensity: Vec3::splat(8.0),
            range: f32::INFINITY,
            inner: 1.0 - cos_inner,
            outer: 1.0 - cos_outer,
        }
    }

    #[test]
    fn point_light_follows_the_inverse_square_within_its_range() {
        let light = |range| PunctualLight::Point {
            position: Vec3::new(0.0, 2.0, 0.0),
            intensity: Vec3::splat(8.0),
            range,
        };
        let free = light(f32::INFINITY).incidence(Vec3::ZERO).unwrap();
        assert_eq!((free.wi, free.distance, free.irradiance), (Vec3::Y, 2.0, Vec3::splat(2.0)));
        let windowed = light(4.0).incidence(Vec3::ZERO).unwrap();
        assert_eq!(windowed.irradiance, Vec3::splat(2.0 * (1.0 - 1.0 / 16.0)));
        assert!(
            light(2.0).incidence(Vec3::ZERO).is_none()
                && light(0.0).incidence(Vec3::ZERO).is_none()
        );
        assert!(light(f32::INFINITY).incidence(Vec3::new(0.0, 2.0, 0.0)).is_none());
    }

    #[test]
    fn spot_light_ramps_between_its_cones() {
        let light = spot(0.9, 0.7);
        let at = |cos: f32| {
            let p = Vec3::new((1.0 - cos * cos).sqrt(), 2.0 - cos, 0.0);
            light.incidence(p).map_or(0.0, |i| i.irradiance.x / 8.0)
        };
        assert!((at(0.95) - 1.0).abs() < 1e-5 && (at(0.8) - 0.25).abs() < 1e-5 && at(0.69) == 0.0);
    }

    /// From 0.1 degrees to nearly a hemisphere: full intensity on the axis and at the edge of the
    /// inner cone, a quarter where the ramp is at one half, nothing outside; light paths carry the
    /// power that the closed form says.
    #[test]
    fn spot_lights_of_any_width_have_their_intensity_and_their_power() {
        for degrees in [0.1_f32, 0.3, 1.0, 5.0, 30.0, 89.0] {
            let (outer, inner) =
                (versine(0.5 * degrees.to_radians()), versine(0.4 * degrees.to_radians()));
            let axis = Vec3::new(0.48, -0.8, 0.36);
            let light = PunctualLight::Spot {
                position: Vec3::new(3.0, 2.0, 1.0),
                direction: axis,
                intensity: Vec3::splat(8.0),
                range: f32::INFINITY,
                inner,
                outer,
            };
            let frame = Frame::from_normal(axis);
            let at = |versine: f32| {
                let local = Vec3::new((versine * (2.0 - versine)).sqrt(), 0.0, 1.0 - versine);
                light.intensity(frame.to_world(local)).x / 8.0
            };
            assert_eq!((at(0.0), at(0.98 * inner), at(1.02 * outer)), (1.0, 1.0, 0.0), "{degrees}");
            assert!((at(0.5 * (inner + outer)) - 0.25).abs() < 0.01, "{degrees}");

            let side = 64;
            let sum: f64 = (0..side * side)
                .map(|i| {
                    let u = (Vec2::new((i % side) as f32, (i / side) as f32) + 0.5) / side as f32;
                    let direction = light.sample_direction(u).unwrap();
                    f64::from(light.intensity(direction).x / light.direction_density(direction))
                })
                .sum();
            let mean = (sum / f64::from(side * side)) as f32;
            assert!((mean / light.power().x - 1.0).abs() < 2e-3, "{degrees}: {mean}");
        }
    }

    #[test]
    fn spot_light_with_equal_angles_has_a_sharp_edge() {
        let light = spot(0.8, 0.8);
        assert!(light.incidence(Vec3::new(0.1, 0.0, 0.0)).unwrap().irradiance.is_finite());
        assert!(light.incidence(Vec3::new(5.0, 0.0, 0.0)).is_none());
    }

    #[test]
    fn power_of_a_spot_light_is_the_integral_of_its_intensity() {
        let light = spot(0.9, 0.6);
        let steps = 20_000;
        let sum: f32 = (0..steps)
            .map(|i| {
                let cos = 1.0 - 2.0 * (i as f32 + 0.5) / steps as f32;
                let p = Vec3::new((1.0 - cos * cos).sqrt(), 2.0 - cos, 0.0);
                light.incidence(p).map_or(0.0, |i| i.irradiance.x)
            })
            .sum();
        let expected = sum * 4.0 * std::f32::consts::PI / steps as f32;
        assert!((light.power().x / expected - 1.0).abs() < 1e-3);
    }
}
