//! Building: the records that seed points need.

use super::abi::{lumi_cache, lumi_query, read};
use super::cache::{CacheObject, Settings};
use super::handles::borrow;
use super::query::Points;
use super::scene::World;
use super::status::{Fault, Outcome, guard, lumi_error};
use crate::cache::{Cache, LevelPoints};
use crate::error::Error;
use crate::geometry::SurfacePoint;
use crate::hosted::{Exchange, Host};
use crate::progress::{Phase, Progress};
use crate::render::{Caches, FillJob as Job, Gloss, Spot};
use crate::sampling::hash;
use crate::scene::Scene;
use crate::transport::{PathTracer, Service, View};
use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::time::Instant;

/// What is made of seeds.
type Built = (Cache, Option<Arc<Gloss>>);

impl CacheObject {
    /// Fills all levels, deepest first, with what `points` need on the first.
    fn build(&self, points: &Points) -> Outcome {
        let started = Instant::now();
        let (settings, snapshot, progress) =
            (self.settings(), self.live.snapshot(), Progress::default());
        if snapshot.is_frozen() {
            return Err(Fault::operation("the cache is frozen: it takes no more records"));
        }
        let seeds = LevelPoints::scattered(points.valid(), settings.seed).points;
        let before = (snapshot.compact(), self.gloss.load_full());
        let committed = self.scene.committed()?;
        let (cache, gloss) = self.run(&progress, true, |exchange| match &committed.world {
            World::Own(scene) => {
                self.build_own(scene, &settings, seeds, points.have_wo(), before, &progress)
            }
            World::Host(host) => {
                Ok((self.build_with(host, &settings, seeds, before.0, exchange, &progress)?, None))
            }
        })??;
        self.counters.spent(started);
        self.put(cache, gloss);
        Ok(())
    }

    /// In a scene of our own. Radiance records are made where the seeds say from where they are
    /// looked at.
    fn build_own(
        &self,
        scene: &Scene,
        settings: &Settings,
        seeds: Vec<SurfacePoint>,
        have_wo: bool,
        (cache, gloss): Built,
        progress: &Progress,
    ) -> Outcome<Built> {
        let (scheme, seed) = (&settings.scheme, settings.seed);
        let tracer = PathTracer { scene, max_bounces: settings.max_bounces };
        let wanted = scheme.radiance_diffuse || have_wo;
        let gloss = gloss.or_else(|| {
            Gloss::new(scene, scheme, settings.max_bounces).filter(|_| wanted).map(Arc::new)
        });
        let before = gloss.as_ref().map_or(0, |g| g.gather_rays());
        let mut caches = Caches::of(cache, gloss);
        let spots = spots(tracer, &mut caches, settings, &seeds, have_wo);
        let look = |spots: &[Spot], _: Option<&Service>| -> Vec<Option<View>> {
            let points: Vec<SurfacePoint> = spots.iter().map(|s| s.point).collect();
            tracer.views_at(&points, seed)
        };
        let deeper_points = settings.deeper_points as usize;
        caches.fill(
            &Job { tracer, deeper_points, round: 0, seed, look: &look, towards: None },
            &spots,
            progress,
        )?;
        let rays = caches.fill.iter().map(|f| f.gather_rays).sum::<u64>();
        let of_gloss = caches.gloss.as_ref().map_or(0, |g| g.gather_rays()) - before;
        self.counters.rays.fetch_add(rays + of_gloss, Ordering::Relaxed);
        Ok((caches.cache, caches.gloss))
    }

    /// In the scene of `host`, of whose surfaces little is known: irradiance alone, without
    /// refinement.
    fn build_with(
        &self,
        host: &Host,
        settings: &Settings,
        seeds: Vec<SurfacePoint>,
        mut cache: Cache,
        exchange: &Exchange,
        progress: &Progress,
    ) -> Outcome<Cache> {
        if cache.level_count() == 0 {
            return Ok(cache);
        }
        let probe = self.host_probe(host, exchange, progress)?;
        let mut levels = vec![LevelPoints { points: seeds, round: 0 }];
        for level in 1..cache.level_count() {
            let (from, count) = (&levels[levels.len() - 1].points, settings.deeper_points as usize);
            let seed = hash(&[settings.seed, 2, u64::from(level)]);
            let points = probe.next_points(from, count, u32::from(level), seed);
            levels.push(LevelPoints { points, round: 0 });
        }
        progress.start(Phase::Fill, levels.iter().map(|l| l.points.len() as u64).sum());
        let mut rays = 0;
        for (level, points) in levels.iter().enumerate().rev() {
            rays += cache.fill(&probe, level as u8, points, settings.seed, progress)?.gather_rays;
        }
        if progress.is_cancelled() {
            return Err(Error::Cancelled.into());
        }
        self.counters.rays.fetch_add(rays, Ordering::Relaxed);
        Ok(cache)
    }
}

/// The records that `seeds` need: irradiance everywhere, as hosts ask for it with or without `wo`,
/// and radiance on all surfaces of ours that have a use for it: a host that says from where they
/// are looked at has one, too.
fn spots(
    tracer: PathTracer,
    caches: &mut Caches,
    settings: &Settings,
    seeds: &[SurfacePoint],
    have_wo: bool,
) -> Vec<Spot> {
    let scheme = &settings.scheme;
    let numbered = || (0_u32..).zip(seeds);
    let of_irradiance =
        numbered().map(|(number, at)| Spot { number, point: *at, irradiance: true, order: 0 });
    let Some(gloss) = caches.gloss.as_mut().filter(|_| have_wo || scheme.radiance_diffuse) else {
        return of_irradiance.collect();
    };
    let gloss = Arc::make_mut(gloss);
    gloss.serve(&vec![f32::INFINITY; tracer.scene.materials().len()], scheme);
    let service = gloss.service(scheme);
    let found = |(number, at): (u32, &SurfacePoint)| {
        let (point, order, _) = tracer.cached_at(at, settings.seed, Some(&service))?;
        let order = if scheme.radiance_diffuse { scheme.radiance_order } else { order };
        (order > 0).then_some(Spot { number, point, irradiance: false, order })
    };
    let of_radiance = numbered().filter_map(found);
    if scheme.radiance_diffuse {
        of_radiance.collect()
    } else {
        of_irradiance.chain(of_radiance).collect()
    }
}

/// Makes records until every seed point is covered; records of deeper bounces come first. Where
/// seeds have `wo`, and scene and preset have a use for them, radiance records are made beside the
/// others, for glossy lobes that harmonics represent. Presets that refine records refine them in
/// scenes of our own. Records that the cache has already are kept. The same settings, points and
/// calls give the same records, bit for bit, on any number of threads. After a failure, and when
/// cancelled, the cache is as before.
///
/// `seeds`: positions, normals, wo and footprints are read, nothing is written.
///
/// Threads: one per cache; lookups may go on meanwhile and see the cache as it was.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn lumi_cache_build(
    cache: lumi_cache,
    seeds: *const lumi_query,
) -> lumi_error {
    guard("lumi_cache_build", || {
        let cache = borrow::<CacheObject>(cache)?;
        let points = Points::new(&read(seeds, "the query")?, &cache)?;
        let _alone = cache.change()?;
        cache.build(&points)
    })
}
