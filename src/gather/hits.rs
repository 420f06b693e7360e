//! What a gather saw, kept as patches of the surfaces around. Extrapolated coefficients are
//! compared with these patches.

use super::samples::{HemisphereSamples, MIN_COS_HIT};
use crate::math::{Color, PI, Vec3};

/// A patch around a hit, or a share of the surroundings that are infinitely far.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StoredHit {
    /// The hit, world space; the direction to it if it is infinitely far.
    pub position: Vec3,
    /// Unit normal, facing the gather; zero if it is infinitely far.
    pub normal: Vec3,
    /// Area of the patch; its solid angle if it is infinitely far.
    pub area: f32,
    /// Radiance that left it towards the gather.
    pub radiance: Color,
}

impl StoredHit {
    /// The direction to the patch from `x` and the solid angle that it takes up there; `None` if it
    /// shows its back. Next to a patch the solid angle of a disc bounds it, `cos ξ A/(r² + A/π)`.
    pub fn seen_from(&self, x: Vec3) -> Option<(Vec3, f32)> {
        if self.normal == Vec3::ZERO {
            return Some((self.position, self.area));
        }
        let to = self.position - x;
        let square = to.length_squared();
        let direction = to.try_normalize()?;
        let cos = -self.normal.dot(direction);
        (cos > 0.0).then(|| (direction, cos * self.area / (square + self.area / PI)))
    }
}

impl HemisphereSamples {
    /// The hits of a gather that started from `x`: `L_r(x') = Σ_j L_j f(x', wo, w_j) cos θ_j cos
    /// ξ_j A_j/r_j²` is what a surface beside it reflects [Zhao, Eq. 3.38], `A_j = Ω_j r_j²/cos
    /// ξ_j`.
    pub fn stored_hits(&self, x: Vec3) -> Vec<StoredHit> {
        let b = &self.bundle;
        let hit = |k: usize| {
            let (w, r, solid_angle) =
                (self.frame.to_world(b.dir_local[k]), b.distance[k], self.solid_angle(k));
            let radiance = b.radiance[k];
            if !r.is_finite() || b.normal[k] == Vec3::ZERO {
                return StoredHit { position: w, normal: Vec3::ZERO, area: solid_angle, radiance };
            }
            let cos = (-b.normal[k].dot(w)).max(MIN_COS_HIT);
            StoredHit {
                position: x + r * w,
                normal: b.normal[k],
                area: solid_angle * r * r / cos,
                radiance,
            }
        };
        (0..b.len()).map(hit).collect()
    }
}
