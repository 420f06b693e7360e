//! A tree over the lights at finite distance, for choosing one of many in logarithmic time.
//!
//! Inner nodes hold two children and are split by the bounds of the children; a leaf holds a few lights and is split by the lights' own importance. A scene of few lights is
//! one leaf.

use super::bounds::{Cluster, LightBounds};
use super::{PunctualLight, TriangleLight};
use crate::geometry::Aabb;
use crate::math::Vec3;
use std::f32::consts::PI;
use std::ops::Range;

/// Most lights of a leaf.
pub(super) const LEAF: usize = 16;
/// Candidate planes per axis are the borders of this many bins.
const BINS: usize = 12;
/// From this depth on groups are halved by number, which bounds the depth of any tree by that of a path.
const MAX_SAOH_DEPTH: u32 = 32;

/// Equally spaced choices in [0, 1): `count` of them, the first at `offset / count`. Those that fall into an interval of cumulated probability choose its light.
#[derive(Clone, Copy)]
pub(super) struct Comb {
    pub offset: f64,
    pub count: u32,
}

impl Comb {
    /// How many choices lie below `position`.
    fn below(self, position: f64) -> u32 {
        (position * f64::from(self.count) - self.offset).ceil().max(0.0) as u32
    }

    /// The choices of `choices` that lie below `position`, and the rest.
    pub fn split(self, choices: &Range<u32>, position: f64) -> (Range<u32>, Range<u32>) {
        let middle = self.below(position).clamp(choices.start, choices.end);
        (choices.start..middle, middle..choices.end)
    }
}

/// An interval of cumulated probability and the choices inside it.
#[derive(Clone)]
pub(super) struct Share {
    pub start: f64,
    pub probability: f64,
    pub choices: Range<u32>,
}

/// A light of the tree.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Pick {
    Triangle(usize),
    Punctual(usize),
}

#[derive(Clone, Debug)]
enum Kind {
    /// Index of the first child; the second follows it.
    Inner(u32),
    Leaf(Leaf),
}

#[derive(Clone, Debug, Default)]
struct Leaf {
    triangles: Range<u32>,
    punctual: Range<u32>,
}

#[derive(Clone, Debug)]
struct Node {
    cluster: Cluster,
    kind: Kind,
}

/// The lights at finite distance.
#[derive(Clone, Debug)]
pub(super) struct LightTree {
    nodes: Vec<Node>,
    /// In the order of the leaves.
    triangles: Vec<TriangleLight>,
    /// In the order of the leaves, with their indices in the scene.
    punctual: Vec<(u32, PunctualLight)>,
    /// For each triangle, the path from the root to its leaf: bit i is set where the path takes the second child at depth i.
    paths: Vec<u64>,
}

impl LightTree {
    /// Lights without power are left out.
    pub fn new(triangles: Vec<TriangleLight>, punctual: Vec<(u32, PunctualLight)>) -> Self {
        let items = triangles.iter().enumerate().map(|(i, t)| (triangle_bounds(t), Pick::Triangle(i)));
        let items = items.chain(punctual.iter().enumerate().map(|(i, l)| (punctual_bounds(&l.1), Pick::Punctual(i))));
        let mut items: Vec<_> =
            items.filter(|(b, _)| b.intensity > 0.0 && b.intensity.is_finite() && b.bounds.diagonal().is_finite()).collect();
        let mut tree = Self { nodes: Vec::new(), triangles: Vec::new(), punctual: Vec::new(), paths: Vec::new() };
        if let Some(all) = union(&items) {
            tree.nodes.push(Node { cluster: Cluster::from(&all), kind: Kind::Inner(0) });
            tree.build(0, &mut items, &all, 0, 0, &triangles, &punctual);
        }
        tree
    }

    #[allow(clippy::too_many_arguments, reason = "the state of a recursion")]
    fn build(
        &mut self,
        node: usize,
        items: &mut [(LightBounds, Pick)],
        all: &LightBounds,
        depth: u32,
        path: u64,
        triangles: &[TriangleLight],
        punctual: &[(u32, PunctualLight)],
    ) {
        if items.len() <= LEAF {
            let (first_triangle, first_punctual) = (self.triangles.len() as u32, self.punctual.len() as u32);
            for (_, pick) in items.iter() {
                match *pick {
                    Pick::Triangle(i) => {
                        self.triangles.push(triangles[i]);
                        self.paths.push(path);
                    }
                    Pick::Punctual(i) => self.punctual.push(punctual[i]),
                }
            }
            self.nodes[node].kind = Kind::Leaf(Leaf {
                triangles: first_triangle..self.triangles.len() as u32,
                punctual: first_punctual..self.punctual.len() as u32,
            });
            return;
        }
        let middle = if depth < MAX_SAOH_DEPTH { partition(items, all) } else { items.len() / 2 };
        let first = self.nodes.len();
        self.nodes[node].kind = Kind::Inner(first as u32);
        let (left, right) = items.split_at_mut(middle);
        let bounds = [union(left), union(right)].map(|b| b.unwrap_or(*all));
        self.nodes.extend(bounds.iter().map(|b| Node { cluster: Cluster::from(b), kind: Kind::Inner(0) }));
        self.build(first, left, &bounds[0], depth + 1, path, triangles, punctual);
        self.build(first + 1, right, &bounds[1], depth + 1, path | 1 << depth, triangles, punctual);
    }

    /// The emissive triangles, in the order of the leaves.
    pub fn triangles(&self) -> &[TriangleLight] {
        &self.triangles
    }

    /// True if there is a point or spot light.
    pub fn has_punctual(&self) -> bool {
        !self.punctual.is_empty()
    }

    /// The punctual light of a pick and its index in the scene.
    pub fn punctual(&self, index: usize) -> (u32, &PunctualLight) {
        let (scene_index, light) = &self.punctual[index];
        (*scene_index, light)
    }

    /// True if some light of the tree may reach the receiver.
    pub fn reaches(&self, p: Vec3, n: Option<Vec3>) -> bool {
        self.nodes.first().is_some_and(|root| match &root.kind {
            Kind::Inner(_) => root.cluster.importance(p, n) > 0.0,
            Kind::Leaf(leaf) => self.leaf_importance(leaf, p, n).1 > 0.0,
        })
    }

    /// Distributes the choices of `share` over the lights, and calls `out` for each light that gets some. Choices that end among lights which all turn
    /// out not to reach the receiver are lost.
    pub fn distribute(&self, p: Vec3, n: Option<Vec3>, comb: Comb, share: Share, out: &mut impl FnMut(Pick, Share)) {
        if self.nodes.is_empty() || share.choices.is_empty() {
            return;
        }
        self.distribute_node(0, p, n, comb, share, out);
    }

    fn distribute_node(
        &self,
        node: usize,
        p: Vec3,
        n: Option<Vec3>,
        comb: Comb,
        mut share: Share,
        out: &mut impl FnMut(Pick, Share),
    ) {
        let mut node = node;
        loop {
            match &self.nodes[node].kind {
                Kind::Leaf(leaf) => return self.distribute_leaf(leaf, p, n, comb, share, out),
                &Kind::Inner(first) => {
                    let Some(left_probability) = self.left_probability(first, p, n) else { return };
                    let first = first as usize;
                    let left = share.probability * left_probability;
                    let right = share.probability * (1.0 - left_probability);
                    let (left_choices, right_choices) = match left_probability {
                        1.0 => (share.choices, 0..0),
                        0.0 => (0..0, share.choices),
                        _ => comb.split(&share.choices, share.start + left),
                    };
                    let left = Share { start: share.start, probability: left, choices: left_choices };
                    let right = Share { start: share.start + left.probability, probability: right, choices: right_choices };
                    if right.choices.is_empty() {
                        (node, share) = (first, left);
                    } else {
                        if !left.choices.is_empty() {
                            self.distribute_node(first, p, n, comb, left, out);
                        }
                        (node, share) = (first + 1, right);
                    }
                }
            }
        }
    }

    fn distribute_leaf(
        &self,
        leaf: &Leaf,
        p: Vec3,
        n: Option<Vec3>,
        comb: Comb,
        share: Share,
        out: &mut impl FnMut(Pick, Share),
    ) {
        let (importance, total) = self.leaf_importance(leaf, p, n);
        let count = leaf.triangles.len() + leaf.punctual.len();
        let Some(last) = importance[..count].iter().rposition(|&i| i > 0.0) else { return };
        let (mut start, mut choices) = (share.start, share.choices);
        for (i, &value) in importance[..=last].iter().enumerate() {
            let probability = share.probability * f64::from(value / total);
            let mine = if i == last {
                choices.clone()
            } else {
                let (mine, rest) = comb.split(&choices, start + probability);
                choices = rest;
                mine
            };
            if value > 0.0 && !mine.is_empty() {
                let pick = match i.checked_sub(leaf.triangles.len()) {
                    None => Pick::Triangle(leaf.triangles.start as usize + i),
                    Some(j) => Pick::Punctual(leaf.punctual.start as usize + j),
                };
                out(pick, Share { start, probability, choices: mine });
            }
            start += probability;
        }
    }

    /// The probability that a choice falls on a triangle (an index into [`LightTree::triangles`]).
    pub fn probability(&self, p: Vec3, n: Option<Vec3>, triangle: usize) -> f32 {
        let mut probability = 1.0_f64;
        let mut path = self.paths[triangle];
        let mut node = 0;
        loop {
            match &self.nodes[node].kind {
                &Kind::Inner(first) => {
                    let Some(left) = self.left_probability(first, p, n) else { return 0.0 };
                    let second = path & 1 == 1;
                    probability *= if second { 1.0 - left } else { left };
                    if probability == 0.0 {
                        return 0.0;
                    }
                    node = first as usize + usize::from(second);
                    path >>= 1;
                }
                Kind::Leaf(leaf) => {
                    let (importance, total) = self.leaf_importance(leaf, p, n);
                    let value = importance[triangle - leaf.triangles.start as usize];
                    return if value > 0.0 { (probability * f64::from(value / total)) as f32 } else { 0.0 };
                }
            }
        }
    }

    /// The probability of the first of two siblings, `None` if neither reaches the receiver.
    fn left_probability(&self, first: u32, p: Vec3, n: Option<Vec3>) -> Option<f64> {
        let first = first as usize;
        let left = self.nodes[first].cluster.importance(p, n);
        let right = self.nodes[first + 1].cluster.importance(p, n);
        let sum = left + right;
        (sum > 0.0).then(|| f64::from(left / sum))
    }

    /// The importance of each light of a leaf, triangles first, and the sum.
    fn leaf_importance(&self, leaf: &Leaf, p: Vec3, n: Option<Vec3>) -> ([f32; LEAF], f32) {
        let mut importance = [0.0; LEAF];
        let triangles = &self.triangles[leaf.triangles.start as usize..leaf.triangles.end as usize];
        let punctual = &self.punctual[leaf.punctual.start as usize..leaf.punctual.end as usize];
        let values = triangles.iter().map(|t| t.importance(p, n)).chain(punctual.iter().map(|(_, l)| l.importance(p, n)));
        let mut total = 0.0;
        for (slot, value) in importance.iter_mut().zip(values) {
            *slot = value;
            total += value;
        }
        (importance, total)
    }
}

fn triangle_bounds(triangle: &TriangleLight) -> LightBounds {
    let theta_o = if triangle.emitter().double_sided { PI } else { 0.0 };
    let bounds = triangle.corners().into_iter().fold(Aabb::EMPTY, Aabb::with);
    LightBounds { bounds, axis: triangle.normal(), theta_o, intensity: triangle.intensity() }
}

fn punctual_bounds(light: &PunctualLight) -> LightBounds {
    let (position, axis, theta_o) = match *light {
        PunctualLight::Point { position, .. } => (position, Vec3::Z, PI),
        PunctualLight::Spot { position, direction, cos_outer, .. } => (position, direction, cos_outer.clamp(-1.0, 1.0).acos()),
        PunctualLight::Directional { direction, .. } => (Vec3::ZERO, direction, 0.0),
    };
    LightBounds { bounds: Aabb { min: position, max: position }, axis, theta_o, intensity: super::weight(light.strength()) }
}

fn union(items: &[(LightBounds, Pick)]) -> Option<LightBounds> {
    items.iter().map(|(b, _)| *b).reduce(|a, b| a.union(&b))
}

/// Orders the items so that a good split lies at the returned index: the surface area orientation heuristic over bins along each axis [Conty18, Sec. 4.4].
fn partition(items: &mut [(LightBounds, Pick)], all: &LightBounds) -> usize {
    let centers = items.iter().fold(Aabb::EMPTY, |b, (l, _)| b.with(l.bounds.center()));
    let extent = centers.max - centers.min;
    let longest = (all.bounds.max - all.bounds.min).max_element();
    let mut best: Option<(f32, usize, usize)> = None;
    for axis in 0..3 {
        if extent[axis] <= 0.0 {
            continue;
        }
        let mut bins: [Option<LightBounds>; BINS] = [None; BINS];
        for (light, _) in items.iter() {
            let bin = &mut bins[bin_of(light, &centers, axis)];
            *bin = Some(bin.map_or(*light, |b| b.union(light)));
        }
        let mut above = [0.0; BINS];
        let mut group: Option<LightBounds> = None;
        for i in (1..BINS).rev() {
            group = merge(group, bins[i]);
            above[i] = group.map_or(0.0, |g| g.cost());
        }
        group = None;
        // Thin boxes are better cut across their length.
        let shape = longest / (all.bounds.max[axis] - all.bounds.min[axis]);
        for i in 1..BINS {
            group = merge(group, bins[i - 1]);
            let Some(below) = group else { continue };
            let cost = shape * (below.cost() + above[i]);
            if cost.is_finite() && best.is_none_or(|(b, ..)| cost < b) {
                best = Some((cost, axis, i));
            }
        }
    }
    let Some((_, axis, border)) = best else { return items.len() / 2 };
    // Stable, so that the order depends on the input alone.
    items.sort_by_key(|(light, _)| bin_of(light, &centers, axis) >= border);
    let middle = items.partition_point(|(light, _)| bin_of(light, &centers, axis) < border);
    if middle == 0 || middle == items.len() { items.len() / 2 } else { middle }
}

fn bin_of(light: &LightBounds, centers: &Aabb, axis: usize) -> usize {
    let position = (light.bounds.center()[axis] - centers.min[axis]) / (centers.max[axis] - centers.min[axis]);
    ((position * BINS as f32) as usize).min(BINS - 1)
}

fn merge(a: Option<LightBounds>, b: Option<LightBounds>) -> Option<LightBounds> {
    match (a, b) {
        (Some(a), Some(b)) => Some(a.union(&b)),
        (a, b) => a.or(b),
    }
}
