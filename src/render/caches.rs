//! The caches that a frame, all frames of a sequence, or a host's questions are answered from, and
//! how they are filled.

use crate::cache::{
    Appearance, Cache, FillStats, GlossyView, LevelPoints, LobeCoefficients, RadianceBands,
    RadianceCache, RadiancePoints, Refinement, Scheme, Sources,
};
use crate::error::Result;
use crate::geometry::SurfacePoint;
use crate::material::Bsdf;
use crate::material::tables::{GlossyTables, TableSettings};
use crate::math::Vec3;
use crate::progress::{Phase, Progress};
use crate::sampling::hash;
use crate::scene::Scene;
use crate::transport::{self, PathTracer, SceneProbe, SceneReflector, Service, View};
use std::sync::Arc;

/// What serves the glossy lobes of low frequency. Copies share what does not change.
#[derive(Clone)]
pub struct Gloss {
    /// Those lobes in harmonics.
    pub tables: Arc<GlossyTables>,
    /// Records of the light that reaches them, a cache for each level of bounces.
    pub levels: Vec<RadianceCache>,
    /// For each material whether they serve it.
    served: Vec<bool>,
    /// What the fill did on each level.
    pub fill: Vec<FillStats>,
}

impl Gloss {
    /// What will serve glossy lobes under `scheme`, still without records; `None` where the scheme
    /// or the scene has nothing for it.
    pub fn new(scene: &Scene, scheme: &Scheme, max_bounces: u32) -> Option<Self> {
        let count = u32::from(scheme.levels.min(scheme.radiance_levels)).min(max_bounces) as u8;
        if scheme.radiance_order == 0 || count == 0 {
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
        let tables = GlossyTables::new(scene.materials(), wanted, scene.tables());
        if tables.is_empty() && !scheme.radiance_diffuse {
            return None;
        }
        let levels: Vec<_> =
            (0..count).map(|k| RadianceCache::new(scheme, max_bounces, scene.size(), k)).collect();
        let served = vec![scheme.radiance_break_even <= 0.0; scene.materials().len()];
        let fill = vec![FillStats::default(); levels.len()];
        Some(Self { tables: Arc::new(tables), levels, served, fill })
    }

    /// Lets records serve those materials, too, for which they take the place of enough paths:
    /// `paths` says of how many.
    pub fn serve(&mut self, paths: &[f32], scheme: &Scheme) {
        let enough = scheme.radiance_break_even * self.levels[0].placement().scheme().rays as f32;
        self.served.iter_mut().zip(paths).for_each(|(served, &paths)| *served |= paths >= enough);
    }

    /// True if records serve a material, by its number.
    pub fn serves(&self, material: u32) -> bool {
        self.served[material as usize]
    }

    /// The choice between records and paths.
    pub fn service(&self, scheme: &Scheme) -> Service<'_> {
        Service::new(&self.tables, &self.served, scheme)
    }

    /// What the integrator shades by.
    pub fn shading(&self, scheme: &Scheme) -> transport::Gloss<'_> {
        transport::Gloss { service: self.service(scheme), records: &self.levels }
    }

    /// Number of records on all levels.
    pub fn record_count(&self) -> usize {
        self.levels.iter().map(|l| l.records().len()).sum()
    }

    /// Rays of all gathers so far.
    pub fn gather_rays(&self) -> u64 {
        self.fill.iter().map(|f| f.gather_rays).sum()
    }

    /// Bytes that records and indexes occupy.
    pub fn bytes(&self) -> usize {
        self.levels.iter().map(RadianceCache::bytes).sum()
    }
}

/// The caches that surfaces are shaded by.
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

/// A point of the first level that records are wanted for.
#[derive(Clone, Copy, Debug)]
pub struct Spot {
    /// Whose it is: a number for the caller.
    pub number: u32,
    /// Where.
    pub point: SurfacePoint,
    /// Its irradiance is wanted.
    pub irradiance: bool,
    /// The number of bands of its radiance record, 0 if none is wanted.
    pub order: u8,
}

/// Tells how spots look; `None` where one sees nothing. Glossy lobes count where they are served.
pub type Look<'a> = dyn Fn(&[Spot], Option<&Service>) -> Vec<Option<View>> + 'a;

/// What a fill is done for.
pub struct Job<'a> {
    /// The scene and the length of light paths.
    pub tracer: PathTracer<'a>,
    /// Points of each deeper level.
    pub deeper_points: usize,
    /// Points per round on the first level, see [`LevelPoints::round`].
    pub round: usize,
    /// Seed of everything random.
    pub seed: u64,
    /// How spots look, for schemes that refine records.
    pub look: &'a Look<'a>,
    /// The direction to the viewer from a position, if there is one viewer.
    pub towards: Option<&'a (dyn Fn(Vec3) -> Vec3 + Sync)>,
}

impl Caches {
    /// Caches for `scheme` and light paths of at most `max_bounces` interactions, without records
    /// but those of `before`.
    pub fn new(scene: &Scene, scheme: &Scheme, max_bounces: u32, before: Option<Cache>) -> Self {
        let cache = before.unwrap_or_else(|| Cache::new(scheme.clone(), max_bounces, scene.size()));
        Self::of(cache, Gloss::new(scene, scheme, max_bounces).map(Arc::new))
    }

    /// Caches with the records that these have.
    pub fn of(cache: Cache, gloss: Option<Arc<Gloss>>) -> Self {
        let fill = vec![FillStats::default(); usize::from(cache.level_count())];
        Self { cache, fill, gloss, gathered: [0; 3] }
    }

    /// Number of irradiance records on each level, and of radiance records.
    pub fn record_counts(&self) -> (Vec<usize>, usize) {
        let levels = (0..self.cache.level_count())
            .map(|k| self.cache.level(k).map_or(0, |l| l.records().len()));
        (levels.collect(), self.gloss.as_ref().map_or(0, |g| g.record_count()))
    }

    /// How often records were made smaller so far, because they disagreed with others.
    pub fn reductions(&self) -> u64 {
        self.fill.iter().chain(self.gloss.iter().flat_map(|g| &g.fill)).map(|f| f.reductions).sum()
    }

    /// Fills all levels with what `spots` need beside the records that there are, deepest first; on
    /// each level irradiance before radiance. Gathers read what deeper levels know of both. Returns
    /// for each spot how many records of its kind existed when it was visited.
    ///
    /// # Errors
    /// [`Error::Cancelled`](crate::error::Error::Cancelled).
    pub fn fill(&mut self, job: &Job, spots: &[Spot], progress: &Progress) -> Result<Vec<u32>> {
        let mut births = vec![u32::MAX; spots.len()];
        let count = self.cache.level_count();
        if count == 0 {
            // Light without bounces has nothing to cache.
            return Ok(births);
        }
        let mut deeper: Vec<Vec<Spot>> = Vec::new();
        for level in 1..count {
            deeper.push(self.next_spots(job, level, deeper.last().map_or(spots, Vec::as_slice)));
        }
        let total = |spots: &[Spot]| {
            spots.iter().map(|s| u64::from(s.irradiance) + u64::from(s.order > 0)).sum::<u64>()
        };
        progress.start(Phase::Fill, total(spots) + deeper.iter().map(|d| total(d)).sum::<u64>());
        for level in (0..count).rev() {
            let spots = if level == 0 { spots } else { &deeper[usize::from(level) - 1] };
            let (of_irradiance, of_radiance) =
                (numbers(spots, |s| s.irradiance), numbers(spots, |s| s.order > 0));
            let of_these = self.fill_irradiance(job, level, spots, &of_irradiance, progress)?;
            let of_those = self.fill_radiance(job, level, spots, &of_radiance, progress)?;
            if level == 0 {
                for (numbers, made) in [(of_irradiance, of_these), (of_radiance, of_those)] {
                    numbers.iter().zip(made).for_each(|(&i, birth)| births[i as usize] = birth);
                }
            }
        }
        Ok(births)
    }

    /// Points from which light reaches `before`, as spots of `level`.
    fn next_spots(&self, job: &Job, level: u8, before: &[Spot]) -> Vec<Spot> {
        let scheme = self.cache.scheme();
        let gloss = self.gloss.as_ref().filter(|g| usize::from(level) < g.levels.len());
        let service = gloss.map(|g| g.service(scheme));
        let points: Vec<SurfacePoint> = before.iter().map(|s| s.point).collect();
        let seed = hash(&[job.seed, 2, u64::from(level)]);
        let found = job.tracer.next_cached(&points, job.deeper_points, seed, service.as_ref());
        let spot = |(number, (point, order)): (usize, (SurfacePoint, u8))| {
            let order = if scheme.radiance_diffuse && gloss.is_some() {
                scheme.radiance_order
            } else {
                order
            };
            Spot { number: number as u32, point, irradiance: order == 0, order }
        };
        found.into_iter().enumerate().map(spot).collect()
    }

    fn fill_irradiance(
        &mut self,
        job: &Job,
        level: u8,
        spots: &[Spot],
        chosen: &[u32],
        progress: &Progress,
    ) -> Result<Vec<u32>> {
        let scheme = self.cache.scheme().clone();
        let gloss = self.gloss.clone();
        let behind = gloss.as_ref().map(|g| {
            let first = g.levels.len().min(usize::from(level) + 1);
            transport::Gloss { records: &g.levels[first..], ..g.shading(&scheme) }
        });
        let probe = SceneProbe::new(job.tracer).with_gloss(behind);
        let points = LevelPoints {
            points: points(spots, chosen),
            round: if level == 0 { job.round } else { 0 },
        };
        let stats = self.cache.fill(&probe, level, &points, job.seed, progress)?;
        self.fill[usize::from(level)].add(&stats);
        if level == 0 && scheme.refinement != Refinement::None {
            let views = views(job, spots, chosen, None);
            let looks: Vec<Appearance> = views.iter().map(|l| l.2).collect();
            let refined =
                self.cache.converge(&probe, 0, &points.points, &looks, job.seed, progress)?;
            self.fill[0].add(&refined);
        }
        add(&mut self.gathered, &probe);
        Ok(stats.births)
    }

    fn fill_radiance(
        &mut self,
        job: &Job,
        level: u8,
        spots: &[Spot],
        chosen: &[u32],
        progress: &Progress,
    ) -> Result<Vec<u32>> {
        let Some(gloss) = self.gloss.as_mut().filter(|g| usize::from(level) < g.levels.len())
        else {
            return Ok(Vec::new());
        };
        let scheme = self.cache.scheme();
        let Gloss { tables, levels, served, fill } = Arc::make_mut(gloss);
        let (first, behind) = levels.split_at_mut(usize::from(level) + 1);
        let (records, fill) = (&mut first[usize::from(level)], &mut fill[usize::from(level)]);
        let service = Service::new(tables, served, scheme);
        let probe = SceneProbe::new(job.tracer)
            .with_tables(Some(&**tables))
            .with_gloss(Some(transport::Gloss { service, records: behind }));
        let reflector = SceneReflector { tracer: job.tracer, tables };
        let orders = chosen.iter().map(|&i| spots[i as usize].order).collect();
        let points = LevelPoints {
            points: points(spots, chosen),
            round: if level == 0 { job.round } else { 0 },
        };
        let points = RadiancePoints { points, orders };
        if let Some(towards) = job.towards.filter(|_| level == 0) {
            records.see_from(&reflector, towards);
        }
        let stats =
            records.fill(&probe, &points, &self.cache, Some(&reflector), job.seed, progress)?;
        fill.add(&stats);
        if level == 0 && scheme.refinement != Refinement::None {
            let views = views(job, spots, chosen, Some(&service));
            let appearance: Vec<Appearance> = views.iter().map(|l| l.2).collect();
            let lobes = |p: usize, lobe: &mut LobeCoefficients| {
                let order =
                    service.project(&points.points.points[p], &views[p].1, None, &mut lobe.values);
                order.map(|n| lobe.order = n).is_some()
            };
            let view = GlossyView { points: &points, appearance: &appearance, lobes: &lobes };
            let sources =
                Sources { probe: &probe, deeper: &self.cache, reflector: Some(&reflector) };
            fill.add(&records.converge(&view, &sources, job.seed, progress)?);
        }
        add(&mut self.gathered, &probe);
        if scheme.radiance_diffuse {
            self.cache.share_level(level, records.placement());
        }
        Ok(stats.births)
    }
}

/// The numbers of the spots that are `wanted`.
fn numbers(spots: &[Spot], wanted: impl Fn(&Spot) -> bool) -> Vec<u32> {
    (0..spots.len() as u32).filter(|&i| wanted(&spots[i as usize])).collect()
}

fn points(spots: &[Spot], chosen: &[u32]) -> Vec<SurfacePoint> {
    chosen.iter().map(|&i| spots[i as usize].point).collect()
}

/// How the chosen spots look.
fn views(job: &Job, spots: &[Spot], chosen: &[u32], service: Option<&Service>) -> Vec<View> {
    let chosen: Vec<Spot> = chosen.iter().map(|&i| spots[i as usize]).collect();
    let nothing = |s: &Spot| (s.point, Bsdf::BLACK, Appearance::default());
    (job.look)(&chosen, service)
        .into_iter()
        .zip(&chosen)
        .map(|(seen, s)| seen.unwrap_or_else(|| nothing(s)))
        .collect()
}

/// Adds what `probe` has traced to `rays`.
fn add(rays: &mut [u64; 3], probe: &SceneProbe) {
    rays.iter_mut().zip(probe.counts().totals()).for_each(|(sum, n)| *sum += n);
}
