//! What a surface makes of incident light in all directions at once: the matrix from coefficients
//! of incident to those of outgoing radiance.

use super::quadrature::rows;
use crate::basis::{Basis, BasisKind, index, triangle};
use crate::math::Vec3;
use std::f64::consts::{PI, TAU};

/// Nodes over the cosine of the outgoing direction.
const ROWS: usize = 32;

/// The matrix M of a surface, `O = M Λ`: coefficients of the radiance that leaves it from those of
/// the radiance that reaches it, in its local frame, per channel,
///
/// ```text
/// M_ij = ∫ ∫ f(wo, wi) cos θ_i B_j(wi) B_i(wo) dwi dwo    [Zhao, Eq. 3.33, which lacks the cosine]
/// ```
///
/// Spherical harmonics take wo over the whole sphere with `f` mirrored at the surface, which is
/// continuous there and doubles what is above; hemispherical ones take the hemisphere. Functions of
/// different |m|, and cosines and sines, do not mix where f depends on the difference of the
/// azimuths alone. One block for each m is kept for both: 385 numbers instead of 10⁴ with 10 bands.
/// For other lobes this is the matrix of f averaged over turns of the surface.
///
/// With mirrored harmonics a diffuse surface of albedo ρ has the first row alone, and `O_00 =
/// sqrt(4π) ρ E/π`.
#[derive(Clone, Debug, PartialEq)]
pub struct BrdfMatrix {
    order: usize,
    /// For each channel and m the square block over l', then l, from m on.
    blocks: Vec<f32>,
}

/// Numbers of one channel.
fn size(order: usize) -> usize {
    (1..=order).map(|n| n * n).sum()
}

impl BrdfMatrix {
    /// The matrix of a surface that reflects nothing.
    pub fn black(order: usize) -> Self {
        Self { order, blocks: vec![0.0; 3 * size(order)] }
    }

    /// By quadrature over wo: `lobe(wo, out)` adds the coefficients `∫ f cos θ_i B_j(wi) dwi` of
    /// all lobes for `wo`, whose azimuth is 0, to `out`, three runs of as many numbers as the basis
    /// has functions.
    pub fn build(
        kind: BasisKind, basis: &dyn Basis, mut lobe: impl FnMut(Vec3, &mut [f32]),
    ) -> Self {
        let (order, count) = (basis.order(), basis.count());
        let mut sums = vec![0f64; 3 * size(order)];
        let mut coefficients = vec![0.0; 3 * count];
        for row in rows(basis, ROWS) {
            let wo = Vec3::new((1.0 - row.cos * row.cos).sqrt() as f32, 0.0, row.cos as f32);
            coefficients.fill(0.0);
            lobe(wo, &mut coefficients);
            let mut at = 0;
            for coefficients in coefficients.chunks_exact(count) {
                for m in 0..order {
                    // ∫cos² mφ.
                    let turn = if m == 0 { TAU } else { PI };
                    for to in m..order {
                        // The mirrored function has no odd part.
                        let both = match kind {
                            BasisKind::Sh => 2.0 * f64::from(u8::from((to + m).is_multiple_of(2))),
                            BasisKind::Hsh => 1.0,
                        };
                        let zonal = f64::from(row.zonal[triangle(to, m)]);
                        let factor = row.weight * turn * both * zonal;
                        for from in m..order {
                            sums[at] += factor * f64::from(coefficients[index(from, m as i32)]);
                            at += 1;
                        }
                    }
                }
            }
        }
        Self { order, blocks: sums.into_iter().map(|x| x as f32).collect() }
    }

    /// M Λ: three runs of coefficients, of an order no higher than the matrix's, from as many.
    pub fn apply(&self, incident: &[f32]) -> Vec<f32> {
        let count = incident.len() / 3;
        let order = count.isqrt().min(self.order);
        let mut out = vec![0.0; incident.len()];
        for channel in 0..3 {
            let (incident, out) =
                (&incident[channel * count..][..count], &mut out[channel * count..][..count]);
            let mut first = channel * size(self.order);
            for m in 0..order {
                let side = self.order - m;
                for to in m..order {
                    let row = &self.blocks[first + (to - m) * side..][..order - m];
                    let sum = |sign: i32| -> f32 {
                        row.iter()
                            .zip(m..)
                            .map(|(x, from)| x * incident[index(from, sign * m as i32)])
                            .sum()
                    };
                    out[index(to, m as i32)] = sum(1);
                    if m > 0 {
                        out[index(to, -(m as i32))] = sum(-1);
                    }
                }
                first += side * side;
            }
        }
        out
    }
}
