//! A cache that threads read while others add to it.
//!
//! What readers see is an immutable [`Snapshot`]: the levels of a deterministic fill, and late
//! records of the first level that were added since, in batches. A batch is a small level with an
//! index of its own; batches of like size are joined, so that there are never more than about log2
//! of the number of late records, and a record is indexed again as often. Readers take the snapshot
//! without waiting for anybody.
//!
//! Late records depend on which thread asked first. Where the same records are wanted every time,
//! fill before reading and add nothing.

use super::cache::Cache;
use super::index::Answer;
use super::published::Published;
use super::records::Store;
use crate::cache::payload::Irradiance;
use crate::cache::record::Record;
use crate::geometry::SurfacePoint;
use std::sync::Arc;

/// One state of a [`Live`] cache.
#[derive(Clone)]
pub struct Snapshot {
    cache: Cache,
    late: Vec<Arc<Store<Irradiance>>>,
    /// Counts the caches put here by [`Live::replace`]: late records belong to one of them.
    generation: u64,
    /// No late records are taken.
    frozen: bool,
}

/// A cache under a name that several threads share.
pub struct Live(Published<Snapshot>);

impl Snapshot {
    /// The cache without the late records.
    pub fn cache(&self) -> &Cache {
        &self.cache
    }

    /// True once no more records can be added.
    pub fn is_frozen(&self) -> bool {
        self.frozen
    }

    /// The first level's answer at `at` from all its records.
    #[inline]
    pub fn lookup(&self, at: &SurfacePoint) -> Option<Answer> {
        let mut found = self.cache.lookup(0, at, u32::MAX);
        for late in &self.late {
            found = match (found, late.lookup(at, u32::MAX)) {
                (Some(a), Some(b)) => Some(joined(&a, &b)),
                (a, b) => a.or(b),
            };
        }
        found
    }

    pub(in crate::cache) fn covers(&self, at: &SurfacePoint) -> bool {
        let early = self.cache.level(0).map(|level| level.irradiance()).into_iter();
        early.chain(self.late.iter().map(Arc::as_ref)).any(|store| store.index().covers(at))
    }

    /// All irradiance records, deepest level last, each with its level.
    pub fn records(&self) -> impl Iterator<Item = (u8, &Record<Irradiance>)> {
        let of = |level: u8| self.cache.records(level).iter().map(move |r| (level, r));
        let late = self.late.iter().flat_map(|l| l.records()).map(|r| (0, r));
        of(0).chain(late).chain((1..self.cache.level_count()).flat_map(of))
    }

    /// Number of irradiance records on all levels.
    pub fn record_count(&self) -> usize {
        self.cache.record_count() + self.late.iter().map(|l| l.len()).sum::<usize>()
    }

    /// Number of batches of late records.
    #[cfg(test)]
    pub(in crate::cache) fn late_batches(&self) -> usize {
        self.late.len()
    }

    /// Bytes that records and indexes occupy.
    pub fn bytes(&self) -> usize {
        self.cache.bytes() + self.late_bytes()
    }

    /// The same of the late records.
    pub(in crate::cache) fn late_bytes(&self) -> usize {
        self.late.iter().map(|l| l.bytes()).sum()
    }

    /// The cache with the late records among those of its first level.
    pub fn compact(&self) -> Cache {
        let mut cache = self.cache.clone();
        if !self.late.is_empty() {
            let all =
                self.records().filter(|(level, _)| *level == 0).map(|(_, r)| r.clone()).collect();
            cache.replace(0, all);
        }
        cache
    }

    /// The snapshot with `batch` among the late records.
    fn with(&self, batch: Store<Irradiance>) -> Self {
        let mut late = self.late.clone();
        let mut last = batch;
        while let Some(before) = late.pop_if(|l| l.len() < 2 * last.len()) {
            let records = before.records().iter().chain(last.records()).cloned().collect();
            last = self.cache.rules().clamped_store(0, records);
        }
        late.push(Arc::new(last));
        Self { late, ..self.clone() }
    }
}

/// The mean of two answers by the weights of their records.
fn joined(a: &Answer, b: &Answer) -> Answer {
    let weight = a.weight + b.weight;
    let (wa, wb) = (a.weight / weight, b.weight / weight);
    Answer {
        glossy: wa * a.glossy + wb * b.glossy,
        irradiance: wa * a.irradiance + wb * b.irradiance,
        direct: a.direct.zip(b.direct).map(|(a, b)| wa * a + wb * b),
        error: wa * a.error + wb * b.error,
        allowed: wa * a.allowed + wb * b.allowed,
        records: a.records + b.records,
        weight,
    }
}

impl Live {
    /// Starts with `cache`.
    pub fn new(cache: Cache) -> Self {
        Self(Published::new(Snapshot { cache, late: Vec::new(), generation: 0, frozen: false }))
    }

    /// Calls `f` with the current state. Never waits.
    #[inline]
    pub fn read<R>(&self, f: impl FnOnce(&Snapshot) -> R) -> R {
        self.0.read(f)
    }

    /// The current state, to be kept.
    pub fn snapshot(&self) -> Arc<Snapshot> {
        self.0.get()
    }

    /// Puts another cache here. Late records that are being made for the former one are thrown
    /// away.
    pub fn replace(&self, cache: Cache) {
        self.0.update(|s| {
            Some(Snapshot { cache, late: Vec::new(), generation: s.generation + 1, frozen: false })
        });
    }

    /// Makes the late records part of the first level; more are refused from now on.
    pub fn freeze(&self) {
        self.0.update(|s| {
            Some(Snapshot { cache: s.compact(), late: Vec::new(), frozen: true, ..s.clone() })
        });
    }

    /// Gives an empty cache its extent, unless it has one.
    pub(in crate::cache) fn settle(&self, extent: f32) {
        self.0.update(|s| {
            let cache = (s.cache.extent() == 0.0).then(|| s.cache.clone().with_extent(extent))?;
            Some(Snapshot { cache, ..s.clone() })
        });
    }

    /// Adds late records that were made for `base`, unless another cache has taken its place or the
    /// cache is frozen.
    pub(in crate::cache) fn add(&self, base: &Snapshot, batch: Store<Irradiance>) {
        self.0.update(|s| (s.generation == base.generation && !s.frozen).then(|| s.with(batch)));
    }
}
