//! The part of one edge in the irradiance that a polygon of constant radiance sends to a surface,
//! differentiated twice by the position of the surface.
//!
//! Irradiance from a polygon is a sum over its edges [Arvo94; HolzschuchSillion98]; its derivatives
//! are integrals along them of r/(r·r)² and r rᵀ/(r·r)³, whose closed forms cancel badly on short
//! edges and on those that point at the receiver, as the silhouettes of a triangulated hemisphere
//! do. We integrate over the parameter u of the chord between the two directions, `ĉ(u) = (1-u) â +
//! u b̂`, instead of over the edge. The point of the edge that lies in direction ĉ has the inverse
//! distance `d(u) = (1-u) p_a + u p_b` per |ĉ|, where p = 1/distance, and everything becomes a
//! polynomial in p_a and p_b whose coefficients depend on the angle alone:
//!
//! ```text
//! ∇E  = ½ G M + κ S              M = n × (p_a b̂ - p_b â),  κ = n·(â × b̂),  S = ∫ ĉ d/g²
//! ∇²E = M Sᵀ + S Mᵀ + κ (4 ∫ ĉ ĉᵀ d²/g³ - Id ∫ d²/g²)
//! ```
//!
//! with `g = |ĉ|² = 1 - z u(1-u)`, `z = |â - b̂|²`, `G = ∫ 1/g` and all integrals over u in [0, 1].
//! Nothing is divided by a difference, edges of any direction and length are equally precise, and a
//! ray that left the scene has p = 0 exactly. The precision is double: the
//! parts of neighbouring edges cancel.

use std::ops::{Add, Mul, Sub};

/// Edges that are worked on together: what a vector register of AVX2 holds.
const LANES: usize = 4;

/// One number of each of four edges. The compiler turns its arithmetic into vector instructions.
#[derive(Clone, Copy, Debug)]
struct Lanes([f64; LANES]);

macro_rules! by_lane {
    ($operation:ident, $function:ident, $operator:tt) => {
        impl $operation for Lanes {
            type Output = Self;

            #[inline(always)]
            fn $function(self, other: Self) -> Self {
                Self(std::array::from_fn(|k| self.0[k] $operator other.0[k]))
            }
        }
    };
}
by_lane!(Add, add, +);
by_lane!(Sub, sub, -);
by_lane!(Mul, mul, *);

impl Mul<Lanes> for f64 {
    type Output = Lanes;

    #[inline(always)]
    fn mul(self, other: Lanes) -> Lanes {
        Lanes(other.0.map(|x| self * x))
    }
}

/// A vertex of the triangulated hemisphere, seen from the receiver: unit direction with z along the
/// receiver's normal, and 1/distance, 0 for what is infinitely far.
pub type Vertex = [f64; 4];

/// Edges on their way into the sum; four wait until they are worked on together.
pub struct EdgeSum {
    from: [[f64; BATCH]; 4],
    to: [[f64; BATCH]; 4],
    difference: [[f64; BATCH]; 3],
    waiting: usize,
    /// Gradient (x, y) and Hessian (xx, xy, yy) in the tangent plane, per channel.
    sum: [[Lanes; 3]; 5],
}

/// Edges that wait; many, so that they are out of the processor's store buffers before they are
/// read again.
const BATCH: usize = 32;

impl EdgeSum {
    /// Nothing yet.
    pub fn new() -> Self {
        Self {
            from: [[0.0; BATCH]; 4],
            to: [[0.0; BATCH]; 4],
            difference: [[0.0; BATCH]; 3],
            waiting: 0,
            sum: [[Lanes([0.0; LANES]); 3]; 5],
        }
    }

    /// Adds the edge from `a` to `b`, whose left side is brighter than its right one by
    /// `difference`.
    #[inline]
    pub fn add(&mut self, a: &Vertex, b: &Vertex, difference: [f64; 3]) {
        let k = self.waiting;
        for (slots, x) in self.from.iter_mut().zip(a) {
            slots[k] = *x;
        }
        for (slots, x) in self.to.iter_mut().zip(b) {
            slots[k] = *x;
        }
        for (slots, x) in self.difference.iter_mut().zip(difference) {
            slots[k] = x;
        }
        self.waiting += 1;
        if self.waiting == BATCH {
            self.flush();
        }
    }

    fn flush(&mut self) {
        // What is left over in the last lanes counts for nothing.
        for slots in &mut self.difference {
            slots[self.waiting..].fill(0.0);
        }
        for k in (0..self.waiting).step_by(LANES) {
            let load = |slots: &[f64; BATCH]| Lanes(std::array::from_fn(|l| slots[k + l]));
            let share = share(&self.from.each_ref().map(load), &self.to.each_ref().map(load));
            let difference = self.difference.each_ref().map(load);
            for (sums, share) in self.sum.iter_mut().zip(share) {
                for (sum, difference) in sums.iter_mut().zip(difference) {
                    *sum = *sum + share * difference;
                }
            }
        }
        self.waiting = 0;
    }

    /// Gradient (x, y) and Hessian (xx, xy, yy) in the tangent plane, per channel.
    pub fn finish(mut self) -> [[f64; 3]; 5] {
        self.flush();
        self.sum.map(|channels| channels.map(|lanes| lanes.0.iter().sum()))
    }
}

/// ∫1/g, ∫u(1-u)/g² and ∫u²(1-u)²/g³ as power series in z: `Σ z^m B(m+1, m+1)`, `Σ (m+1) z^m B(m+2,
/// m+2)`, `Σ ½(m+1)(m+2) z^m B(m+3, m+3)`, B being Euler's beta function.
const SERIES: [[f64; LONGEST]; 3] = series();
/// Terms for the widest edges; `(z/4)^m` bounds the m-th one's share, and z is below 2 on every
/// hemisphere of 4 x 4 or more samples.
const LONGEST: usize = 64;
/// Up to these z, 8 and 16 terms are enough.
const NARROW: f64 = 0.07;
const WIDE: f64 = 0.5;

const fn series() -> [[f64; LONGEST]; 3] {
    let mut out = [[0.0; LONGEST]; 3];
    // B(1, 1), B(2, 2), B(3, 3).
    let mut term = [1.0, 1.0 / 6.0, 1.0 / 30.0];
    let mut m = 0;
    while m < LONGEST {
        let mut k = 0;
        while k < 3 {
            out[k][m] = term[k];
            // B(x+1, x+1)/B(x, x) = x/(2 (2x+1)), and the binomial factor grows by (m+1+k)/(m+1).
            let x = (m + 1 + k) as f64;
            term[k] *= x / (2.0 * (2.0 * x + 1.0)) * (m + 1 + k) as f64 / (m + 1) as f64;
            k += 1;
        }
        m += 1;
    }
    out
}

/// The first N terms of each series.
#[inline(always)]
fn sum<const N: usize>(z: Lanes) -> [Lanes; 3] {
    SERIES.each_ref().map(|terms| {
        terms[..N].iter().rev().fold(Lanes([0.0; LANES]), |sum, t| sum * z + Lanes([*t; LANES]))
    })
}

/// Derivatives of the irradiance from the left sides of edges, per unit radiance: gradient (x, y),
/// Hessian (xx, xy, yy).
#[inline(always)]
fn share([ux, uy, uz, p]: &[Lanes; 4], [vx, vy, vz, q]: &[Lanes; 4]) -> [Lanes; 5] {
    let [ux, uy, uz, p, vx, vy, vz, q] = [*ux, *uy, *uz, *p, *vx, *vy, *vz, *q];
    let (dx, dy, dz) = (ux - vx, uy - vy, uz - vz);
    let z = dx * dx + dy * dy + dz * dz;
    // Enough terms for 12 digits.
    let widest = z.0.into_iter().fold(0.0, f64::max);
    let [g1, b2, c22] = if widest < NARROW {
        sum::<8>(z)
    } else if widest < WIDE {
        sum::<16>(z)
    } else {
        sum::<LONGEST>(z)
    };
    // The other integrals, from u(1-u) z = 1 - g: first ∫1/g², ∫u(1-u)/g³, ∫1/g³.
    let g2 = g1 + z * b2;
    let b3 = b2 + z * c22;
    let g3 = g2 + z * b3;
    // ∫(1-u)²/g², ∫(1-u)³u/g³, ∫(1-u)⁴/g³.
    let a2 = 0.5 * g2 - b2;
    let c31 = 0.5 * b3 - c22;
    let c40 = 0.5 * g3 - 4.0 * c31 - 3.0 * c22;

    let kappa = ux * vy - uy * vx;
    let (mx, my) = (q * uy - p * vy, p * vx - q * ux);
    let (of_u, of_v) = (p * a2 + q * b2, p * b2 + q * a2);
    let (sx, sy) = (ux * of_u + vx * of_v, uy * of_u + vy * of_v);
    let (pp, pq, qq) = (p * p, 2.0 * p * q, q * q);
    let trace = (pp + qq) * a2 + pq * b2;
    let (uu, uv, vv) = (
        pp * c40 + pq * c31 + qq * c22,
        (pp + qq) * c31 + pq * c22,
        pp * c22 + pq * c31 + qq * c40,
    );
    // 4 ∫ĉĉᵀd²/g³ - Id ∫d²/g².
    let xx = 4.0 * (uu * ux * ux + 2.0 * uv * ux * vx + vv * vx * vx) - trace;
    let yy = 4.0 * (uu * uy * uy + 2.0 * uv * uy * vy + vv * vy * vy) - trace;
    let xy = 4.0 * (uu * ux * uy + uv * (ux * vy + uy * vx) + vv * vx * vy);
    let half = 0.5 * g1;
    [
        half * mx + kappa * sx,
        half * my + kappa * sy,
        2.0 * mx * sx + kappa * xx,
        mx * sy + my * sx + kappa * xy,
        2.0 * my * sy + kappa * yy,
    ]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::DVec3;
    use crate::sampling::Rng;

    /// Irradiance from a polygon of unit radiance, Lambert's formula.
    fn irradiance(x: DVec3, corners: &[DVec3]) -> f64 {
        let pairs = corners.iter().zip(corners.iter().cycle().skip(1));
        pairs
            .map(|(a, b)| {
                let (a, b) = (*a - x, *b - x);
                let c = a.cross(b);
                0.5 * c.z / c.length() * c.length().atan2(a.dot(b))
            })
            .sum()
    }

    fn vertex(direction: DVec3, inverse: f64) -> Vertex {
        direction.normalize().extend(inverse).to_array()
    }

    /// The derivatives of the irradiance from a polygon of radiance 1.
    fn polygon(x: DVec3, corners: &[DVec3]) -> [f64; 5] {
        let seen: Vec<Vertex> =
            corners.iter().map(|c| vertex(*c - x, 1.0 / (*c - x).length())).collect();
        let mut sum = EdgeSum::new();
        for (a, b) in seen.iter().zip(seen.iter().cycle().skip(1)) {
            sum.add(a, b, [1.0, 0.0, 0.0]);
        }
        sum.finish().map(|c| c[0])
    }

    #[test]
    fn derivatives_agree_with_finite_differences_of_lamberts_formula() {
        let mut rng = Rng::new(11);
        for _ in 0..300 {
            // Any triangle above the plane: near and far corners, edges up to a right angle wide,
            // narrow ones that point at x.
            let mut corner = || {
                let (phi, z) =
                    (6.3 * f64::from(rng.next_f32()), 0.05 + 0.9 * f64::from(rng.next_f32()));
                let r = (1.0 - z * z).sqrt();
                DVec3::new(r * phi.cos(), r * phi.sin(), z)
                    * 10.0_f64.powf(2.0 * f64::from(rng.next_f32()) - 0.5)
            };
            let corners = [corner(), corner(), corner()];
            let widest =
                (0..3).map(|k| corners[k].angle_between(corners[(k + 1) % 3])).fold(0.0, f64::max);
            let nearest = corners.iter().map(|c| c.length()).fold(f64::INFINITY, f64::min);
            if widest > 1.5 {
                continue;
            }
            let got = polygon(DVec3::ZERO, &corners);
            let h = 2e-4 * nearest;
            let e = |i: f64, j: f64| irradiance(DVec3::new(h * i, h * j, 0.0), &corners);
            let expected = [
                (e(1.0, 0.0) - e(-1.0, 0.0)) / (2.0 * h),
                (e(0.0, 1.0) - e(0.0, -1.0)) / (2.0 * h),
                (e(1.0, 0.0) + e(-1.0, 0.0) - 2.0 * e(0.0, 0.0)) / (h * h),
                (e(1.0, 1.0) + e(-1.0, -1.0) - e(1.0, -1.0) - e(-1.0, 1.0)) / (4.0 * h * h),
                (e(0.0, 1.0) + e(0.0, -1.0) - 2.0 * e(0.0, 0.0)) / (h * h),
            ];
            for (k, (g, x)) in got.iter().zip(&expected).enumerate() {
                let scale = if k < 2 { 1.0 / nearest } else { 1.0 / (nearest * nearest) };
                assert!((g - x).abs() < 2e-6 * scale, "{k}: {g} instead of {x} for {corners:?}");
            }
        }
    }

    #[test]
    fn the_series_meet_where_one_takes_over_from_another() {
        let lanes = |z| Lanes([z; LANES]);
        for (short, long) in [
            (sum::<8>(lanes(NARROW)), sum::<LONGEST>(lanes(NARROW))),
            (sum::<16>(lanes(WIDE)), sum::<LONGEST>(lanes(WIDE))),
        ] {
            for (a, b) in short.iter().zip(long) {
                assert!((a.0[0] / b.0[0] - 1.0).abs() < 1e-12, "{a:?} {b:?}");
            }
        }
        // ∫1/g is Θ/sin Θ.
        let theta = 1.2_f64;
        assert!(
            (sum::<LONGEST>(lanes(2.0 - 2.0 * theta.cos()))[0].0[0] - theta / theta.sin()).abs()
                < 1e-13
        );
    }

    #[test]
    fn an_infinitely_far_corner_is_the_limit_of_far_ones() {
        let direction = |x: f64, y: f64| DVec3::new(x, y, 0.7);
        let at = |inverse| {
            let mut sum = EdgeSum::new();
            sum.add(
                &vertex(direction(0.3, 0.1), 0.5),
                &vertex(direction(0.1, 0.4), inverse),
                [1.0; 3],
            );
            sum.finish()
        };
        for (limit, close) in at(0.0).iter().zip(at(1e-9)) {
            assert!((limit[0] - close[0]).abs() < 1e-8, "{limit:?} {close:?}");
        }
    }

    #[test]
    fn any_number_of_edges_adds_up() {
        let corners =
            [DVec3::new(0.3, 0.1, 1.0), DVec3::new(-0.2, 0.5, 2.0), DVec3::new(0.1, -0.4, 1.5)];
        let once = polygon(DVec3::ZERO, &corners);
        for times in [2, 10, 11, 43] {
            let many: Vec<DVec3> = corners.iter().copied().cycle().take(3 * times).collect();
            for (a, b) in once.iter().zip(polygon(DVec3::ZERO, &many)) {
                assert!((a * times as f64 - b).abs() < 1e-12 * times as f64, "{times}: {a} {b}");
            }
        }
    }
}
