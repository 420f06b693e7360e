//! From gathers to coefficients, and from coefficients to the light that a lobe reflects.

use super::placement::{Reflector, Response, Surroundings, shape};
use super::record::Harmonics;
use super::vectors::Vectors;
use crate::basis::{
    Basis, BasisKind, LANES, Sh, ShRotation, Tilt, Turn, gauss_legendre, index, triangle,
    zonal_factors,
};
use crate::cache::payload::irradiance::Irradiance;
use crate::cache::record::{RadiusRule, Record};
use crate::cache::scheme::{
    Bands, Extrapolation, GlossyBasis, GlossyMetric, Hits, Placement, Scheme,
};
use crate::gather::{
    Coefficients, HemisphereSamples, LobeCoefficients, RadianceDerivatives, RadianceGradient,
    TriangleRadiance,
};
use crate::geometry::SurfacePoint;
use crate::math::{Color, Frame, Vec3, luminance};
use std::f32::consts::TAU;
use std::sync::{Arc, OnceLock};

/// Projects gathers onto harmonics and multiplies lobes with records, as the scheme of radiance
/// records says.
pub struct Projector {
    scheme: Arc<Scheme>,
    /// The bases of orders 1, 2, ...
    bases: Vec<Box<dyn Basis>>,
    rotation: OnceLock<Rotation>,
    /// Coefficients of the cosine over the hemisphere.
    cosine: Vec<f32>,
}

/// A projector with the surfaces that records are made for, as far as the scheme has them count.
#[derive(Clone, Copy)]
pub struct Projection<'a> {
    /// The projector.
    pub projector: &'a Projector,
    /// The surfaces.
    pub reflector: Option<&'a dyn Reflector>,
}

/// General rotations of the basis in use.
enum Rotation {
    Hsh(Tilt),
    Sh(ShRotation),
}

/// Normals and tangents closer than this are the same frame.
const SAME: f32 = 1.0 - 1e-5;
/// What tilting loses or adds is corrected by at most this factor.
const MOST_CORRECTION: f32 = 2.0;
const WORLD: Frame = Frame { s: Vec3::X, t: Vec3::Y, n: Vec3::Z };
/// Bands of what is kept of the uncertainty of light.
const UNCERTAINTY_BANDS: usize = 6;
/// The uncertainty of the light that a lobe sees is at least this share of its mean over the
/// hemisphere: few bands of it may dip below zero.
const LEAST_UNCERTAINTY: f32 = 0.1;
/// Bands beyond those of a lobe that its tilted image has a noticeable share in.
const SPILL: usize = 2;

impl Projection<'_> {
    /// The record of `order` bands of the gather `samples` at `at`. `record` is made of the same
    /// gather and is given another area.
    pub(super) fn project(
        &self, samples: &HemisphereSamples, at: &SurfacePoint, order: u8,
        mut record: Record<Irradiance>, rule: &RadiusRule,
    ) -> Record<Harmonics> {
        let (projector, scheme) = (self.projector, &self.projector.scheme);
        let order = usize::from(order).clamp(1, projector.bases.len());
        let basis = projector.bases[order - 1].as_ref();
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
            Some(s) => self.reshape(&mut record, response.clone(), s, samples.frame(), at, rule),
            None if scheme.clamping.gradient() => record.shorten(
                response.length()
                    / if scheme.radius.metric.is_distance() { 1.0 } else { rule.scale() },
            ),
            None => {}
        }
        let kept = scheme.glossy().hits.are_kept();
        let hits = if kept { samples.stored_hits(record.position) } else { Vec::new() };
        let mut uncertainty = Vec::new();
        if scheme.refinement.is_some() {
            uncertainty =
                samples.uncertainty(projector.bases[order.min(UNCERTAINTY_BANDS) - 1].as_ref());
            if projector.is_in_world() {
                let turn = Turn::between(samples.frame(), &WORLD);
                projector.rotation().rotate(&mut uncertainty, turn);
            }
        }
        let vectors = projector.pack(response, samples.frame());
        let frame = *samples.frame();
        let make = |irradiance| Harmonics {
            irradiance,
            frame,
            order,
            vectors,
            wo: at.wo,
            surroundings,
            hits,
            uncertainty,
        };
        record.map(make)
    }

    /// Gives `record` the area that follows from what it holds, seen from `wo`.
    pub(in crate::cache) fn place(
        &self, record: &mut Record<Harmonics>, wo: Vec3, rule: &RadiusRule,
    ) {
        record.payload.wo = wo;
        let Some(surroundings) = record.payload.surroundings else { return };
        let (frame, footprint) = (record.payload.frame, record.footprint);
        let response = self.projector.unpack(&record.payload);
        let plain = SurfacePoint::plain(record.position, record.normal);
        let at = SurfacePoint { frame, wo, footprint, ..plain };
        self.reshape(record, response, &surroundings, &frame, &at, rule);
    }

    fn reshape<P>(
        &self, record: &mut Record<P>, incident: Response, surroundings: &Surroundings,
        frame: &Frame, at: &SurfacePoint, rule: &RadiusRule,
    ) {
        let (scheme, size) = (&self.projector.scheme, rule.extent());
        let response = incident.placed(scheme.glossy().metric.placement(), self.reflector, at);
        record.reshape(shape(scheme, &response, surroundings, frame, size, rule.scale()));
    }
}

impl Projector {
    /// The projector of radiance records under `scheme`, which is the scheme
    /// [of radiance records](Scheme::for_radiance).
    pub(in crate::cache) fn new(scheme: Arc<Scheme>) -> Self {
        let order = usize::from(scheme.glossy().order);
        let bases: Vec<_> = (1..=order).map(|n| scheme.glossy().basis.kind().basis(n)).collect();
        let cosine = cosine(bases[order - 1].as_ref());
        Self { scheme, bases, rotation: OnceLock::new(), cosine }
    }

    /// The scheme of radiance records.
    pub(in crate::cache) fn scheme(&self) -> &Arc<Scheme> {
        &self.scheme
    }

    /// Whether records keep their hits.
    pub fn hits(&self) -> Hits {
        self.scheme.glossy().hits
    }

    /// True if `record` has bands enough for `lobe`, or counts as zero in those that it lacks.
    pub(in crate::cache) fn answers(&self, record: &Harmonics, lobe: &LobeCoefficients) -> bool {
        record.order >= lobe.order || self.scheme.glossy().bands == Bands::Padded
    }

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
    fn pack(&self, response: Response, frame: &Frame) -> Vectors {
        let again = self.scheme.glossy().metric.placement() == Placement::View;
        let most = if again { 6 } else { self.vectors_used() };
        let vectors =
            [vec![response.value], response.gradient.into(), response.hessian.into()].concat();
        let mut vectors: Vec<Coefficients> =
            vectors.into_iter().filter(|v| !v.is_empty()).take(most).collect();
        if self.is_in_world() {
            self.turn(&mut vectors, Turn::between(frame, &WORLD));
        }
        Vectors::new(vectors, self.scheme.glossy().storage)
    }

    /// What [`Projector::pack`] kept, in the frame of the record.
    fn unpack(&self, radiance: &Harmonics) -> Response {
        let mut vectors = radiance.vectors.to_single();
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
    pub(in crate::cache) fn prepare(&self, at: &SurfacePoint, lobe: &mut LobeCoefficients) {
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
    pub(in crate::cache) fn leaving(
        &self, record: &Harmonics, at: &SurfacePoint, offset: Vec3, irradiance: Color,
        lobe: &mut LobeCoefficients,
    ) -> Color {
        let turned = self.aim(record, at, lobe);
        self.reflect(record, offset, irradiance, lobe, turned)
    }

    /// As [`Projector::leaving`], with the standard error of its luminance.
    pub(super) fn leaving_with_error(
        &self, record: &Harmonics, at: &SurfacePoint, offset: Vec3, irradiance: Color,
        lobe: &mut LobeCoefficients,
    ) -> (Color, f32) {
        let turned = self.aim(record, at, lobe);
        (self.reflect(record, offset, irradiance, lobe, turned), self.sigma(record, lobe, turned))
    }

    /// Turns `lobe` at `at` into the frame of `record` if that is another one; returns if it is.
    fn aim(&self, record: &Harmonics, at: &SurfacePoint, lobe: &mut LobeCoefficients) -> bool {
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
        &self, record: &Harmonics, offset: Vec3, irradiance: Color, lobe: &LobeCoefficients,
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
    fn sigma(&self, record: &Harmonics, lobe: &LobeCoefficients, turned: bool) -> f32 {
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
