//! Boxes -> binary hierarchy -> eight-wide hierarchy.
//!
//! `obvhs` does the second step. Its own builder of the first (PLOC) needs quadratic time and makes
//! a list instead of a tree where many boxes coincide, so this one is ours: top-down, by the binned
//! surface area heuristic. [Wald07, binned SAH]

use super::traverse::{MAX_DEPTH, Node};
use glam::Vec3A;
use obvhs::aabb::Aabb;
use obvhs::bvh2::Bvh2;
use obvhs::bvh2::node::Bvh2Node;
use obvhs::bvh2::reinsertion::ReinsertionOptimizer;
use obvhs::cwbvh::CwBvh;
use obvhs::cwbvh::bvh2_to_cwbvh::bvh2_to_cwbvh;

/// An eight-wide hierarchy.
#[derive(Default)]
pub struct Built {
    /// The nodes, root first; empty if there were no boxes.
    pub nodes: Vec<Node>,
    /// The number of the box at each place in the leaves.
    pub order: Vec<u32>,
}

/// Largest coordinate of a box: sums of areas must not overflow.
pub const LIMIT: f32 = 1e15;

/// Candidates for a split along each axis, and one more.
const BINS: usize = 16;
/// Most primitives of a leaf: a limit of the compressed node.
const LEAF: u32 = 3;
/// Below this many boxes a thread works alone.
const PARALLEL: usize = 4096;
/// Share of the nodes that `obvhs` tries to place better in its first round.
const REINSERTION: f32 = 0.05;

#[derive(Clone, Copy)]
struct Item {
    bounds: Aabb,
    index: u32,
}

impl Item {
    /// Twice the middle of the box.
    fn center(&self) -> Vec3A {
        self.bounds.min + self.bounds.max
    }
}

/// The hierarchy over `bounds`, boxes with `min <= max` inside [`LIMIT`]. The result depends on
/// nothing else.
pub fn build(bounds: &[Aabb]) -> Built {
    if bounds.is_empty() {
        return Built::default();
    }
    let mut items: Vec<_> =
        bounds.iter().zip(0..).map(|(&bounds, index)| Item { bounds, index }).collect();
    let mut nodes = vec![Bvh2Node::default(); 2 * items.len() - 1];
    if let Some((root, rest)) = nodes.split_first_mut() {
        split(&mut items, 0, root, rest, 1, 1);
    }
    let binary = Bvh2 {
        nodes,
        primitive_indices: items.iter().map(|item| item.index).collect(),
        ..Default::default()
    };
    let wide =
        reinserted(binary.clone()).unwrap_or_else(|| bvh2_to_cwbvh(&binary, LEAF, true, false));
    Built { nodes: exact_nodes(&wide, bounds), order: wide.primitive_indices }
}

/// The nodes of `wide` with the boxes of `bounds` in place of its quantised ones.
fn exact_nodes(wide: &CwBvh, bounds: &[Aabb]) -> Vec<Node> {
    let mut boxes = vec![[Aabb::INVALID; 8]; wide.nodes.len()];
    // Children come after their parent, so they are complete when it is their parent's turn.
    for (i, node) in wide.nodes.iter().enumerate().rev() {
        for child in (0..8).filter(|&child| !node.is_child_empty(child)) {
            boxes[i][child] = if node.is_leaf(child) {
                let (first, count) = node.child_primitives(child);
                let leaf = &wide.primitive_indices[first as usize..(first + count) as usize];
                leaf.iter().fold(Aabb::INVALID, |all, &k| all.union(&bounds[k as usize]))
            } else {
                let below = node.child_node_index(child) as usize;
                debug_assert!(below > i);
                boxes[below].iter().fold(Aabb::INVALID, |all, bounds| all.union(bounds))
            };
        }
    }
    wide.nodes.iter().zip(&boxes).map(|(node, children)| Node::new(node, children)).collect()
}

/// The eight-wide hierarchy of `binary` after moving subtrees where they cost less; `None` where
/// that makes it too deep.
fn reinserted(mut binary: Bvh2) -> Option<CwBvh> {
    // Deeper than this, the recursion in the conversion could exhaust a thread's stack.
    const DEEPEST_BINARY: usize = 512;
    ReinsertionOptimizer::default().run(&mut binary, REINSERTION, None);
    let binary_children = |i: usize| {
        let node = &binary.nodes[i];
        let first = node.first_index as usize;
        if node.is_leaf() { first..first } else { first..first + 2 }
    };
    if depth(binary_children) > DEEPEST_BINARY {
        return None;
    }
    let wide = bvh2_to_cwbvh(&binary, LEAF, true, false);
    let wide_children = |i: usize| {
        let first = wide.nodes[i].child_base_idx as usize;
        first..first + wide.nodes[i].imask.count_ones() as usize
    };
    (depth(wide_children) <= MAX_DEPTH).then_some(wide)
}

/// Number of levels of a tree whose root is node 0 and whose node `i` has the inner nodes
/// `children(i)` below it.
fn depth(children: impl Fn(usize) -> std::ops::Range<usize>) -> usize {
    let mut deepest = 0;
    let mut open = vec![(0_usize, 1_usize)];
    while let Some((i, level)) = open.pop() {
        deepest = deepest.max(level);
        open.extend(children(i).map(|child| (child, level + 1)));
    }
    deepest
}

/// Arranges `items`, whose first has number `first` in the leaves, under `root`. `rest` are the `2
/// n - 2` nodes below the root, `rest_index` the number of the first of them; `level` is the
/// root's, from 1.
fn split(
    items: &mut [Item], first: u32, root: &mut Bvh2Node, rest: &mut [Bvh2Node], rest_index: u32,
    level: u32,
) {
    let bounds = items.iter().fold(Aabb::INVALID, |all, item| all.union(&item.bounds));
    if items.len() == 1 {
        *root = Bvh2Node::new(bounds, 1, first);
        return;
    }
    *root = Bvh2Node::new(bounds, 0, rest_index);
    // Halving from here on must end above the deepest level.
    let levels_to_halve = usize::BITS - (items.len() - 1).leading_zeros();
    let by_area =
        if level + levels_to_halve < MAX_DEPTH as u32 { partition_by_area(items) } else { None };
    let middle = by_area.unwrap_or_else(|| partition_by_count(items));

    let (low, high) = items.split_at_mut(middle);
    let (pair, rest) = rest.split_at_mut(2);
    let (left, right) = pair.split_at_mut(1);
    let (low_rest, high_rest) = rest.split_at_mut(2 * low.len() - 2);
    let low_index = rest_index + 2;
    let high_index = low_index + low_rest.len() as u32;
    let parallel = low.len() + high.len() >= PARALLEL;
    let high_first = first + low.len() as u32;
    let mut do_low = || split(low, first, &mut left[0], low_rest, low_index, level + 1);
    let mut do_high = || split(high, high_first, &mut right[0], high_rest, high_index, level + 1);
    if parallel {
        rayon::join(do_low, do_high);
    } else {
        do_low();
        do_high();
    }
}

/// Moves the items of the cheapest split's lower side to the front and returns their number; `None`
/// if all centres coincide.
fn partition_by_area(items: &mut [Item]) -> Option<usize> {
    let (low, high) = items
        .iter()
        .map(Item::center)
        .fold((Vec3A::INFINITY, Vec3A::NEG_INFINITY), |(low, high), center| {
            (low.min(center), high.max(center))
        });
    let extent = high - low;
    // Along a flat axis everything falls into the first bin.
    let scale = Vec3A::select(
        extent.cmpgt(Vec3A::ZERO),
        BINS as f32 * (1.0 - f32::EPSILON) / extent,
        Vec3A::ZERO,
    );
    let scale = Vec3A::select(scale.cmplt(Vec3A::INFINITY), scale, Vec3A::ZERO);
    let bin_of = |item: &Item| {
        ((item.center() - low) * scale).as_uvec3().min(glam::UVec3::splat(BINS as u32 - 1))
    };

    let mut bins = [[(Aabb::INVALID, 0_u32); BINS]; 3];
    for item in &*items {
        let bin = bin_of(item);
        for axis in 0..3 {
            let (bounds, count) = &mut bins[axis][bin[axis] as usize];
            *bounds = bounds.union(&item.bounds);
            *count += 1;
        }
    }

    // The cost of a split is the sum of each side's half area times its count.
    let mut best: Option<(f32, usize, u32)> = None;
    for (axis, bins) in bins.iter().enumerate() {
        let mut above = [(f32::INFINITY, 0); BINS];
        let mut side = (Aabb::INVALID, 0);
        for (i, (bounds, count)) in bins.iter().enumerate().skip(1).rev() {
            side = (side.0.union(bounds), side.1 + count);
            above[i] = (side.0.half_area() * side.1 as f32, side.1);
        }
        let mut side = (Aabb::INVALID, 0);
        for i in 1..BINS {
            side = (side.0.union(&bins[i - 1].0), side.1 + bins[i - 1].1);
            if side.1 == 0 || above[i].1 == 0 {
                continue;
            }
            let cost = side.0.half_area() * side.1 as f32 + above[i].0;
            if best.is_none_or(|(least, ..)| cost < least) {
                best = Some((cost, axis, i as u32));
            }
        }
    }
    let (_, axis, bin) = best?;
    let mut middle = 0;
    for i in 0..items.len() {
        if bin_of(&items[i])[axis] < bin {
            items.swap(i, middle);
            middle += 1;
        }
    }
    Some(middle)
}

/// Moves the lower half of the items along the widest axis to the front and returns their number.
fn partition_by_count(items: &mut [Item]) -> usize {
    let bounds = items.iter().fold(Aabb::INVALID, |all, item| all.union(&item.bounds));
    let size = bounds.max - bounds.min;
    let axis = if size.x >= size.y.max(size.z) {
        0
    } else if size.y >= size.z {
        1
    } else {
        2
    };
    let middle = items.len() / 2;
    items.select_nth_unstable_by(middle, |a, b| {
        a.center()[axis].total_cmp(&b.center()[axis]).then(a.index.cmp(&b.index))
    });
    middle
}

#[cfg(test)]
mod tests {
    use super::*;

    fn boxes(count: usize, at: impl Fn(usize) -> (Vec3A, Vec3A)) -> Vec<Aabb> {
        (0..count).map(at).map(|(a, b)| Aabb::new(a.min(b), a.max(b))).collect()
    }

    #[test]
    fn every_box_is_in_one_leaf() {
        for count in [1, 2, 3, 4, 9, 100, 20_000] {
            let spread = boxes(count, |i| {
                (
                    Vec3A::new(i as f32 % 7.0, (i as f32).sqrt(), (i as f32).sin()),
                    Vec3A::splat(i as f32 % 3.0),
                )
            });
            let same = boxes(count, |_| (Vec3A::ZERO, Vec3A::ONE));
            let nested = boxes(count, |i| (Vec3A::ZERO, Vec3A::new(1.0, 1.0, i as f32)));
            let growing =
                boxes(count, |i| (Vec3A::ZERO, Vec3A::splat(1.5_f32.powi(i as i32 % 80))));
            let points = boxes(count, |i| (Vec3A::splat(i as f32), Vec3A::splat(i as f32)));
            for bounds in [spread, same, nested, growing, points] {
                let built = build(&bounds);
                let mut order = built.order;
                order.sort_unstable();
                assert!(order.iter().copied().eq(0..count as u32), "{count}");
                assert!(!built.nodes.is_empty());
            }
        }
        assert!(build(&[]).nodes.is_empty());
    }
}
