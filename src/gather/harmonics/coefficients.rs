//! Incident radiance as a sum of harmonics.

use crate::basis::{Basis, LANES, Lane};
use crate::gather::samples::HemisphereSamples;
use crate::gather::strata::Layout;
use crate::math::{Color, Vec3, luminance};

/// Coefficients of a colour-valued function: those of red, then green, then blue.
pub type Coefficients = Vec<f32>;

impl HemisphereSamples {
    /// The coefficients `λ_i = Σ Ω_k L_k B_i(w_k)` of incident radiance, in the frame of the
    /// gather. Their cosine-weighted sum is the very estimate of
    /// [`HemisphereSamples::irradiance`] when the basis contains the cosine.
    pub fn project(&self, basis: &dyn Basis) -> Coefficients {
        let b = &self.bundle;
        let mut sums = Sums::new(basis);
        for first in (0..b.len()).step_by(LANES) {
            let sample = |k: usize| first + k < b.len();
            let w =
                std::array::from_fn(|k| if sample(k) { b.dir_local[first + k] } else { Vec3::Z });
            let weights = std::array::from_fn(|k| {
                if sample(k) {
                    b.radiance[first + k] * self.solid_angle(first + k)
                } else {
                    Color::ZERO
                }
            });
            sums.add(basis, &w, &weights);
        }
        sums.finish()
    }

    /// How uncertain incident light is: the coefficients of `v(w) = Ω(w) var L(w)`, the variance of
    /// the luminance of a sample from its stratum times the solid angle that it stands for, in the
    /// frame of the gather. What a lobe c makes of the samples has the variance `∫ c² v dw`.
    ///
    /// The variance within a stratum is taken for half the mean square of its differences to the
    /// next ones in both directions.
    pub fn uncertainty(&self, basis: &dyn Basis) -> Vec<f32> {
        let b = &self.bundle;
        let (row, rows) = match self.layout {
            Layout::Polar { m, n } => (n as usize, m as usize),
            Layout::Concentric { n } => (n as usize, n as usize),
        };
        let mut sums = Sums::new(basis);
        for first in (0..b.len()).step_by(LANES) {
            let sample = |k: usize| first + k < b.len();
            let variance = |k: usize| {
                let (j, i) = self.layout.cell(k);
                let aside = j * row + if i + 1 < row { i + 1 } else { i - 1 };
                let across = (if j + 1 < rows { j + 1 } else { j - 1 }) * row + i;
                let square = |other: usize| luminance(b.of_ray(k) - b.of_ray(other)).powi(2);
                0.25 * (square(aside) + square(across)) * self.solid_angle(k).powi(2)
            };
            let w =
                std::array::from_fn(|k| if sample(k) { b.dir_local[first + k] } else { Vec3::Z });
            sums.add(
                basis,
                &w,
                &std::array::from_fn(|k| {
                    if sample(k) { variance(first + k) * Color::X } else { Color::ZERO }
                }),
            );
        }
        let mut coefficients = sums.finish();
        coefficients.truncate(basis.count());
        coefficients
    }
}

/// Sums of basis functions at weighted directions, eight at a time.
pub struct Sums {
    values: Vec<Lane>,
    sums: Vec<[Lane; 3]>,
}

impl Sums {
    pub fn new(basis: &dyn Basis) -> Self {
        Self {
            values: vec![Lane::default(); basis.count()],
            sums: vec![[Lane::default(); 3]; basis.count()],
        }
    }

    pub fn add(&mut self, basis: &dyn Basis, w: &[Vec3; LANES], weights: &[Color; LANES]) {
        basis.values(w, &mut self.values);
        let channels: [Lane; 3] = std::array::from_fn(|c| weights.map(|w| w[c]));
        for (sum, value) in self.sums.iter_mut().zip(&self.values) {
            for (sum, weight) in sum.iter_mut().zip(&channels) {
                for k in 0..LANES {
                    sum[k] += value[k] * weight[k];
                }
            }
        }
    }

    pub fn finish(&self) -> Coefficients {
        (0..3).flat_map(|c| self.sums.iter().map(move |s| s[c].iter().sum())).collect()
    }
}
