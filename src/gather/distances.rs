//! Distances to the surroundings.

use super::samples::HemisphereSamples;
use std::f32::consts::{FRAC_PI_4, FRAC_PI_8, TAU};

/// Sine of 10°, the elevation below which hits do not count for the minimum distance: on a concave
/// surface the nearest hits are those along the surface itself.
const MIN_ELEVATION: f32 = 0.173_648;

impl HemisphereSamples {
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
