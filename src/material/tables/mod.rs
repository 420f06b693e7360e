//! Glossy lobes in harmonics, tabulated over the outgoing direction: what a record of incident
//! radiance is multiplied with.

mod lobe;
mod disk;
mod matrix;

pub use disk::{TABLES_VARIABLE, TableStore};
pub use lobe::{Lobe, LobeTable};
pub use matrix::BrdfMatrix;

use super::bsdf::Bsdf;
use super::microfacet::{ggx_d, schlick_weight, visibility};
use super::{Material, NativeBrdf};
use crate::basis::{Basis, BasisKind};
use crate::geometry::SurfacePoint;
use crate::math::{Color, Vec3};
use rayon::prelude::*;
use std::sync::OnceLock;

/// What tables are made for.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TableSettings {
    /// The basis.
    pub basis: BasisKind,
    /// Its highest order.
    pub order: usize,
    /// Share of a lobe's energy that may be lost: see [`LobeTable`].
    pub loss: f32,
    /// Records may have too low an order for some directions: see [`GlossyTables::record_order`].
    pub padding: bool,
    /// Lobes are given with all bands, and not with those alone that `loss` asks for.
    pub whole: bool,
    /// Lobes need all bands, and none is of high frequency, whatever it loses.
    pub forced: bool,
}

impl Entry {
    /// `tints` are those for which the highest order is asked.
    fn new(table: LobeTable, tints: &[[Color; 3]], loss: f32) -> Self {
        let largest = tints.iter().map(|t| table.largest_order(t, loss)).max().unwrap_or(0);
        Self { table, largest }
    }
}

impl TableSettings {
    /// What a table depends on, as text.
    fn key(&self) -> String {
        format!("{:?} {}", self.basis, self.order)
    }
}

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
        Self { settings, native, ggx, cosine: settings.cosine(basis.as_ref()), basis, matrices }
    }

    /// True if no material has lobes that were tabulated.
    pub fn is_empty(&self) -> bool {
        self.ggx.is_empty() && self.native.iter().all(Option::is_none)
    }

    /// Number of functions of the basis.
    pub fn coefficient_count(&self) -> usize {
        self.settings.order * self.settings.order
    }

    /// The order of a record that serves the glossy lobes of `bsdf` at `at`: what they need for
    /// `at.wo`, or with `padding` off for any direction. `None` where there are no such lobes,
    /// where they are of high frequency for `at.wo`, or where light passes through the surface.
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
        &self,
        material: u32,
        bsdf: &Bsdf,
        wo: Vec3,
        out: &mut Vec<f32>,
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
    brdf: NativeBrdf,
    settings: &TableSettings,
    basis: &dyn Basis,
    store: &TableStore,
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
