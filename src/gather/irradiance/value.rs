//! Irradiance and its standard error.

use crate::gather::samples::{GROUPS, HemisphereSamples};
use crate::math::{Color, luminance};
use std::f32::consts::TAU;

impl HemisphereSamples {
    /// Irradiance `E = Σ Ω_k L_k cos θ_k`, with respect to the shading normal, and what light paths
    /// bring beside the rays.
    pub fn irradiance(&self) -> Color {
        let b = &self.bundle;
        let rays: Color =
            (0..b.len()).map(|k| b.radiance[k] * (b.dir_local[k].z * self.solid_angle(k))).sum();
        rays + b.joints.iter().map(|j| j.irradiance).sum::<Color>()
    }

    /// Standard error of the luminance of [`HemisphereSamples::irradiance`].
    ///
    /// The strata are dealt to 8 interleaved groups g, each of which covers the whole hemisphere:
    /// `σ² = Σ_g (E_g - E)²/(8·7)`. The single pair of halves of [Krivanek06, Sec. 4.3] is the same
    /// estimate from one sample. Rays beside the strata have a variance of their own.
    pub fn sigma(&self) -> f32 {
        let b = &self.bundle;
        let mut sums = [0.0_f32; GROUPS];
        let mut counts = [0_u32; GROUPS];
        for k in 0..b.len() {
            let (row, column) = self.layout.cell(k);
            let g = (3 * row + column) % GROUPS;
            sums[g] += luminance(b.of_ray(k)) * b.dir_local[k].z / b.pdf[k];
            counts[g] += 1;
        }
        if counts.contains(&0) {
            return f32::INFINITY;
        }
        let mean = sums.iter().sum::<f32>() / b.len() as f32;
        let spread: f32 = sums.iter().zip(counts).map(|(s, n)| (s / n as f32 - mean).powi(2)).sum();
        (spread / (GROUPS * (GROUPS - 1)) as f32 + b.found_variance).sqrt()
    }

    /// Mean radiance over the solid angle of the hemisphere.
    pub fn mean_radiance(&self) -> Color {
        let b = &self.bundle;
        (0..b.len()).map(|k| b.radiance[k] * self.solid_angle(k)).sum::<Color>() / TAU
    }
}
