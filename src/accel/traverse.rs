//! The walk of a ray through an eight-wide hierarchy, after [Ylitie17, octant-based traversal
//! order].
//!
//! `obvhs` arranges the nodes; the walk is our own because its box test must not lose hits: `obvhs`
//! ignores boxes nearer than 1e-4, replaces small direction components, and does not bound rounding
//! errors, neither here nor when it packs boxes into bytes. Our nodes have the exact boxes, which
//! costs memory and saves a third of the time.

use crate::math::Vec3;
use glam::Vec4;
use obvhs::aabb::Aabb;
use obvhs::cwbvh::node::CwBvhNode;

/// Deepest hierarchy that [`traverse`] can walk.
pub const MAX_DEPTH: usize = 64;

/// Eight children with their boxes.
#[derive(Clone, Copy, Debug)]
#[repr(C, align(16))]
pub struct Node {
    /// Planes of the children's boxes: lowest and highest x, lowest and highest y, lowest and
    /// highest z.
    planes: [[f32; 8]; 6],
    /// Index of the first inner child; the others follow it.
    first_child: u32,
    /// Number of the first primitive in the leaves among the children; the others follow it.
    first_primitive: u32,
    /// Of a leaf: first primitive beyond `first_primitive` in the low five bits, and a set bit for
    /// each primitive in the high three.
    leaves: [u8; 8],
    /// Which children are inner nodes.
    inner: u8,
}

impl Node {
    /// The node as `packed` arranges it, with the given boxes of its children; empty ones where
    /// there is no child.
    pub fn new(packed: &CwBvhNode, children: &[Aabb; 8]) -> Self {
        let plane = |k: usize| {
            children.map(
                |bounds| if k.is_multiple_of(2) { bounds.min[k / 2] } else { bounds.max[k / 2] },
            )
        };
        Self {
            planes: std::array::from_fn(plane),
            first_child: packed.child_base_idx,
            first_primitive: packed.primitive_base_idx,
            leaves: packed.child_meta,
            inner: packed.imask,
        }
    }
}

/// What the walk needs of a ray beside its end.
#[derive(Clone, Copy)]
pub struct Walker {
    origin: [Vec4; 3],
    inverse: [Vec4; 3],
    /// For each axis, where [`Node::planes`] has the planes that the ray meets first.
    near: [usize; 3],
    tmin: f32,
    /// The order of children: number `i` is visited in the order of `i ^ octant`, highest first.
    /// [Ylitie17, octant-based traversal order]
    octant: u32,
}

impl Walker {
    /// A walker along `origin + t * dir` for `t >= tmin`.
    #[inline]
    pub fn new(origin: Vec3, dir: Vec3, tmin: f32) -> Self {
        // Beyond this the product with a distance overflows.
        const STEEPEST: f32 = 1e18;
        let inverse = dir.recip().clamp(Vec3::splat(-STEEPEST), Vec3::splat(STEEPEST));
        // Of the inverse: a direction of -0 has one of -1e18.
        let negative = [inverse.x < 0.0, inverse.y < 0.0, inverse.z < 0.0];
        Self {
            origin: origin.to_array().map(Vec4::splat),
            inverse: inverse.to_array().map(Vec4::splat),
            near: [
                usize::from(negative[0]),
                2 + usize::from(negative[1]),
                4 + usize::from(negative[2]),
            ],
            tmin,
            octant: u32::from(!negative[0]) << 2
                | u32::from(!negative[1]) << 1
                | u32::from(!negative[2]),
        }
    }

    /// The children of `node` that the segment up to `tmax` may touch: inner children in the high
    /// byte in the order of their visit, primitives of leaf children in the lower 24 bits.
    ///
    /// A distance has three roundings, so intervals that are longer by [Ize13, robust traversal]'s
    /// factor miss no box.
    #[inline]
    fn children(&self, node: &Node, tmax: f32) -> u32 {
        const LONGER: f32 = 1.0 + 3.0 * f32::EPSILON;
        let mut mask = 0;
        for half in [0, 4] {
            let meet = |plane: usize, axis: usize| {
                (Vec4::from_slice(&node.planes[plane][half..half + 4]) - self.origin[axis])
                    * self.inverse[axis]
            };
            let enter = |axis: usize| meet(self.near[axis], axis);
            let leave = |axis: usize| meet(self.near[axis] ^ 1, axis);
            let first = enter(0).max(enter(1)).max(enter(2)).max(Vec4::splat(self.tmin));
            let last = leave(0).min(leave(1)).min(leave(2)) * LONGER;
            let mut touched = first.cmple(last.min(Vec4::splat(tmax))).bitmask();
            while touched != 0 {
                let child = half as u32 + touched.trailing_zeros();
                touched &= touched - 1;
                mask |= if u32::from(node.inner) >> child & 1 != 0 {
                    1 << (24 + (child ^ self.octant))
                } else {
                    let leaf = u32::from(node.leaves[child as usize]);
                    (leaf >> 5) << (leaf & 31)
                };
            }
        }
        mask
    }
}

/// Calls `leaf` with the number of every primitive whose box the segment touches, near ones first
/// by and large. `leaf` gets the current end of the segment, may shorten it, and ends the walk by
/// returning true.
///
/// `nodes` must not be empty nor deeper than [`MAX_DEPTH`].
#[inline]
pub fn traverse(
    nodes: &[Node], walker: &Walker, tmax: &mut f32, mut leaf: impl FnMut(u32, &mut f32) -> bool,
) {
    const INNER: u32 = 0xff00_0000;
    let mut stack = [(0_u32, 0_u32); MAX_DEPTH];
    let mut depth = 0;
    // A group is the index of a node's first inner child with, in the high byte, the children still
    // to visit, in the low byte, which are inner nodes.
    let mut group = (0_u32, 0x8000_0000_u32);
    loop {
        // Take the nearest child out of the group and keep the others for later.
        let visit = 31 - group.1.leading_zeros();
        let inner = group.1;
        group.1 &= !(1 << visit);
        if group.1 & INNER != 0 {
            stack[depth] = group;
            depth += 1;
        }
        let child = (visit - 24) ^ walker.octant;
        let node = &nodes[(group.0 + (inner & !(u32::MAX << child)).count_ones()) as usize];

        // Test its children's boxes, then the primitives in those that are leaves.
        let hit = walker.children(node, *tmax);
        let mut primitives = hit & !INNER;
        while primitives != 0 {
            let i = 31 - primitives.leading_zeros();
            primitives &= !(1 << i);
            if leaf(node.first_primitive + i, tmax) {
                return;
            }
        }
        group = (node.first_child, (hit & INNER) | u32::from(node.inner));
        if group.1 & INNER == 0 {
            if depth == 0 {
                return;
            }
            depth -= 1;
            group = stack[depth];
        }
    }
}
