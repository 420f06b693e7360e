//! Stratified directions over the hemisphere with known neighbours.

use crate::math::{INV_PI, Vec2, Vec3};
use crate::sampling::{Rng, disk_to_square, square_to_disk};
use serde::{Deserialize, Serialize};
use std::f32::consts::TAU;

/// How the strata of a hemisphere are arranged.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Layout {
    /// `m` rings of equal weight times `n` sectors; sample `j * n + k` lies in ring j (from the
    /// pole) and sector k. The gradient of Ward and Heckbert needs it; `n ≈ π m` makes
    /// the strata about square.
    Polar {
        /// Rings.
        m: u32,
        /// Sectors.
        n: u32,
    },
    /// `n × n` strata of the square, mapped to the disk by concentric squares [Shirley97] and
    /// lifted to the hemisphere; sample `j * n + i`.
    Concentric {
        /// Strata along each side.
        n: u32,
    },
}

/// The density of directions over the hemisphere.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Density {
    /// cos θ/π per steradian.
    #[default]
    Cosine,
    /// 1/(2π) per steradian.
    Uniform,
}

impl Density {
    /// The density of directions under the cosine `cos` to the normal.
    pub fn pdf(self, cos: f32) -> f32 {
        match self {
            Self::Cosine => cos.max(0.0) * INV_PI,
            Self::Uniform => 0.5 * INV_PI,
        }
    }

    /// The angle θ to the normal within which the share `t` of the directions lies.
    pub(super) fn angle(self, t: f32) -> f32 {
        match self {
            Self::Cosine => t.sqrt().min(1.0).asin(),
            Self::Uniform => (1.0 - t).acos(),
        }
    }
}

/// Directions are kept this far above the horizon (cos θ), where harmonics with odd m have
/// unbounded derivatives and rays graze the surface they start from.
const MIN_COS: f32 = 1e-3;

impl Layout {
    /// The polar layout of about `rays` rays with nearly square strata, `n ≈ π m`, and at least 2 ×
    /// 4 of them.
    pub fn polar(rays: u32) -> Self {
        let m = ((rays as f32 / std::f32::consts::PI).sqrt().round() as u32).max(2);
        Self::Polar { m, n: (rays as f32 / m as f32).round().max(4.0) as u32 }
    }

    /// The concentric layout of about `rays` rays, at least 2 × 2.
    pub fn concentric(rays: u32) -> Self {
        Self::Concentric { n: ((rays as f32).sqrt().round() as u32).max(2) }
    }

    /// The same kind of layout with about `rays` rays.
    #[must_use]
    pub fn with_rays(self, rays: u32) -> Self {
        match self {
            Self::Polar { .. } => Self::polar(rays),
            Self::Concentric { .. } => Self::concentric(rays),
        }
    }

    /// Number of rays.
    pub fn rays(self) -> usize {
        match self {
            Self::Polar { m, n } => m as usize * n as usize,
            Self::Concentric { n } => n as usize * n as usize,
        }
    }

    /// The grid coordinates of sample `k`: (ring, sector) or (row, column).
    #[inline]
    pub fn cell(self, k: usize) -> (usize, usize) {
        let n = match self {
            Self::Polar { n, .. } | Self::Concentric { n } => n as usize,
        };
        (k / n, k % n)
    }

    /// The sample in whose stratum the local direction `w` lies.
    pub(super) fn at(self, density: Density, w: Vec3) -> usize {
        // The place on the disk that the square goes to first.
        let squared = w.truncate().length_squared().min(1.0);
        let t = if density == Density::Cosine { squared } else { 1.0 - w.z };
        let place = |x: f32, n: u32| ((x * n as f32) as u32).min(n - 1) as usize;
        match self {
            Self::Polar { m, n } => {
                let turn = (w.y.atan2(w.x) / TAU).rem_euclid(1.0);
                place(t, m) * n as usize + place(turn, n)
            }
            Self::Concentric { n } => {
                let disk = w.truncate() * (t / squared.max(f32::MIN_POSITIVE)).sqrt();
                let square = disk_to_square(disk);
                place(square.y, n) * n as usize + place(square.x, n)
            }
        }
    }

    /// Fills one jittered direction per stratum, and its density per steradian.
    pub fn directions(
        self, density: Density, seed: u64, dir_local: &mut Vec<Vec3>, pdf: &mut Vec<f32>,
    ) {
        let mut rng = Rng::new(seed);
        for k in 0..self.rays() {
            let (row, column) = self.cell(k);
            let u = rng.next_2d();
            // (x, y) on the unit disk of a cosine-weighted direction; a uniform one has its radius
            // replaced.
            let disk = match self {
                Self::Polar { m, n } => {
                    let radius = ((row as f32 + u.x) / m as f32).sqrt();
                    let (sin, cos) = (TAU * (column as f32 + u.y) / n as f32).sin_cos();
                    radius * Vec2::new(cos, sin)
                }
                Self::Concentric { n } => {
                    square_to_disk((Vec2::new(column as f32, row as f32) + u) / n as f32)
                }
            };
            let r2 = disk.length_squared().min(1.0);
            let (w, p) = match density {
                Density::Cosine => {
                    let z = (1.0 - r2).sqrt().max(MIN_COS);
                    (disk.extend(z), z * INV_PI)
                }
                // cos θ = 1 - r² is uniform; the radius becomes sin θ = r sqrt(2 - r²).
                Density::Uniform => {
                    ((disk * (2.0 - r2).sqrt()).extend((1.0 - r2).max(MIN_COS)), 0.5 * INV_PI)
                }
            };
            dir_local.push(w.normalize());
            pdf.push(p);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn directions_lie_in_their_own_strata() {
        for layout in [Layout::Polar { m: 13, n: 40 }, Layout::Concentric { n: 23 }] {
            for density in [Density::Cosine, Density::Uniform] {
                let (mut directions, mut pdf) = (Vec::new(), Vec::new());
                layout.directions(density, 5, &mut directions, &mut pdf);
                let strays = (directions.iter().enumerate())
                    .filter(|(k, w)| layout.at(density, **w) != *k)
                    .count();
                // Those on the borders may fall to either side.
                assert!(strays <= layout.rays() / 100, "{layout:?} {density:?}: {strays}");
            }
        }
    }
}
