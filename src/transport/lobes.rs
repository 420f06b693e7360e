//! Which glossy lobes are cached and which are traced, and what is known of indirect light where
//! paths may end.

use super::bright::Bright;
use super::vertex::Vertex;
use crate::cache::{Bands, Scheme};
use crate::gather::{Deeper, LobeCoefficients};
use crate::geometry::SurfacePoint;
use crate::material::Bsdf;
use crate::material::tables::{GlossyTables, TableSettings};
use crate::math::{Color, INV_PI, Vec3, luminance};
use crate::sampling::Sampler;
use crate::scene::Scene;
use std::sync::Arc;

/// The glossy lobes of a scene in harmonics, and the materials whose lobes are cached. Copies share
/// what does not change.
#[derive(Clone)]
pub struct GlossyLobes {
    tables: Arc<GlossyTables>,
    /// For each material whether its lobes are cached.
    materials: Vec<bool>,
}

impl GlossyLobes {
    /// The lobes that `scheme` asks for in `scene`; `None` where the scheme or the scene has
    /// nothing for a radiance cache.
    pub fn new(scene: &Scene, scheme: &Scheme, max_bounces: u32) -> Option<Self> {
        let levels = u32::from(scheme.levels.min(scheme.glossy().levels)).min(max_bounces);
        if scheme.glossy.is_none() || levels == 0 {
            return None;
        }
        let wanted = TableSettings {
            basis: scheme.glossy().basis.kind(),
            order: usize::from(scheme.glossy().order),
            loss: scheme.glossy().loss,
            padding: scheme.glossy().bands == Bands::Padded,
            whole: scheme.whole(),
            forced: scheme.glossy().bands == Bands::All,
        };
        let tables = GlossyTables::new(scene.materials(), wanted, scene.tables());
        if tables.is_empty() && !scheme.whole() {
            return None;
        }
        let materials = vec![scheme.glossy().break_even() <= 0.0; scene.materials().len()];
        Some(Self { tables: Arc::new(tables), materials })
    }

    /// The lobes.
    pub fn tables(&self) -> &GlossyTables {
        &self.tables
    }

    /// Caches the lobes of those materials, too, for which records take the place of enough paths:
    /// `paths` says of how many.
    pub fn admit(&mut self, paths: &[f32], scheme: &Scheme) {
        let enough = scheme.glossy().break_even() * scheme.gather.rays as f32;
        self.materials.iter_mut().zip(paths).for_each(|(cached, &n)| *cached |= n >= enough);
    }

    /// Caches the lobes of all materials.
    pub fn admit_all(&mut self) {
        self.materials.fill(true);
    }

    /// True if the lobes of a material are cached, by its number.
    pub fn are_cached(&self, material: u32) -> bool {
        self.materials[material as usize]
    }

    /// The choice between cached and traced lobes that `scheme` makes.
    pub fn choice(&self, scheme: &Scheme) -> CachedLobes<'_> {
        CachedLobes {
            tables: &self.tables,
            materials: &self.materials,
            share: scheme.glossy().share(),
            curved_order: scheme.glossy().curved_order(),
        }
    }
}

/// The choice between cached and traced lobes.
#[derive(Clone, Copy)]
pub struct CachedLobes<'a> {
    /// The lobes in harmonics.
    pub tables: &'a GlossyTables,
    /// For each material whether its lobes may be cached.
    materials: &'a [bool],
    /// See [`Scheme::radiance_share`].
    share: f32,
    /// See [`Scheme::radiance_curved_order`].
    curved_order: u8,
}

/// What records tell of indirect light at surfaces where paths may end.
#[derive(Clone, Copy)]
pub struct IndirectLight<'a> {
    /// The records.
    pub records: &'a dyn Deeper,
    /// The lobes that radiance records answer for, if there are any.
    pub lobes: Option<CachedLobes<'a>>,
    /// The small bright surfaces that paths may go to, if there are any.
    pub(super) bright: Option<&'a Bright>,
}

impl<'a> From<&'a dyn Deeper> for IndirectLight<'a> {
    /// Irradiance alone.
    fn from(records: &'a dyn Deeper) -> Self {
        Self { records, lobes: None, bright: None }
    }
}

impl IndirectLight<'_> {
    /// Light that leaves a surface by its diffuse lobe, as the radiosity cache knows it, and
    /// whether direct light is part of it; the ray that met the surface is `distance` long. Records
    /// are coarse, which shows from near by.
    pub(super) fn radiosity(
        &self, v: &Vertex, distance: f32, sampler: &mut Sampler,
    ) -> Option<(Color, bool)> {
        if !self.records.has_radiosity() || !v.bsdf.has_diffuse() {
            return None;
        }
        let longest = distance / (NEAREST + sampler.next_1d());
        let found = self.records.radiosity(&v.point, longest)?;
        let albedo = v.bsdf.diffuse_albedo(v.point.frame.to_local(v.point.wo));
        Some((albedo * found.irradiance * INV_PI, found.all))
    }

    /// Irradiance of indirect light at a surface `level` bounces behind the first, and the radiance
    /// that leaves by its glossy lobes; `None` where the lobes are traced or no record is valid. As
    /// for irradiance, records of any level answer if light paths have no bound, the first level's
    /// before others.
    pub(super) fn glossy(&self, level: u8, v: &Vertex) -> Option<(Color, Color)> {
        let lobes =
            self.lobes.filter(|_| self.records.has_radiance() && !v.bsdf.is_delta_only())?;
        let mut lobe = LobeCoefficients::default();
        lobe.order = lobes.project(&v.point, &v.bsdf, None, &mut lobe.values)?;
        self.records.radiance(level, &v.point, &mut lobe)
    }

    /// What [`IndirectLight::glossy`] says of the glossy lobes if the surface is looked at from
    /// `wo` instead, in its local frame.
    pub(super) fn seen_from(&self, level: u8, v: &Vertex, wo: Vec3) -> Option<Color> {
        let point = SurfacePoint { wo: v.point.frame.to_world(wo), ..v.point };
        Some(self.glossy(level, &Vertex { point, bsdf: v.bsdf })?.1)
    }

    /// Indirect light that leaves a surface `level` bounces behind the first, by the diffuse lobe
    /// and by the others; the second is `None` where nothing is known of it. `None` where nothing
    /// is known at all.
    pub(super) fn leaving(&self, level: u8, v: &Vertex) -> Option<(Color, Option<Color>)> {
        let diffuse = |irradiance: Color| {
            v.bsdf.diffuse_albedo(v.point.frame.to_local(v.point.wo)) * irradiance * INV_PI
        };
        if let Some((irradiance, glossy)) = self.glossy(level, v) {
            return Some((diffuse(irradiance), Some(glossy)));
        }
        if !v.bsdf.has_diffuse() {
            return None;
        }
        Some((diffuse(self.records.irradiance(level, &v.point)?), None))
    }
}

/// Direct light is sampled where a ray ends in records whose radius is above 1/u of its length, u
/// between this and one more.
pub(super) const NEAREST: f32 = 0.5;

/// The cosine between shading and geometric normal above which a surface is flat.
const FLAT: f32 = 1.0 - 1e-6;

impl CachedLobes<'_> {
    /// The number of bands of a record for the cached lobes of `bsdf` at `at` in the
    /// direction `at.wo`; `None` where the lobes are traced.
    pub fn record_order(&self, at: &SurfacePoint, bsdf: &Bsdf) -> Option<u8> {
        self.admits(at, bsdf, None).then(|| self.tables.record_order(at, bsdf))?
    }

    /// Writes the coefficients of those lobes to `out` and returns their order; see
    /// [`GlossyTables::project`]. `None` where they are traced. `albedo` is that of all lobes
    /// towards `at.wo`, if it is known.
    pub fn project(
        &self, at: &SurfacePoint, bsdf: &Bsdf, albedo: Option<Color>, out: &mut Vec<f32>,
    ) -> Option<usize> {
        self.admits(at, bsdf, albedo)
            .then(|| self.tables.project(at.material, bsdf, at.frame.to_local(at.wo), out))?
    }

    /// True unless records cost more there than they are worth.
    fn admits(&self, at: &SurfacePoint, bsdf: &Bsdf, albedo: Option<Color>) -> bool {
        let affordable = |order: usize| order <= usize::from(self.curved_order);
        self.worthwhile(at, bsdf, albedo)
            && (!self.is_limited(at) || self.tables.lobe_order(at, bsdf).is_some_and(affordable))
    }

    /// Records in another frame than the point's cost a rotation of the lobe for each of them,
    /// which grows with the cube of its order: beyond some order a path is cheaper.
    fn is_limited(&self, at: &SurfacePoint) -> bool {
        at.frame.n.dot(at.ng).abs() < FLAT
    }

    /// A faint gloss beside a diffuse lobe makes little noise, whose removal is not worth records
    /// that are dearer than those of irradiance.
    fn worthwhile(&self, at: &SurfacePoint, bsdf: &Bsdf, albedo: Option<Color>) -> bool {
        if !bsdf.has_glossy() || !self.materials[at.material as usize] {
            return false;
        }
        if self.share <= 0.0 || !bsdf.has_diffuse() {
            return true;
        }
        let wo = at.frame.to_local(at.wo);
        let (all, diffuse) = (
            luminance(albedo.unwrap_or_else(|| bsdf.albedo(wo))),
            luminance(bsdf.diffuse_albedo(wo)),
        );
        all - diffuse >= self.share * all
    }
}
