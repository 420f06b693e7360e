//! Filling a level: rounds over a frozen index, so that records do not depend on the number of
//! threads or their timing.

use super::gatherer::{Gathered, Gatherer};
use super::points::{FillStats, LevelPoints};
use crate::cache::payload::Payload;
use crate::cache::record::{Envelope, Record, clamp_to_neighbours};
use crate::cache::scheme::Outline;
use crate::cache::store::Index;
use crate::error::{Error, Result, check_room};
use crate::geometry::SurfacePoint;
use crate::math::{Vec3, luminance};
use crate::progress::Progress;
use crate::sampling::{hash, stream};
use rayon::prelude::*;

/// Size of the first growing round.
const FIRST_ROUND: usize = 64;
/// Most rounds over all points at the end. Two or three are enough, but for points whose own record
/// does not cover them.
const LAST_ROUNDS: usize = 8;
/// Two candidates of one round conflict within this share of their expected radius.
const CONFLICT: f32 = 0.7;
/// Fewest records that one pass over the candidates may make.
const BATCH: usize = 256;
/// A new record is allowed this multiple of the error that the nearest one is left with, found by
/// experiment [Krivanek06, Sec. 4.2].
const OPTIMISM: f32 = 1.4;
/// A noisy record is gathered again with this multiple of the rays.
const MORE_RAYS: u32 = 4;
/// An index is made of lists that are as large as itself, while the one before still stands.
const INDEXES: usize = 3;
/// Bytes that stay free for what does not grow with the number of records.
const SMALL: usize = 1 << 26;

/// The records of one kind on one level while it fills.
pub(super) struct Filling<'a, P: Payload> {
    pub gatherer: Gatherer<'a, P>,
    pub records: Vec<Record<P>>,
    /// Where the last of the records were gathered, as many as were made here, and the order that
    /// was asked for there.
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

impl<'a, P: Payload> Filling<'a, P> {
    /// Goes on from `records`.
    pub fn new(gatherer: Gatherer<'a, P>, records: Vec<Record<P>>) -> Self {
        Self {
            envelope: Envelope::build(records.iter().map(|r| (r.position, r.length_unclamped))),
            index: gatherer.rules.index(&records, gatherer.rule),
            indexed: records.len(),
            records,
            origins: Vec::new(),
            fresh: gatherer.rules.index::<P>(&[], gatherer.rule),
            spread: None,
            nearest: None,
            stats: FillStats::default(),
            gatherer,
        }
    }

    /// Goes on from `records` whose allowed errors will differ.
    pub fn resume(gatherer: Gatherer<'a, P>, records: Vec<Record<P>>) -> Self {
        let mut filling = Self::new(gatherer, records);
        filling.survey(true);
        filling
    }

    /// What new records will be told of those that are there.
    fn survey(&mut self, errors_differ: bool) {
        let (records, rule) = (&self.records, &self.gatherer.rule);
        self.envelope = Envelope::build(records.iter().map(|r| (r.position, r.length_unclamped)));
        self.spread = (self.gatherer.rules.scheme.radius.area == Outline::Sectors).then(|| {
            let mean = |r: &Record<P>| (r.position, rule.length_of(rule.area(r).0.mean()));
            Envelope::build(records.iter().map(mean))
        });
        self.nearest =
            errors_differ.then(|| Envelope::build(records.iter().map(|r| (r.position, 0.0))));
    }

    /// The error that a new record at `x` is allowed.
    fn error_of_new(&self, x: Vec3) -> f32 {
        let most = self.gatherer.rule.allowed_error();
        let nearest = self.nearest.as_ref();
        let nearest = nearest.and_then(|n| self.records.get(n.lowest_two(x)[0].id as usize));
        nearest.map_or(most, |r| most.min(OPTIMISM * r.error))
    }

    /// Rounds over all points, then over those that clamping has uncovered.
    pub fn run(&mut self, level: &LevelPoints, progress: &Progress) -> Result<()> {
        let (points, orders) = (&level.points, &level.orders);
        let known = self.records.len();
        let (mut begin, mut round) = (0, if level.round > 0 { level.round } else { FIRST_ROUND });
        while begin < points.len() {
            let end = points.len().min(begin + round);
            self.round(&points[begin..end], orders.get(begin..end).unwrap_or(&[]), progress)?;
            let births = self.records.len() as u32;
            self.stats.births.resize(end, births);
            begin = end;
            if level.round == 0 {
                round *= 4;
            }
        }
        if self.records.len() == known {
            // Nothing new that could be noisy, or clamp others.
            return Ok(());
        }
        self.regather_noisy(progress);
        // Neighbour clamping may have uncovered points of earlier rounds, and the records made for
        // those may uncover more.
        for _ in 0..LAST_ROUNDS {
            let before = self.records.len();
            self.reindex(true);
            self.round(points, orders, progress)?;
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
            self.make_records(points, orders, &chosen, progress)?;
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
    /// quarter has been added: between those times new records go to a small index of their own,
    /// and clamped ones keep their former radii in the large one.
    fn reindex(&mut self, complete: bool) {
        let (rules, rule) = (self.gatherer.rules, self.gatherer.rule);
        if complete || 4 * (self.records.len() - self.indexed) > self.records.len() {
            self.indexed = self.records.len();
            self.index = rules.index(&self.records, rule);
        }
        self.fresh = rules.index(&self.records[self.indexed..], rule);
    }

    /// A maximal set of candidates none of which is likely to be covered by the record of another,
    /// in ascending order: earlier points go first.
    pub fn choose(&self, points: &[SurfacePoint], pending: &[u32]) -> Vec<u32> {
        let rule = &self.gatherer.rule;
        let most = BATCH.max(self.records.len() / 2);
        let mut chosen = Vec::new();
        let mut discs: Vec<(Vec3, Vec3, f32)> = Vec::new();
        for &i in pending {
            let p = &points[i as usize];
            // R can be no longer than the envelope of its neighbours, so this radius is an upper
            // bound where neighbours exist.
            let length = self.spread.as_ref().unwrap_or(&self.envelope).value(p.position);
            let (radius, _) = rule.radius(length, p.footprint);
            let radius = radius * self.error_of_new(p.position) / rule.allowed_error();
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
    /// records to each other. `orders` are those that the points ask for, if they ask for any. Once
    /// the work is cancelled, the points that have none yet get none.
    ///
    /// # Errors
    /// [`Error::OutOfMemory`], before any record is made.
    pub fn make_records(
        &mut self, points: &[SurfacePoint], orders: &[u8], chosen: &[u32], progress: &Progress,
    ) -> Result<()> {
        self.reserve(chosen.len())?;
        let order = |i: u32| orders.get(i as usize).copied().unwrap_or(0);
        let others = (&self.records[..], &self.envelope);
        let make = |samples: &mut _, &i: &u32| {
            let wanted = !progress.is_cancelled();
            let record = || self.gatherer.record(samples, &points[i as usize], order(i), others);
            wanted.then(record).map(|made| (i, made))
        };
        let made: Vec<(u32, Gathered<P>)> =
            chosen.par_iter().map_init(|| self.gatherer.samples(), make).flatten().collect();
        let rays = self.gatherer.rules.scheme.layout(self.gatherer.level).rays() as u64;
        let errors: Vec<f32> =
            made.iter().map(|(_, made)| self.error_of_new(made.record.position)).collect();
        for ((i, made), error) in made.into_iter().zip(errors) {
            self.stats.gather_rays += rays * (1 + u64::from(made.retaken));
            self.stats.retaken += u64::from(made.retaken);
            self.records.push(Record { error, ..made.record });
            self.origins.push((made.origin, order(i)));
        }
        self.settle();
        Ok(())
    }

    /// Makes sure that there is memory for `more` records and for what finds them.
    fn reserve(&mut self, more: usize) -> Result<()> {
        let count = self.records.len() + more;
        let mean = |bytes: usize| bytes.div_ceil(self.records.len().max(1));
        let held = mean(self.records.iter().map(|r| r.payload.heap_bytes()).sum());
        let held = held.max(self.gatherer.kept_bytes());
        let indexed = mean(self.index.bytes() + self.fresh.bytes());
        // Each new one twice, for those of a round wait in a list of their own.
        let made = size_of::<Gathered<P>>() + size_of::<(SurfacePoint, u8)>() + held;
        let bytes = 2 * more * made + INDEXES * count * indexed + SMALL;
        let what = format!("{count} records of level {}", self.gatherer.level);
        check_room(&what, bytes as u64)?;
        let full = |_| Error::memory(&what, bytes as u64);
        self.records.try_reserve(more).map_err(full)?;
        self.origins.try_reserve(more).map_err(full)
    }

    /// Tells all records of each other, after some were made.
    fn settle(&mut self) {
        self.survey(self.nearest.is_some());
        if self.gatherer.rules.scheme.clamping.neighbours() {
            clamp_to_neighbours(&mut self.records, &self.envelope);
        }
    }

    /// Gathers again, with more rays, where the records of the first level are noisy. Deeper ones
    /// are averaged by the gathers that read them.
    ///
    /// A record is judged together with those around it. By its own samples alone it would be kept
    /// where they happened to miss a small bright light, which makes them look clean, and thrown
    /// away where they happened to find it: the picture would become darker.
    fn regather_noisy(&mut self, progress: &Progress) {
        let gatherer = &self.gatherer;
        let scheme = gatherer.rules.scheme;
        if gatherer.level > 0 || scheme.gather.noise <= 0.0 {
            return;
        }
        let index = gatherer.rules.index(&self.records, gatherer.final_rule);
        let first = self.records.len() - self.origins.len();
        let noisy = |at: &SurfacePoint| {
            let [mut variance, mut square] = [0.0; 2];
            index.near(at, |id| {
                let record = &self.records[id as usize];
                variance += record.sigma * record.sigma;
                square += luminance(record.payload.irradiance().irradiance).powi(2);
            });
            variance > scheme.gather.noise * scheme.gather.noise * square
        };
        let layout = scheme.layout(gatherer.level);
        let layout = layout.with_rays(MORE_RAYS * layout.rays() as u32);
        let again: Vec<(usize, Record<P>)> = self
            .origins
            .par_iter()
            .enumerate()
            .filter(|(_, (at, _))| !progress.is_cancelled() && noisy(at))
            .map_init(
                || gatherer.empty_gather(layout),
                |samples, (k, (at, order))| {
                    let seed = hash(&[gatherer.seed_at(at), stream::RETAKE]);
                    samples.gather(gatherer.probe, at, gatherer.level, &gatherer.deeper, seed);
                    (first + k, gatherer.estimate(samples, at, *order))
                },
            )
            .collect();
        self.stats.noisy += again.len() as u64;
        self.stats.gather_rays += (again.len() * layout.rays()) as u64;
        for (id, record) in again {
            let Record { error, position, .. } = self.records[id];
            self.records[id] = Record { error, position, ..record };
        }
        self.settle();
    }
}
