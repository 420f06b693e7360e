//! The share of one edge in the irradiance that a polygon of constant radiance sends to a surface, differentiated twice by the position of that surface.
//!
//! Irradiance from a polygon is a sum over its edges [Arvo94; HolzschuchSillion98]; its derivatives are integrals along them of r/(r·r)² and r rᵀ/(r·r)³, whose closed
//! forms cancel badly on short edges and on those that point at the receiver, as the silhouettes of a triangulated hemisphere do. We integrate over the parameter u of the chord between
//! the two directions, `ĉ(u) = (1-u) â + u b̂`, instead of over the edge. The point of the edge that lies in direction ĉ has the inverse distance `d(u) = (1-u) p_a + u p_b` per |ĉ|, where p = 1/distance, and
//! everything becomes a polynomial in p_a and p_b whose coefficients depend on the angle alone:
//!
//! ```text
//! ∇E  = ½ G M + κ S              M = n × (p_a b̂ - p_b â),  κ = n·(â × b̂),  S = ∫ ĉ d/g²
//! ∇²E = M Sᵀ + S Mᵀ + κ (4 ∫ ĉ ĉᵀ d²/g³ - Id ∫ d²/g²)
//! ```
//!
//! with `g = |ĉ|² = 1 - z u(1-u)`, `z = |â - b̂|²`, `G = ∫ 1/g` and all integrals over u in [0, 1]. Nothing is divided by a difference, edges of any direction and length are equally precise, and a ray that
//! left the scene has p = 0 exactly. Double precision: the shares of neighbouring edges cancel.

use crate::math::{DVec2, DVec3};

/// A vertex of the triangulated hemisphere, seen from the receiver.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Vertex {
    /// Unit direction, z along the receiver's normal.
    pub direction: DVec3,
    /// 1/distance; 0 for what is infinitely far.
    pub inverse: f64,
}

/// Derivatives in the tangent plane of the irradiance from an edge's left side, per unit radiance: gradient (x, y), Hessian (xx, xy, yy).
pub(super) type Share = [f64; 5];

/// ∫1/g, ∫u(1-u)/g² and ∫u²(1-u)²/g³ as power series in z: `Σ z^m B(m+1, m+1)`, `Σ (m+1) z^m B(m+2, m+2)`, `Σ ½(m+1)(m+2) z^m B(m+3, m+3)`, B being Euler's beta function.
const SERIES: [[f64; LONGEST]; 3] = series();
/// Terms for the widest edges; `(z/4)^m` bounds the m-th one's share, and z is below 2 on every hemisphere of 4 x 4 or more samples.
const LONGEST: usize = 64;

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
#[inline]
fn sum<const N: usize>(z: f64) -> [f64; 3] {
    let mut out = [0.0; 3];
    for (sum, terms) in out.iter_mut().zip(&SERIES) {
        for t in terms[..N].iter().rev() {
            *sum = *sum * z + t;
        }
    }
    out
}

/// The share of the edge from `a` to `b`.
#[inline]
pub(super) fn share(a: &Vertex, b: &Vertex) -> Share {
    let (p, q) = (a.inverse, b.inverse);
    let z = a.direction.distance_squared(b.direction);
    // Enough terms for 12 digits.
    let [g1, b2, c22] = if z < 0.07 {
        sum::<8>(z)
    } else if z < 0.5 {
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

    let (u, v) = (a.direction.truncate(), b.direction.truncate());
    let kappa = u.perp_dot(v);
    let m = (p * v - q * u).perp();
    let s = u * (p * a2 + q * b2) + v * (p * b2 + q * a2);
    let gradient: DVec2 = 0.5 * g1 * m + kappa * s;
    let (pp, pq, qq) = (p * p, 2.0 * p * q, q * q);
    let trace = (pp + qq) * a2 + pq * b2;
    let (uu, uv, vv) = (pp * c40 + pq * c31 + qq * c22, pp * c31 + pq * c22 + qq * c31, pp * c22 + pq * c31 + qq * c40);
    // 4 ∫ĉĉᵀd²/g³ - Id ∫d²/g².
    let xx = 4.0 * (uu * u.x * u.x + 2.0 * uv * u.x * v.x + vv * v.x * v.x) - trace;
    let yy = 4.0 * (uu * u.y * u.y + 2.0 * uv * u.y * v.y + vv * v.y * v.y) - trace;
    let xy = 4.0 * (uu * u.x * u.y + uv * (u.x * v.y + u.y * v.x) + vv * v.x * v.y);
    [gradient.x, gradient.y, 2.0 * m.x * s.x + kappa * xx, m.x * s.y + m.y * s.x + kappa * xy, 2.0 * m.y * s.y + kappa * yy]
}

#[cfg(test)]
mod tests {
    use super::*;
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

    fn polygon_share(x: DVec3, corners: &[DVec3]) -> Share {
        let seen: Vec<Vertex> =
            corners.iter().map(|c| *c - x).map(|r| Vertex { direction: r.normalize(), inverse: 1.0 / r.length() }).collect();
        let mut sum = [0.0; 5];
        for (a, b) in seen.iter().zip(seen.iter().cycle().skip(1)) {
            for (s, t) in sum.iter_mut().zip(share(a, b)) {
                *s += t;
            }
        }
        sum
    }

    #[test]
    fn derivatives_agree_with_finite_differences_of_lamberts_formula() {
        let mut rng = Rng::new(11);
        for _ in 0..300 {
            // Any triangle above the plane: near and far corners, edges up to a right angle wide, narrow ones that point at x.
            let mut corner = || {
                let (phi, z) = (6.3 * f64::from(rng.next_f32()), 0.05 + 0.9 * f64::from(rng.next_f32()));
                let r = (1.0 - z * z).sqrt();
                DVec3::new(r * phi.cos(), r * phi.sin(), z) * 10.0_f64.powf(2.0 * f64::from(rng.next_f32()) - 0.5)
            };
            let corners = [corner(), corner(), corner()];
            let widest = (0..3).map(|k| corners[k].angle_between(corners[(k + 1) % 3])).fold(0.0, f64::max);
            let nearest = corners.iter().map(|c| c.length()).fold(f64::INFINITY, f64::min);
            if widest > 1.5 {
                continue;
            }
            let got = polygon_share(DVec3::ZERO, &corners);
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
        for z in [0.07, 0.5] {
            let (short, long) = if z < 0.1 { (sum::<8>(z), sum::<LONGEST>(z)) } else { (sum::<16>(z), sum::<LONGEST>(z)) };
            for (a, b) in short.iter().zip(long) {
                assert!((a / b - 1.0).abs() < 1e-12, "{a} {b}");
            }
        }
        // ∫1/g is Θ/sin Θ.
        let theta = 1.2_f64;
        assert!((sum::<LONGEST>(2.0 - 2.0 * theta.cos())[0] - theta / theta.sin()).abs() < 1e-13);
    }

    #[test]
    fn an_infinitely_far_corner_is_the_limit_of_far_ones() {
        let direction = |x: f64, y: f64| DVec3::new(x, y, 0.7).normalize();
        let near = Vertex { direction: direction(0.3, 0.1), inverse: 0.5 };
        let at = |inverse| share(&near, &Vertex { direction: direction(0.1, 0.4), inverse });
        for (limit, close) in at(0.0).iter().zip(at(1e-9)) {
            assert!((limit - close).abs() < 1e-8, "{limit} {close}");
        }
    }
}
