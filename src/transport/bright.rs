//! Small bright surfaces, and rays towards them.
//!
//! Where most light comes from the spot of an uplight on the ceiling or from a strip of sunlight on
//! the floor, few rays of a gather meet it, and one more or less is a blotch. Such surfaces are
//! known before ([`super::find_bright`]) as balls around them. More rays go into the cones that
//! these balls fill; all rays are weighed by the balance heuristic [Veach97, Sec. 9.2.2]. What the
//! rays meet, and how bright it is, is found as for all others, so that the balls need not be
//! right.

use crate::geometry::SurfacePoint;
use crate::math::{Frame, Vec2, Vec3};
use std::f32::consts::{PI, TAU};

/// A ball around a small bright surface.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Patch {
    pub center: Vec3,
    pub radius: f32,
    /// The mean of the unit normals; shorter than 1 where they differ.
    pub normal: Vec3,
    /// The flux that it reflects, in any unit.
    pub flux: f32,
}

impl Patch {
    /// A measure of the irradiance that it gives at `x` on a surface with the normal `n` if nothing
    /// is in the way, 0 only where it gives none; and 1 - cos of the half angle of its cone.
    pub fn seen_from(&self, x: Vec3, n: Option<Vec3>) -> (f32, f32) {
        let to = self.center - x;
        let (squared, radius) = (to.length_squared(), self.radius);
        if squared <= radius * radius {
            return (self.flux / (radius * radius), 2.0);
        }
        let dir = to / squared.sqrt();
        let sin = radius / squared.sqrt();
        let received = n.map_or(1.0, |n| (n.dot(dir) + sin).clamp(0.0, 1.0));
        // As much as the normals differ, some of them may face x.
        let sent = 1.0 - self.normal.length() - self.normal.dot(dir) + sin;
        let wide = sin * sin / (1.0 + (1.0 - sin * sin).sqrt());
        (self.flux * received * sent.clamp(0.0, 1.0) / squared, wide)
    }

    /// Area of a disc through its middle.
    pub fn area(&self) -> f32 {
        PI * self.radius * self.radius
    }
}

/// The small bright surfaces of a scene.
#[derive(Debug, Default)]
pub(super) struct Bright {
    pub patches: Vec<Patch>,
    /// Points that light sources light up.
    pub lit: Vec<SurfacePoint>,
}

impl Bright {
    /// The cones from `x`, where the normal is `n`; `None` where no patch sends light.
    pub fn seen_from(&self, x: Vec3, n: Option<Vec3>) -> Option<Cones> {
        let mut cones = Vec::with_capacity(self.patches.len());
        let mut sum = 0.0;
        for patch in &self.patches {
            let (weight, wide) = patch.seen_from(x, n);
            if weight > 0.0 && weight.is_finite() && wide > 0.0 {
                sum += weight;
                let axis = (patch.center - x).try_normalize().unwrap_or(Vec3::Z);
                cones.push(Cone { axis, wide, share: weight, sum });
            }
        }
        for cone in &mut cones {
            cone.share /= sum;
            cone.sum /= sum;
        }
        (!cones.is_empty()).then_some(Cones { cones })
    }
}

/// A cone of directions around a patch.
struct Cone {
    axis: Vec3,
    /// 1 - cos of its half angle.
    wide: f32,
    /// Share of the directions that are drawn from it.
    share: f32,
    /// Sum of the shares up to it.
    sum: f32,
}

/// Directions from a point towards small bright surfaces.
pub(super) struct Cones {
    cones: Vec<Cone>,
}

impl Cones {
    /// A unit direction, world space: `select` in [0, 1) chooses the cone, `u` in [0, 1)² the
    /// direction.
    pub fn sample(&self, select: f32, u: Vec2) -> Vec3 {
        let k = self.cones.partition_point(|c| c.sum <= select).min(self.cones.len() - 1);
        let Cone { axis, wide, .. } = self.cones[k];
        let depth = u.x * wide;
        let (sin, cos) = (TAU * u.y).sin_cos();
        let radius = (depth * (2.0 - depth)).max(0.0).sqrt();
        let local = Vec3::new(radius * cos, radius * sin, 1.0 - depth);
        Frame::from_normal(axis).to_world(local).normalize()
    }

    /// The density of [`Cones::sample`] per steradian.
    #[inline]
    pub fn density(&self, dir: Vec3) -> f32 {
        // |a - b|² = 2 (1 - cos) is precise for narrow cones.
        let inside = |c: &&Cone| 0.5 * (dir - c.axis).length_squared() <= c.wide;
        self.cones.iter().filter(inside).map(|c| c.share / (TAU * c.wide)).sum()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sampling::Rng;

    fn two() -> Bright {
        let patch = |x, radius| Patch {
            center: Vec3::new(x, 0.0, 3.0),
            radius,
            normal: -Vec3::Z,
            flux: 1.0,
        };
        Bright { patches: vec![patch(0.0, 0.05), patch(1.0, 0.8)], lit: Vec::new() }
    }

    #[test]
    fn the_density_of_directions_is_what_they_are_drawn_with() {
        let cones = two().seen_from(Vec3::ZERO, Some(Vec3::Z)).unwrap();
        let mut rng = Rng::new(3);
        // The integral of 1 over the cones, as a mean over the samples, is their solid angle: that
        // of the wide one, for the narrow one lies inside.
        let n = 100_000;
        let mut draw = || cones.sample(rng.next_f32(), rng.next_2d());
        let area: f32 = (0..n).map(|_| 1.0 / cones.density(draw())).sum::<f32>() / n as f32;
        let sin = 0.8 / 10.0_f32.sqrt();
        let narrow = TAU * (1.0 - (1.0 - (0.05_f32 / 3.0).powi(2)).sqrt());
        let wide = TAU * (1.0 - (1.0 - sin * sin).sqrt());
        assert!((area - wide - narrow).abs() < 0.02 * wide, "{area} {wide}");
    }

    #[test]
    fn patches_that_face_away_or_lie_below_the_horizon_get_no_rays() {
        assert!(two().seen_from(Vec3::ZERO, Some(-Vec3::Z)).is_none());
        assert!(two().seen_from(Vec3::new(0.0, 0.0, 9.0), Some(-Vec3::Z)).is_none());
        assert!(two().seen_from(Vec3::ZERO, None).is_some());
    }

    #[test]
    fn a_point_inside_a_ball_looks_everywhere() {
        let cones = two().seen_from(Vec3::new(1.0, 0.0, 2.9), Some(Vec3::Z)).unwrap();
        assert!(cones.density(-Vec3::Z) > 0.0);
    }
}
