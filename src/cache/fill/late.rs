//! Late records: made while other threads read the cache.

use super::gatherer::Gatherer;
use super::points::{FillStats, extent_of};
use super::rounds::Filling;
use crate::cache::payload::Irradiance;
use crate::cache::store::Live;
use crate::error::{Error, Result, check_room};
use crate::gather::RadianceProbe;
use crate::geometry::SurfacePoint;
use crate::progress::Progress;
use rayon::prelude::*;

/// A batch with all late records takes so many times their memory while it is made.
const JOINED: u64 = 4;

impl Live {
    /// Makes late records until every point of `points` is covered. Any number of threads may do so
    /// at once; no lock is held while `probe` is asked. Two threads that miss at the same place
    /// at the same time may both make a record there.
    ///
    /// # Errors
    /// [`Error::Cancelled`], [`Error::OutOfMemory`], and [`Error::InvalidArgument`] when the cache
    /// is frozen; nothing is added then.
    pub fn fill(
        &self, probe: &dyn RadianceProbe, mut points: Vec<SurfacePoint>, seed: u64,
        progress: &Progress,
    ) -> Result<FillStats> {
        if self.read(|s| s.cache().extent()) == 0.0 && !points.is_empty() {
            self.settle(extent_of(&points));
        }
        let base = self.snapshot();
        if base.is_frozen() {
            let what = "the cache is frozen: it takes no more records";
            return Err(Error::InvalidArgument(what.into()));
        }
        let cache = base.cache();
        if cache.level_count() == 0 {
            return Ok(FillStats::default());
        }
        points = points.into_par_iter().filter(|p| !base.covers(p)).collect();
        if points.is_empty() {
            return Ok(FillStats::default());
        }
        let rules = cache.rules();
        let gatherer = Gatherer::<Irradiance>::new(rules, probe, cache.behind(1), (), 0, seed);
        let mut filling = Filling::new(gatherer, Vec::new());
        filling.run(&points.into(), progress)?;
        // Batches are joined by copying them.
        check_room("late records", JOINED * base.late_bytes() as u64)?;
        self.add(&base, rules.store(0, filling.records));
        Ok(filling.stats)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cache::Cache;
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
        (scheme.gather.rays, scheme.levels) = (16, 1);
        Live::new(Cache::new(scheme, u32::MAX).with_extent(2.0))
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
        assert!(now.late_batches() <= 8, "{} batches", now.late_batches());
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
        assert_eq!((frozen.record_count(), frozen.late_batches()), (count, 0));
        assert!(live.fill(&Shell, row(0.5), 1, &Progress::default()).is_err());
        let close = |p: &SurfacePoint| {
            (now.lookup(p).unwrap().irradiance - frozen.lookup(p).unwrap().irradiance).length()
                < 1e-4
        };
        assert!(row(0.0).iter().all(close), "one index answers differently from several");
    }

    #[test]
    fn threads_fill_while_others_read() {
        // An interpreter takes a thousand times as long.
        let (fills, reads) = if cfg!(miri) { (2, 3) } else { (20, 500) };
        let live = live();
        std::thread::scope(|s| {
            for t in 0..4 {
                let live = &live;
                s.spawn(move || {
                    for k in 0..fills {
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
                    for _ in 0..reads {
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
                &self, from: &SurfacePoint, level: u8, deeper: &dyn Deeper, bundle: &mut Bundle,
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
