//! Bounds of a group of lights in space and direction, and how much light the group may send to a point.

use crate::geometry::Aabb;
use crate::math::Vec3;
use std::f32::consts::{FRAC_PI_2, PI};

/// A group of lights: where they are, where they shine and how strongly [Conty18, Sec. 4.1].
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
        Self { bounds: self.bounds.union(other.bounds), axis, theta_o, intensity: self.intensity + other.intensity }
    }

    /// The cost of a node of the tree: intensity times the measure of its directions times that of its extent [Conty18, Eq. 1]. The squared diagonal
    /// stands for the surface area, which is zero for lights in a row.
    pub fn cost(&self) -> f32 {
        let theta_w = (self.theta_o + FRAC_PI_2).min(PI);
        let (sin_o, cos_o) = self.theta_o.sin_cos();
        let directions = 2.0 * PI * (1.0 - cos_o)
            + FRAC_PI_2 * (2.0 * theta_w * sin_o - (self.theta_o - 2.0 * theta_w).cos() - 2.0 * self.theta_o * sin_o + cos_o);
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

/// The bounds of a group in the form that the estimate at a point needs.
#[derive(Clone, Copy, Debug)]
pub(super) struct Cluster {
    center: Vec3,
    half: Vec3,
    radius_squared: f32,
    axis: Vec3,
    cos_o: f32,
    sin_o: f32,
    intensity: f32,
}

impl From<&LightBounds> for Cluster {
    fn from(group: &LightBounds) -> Self {
        let half = 0.5 * (group.bounds.max - group.bounds.min);
        let (sin_o, cos_o) = group.theta_o.sin_cos();
        Self {
            center: group.bounds.center(),
            half,
            radius_squared: half.length_squared(),
            axis: group.axis,
            cos_o,
            // The sine of the single precision π is not 0.
            sin_o: if group.theta_o >= PI { 0.0 } else { sin_o },
            intensity: group.intensity,
        }
    }
}

impl Cluster {
    /// An estimate of the irradiance at `p` from the whole group: intensity cosθ' cosθ / d², both cosines the largest that the bounding sphere and the cone of normals
    /// allow [Conty18, Eq. 3]. Zero only if no light of the group can reach a surface with normal `n`.
    #[inline]
    pub fn importance(&self, p: Vec3, n: Option<Vec3>) -> f32 {
        let to = self.center - p;
        let distance_squared = to.length_squared();
        if let Some(n) = n {
            if n.dot(to) + n.abs().dot(self.half) <= 0.0 {
                return 0.0;
            }
        }
        // Inside the bounding sphere every direction is possible.
        if distance_squared <= self.radius_squared {
            return self.intensity / self.radius_squared.max(f32::MIN_POSITIVE);
        }
        let inverse_squared = distance_squared.recip();
        let wi = to * inverse_squared.sqrt();
        let sin2_b = self.radius_squared * inverse_squared;
        let (sin_b, cos_b) = (sin2_b.sqrt(), (1.0 - sin2_b).max(0.0).sqrt());
        let cos_w = -self.axis.dot(wi);
        let (cos_x, sin_x) = subtract_angle(cos_w, sine(cos_w), self.cos_o, self.sin_o);
        let (cos_light, _) = subtract_angle(cos_x, sin_x, cos_b, sin_b);
        if cos_light <= 0.0 {
            return 0.0;
        }
        let cos_receiver = n.map_or(1.0, |n| {
            let cos = n.dot(wi);
            subtract_angle(cos, sine(cos), cos_b, sin_b).0.max(0.0)
        });
        self.intensity * cos_light * cos_receiver * inverse_squared
    }
}

fn sine(cos: f32) -> f32 {
    (1.0 - cos * cos).max(0.0).sqrt()
}

/// Cosine and sine of max(0, a - b) for angles in [0, π].
fn subtract_angle(cos_a: f32, sin_a: f32, cos_b: f32, sin_b: f32) -> (f32, f32) {
    if cos_a > cos_b { (1.0, 0.0) } else { (cos_a * cos_b + sin_a * sin_b, sin_a * cos_b - cos_a * sin_b) }
}
