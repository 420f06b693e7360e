//! Which records refinement keeps away from a point, by the law of Weber.

use crate::cache::scheme::{RefinementRule, Scheme, Weight};

/// A record as one point sees it while the point decides.
#[derive(Clone, Copy)]
pub(super) struct Candidate {
    pub record: u32,
    pub error: f32,
    pub luminance: f32,
    /// Standard error of `luminance`.
    pub sigma: f32,
    /// a_i as a share of the level's allowed error, and the smallest share it may have.
    pub share: f32,
    pub floor: f32,
    pub weight: f32,
}

/// A record's new share of the level's allowed error.
pub(super) type Proposal = (u32, f32);

/// ε of [Krivanek06, Sec. 4.1], relative to a_i.
const EPSILON: f32 = 1e-4;

/// What is visible, by the law of Weber.
#[derive(Clone, Copy)]
pub(super) struct Weber {
    weight: Weight,
    contrast: f32,
    /// See [`RefinementRule::WeberNearest`].
    spares_nearest: bool,
}

impl Weber {
    /// The rule of `scheme`.
    pub fn new(scheme: &Scheme) -> Self {
        Self {
            weight: scheme.validity.weight,
            contrast: scheme.refinement.unwrap_or_default().contrast,
            spares_nearest: scheme
                .refinement
                .is_some_and(|r| r.rule == RefinementRule::WeberNearest),
        }
    }

    pub fn weight(&self, error: f32, share: f32) -> f32 {
        self.weight.at(error / share, 1.0 / share)
    }

    /// Keeps candidates away from the point, or as far away as they may be kept, until none is left
    /// whose absence would show.
    pub fn proposals(&self, candidates: &mut Vec<Candidate>, direct: f32) -> Vec<Proposal> {
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

#[cfg(test)]
mod tests {
    use super::*;

    const RULE: Weber = Weber { weight: Weight::Inverse, contrast: 0.02, spares_nearest: false };

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
        let kind = Weber { spares_nearest: true, ..RULE };
        // At record 0, over whose place the others rule. They agree with each other and hardly
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
