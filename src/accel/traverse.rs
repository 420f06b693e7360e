//! The walk of a ray through a compressed eight-wide hierarchy, after [Ylitie17].
//!
//! The nodes are built by `obvhs`. The walk is our own because its box test must not lose hits: `obvhs` ignores boxes nearer than 1e-4, replaces small
//! direction components, and does not bound rounding errors.

use crate::math::Vec3;
use glam::{Vec3A, Vec4};
use obvhs::cwbvh::node::{CwBvhNode, extract_byte64};

/// Deepest hierarchy that [`traverse`] can walk.
pub const MAX_DEPTH: usize = 64;

/// What the walk needs of a ray beside its end.
#[derive(Clone, Copy)]
pub struct Walker {
    origin: Vec3A,
    inverse: Vec3A,
    tmin: f32,
    /// Which children come first, see [Ylitie17, Sec. 3.1].
    octant: u32,
    negative: [bool; 3],
}

impl Walker {
    /// A walker along `origin + t * dir` for `t >= tmin`.
    #[inline]
    pub fn new(origin: Vec3, dir: Vec3, tmin: f32) -> Self {
        // Beyond this the product with a distance overflows.
        const STEEPEST: f32 = 1e18;
        let negative = [dir.x < 0.0, dir.y < 0.0, dir.z < 0.0];
        let octant = [0x0404_0404, 0x0202_0202, 0x0101_0101].iter().zip(negative).map(|(bits, n)| if n { 0 } else { *bits }).sum();
        let inverse = Vec3A::from(dir).recip().clamp(Vec3A::splat(-STEEPEST), Vec3A::splat(STEEPEST));
        Self { origin: origin.into(), inverse, tmin, octant, negative }
    }

    /// The children of `node` that the segment up to `tmax` may touch, as the bits [Ylitie17] calls a hit mask: inner children in the high byte in the order
    /// of the octant, triangles of leaf children in the lower 24 bits.
    ///
    /// With p the node's corner, e the size of its grid and q a grid coordinate, a plane is met at t = q (e / d) + (p - o) / d. The rounding error of
    /// that is below four units in the last place of the two terms' magnitudes; the interval is widened by it, so a box is never missed.
    #[inline]
    fn children(&self, node: &CwBvhNode, tmax: f32) -> u32 {
        const ROUNDING: f32 = 2.0 * f32::EPSILON;
        let scale = node.compute_extent() * self.inverse;
        let base = (Vec3A::from(node.p) - self.origin) * self.inverse;
        let slack = (255.0 * scale.abs() + base.abs()) * ROUNDING;
        let (near, far) = (base - slack, base + slack);
        let order = |low, high, axis: usize| if self.negative[axis] { (high, low) } else { (low, high) };
        let (x0, x1) = order(&node.child_min_x, &node.child_max_x, 0);
        let (y0, y1) = order(&node.child_min_y, &node.child_max_y, 1);
        let (z0, z1) = order(&node.child_min_z, &node.child_max_z, 2);
        let (bits, index) = node.get_child_and_index_bits(self.octant);
        let mut mask = 0;
        for half in 0..2 {
            let planes = |q: &[u8; 8], scale: f32, base: f32| {
                let q = &q[4 * half..4 * half + 4];
                Vec4::new(f32::from(q[0]), f32::from(q[1]), f32::from(q[2]), f32::from(q[3])) * scale + base
            };
            let enter = planes(x0, scale.x, near.x).max(planes(y0, scale.y, near.y)).max(planes(z0, scale.z, near.z));
            let leave = planes(x1, scale.x, far.x).min(planes(y1, scale.y, far.y)).min(planes(z1, scale.z, far.z));
            let mut touched = enter.max(Vec4::splat(self.tmin)).cmple(leave.min(Vec4::splat(tmax))).bitmask();
            while touched != 0 {
                let child = 4 * half + touched.trailing_zeros() as usize;
                touched &= touched - 1;
                mask |= extract_byte64(bits, child) << extract_byte64(index, child);
            }
        }
        mask
    }
}

/// Calls `leaf` with the number of every primitive whose box the segment touches, near ones first by and large. `leaf` gets the current end of the
/// segment, may shorten it, and ends the walk by returning true.
///
/// `nodes` must not be empty nor deeper than [`MAX_DEPTH`].
#[inline]
pub fn traverse(nodes: &[CwBvhNode], walker: &Walker, tmax: &mut f32, mut leaf: impl FnMut(u32, &mut f32) -> bool) {
    const INNER: u32 = 0xff00_0000;
    let mut stack = [(0_u32, 0_u32); MAX_DEPTH];
    let mut depth = 0;
    // A group is the first child's index with, in the high byte, the children still to visit, in the low byte, which of the slots are inner nodes.
    let mut group = (0_u32, 0x8000_0000_u32);
    loop {
        // Take the nearest child out of the group and keep the others for later.
        let child = 31 - group.1.leading_zeros();
        let slots = group.1;
        group.1 &= !(1 << child);
        if group.1 & INNER != 0 {
            stack[depth] = group;
            depth += 1;
        }
        let slot = (child - 24) ^ (walker.octant & 0xff);
        let node = &nodes[(group.0 + (slots & !(u32::MAX << slot)).count_ones()) as usize];

        // Test its children's boxes, then the triangles in those that are leaves.
        let hit = walker.children(node, *tmax);
        let mut leaves = hit & !INNER;
        while leaves != 0 {
            let i = 31 - leaves.leading_zeros();
            leaves &= !(1 << i);
            if leaf(node.primitive_base_idx + i, tmax) {
                return;
            }
        }
        group = (node.child_base_idx, (hit & INNER) | u32::from(node.imask));
        if group.1 & INNER == 0 {
            if depth == 0 {
                return;
            }
            depth -= 1;
            group = stack[depth];
        }
    }
}

/// Number of levels below and with the root.
pub fn depth(nodes: &[CwBvhNode]) -> usize {
    let mut deepest = 0;
    let mut open = vec![(0_usize, 1_usize)];
    while let Some((i, level)) = open.pop() {
        deepest = deepest.max(level);
        let inner = nodes[i].imask.count_ones() as usize;
        let first = nodes[i].child_base_idx as usize;
        open.extend((first..first + inner).map(|child| (child, level + 1)));
    }
    deepest
}
