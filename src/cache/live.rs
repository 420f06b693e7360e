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

use super::published::Published;
use super::{Answer, Cache, FillStats, Level, LevelPoints, Record};
use crate::error::{Error, Result};
use crate::gather::RadianceProbe;
use crate::geometry::SurfacePoint;
use crate::progress::Progress;
use rayon::prelude::*;
use std::sync::Arc;

/// One state of a [`Live`] cache.
#[derive(Clone)]
pub struct Snapshot {
    cache: Cache,
    late: Vec<Arc<Level>>,
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
            found = match (found, late.index().lookup(at, u32::MAX)) {
                (Some(a), Some(b)) => Some(joined(&a, &b)),
                (a, b) => a.or(b),
            };
        }
        found
    }

    fn covers(&self, at: &SurfacePoint) -> bool {
        let early = self.cache.level(0).into_iter();
        early.chain(self.late.iter().map(Arc::as_ref)).any(|level| level.index().covers(at))
    }

    /// All records, deepest level last, each with its level.
    pub fn records(&self) -> impl Iterator<Item = (u8, &Record)> {
        let of = |level: u8| {
            self.cache.level(level).map_or(&[][..], Level::records).iter().map(move |r| (level, r))
        };
        let late = self.late.iter().flat_map(|l| l.records()).map(|r| (0, r));
        of(0).chain(late).chain((1..self.cache.level_count()).flat_map(of))
    }

    /// Number of records on all levels.
    pub fn record_count(&self) -> usize {
        self.cache.record_count() + self.late.iter().map(|l| l.records().len()).sum::<usize>()
    }

    /// Bytes that records and indexes occupy.
    pub fn bytes(&self) -> usize {
        let early = (0..self.cache.level_count()).filter_map(|k| self.cache.level(k));
        early.chain(self.late.iter().map(Arc::as_ref)).map(Level::bytes).sum()
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
    fn with(&self, batch: Level) -> Self {
        let mut late = self.late.clone();
        let mut last = batch;
        while let Some(before) = late.pop_if(|l| l.records().len() < 2 * last.records().len()) {
            let records = before.records().iter().chain(last.records()).cloned().collect();
            last = self.cache.level_of(0, records);
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

    /// Makes late records until every point of `points` is covered. Any number of threads may do so
    /// at once; no lock is held while `probe` is asked. Two threads that miss at the same place
    /// at the same time may both make a record there.
    ///
    /// # Errors
    /// [`Error::Cancelled`], and [`Error::InvalidArgument`] when the cache is frozen; nothing is
    /// added then.
    pub fn fill(
        &self,
        probe: &dyn RadianceProbe,
        mut points: Vec<SurfacePoint>,
        seed: u64,
        progress: &Progress,
    ) -> Result<FillStats> {
        let base = self.snapshot();
        if base.frozen {
            return Err(Error::InvalidArgument(
                "the cache is frozen: it takes no more records".into(),
            ));
        }
        if base.cache.level_count() == 0 {
            return Ok(FillStats::default());
        }
        points = points.into_par_iter().filter(|p| !base.covers(p)).collect();
        if points.is_empty() {
            return Ok(FillStats::default());
        }
        let (batch, stats) = base.cache.filled(
            probe,
            0,
            &LevelPoints { points, round: 0 },
            seed,
            Vec::new(),
            progress,
        )?;
        self.0.update(|s| (s.generation == base.generation && !s.frozen).then(|| s.with(batch)));
        Ok(stats)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cache::Preset;
    use crate::gather::{Bundle, Deeper};
    use crate::math::{Color, Vec3};

    /// A closed sphere of radius 1 around the origin that reflects radiance 2 from everywhere.
    struct Shell;

    impl RadianceProbe for Shell {
        fn incoming(&self, _: &SurfacePoint, _: u8, _: &dyn Deeper, bundle: &mut Bundle) {
            bundle.radiance.fill(Color::splat(2.0));
            bundle.distance.fill(1.0);
        }
    }

    fn point(x: f32, y: f32) -> SurfacePoint {
        SurfacePoint { footprint: 0.01, ..SurfacePoint::plain(Vec3::new(x, y, 0.0), Vec3::Z) }
    }

    fn live() -> Live {
        let mut scheme = Preset::by_name("ward-heckbert92").unwrap().scheme();
        scheme.gather.rays = 16;
        scheme.levels = 1;
        Live::new(Cache::new(scheme, u32::MAX, 2.0))
    }

    fn row(y: f32) -> Vec<SurfacePoint> {
        (0..100).map(|i| point(i as f32 * 0.02 - 1.0, y)).collect()
    }

    #[test]
    fn late_records_answer_and_stay_few_batches() {
        let live = live();
        let kept = live.snapshot();
        for k in 0..40 {
            live.fill(&Shell, row(k as f32 * 0.05 - 1.0), 1, &Progress::default()).unwrap();
        }
        let now = live.snapshot();
        assert!(now.late.len() <= 8, "{} batches", now.late.len());
        let count = now.record_count();
        assert!(count > 100, "{count} records");
        for p in (0..40).flat_map(|k| row(k as f32 * 0.05 - 1.0)) {
            let e = now.lookup(&p).expect("covered").irradiance;
            assert!((e.x / std::f32::consts::TAU - 1.0).abs() < 0.2, "{e}");
            assert!(kept.lookup(&p).is_none(), "a snapshot changed");
        }
        // Everything is covered: nothing more is made.
        assert_eq!(live.fill(&Shell, row(0.0), 1, &Progress::default()).unwrap().gather_rays, 0);
        live.freeze();
        let frozen = live.snapshot();
        assert_eq!((frozen.record_count(), frozen.late.len()), (count, 0));
        assert!(live.fill(&Shell, row(0.5), 1, &Progress::default()).is_err());
        let close = |p: &SurfacePoint| {
            (now.lookup(p).unwrap().irradiance - frozen.lookup(p).unwrap().irradiance).length()
                < 1e-4
        };
        assert!(row(0.0).iter().all(close), "one index answers differently from several");
    }

    #[test]
    fn threads_fill_while_others_read() {
        let live = live();
        std::thread::scope(|s| {
            for t in 0..4 {
                let live = &live;
                s.spawn(move || {
                    for k in 0..20 {
                        let points = row((k * 4 + t) as f32 * 0.025 - 1.0);
                        live.fill(&Shell, points.clone(), 1, &Progress::default()).unwrap();
                        live.read(|s| {
                            assert!(
                                points.iter().all(|p| s.lookup(p).is_some()),
                                "its own records are missing"
                            )
                        });
                    }
                });
            }
            for _ in 0..2 {
                s.spawn(|| {
                    let mut before = 0;
                    for _ in 0..500 {
                        let (count, answers) = live.read(|s| {
                            (s.record_count(), row(0.0).iter().filter_map(|p| s.lookup(p)).count())
                        });
                        assert!(
                            count >= before && answers <= 100,
                            "{count} records after {before}"
                        );
                        before = count;
                    }
                });
            }
        });
    }

    #[test]
    fn what_is_made_for_a_cache_that_was_replaced_is_thrown_away() {
        /// Replaces the cache while its own gather is under way.
        struct Meddler<'a>(&'a Live);
        impl RadianceProbe for Meddler<'_> {
            fn incoming(
                &self,
                from: &SurfacePoint,
                level: u8,
                deeper: &dyn Deeper,
                bundle: &mut Bundle,
            ) {
                Shell.incoming(from, level, deeper, bundle);
                self.0.replace(self.0.snapshot().cache().clone());
            }
        }
        let live = live();
        live.fill(&Meddler(&live), row(0.0), 1, &Progress::default()).unwrap();
        assert_eq!(live.snapshot().record_count(), 0);
    }
}
