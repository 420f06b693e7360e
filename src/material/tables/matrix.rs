//! What a surface makes of incident light in all directions at once: the matrix from coefficients
//! of incident to those of outgoing radiance.

use super::{GlossyTables, TableSettings};
use crate::basis::{Basis, BasisKind, LANES, gauss_legendre, index, triangle, zonal_factors};
use crate::material::Bsdf;
use crate::math::{Color, INV_PI, Vec3};
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
/// azimuths alone: what is kept is a block for each m that serves both, 385 numbers instead of 10⁴
/// with 10 bands. For other lobes it is the matrix of f averaged over turns of the surface.
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
        kind: BasisKind,
        basis: &dyn Basis,
        mut lobe: impl FnMut(Vec3, &mut [f32]),
    ) -> Self {
        let (order, count) = (basis.order(), basis.count());
        let mut sums = vec![0f64; 3 * size(order)];
        let mut coefficients = vec![0.0; 3 * count];
        let mut zonal = Vec::new();
        // cos θ = t²: the √cos θ of hemispherical harmonics is smooth in t.
        let nodes: Vec<(f64, f64)> = gauss_legendre(ROWS, 0.0, 1.0)
            .into_iter()
            .map(|(t, weight)| (t * t, 2.0 * t * weight))
            .collect();
        for chunk in nodes.chunks(LANES) {
            zonal_factors(
                basis,
                &std::array::from_fn(|k| chunk.get(k).map_or(1.0, |n| n.0 as f32)),
                &mut zonal,
            );
            for (k, &(cos, weight)) in chunk.iter().enumerate() {
                let wo = Vec3::new((1.0 - cos * cos).sqrt() as f32, 0.0, cos as f32);
                coefficients.fill(0.0);
                lobe(wo, &mut coefficients);
                let mut at = 0;
                for channel in 0..3 {
                    for m in 0..order {
                        // ∫cos² mφ.
                        let turn = if m == 0 { TAU } else { PI };
                        for to in m..order {
                            // The mirrored function has no odd part.
                            let both = match kind {
                                BasisKind::Sh => {
                                    2.0 * f64::from(u8::from((to + m).is_multiple_of(2)))
                                }
                                BasisKind::Hsh => 1.0,
                            };
                            let factor =
                                weight * turn * both * f64::from(zonal[triangle(to, m)][k]);
                            for from in m..order {
                                sums[at] += factor
                                    * f64::from(
                                        coefficients[channel * count + index(from, m as i32)],
                                    );
                                at += 1;
                            }
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

impl GlossyTables {
    /// Adds the coefficients of all lobes of `bsdf` times the cosine for `wo`, of finite width and
    /// tabulated, to `out`: three runs of as many numbers as the basis has functions. Bands beyond
    /// the highest are left out, however much they hold.
    pub fn add_lobes(&self, material: u32, bsdf: &Bsdf, wo: Vec3, out: &mut [f32]) {
        let count = out.len() / 3;
        if bsdf.has_diffuse() {
            let albedo = bsdf.diffuse_albedo(wo) * INV_PI;
            for l in 0..self.settings.order {
                (0..3).for_each(|c| {
                    out[c * count + index(l, 0)] += albedo[c] * self.cosine[index(l, 0)]
                });
            }
        }
        if let Some(terms) = self.terms(material, bsdf, wo) {
            for term in terms.iter().flatten() {
                term.entry.table.add(wo, self.settings.order, &term.tints, out);
            }
        }
    }

    /// `f(wo, wi) cos θ_i` of all lobes as far as the basis represents it, `c(wo)·B(wi)`.
    pub fn reflect(&self, material: u32, bsdf: &Bsdf, wo: Vec3, wi: Vec3) -> Color {
        let count = self.coefficient_count();
        let (mut lobe, mut values) = (vec![0.0; 3 * count], vec![[0.0; LANES]; count]);
        self.add_lobes(material, bsdf, wo, &mut lobe);
        self.basis.values(&[wi; LANES], &mut values);
        let channel = |c: usize| {
            lobe[c * count..(c + 1) * count].iter().zip(&values).map(|(l, v)| l * v[0]).sum()
        };
        Color::new(channel(0), channel(1), channel(2))
    }

    /// The matrix of the surface with the material number `material` and the reflectance `bsdf`.
    pub fn matrix(&self, material: u32, bsdf: &Bsdf) -> BrdfMatrix {
        let build = || {
            BrdfMatrix::build(self.settings.basis, self.basis.as_ref(), |wo, out| {
                self.add_lobes(material, bsdf, wo, out)
            })
        };
        // The papers' BRDFs have no textures: one matrix serves all points.
        match self.matrices.get(material as usize).filter(|_| bsdf.native_brdf().is_some()) {
            Some(cell) => cell.get_or_init(build).clone(),
            None => build(),
        }
    }
}

impl TableSettings {
    /// The coefficients of the cosine over the hemisphere in the basis.
    pub(super) fn cosine(&self, basis: &dyn Basis) -> Vec<f32> {
        let mut c = vec![0.0; basis.count()];
        let mut zonal = Vec::new();
        for nodes in gauss_legendre(4 * LANES, 0.0, 1.0).chunks_exact(LANES) {
            zonal_factors(basis, &std::array::from_fn(|k| nodes[k].0 as f32), &mut zonal);
            for l in 0..self.order {
                let sum: f64 = (0..LANES)
                    .map(|k| TAU * nodes[k].0 * nodes[k].1 * f64::from(zonal[triangle(l, 0)][k]))
                    .sum();
                c[index(l, 0)] += sum as f32;
            }
        }
        c
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::material::tables::TableStore;
    use crate::material::{Material, NativeBrdf};

    fn tables(kind: BasisKind, brdf: NativeBrdf) -> (GlossyTables, Bsdf) {
        let settings = TableSettings {
            basis: kind,
            order: 8,
            loss: 0.5,
            padding: true,
            whole: false,
            forced: false,
        };
        let material = Material { native: Some(brdf), ..Material::default() };
        (GlossyTables::new(&[material], settings, &TableStore::default()), Bsdf::native(brdf))
    }

    /// The coefficients of some incident light that is bright on one side, red brighter than green.
    fn light(kind: BasisKind) -> (Vec<f32>, Color) {
        let basis = kind.basis(8);
        let mut c = vec![0.0; 3 * 64];
        let mut lanes = vec![[0.0; LANES]; 64];
        let w = Vec3::new(0.5, 0.3, 0.8).normalize();
        basis.values(&[w; LANES], &mut lanes);
        let color = Color::new(2.0, 1.0, 0.5);
        for (i, lane) in lanes.iter().enumerate() {
            (0..3).for_each(|channel| c[64 * channel + i] = color[channel] * lane[0]);
        }
        (c, color * w.z)
    }

    #[test]
    fn a_diffuse_surface_has_the_first_row_alone() {
        let rho = Color::new(0.8, 0.5, 0.2);
        let (tables, bsdf) =
            tables(BasisKind::Sh, NativeBrdf::Phong { kd: rho, ks: Color::ZERO, exponent: 1.0 });
        let (incident, irradiance) = light(BasisKind::Sh);
        let out = tables.matrix(0, &bsdf).apply(&incident);
        for channel in 0..3 {
            let expected = (4.0 * PI).sqrt() as f32 * rho[channel] * irradiance[channel] * INV_PI;
            let out = &out[64 * channel..64 * (channel + 1)];
            // Eight bands of the cosine miss 0.2 % of its energy.
            assert!((out[0] / expected - 1.0).abs() < 0.03, "{} {expected}", out[0]);
            assert!(out[1..].iter().all(|x| x.abs() < 2e-3 * expected), "{out:?}");
        }
    }

    #[test]
    fn outgoing_radiance_is_that_of_each_lobe() {
        for kind in [BasisKind::Sh, BasisKind::Hsh] {
            let brdf =
                NativeBrdf::Phong { kd: Color::splat(0.2), ks: Color::splat(0.6), exponent: 8.0 };
            let (tables, bsdf) = tables(kind, brdf);
            let (incident, _) = light(kind);
            let out = tables.matrix(0, &bsdf).apply(&incident);
            let basis = kind.basis(8);
            let mut values = vec![[0.0; LANES]; 64];
            for wo in
                [Vec3::new(-0.3, 0.2, 0.9), Vec3::new(0.2, -0.6, 0.7), Vec3::new(0.0, 0.0, 1.0)]
                    .map(Vec3::normalize)
            {
                let mut lobe = vec![0.0; 192];
                tables.add_lobes(0, &bsdf, wo, &mut lobe);
                basis.values(&[wo; LANES], &mut values);
                for channel in 0..3 {
                    let run = 64 * channel..64 * (channel + 1);
                    let by_lobe: f32 = lobe[run.clone()]
                        .iter()
                        .zip(&incident[run.clone()])
                        .map(|(a, b)| a * b)
                        .sum();
                    let by_matrix: f32 = out[run].iter().zip(&values).map(|(o, y)| o * y[0]).sum();
                    // The matrix cuts the lobe off in the outgoing direction, too.
                    assert!(
                        (by_matrix - by_lobe).abs() < 0.08 * by_lobe.abs() + 0.02,
                        "{kind:?} {wo}: {by_matrix} {by_lobe}"
                    );
                }
            }
        }
    }

    #[test]
    fn a_furnace_shows_the_albedo() {
        let brdf =
            NativeBrdf::Phong { kd: Color::splat(0.3), ks: Color::splat(0.5), exponent: 4.0 };
        let (tables, bsdf) = tables(BasisKind::Hsh, brdf);
        let mut incident = vec![0.0; 192];
        (0..3).for_each(|c| incident[64 * c] = TAU.sqrt() as f32);
        let out = tables.matrix(0, &bsdf).apply(&incident);
        let basis = BasisKind::Hsh.basis(8);
        let mut values = vec![[0.0; LANES]; 64];
        for wo in [Vec3::new(0.0, 0.0, 1.0), Vec3::new(0.6, 0.0, 0.8), Vec3::new(0.0, 0.8, 0.6)] {
            basis.values(&[wo; LANES], &mut values);
            let radiance: f32 = out[..64].iter().zip(&values).map(|(o, y)| o * y[0]).sum();
            assert!(
                (radiance - bsdf.albedo(wo).x).abs() < 0.02,
                "{wo}: {radiance} {}",
                bsdf.albedo(wo).x
            );
        }
    }
}
