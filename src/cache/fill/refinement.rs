//! Adaptive caching: where records visibly disagree, they are made smaller and others are put
//! between them, until nothing changes any more [Krivanek06, Sec. 4].
//!
//! The published algorithm takes one shading point after the other from a queue. Here a pass
//! handles all points of the queue, a fraction of them at a time: every point of the fraction looks
//! at the same records and proposes lower errors, and the lowest proposal for each record holds. So
//! nothing depends on threads. The fractions are spread over the image; were all points heard at
//! once, both records of a pair that disagree would shrink, each at the wish of points near the
//! other.

use super::gatherer::Gatherer;
use super::locate::Locator;
use super::points::{Appearances, FillStats, LevelPoints};
use super::rounds::Filling;
use super::weber::{Candidate, Proposal, Weber};
use crate::cache::payload::{Payload, Seen};
use crate::cache::record::{RadiusRule, Record};
use crate::cache::store::Store;
use crate::error::{Error, Result, check_room};
use crate::gather::LobeCoefficients;
use crate::progress::Progress;
use rayon::prelude::*;
use std::ops::Range;

/// A record's share in the light of one shading point.
#[derive(Clone, Copy)]
struct Contribution {
    record: u32,
    /// The record's change counter when the error was worked out.
    changes: u32,
    /// See [`Record::error_at`].
    error: f32,
    /// Luminance of the radiance that leaves the point if this record alone is asked, and its
    /// standard error.
    luminance: f32,
    sigma: f32,
}

/// Fractions of the queue that decide one after the other.
const FRACTIONS: usize = 16;
/// Records whose contributions are looked for at once.
const ATTACHED: usize = 1024;

/// The points and what they look like.
struct View<'a, P: Payload> {
    points: &'a LevelPoints,
    appearances: &'a Appearances<'a>,
    context: P::Context<'a>,
    rule: RadiusRule,
    in_front: f32,
}

/// One level while it is refined.
struct Convergence<'a, P: Payload> {
    filling: Filling<'a, P>,
    view: View<'a, P>,
    weber: Weber,
    locator: Locator,
    /// The contributions to each point. Entries whose change counter is not the record's are out
    /// of date.
    lists: Vec<Vec<Contribution>>,
    /// For each record how often its area has become smaller.
    changes: Vec<u32>,
    /// The points that were given a record, so that they get no second one.
    given: Vec<bool>,
}

/// What records become, and what was done: see [`Cache::refine`](crate::cache::Cache::refine). The
/// latter is [`Error::Cancelled`] where the former are only the records so far.
///
/// # Errors
/// [`Error::InvalidArgument`] if points and appearances are not of one length,
/// [`Error::OutOfMemory`].
pub(super) fn refine<'a, P: Payload>(
    gatherer: Gatherer<'a, P>, records: Vec<Record<P>>, points: &'a LevelPoints,
    appearances: &'a Appearances<'a>, progress: &Progress,
) -> Result<(Store<P>, Result<FillStats>)> {
    if points.points.len() != appearances.of_points.len() {
        let (p, a) = (points.points.len(), appearances.of_points.len());
        let what = format!("{p} shading points cannot have {a} appearances");
        return Err(Error::InvalidArgument(what));
    }
    let each = size_of::<Vec<Contribution>>() + 2 * size_of::<u32>() + size_of::<[bool; 3]>();
    let count = points.points.len();
    check_room(format_args!("{count} points that are refined"), (count * each) as u64)?;
    let filling = Filling::resume(gatherer, records);
    let mut convergence = Convergence::new(filling, points, appearances)?;
    let end = convergence.run(progress);
    if let Err(error @ Error::OutOfMemory(_)) = end {
        return Err(error);
    }
    let Filling { records, stats, .. } = convergence.filling;
    Ok((gatherer.rules.store(gatherer.level, records), end.map(|()| stats)))
}

impl<'a, P: Payload> Convergence<'a, P> {
    fn new(
        filling: Filling<'a, P>, points: &'a LevelPoints, appearances: &'a Appearances<'a>,
    ) -> Result<Self> {
        let gatherer = &filling.gatherer;
        let (count, rules) = (points.points.len(), gatherer.rules);
        let (context, rule, in_front) = (gatherer.context, gatherer.rule, rules.in_front());
        let mut convergence = Self {
            view: View { points, appearances, context, rule, in_front },
            weber: Weber::new(rules.scheme),
            locator: Locator::build(&points.points),
            lists: vec![Vec::new(); count],
            changes: vec![0; filling.records.len()],
            given: vec![false; count],
            filling,
        };
        convergence.attach(0, &mut PointSet::new(count))?;
        Ok(convergence)
    }

    /// Pass after pass, until one changes nothing.
    fn run(&mut self, progress: &Progress) -> Result<()> {
        let count = self.lists.len();
        let mut queue: Vec<u32> = (0..count as u32).collect();
        let mut stale = PointSet::new(count);
        queue.iter().filter(|&&p| self.lists[p as usize].is_empty()).for_each(|&p| stale.insert(p));
        while !queue.is_empty() {
            if progress.is_cancelled() {
                return Err(Error::Cancelled);
            }
            self.filling.stats.passes += 1;
            self.refine(&queue, &mut stale);
            queue = self.cover(&mut stale, progress)?;
            queue.retain(|&p| self.lists[p as usize].len() > 1);
        }
        Ok(())
    }

    /// Lets the points of `queue` lower the errors of records; the points in areas that shrank by
    /// it become stale.
    fn refine(&mut self, queue: &[u32], stale: &mut PointSet) {
        let rule = self.view.rule;
        let mut shrunk: Vec<(u32, f32)> = Vec::new();
        for fraction in 0..FRACTIONS {
            let points: Vec<u32> =
                queue.iter().skip(fraction).step_by(FRACTIONS).copied().collect();
            let proposals: Vec<Proposal> = points
                .par_iter()
                .map_init(Vec::new, |scratch, &p| self.propose(p as usize, scratch))
                .flatten_iter()
                .collect();
            for (id, share) in proposals {
                let record = &mut self.filling.records[id as usize];
                let error = share * rule.allowed_error();
                if error < record.error {
                    shrunk.push((id, area(&rule, record)));
                    record.error = error;
                    self.changes[id as usize] += 1;
                    self.filling.stats.reductions += 1;
                }
            }
        }
        // Of each record the largest area, the one it had when the pass began.
        shrunk.sort_by(|a, b| a.0.cmp(&b.0).then(b.1.total_cmp(&a.1)));
        shrunk.dedup_by_key(|s| s.0);
        for (id, radius) in shrunk {
            self.locator
                .within(self.filling.records[id as usize].position, radius, |p| stale.insert(p));
        }
    }

    /// Brings the lists of the stale points up to date and makes records where they are empty.
    /// Returns the points that this and the clamping of neighbours touched and those
    /// that were stale, in ascending order.
    fn cover(&mut self, stale: &mut PointSet, progress: &Progress) -> Result<Vec<u32>> {
        let mut touched = PointSet::new(self.lists.len());
        let mut pending: Vec<u32> = Vec::new();
        loop {
            self.update(stale);
            let new = stale.drain();
            new.iter().for_each(|&p| touched.insert(p));
            pending.extend(new);
            pending.retain(|&p| self.lists[p as usize].is_empty() && !self.given[p as usize]);
            pending.sort_unstable();
            pending.dedup();
            if pending.is_empty() {
                return Ok(touched.drain());
            }
            if progress.is_cancelled() {
                return Err(Error::Cancelled);
            }
            let lengths: Vec<f32> = self.filling.records.iter().map(|r| r.length).collect();
            let chosen = self.filling.choose(&self.view.points.points, &pending);
            let LevelPoints { points, orders, .. } = self.view.points;
            self.filling.make_records(points, orders, &chosen, progress)?;
            chosen.iter().for_each(|&p| self.given[p as usize] = true);
            self.changes.resize(self.filling.records.len(), 0);
            for (id, &length) in lengths.iter().enumerate() {
                let record = &self.filling.records[id];
                if record.length < length {
                    self.changes[id] += 1;
                    let radius = area(&self.view.rule, &Record { length, ..record.clone() });
                    self.locator.within(record.position, radius, |p| stale.insert(p));
                }
            }
            self.attach(lengths.len(), stale)?;
        }
    }

    /// Adds the contributions of the records from number `first` on to the points in their areas,
    /// which become stale.
    fn attach(&mut self, first: usize, stale: &mut PointSet) -> Result<()> {
        let count = self.filling.records.len();
        (first..count)
            .step_by(ATTACHED)
            .try_for_each(|begin| self.attach_some(begin..count.min(begin + ATTACHED), stale))
    }

    /// The same for the records with these numbers.
    fn attach_some(&mut self, which: Range<usize>, stale: &mut PointSet) -> Result<()> {
        let (records, view) = (&self.filling.records, &self.view);
        let found: Vec<Vec<(u32, Contribution)>> = which
            .into_par_iter()
            .map_init(LobeCoefficients::default, |scratch, id| {
                let (record, changes, mut found) = (&records[id], self.changes[id], Vec::new());
                self.locator.within(record.position, area(&view.rule, record), |p| {
                    let contribution =
                        view.contribution(p as usize, id as u32, record, changes, scratch);
                    found.extend(contribution.map(|c| (p, c)));
                });
                found
            })
            .collect();
        let full = |_| Error::OutOfMemory("refinement: the memory is full".to_owned());
        for (p, contribution) in found.into_iter().flatten() {
            let list = &mut self.lists[p as usize];
            list.try_reserve(1).map_err(full)?;
            list.push(contribution);
            stale.insert(p);
        }
        Ok(())
    }

    /// Brings the lists of `points` up to date.
    fn update(&mut self, points: &PointSet) {
        let (view, records, changes) = (&self.view, &self.filling.records, &self.changes);
        self.lists
            .par_iter_mut()
            .zip(&points.marked)
            .enumerate()
            .filter(|(_, (_, marked))| **marked)
            .for_each(|(p, (list, _))| {
                list.retain_mut(|c| match view.current(p, c, records, changes) {
                    Some(now) => {
                        *c = now;
                        true
                    }
                    None => false,
                });
            });
    }

    /// What point `p` demands, so that no record's area has a visible edge at it.
    fn propose(&self, p: usize, scratch: &mut Vec<Candidate>) -> Vec<Proposal> {
        if self.lists[p].len() < 2 {
            return Vec::new();
        }
        let (rule, direct) = (&self.view.rule, self.view.appearances.of_points[p].direct);
        scratch.clear();
        for c in self.lists[p]
            .iter()
            .filter_map(|c| self.view.current(p, c, &self.filling.records, &self.changes))
        {
            let record = &self.filling.records[c.record as usize];
            let (share, floor) = (rule.share(record), rule.floor(record) / rule.allowed_error());
            scratch.push(Candidate {
                record: c.record,
                error: c.error,
                luminance: c.luminance,
                sigma: c.sigma,
                share,
                floor,
                weight: self.weber.weight(c.error, share),
            });
        }
        self.weber.proposals(scratch, direct)
    }
}

/// The radius of validity of `record`.
fn area<P>(rule: &RadiusRule, record: &Record<P>) -> f32 {
    rule.share(record) * rule.radius(record.length, record.footprint).0
}

impl<P: Payload> View<'_, P> {
    /// The error of `record` at point `p`, if it is valid there.
    fn error(&self, p: usize, record: &Record<P>) -> Option<f32> {
        let error = self.rule.error_of(record, &self.points.points[p], self.in_front);
        error.filter(|e| *e < self.rule.share(record))
    }

    /// What a record contributes to point `p`, if it is valid there.
    fn contribution(
        &self, p: usize, id: u32, record: &Record<P>, changes: u32, scratch: &mut LobeCoefficients,
    ) -> Option<Contribution> {
        let error = self.error(p, record)?;
        let appearance = &self.appearances.of_points[p];
        let lobes = self.appearances.lobes.as_deref();
        let seen = Seen { number: p, at: &self.points.points[p], appearance, lobes };
        let (luminance, sigma) = P::luminance(self.context, record, &seen, &self.rule, scratch)?;
        Some(Contribution { record: id, changes, error, luminance, sigma })
    }

    /// The contribution `c` to point `p` as the records are now.
    fn current(
        &self, p: usize, c: &Contribution, records: &[Record<P>], changes: &[u32],
    ) -> Option<Contribution> {
        let now = changes[c.record as usize];
        if now == c.changes {
            return Some(*c);
        }
        let record = &records[c.record as usize];
        if P::HOLDS_RADIANCE {
            return Some(Contribution { changes: now, error: self.error(p, record)?, ..*c });
        }
        self.contribution(p, c.record, record, now, &mut LobeCoefficients::default())
    }
}

/// A set of points.
struct PointSet {
    marked: Vec<bool>,
    members: Vec<u32>,
}

impl PointSet {
    fn new(count: usize) -> Self {
        Self { marked: vec![false; count], members: Vec::new() }
    }

    fn insert(&mut self, p: u32) {
        if !std::mem::replace(&mut self.marked[p as usize], true) {
            self.members.push(p);
        }
    }

    /// Empties the set; its members in ascending order.
    fn drain(&mut self) -> Vec<u32> {
        let mut members = std::mem::take(&mut self.members);
        members.iter().for_each(|&p| self.marked[p as usize] = false);
        members.par_sort_unstable();
        members
    }
}
