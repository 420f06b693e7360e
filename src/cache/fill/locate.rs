//! Which shading points lie in a record's area: a bounding volume hierarchy over points that never
//! move.

use crate::geometry::{Aabb, SurfacePoint};
use crate::math::Vec3;
use rayon::prelude::*;

/// Points per leaf.
const LEAF: usize = 16;
/// Bits of each coordinate in the order along which points are laid out.
const BITS: u32 = 21;

/// The points along a space-filling curve, with the bounds of the implicit binary tree over runs of
/// [`LEAF`] of them: node 0 covers everything, node i's halves are 2i+1 and 2i+2.
pub struct Locator {
    positions: Vec<Vec3>,
    ids: Vec<u32>,
    nodes: Vec<Aabb>,
    leaves: usize,
}

impl Locator {
    /// The tree of `points`; their numbers are their ids.
    pub fn build(points: &[SurfacePoint]) -> Self {
        let bounds = points.iter().fold(Aabb::EMPTY, |b, p| b.with(p.position));
        let scale =
            (1 << BITS) as f32 / (bounds.max - bounds.min).max_element().max(f32::MIN_POSITIVE);
        let mut order: Vec<(u64, u32)> = points
            .par_iter()
            .enumerate()
            .map(|(id, p)| {
                (
                    morton(((p.position - bounds.min) * scale).to_array().map(|x| x as u32)),
                    id as u32,
                )
            })
            .collect();
        order.par_sort_unstable();
        let ids: Vec<u32> = order.into_iter().map(|(_, id)| id).collect();
        let positions: Vec<Vec3> = ids.iter().map(|&id| points[id as usize].position).collect();
        let leaves = positions.len().div_ceil(LEAF).next_power_of_two();
        let mut nodes = vec![Aabb::EMPTY; 2 * leaves - 1];
        for (leaf, run) in positions.chunks(LEAF).enumerate() {
            nodes[leaves - 1 + leaf] = run.iter().fold(Aabb::EMPTY, |b, &p| b.with(p));
        }
        for node in (0..leaves - 1).rev() {
            nodes[node] = nodes[2 * node + 1].union(nodes[2 * node + 2]);
        }
        Self { positions, ids, nodes, leaves }
    }

    /// Calls `visit` with the id of every point within `radius` of `center`, in an order that
    /// depends on nothing but the points.
    pub fn within(&self, center: Vec3, radius: f32, mut visit: impl FnMut(u32)) {
        let r2 = radius * radius;
        let mut stack = vec![0];
        while let Some(node) = stack.pop() {
            let b = &self.nodes[node];
            if b.is_empty()
                || (b.min - center).max(center - b.max).max(Vec3::ZERO).length_squared() > r2
            {
                continue;
            }
            if node + 1 < self.leaves {
                stack.extend([2 * node + 2, 2 * node + 1]);
                continue;
            }
            let first = (node + 1 - self.leaves) * LEAF;
            let last = self.positions.len().min(first + LEAF);
            for (p, &id) in self.positions[first..last].iter().zip(&self.ids[first..last]) {
                if p.distance_squared(center) <= r2 {
                    visit(id);
                }
            }
        }
    }
}

/// The bits of three coordinates interleaved.
fn morton(coordinates: [u32; 3]) -> u64 {
    let spread = |x: u32| {
        let mut x = u64::from(x.min((1 << BITS) - 1));
        x = (x | x << 32) & 0x001f_0000_0000_ffff;
        x = (x | x << 16) & 0x001f_0000_ff00_00ff;
        x = (x | x << 8) & 0x100f_00f0_0f00_f00f;
        x = (x | x << 4) & 0x10c3_0c30_c30c_30c3;
        (x | x << 2) & 0x1249_2492_4924_9249
    };
    let [x, y, z] = coordinates.map(spread);
    x | y << 1 | z << 2
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sampling::Rng;

    fn point(position: Vec3) -> SurfacePoint {
        SurfacePoint::plain(position, Vec3::Z)
    }

    #[test]
    fn finds_what_a_search_of_all_points_finds() {
        let mut rng = Rng::new(8);
        for count in [0, 1, 16, 17, 100, 3000] {
            let mut random =
                || Vec3::new(rng.next_f32(), 3.0 * rng.next_f32(), (rng.next_f32() * 2.0).floor());
            let points: Vec<_> = (0..count).map(|_| point(random())).collect();
            let locator = Locator::build(&points);
            for _ in 0..100 {
                let (center, radius) = (random(), random().x.powi(2));
                let mut found = Vec::new();
                locator.within(center, radius, |id| found.push(id));
                found.sort_unstable();
                let inside = |id: &u32| {
                    points[*id as usize].position.distance_squared(center) <= radius * radius
                };
                let expected: Vec<u32> = (0..count).filter(inside).collect();
                assert_eq!(found, expected);
            }
        }
    }

    #[test]
    fn coincident_points_are_all_found() {
        let points = vec![point(Vec3::ONE); 40];
        let mut found = 0;
        Locator::build(&points).within(Vec3::ONE, 0.0, |_| found += 1);
        assert_eq!(found, 40);
    }
}
