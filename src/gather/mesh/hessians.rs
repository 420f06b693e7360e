//! Second derivatives of irradiance by the position of the receiver: the type, the estimator that
//! knows no occlusion, and how much surroundings could curve it.

use crate::gather::irradiance::Gradient;
use crate::gather::samples::{HemisphereSamples, MIN_COS_HIT};
use crate::math::{Color, DMat2, Vec2};

/// A Hessian in the tangent plane, per channel: `½ (ss x² + 2 st x y + tt y²)` is the second-order
/// change of irradiance at x along `frame.s`, y along `frame.t`.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Hessian {
    /// Twice along `frame.s`.
    pub ss: Color,
    /// Along both tangents.
    pub st: Color,
    /// Twice along `frame.t`.
    pub tt: Color,
}

impl std::ops::Mul<f32> for Hessian {
    type Output = Self;

    fn mul(self, factor: f32) -> Self {
        Self { ss: self.ss * factor, st: self.st * factor, tt: self.tt * factor }
    }
}

impl Hessian {
    /// `uᵀ H v` per channel, in the tangents of the gather's frame.
    #[inline]
    pub fn apply(&self, u: Vec2, v: Vec2) -> Color {
        self.ss * (u.x * v.x) + self.st * (u.x * v.y + u.y * v.x) + self.tt * (u.y * v.y)
    }

    fn add(&mut self, [ss, st, tt]: [f32; 3], value: Color) {
        self.ss += ss * value;
        self.st += st * value;
        self.tt += tt * value;
    }
}

/// First and second derivatives of irradiance.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Derivatives {
    /// The translational gradient.
    pub gradient: Gradient,
    /// The Hessian.
    pub hessian: Hessian,
}

impl HemisphereSamples {
    /// The Hessian by which each hit stands for a fixed patch that keeps its radiance and its
    /// visibility [Jarosz12]: a hit in direction w at distance r, whose normal n_q is seen under
    /// cos ξ, has
    ///
    /// ```text
    /// ∇²(Ω cos θ) = Ω cos θ/r² (24 w wᵀ - 4 Id + 4 (n_q wᵀ + w n_qᵀ)/cos ξ)
    /// ```
    ///
    /// in the tangent plane. Any layout and density; blind to occlusion; escaped rays contribute
    /// nothing.
    pub fn unoccluded_hessian(&self) -> Hessian {
        self.hessian_of(&self.bundle.radiance)
    }

    /// The part of [`HemisphereSamples::unoccluded_hessian`] that comes from small bright surfaces;
    /// 0 unless rays were sent towards some.
    pub fn found_hessian(&self) -> Hessian {
        self.hessian_of(&self.bundle.found)
    }

    /// [`HemisphereSamples::unoccluded_hessian`] if the first rays bring `radiance`, others none.
    fn hessian_of(&self, radiance: &[Color]) -> Hessian {
        let b = &self.bundle;
        let mut h = Hessian::default();
        for (k, &light) in radiance.iter().enumerate() {
            let r = b.distance[k];
            if r.is_finite() && r > 0.0 {
                let w = b.dir_local[k];
                let normal = self.frame.to_local(b.normal[k]);
                let m = 4.0 * normal / (-normal.dot(w)).max(MIN_COS_HIT);
                let terms = [
                    24.0 * w.x * w.x - 4.0 + 2.0 * m.x * w.x,
                    24.0 * w.x * w.y + m.x * w.y + m.y * w.x,
                    24.0 * w.y * w.y - 4.0 + 2.0 * m.y * w.y,
                ];
                h.add(terms, light * (w.z * self.solid_angle(k) / (r * r)));
            }
        }
        h
    }

    /// How strongly surroundings of unit radiance at these distances could curve irradiance along
    /// each direction, if what the rays see had nothing to do with each other: `Σ Ω cos θ 24 w
    /// wᵀ/r²`, the part of [`HemisphereSamples::unoccluded_hessian`] that no sign cancels.
    /// Symmetric and positive.
    pub fn geometric_curvature(&self) -> DMat2 {
        let b = &self.bundle;
        let mut sum = DMat2::ZERO;
        for (k, &r) in b.distance.iter().enumerate() {
            if r > 0.0 {
                let w = b.dir_local[k].truncate().as_dvec2();
                let scale =
                    24.0 * f64::from(b.dir_local[k].z * self.solid_angle(k)) / f64::from(r).powi(2);
                sum += scale * DMat2::from_cols(w * w.x, w * w.y);
            }
        }
        sum
    }

    /// The same for the gradient: `Σ Ω cos θ 4 sin θ/r`.
    pub fn geometric_slope(&self) -> f32 {
        let b = &self.bundle;
        let terms = b.dir_local.iter().zip(&b.distance).enumerate();
        terms
            .filter(|(_, (_, r))| **r > 0.0)
            .map(|(k, (w, r))| 4.0 * w.truncate().length() * w.z * self.solid_angle(k) / r)
            .sum()
    }
}
