//! The tables of all materials of a scene.

use super::lobe::{Lobe, LobeTable};
use super::matrix::BrdfMatrix;
use super::quadrature::cosine;
use super::settings::TableSettings;
use super::store::TableStore;
use crate::basis::{Basis, LANES, index};
use crate::geometry::SurfacePoint;
use crate::material::microfacet::{ggx_d, schlick_weight, visibility};
use crate::material::{Bsdf, Material, NativeBrdf};
use crate::math::{Color, INV_PI, Vec3};
use rayon::prelude::*;
use std::sync::OnceLock;

/// Lobes narrower than this GGX α are of high frequency at every order, and are not tabulated.
const MIN_ALPHA: f32 = 0.05;
/// Step between tabulated roughnesses `√α` where textures vary them.
const ROUGHNESS_STEP: f32 = 0.04;
/// More roughnesses than this are taken from the grid as well.
const MOST_ROUGHNESSES: usize = 24;
/// Reflectances F0 and F90 of a metal and of a dielectric, for which records on GGX surfaces must
/// be good enough.
const GGX_TINTS: [[Color; 3]; 2] =
    [[Color::ONE, Color::ONE, Color::ZERO], [Color::splat(0.04), Color::ONE, Color::ZERO]];

/// Tints of three parts that are the channels.
const CHANNELS: [Color; 3] = [Color::X, Color::Y, Color::Z];

/// A table, and the highest order that a lobe in it needs.
struct Entry {
    table: LobeTable,
    largest: usize,
}

impl Entry {
    /// `tints` are those for which the highest order is asked.
    fn new(table: LobeTable, tints: &[[Color; 3]], loss: f32) -> Self {
        let largest = tints.iter().map(|t| table.largest_order(t, loss)).max().unwrap_or(0);
        Self { table, largest }
    }
}

/// The tables of all materials of a scene.
pub struct GlossyTables {
    settings: TableSettings,
    /// For each material that is one of the papers' BRDFs, its table.
    native: Vec<Option<Entry>>,
    /// The GGX lobe at ascending α. Its two parts are what the reflectances at normal and at
    /// grazing incidence are multiplied with.
    ggx: Vec<(f32, Entry)>,
    basis: Box<dyn Basis>,
    /// The cosine over the hemisphere in the basis.
    cosine: Vec<f32>,
    /// For each material the matrix of its BRDF, if it is one of the papers' and was asked for.
    matrices: Vec<OnceLock<BrdfMatrix>>,
}

/// A table with the factors of its parts.
struct Term<'a> {
    entry: &'a Entry,
    tints: [Color; 3],
}

impl GlossyTables {
    /// Tables for `materials`: read from `store`, or made in parallel.
    pub fn new(materials: &[Material], settings: TableSettings, store: &TableStore) -> Self {
        let basis = settings.basis.basis(settings.order);
        let native = materials
            .par_iter()
            .map(|m| native_table(m.native?, &settings, basis.as_ref(), store))
            .collect();
        let ggx = roughnesses(materials)
            .into_par_iter()
            .map(|alpha| {
                let f = |wo: Vec3, wi: Vec3| {
                    let h = (wo + wi).normalize_or(Vec3::Z);
                    let lobe = ggx_d(h, alpha) * visibility(wo.z, wi.z, alpha);
                    let grazing = schlick_weight(wo.dot(h));
                    [lobe * (1.0 - grazing), lobe * grazing, 0.0]
                };
                let lobe = Lobe { f: &f, parts: 2, isotropic: true };
                let table = store.get(&format!("ggx {alpha:?} {}", settings.key()), || {
                    LobeTable::build(&lobe, basis.as_ref())
                });
                (alpha, Entry::new(table, &GGX_TINTS, settings.loss))
            })
            .collect();
        let matrices = materials.iter().map(|_| OnceLock::new()).collect();
        Self { settings, native, ggx, cosine: cosine(basis.as_ref()), basis, matrices }
    }

    /// True if no material has lobes that were tabulated.
    pub fn is_empty(&self) -> bool {
        self.ggx.is_empty() && self.native.iter().all(Option::is_none)
    }

    /// Number of functions of the basis.
    pub fn coefficient_count(&self) -> usize {
        self.settings.order * self.settings.order
    }

    /// The order of a record that can answer for the glossy lobes of `bsdf` at `at`: the order that
    /// they need for `at.wo`, or with `padding` off for any direction. `None` where there are no
    /// such lobes, where they are of high frequency for `at.wo`, or where light passes through the
    /// surface.
    pub fn record_order(&self, at: &SurfacePoint, bsdf: &Bsdf) -> Option<u8> {
        let wo = at.frame.to_local(at.wo);
        let terms = self.terms(at.material, bsdf, wo)?;
        let order = self.order_of(&terms, wo)?;
        let largest = terms.iter().flatten().map(|t| t.entry.largest).fold(order, usize::max);
        Some(if self.settings.padding { order } else { largest } as u8)
    }

    /// The order that the glossy lobes of `bsdf` at `at` need for `at.wo`; `None` as in
    /// [`GlossyTables::record_order`].
    pub fn lobe_order(&self, at: &SurfacePoint, bsdf: &Bsdf) -> Option<usize> {
        let wo = at.frame.to_local(at.wo);
        self.order_of(&self.terms(at.material, bsdf, wo)?, wo)
    }

    /// Writes the coefficients of the glossy lobes of `bsdf` times the cosine for `wo` to `out`,
    /// three runs of as many numbers as the basis has functions, and returns the number of bands
    /// that were written; `None` as in [`GlossyTables::record_order`].
    pub fn project(
        &self, material: u32, bsdf: &Bsdf, wo: Vec3, out: &mut Vec<f32>,
    ) -> Option<usize> {
        let terms = self.terms(material, bsdf, wo)?;
        let needed = self.order_of(&terms, wo)?;
        let order = if self.settings.whole { self.settings.order } else { needed };
        out.clear();
        out.resize(3 * self.settings.order * self.settings.order, 0.0);
        for term in terms.iter().flatten() {
            term.entry.table.add(wo, order, &term.tints, out);
        }
        Some(order)
    }

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
        // The papers' BRDFs have no textures: one matrix holds for all points.
        match self.matrices.get(material as usize).filter(|_| bsdf.native_brdf().is_some()) {
            Some(cell) => cell.get_or_init(build).clone(),
            None => build(),
        }
    }

    /// The highest order that any of `terms` needs for `wo`.
    fn order_of(&self, terms: &[Option<Term>; 4], wo: Vec3) -> Option<usize> {
        if self.settings.forced {
            return terms.iter().any(Option::is_some).then_some(self.settings.order);
        }
        let order = |t: &Term| t.entry.table.needed_order(wo, &t.tints, self.settings.loss);
        terms
            .iter()
            .flatten()
            .map(order)
            .try_fold(0, |most, order| Some(most.max(order?)))
            .filter(|&n| n > 0)
    }

    /// The tables whose sum the glossy lobes are.
    fn terms(&self, material: u32, bsdf: &Bsdf, wo: Vec3) -> Option<[Option<Term<'_>>; 4]> {
        if wo.z <= 0.0 || !bsdf.has_glossy() {
            return None;
        }
        let mut terms = [const { None }; 4];
        if let Some(brdf) = bsdf.native_brdf() {
            let entry = self.native.get(material as usize)?.as_ref()?;
            let tints = match brdf {
                NativeBrdf::Phong { ks, .. } | NativeBrdf::WardDuer { ks, .. } => {
                    [*ks, Color::ZERO, Color::ZERO]
                }
                NativeBrdf::Lafortune { .. } => CHANNELS,
            };
            terms[0] = Some(Term { entry, tints });
            return Some(terms);
        }
        for (k, lobe) in bsdf.ggx_lobes(wo)?.into_iter().enumerate() {
            if lobe.f0 == Color::ZERO && lobe.f90 == Color::ZERO {
                continue;
            }
            let above = self.ggx.partition_point(|(alpha, _)| *alpha < lobe.alpha);
            let (high, above_entry) = self.ggx.get(above)?;
            let scaled = |s: f32| [lobe.f0 * s, lobe.f90 * s, Color::ZERO];
            if *high == lobe.alpha {
                terms[2 * k] = Some(Term { entry: above_entry, tints: scaled(1.0) });
                continue;
            }
            let (low, below_entry) = self.ggx.get(above.checked_sub(1)?)?;
            let t = (lobe.alpha.sqrt() - low.sqrt()) / (high.sqrt() - low.sqrt());
            terms[2 * k] = Some(Term { entry: below_entry, tints: scaled(1.0 - t) });
            terms[2 * k + 1] = Some(Term { entry: above_entry, tints: scaled(t) });
        }
        Some(terms)
    }
}

/// The table of one of the papers' BRDFs without its diffuse part and, where it is only a factor,
/// without its specular albedo.
fn native_table(
    brdf: NativeBrdf, settings: &TableSettings, basis: &dyn Basis, store: &TableStore,
) -> Option<Entry> {
    let brdf = brdf.sanitized();
    if !brdf.has_glossy() || brdf.sharpest() < MIN_ALPHA {
        return None;
    }
    let (brdf, parts) = match brdf {
        NativeBrdf::Phong { exponent, .. } => {
            (NativeBrdf::Phong { kd: Color::ZERO, ks: Color::ONE, exponent }, 1)
        }
        NativeBrdf::WardDuer { alpha_x, alpha_y, .. } => {
            (NativeBrdf::WardDuer { kd: Color::ZERO, ks: Color::ONE, alpha_x, alpha_y }, 1)
        }
        NativeBrdf::Lafortune { lobes, count, .. } => {
            (NativeBrdf::Lafortune { kd: Color::ZERO, lobes, count }, 3)
        }
    };
    let f = |wo: Vec3, wi: Vec3| brdf.f_pdf(wo, wi, false).0.to_array();
    let lobe = Lobe { f: &f, parts, isotropic: !brdf.is_anisotropic() };
    let table =
        store.get(&format!("{brdf:?} {}", settings.key()), || LobeTable::build(&lobe, basis));
    Some(Entry::new(table, &[CHANNELS], settings.loss))
}

/// The roughnesses α at which the GGX lobe is needed, ascending: those that materials have, and a
/// grid where textures vary them or where they are too many.
fn roughnesses(materials: &[Material]) -> Vec<f32> {
    let mut exact = Vec::new();
    let mut grid_to = 0f32;
    for m in materials.iter().filter(|m| m.native.is_none() && !m.unlit && m.transmission <= 0.0) {
        let mut add = |roughness: f32, textured: bool| {
            let roughness = roughness.clamp(0.0, 1.0);
            if textured {
                grid_to = grid_to.max(roughness);
            } else {
                exact.push(roughness * roughness);
            }
        };
        if m.metallic > 0.0 || m.specular > 0.0 {
            add(m.roughness, m.metallic_roughness_texture.is_some());
        }
        if m.clearcoat > 0.0 {
            add(m.clearcoat_roughness, m.clearcoat_roughness_texture.is_some());
        }
    }
    exact.retain(|alpha| *alpha >= MIN_ALPHA);
    exact.sort_by(f32::total_cmp);
    exact.dedup();
    if exact.len() > MOST_ROUGHNESSES {
        grid_to = grid_to.max(exact.pop().unwrap_or(0.0).sqrt());
        exact.clear();
    }
    let first = MIN_ALPHA.sqrt();
    if grid_to > first {
        let steps = ((grid_to - first) / ROUGHNESS_STEP).ceil() as usize;
        exact.extend(
            (0..=steps).map(|k| (first + (grid_to - first) * k as f32 / steps as f32).powi(2)),
        );
        exact.sort_by(f32::total_cmp);
        exact.dedup();
    }
    exact
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::basis::BasisKind;
    use std::f64::consts::{PI, TAU};

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
