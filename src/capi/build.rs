//! Building: the records that seed points need.

use super::abi::{lumi_cache, lumi_query, read};
use super::cache::{CacheObject, Settings};
use super::handles::borrow;
use super::query::Points;
use super::scene::SceneKind;
use super::status::{Fault, Outcome, guard, lumi_error};
use crate::cache::{Cache, FillPlan, FillReport, ShadingPoint, scattered};
use crate::error::Error;
use crate::geometry::SurfacePoint;
use crate::hosted::{Exchange, Host};
use crate::progress::Progress;
use crate::render::Caches;
use crate::scene::Scene;
use crate::transport::{CachedLobes, GlossyLobes, PathTracer, SceneWorld, View};
use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::time::Instant;

/// A cache and the lobes that its radiance records answer for.
type Built = (Cache, Option<Arc<GlossyLobes>>);

impl CacheObject {
    /// Fills all levels, deepest first, with what `points` need on the first.
    fn build(&self, points: &Points) -> Outcome {
        let started = Instant::now();
        let (settings, snapshot) = (self.settings(), self.live.snapshot());
        let progress = Progress::default();
        if snapshot.is_frozen() {
            return Err(Fault::operation("the cache is frozen: it takes no more records"));
        }
        let seeds = scattered(&points.valid(), settings.seed);
        let before = (snapshot.compact(), self.lobes.load_full());
        let have_wo = points.have_wo();
        let committed = self.scene.committed()?;
        let (cache, lobes) = self.run(&progress, true, |exchange| match &committed.kind {
            SceneKind::Own(scene) => {
                self.build_own(scene, &settings, &seeds, have_wo, before, &progress)
            }
            SceneKind::Host(host) => {
                self.build_with(host, &settings, &seeds, before.0, exchange, &progress)
            }
        })??;
        self.counters.spent(started);
        self.put(cache, lobes);
        Ok(())
    }

    /// In a scene of our own. Radiance records are made where seeds have directions to the viewer.
    fn build_own(
        &self, scene: &Scene, settings: &Settings, seeds: &[SurfacePoint], have_wo: bool,
        (cache, lobes): Built, progress: &Progress,
    ) -> Outcome<Built> {
        let (scheme, seed) = (&settings.scheme, settings.seed);
        let tracer = PathTracer { scene, max_bounces: settings.max_bounces };
        let wanted = have_wo || scheme.whole();
        let lobes = lobes.or_else(|| {
            let new = || GlossyLobes::new(scene, scheme, settings.max_bounces);
            wanted.then(new).flatten().map(Arc::new)
        });
        let mut caches = Caches::with(cache, lobes);
        let points = self.shading_points(tracer, &mut caches, settings, seeds, wanted);
        let appearance = |points: &[ShadingPoint], _: Option<CachedLobes>| -> Vec<Option<View>> {
            let points: Vec<SurfacePoint> = points.iter().map(|p| p.point).collect();
            tracer.views_at(&points, seed)
        };
        let lobes = caches.lobes.clone();
        let world = SceneWorld::new(tracer, lobes.as_deref(), scheme).with_appearance(&appearance);
        caches.fill(&world, &points, &settings.plan(), progress)?;
        self.counters.rays.fetch_add(caches.report.gather_rays(), Ordering::Relaxed);
        Ok((caches.cache, caches.lobes))
    }

    /// The records that `seeds` need: irradiance everywhere, and where it is `wanted` radiance on
    /// all surfaces of ours whose lobes are cached.
    fn shading_points(
        &self, tracer: PathTracer, caches: &mut Caches, settings: &Settings,
        seeds: &[SurfacePoint], wanted: bool,
    ) -> Vec<ShadingPoint> {
        let Some(lobes) = caches.lobes.as_mut().filter(|_| wanted) else {
            return irradiance_points(seeds).collect();
        };
        Arc::make_mut(lobes).admit_all();
        let (cache, lobes) = (&caches.cache, lobes.choice(&settings.scheme));
        let found = |(number, at): (u32, &SurfacePoint)| {
            let (point, order, _) = tracer.cached_at(at, settings.seed, Some(lobes))?;
            let wanted = cache.shading_point(0, number, point, order);
            (wanted.order > 0).then_some(ShadingPoint { irradiance: false, ..wanted })
        };
        let of_radiance = (0..).zip(seeds).filter_map(found);
        if settings.scheme.whole() {
            of_radiance.collect()
        } else {
            irradiance_points(seeds).chain(of_radiance).collect()
        }
    }

    /// In the scene of `host`: irradiance alone, without refinement.
    fn build_with(
        &self, host: &Host, settings: &Settings, seeds: &[SurfacePoint], mut cache: Cache,
        exchange: &Exchange, progress: &Progress,
    ) -> Outcome<Built> {
        let world = self.host_probe(host, exchange, progress)?;
        let points: Vec<ShadingPoint> = irradiance_points(seeds).collect();
        let mut report = FillReport::new(&cache);
        cache.fill_levels(&world, &points, &settings.plan(), &mut report, progress)?;
        if progress.is_cancelled() {
            return Err(Error::Cancelled.into());
        }
        self.counters.rays.fetch_add(report.gather_rays(), Ordering::Relaxed);
        Ok((cache, None))
    }
}

/// The irradiance records that `seeds` need.
fn irradiance_points(seeds: &[SurfacePoint]) -> impl Iterator<Item = ShadingPoint> + '_ {
    let needed = |(number, at): (u32, &SurfacePoint)| ShadingPoint {
        number,
        point: *at,
        irradiance: true,
        order: 0,
    };
    (0..).zip(seeds).map(needed)
}

impl Settings {
    fn plan(&self) -> FillPlan {
        let deeper_points = self.deeper_points as usize;
        FillPlan { deeper_points, round: 0, seed: self.seed }
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
    cache: lumi_cache, seeds: *const lumi_query,
) -> lumi_error {
    guard("lumi_cache_build", || {
        let cache = borrow::<CacheObject>(cache)?;
        let points = Points::new(&read(seeds, "the query")?, &cache)?;
        let _alone = cache.change()?;
        cache.build(&points)
    })
}
