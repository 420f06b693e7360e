//! Rotations: about the pole for every basis, general ones for spherical harmonics.

use super::functions::{Basis, LANES, Lane, MAX_ORDER, index};
use super::quadrature::gauss_legendre;
use super::sh::Sh;
use crate::math::{Frame, Vec3};
use std::f32::consts::PI;

/// A rotation `R = R_z(α) R_y(β) R_z(γ)`, angles in radians, 0 ≤ β ≤ π.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Turn {
    /// About the pole, last.
    pub alpha: f32,
    /// The tilt.
    pub beta: f32,
    /// About the pole, first.
    pub gamma: f32,
}

impl Turn {
    /// The rotation that takes local coordinates in the frame `from` to those in `to`: of a
    /// function given in the local frame `from`, its rotated coefficients are those in `to`.
    pub fn between(from: &Frame, to: &Frame) -> Self {
        // R_ij = to_i · from_j; the tilt's axis lies along the projection of from.n.
        let pole = to.to_local(from.n);
        let beta = pole.x.hypot(pole.y).atan2(pole.z);
        if beta < 1e-5 {
            let s = to.to_local(from.s);
            return Self { alpha: s.y.atan2(s.x), beta, gamma: 0.0 };
        }
        let back = from.to_local(to.n);
        Self { alpha: pole.y.atan2(pole.x), beta, gamma: back.y.atan2(-back.x) }
    }

    /// The rotation back.
    #[must_use]
    pub fn inverse(self) -> Self {
        // R_z(-γ) R_y(-β) R_z(-α), and R_y(-β) = R_z(π) R_y(β) R_z(-π).
        Self { alpha: PI - self.gamma, beta: self.beta, gamma: -PI - self.alpha }
    }

    /// The rotated vector.
    pub fn apply(self, v: Vec3) -> Vec3 {
        let about_z = |v: Vec3, angle: f32| {
            let (s, c) = angle.sin_cos();
            Vec3::new(c * v.x - s * v.y, s * v.x + c * v.y, v.z)
        };
        let (s, c) = self.beta.sin_cos();
        let v = about_z(v, self.gamma);
        about_z(Vec3::new(c * v.x + s * v.z, v.y, c * v.z - s * v.x), self.alpha)
    }
}

/// Rotates the function with the given coefficients of any basis about the pole by `angle`:
/// exactly. The length of `coefficients` is the square of the order.
pub fn rotate_z(coefficients: &mut [f32], angle: f32) {
    if angle == 0.0 {
        return;
    }
    let order = coefficients.len().isqrt();
    let (sin1, cos1) = angle.sin_cos();
    let (mut c, mut s) = (cos1, sin1);
    for m in 1..order {
        for l in m..order {
            let (plus, minus) = (l * l + l + m, l * l + l - m);
            let (a, b) = (coefficients[plus], coefficients[minus]);
            coefficients[plus] = c * a - s * b;
            coefficients[minus] = s * a + c * b;
        }
        (c, s) = (c * cos1 - s * sin1, s * cos1 + c * sin1);
    }
}

/// Rotation of spherical harmonics of one order by any [`Turn`].
pub struct ShRotation {
    /// Rotation by -90° about x, which takes z to y, band after band, each a square matrix by
    /// rows.
    quarter: Vec<f32>,
    /// Tilts up to this angle are made by the series.
    series_below: f32,
}

/// Largest error of the series for small tilts, as a share of the norm of the coefficients.
const SERIES_ERROR: f32 = 1e-3;

impl ShRotation {
    /// Rotations of harmonics of `order`.
    pub fn new(order: usize) -> Self {
        let sh = Sh::new(order);
        let nodes = gauss_legendre(order, -1.0, 1.0);
        let columns = 2 * order;
        let mut matrices = vec![0f64; (0..order).map(|l| (2 * l + 1) * (2 * l + 1)).sum()];
        let (mut here, mut turned) =
            (vec![Lane::default(); order * order], vec![Lane::default(); order * order]);
        // Products of two functions of one band are polynomials that this quadrature integrates
        // exactly.
        for &(z, weight) in &nodes {
            let r = (1.0 - z * z).sqrt();
            for first in (0..columns).step_by(LANES) {
                let w: [Vec3; LANES] = std::array::from_fn(|k| {
                    let (s, c) =
                        (std::f64::consts::TAU * (first + k) as f64 / columns as f64).sin_cos();
                    Vec3::new((r * c) as f32, (r * s) as f32, z as f32)
                });
                sh.values(&w, &mut here);
                // The inverse: +90° about x takes y to z and z to -y.
                sh.values(&w.map(|w| Vec3::new(w.x, -w.z, w.y)), &mut turned);
                let weight = weight * std::f64::consts::TAU / columns as f64;
                let lanes = LANES.min(columns - first);
                let mut at = 0;
                for l in 0..order {
                    let band = l * l..(l + 1) * (l + 1);
                    for i in band.clone() {
                        for j in band.clone() {
                            let sum: f64 = (0..lanes)
                                .map(|k| f64::from(here[i][k]) * f64::from(turned[j][k]))
                                .sum();
                            matrices[at] += weight * sum;
                            at += 1;
                        }
                    }
                }
            }
        }
        let bands = (order - 1).max(1) as f32;
        Self {
            quarter: matrices.iter().map(|x| *x as f32).collect(),
            // The remainder of exp(βG) after the second order is at most (β‖G‖)³/6, and ‖G‖ is the
            // highest l.
            series_below: (6.0 * SERIES_ERROR).cbrt() / bands,
        }
    }

    /// Rotates the function with the coefficients `c`, which may be of a lower order: by
    /// factorisation into rotations about the pole and two quarter turns, exact up to rounding; by
    /// a series where that errs by less than 0.1 %.
    pub fn rotate(&self, c: &mut [f32], turn: Turn) {
        rotate_z(c, turn.gamma);
        if turn.beta <= self.series_below {
            self.series(c, turn.beta);
        } else {
            // R_y(β) = Q R_z(β) Q⁻¹ with Q z = y.
            self.quarter(c, true);
            rotate_z(c, turn.beta);
            self.quarter(c, false);
        }
        rotate_z(c, turn.alpha);
    }

    /// Applies the quarter turn, or its inverse, which is its transpose.
    fn quarter(&self, c: &mut [f32], inverse: bool) {
        let mut at = 0;
        let mut out = [0.0; 2 * MAX_ORDER];
        for l in 0..c.len().isqrt() {
            let width = 2 * l + 1;
            let band = &mut c[l * l..(l + 1) * (l + 1)];
            let matrix = &self.quarter[at..at + width * width];
            for (i, out) in out[..width].iter_mut().enumerate() {
                let element =
                    |j: usize| if inverse { matrix[j * width + i] } else { matrix[i * width + j] };
                *out = band.iter().enumerate().map(|(j, x)| element(j) * x).sum();
            }
            band.copy_from_slice(&out[..width]);
            at += width * width;
        }
    }

    /// `c + β G c + β²/2 G² c` with the generator G of rotations about y [Krivanek06, for tilts by
    /// small angles].
    fn series(&self, c: &mut [f32], beta: f32) {
        let mut term = c.to_vec();
        for k in [1.0, 2.0] {
            term = self.generator(&term);
            for (c, t) in c.iter_mut().zip(&mut term) {
                *t *= beta / k;
                *c += *t;
            }
        }
    }

    /// G c: antisymmetric, it couples m with m ± 1 within the cosine and within the sine functions.
    fn generator(&self, c: &[f32]) -> Vec<f32> {
        let mut out = vec![0.0; c.len()];
        for l in 1..c.len().isqrt() {
            let li = l as i32;
            for m in 0..li {
                let g = if m == 0 {
                    (0.5 * (l * (l + 1)) as f32).sqrt()
                } else {
                    0.5 * (((li - m) * (li + m + 1)) as f32).sqrt()
                };
                let mut couple = |low: usize, high: usize| {
                    out[high] += g * c[low];
                    out[low] -= g * c[high];
                };
                couple(index(l, m), index(l, m + 1));
                if m > 0 {
                    couple(index(l, -m), index(l, -m - 1));
                }
            }
        }
        out
    }
}
