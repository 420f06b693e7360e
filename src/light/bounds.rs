//! Bounds of a group of lights in space and direction, and the cost of a group by which the light
//! tree is built.

use crate::geometry::Aabb;
use crate::math::Vec3;
use std::f32::consts::{FRAC_PI_2, PI};

/// A group of lights: where they are, where they shine and how strongly [Conty18, Sec. 4].
#[derive(Clone, Copy, Debug)]
pub(super) struct LightBounds {
    pub bounds: Aabb,
    /// Axis of a cone that holds the normals.
    pub axis: Vec3,
    /// Half angle of that cone, 0 to π. Each light shines up to 90° away from its normal.
    pub theta_o: f32,
    /// Radiant intensity along the normals, summed.
    pub intensity: f32,
}

impl LightBounds {
    /// The bounds of both groups.
    pub fn union(&self, other: &Self) -> Self {
        let (axis, theta_o) = union_cones((self.axis, self.theta_o), (other.axis, other.theta_o));
        Self {
            bounds: self.bounds.union(other.bounds),
            axis,
            theta_o,
            intensity: self.intensity + other.intensity,
        }
    }

    /// The cost of a node of the tree: intensity times the measure of its directions times that of
    /// its extent [Conty18, Sec. 4]. The squared diagonal stands for the surface area, which is
    /// zero for lights in a row.
    pub fn cost(&self) -> f32 {
        let theta_w = (self.theta_o + FRAC_PI_2).min(PI);
        let (sin_o, cos_o) = self.theta_o.sin_cos();
        let directions = 2.0 * PI * (1.0 - cos_o)
            + FRAC_PI_2
                * (2.0 * theta_w * sin_o
                    - (self.theta_o - 2.0 * theta_w).cos()
                    - 2.0 * self.theta_o * sin_o
                    + cos_o);
        self.intensity * directions * self.bounds.diagonal().powi(2)
    }
}

/// The smallest cone of directions around two cones.
fn union_cones(a: (Vec3, f32), b: (Vec3, f32)) -> (Vec3, f32) {
    let (wide, narrow) = if a.1 >= b.1 { (a, b) } else { (b, a) };
    let between = wide.0.cross(narrow.0).length().atan2(wide.0.dot(narrow.0));
    if (between + narrow.1).min(PI) <= wide.1 {
        return wide;
    }
    let theta_o = 0.5 * (wide.1 + between + narrow.1);
    let across = (narrow.0 - wide.0 * wide.0.dot(narrow.0)).try_normalize();
    match across {
        Some(across) if theta_o < PI => {
            let (sin, cos) = (theta_o - wide.1).sin_cos();
            (wide.0 * cos + across * sin, theta_o)
        }
        _ => (wide.0, PI),
    }
}
