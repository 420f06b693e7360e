//! Real spherical harmonics.

use super::functions::{Basis, Jet, LANES, Lane, MAX_ORDER, index, triangle};
use crate::math::{DVec3, Vec3};
use glam::DMat3;
use std::f64::consts::PI;

/// Real spherical harmonics Y_lm, orthonormal on the sphere.
pub struct Sh {
    order: usize,
    /// T_mm / sin^m θ for each m, the factor √2 of m > 0 included.
    first: Vec<f32>,
    /// Coefficients (a, b) of `P_lm = a (z P_{l-1,m} - b P_{l-2,m})` for each m and then l = m+1
    /// .. n-1.
    steps: Vec<[f32; 2]>,
    /// Normalisation of the unnormalised Legendre derivatives, by `triangle(l, m)`.
    norms: Vec<f64>,
}

impl Sh {
    /// The harmonics of bands below `order`, which is in 1 ..= [`MAX_ORDER`].
    pub fn new(order: usize) -> Self {
        Self::scaled(order, 1.0)
    }

    /// [`Sh::new`] with every function multiplied by `scale`.
    pub(super) fn scaled(order: usize, scale: f64) -> Self {
        assert!((1..=MAX_ORDER).contains(&order), "the order of a basis is from 1 to {MAX_ORDER}");
        let (mut first, mut steps) = (Vec::new(), Vec::new());
        let mut diagonal = scale * (0.25 / PI).sqrt();
        for m in 0..order {
            if m > 0 {
                diagonal *= ((2 * m + 1) as f64 / (2 * m) as f64).sqrt();
            }
            first.push((if m > 0 { diagonal * 2f64.sqrt() } else { diagonal }) as f32);
            for l in m + 1..order {
                let square = |k: usize| (k * k) as f64;
                let a = ((4.0 * square(l) - 1.0) / (square(l) - square(m))).sqrt();
                let b = ((square(l - 1) - square(m)) / (4.0 * square(l - 1) - 1.0)).max(0.0).sqrt();
                steps.push([a as f32, b as f32]);
            }
        }
        let mut norms = Vec::new();
        for l in 0..order {
            for m in 0..=l {
                // (l-m)!/(l+m)!
                let ratio: f64 = (l - m + 1..=l + m).map(|k| 1.0 / k as f64).product();
                let both = if m > 0 { 2.0 } else { 1.0 };
                norms.push(scale * (both * (2 * l + 1) as f64 / (4.0 * PI) * ratio).sqrt());
            }
        }
        Self { order, first, steps, norms }
    }

    /// All functions at eight unit directions, each with the components along x and y of its
    /// gradient on the sphere, that of [`Jet`]: the first [`Basis::count`] elements of `out` are
    /// written.
    ///
    /// Single precision. With `Y = P(z) C(x, y)`, C being the trigonometric factor times sin^m θ,
    /// the gradient is that of this polynomial without its radial part: `x∂C/∂x + y∂C/∂y = m C`.
    pub fn slopes(&self, w: &[Vec3; LANES], out: &mut [[Lane; 3]]) {
        let lanes = |f: &dyn Fn(Vec3) -> f32| w.map(f);
        let (x, y, z) = (lanes(&|w| w.x), lanes(&|w| w.y), lanes(&|w| w.z));
        // (x + iy)^m and (x + iy)^(m-1).
        let (mut c, mut s) = ([1.0; LANES], [0.0; LANES]);
        let (mut c1, mut s1) = ([0.0; LANES], [0.0; LANES]);
        let mut steps = self.steps.iter();
        for m in 0..self.order {
            let degree = m as f32;
            let (mut p0, mut p1) = ([0.0; LANES], [self.first[m]; LANES]);
            // dP/dz.
            let (mut d0, mut d1) = ([0.0; LANES], [0.0; LANES]);
            for l in m..self.order {
                if l > m {
                    let [a, b] = *steps.next().expect("one step for each l above m");
                    for k in 0..LANES {
                        (d0[k], d1[k]) = (d1[k], a * (p1[k] + z[k] * d1[k] - b * d0[k]));
                        (p0[k], p1[k]) = (p1[k], a * (z[k] * p1[k] - b * p0[k]));
                    }
                }
                let middle = l * l + l;
                let [value, gx, gy] = &mut out[middle + m];
                for k in 0..LANES {
                    let radial = (degree * p1[k] + z[k] * d1[k]) * c[k];
                    value[k] = p1[k] * c[k];
                    gx[k] = degree * p1[k] * c1[k] - x[k] * radial;
                    gy[k] = -degree * p1[k] * s1[k] - y[k] * radial;
                }
                if m > 0 {
                    let [value, gx, gy] = &mut out[middle - m];
                    for k in 0..LANES {
                        let radial = (degree * p1[k] + z[k] * d1[k]) * s[k];
                        value[k] = p1[k] * s[k];
                        gx[k] = degree * p1[k] * s1[k] - x[k] * radial;
                        gy[k] = degree * p1[k] * c1[k] - y[k] * radial;
                    }
                }
            }
            (c1, s1) = (c, s);
            for k in 0..LANES {
                (c[k], s[k]) = (x[k] * c[k] - y[k] * s[k], x[k] * s[k] + y[k] * c[k]);
            }
        }
    }

    /// The derivatives Q_lm of Legendre's polynomials as homogeneous polynomials of (x, y, z), at a
    /// unit vector: `Q_mm = (2m-1)!!`, `(l-m) Q_lm = (2l-1) z Q_{l-1,m} - (l+m-1) (x²+y²+z²)
    /// Q_{l-2,m}`.
    fn legendre(&self, z: f64) -> Vec<f64> {
        let mut q = vec![0.0; triangle(self.order, 0)];
        let mut diagonal = 1.0;
        for m in 0..self.order {
            if m > 0 {
                diagonal *= (2 * m - 1) as f64;
            }
            let (mut p0, mut p1) = (0.0, diagonal);
            q[triangle(m, m)] = diagonal;
            for l in m + 1..self.order {
                (p0, p1) =
                    (p1, ((2 * l - 1) as f64 * z * p1 - (l + m - 1) as f64 * p0) / (l - m) as f64);
                q[triangle(l, m)] = p1;
            }
        }
        q
    }
}

/// `T = C_m` or `S_m`, real or imaginary part of (x + iy)^m, with its derivatives: T, T_x, T_y,
/// T_xx, T_xy; T_yy is -T_xx.
fn trigonometric(powers: &[[f64; 2]], m: usize, sine: bool) -> [f64; 5] {
    let part = usize::from(sine);
    let power = |k: i32| if k < 0 { [0.0; 2] } else { powers[k as usize] };
    let k = m as i32;
    let (m, one, two) = (m as f64, power(k - 1), power(k - 2));
    // d/dy (x+iy)^m = i m (x+iy)^(m-1): the real part is -m S, the imaginary one m C.
    let turned = |p: [f64; 2]| if sine { p[0] } else { -p[1] };
    [
        powers[k as usize][part],
        m * one[part],
        m * turned(one),
        m * (m - 1.0) * two[part],
        m * (m - 1.0) * turned(two),
    ]
}

impl Basis for Sh {
    fn order(&self) -> usize {
        self.order
    }

    fn values(&self, w: &[Vec3; LANES], out: &mut [Lane]) {
        let lanes = |f: &dyn Fn(Vec3) -> f32| w.map(f);
        let (x, y, z) = (lanes(&|w| w.x), lanes(&|w| w.y), lanes(&|w| w.z));
        // (x + iy)^m.
        let (mut c, mut s) = ([1.0; LANES], [0.0; LANES]);
        let mut steps = self.steps.iter();
        for m in 0..self.order {
            let (mut p0, mut p1) = ([0.0; LANES], [self.first[m]; LANES]);
            for l in m..self.order {
                if l > m {
                    let [a, b] = *steps.next().expect("one step for each l above m");
                    for k in 0..LANES {
                        (p0[k], p1[k]) = (p1[k], a * (z[k] * p1[k] - b * p0[k]));
                    }
                }
                let middle = l * l + l;
                let cosine = &mut out[middle + m];
                for k in 0..LANES {
                    cosine[k] = p1[k] * c[k];
                }
                if m > 0 {
                    let sine = &mut out[middle - m];
                    for k in 0..LANES {
                        sine[k] = p1[k] * s[k];
                    }
                }
            }
            for k in 0..LANES {
                (c[k], s[k]) = (x[k] * c[k] - y[k] * s[k], x[k] * s[k] + y[k] * c[k]);
            }
        }
    }

    /// Solid harmonics in Cartesian form, which have no singular directions: `R_lm = N Q_l|m| T_m`
    /// with `∂Q_lm/∂x = -x Q_{l-1,m+1}`, `∂Q_lm/∂z = (l+m) Q_{l-1,m}`.
    fn jets(&self, w: DVec3, hessians: bool, out: &mut [Jet]) {
        let DVec3 { x, y, z } = w;
        let q = self.legendre(z);
        let q = |l: i32, m: usize| if l >= m as i32 { q[triangle(l as usize, m)] } else { 0.0 };
        let mut powers = vec![[1.0, 0.0]];
        for m in 1..self.order {
            let [c, s] = powers[m - 1];
            powers.push([x * c - y * s, x * s + y * c]);
        }
        for l in 0..self.order {
            let (li, lf) = (l as i32, l as f64);
            for m in -li..=li {
                let am = m.unsigned_abs() as usize;
                let [t, tx, ty, txx, txy] = trigonometric(&powers, am, m < 0);
                let (q0, q1) = (q(li, am), q(li - 1, am + 1));
                let (sum, below) = ((l + am) as f64, q(li - 1, am));
                let value = q0 * t;
                let gradient =
                    DVec3::new(-x * q1 * t + q0 * tx, -y * q1 * t + q0 * ty, sum * below * t);
                let norm = self.norms[triangle(l, am)];
                let jet = &mut out[index(l, m)];
                // To the extension of degree 0: R/|v|^l.
                jet.value = norm * value;
                jet.gradient = norm * (gradient - lf * value * w);
                jet.hessian = DMat3::ZERO;
                if hessians {
                    let (q2, qz1) = (q(li - 2, am + 2), q(li - 2, am + 1));
                    let xx = (x * x * q2 - q1) * t - 2.0 * x * q1 * tx + q0 * txx;
                    let yy = (y * y * q2 - q1) * t - 2.0 * y * q1 * ty - q0 * txx;
                    let xy = x * y * q2 * t - x * q1 * ty - y * q1 * tx + q0 * txy;
                    let xz = sum * (-x * qz1 * t + below * tx);
                    let yz = sum * (-y * qz1 * t + below * ty);
                    let zz = sum * (sum - 1.0) * q(li - 2, am) * t;
                    let solid = DMat3::from_cols(
                        DVec3::new(xx, xy, xz),
                        DVec3::new(xy, yy, yz),
                        DVec3::new(xz, yz, zz),
                    );
                    let radial = outer(gradient, w) + outer(w, gradient);
                    let constant = DMat3::from_diagonal(DVec3::splat(lf * value));
                    jet.hessian = (solid - radial * lf - constant
                        + outer(w, w) * (lf * (lf + 2.0) * value))
                        * norm;
                }
            }
        }
    }
}

/// The matrix a bᵀ.
pub(super) fn outer(a: DVec3, b: DVec3) -> DMat3 {
    DMat3::from_cols(a * b.x, a * b.y, a * b.z)
}
