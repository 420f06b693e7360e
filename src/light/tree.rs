//! A tree over the lights at finite distance, for choosing one of many in logarithmic time.
//!
//! Inner nodes have up to four children and are split by the bounds of the children; a leaf holds a
//! few lights and is split by the lights' own importance. A scene of few lights is one leaf.

use super::bounds::LightBounds;
use super::lanes::{GroupLanes, TriangleLanes};
use super::simd::LANES;
use super::source::{PunctualLight, weight};
use super::triangle::TriangleLight;
use crate::geometry::Aabb;
use crate::math::Vec3;
use std::f32::consts::PI;
use std::ops::Range;

/// Most lights of a leaf.
const LEAF: usize = 16;
/// Candidate planes per axis are the borders of this many bins.
const BINS: usize = 12;
/// From this depth on groups are halved by number, which bounds the depth of any tree by the 32
/// steps of a path.
const MAX_SAOH_DEPTH: u32 = 16;

/// Equally spaced choices in [0, 1): `count` of them, the first at `offset / count`. Those that
/// fall into an interval of cumulated probability choose its light.
#[derive(Clone, Copy)]
pub(super) struct Comb {
    pub offset: f64,
    pub count: u32,
}

/// An interval of cumulated probability and the choices inside it.
#[derive(Clone)]
pub(super) struct Share {
    pub start: f64,
    pub probability: f64,
    pub choices: Range<u32>,
}

impl Share {
    /// The whole of a comb.
    pub fn all(comb: Comb) -> Self {
        Self { start: 0.0, probability: 1.0, choices: 0..comb.count }
    }
}

impl Comb {
    /// Cuts an interval in proportion to `values`, and yields the parts that contain choices. The
    /// parts of positive values get all choices.
    #[inline]
    pub fn split(
        self, share: Share, values: impl Iterator<Item = f32> + Clone,
    ) -> impl Iterator<Item = (usize, Share)> {
        let total: f32 = values.clone().sum();
        let scale = share.probability / f64::from(total);
        let Share { start, mut choices, .. } = share;
        // Choice k lies at (k + offset) / count; `next` is where the first one left lies on the
        // scale of the values.
        let spacing = f64::from(self.count).recip();
        let position =
            move |choice: u32| ((f64::from(choice) + self.offset) * spacing - start) / scale;
        let mut next = position(choices.start);
        let mut sum = 0.0;
        values.enumerate().filter_map(move |(i, value)| {
            let below = sum;
            sum += value;
            // The sum reaches the total, to the bit, with the last positive value.
            let last = sum >= total;
            if value <= 0.0 || choices.is_empty() || (f64::from(sum) <= next && !last) {
                return None;
            }
            let mut end = choices.start + 1;
            while end < choices.end && (last || position(end) < f64::from(sum)) {
                end += 1;
            }
            let part = Share {
                start: start + f64::from(below) * scale,
                probability: f64::from(value) * scale,
                choices: choices.start..end,
            };
            choices.start = end;
            next = position(end);
            Some((i, part))
        })
    }
}

/// A light of the tree.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Pick {
    Triangle(usize),
    Punctual(usize),
}

/// Index of an inner node or of a leaf.
#[derive(Clone, Copy, Debug)]
enum Child {
    Inner(u32),
    Leaf(u32),
}

#[derive(Clone, Debug)]
struct Node {
    groups: GroupLanes,
    /// Unused ones at the end are groups without intensity.
    children: [Child; LANES],
}

#[derive(Clone, Debug)]
struct Leaf {
    triangles: Range<u32>,
    /// The triangles again, for their importance: a range of `LightTree::lanes`.
    lanes: Range<u32>,
    punctual: Range<u32>,
}

/// The lights of a leaf by importance: triangles, padded to whole groups, then punctual lights.
type Importance = [f32; LEAF + LANES];

/// The lights at finite distance.
#[derive(Clone, Debug)]
pub(super) struct LightTree {
    /// `None` without lights.
    root: Option<Child>,
    nodes: Vec<Node>,
    leaves: Vec<Leaf>,
    lanes: Vec<TriangleLanes>,
    /// In the order of the leaves.
    triangles: Vec<TriangleLight>,
    /// In the order of the leaves, with their indices in the scene.
    punctual: Vec<(u32, PunctualLight)>,
    /// For each triangle, the path from the root to its leaf: bits 2i and 2i + 1 are the child
    /// that it takes at depth i.
    paths: Vec<u64>,
    /// The same for each punctual light.
    punctual_paths: Vec<u64>,
    /// For each punctual light, its index in the scene and its place, in the order of the former.
    punctual_places: Vec<(u32, usize)>,
}

impl LightTree {
    /// Lights without power are left out.
    pub fn new(triangles: Vec<TriangleLight>, punctual: Vec<(u32, PunctualLight)>) -> Self {
        let items =
            triangles.iter().enumerate().map(|(i, t)| (triangle_bounds(t), Pick::Triangle(i)));
        let items = items.chain(
            punctual.iter().enumerate().map(|(i, l)| (punctual_bounds(&l.1), Pick::Punctual(i))),
        );
        let mut items: Vec<_> = items
            .filter(|(b, _)| {
                b.intensity > 0.0 && b.intensity.is_finite() && b.bounds.diagonal().is_finite()
            })
            .collect();
        let mut tree = Self {
            root: None,
            nodes: Vec::new(),
            leaves: Vec::new(),
            lanes: Vec::new(),
            triangles: Vec::new(),
            punctual: Vec::new(),
            paths: Vec::new(),
            punctual_paths: Vec::new(),
            punctual_places: Vec::new(),
        };
        if !items.is_empty() {
            tree.root = Some(tree.build(&mut items, 0, 0, &triangles, &punctual));
        }
        tree.punctual_places =
            (0..).zip(&tree.punctual).map(|(place, (index, _))| (*index, place)).collect();
        tree.punctual_places.sort_unstable();
        tree
    }

    fn build(
        &mut self, items: &mut [(LightBounds, Pick)], depth: u32, path: u64,
        triangles: &[TriangleLight], punctual: &[(u32, PunctualLight)],
    ) -> Child {
        if items.len() <= LEAF {
            return Child::Leaf(self.add_leaf(items, path, triangles, punctual));
        }
        let halves = cut(items, depth)
            .map(|half| if half.len() > LEAF { cut(half, depth) } else { [half, &mut []] });
        let mut groups: Vec<_> =
            halves.into_iter().flatten().filter(|group| !group.is_empty()).collect();
        let bounds: Vec<_> = groups.iter().filter_map(|group| union(group)).collect();
        let node = self.nodes.len();
        self.nodes
            .push(Node { groups: GroupLanes::new(&bounds), children: [Child::Leaf(0); LANES] });
        for (i, group) in groups.iter_mut().enumerate() {
            let child =
                self.build(group, depth + 1, path | (i as u64) << (2 * depth), triangles, punctual);
            self.nodes[node].children[i] = child;
        }
        Child::Inner(node as u32)
    }

    fn add_leaf(
        &mut self, items: &[(LightBounds, Pick)], path: u64, triangles: &[TriangleLight],
        punctual: &[(u32, PunctualLight)],
    ) -> u32 {
        let counts = |tree: &Self| {
            [tree.triangles.len(), tree.lanes.len(), tree.punctual.len()].map(|n| n as u32)
        };
        let first = counts(self);
        for (_, pick) in items {
            match *pick {
                Pick::Triangle(i) => {
                    self.triangles.push(triangles[i]);
                    self.paths.push(path);
                }
                Pick::Punctual(i) => {
                    self.punctual.push(punctual[i].clone());
                    self.punctual_paths.push(path);
                }
            }
        }
        self.lanes
            .extend(self.triangles[first[0] as usize..].chunks(LANES).map(TriangleLanes::new));
        let end = counts(self);
        self.leaves.push(Leaf {
            triangles: first[0]..end[0],
            lanes: first[1]..end[1],
            punctual: first[2]..end[2],
        });
        self.leaves.len() as u32 - 1
    }

    /// The emissive triangles, in the order of the leaves.
    pub fn triangles(&self) -> &[TriangleLight] {
        &self.triangles
    }

    /// True if there is a point or spot light.
    pub fn has_punctual(&self) -> bool {
        !self.punctual.is_empty()
    }

    /// The punctual lights with their indices in the scene.
    pub fn punctual_lights(&self) -> &[(u32, PunctualLight)] {
        &self.punctual
    }

    /// The place of a punctual light by its index in the scene.
    pub fn find_punctual(&self, scene_index: u32) -> Option<usize> {
        self.punctual_places
            .binary_search_by_key(&scene_index, |(index, _)| *index)
            .ok()
            .map(|i| self.punctual_places[i].1)
    }

    /// The punctual light of a pick and its index in the scene.
    pub fn punctual(&self, index: usize) -> (u32, &PunctualLight) {
        let (scene_index, light) = &self.punctual[index];
        (*scene_index, light)
    }

    /// True if some light of the tree may reach the receiver.
    pub fn reaches(&self, p: Vec3, n: Option<Vec3>) -> bool {
        match self.root {
            None => false,
            Some(Child::Inner(node)) => {
                self.nodes[node as usize].groups.importance(p, n).max_element() > 0.0
            }
            Some(Child::Leaf(leaf)) => {
                self.leaf_importance(&self.leaves[leaf as usize], p, n).0.iter().any(|&i| i > 0.0)
            }
        }
    }

    /// Distributes the choices of `share` over the lights, and calls `out` for each light that gets
    /// some. Choices that end among lights which all turn out not to reach the receiver are
    /// lost.
    pub fn distribute(
        &self, p: Vec3, n: Option<Vec3>, comb: Comb, share: Share,
        out: &mut impl FnMut(Pick, Share),
    ) {
        if let Some(root) = self.root {
            self.distribute_below(root, p, n, comb, share, out);
        }
    }

    fn distribute_below(
        &self, child: Child, p: Vec3, n: Option<Vec3>, comb: Comb, share: Share,
        out: &mut impl FnMut(Pick, Share),
    ) {
        match child {
            Child::Inner(node) => {
                let node = &self.nodes[node as usize];
                let importance = node.groups.importance(p, n).to_array();
                for (i, part) in comb.split(share, importance.into_iter()) {
                    self.distribute_below(node.children[i], p, n, comb, part, out);
                }
            }
            Child::Leaf(leaf) => {
                let leaf = &self.leaves[leaf as usize];
                let (importance, slots) = self.leaf_importance(leaf, p, n);
                let padded = slots - leaf.punctual.len();
                for (i, part) in comb.split(share, importance[..slots].iter().copied()) {
                    let pick = match i.checked_sub(padded) {
                        None => Pick::Triangle(leaf.triangles.start as usize + i),
                        Some(j) => Pick::Punctual(leaf.punctual.start as usize + j),
                    };
                    out(pick, part);
                }
            }
        }
    }

    /// The probability that a choice falls on a light, a triangle by its index in
    /// [`LightTree::triangles`].
    pub fn probability(&self, p: Vec3, n: Option<Vec3>, pick: Pick) -> f32 {
        let mut probability = 1.0;
        let mut path = match pick {
            Pick::Triangle(i) => self.paths[i],
            Pick::Punctual(i) => self.punctual_paths[i],
        };
        let mut child = self.root;
        while let Some(Child::Inner(node)) = child {
            let node = &self.nodes[node as usize];
            let importance = node.groups.importance(p, n).to_array();
            let index = (path & 3) as usize;
            probability *= fraction(&importance, index);
            if probability <= 0.0 {
                return 0.0;
            }
            child = Some(node.children[index]);
            path >>= 2;
        }
        let Some(Child::Leaf(leaf)) = child else { return 0.0 };
        let leaf = &self.leaves[leaf as usize];
        let (importance, slots) = self.leaf_importance(leaf, p, n);
        let slot = match pick {
            Pick::Triangle(i) => i - leaf.triangles.start as usize,
            Pick::Punctual(i) => slots - leaf.punctual.len() + i - leaf.punctual.start as usize,
        };
        (probability * fraction(&importance[..slots], slot)) as f32
    }

    /// The importance of each light of a leaf, and the number of slots that they take.
    fn leaf_importance(&self, leaf: &Leaf, p: Vec3, n: Option<Vec3>) -> (Importance, usize) {
        let mut importance = [0.0; LEAF + LANES];
        let mut slots = 0;
        for lanes in &self.lanes[leaf.lanes.start as usize..leaf.lanes.end as usize] {
            let (values, mut near) = lanes.importance(p, n);
            importance[slots..slots + LANES].copy_from_slice(&values.to_array());
            while near != 0 {
                let slot = slots + near.trailing_zeros() as usize;
                importance[slot] =
                    self.triangles[leaf.triangles.start as usize + slot].near_importance(p, n);
                near &= near - 1;
            }
            slots += LANES;
        }
        for (_, light) in &self.punctual[leaf.punctual.start as usize..leaf.punctual.end as usize] {
            importance[slots] = light.importance(p, n);
            slots += 1;
        }
        (importance, slots)
    }
}

/// The part of one value in the sum of all, as [`Comb::split`] has it.
fn fraction(values: &[f32], index: usize) -> f64 {
    if values[index] > 0.0 {
        f64::from(values[index]) / f64::from(values.iter().sum::<f32>())
    } else {
        0.0
    }
}

fn triangle_bounds(triangle: &TriangleLight) -> LightBounds {
    let theta_o = if triangle.emitter().double_sided { PI } else { 0.0 };
    let bounds = triangle.corners().into_iter().fold(Aabb::EMPTY, Aabb::with);
    LightBounds { bounds, axis: triangle.normal(), theta_o, intensity: triangle.intensity() }
}

fn punctual_bounds(light: &PunctualLight) -> LightBounds {
    let (position, axis, theta_o) = match *light {
        PunctualLight::Ies { position, from_world, ref profile, .. } => {
            (position, from_world.transpose() * Vec3::NEG_Z, profile.reach())
        }
        PunctualLight::Point { position, .. } => (position, Vec3::Z, PI),
        PunctualLight::Spot { position, direction, outer, .. } => {
            (position, direction, 2.0 * (0.5 * outer).clamp(0.0, 1.0).sqrt().asin())
        }
        PunctualLight::Directional { direction, .. } | PunctualLight::Disc { direction, .. } => {
            (Vec3::ZERO, direction, 0.0)
        }
    };
    LightBounds {
        bounds: Aabb { min: position, max: position },
        axis,
        theta_o,
        intensity: weight(light.strength()),
    }
}

fn union(items: &[(LightBounds, Pick)]) -> Option<LightBounds> {
    items.iter().map(|(b, _)| *b).reduce(|a, b| a.union(&b))
}

/// Cuts a group in two.
fn cut(items: &mut [(LightBounds, Pick)], depth: u32) -> [&mut [(LightBounds, Pick)]; 2] {
    let middle = if depth < MAX_SAOH_DEPTH { partition(items) } else { None };
    let (left, right) = items.split_at_mut(middle.unwrap_or(items.len() / 2));
    [left, right]
}

/// Orders the items so that a good split lies at the returned index: the surface area orientation
/// heuristic over bins along each axis [Conty18, Sec. 4]. `None` where all items lie at one place.
fn partition(items: &mut [(LightBounds, Pick)]) -> Option<usize> {
    let all = items.iter().fold(Aabb::EMPTY, |b, (l, _)| b.union(l.bounds));
    let centers = items.iter().fold(Aabb::EMPTY, |b, (l, _)| b.with(l.bounds.center()));
    let extent = centers.max - centers.min;
    let longest = (all.max - all.min).max_element();
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
        let shape = longest / (all.max[axis] - all.min[axis]);
        for i in 1..BINS {
            group = merge(group, bins[i - 1]);
            let Some(below) = group else { continue };
            let cost = shape * (below.cost() + above[i]);
            if cost.is_finite() && best.is_none_or(|(b, ..)| cost < b) {
                best = Some((cost, axis, i));
            }
        }
    }
    let (_, axis, border) = best?;
    // Stable, so that the order depends on the input alone.
    items.sort_by_key(|(light, _)| bin_of(light, &centers, axis) >= border);
    let middle = items.partition_point(|(light, _)| bin_of(light, &centers, axis) < border);
    (0 < middle && middle < items.len()).then_some(middle)
}

fn bin_of(light: &LightBounds, centers: &Aabb, axis: usize) -> usize {
    let position =
        (light.bounds.center()[axis] - centers.min[axis]) / (centers.max[axis] - centers.min[axis]);
    ((position * BINS as f32) as usize).min(BINS - 1)
}

fn merge(a: Option<LightBounds>, b: Option<LightBounds>) -> Option<LightBounds> {
    match (a, b) {
        (Some(a), Some(b)) => Some(a.union(&b)),
        (a, b) => a.or(b),
    }
}
