//! The records that a frame, all frames of a sequence, or a host's questions are answered from.

use crate::cache::{Cache, FillPlan, FillReport, Scheme, ShadingPoint};
use crate::error::Result;
use crate::progress::Progress;
use crate::scene::Scene;
use crate::transport::{CachedLobes, GlossyLobes, SceneWorld};
use std::sync::Arc;

/// A cache of our own scene, the glossy lobes that its radiance records answer for, and what was
/// done to fill it.
#[derive(Clone)]
pub struct Caches {
    /// The records.
    pub cache: Cache,
    /// The lobes, if the scheme caches radiance and the scene has a use for that. Copies share
    /// them.
    pub lobes: Option<Arc<GlossyLobes>>,
    /// What the fill did on each level.
    pub report: FillReport,
    /// Rays that the fill traced: bundles, shadow rays and paths at their hits.
    pub gathered: [u64; 3],
}

impl Caches {
    /// Caches for `scheme` and light paths of at most `max_bounces` interactions, without records
    /// but those of `before`.
    pub fn new(scene: &Scene, scheme: &Scheme, max_bounces: u32, before: Option<Cache>) -> Self {
        let new = || Cache::new(scheme.clone(), max_bounces);
        let lobes = GlossyLobes::new(scene, scheme, max_bounces).map(Arc::new);
        Self::with(before.unwrap_or_else(new), lobes)
    }

    /// The records of `cache`, with radiance caches if there are `lobes`.
    pub fn with(cache: Cache, lobes: Option<Arc<GlossyLobes>>) -> Self {
        let cache = if lobes.is_some() { cache.with_radiance() } else { cache };
        let report = FillReport::new(&cache);
        Self { cache, lobes, report, gathered: [0; 3] }
    }

    /// The choice between cached and traced lobes.
    pub fn choice(&self) -> Option<CachedLobes<'_>> {
        self.lobes.as_ref().map(|l| l.choice(self.cache.scheme()))
    }

    /// Fills the cache with what `points` need: see [`Cache::fill_levels`].
    ///
    /// # Errors
    /// [`Error::Cancelled`](crate::error::Error::Cancelled).
    pub fn fill(
        &mut self, world: &SceneWorld, points: &[ShadingPoint], plan: &FillPlan,
        progress: &Progress,
    ) -> Result<Vec<u32>> {
        let before = world.rays();
        let births = self.cache.fill_levels(world, points, plan, &mut self.report, progress);
        for (sum, (now, before)) in self.gathered.iter_mut().zip(world.rays().iter().zip(before)) {
            *sum += now - before;
        }
        births
    }
}
