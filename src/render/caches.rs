//! The caches of a frame, or of all frames of a sequence, and how they are filled.

use super::frame::{camera_sample, pixel_order};
use super::settings::Settings;
use crate::cache::{
    Appearance, Cache, FillStats, GlossyView, LevelPoints, LobeCoefficients, Order, RadianceBands, RadianceCache, RadiancePoints,
    Refinement, Scheme, Sources,
};
use crate::camera::Camera;
use crate::error::{Error, Result};
use crate::geometry::SurfacePoint;
use crate::integrator::{self, PathTracer, SceneProbe, SceneReflector, Service, View, pixel_footprint};
use crate::material::Bsdf;
use crate::material::tables::{GlossyTables, TableSettings, TableStore};
use crate::progress::{Phase, Progress};
use crate::sampling::hash;
use crate::scene::Scene;
use rayon::prelude::*;
use std::sync::Arc;

/// Shading points of the deeper levels, per level.
const DEEPER_POINTS: usize = 16_384;

/// What serves the glossy lobes of low frequency.
pub struct Gloss {
    /// Those lobes in harmonics.
    pub tables: GlossyTables,
    /// Records of the light that reaches them.
    pub records: RadianceCache,
    /// For each material whether they serve it.
    served: Vec<bool>,
    /// What their fill did.
    pub fill: FillStats,
}

impl Gloss {
    fn service(&self, scheme: &Scheme) -> Service<'_> {
        Service::new(&self.tables, &self.served, scheme)
    }

    /// What the integrator shades by.
    pub fn shading(&self, scheme: &Scheme) -> integrator::Gloss<'_> {
        integrator::Gloss { service: self.service(scheme), records: &self.records }
    }
}

/// The caches that a frame is shaded by.
pub struct Caches {
    /// Irradiance on all levels.
    pub cache: Cache,
    /// What the fill did on each level.
    pub fill: Vec<FillStats>,
    /// Radiance on glossy surfaces, if the scheme and the scene have a use for it.
    pub gloss: Option<Arc<Gloss>>,
    /// Rays that the fill traced: bundles, shadow rays and paths at their hits.
    pub gathered: [u64; 3],
}

/// A visible point, the pixel that sees it, and the order of its radiance record, 0 if it needs none.
type Visible = (u32, SurfacePoint, u8);

impl Caches {
    /// Caches for `settings`, without records but those of `before`.
    pub fn new(scene: &Scene, settings: &Settings, before: Option<Cache>) -> Self {
        let cache = before.unwrap_or_else(|| Cache::new(settings.scheme.clone(), settings.max_bounces, scene.size()));
        let fill = vec![FillStats::default(); usize::from(cache.level_count())];
        Self { cache, fill, gloss: gloss(scene, settings).map(Arc::new), gathered: [0; 3] }
    }

    /// Number of irradiance records on each level, and of radiance records.
    pub fn record_counts(&self) -> (Vec<usize>, usize) {
        let levels = (0..self.cache.level_count()).map(|k| self.cache.level(k).map_or(0, |l| l.records().len()));
        (levels.collect(), self.gloss.as_ref().map_or(0, |g| g.records.records().len()))
    }

    /// How often records were made smaller so far, because they disagreed with others.
    pub fn reductions(&self) -> u64 {
        self.fill.iter().chain(self.gloss.iter().map(|g| &g.fill)).map(|f| f.reductions).sum()
    }

    /// Fills all levels with what the camera of `settings` needs beside the records that there are, deepest first. Returns for each pixel of the window how many records existed when it was
    /// visited.
    ///
    /// `others` are further cameras that will see the records: no record is made larger than the smallest of their pixels allows.
    ///
    /// # Errors
    /// [`Error::Cancelled`], and [`Error::InvalidArgument`] while a frame holds the radiance records.
    pub fn fill(&mut self, scene: &Scene, settings: &Settings, others: &[Camera], progress: &Progress) -> Result<Vec<u32>> {
        let tracer = PathTracer { scene, max_bounces: settings.max_bounces };
        let probe = SceneProbe::new(tracer);
        let order = pixel_order(settings);
        let mut births = vec![u32::MAX; order.len()];
        if self.cache.level_count() == 0 {
            // Light without bounces has nothing to cache.
            return Ok(births);
        }
        let visible = self.visible(tracer, settings, others, &order)?;
        let everything: Vec<SurfacePoint> = visible.iter().map(|v| v.1).collect();
        let (glossy, diffuse): (Vec<_>, Vec<_>) = visible.into_iter().partition(|v| v.2 > 0);
        let refined = settings.scheme.refinement != Refinement::None;
        let looks = if refined { views(tracer, settings, &diffuse, None) } else { Vec::new() };
        let appearances: Vec<Appearance> = looks.iter().map(|l| l.2).collect();
        let width = (settings.window[2] - settings.window[0]) as usize;
        let round = if settings.scheme.order == Order::Scanline { width } else { 0 };
        let mut levels = vec![LevelPoints { points: diffuse.iter().map(|v| v.1).collect(), round }];
        for level in 1..self.cache.level_count() {
            let seed = hash(&[settings.seed, 2, u64::from(level)]);
            let before = if level == 1 { &everything } else { &levels[levels.len() - 1].points };
            let points = tracer.next_points(before, DEEPER_POINTS, seed);
            levels.push(LevelPoints { points, round: 0 });
        }
        let count: usize = levels.iter().map(|l| l.points.len()).sum();
        progress.start(Phase::Fill, (count + glossy.len()) as u64);
        for (level, points) in levels.iter().enumerate().rev() {
            let stats = self.cache.fill(&probe, level as u8, points, settings.seed, progress)?;
            if level == 0 {
                diffuse.iter().zip(&stats.births).for_each(|(v, &birth)| births[v.0 as usize] = birth);
            }
            self.fill[level].add(&stats);
            if level == 0 && refined {
                let stats = self.cache.converge(&probe, 0, &points.points, &appearances, settings.seed, progress)?;
                self.fill[level].add(&stats);
            }
        }
        if let Some(gloss) = &mut self.gloss {
            let gloss = Arc::get_mut(gloss).ok_or_else(held)?;
            let points = LevelPoints { points: glossy.iter().map(|v| v.1).collect(), round };
            let points = RadiancePoints { points, orders: glossy.iter().map(|v| v.2).collect() };
            let probe = SceneProbe::new(tracer).with_tables(Some(&gloss.tables));
            let reflector = SceneReflector { tracer, tables: &gloss.tables };
            gloss.records.see_from(&reflector, &|p| settings.camera.towards(p));
            let stats = gloss.records.fill(&probe, &points, &self.cache, Some(&reflector), settings.seed, progress)?;
            glossy.iter().zip(&stats.births).for_each(|(v, &birth)| births[v.0 as usize] = birth);
            gloss.fill.add(&stats);
            if refined {
                let service = Service::new(&gloss.tables, &gloss.served, &settings.scheme);
                let looks = views(tracer, settings, &glossy, Some(&service));
                let appearance: Vec<Appearance> = looks.iter().map(|l| l.2).collect();
                let lobes = |p: usize, lobe: &mut LobeCoefficients| {
                    let order = service.project(&points.points.points[p], &looks[p].1, None, &mut lobe.values);
                    order.map(|n| lobe.order = n).is_some()
                };
                let view = GlossyView { points: &points, appearance: &appearance, lobes: &lobes };
                let sources = Sources { probe: &probe, deeper: &self.cache, reflector: Some(&reflector) };
                gloss.fill.add(&gloss.records.converge(&view, &sources, settings.seed, progress)?);
            }
            if settings.scheme.radiance_diffuse {
                self.cache.share_level(0, gloss.records.placement());
            }
            add(&mut self.gathered, &probe);
        }
        add(&mut self.gathered, &probe);
        Ok(births)
    }

    /// What the pixels see by their first samples. Decides which materials are worth radiance records.
    fn visible(&mut self, tracer: PathTracer, settings: &Settings, others: &[Camera], order: &[u32]) -> Result<Vec<Visible>> {
        let all = vec![true; tracer.scene.materials().len()];
        let service = self.gloss.as_ref().map(|g| Service::new(&g.tables, &all, &settings.scheme));
        let mut visible: Vec<(Visible, bool)> = order
            .par_iter()
            .filter_map(|&p| {
                let sample = camera_sample(settings, p, 0, u32::MAX);
                let (mut point, order, diffuse) = tracer.first_cached(&sample.camera, sample.seed, service.as_ref())?;
                for camera in others {
                    let footprint = pixel_footprint(camera, settings.size, &point);
                    point.footprint = point.footprint.min(footprint.unwrap_or(f32::INFINITY));
                }
                let whole = settings.scheme.radiance_diffuse && self.gloss.is_some();
                Some(((p, point, if whole { settings.scheme.radiance_order } else { order }), diffuse))
            })
            .collect();
        if let Some(gloss) = self.gloss.as_mut().filter(|_| !settings.scheme.radiance_diffuse) {
            let gloss = Arc::get_mut(gloss).ok_or_else(held)?;
            let mut paths = vec![0.0; all.len()];
            for ((_, point, _), _) in visible.iter().filter(|((_, _, order), _)| *order > 0) {
                paths[point.material as usize] += settings.spp as f32;
            }
            let enough = settings.scheme.radiance_break_even * gloss.records.placement().scheme().rays as f32;
            gloss.served.iter_mut().zip(paths).for_each(|(served, paths)| *served |= paths >= enough);
            for ((_, point, order), _) in &mut visible {
                *order *= u8::from(gloss.served[point.material as usize]);
            }
        }
        Ok(visible.into_iter().filter(|((_, _, order), diffuse)| *order > 0 || *diffuse).map(|v| v.0).collect())
    }
}

/// Adds what `probe` has traced to `rays`.
fn add(rays: &mut [u64; 3], probe: &SceneProbe) {
    rays.iter_mut().zip(probe.counts().totals()).for_each(|(sum, n)| *sum += n);
}

/// Frames must not see records change.
fn held() -> Error {
    Error::InvalidArgument("a frame holds the radiance records that are to be filled".into())
}

/// How the points look.
fn views(tracer: PathTracer, settings: &Settings, points: &[Visible], service: Option<&Service>) -> Vec<View> {
    let samples = points.iter().map(|v| camera_sample(settings, v.0, 0, u32::MAX));
    let rays: Vec<_> = samples.map(|s| (s.camera, s.seed)).collect();
    let nothing = |v: &Visible| (v.1, Bsdf::BLACK, Appearance::default());
    tracer.views(&rays, service).into_iter().zip(points).map(|(seen, v)| seen.unwrap_or_else(|| nothing(v))).collect()
}

/// What will serve glossy lobes, still without records; `None` where the scheme or the scene has nothing for it.
fn gloss(scene: &Scene, settings: &Settings) -> Option<Gloss> {
    let scheme = &settings.scheme;
    if scheme.radiance_order == 0 || settings.max_bounces == 0 {
        return None;
    }
    let wanted = TableSettings {
        basis: scheme.radiance_basis,
        order: usize::from(scheme.radiance_order),
        loss: scheme.radiance_loss,
        padding: scheme.radiance_padding,
        whole: scheme.radiance_diffuse,
        forced: scheme.radiance_bands == RadianceBands::All,
    };
    let tables = GlossyTables::new(scene.materials(), wanted, &TableStore::from_environment());
    let records = RadianceCache::new(scheme, settings.max_bounces, scene.size());
    let served = vec![scheme.radiance_break_even <= 0.0; scene.materials().len()];
    (scheme.radiance_diffuse || !tables.is_empty()).then(|| Gloss { tables, records, served, fill: FillStats::default() })
}
