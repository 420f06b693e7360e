//! Adaptive caching: where records visibly disagree, they are made smaller and others are put
//! between them, until nothing changes any more [Krivanek06, Sec. 4].
//!
//! The published algorithm takes one shading point after the other from a queue. Here a pass
//! handles all points of the queue, a fraction of them at a time: every point of the fraction looks
//! at the same records and proposes lower errors, and the lowest proposal for each record holds. So
//! nothing depends on threads. The fractions are spread over the image; were all points heard at
//! once, both records of a pair that disagree would shrink, each at the wish of points near the
//! other.

use super::fill::{FillStats, Filling};
use super::locate::Locator;
use super::outgoing::Outgoing;
use super::radiance::{GlossyView, LobeCoefficients, Making, Radiance, RadiancePoints, Sources};
use super::scheme::{RefinementRule, Weight};
use super::{Cache, Reach, Record};
use crate::error::{Error, Result};
use crate::gather::RadianceProbe;
use crate::geometry::SurfacePoint;
use crate::math::Color;
use crate::progress::Progress;
use crate::sampling::hash;
use rayon::prelude::*;
use std::sync::Arc;

/// What decides how visible the indirect light is at a shading point.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Appearance {
    /// Radiance towards the viewer per irradiance of indirect light, by the diffuse lobe: ρ/π.
    pub reflectance: Color,
    /// Luminance of all other light that leaves the point towards the viewer, as far as it is
    /// known.
    pub direct: f32,
}

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

/// A record as one point sees it while the point decides.
#[derive(Clone, Copy)]
struct Candidate {
    record: u32,
    error: f32,
    luminance: f32,
    /// Standard error of `luminance`.
    sigma: f32,
    /// a_i as a share of the level's allowed error, and the smallest share it may have.
    share: f32,
    floor: f32,
    weight: f32,
}

/// A record's new share of the level's allowed error.
type Proposal = (u32, f32);

/// Fractions of the queue that decide one after the other.
const FRACTIONS: usize = 16;
/// ε of [Krivanek06, Sec. 4.1], relative to a_i.
const EPSILON: f32 = 1e-4;

/// The points and what they look like.
#[derive(Clone, Copy)]
struct View<'a> {
    points: &'a [SurfacePoint],
    appearance: &'a [Appearance],
    outgoing: Outgoing<'a>,
    /// Orders of the points' radiance records, if they have any.
    orders: &'a [u8],
    reach: Reach,
    in_front: f32,
}

/// One level while it is refined.
struct Convergence<'a> {
    filling: Filling<'a>,
    view: View<'a>,
    rule: Rule,
    locator: Locator,
    /// The contributions to each point. Entries whose change counter is not the record's are out
    /// of date.
    lists: Vec<Vec<Contribution>>,
    /// For each record how often its area has become smaller.
    changes: Vec<u32>,
    /// The points that were given a record, so that they get no second one.
    given: Vec<bool>,
}

/// What is visible, by the law of Weber.
#[derive(Clone, Copy)]
struct Rule {
    weight: Weight,
    contrast: f32,
    /// See [`RefinementRule::WeberNearest`].
    spares_nearest: bool,
}

impl Cache {
    /// Refines a filled level until it has fully converged with respect to `points` [Krivanek06,
    /// Algorithm 1]:
    ///
    /// 1. each point has a record that is valid there, and
    /// 2. where more than one is valid, leaving one of them out makes no visible difference,
    ///    `|Y(L1) - Y(L2)| <= c Y(L1) + max(σ(L1), σ(L2))`, L1 the radiance with the record and L2
    ///    without it, direct light included in both, c the scheme's `contrast`.
    ///
    /// Of the records that violate the second condition at x, the one of the lowest weight is kept
    /// from x by lowering its error to a_i = err_i(x) - ε, err_i with the term of the normals,
    /// which the paper forgets here: without it records on curved surfaces shrink further than the
    /// point asks, to nothing where positions coincide. No record goes below [`Reach::floor`];
    /// one that has arrived there may go on violating the condition. Points left without a record
    /// get new ones, whose error is 1.4 times that of the nearest one.
    ///
    /// The lengths of the points' lists are not bounded, so none of the contributions that the
    /// condition is about is left out.
    ///
    /// # Errors
    /// [`Error::Cancelled`], and the level stays empty then; [`Error::InvalidArgument`] if `points`
    /// and `appearance` are not of one length or the level is not filled.
    pub fn converge(
        &mut self,
        probe: &dyn RadianceProbe,
        level: u8,
        points: &[SurfacePoint],
        appearance: &[Appearance],
        seed: u64,
        progress: &Progress,
    ) -> Result<FillStats> {
        if points.len() != appearance.len() {
            let (p, a) = (points.len(), appearance.len());
            return Err(Error::InvalidArgument(format!(
                "{p} shading points cannot have {a} appearances"
            )));
        }
        let Some(filled) = self.levels.get_mut(usize::from(level)).and_then(Option::take) else {
            return Err(Error::InvalidArgument(format!(
                "level {level} cannot be refined before it is filled"
            )));
        };
        let filling = Filling::resume(self, probe, level, seed, filled.records().to_vec());
        let mut convergence =
            Convergence::new(self, filling, (points, &[]), appearance, Outgoing::Diffuse);
        convergence.run(progress)?;
        let Filling { records, stats, .. } = convergence.filling;
        self.levels[usize::from(level)] = Some(Arc::new(self.finish(level, records)));
        Ok(stats)
    }
}

impl Cache {
    /// As [`Cache::converge`] of a level whose records hold `radiance`; returns that of the records
    /// that there are then.
    pub(super) fn converge_radiance(
        &mut self,
        view: &GlossyView,
        sources: &Sources,
        (making, padding): (Making, bool),
        radiance: Vec<Radiance>,
        seed: u64,
        progress: &Progress,
    ) -> Result<(Vec<Radiance>, FillStats)> {
        let GlossyView { points: RadiancePoints { points, orders }, appearance, lobes } = *view;
        if points.points.len() != appearance.len() {
            let (p, a) = (points.points.len(), appearance.len());
            return Err(Error::InvalidArgument(format!(
                "{p} shading points cannot have {a} appearances"
            )));
        }
        let level = making.maker.level;
        let Some(filled) = self.levels[usize::from(level)].take() else {
            return Ok((radiance, FillStats::default()));
        };
        let resumed = Filling::resume(
            self,
            sources.probe,
            level,
            hash(&[seed, 3]),
            filled.records().to_vec(),
        );
        let filling = resumed.with_radiance(sources.deeper, making, radiance);
        let outgoing = Outgoing::Glossy { lobes, maker: making.maker, padding };
        let mut convergence =
            Convergence::new(self, filling, (&points.points, orders), appearance, outgoing);
        convergence.run(progress)?;
        let Filling { records, radiance, stats, .. } = convergence.filling;
        self.levels[usize::from(level)] = Some(Arc::new(self.finish(level, records)));
        Ok((radiance, stats))
    }
}

impl<'a> Convergence<'a> {
    fn new(
        cache: &'a Cache,
        filling: Filling<'a>,
        (points, orders): (&'a [SurfacePoint], &'a [u8]),
        appearance: &'a [Appearance],
        outgoing: Outgoing<'a>,
    ) -> Self {
        let scheme = &cache.scheme;
        let mut convergence = Self {
            view: View {
                points,
                appearance,
                outgoing,
                orders,
                reach: filling.reach,
                in_front: cache.in_front(),
            },
            rule: Rule {
                weight: scheme.validity.weight,
                contrast: scheme.refinement.unwrap_or_default().contrast,
                spares_nearest: scheme
                    .refinement
                    .is_some_and(|r| r.rule == RefinementRule::WeberNearest),
            },
            locator: Locator::build(points),
            lists: vec![Vec::new(); points.len()],
            changes: vec![0; filling.records.len()],
            given: vec![false; points.len()],
            filling,
        };
        convergence.attach(0, &mut PointSet::new(points.len()));
        convergence
    }

    /// Pass after pass, until one changes nothing.
    fn run(&mut self, progress: &Progress) -> Result<()> {
        let count = self.lists.len();
        let mut queue: Vec<u32> = (0..count as u32).collect();
        let mut stale = PointSet::new(count);
        queue.iter().filter(|&&p| self.lists[p as usize].is_empty()).for_each(|&p| stale.insert(p));
        while !queue.is_empty() {
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
        let reach = self.view.reach;
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
                let error = share * reach.allowed_error();
                if error < record.error {
                    shrunk.push((id, area(&reach, record)));
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
            let chosen = self.filling.choose(self.view.points, &pending);
            self.filling.make_records(self.view.points, self.view.orders, &chosen);
            chosen.iter().for_each(|&p| self.given[p as usize] = true);
            self.changes.resize(self.filling.records.len(), 0);
            for (id, &length) in lengths.iter().enumerate() {
                let record = &self.filling.records[id];
                if record.length < length {
                    self.changes[id] += 1;
                    let radius = area(&self.view.reach, &Record { length, ..record.clone() });
                    self.locator.within(record.position, radius, |p| stale.insert(p));
                }
            }
            self.attach(lengths.len(), stale);
        }
    }

    /// Adds the contributions of the records from number `first` on to the points in their areas,
    /// which become stale.
    fn attach(&mut self, first: usize, stale: &mut PointSet) {
        let records = &self.filling.records;
        let found: Vec<Vec<(u32, Contribution)>> = (first..records.len())
            .into_par_iter()
            .map_init(LobeCoefficients::default, |scratch, id| {
                let (record, radiance, mut found) =
                    (&records[id], self.filling.radiance.get(id), Vec::new());
                self.locator.within(record.position, area(&self.view.reach, record), |p| {
                    let contribution = self.view.contribution(
                        p as usize,
                        id as u32,
                        (record, radiance),
                        self.changes[id],
                        scratch,
                    );
                    found.extend(contribution.map(|c| (p, c)));
                });
                found
            })
            .collect();
        for (p, contribution) in found.into_iter().flatten() {
            self.lists[p as usize].push(contribution);
            stale.insert(p);
        }
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
        let (reach, appearance) = (&self.view.reach, &self.view.appearance[p]);
        scratch.clear();
        for c in self.lists[p]
            .iter()
            .filter_map(|c| self.view.current(p, c, &self.filling.records, &self.changes))
        {
            let record = &self.filling.records[c.record as usize];
            let (share, floor) = (reach.share(record), reach.floor(record) / reach.allowed_error());
            scratch.push(Candidate {
                record: c.record,
                error: c.error,
                luminance: c.luminance,
                sigma: c.sigma,
                share,
                floor,
                weight: self.rule.weight(c.error, share),
            });
        }
        self.rule.proposals(scratch, appearance.direct)
    }
}

impl Rule {
    fn weight(&self, error: f32, share: f32) -> f32 {
        self.weight.at(error / share, 1.0 / share)
    }

    /// Keeps candidates away from the point, or as far away as they may be kept, until none is left
    /// whose absence would show.
    fn proposals(&self, candidates: &mut Vec<Candidate>, direct: f32) -> Vec<Proposal> {
        let mut proposals = Vec::new();
        while let Some(worst) = self.worst(candidates, direct) {
            let c = &mut candidates[worst];
            c.share = c.floor.max(c.error - EPSILON * c.share);
            proposals.push((c.record, c.share));
            if c.error < c.share {
                // The floor keeps it here.
                c.weight = self.weight(c.error, c.share);
            } else {
                candidates.swap_remove(worst);
            }
        }
        proposals
    }

    /// The candidate to keep away: of those whose absence would show, and that may still shrink,
    /// the one with the lowest weight.
    ///
    /// The heaviest is spared where the rule says so: if it differs from the others, those are too
    /// far away, and of them the lightest goes that differs from it.
    fn worst(&self, candidates: &[Candidate], direct: f32) -> Option<usize> {
        let sums = |without: usize| {
            let others = candidates.iter().enumerate().filter(|(k, _)| *k != without);
            others.fold((0.0, 0.0, 0.0), |(w, l, s), (_, c)| {
                (w + c.weight, l + c.weight * c.luminance, s + (c.weight * c.sigma).powi(2))
            })
        };
        if candidates.len() < 2 {
            return None;
        }
        let mean = |(w, l, s): (f32, f32, f32)| (l / w, s.sqrt() / w);
        let (all, sigma_all) = mean(sums(usize::MAX));
        let differ =
            |a: f32, b: f32, sigma: f32| (a - b).abs() > self.contrast * (all + direct) + sigma;
        let visible = |k: usize| {
            let (without, sigma) = mean(sums(k));
            differ(all, without, sigma_all.max(sigma))
        };
        let lighter = |a: &usize, b: &usize| {
            let (a, b) = (&candidates[*a], &candidates[*b]);
            a.weight.total_cmp(&b.weight).then(b.record.cmp(&a.record))
        };
        let free = (0..candidates.len()).filter(|&k| candidates[k].share > candidates[k].floor);
        if !self.spares_nearest {
            return free.filter(|&k| visible(k)).min_by(lighter);
        }
        let nearest = (0..candidates.len()).max_by(lighter)?;
        let mut others = free.filter(|&k| k != nearest);
        others.clone().filter(|&k| visible(k)).min_by(lighter).or_else(|| {
            let n = &candidates[nearest];
            let far = |c: &Candidate| differ(c.luminance, n.luminance, c.sigma.max(n.sigma));
            visible(nearest)
                .then(|| others.by_ref().filter(|&k| far(&candidates[k])).min_by(lighter))?
        })
    }
}

/// The radius of validity of `record`.
fn area(reach: &Reach, record: &Record) -> f32 {
    reach.share(record) * reach.radius(record.length, record.footprint).0
}

impl View<'_> {
    /// The error of `record` at point `p`, if it is valid there.
    fn error(&self, p: usize, record: &Record) -> Option<f32> {
        record
            .error_at(&self.reach, &self.points[p], self.in_front)
            .filter(|e| *e < self.reach.share(record))
    }

    /// What a record contributes to point `p`, if it is valid there.
    fn contribution(
        &self,
        p: usize,
        id: u32,
        (record, radiance): (&Record, Option<&Radiance>),
        changes: u32,
        scratch: &mut LobeCoefficients,
    ) -> Option<Contribution> {
        let error = self.error(p, record)?;
        let (at, appearance) = (&self.points[p], &self.appearance[p]);
        let (luminance, sigma) = self.outgoing.luminance(
            (p, at),
            appearance,
            &self.reach,
            (record, radiance),
            scratch,
        )?;
        Some(Contribution { record: id, changes, error, luminance, sigma })
    }

    /// The contribution `c` to point `p` as the records are now.
    fn current(
        &self,
        p: usize,
        c: &Contribution,
        records: &[Record],
        changes: &[u32],
    ) -> Option<Contribution> {
        let now = changes[c.record as usize];
        if now == c.changes {
            return Some(*c);
        }
        let record = &records[c.record as usize];
        if self.outgoing.is_costly() {
            return Some(Contribution { changes: now, error: self.error(p, record)?, ..*c });
        }
        self.contribution(p, c.record, (record, None), now, &mut LobeCoefficients::default())
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

#[cfg(test)]
mod tests {
    use super::*;

    const RULE: Rule = Rule { weight: Weight::Inverse, contrast: 0.02, spares_nearest: false };

    /// Records 0, 1, ... of these errors and luminances at a point; noiseless, allowed all of the
    /// level's error, and free to shrink to a tenth of it.
    fn candidates(all: &[(f32, f32)]) -> Vec<Candidate> {
        let candidate = |(record, &(error, luminance)): (usize, &(f32, f32))| Candidate {
            record: record as u32,
            error,
            luminance,
            sigma: 0.0,
            share: 1.0,
            floor: 0.1,
            weight: RULE.weight(error, 1.0),
        };
        all.iter().enumerate().map(candidate).collect()
    }

    #[test]
    fn the_farthest_of_the_records_that_differ_is_kept_away() {
        let mut three = candidates(&[(0.3, 1.0), (0.8, 1.2), (0.5, 1.01)]);
        let proposals = RULE.proposals(&mut three, 0.0);
        // Just beyond the point, and not further: the error is that of the point less 1e-4.
        assert_eq!(proposals, [(1, 0.8 - EPSILON)]);
        assert_eq!(three.len(), 2);
    }

    #[test]
    fn the_nearest_is_spared_where_the_rule_says_so() {
        let kind = Rule { spares_nearest: true, ..RULE };
        // At record 0, over whose place the others reach. They agree with each other and hardly
        // weigh: without them nothing changes, and without record 0 everything does.
        let at_its_place = [(0.001, 1.0), (0.5, 1.5), (0.7, 1.5)];
        assert_eq!(RULE.proposals(&mut candidates(&at_its_place), 0.0), [(0, 0.1)]);
        let mut three = candidates(&at_its_place);
        assert_eq!(kind.proposals(&mut three, 0.0), [(2, 0.7 - EPSILON), (1, 0.5 - EPSILON)]);
        // One of them agrees with it and stays.
        let mut three = candidates(&[(0.001, 1.0), (0.5, 1.5), (0.7, 1.0)]);
        assert_eq!(kind.proposals(&mut three, 0.0), [(1, 0.5 - EPSILON)]);
        // Where the others may not shrink any more, it does not have to suffer.
        let mut two = candidates(&[(0.001, 1.0), (0.5, 1.5)]);
        two[1].floor = two[1].share;
        assert!(kind.proposals(&mut two, 0.0).is_empty());
        // Elsewhere the rules agree.
        let elsewhere = [(0.3, 1.0), (0.8, 1.2), (0.5, 1.01)];
        assert_eq!(
            kind.proposals(&mut candidates(&elsewhere), 0.0),
            RULE.proposals(&mut candidates(&elsewhere), 0.0)
        );
    }

    #[test]
    fn what_cannot_be_seen_is_left_alone() {
        let differ = [(0.4, 1.0), (0.5, 1.1)];
        assert_eq!(RULE.proposals(&mut candidates(&differ), 0.0).len(), 1);
        assert!(RULE.proposals(&mut candidates(&[(0.4, 1.0), (0.5, 1.03)]), 0.0).is_empty());
        // The difference is 0.1 5/9 at most; 2 % of direct light of 2 and of the mean exceed it.
        assert!(RULE.proposals(&mut candidates(&differ), 2.0).is_empty());
        let mut noisy = candidates(&differ);
        noisy.iter_mut().for_each(|c| c.sigma = 0.05);
        assert!(RULE.proposals(&mut noisy, 0.0).is_empty());
        assert!(RULE.proposals(&mut candidates(&[(0.4, 1.0)]), 0.0).is_empty());
        assert!(RULE.proposals(&mut candidates(&[(0.4, 0.0), (0.5, 0.0)]), 0.0).is_empty());
    }

    #[test]
    fn no_record_goes_below_its_floor() {
        // Both are so near that they cannot be kept away: both shrink to the floor, the lighter one
        // first, and stay.
        let mut near = candidates(&[(0.01, 1.0), (0.02, 2.0)]);
        assert_eq!(RULE.proposals(&mut near, 0.0), [(1, 0.1), (0, 0.1)]);
        assert_eq!(near.len(), 2);
        // One that has arrived there is passed over.
        let mut arrived = candidates(&[(0.2, 1.0), (0.3, 2.0)]);
        (arrived[1].share, arrived[1].floor) = (0.4, 0.4);
        assert_eq!(RULE.proposals(&mut arrived, 0.0), [(0, 0.2 - EPSILON)]);
    }
}
