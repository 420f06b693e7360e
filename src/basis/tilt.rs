//! Rotation of hemispherical harmonics: exact about the pole, projected for tilts.

use super::functions::{Basis, LANES, Lane};
use super::hsh::Hsh;
use super::quadrature::gauss_legendre;
use super::rotation::{Turn, rotate_z};
use crate::math::Vec3;
use std::f64::consts::{FRAC_PI_2, PI};

/// Rotation of hemispherical harmonics of one order.
///
/// A tilted hemisphere is not the old one: part of the function sinks below the horizon, and
/// nothing is known of what rises above it, so the tilted function is not a combination of the same
/// functions. The tilt by β is therefore the projection
///
/// ```text
/// M(β)_ij = ∫_H H_i(w) H_j(R⁻¹w) [R⁻¹w ∈ H] dw
/// ```
///
/// tabulated over β and interpolated. It loses what sinks: a rotated constant has 0.984 of its norm
/// after 5°, 0.938 after 20°.
pub struct Tilt {
    /// Indices of the functions even and odd in y, which a tilt about y does not mix.
    families: [Vec<usize>; 2],
    /// Both families' matrices by rows, one table per node.
    tables: Vec<Vec<f32>>,
    /// Angle between nodes.
    step: f32,
}

/// Largest tilt in degrees; larger ones are taken to be this.
const MAX_DEGREES: f64 = 45.0;
/// Nodes of the quadrature for each band, across the lune and along half of it: products of two
/// functions of order n are of degree 4n.
const NODES: (usize, usize) = (4, 3);
/// Lower orders have the nodes of this one.
const FEWEST_BANDS: usize = 6;

impl Tilt {
    /// Tilts of harmonics of `order`: 0.1 s of work for order 10, on one thread, so that it may be
    /// done while other threads of a pool wait for it.
    pub fn new(order: usize) -> Self {
        let hsh = Hsh::new(order);
        let mut families = [Vec::new(), Vec::new()];
        for l in 0..order {
            for m in 0..=2 * l {
                families[usize::from(m < l)].push(l * l + m);
            }
        }
        let count = (MAX_DEGREES / 1.5_f64.min(15.0 / order as f64)).ceil() as usize;
        let step = MAX_DEGREES.to_radians() / count as f64;
        let tables = (0..=count).map(|k| table(&hsh, &families, step * k as f64)).collect();
        Self { families, tables, step: step as f32 }
    }

    /// Rotates the function with the coefficients `c`, which may be of a lower order; what the tilt
    /// moves to higher bands is cut off.
    pub fn rotate(&self, c: &mut [f32], turn: Turn) {
        rotate_z(c, turn.gamma);
        let t = turn.beta / self.step;
        let k = (t as usize).min(self.tables.len() - 2);
        let (low, high, t) = (&self.tables[k], &self.tables[k + 1], (t - k as f32).min(1.0));
        let (mut input, mut first) = (Vec::with_capacity(c.len()), 0);
        for family in &self.families {
            input.clear();
            input.extend(family.iter().take_while(|&&i| i < c.len()).map(|&i| c[i]));
            for (row, &i) in family[..input.len()].iter().enumerate() {
                let at = first + row * family.len();
                let row = at..at + input.len();
                c[i] = dot(&low[row.clone()], &high[row], t, &input);
            }
            first += family.len() * family.len();
        }
        rotate_z(c, turn.alpha);
    }
}

/// The product of the row between `low` and `high` with `x`.
fn dot(low: &[f32], high: &[f32], t: f32, x: &[f32]) -> f32 {
    let mut sums: Lane = [0.0; LANES];
    let whole = x.len() / LANES * LANES;
    let eights = |s| <[f32]>::chunks_exact(s, LANES);
    for ((a, b), x) in eights(low).zip(eights(high)).zip(eights(x)) {
        for k in 0..LANES {
            sums[k] += (a[k] + t * (b[k] - a[k])) * x[k];
        }
    }
    let rest: f32 = (whole..x.len()).map(|k| (low[k] + t * (high[k] - low[k])) * x[k]).sum();
    sums.iter().sum::<f32>() + rest
}

/// The matrices of one tilt: a quadrature over the lune that both hemispheres share.
fn table(hsh: &Hsh, families: &[Vec<usize>; 2], beta: f64) -> Vec<f32> {
    let mut matrix = vec![0f32; families.iter().map(|f| f.len() * f.len()).sum()];
    let (mut here, mut there) =
        (vec![Lane::default(); hsh.count()], vec![Lane::default(); hsh.count()]);
    // w = (ρ cos t, y, ρ sin t), and R⁻¹ w has t + β. Both variables are substituted so that the
    // √cos θ of the functions at the two horizons is smooth. By symmetry y > 0 is enough.
    let bands = hsh.order().max(FEWEST_BANDS);
    let mut nodes = Vec::new();
    for (v, weight_v) in gauss_legendre(NODES.1 * bands, 0.0, 1.0) {
        let (y, rho) = (FRAC_PI_2 * v).sin_cos();
        for (s, weight_s) in gauss_legendre(NODES.0 * bands, 0.0, 1.0) {
            let t = (PI - beta) * (FRAC_PI_2 * s).sin().powi(2);
            let density = (PI - beta) * FRAC_PI_2 * (PI * s).sin() * FRAC_PI_2 * rho;
            let at = |t: f64| Vec3::new((rho * t.cos()) as f32, y as f32, (rho * t.sin()) as f32);
            nodes.push((at(t), at(t + beta), (2.0 * weight_v * weight_s * density) as f32));
        }
    }
    for chunk in nodes.chunks(LANES) {
        let lane = |k: usize| chunk.get(k).copied().unwrap_or((Vec3::Z, Vec3::Z, 0.0));
        hsh.values(&std::array::from_fn(|k| lane(k).0), &mut here);
        hsh.values(&std::array::from_fn(|k| lane(k).1), &mut there);
        let weights: Lane = std::array::from_fn(|k| lane(k).2);
        let mut at = 0;
        for family in families {
            for &i in family {
                let weighted: Lane = std::array::from_fn(|k| weights[k] * here[i][k]);
                for &j in family {
                    let products: Lane = std::array::from_fn(|k| weighted[k] * there[j][k]);
                    matrix[at] += products.iter().sum::<f32>();
                    at += 1;
                }
            }
        }
    }
    matrix
}
