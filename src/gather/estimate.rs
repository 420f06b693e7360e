//! Irradiance, its standard error, and the distances to the surroundings.

use super::HemisphereSamples;
use crate::math::{Color, luminance};
use std::f32::consts::{FRAC_PI_4, FRAC_PI_8, TAU};

/// Sine of 10°, the elevation below which hits do not count for the minimum distance: on a concave
/// surface the nearest hits are those along the surface itself.
const MIN_ELEVATION: f32 = 0.173_648;

/// Interleaved groups of [`HemisphereSamples::sigma`].
const GROUPS: usize = 8;

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
    /// `σ² = Σ_g (E_g - E)²/(8·7)`. The seed's single pair of halves [Krivanek06, Sec. 4.3] is
    /// a one-sample version of it.
    pub fn sigma(&self) -> f32 {
        let b = &self.bundle;
        let mut sums = [0.0_f32; GROUPS];
        let mut counts = [0_u32; GROUPS];
        for k in 0..b.len() {
            let (row, column) = self.layout.cell(k);
            let g = (3 * row + column) % GROUPS;
            sums[g] += luminance(b.radiance[k]) * b.dir_local[k].z / b.pdf[k];
            counts[g] += 1;
        }
        if counts.contains(&0) {
            return f32::INFINITY;
        }
        let mean = sums.iter().sum::<f32>() / b.len() as f32;
        let spread: f32 = sums.iter().zip(counts).map(|(s, n)| (s / n as f32 - mean).powi(2)).sum();
        (spread / (GROUPS * (GROUPS - 1)) as f32).sqrt()
    }

    /// Mean radiance over the solid angle of the hemisphere.
    pub fn mean_radiance(&self) -> Color {
        let b = &self.bundle;
        (0..b.len()).map(|k| b.radiance[k] * self.solid_angle(k)).sum::<Color>() / TAU
    }

    /// Harmonic mean of the distances, `ΣΩ_k / Σ(Ω_k/r_k)`; infinite where every ray escaped.
    pub fn harmonic_distance(&self) -> f32 {
        let b = &self.bundle;
        let (sum, inverse) = (0..b.len()).fold((0.0, 0.0), |(s, i), k| {
            let o = self.solid_angle(k);
            (s + o, i + o / b.distance[k])
        });
        if inverse > 0.0 { sum / inverse } else { f32::INFINITY }
    }

    /// Smallest distance over all rays.
    pub fn minimum_distance(&self) -> f32 {
        self.bundle.distance.iter().copied().fold(f32::INFINITY, f32::min)
    }

    /// Smallest distance over the rays more than 10° above the tangent plane.
    pub fn minimum_distance_restricted(&self) -> f32 {
        let b = &self.bundle;
        (0..b.len())
            .filter(|&k| b.dir_local[k].z > MIN_ELEVATION)
            .map(|k| b.distance[k])
            .fold(f32::INFINITY, f32::min)
    }

    /// Mean distance of the nearest `fraction` of the rays, at least one of them; infinite where
    /// too many of those escaped.
    pub fn nearest_distance(&self, fraction: f32) -> f32 {
        let b = &self.bundle;
        let count = ((fraction * b.len() as f32).ceil() as usize).clamp(1, b.len());
        let mut sorted = b.distance.clone();
        let (low, pivot, _) = sorted.select_nth_unstable_by(count - 1, f32::total_cmp);
        (low.iter().sum::<f32>() + *pivot) / count as f32
    }

    /// Smallest distance in each of the eight sectors around the normal, over all rays or, if
    /// `restricted`, those more than 10° above the tangent plane: sector k is centred on azimuth
    /// 45° k, measured from the first tangent.
    pub fn sector_distances(&self, restricted: bool) -> [f32; 8] {
        let b = &self.bundle;
        let mut nearest = [f32::INFINITY; 8];
        for (w, &r) in b.dir_local.iter().zip(&b.distance) {
            if !restricted || w.z > MIN_ELEVATION {
                let phi = (w.y.atan2(w.x) + FRAC_PI_8).rem_euclid(TAU);
                let sector = &mut nearest[((phi / FRAC_PI_4) as usize).min(7)];
                *sector = sector.min(r);
            }
        }
        nearest
    }
}
