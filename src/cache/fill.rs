//! Filling a level: rounds over a frozen index, so that records do not depend on the number of
//! threads or their timing.

use super::radiance::{Making, Radiance, RadiancePoints, Sources};
use super::record::clamp_to_neighbours;
use super::{Cache, Contents, DirectSamples, Envelope, Index, Level, Outline, Reach, Record};
use crate::error::{Error, Result};
use crate::gather::{Deeper, Density, HemisphereSamples, HitChange, Layout, RadianceProbe};
use crate::geometry::SurfacePoint;
use crate::math::{Vec3, luminance};
use crate::progress::Progress;
use crate::sampling::hash;
use rayon::prelude::*;
use std::sync::Arc;

/// The shading points of one level, in the order in which they are to be visited.
pub struct LevelPoints {
    /// The points.
    pub points: Vec<SurfacePoint>,
    /// Points per round: a number, or 0 for rounds that start small and grow fourfold.
    pub round: usize,
}

impl LevelPoints {
    /// `points` in an order that scatters them, whatever theirs was; it depends on their number and
    /// `seed` alone.
    pub fn scattered(points: Vec<SurfacePoint>, seed: u64) -> Self {
        let mut order: Vec<u32> = (0..points.len() as u32).collect();
        order.sort_by_cached_key(|i| (hash(&[seed, 1, u64::from(*i)]), *i));
        Self { points: order.into_iter().map(|i| points[i as usize]).collect(), round: 0 }
    }
}

/// What the filling of one level did.
#[derive(Clone, Debug, Default)]
pub struct FillStats {
    /// Rays of all gathers, without what the probe traced behind them.
    pub gather_rays: u64,
    /// Questions put to the index.
    pub lookups: u64,
    /// Those that found a record.
    pub hits: u64,
    /// Records made anew away from an edge because they had missed what two neighbours saw.
    pub retaken: u64,
    /// Records gathered again with more rays because they were noisy.
    pub noisy: u64,
    /// Passes of refinement, 0 where none was asked for.
    pub passes: u32,
    /// How often refinement lowered the allowed error of a record.
    pub reductions: u64,
    /// For each point, the number of records that existed when its round ended.
    pub births: Vec<u32>,
}

impl FillStats {
    /// Adds what was done to the level afterwards.
    pub fn add(&mut self, later: &Self) {
        self.gather_rays += later.gather_rays;
        self.lookups += later.lookups;
        self.hits += later.hits;
        self.retaken += later.retaken;
        self.noisy += later.noisy;
        self.passes += later.passes;
        self.reductions += later.reductions;
    }
}

/// Size of the first growing round.
const FIRST_ROUND: usize = 64;
/// Most rounds over all points at the end. Two or three are enough, but for points whose own record
/// does not cover them.
const LAST_ROUNDS: usize = 8;
/// Two candidates of one round conflict within this share of their expected radius.
const CONFLICT: f32 = 0.7;
/// Fewest records that one pass over the candidates may make.
const BATCH: usize = 256;
/// A record whose R_i exceeds this multiple of what two neighbours allow has missed what they saw.
const LEAK: f32 = 4.0;

/// A gather that starts aside and finds its surroundings nearer than this share of the step may lie
/// behind a surface.
const BEHIND: f32 = 0.25;

/// A new record is allowed this multiple of the error that the nearest one is left with, found by
/// experiment [Krivanek06, Sec. 4.2].
const OPTIMISM: f32 = 1.4;
/// A noisy record is gathered again with this multiple of the rays.
const MORE_RAYS: u32 = 4;

/// A record with its radiance, if it has any.
struct Made {
    record: Record,
    radiance: Option<Radiance>,
}

/// One level while it fills.
pub(super) struct Filling<'a> {
    cache: &'a Cache,
    probe: &'a dyn RadianceProbe,
    /// Where gathers find indirect light.
    deeper: &'a dyn Deeper,
    /// What makes the radiance of records, if they have any.
    making: Option<Making<'a>>,
    level: u8,
    seed: u64,
    /// The reach until the level is filled.
    pub reach: Reach,
    /// The reach when the level is filled.
    shading_reach: Reach,
    pub records: Vec<Record>,
    /// Their radiance, if they have any.
    pub radiance: Vec<Radiance>,
    /// Where the last of the records were gathered, as many as were made here, and the order of
    /// the radiance there.
    origins: Vec<(SurfacePoint, u8)>,
    /// The first `indexed` records as they stood when there were that many.
    index: Index,
    indexed: usize,
    /// The records made since.
    fresh: Index,
    envelope: Envelope,
    /// The same of the mean lengths of records that have sectors: how far apart new ones are
    /// expected to lie. The shortest say little of that.
    spread: Option<Envelope>,
    /// Finds the nearest record, if they are not all allowed the same error.
    nearest: Option<Envelope>,
    pub stats: FillStats,
}

impl Cache {
    /// Makes records until every point of `points` on `level` is covered, beside those that the
    /// level has already. Deeper levels must be filled already, if the gathers are to use them.
    ///
    /// The same arguments give the same records on any number of threads.
    ///
    /// # Errors
    /// [`Error::Cancelled`]; the level stays as it was then.
    pub fn fill(
        &mut self,
        probe: &dyn RadianceProbe,
        level: u8,
        points: &LevelPoints,
        seed: u64,
        progress: &Progress,
    ) -> Result<FillStats> {
        let mut filling = Filling::new(self, probe, level, seed, self.known(level));
        filling.run(points, &[], progress)?;
        let Filling { records, stats, .. } = filling;
        self.keep(level, records);
        Ok(stats)
    }

    /// The records of `level` so far.
    fn known(&self, level: u8) -> Vec<Record> {
        self.level(level).map_or_else(Vec::new, |l| l.records().to_vec())
    }

    /// Makes `records`, those of `level` and new ones, its records. Without new ones nothing has
    /// changed, and the index is right.
    fn keep(&mut self, level: u8, records: Vec<Record>) {
        if self.level(level).is_none_or(|l| l.records().len() < records.len()) {
            self.levels[usize::from(level)] = Some(Arc::new(self.finish(level, records)));
        }
    }

    /// What [`Cache::fill`] would make of `level` if `before` were its records; the cache does not
    /// change.
    pub(super) fn filled(
        &self,
        probe: &dyn RadianceProbe,
        level: u8,
        points: &LevelPoints,
        seed: u64,
        before: Vec<Record>,
        progress: &Progress,
    ) -> Result<(Level, FillStats)> {
        let mut filling = Filling::new(self, probe, level, seed, before);
        filling.run(points, &[], progress)?;
        let Filling { records, stats, .. } = filling;
        Ok((self.finish(level, records), stats))
    }

    /// As [`Cache::fill`], with the radiance that `making` makes of each gather; adds that to
    /// `radiance`, by the ids of the records. Light comes from `sources`.
    pub(super) fn fill_radiance(
        &mut self,
        sources: &Sources,
        points: &RadiancePoints,
        making: Making,
        radiance: &mut Vec<Radiance>,
        seed: u64,
        progress: &Progress,
    ) -> Result<FillStats> {
        let level = making.maker.level;
        let made = std::mem::take(radiance);
        let mut filling =
            Filling::new(self, sources.probe, level, hash(&[seed, 3]), self.known(level))
                .with_radiance(sources.deeper, making, made);
        let outcome = filling.run(&points.points, &points.orders, progress);
        let Filling { records, radiance: made, stats, .. } = filling;
        *radiance = made;
        if let Err(error) = outcome {
            radiance.truncate(self.level(level).map_or(0, |l| l.records().len()));
            return Err(error);
        }
        self.keep(level, records);
        Ok(stats)
    }

    /// The finished level of `records`: their index with the reach that shading uses.
    pub(super) fn finish(&self, level: u8, records: Vec<Record>) -> Level {
        let index = self.index(&records, self.shading_reach(level));
        Level { records, index }
    }

    pub(super) fn shading_reach(&self, level: u8) -> Reach {
        Reach::new(&self.scheme, level, self.scene_size, self.scheme.validity.smoothing)
    }

    fn index(&self, records: &[Record], reach: Reach) -> Index {
        Index::build(records, reach, self.scheme.validity.weight, self.scene_size)
    }
}

impl<'a> Filling<'a> {
    fn new(
        cache: &'a Cache,
        probe: &'a dyn RadianceProbe,
        level: u8,
        seed: u64,
        records: Vec<Record>,
    ) -> Self {
        let reach = Reach::new(&cache.scheme, level, cache.scene_size, 1.0);
        let envelope = Envelope::build(records.iter().map(|r| (r.position, r.length_unclamped)));
        Self {
            cache,
            probe,
            deeper: cache,
            making: None,
            level,
            seed: hash(&[seed, u64::from(level)]),
            reach,
            shading_reach: cache.shading_reach(level),
            index: cache.index(&records, reach),
            indexed: records.len(),
            records,
            radiance: Vec::new(),
            origins: Vec::new(),
            fresh: cache.index(&[], reach),
            envelope,
            spread: None,
            nearest: None,
            stats: FillStats::default(),
        }
    }

    /// Goes on with a level of `records` whose allowed errors will differ.
    pub fn resume(
        cache: &'a Cache,
        probe: &'a dyn RadianceProbe,
        level: u8,
        seed: u64,
        records: Vec<Record>,
    ) -> Self {
        let mut filling = Self::new(cache, probe, level, seed, records);
        filling.survey(true);
        filling
    }

    /// Makes radiance records, beside `radiance`, that of the records that there are.
    pub fn with_radiance(
        self,
        deeper: &'a dyn Deeper,
        making: Making<'a>,
        radiance: Vec<Radiance>,
    ) -> Self {
        Self { deeper, making: Some(making), radiance, ..self }
    }

    /// What new records will be told of those that are there.
    fn survey(&mut self, errors_differ: bool) {
        self.envelope =
            Envelope::build(self.records.iter().map(|r| (r.position, r.length_unclamped)));
        self.spread = (self.cache.scheme.radius.area == Outline::Sectors).then(|| {
            Envelope::build(
                self.records
                    .iter()
                    .map(|r| (r.position, self.reach.length_of(self.reach.area(r).0.mean()))),
            )
        });
        self.nearest =
            errors_differ.then(|| Envelope::build(self.records.iter().map(|r| (r.position, 0.0))));
    }

    /// The error that a new record at `x` is allowed.
    fn error_of_new(&self, x: Vec3) -> f32 {
        let most = self.reach.allowed_error();
        let nearest =
            self.nearest.as_ref().and_then(|n| self.records.get(n.lowest_two(x)[0].id as usize));
        nearest.map_or(most, |r| most.min(OPTIMISM * r.error))
    }

    /// Rounds over all points, then over those that clamping has uncovered. `orders` are those of
    /// the points' radiance, if they need any.
    fn run(&mut self, points: &LevelPoints, orders: &[u8], progress: &Progress) -> Result<()> {
        let known = self.records.len();
        let (mut begin, mut round) = (0, if points.round > 0 { points.round } else { FIRST_ROUND });
        while begin < points.points.len() {
            let end = points.points.len().min(begin + round);
            self.round(
                &points.points[begin..end],
                orders.get(begin..end).unwrap_or(&[]),
                progress,
            )?;
            let births = self.records.len() as u32;
            self.stats.births.resize(end, births);
            begin = end;
            if points.round == 0 {
                round *= 4;
            }
        }
        if self.records.len() == known {
            // Nothing new that could be noisy, or clamp others.
            return Ok(());
        }
        self.regather_noisy();
        // Neighbour clamping may have uncovered points of earlier rounds, and the records made for
        // those may uncover more.
        for _ in 0..LAST_ROUNDS {
            let before = self.records.len();
            self.reindex(true);
            self.round(&points.points, orders, progress)?;
            if self.records.len() == before {
                break;
            }
        }
        Ok(())
    }

    /// Covers `points`: again and again the uncovered ones are found, some far enough from each
    /// other are given records, in parallel, until none is left.
    fn round(&mut self, points: &[SurfacePoint], orders: &[u8], progress: &Progress) -> Result<()> {
        let mut pending: Vec<u32> = (0..points.len() as u32).collect();
        loop {
            if progress.is_cancelled() {
                return Err(Error::Cancelled);
            }
            let before = pending.len();
            pending =
                pending.into_par_iter().filter(|&i| !self.covers(&points[i as usize])).collect();
            self.stats.lookups += before as u64;
            self.stats.hits += (before - pending.len()) as u64;
            progress.advance((before - pending.len()) as u64);
            if pending.is_empty() {
                return Ok(());
            }
            let chosen = self.choose(points, &pending);
            self.make_records(points, orders, &chosen);
            self.reindex(false);
            // A point that was given a record is done, whatever the index says of it.
            pending.retain(|i| chosen.binary_search(i).is_err());
            self.stats.hits += chosen.len() as u64;
            progress.advance(chosen.len() as u64);
        }
    }

    fn covers(&self, at: &SurfacePoint) -> bool {
        self.fresh.covers(at) || self.index.covers(at)
    }

    /// Indexes the records as they stand now. The index of all of them is made anew only when a
    /// quarter has been added: between those times new records go to a small index of their
    /// own, and clamped ones keep their former reach in the large one.
    fn reindex(&mut self, complete: bool) {
        if complete || 4 * (self.records.len() - self.indexed) > self.records.len() {
            self.indexed = self.records.len();
            self.index = self.cache.index(&self.records, self.reach);
        }
        self.fresh = self.cache.index(&self.records[self.indexed..], self.reach);
    }

    /// A maximal set of candidates none of which is likely to be covered by the record of another,
    /// in ascending order: earlier points go first.
    pub fn choose(&self, points: &[SurfacePoint], pending: &[u32]) -> Vec<u32> {
        let most = BATCH.max(self.records.len() / 2);
        let mut chosen = Vec::new();
        let mut discs: Vec<(Vec3, Vec3, f32)> = Vec::new();
        for &i in pending {
            let p = &points[i as usize];
            // R can be no longer than the envelope of its neighbours, so this radius is an upper
            // bound where neighbours exist.
            let length = self.spread.as_ref().unwrap_or(&self.envelope).value(p.position);
            let (radius, _) = self.reach.radius(length, p.footprint);
            let radius = radius * self.error_of_new(p.position) / self.reach.allowed_error();
            let free = discs.iter().all(|&(x, n, r)| {
                let limit = CONFLICT * r.min(radius);
                (x - p.position).length_squared() >= limit * limit || n.dot(p.frame.n) < 0.7
            });
            if free {
                discs.push((p.position, p.frame.n, radius));
                chosen.push(i);
                if chosen.len() == most {
                    break;
                }
            }
        }
        chosen
    }

    /// Makes a record at each point of `chosen`, in its order, and clamps the lengths of all
    /// records to each other. `orders` are those of the radiance at the points, if
    /// there is any.
    pub fn make_records(&mut self, points: &[SurfacePoint], orders: &[u8], chosen: &[u32]) {
        let order = |i: u32| orders.get(i as usize).copied().unwrap_or(0);
        let made: Vec<(Made, SurfacePoint, bool)> = chosen
            .par_iter()
            .map_init(
                || self.samples(),
                |samples, &i| self.record(samples, &points[i as usize], order(i)),
            )
            .collect();
        let rays = self.cache.scheme.layout(self.level).rays() as u64;
        let errors: Vec<f32> =
            made.iter().map(|(made, ..)| self.error_of_new(made.record.position)).collect();
        for (((made, at, retaken), error), &i) in made.into_iter().zip(errors).zip(chosen) {
            self.stats.gather_rays += rays * (1 + u64::from(retaken));
            self.stats.retaken += u64::from(retaken);
            self.records.push(Record { error, ..made.record });
            self.radiance.extend(made.radiance);
            self.origins.push((at, order(i)));
        }
        self.settle();
    }

    /// Tells all records of each other, after some were made.
    fn settle(&mut self) {
        self.survey(self.nearest.is_some());
        if self.cache.scheme.clamping.neighbours() {
            clamp_to_neighbours(&mut self.records, &self.envelope);
        }
    }

    /// Gathers again, with more rays, where the records of the first level are noisy. Deeper ones
    /// are averaged by the gathers that read them.
    ///
    /// A record is judged together with those around it. By its own samples alone it would be kept
    /// where they happened to miss a small bright light, which makes them look clean, and
    /// thrown away where they happened to find it: the picture would become darker.
    fn regather_noisy(&mut self) {
        let scheme = &self.cache.scheme;
        if self.level > 0 || scheme.gather.noise <= 0.0 {
            return;
        }
        let index = self.cache.index(&self.records, self.shading_reach);
        let first = self.records.len() - self.origins.len();
        let noisy = |at: &SurfacePoint| {
            let [mut variance, mut square] = [0.0; 2];
            index.near(at, |id| {
                let record = &self.records[id as usize];
                variance += record.sigma * record.sigma;
                square += luminance(record.irradiance).powi(2);
            });
            variance > scheme.gather.noise * scheme.gather.noise * square
        };
        let layout = scheme.layout(self.level);
        let layout = layout.with_rays(MORE_RAYS * layout.rays() as u32);
        let again: Vec<(usize, Made)> = self
            .origins
            .par_iter()
            .enumerate()
            .filter(|(_, (at, _))| noisy(at))
            .map_init(
                || self.empty_gather(layout),
                |samples, (k, (at, order))| {
                    samples.gather(
                        self.probe,
                        at,
                        self.level,
                        self.deeper,
                        hash(&[self.seed_at(at), 1]),
                    );
                    (first + k, self.made(samples, at, *order))
                },
            )
            .collect();
        self.stats.noisy += again.len() as u64;
        self.stats.gather_rays += (again.len() * layout.rays()) as u64;
        for (id, Made { record, radiance }) in again {
            let before = &self.records[id];
            self.records[id] = Record { error: before.error, position: before.position, ..record };
            if let Some(radiance) = radiance {
                self.radiance[id] = radiance;
            }
        }
        self.settle();
    }

    fn samples(&self) -> HemisphereSamples {
        self.empty_gather(self.cache.scheme.layout(self.level))
    }

    /// An empty gather of this layout.
    fn empty_gather(&self, layout: Layout) -> HemisphereSamples {
        let scheme = &self.cache.scheme;
        let paths = if self.level == 0 { scheme.extrapolation.light_paths() } else { 0 };
        let (change, density) = match self.making {
            Some(_) => (scheme.glossy().hits.change(), scheme.glossy().density()),
            None => (HitChange::None, Density::Cosine),
        };
        HemisphereSamples::new(layout, density).with_light_paths(paths).with_change(change)
    }

    /// The record of a gather at `at`, where it was made, and whether it had to be taken again
    /// there.
    fn record(
        &self,
        samples: &mut HemisphereSamples,
        at: &SurfacePoint,
        order: u8,
    ) -> (Made, SurfacePoint, bool) {
        let made = self.gather(samples, at, order);
        if !self.cache.scheme.clamping.neighbours() {
            return (made, *at, false);
        }
        let record = &made.record;
        // Rays that slip through a crack beside the point see too far. Two neighbours that see much
        // nearer things give it away; the gather is repeated a little towards them, inside
        // the surface that they share [Krivanek06, Sec. 5.2].
        let neighbours = self.envelope.lowest_two(at.position);
        if record.length_unclamped <= LEAK * neighbours[1].value {
            return (made, *at, false);
        }
        let [a, b] = neighbours.map(|n| self.records[n.id as usize].position);
        let towards = 0.5 * (a + b) - at.position;
        let tangential = towards - at.ng * at.ng.dot(towards);
        let step = (0.5 * at.footprint).min(0.1 * record.length_unclamped).min(tangential.length());
        let moved =
            SurfacePoint { position: at.position + tangential.normalize_or_zero() * step, ..*at };
        let mut again = self.gather(samples, &moved, order);
        // In a hollow of facets the step may lead behind the next one: then all is near, and unlike
        // what the neighbours see. What is near beside a crack is like it.
        let brightness = |r: &Record| luminance(r.irradiance).max(f32::MIN_POSITIVE).ln();
        let usual = 0.5
            * neighbours.map(|n| brightness(&self.records[n.id as usize])).into_iter().sum::<f32>();
        let unlike = |m: &Made| (brightness(&m.record) - usual).abs();
        if again.record.length_unclamped <= BEHIND * step && unlike(&again) > unlike(&made) {
            return (made, *at, false);
        }
        // Its rays start aside [Tabellion04, Sec. 3.1], but the record stays at the point:
        // refinement may leave it an area that is smaller than the step, and the point would have
        // no record.
        again.record.position = at.position;
        (again, moved, true)
    }

    fn gather(&self, samples: &mut HemisphereSamples, at: &SurfacePoint, order: u8) -> Made {
        samples.gather(self.probe, at, self.level, self.deeper, self.seed_at(at));
        self.made(samples, at, order)
    }

    fn seed_at(&self, at: &SurfacePoint) -> u64 {
        let p = at.position.to_array().map(|x| u64::from((x + 0.0).to_bits()));
        hash(&[self.seed, p[0], p[1], p[2]])
    }

    /// What the finished gather `samples` at `at` makes.
    fn made(&self, samples: &HemisphereSamples, at: &SurfacePoint, order: u8) -> Made {
        let scheme = &self.cache.scheme;
        let lit = self.level == 0 && scheme.contents == Contents::DirectAndIndirect;
        let direct =
            if lit { DirectSamples::new(self.probe, at, samples, self.seed_at(at)) } else { None };
        let mut record = Record::new(scheme, &self.shading_reach, at, samples, direct.as_ref());
        let radiance = self.making.map(|m| m.make(samples, at, order, &mut record, &self.reach));
        Made { record, radiance }
    }
}
