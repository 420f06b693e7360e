//! Gradients of irradiance from the samples of one hemisphere.

use crate::gather::samples::{HemisphereSamples, MIN_COS_HIT};
use crate::gather::strata::Layout;
use crate::math::{Color, Frame, Mat3, Vec2};
use std::f32::consts::TAU;

/// A gradient in the tangent plane: the change of irradiance per unit along each tangent of the
/// gather's frame.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Gradient {
    /// Along `frame.s`.
    pub s: Color,
    /// Along `frame.t`.
    pub t: Color,
}

impl Gradient {
    /// The matrix that takes a world-space vector to the change of irradiance.
    pub fn to_world(self, frame: &Frame) -> Mat3 {
        Mat3::from_cols(
            self.s * frame.s.x + self.t * frame.t.x,
            self.s * frame.s.y + self.t * frame.t.y,
            self.s * frame.s.z + self.t * frame.t.z,
        )
    }

    fn add(&mut self, direction: Vec2, value: Color) {
        self.s += value * direction.x;
        self.t += value * direction.y;
    }
}

impl HemisphereSamples {
    /// Rotational gradient `G = Σ Ω_k L_k (n × w_k)`: for the normal n' = n + α × n with small α,
    /// `E(n') = E + α·G`, and for a near normal n' `α = n × n'` [WardHeckbert92].
    ///
    /// The weight of a cosine-distributed ray is tan θ here, whose variance is infinite. So no ray
    /// stands for more than `1/sqrt(N)` of the hemisphere: the few rays that graze the horizon
    /// would leave splotches on curved surfaces. The bound takes light away only from less than
    /// `1/(2 sqrt(N))` above the horizon, and the loss vanishes with growing N.
    pub fn rotational_gradient(&self) -> Gradient {
        let b = &self.bundle;
        let mut g = Gradient::default();
        let largest = TAU / (b.len() as f32).sqrt();
        for k in 0..b.len() {
            let w = b.dir_local[k];
            // n × w with n = (0, 0, 1).
            g.add(Vec2::new(-w.y, w.x), b.radiance[k] * self.solid_angle(k).min(largest));
        }
        g
    }

    /// The gradient of Ward and Heckbert [WardHeckbert92], in the notation of [Krivanek05]: ring j
    /// from the pole, sector k,
    ///
    /// ```text
    /// ∇E = Σ_k { u_k (2π/N) Σ_{j≥1} sin θ_j- cos² θ_j- (L_jk - L_{j-1,k}) / min(r_jk, r_{j-1,k})
    ///          + v_k- Σ_j (sin θ_j+ - sin θ_j-) (L_jk - L_{j,k-1}) / min(r_jk, r_{j,k-1}) }
    /// ```
    ///
    /// u_k points along the middle of sector k, v_k- is perpendicular to its lower boundary; with
    /// cosine density sin² θ_j- = j/M.
    ///
    /// What rays beside the strata found is smaller than a stratum. Moved boundaries would cut it
    /// off at whatever is near in the next stratum; it counts as patches.
    pub(in crate::gather) fn ward_heckbert(&self) -> Gradient {
        let Layout::Polar { m, n } = self.layout else {
            panic!("the Ward-Heckbert gradient needs the polar layout")
        };
        let (m, n) = (m as usize, n as usize);
        let b = &self.bundle;
        let sin_lower = |j: usize| b.density.angle(j as f32 / m as f32).sin();
        let mut g = self.of_patches(&b.found);
        for k in 0..n {
            let before = (k + n - 1) % n;
            let (mut across_rings, mut across_sectors) = (Color::ZERO, Color::ZERO);
            for j in 0..m {
                let here = j * n + k;
                let side = j * n + before;
                let nearer = b.distance[here].min(b.distance[side]);
                across_sectors +=
                    (sin_lower(j + 1) - sin_lower(j)) * (b.of_ray(here) - b.of_ray(side)) / nearer;
                if j > 0 {
                    let inner = here - n;
                    let nearer = b.distance[here].min(b.distance[inner]);
                    let sin = sin_lower(j);
                    across_rings +=
                        sin * (1.0 - sin * sin) * (b.of_ray(here) - b.of_ray(inner)) / nearer;
                }
            }
            let (middle, lower) = (TAU * (k as f32 + 0.5) / n as f32, TAU * k as f32 / n as f32);
            g.add(Vec2::new(middle.cos(), middle.sin()), across_rings * (TAU / n as f32));
            g.add(Vec2::new(-lower.sin(), lower.cos()), across_sectors);
        }
        g
    }

    /// The per-sample gradient: a hit q at distance r with normal n_q seen under cos ξ stands for a
    /// fixed patch, so `∇(Ω cos θ) = Ω cos θ (n_q/(r cos ξ) + 4 w/r)` [Krivanek05, Eq. 10-11 for
    /// the cosine-weighted solid angle]. Escaped rays contribute nothing.
    pub(in crate::gather) fn per_sample(&self) -> Gradient {
        self.of_patches(&self.bundle.radiance)
    }

    /// The same for a part of the radiance.
    fn of_patches(&self, radiance: &[Color]) -> Gradient {
        let b = &self.bundle;
        let mut g = Gradient::default();
        for (k, radiance) in radiance.iter().enumerate() {
            let r = b.distance[k];
            if r.is_finite() {
                let w = b.dir_local[k];
                let normal = self.frame.to_local(b.normal[k]);
                let cos_hit = (-normal.dot(w)).max(MIN_COS_HIT);
                let direction = (normal / cos_hit + 4.0 * w) / r;
                g.add(direction.truncate(), *radiance * (w.z * self.solid_angle(k)));
            }
        }
        g
    }
}
