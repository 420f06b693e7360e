//! Our own scene as the world of a cache.

use super::lobes::{CachedLobes, GlossyLobes};
use super::path::PathTracer;
use super::points::View;
use super::probe::SceneProbe;
use super::reflector::SceneReflector;
use super::transfer::SceneTransfer;
use crate::cache::{
    Appearance, Appearances, Reflector, Scheme, ShadingPoint, Towards, Transfer, World,
};
use crate::gather::{LobeCoefficients, RadianceProbe};
use crate::geometry::SurfacePoint;
use crate::material::Bsdf;

/// Tells how shading points look, `None` where one sees nothing. Glossy lobes count where they are
/// cached.
pub type AppearanceOf<'a> =
    dyn Fn(&[ShadingPoint], Option<CachedLobes>) -> Vec<Option<View>> + Sync + 'a;

/// Our own scene with the paths that gathers trace in it, the lobes that are cached, and a viewer.
pub struct SceneWorld<'a> {
    tracer: PathTracer<'a>,
    lobes: Option<CachedLobes<'a>>,
    probe: SceneProbe<'a>,
    reflector: Option<SceneReflector<'a>>,
    appearance_of: Option<&'a AppearanceOf<'a>>,
    towards: Option<&'a Towards<'a>>,
    /// Gathers have rays for small bright surfaces, or records of all light beware of them.
    seeks_bright: bool,
}

impl<'a> SceneWorld<'a> {
    /// The scene of `tracer`; `lobes` are its glossy lobes, if radiance is cached under `scheme`.
    pub fn new(tracer: PathTracer<'a>, lobes: Option<&'a GlossyLobes>, scheme: &Scheme) -> Self {
        let lobes = lobes.map(|l| l.choice(scheme));
        let probe = SceneProbe::new(tracer).with_lobes(lobes);
        let reflector = lobes.map(|l| SceneReflector { tracer, tables: l.tables });
        let seeks_bright = scheme.gather.bright > 0.0 || scheme.radiosity.is_some();
        Self { tracer, lobes, probe, reflector, appearance_of: None, towards: None, seeks_bright }
    }

    /// The same world in which `of` tells how points look.
    #[must_use]
    pub fn with_appearance(self, of: &'a AppearanceOf<'a>) -> Self {
        Self { appearance_of: Some(of), ..self }
    }

    /// The same world with a viewer: `towards` is the direction to the viewer from a position.
    #[must_use]
    pub fn with_viewer(self, towards: &'a Towards<'a>) -> Self {
        Self { towards: Some(towards), ..self }
    }

    /// Rays traced so far: bundles, shadow rays and paths at their hits.
    pub fn rays(&self) -> [u64; 3] {
        self.probe.counts().totals()
    }
}

impl World for SceneWorld<'_> {
    fn probe(&self) -> &dyn RadianceProbe {
        &self.probe
    }

    fn prepare(&self, points: &[SurfacePoint], seed: u64) {
        self.probe.aim_at(points);
        if self.seeks_bright {
            self.probe.seek_bright(points, seed);
        }
    }

    fn next_points(
        &self, before: &[SurfacePoint], _: u8, radiance: bool, count: usize, seed: u64,
    ) -> Vec<(SurfacePoint, u8)> {
        self.tracer.next_points(before, count, seed, self.lobes.filter(|_| radiance))
    }

    fn appearances(&self, points: &[ShadingPoint], radiance: bool) -> Option<Appearances<'_>> {
        let lobes = self.lobes.filter(|_| radiance);
        let nothing = |p: &ShadingPoint| (p.point, Bsdf::BLACK, Appearance::default());
        let seen = self.appearance_of?(points, lobes).into_iter().zip(points);
        let views: Vec<View> = seen.map(|(seen, p)| seen.unwrap_or_else(|| nothing(p))).collect();
        let of_points = views.iter().map(|v| v.2).collect();
        let Some(lobes) = lobes else { return Some(Appearances { of_points, lobes: None }) };
        let points: Vec<SurfacePoint> = points.iter().map(|p| p.point).collect();
        let lobe = move |p: usize, lobe: &mut LobeCoefficients| {
            let order = lobes.project(&points[p], &views[p].1, None, &mut lobe.values);
            order.map(|n| lobe.order = n).is_some()
        };
        Some(Appearances { of_points, lobes: Some(Box::new(lobe)) })
    }

    fn transfer(&self) -> Option<Box<dyn Transfer + '_>> {
        Some(Box::new(SceneTransfer { tracer: self.tracer, bright: self.probe.bright() }))
    }

    fn reflector(&self) -> Option<&dyn Reflector> {
        self.reflector.as_ref().map(|r| r as &dyn Reflector)
    }

    fn towards_viewer(&self) -> Option<&Towards<'_>> {
        self.towards
    }
}
