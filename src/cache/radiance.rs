//! Radiance records: incident radiance in harmonics, beside the irradiance that every record holds.
//!
//! They serve glossy surfaces of low frequency: what such a surface sends to the viewer is the
//! product of two vectors, the record's coefficients and those of the lobe. Records are placed as
//! irradiance records are, in a cache of their own.

use super::radiance_payload::Payload;
use super::radiance_placement::{Reflector, Response, Surroundings, shape};
use super::{
    Appearance, Bands, Cache, Extrapolation, FillStats, GlossyBasis, GlossyMetric, Hits, Index,
    LevelPoints, Lobes, Placement, Reach, Record, Scheme,
};
use crate::basis::{
    Basis, BasisKind, LANES, Sh, ShRotation, Tilt, Turn, gauss_legendre, index, triangle,
    zonal_factors,
};
use crate::error::Result;
use crate::gather::{
    Coefficients, HemisphereSamples, RadianceDerivatives, RadianceGradient, RadianceProbe,
    StoredHit, TriangleRadiance,
};
use crate::geometry::SurfacePoint;
use crate::math::{Color, Frame, Vec2, Vec3, luminance};
use crate::progress::Progress;
use rayon::prelude::*;
use std::f32::consts::TAU;
use std::sync::{Arc, OnceLock};

/// What a record holds besides its irradiance.
#[derive(Clone)]
pub(super) struct Radiance {
    /// The frame of its tangents.
    frame: Frame,
    order: usize,
    /// The coefficients and their derivatives along `frame.s` and `frame.t`.
    payload: Payload,
    /// The direction towards the viewer that the record was made for.
    wo: Vec3,
    /// What its area is bounded by besides its coefficients; `None` if those have no part in it.
    surroundings: Option<Surroundings>,
    /// What its rays hit, if the scheme has it kept.
    hits: Vec<StoredHit>,
    /// How uncertain the light is, see [`HemisphereSamples::uncertainty`], in the frame of the
    /// coefficients; empty if the scheme does not ask.
    uncertainty: Vec<f32>,
}

/// Makes [`Radiance`] from gathers.
pub(super) struct Maker {
    scheme: Scheme,
    pub level: u8,
    scene_size: f32,
    /// The bases of orders 1, 2, ...
    bases: Vec<Box<dyn Basis>>,
    rotation: OnceLock<Rotation>,
    /// Coefficients of the cosine over the hemisphere.
    cosine: Vec<f32>,
}

/// A maker with the surfaces that it makes records for, as far as the scheme has them count.
#[derive(Clone, Copy)]
pub(super) struct Making<'a> {
    pub maker: &'a Maker,
    pub reflector: Option<&'a dyn Reflector>,
}

/// Shading points with the orders that their lobes need.
pub struct RadiancePoints {
    /// The points.
    pub points: LevelPoints,
    /// For each of them, the number of bands of its record.
    pub orders: Vec<u8>,
}

/// Coefficients of a lobe times the cosine, in the local frame of the point asked about.
#[derive(Clone, Debug, Default)]
pub struct LobeCoefficients {
    /// Bands in use.
    pub order: usize,
    /// Red, green, blue; each as many as the basis of the cache has functions.
    pub values: Vec<f32>,
    /// The same in the frame of a record, with what the cosine becomes in a fourth run.
    rotated: Vec<f32>,
}

/// Light that leaves a glossy surface.
#[derive(Clone, Copy, Debug)]
pub struct RadianceAnswer {
    /// Radiance by the glossy lobe.
    pub glossy: Color,
    /// Irradiance from the same records.
    pub irradiance: Color,
    /// Weighted mean of their errors as a share of the allowed one.
    pub error: f32,
    /// Number of records that took part.
    pub records: u32,
}

/// Glossy shading points as adaptive caching sees them.
#[derive(Clone, Copy)]
pub struct GlossyView<'a> {
    /// The points, with the orders of their records.
    pub points: &'a RadiancePoints,
    /// How they look.
    pub appearance: &'a [Appearance],
    /// Their lobes.
    pub lobes: &'a Lobes<'a>,
}

/// Where gathers find light.
#[derive(Clone, Copy)]
pub struct Sources<'a> {
    /// What traces them.
    pub probe: &'a dyn RadianceProbe,
    /// What knows the indirect light at their hits.
    pub deeper: &'a Cache,
    /// What knows how surfaces reflect: see [`RadianceCache::fill`].
    pub reflector: Option<&'a dyn Reflector>,
}

/// General rotations of the basis in use.
enum Rotation {
    Hsh(Tilt),
    Sh(ShRotation),
}

/// A cache of radiance records for one level of bounces. Copies share what does not change.
#[derive(Clone)]
pub struct RadianceCache {
    cache: Cache,
    maker: Arc<Maker>,
    records: Vec<Radiance>,
    /// For each record the factor on its gradient: see [`super::Reach::radius`].
    gradient_scales: Vec<f32>,
    padding: bool,
}

/// Normals and tangents closer than this are the same frame.
const SAME: f32 = 1.0 - 1e-5;
/// What tilting loses or adds is corrected by at most this factor.
const MOST_CORRECTION: f32 = 2.0;
const WORLD: Frame = Frame { s: Vec3::X, t: Vec3::Y, n: Vec3::Z };

impl RadianceCache {
    /// An empty cache under `scheme`, which has radiance records, for light paths of at most
    /// `max_bounces` interactions in a scene whose diagonal is `scene_size`. It holds what surfaces
    /// `level` bounces behind the first need.
    ///
    /// # Panics
    /// When the scheme or the paths have no such level.
    pub fn new(scheme: &Scheme, max_bounces: u32, scene_size: f32, level: u8) -> Self {
        let order = usize::from(scheme.glossy().order);
        let bases: Vec<_> = (1..=order).map(|n| scheme.glossy().basis.kind().basis(n)).collect();
        let cosine = cosine(bases[order - 1].as_ref());
        let maker = Maker {
            scheme: scheme.for_radiance(),
            level,
            scene_size,
            bases,
            rotation: OnceLock::new(),
            cosine,
        };
        let padding = scheme.glossy().bands == Bands::Padded;
        let cache = Cache::new(scheme.for_radiance(), max_bounces, scene_size);
        assert!(level < cache.level_count(), "there is no level {level}");
        Self {
            cache,
            maker: Arc::new(maker),
            records: Vec::new(),
            gradient_scales: Vec::new(),
            padding,
        }
    }

    /// The level.
    pub fn level(&self) -> u8 {
        self.maker.level
    }

    /// Makes records until every point is covered, beside those that there are already; gathers
    /// take indirect light at their hits from `deeper`, and `reflector` tells how surfaces reflect,
    /// for schemes that place records by outgoing radiance. As [`Cache::fill`], of which it is
    /// a kind.
    ///
    /// # Errors
    /// [`crate::error::Error::Cancelled`]; the cache stays as it was then.
    pub fn fill(
        &mut self,
        probe: &dyn RadianceProbe,
        points: &RadiancePoints,
        deeper: &Cache,
        reflector: Option<&dyn Reflector>,
        seed: u64,
        progress: &Progress,
    ) -> Result<FillStats> {
        let making = Making { maker: &self.maker, reflector };
        let sources = Sources { probe, deeper, reflector };
        let stats = self.cache.fill_radiance(
            &sources,
            points,
            making,
            &mut self.records,
            seed,
            progress,
        )?;
        self.rescale();
        Ok(stats)
    }

    /// Gives all records the areas that another viewer needs, `towards` being the direction to it
    /// from a position, where the scheme places records by what the viewer sees; else nothing
    /// changes. Fences and orders stay as they are.
    pub fn see_from(&mut self, reflector: &dyn Reflector, towards: &(dyn Fn(Vec3) -> Vec3 + Sync)) {
        if self.maker.scheme.glossy().metric.placement() != Placement::View {
            return;
        }
        let reach = self.cache.shading_reach(self.maker.level);
        let making = Making { maker: &self.maker, reflector: Some(reflector) };
        let mut placed = self.records().to_vec();
        placed.par_iter_mut().zip(&mut self.records).for_each(|(record, radiance)| {
            radiance.wo = towards(record.position);
            making.place(record, radiance, &reach);
        });
        self.cache.replace(self.maker.level, placed);
        self.rescale();
    }

    /// Refines the filled cache until it has fully converged with respect to `points` [Krivanek06,
    /// Algorithm 1]: as [`Cache::converge`], but records are compared by the radiance that leaves
    /// the points by all their lobes. So their density follows the sharpness of the lobes and
    /// the direction of view.
    ///
    /// # Errors
    /// [`crate::error::Error::Cancelled`], and the cache is empty then;
    /// [`crate::error::Error::InvalidArgument`] if `points` and `appearance` are not of one length.
    pub fn converge(
        &mut self,
        view: &GlossyView,
        sources: &Sources,
        seed: u64,
        progress: &Progress,
    ) -> Result<FillStats> {
        let records = std::mem::take(&mut self.records);
        let making = Making { maker: &self.maker, reflector: sources.reflector };
        let outcome = self.cache.converge_radiance(
            view,
            sources,
            (making, self.padding),
            records,
            seed,
            progress,
        );
        let (records, stats) = outcome?;
        self.records = records;
        self.rescale();
        Ok(stats)
    }

    /// Notes the factors on the gradients of the records as they are now.
    fn rescale(&mut self) {
        let reach = self.cache.shading_reach(self.maker.level);
        let level = self.cache.level(self.maker.level).map_or(&[][..], |l| l.records());
        self.gradient_scales =
            level.iter().map(|r| reach.radius(r.length, r.footprint).1).collect();
    }

    /// The irradiance part of the records, by their ids.
    pub fn records(&self) -> &[Record] {
        self.cache.level(self.maker.level).map_or(&[], |l| l.records())
    }

    /// The cache of that part.
    pub fn placement(&self) -> &Cache {
        &self.cache
    }

    /// Bytes that records and index occupy.
    pub fn bytes(&self) -> usize {
        let numbers: usize =
            self.records.iter().map(|r| r.payload.bytes() + size_of_val(&r.hits[..])).sum();
        self.cache.level(self.maker.level).map_or(0, |l| l.bytes())
            + self.records.len() * size_of::<Radiance>()
            + numbers
    }

    /// Radiance from the records with ids below `limit` that leaves towards `at.wo` by the lobe
    /// with the coefficients `lobe`:
    ///
    /// ```text
    /// L = Σ w_i max(0, c · R_i (Λ_i + dx ∂Λ_i/∂x + dy ∂Λ_i/∂y)) / Σ w_i      [Krivanek05, Eq. 12-13]
    /// ```
    ///
    /// The gradient is applied before the rotation R_i from the record's frame to the point's, and
    /// instead of Λ_i the one vector c is rotated, by the inverse. Each record is clamped by
    /// itself; a tilted one is scaled so that its irradiance is what the rotational gradient
    /// predicts. `None` where no record is valid.
    pub fn lookup(
        &self,
        at: &SurfacePoint,
        limit: u32,
        lobe: &mut LobeCoefficients,
    ) -> Option<RadianceAnswer> {
        let index: &Index = self.cache.level(self.maker.level)?.index();
        let (mut glossy, mut irradiance, mut weights, mut errors, mut count) =
            (Color::ZERO, Color::ZERO, 0.0, 0.0, 0);
        self.maker.prepare(at, lobe);
        index.visit(at, limit, |valid| {
            let record = &self.records[valid.id as usize];
            if record.order < lobe.order && !self.padding {
                return;
            }
            let offset = valid.offset * self.gradient_scales[valid.id as usize];
            glossy += valid.weight * self.maker.leaving(record, at, offset, valid.irradiance, lobe);
            irradiance += valid.weight * valid.irradiance;
            weights += valid.weight;
            errors += valid.weight * valid.error;
            count += 1;
        });
        (weights > 0.0).then(|| RadianceAnswer {
            glossy: glossy / weights,
            irradiance: irradiance / weights,
            error: errors / weights,
            records: count,
        })
    }
}

impl RadianceCache {
    /// Whether records keep their hits.
    pub fn hits(&self) -> Hits {
        self.maker.scheme.glossy().hits
    }

    /// As [`RadianceCache::lookup`], from the hits that the records keep: `reflect(hit, direction,
    /// solid angle)` is what the surface at `at` makes of one of them, as it sees it.
    pub fn lookup_hits(
        &self,
        at: &SurfacePoint,
        limit: u32,
        mut reflect: impl FnMut(&StoredHit, Vec3, f32) -> Color,
    ) -> Option<RadianceAnswer> {
        let mut sum =
            RadianceAnswer { glossy: Color::ZERO, irradiance: Color::ZERO, error: 0.0, records: 0 };
        let mut weights = 0.0;
        self.cache.level(self.maker.level)?.index().visit(at, limit, |valid| {
            for hit in &self.records[valid.id as usize].hits {
                if let Some((direction, solid_angle)) = hit.seen_from(at.position) {
                    sum.glossy += valid.weight * reflect(hit, direction, solid_angle);
                }
            }
            sum.irradiance += valid.weight * valid.irradiance;
            sum.error += valid.weight * valid.error;
            sum.records += 1;
            weights += valid.weight;
        });
        let mean = |sum: Color| sum / weights;
        (weights > 0.0).then(|| RadianceAnswer {
            glossy: mean(sum.glossy),
            irradiance: mean(sum.irradiance),
            error: sum.error / weights,
            ..sum
        })
    }
}

/// Bands of what is kept of the uncertainty of light.
const UNCERTAINTY_BANDS: usize = 6;
/// The uncertainty of the light that a lobe sees is at least this share of its mean over the
/// hemisphere: few bands of it may dip below zero.
const LEAST_UNCERTAINTY: f32 = 0.1;
/// Bands beyond those of a lobe that its tilted image has a noticeable share in.
const SPILL: usize = 2;

impl LobeCoefficients {
    /// Rotates all runs, and `cosine` as a fourth, by `rotate`; `spill` is the number of bands by
    /// which the order may grow. The runs are no longer than that order needs.
    fn rotate(&mut self, cosine: &[f32], spill: usize, rotate: impl Fn(&mut [f32])) {
        let count = (self.order + spill).pow(2).min(cosine.len());
        self.rotated.clear();
        for run in runs(&self.values).into_iter().chain([cosine]) {
            self.rotated.extend_from_slice(&run[..count]);
        }
        self.rotated.chunks_exact_mut(count).for_each(rotate);
    }

    /// The runs of the lobe as it is used with a record: in the frame of the point, or in that of
    /// the record if it was turned.
    fn used(&self, turned: bool) -> [&[f32]; 3] {
        if turned {
            self.rotated().0
        } else {
            runs(&self.values).map(|run| &run[..run.len().min(self.order * self.order)])
        }
    }

    /// The rotated runs of the lobe, and that of the cosine.
    fn rotated(&self) -> ([&[f32]; 3], &[f32]) {
        let (lobe, cosine) = self.rotated.split_at(self.rotated.len() / 4 * 3);
        (runs(lobe), cosine)
    }
}

impl Radiance {
    /// The product, channel by channel, of the coefficients extrapolated by `offset` with `c`, by
    /// no more vectors than `most`.
    fn product(&self, offset: Vec3, c: [&[f32]; 3], most: usize) -> Color {
        self.payload.product(Vec2::new(offset.dot(self.frame.s), offset.dot(self.frame.t)), c, most)
    }

    /// Number of bands.
    pub fn order(&self) -> usize {
        self.order
    }
}

impl Making<'_> {
    /// What a record of `order` bands at `at` holds of the gather `samples`; `record`, made of the
    /// same, is given its area.
    pub fn make(
        &self,
        samples: &HemisphereSamples,
        at: &SurfacePoint,
        order: u8,
        record: &mut Record,
        reach: &Reach,
    ) -> Radiance {
        let (maker, scheme) = (self.maker, &self.maker.scheme);
        let order = usize::from(order).clamp(1, maker.bases.len());
        let basis = maker.bases[order - 1].as_ref();
        let value = samples.project(basis);
        let derivatives = match scheme.glossy().gradient {
            RadianceGradient::None => RadianceDerivatives::default(),
            RadianceGradient::Triangulated => {
                let hessians = scheme.extrapolation == Extrapolation::Second
                    || matches!(scheme.glossy().metric, GlossyMetric::Second(_));
                samples.radiance_derivatives(&Sh::new(order), TriangleRadiance::Hybrid, hessians)
            }
            kind => RadianceDerivatives {
                gradient: samples.radiance_gradient(basis, kind),
                ..RadianceDerivatives::default()
            },
        };
        let response =
            Response { value, gradient: derivatives.gradient, hessian: derivatives.hessian };
        let surroundings = (scheme.glossy().metric != GlossyMetric::Irradiance)
            .then(|| Surroundings::new(samples, &response));
        match &surroundings {
            Some(s) => self.reshape(record, response.clone(), s, samples.frame(), at, reach),
            None if scheme.clamping.gradient() => record.shorten(
                response.length()
                    / if scheme.radius.metric.is_distance() { 1.0 } else { reach.scale() },
            ),
            None => {}
        }
        let kept = scheme.glossy().hits.are_kept();
        let hits = if kept { samples.stored_hits(record.position) } else { Vec::new() };
        let mut uncertainty = Vec::new();
        if scheme.refinement.is_some() {
            uncertainty =
                samples.uncertainty(maker.bases[order.min(UNCERTAINTY_BANDS) - 1].as_ref());
            if maker.is_in_world() {
                maker.rotation().rotate(&mut uncertainty, Turn::between(samples.frame(), &WORLD));
            }
        }
        let payload = maker.pack(response, samples.frame());
        Radiance {
            frame: *samples.frame(),
            order,
            payload,
            wo: at.wo,
            surroundings,
            hits,
            uncertainty,
        }
    }

    /// Gives `record` the area that follows from what it holds, seen from its `wo`.
    fn place(&self, record: &mut Record, radiance: &Radiance, reach: &Reach) {
        let Some(surroundings) = &radiance.surroundings else { return };
        let response = self.maker.unpack(radiance);
        let plain = SurfacePoint::plain(record.position, record.normal);
        let at = SurfacePoint {
            frame: radiance.frame,
            wo: radiance.wo,
            footprint: record.footprint,
            ..plain
        };
        self.reshape(record, response, surroundings, &radiance.frame, &at, reach);
    }

    fn reshape(
        &self,
        record: &mut Record,
        incident: Response,
        surroundings: &Surroundings,
        frame: &Frame,
        at: &SurfacePoint,
        reach: &Reach,
    ) {
        let scheme = &self.maker.scheme;
        let response = incident.placed(scheme.glossy().metric.placement(), self.reflector, at);
        record.reshape(shape(
            scheme,
            &response,
            surroundings,
            frame,
            self.maker.scene_size,
            reach.scale(),
        ));
    }
}

impl Maker {
    fn is_spherical(&self) -> bool {
        self.scheme.glossy().basis.kind() == BasisKind::Sh
    }

    /// Spherical harmonics in the world's frame, where records of all normals meet.
    fn is_in_world(&self) -> bool {
        self.is_spherical() && self.scheme.glossy().basis == GlossyBasis::ShWorld
    }

    /// The number of vectors by which records are continued.
    fn vectors_used(&self) -> usize {
        match self.scheme.extrapolation {
            Extrapolation::None | Extrapolation::Rotation => 1,
            Extrapolation::First | Extrapolation::Axes { .. } => 3,
            Extrapolation::Second => 6,
        }
    }

    /// Keeps what is needed of `response`, which is given in `frame`.
    fn pack(&self, response: Response, frame: &Frame) -> Payload {
        let again = self.scheme.glossy().metric.placement() == Placement::View;
        let most = if again { 6 } else { self.vectors_used() };
        let vectors =
            [vec![response.value], response.gradient.into(), response.hessian.into()].concat();
        let mut vectors: Vec<Coefficients> =
            vectors.into_iter().filter(|v| !v.is_empty()).take(most).collect();
        if self.is_in_world() {
            self.turn(&mut vectors, Turn::between(frame, &WORLD));
        }
        Payload::new(vectors, self.scheme.glossy().storage)
    }

    /// What [`Maker::pack`] kept, in the frame of the record.
    fn unpack(&self, radiance: &Radiance) -> Response {
        let mut vectors = radiance.payload.to_single();
        if self.is_in_world() {
            self.turn(&mut vectors, Turn::between(&WORLD, &radiance.frame));
        }
        let mut vectors = vectors.into_iter();
        let mut next = || vectors.next().unwrap_or_default();
        Response { value: next(), gradient: [next(), next()], hessian: [next(), next(), next()] }
    }

    fn turn(&self, vectors: &mut [Coefficients], turn: Turn) {
        for vector in vectors {
            let count = vector.len() / 3;
            vector.chunks_exact_mut(count).for_each(|c| self.rotation().rotate(c, turn));
        }
    }

    /// Makes a lobe ready for the records around `at`, if those are all kept in the world's frame.
    pub fn prepare(&self, at: &SurfacePoint, lobe: &mut LobeCoefficients) {
        if self.is_in_world() {
            lobe.rotate(&self.cosine, 0, |c| {
                self.rotation().rotate(c, Turn::between(&at.frame, &WORLD))
            });
        }
    }

    /// Radiance that leaves `at` by `lobe`, which is prepared, if `record` alone is asked: `max(0,
    /// c · R_i (Λ_i + dx ∂Λ_i/∂x + dy ∂Λ_i/∂y))`. `offset` leads from the record to the point and
    /// is what the gradient is multiplied with; `irradiance` is what the record's irradiance
    /// predicts at the point.
    pub fn leaving(
        &self,
        record: &Radiance,
        at: &SurfacePoint,
        offset: Vec3,
        irradiance: Color,
        lobe: &mut LobeCoefficients,
    ) -> Color {
        let turned = self.aim(record, at, lobe);
        self.reflect(record, offset, irradiance, lobe, turned)
    }

    /// As [`Maker::leaving`], with the standard error of its luminance.
    pub fn leaving_with_error(
        &self,
        record: &Radiance,
        at: &SurfacePoint,
        offset: Vec3,
        irradiance: Color,
        lobe: &mut LobeCoefficients,
    ) -> (Color, f32) {
        let turned = self.aim(record, at, lobe);
        (self.reflect(record, offset, irradiance, lobe, turned), self.sigma(record, lobe, turned))
    }

    /// Turns `lobe` at `at` into the frame of `record` if that is another one; returns if it is.
    fn aim(&self, record: &Radiance, at: &SurfacePoint, lobe: &mut LobeCoefficients) -> bool {
        if self.is_in_world() {
            return true;
        }
        if record.frame.n.dot(at.frame.n) > SAME && record.frame.s.dot(at.frame.s) > SAME {
            return false;
        }
        let (turn, spill) =
            (Turn::between(&at.frame, &record.frame), if self.is_spherical() { 0 } else { SPILL });
        lobe.rotate(&self.cosine, spill, |c| self.rotation().rotate(c, turn));
        true
    }

    fn reflect(
        &self,
        record: &Radiance,
        offset: Vec3,
        irradiance: Color,
        lobe: &LobeCoefficients,
        turned: bool,
    ) -> Color {
        let most = self.vectors_used();
        let mut radiance = record.product(offset, lobe.used(turned), most);
        if turned && !self.is_spherical() {
            let tilted = luminance(record.product(offset, [lobe.rotated().1; 3], most));
            let correction = luminance(irradiance) / tilted.max(1e-20);
            radiance *= correction.clamp(1.0 / MOST_CORRECTION, MOST_CORRECTION);
        }
        radiance.max(Color::ZERO)
    }

    /// Standard error of the luminance of the light that `lobe` makes of the samples of `record`:
    /// `sqrt(|c|² v)`, v being the uncertainty averaged over the lobe.
    fn sigma(&self, record: &Radiance, lobe: &LobeCoefficients, turned: bool) -> f32 {
        let [r, g, b] = lobe.used(turned);
        let of = |i: usize| luminance(Color::new(r[i], g[i], b[i]));
        let norm: f32 = (0..r.len()).map(|i| of(i).powi(2)).sum();
        let seen: f32 = record.uncertainty.iter().zip(0..r.len()).map(|(v, i)| v * of(i)).sum();
        // Integrals over the hemisphere are those of the constant function, the first of the basis,
        // which spherical harmonics have on the whole sphere.
        let constant = if self.is_spherical() { (2.0 * TAU).sqrt() } else { TAU.sqrt() };
        let mean = record.uncertainty.first().map_or(0.0, |v| v * constant / TAU);
        let weight = of(0) * constant;
        let v = if weight > 0.0 { seen / weight } else { mean };
        (norm * v.max(LEAST_UNCERTAINTY * mean).max(0.0)).sqrt()
    }

    /// Made when the first rotation is asked for: flat surfaces need none.
    fn rotation(&self) -> &Rotation {
        self.rotation.get_or_init(|| match self.scheme.glossy().basis.kind() {
            BasisKind::Hsh => Rotation::Hsh(Tilt::new(self.bases.len())),
            BasisKind::Sh => Rotation::Sh(ShRotation::new(self.bases.len())),
        })
    }
}

impl Rotation {
    fn rotate(&self, c: &mut [f32], turn: Turn) {
        match self {
            Self::Hsh(tilt) => tilt.rotate(c, turn),
            Self::Sh(rotation) => rotation.rotate(c, turn),
        }
    }
}

/// The coefficients of the cosine over the hemisphere.
fn cosine(basis: &dyn Basis) -> Vec<f32> {
    let mut c = vec![0.0; basis.count()];
    let mut zonal = Vec::new();
    // Enough nodes for the products of the cosine with bands of any order.
    for nodes in gauss_legendre(4 * LANES, 0.0, 1.0).chunks_exact(LANES) {
        zonal_factors(basis, &std::array::from_fn(|k| nodes[k].0 as f32), &mut zonal);
        for l in 0..basis.order() {
            c[index(l, 0)] += (0..LANES)
                .map(|k| TAU * (nodes[k].0 * nodes[k].1) as f32 * zonal[triangle(l, 0)][k])
                .sum::<f32>();
        }
    }
    c
}

/// The three runs of coefficients in `c`.
fn runs(c: &[f32]) -> [&[f32]; 3] {
    let count = c.len() / 3;
    [&c[..count], &c[count..2 * count], &c[2 * count..]]
}
