//! Which surfaces radiance records serve, and in which directions; and what is known of light where
//! paths may end.

use super::path::Vertex;
use crate::cache::{LobeCoefficients, RadianceAnswer, RadianceCache, Scheme};
use crate::gather::Deeper;
use crate::geometry::SurfacePoint;
use crate::material::Bsdf;
use crate::material::tables::GlossyTables;
use crate::math::{Color, INV_PI, Vec3, luminance};

/// The choice between records and paths for a surface's glossy lobes.
#[derive(Clone, Copy)]
pub struct Service<'a> {
    /// The lobes in harmonics.
    pub tables: &'a GlossyTables,
    /// For each material whether records may serve it.
    pub materials: &'a [bool],
    /// See [`Glossy::share`].
    pub share: f32,
    /// See [`Glossy::curved_order`].
    pub curved_order: u8,
}

/// What serves the glossy lobes of low frequency.
#[derive(Clone, Copy)]
pub struct Gloss<'a> {
    /// Those lobes.
    pub service: Service<'a>,
    /// Records of the light that reaches them, for one level of bounces each, ascending.
    pub records: &'a [RadianceCache],
}

/// What is known of indirect light at surfaces where paths may end.
#[derive(Clone, Copy)]
pub struct Known<'a> {
    /// What reaches diffuse lobes.
    pub irradiance: &'a dyn Deeper,
    /// What reaches glossy lobes.
    pub gloss: Option<Gloss<'a>>,
}

impl<'a> From<&'a dyn Deeper> for Known<'a> {
    /// Irradiance alone.
    fn from(irradiance: &'a dyn Deeper) -> Self {
        Self { irradiance, gloss: None }
    }
}

impl<'a> Gloss<'a> {
    /// The records of `level`.
    pub(super) fn level(&self, level: u8) -> Option<&'a RadianceCache> {
        self.records.iter().find(|r| r.level() == level)
    }

    /// Indirect light that leaves a surface `level` bounces behind the first by its glossy lobes,
    /// and the irradiance there; `None` where no record serves it. As for irradiance, records of
    /// any level answer if light paths have no bound, the first level's before others.
    pub(super) fn behind(&self, level: u8, v: &Vertex) -> Option<RadianceAnswer> {
        if v.bsdf.is_delta_only() || self.records.is_empty() {
            return None;
        }
        let mut lobe = LobeCoefficients::default();
        lobe.order = self.service.project(&v.point, &v.bsdf, None, &mut lobe.values)?;
        let mut usable =
            self.records.iter().filter(|r| r.placement().is_unlimited() || r.level() == level);
        usable.find_map(|records| records.lookup(&v.point, u32::MAX, &mut lobe))
    }

    /// The same of what the camera sees, from the first level alone.
    pub(super) fn first(&self, v: &Vertex) -> Option<RadianceAnswer> {
        Gloss { records: self.records.get(..1)?, ..*self }.behind(0, v)
    }

    /// What [`Gloss::behind`] says of the glossy lobes if the surface is looked at from `wo`
    /// instead, in its local frame.
    pub(super) fn seen_from(&self, level: u8, v: &Vertex, wo: Vec3) -> Option<Color> {
        let point = SurfacePoint { wo: v.point.frame.to_world(wo), ..v.point };
        Some(self.behind(level, &Vertex { point, bsdf: v.bsdf })?.glossy)
    }
}

impl Known<'_> {
    /// Indirect light that leaves a surface `level` bounces behind the first, by the diffuse lobe
    /// and by the others; the second is `None` where nothing is known of it. `None` where nothing
    /// is known at all.
    pub(super) fn leaving(&self, level: u8, v: &Vertex) -> Option<(Color, Option<Color>)> {
        let diffuse = |irradiance: Color| {
            v.bsdf.diffuse_albedo(v.point.frame.to_local(v.point.wo)) * irradiance * INV_PI
        };
        if let Some(answer) = self.gloss.as_ref().and_then(|g| g.behind(level, v)) {
            return Some((diffuse(answer.irradiance), Some(answer.glossy)));
        }
        let irradiance =
            if v.bsdf.has_diffuse() { self.irradiance.irradiance(level, &v.point) } else { None };
        Some((diffuse(irradiance?), None))
    }
}

/// The cosine between shading and geometric normal above which a surface is flat.
const FLAT: f32 = 1.0 - 1e-6;

impl<'a> Service<'a> {
    /// The choice that `scheme` makes among `materials`, a flag for each of the scene's.
    pub fn new(tables: &'a GlossyTables, materials: &'a [bool], scheme: &Scheme) -> Self {
        Self {
            tables,
            materials,
            share: scheme.glossy().share(),
            curved_order: scheme.glossy().curved_order(),
        }
    }

    /// The number of bands of a record that serves the glossy lobes of `bsdf` at `at` in the
    /// direction `at.wo`; `None` where paths do.
    pub fn record_order(&self, at: &SurfacePoint, bsdf: &Bsdf) -> Option<u8> {
        self.admits(at, bsdf, None).then(|| self.tables.record_order(at, bsdf))?
    }

    /// Writes the coefficients of those lobes to `out` and returns their order; see
    /// [`GlossyTables::project`]. `None` where paths serve them. `albedo` is that of all lobes
    /// towards `at.wo`, if it is known.
    pub fn project(
        &self,
        at: &SurfacePoint,
        bsdf: &Bsdf,
        albedo: Option<Color>,
        out: &mut Vec<f32>,
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
