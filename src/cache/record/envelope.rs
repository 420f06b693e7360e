//! The lower envelope `min_j (R_j + |x - x_j|)` of all records: the largest field below every R_j
//! that changes by at most one unit per unit of distance.

use crate::geometry::Aabb;
use crate::math::Vec3;

/// One record as the envelope sees it.
#[derive(Clone, Copy)]
struct Site {
    position: Vec3,
    length: f32,
    id: u32,
}

/// What is known of a range of sites.
struct Bounds {
    bounds: Aabb,
    shortest: f32,
}

/// The sites in leaf order with the bounds of a balanced tree over them; queries are
/// nearest-neighbour searches with additive weights.
pub struct Envelope {
    sites: Vec<Site>,
    /// Bounds of the implicit tree's nodes: node 0 covers everything, node i's halves are 2i+1 and
    /// 2i+2.
    nodes: Vec<Bounds>,
    depth: u32,
}

/// A site and its value at the point asked about.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Nearest {
    /// `R_j + |x - x_j|`.
    pub value: f32,
    /// j.
    pub id: u32,
}

const NOBODY: Nearest = Nearest { value: f32::INFINITY, id: u32::MAX };
/// Sites per leaf, about.
const LEAF: usize = 8;

impl Envelope {
    /// The envelope of `(position, length)` pairs; their numbers are their ids.
    pub fn build(sites: impl Iterator<Item = (Vec3, f32)>) -> Self {
        let mut sites: Vec<_> = sites
            .enumerate()
            .map(|(id, (position, length))| Site { position, length, id: id as u32 })
            .collect();
        let depth = (sites.len().div_ceil(LEAF)).next_power_of_two().trailing_zeros();
        let mut nodes = Vec::new();
        nodes.resize_with((1 << (depth + 1)) - 1, || Bounds {
            bounds: Aabb::EMPTY,
            shortest: f32::INFINITY,
        });
        Self::arrange(&mut sites, &mut nodes, 0, depth);
        Self { sites, nodes, depth }
    }

    fn arrange(sites: &mut [Site], nodes: &mut [Bounds], node: usize, depth: u32) {
        for s in sites.iter() {
            nodes[node].bounds = nodes[node].bounds.with(s.position);
            nodes[node].shortest = nodes[node].shortest.min(s.length);
        }
        if depth > 0 {
            let size = nodes[node].bounds.max - nodes[node].bounds.min;
            let axis = if size.x >= size.y && size.x >= size.z {
                0
            } else {
                usize::from(size.z > size.y) + 1
            };
            let middle = sites.len() / 2;
            if middle > 0 {
                sites.select_nth_unstable_by(middle, |a, b| {
                    a.position[axis].total_cmp(&b.position[axis]).then(a.id.cmp(&b.id))
                });
            }
            let (low, high) = sites.split_at_mut(middle);
            Self::arrange(low, nodes, 2 * node + 1, depth - 1);
            Self::arrange(high, nodes, 2 * node + 2, depth - 1);
        }
    }

    /// The two sites with the lowest values at `x`, lowest first; ids `u32::MAX` with infinite
    /// values where there are fewer.
    pub fn lowest_two(&self, x: Vec3) -> [Nearest; 2] {
        let mut best = [NOBODY; 2];
        self.search(x, 0, 0, self.sites.len(), self.depth, &mut best);
        best
    }

    /// The envelope's value at `x`, infinite without sites.
    pub fn value(&self, x: Vec3) -> f32 {
        self.lowest_two(x)[0].value
    }

    fn search(
        &self, x: Vec3, node: usize, first: usize, last: usize, depth: u32, best: &mut [Nearest; 2],
    ) {
        if self.lower_bound(x, node) >= best[1].value {
            return;
        }
        if depth == 0 {
            for s in &self.sites[first..last] {
                let found = Nearest { value: s.length + (x - s.position).length(), id: s.id };
                if found.value < best[0].value {
                    *best = [found, best[0]];
                } else if found.value < best[1].value {
                    best[1] = found;
                }
            }
            return;
        }
        let middle = first + (last - first) / 2;
        let (low, high) = (2 * node + 1, 2 * node + 2);
        if self.lower_bound(x, low) <= self.lower_bound(x, high) {
            self.search(x, low, first, middle, depth - 1, best);
            self.search(x, high, middle, last, depth - 1, best);
        } else {
            self.search(x, high, middle, last, depth - 1, best);
            self.search(x, low, first, middle, depth - 1, best);
        }
    }

    fn lower_bound(&self, x: Vec3, node: usize) -> f32 {
        let n = &self.nodes[node];
        if n.bounds.is_empty() {
            return f32::INFINITY;
        }
        n.shortest + (n.bounds.min - x).max(x - n.bounds.max).max(Vec3::ZERO).length()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sampling::Rng;

    #[test]
    fn agrees_with_brute_force() {
        let mut rng = Rng::new(4);
        for count in [0, 1, 2, 7, 8, 9, 100, 1000] {
            let mut point =
                || Vec3::new(rng.next_f32(), rng.next_f32(), (rng.next_f32() * 3.0).floor());
            let sites: Vec<_> = (0..count).map(|_| (point(), point().x)).collect();
            let envelope = Envelope::build(sites.iter().copied());
            for _ in 0..200 {
                let x = point();
                let mut values: Vec<_> = sites.iter().map(|(p, r)| r + (x - *p).length()).collect();
                values.sort_by(f32::total_cmp);
                let best = envelope.lowest_two(x);
                values.extend([f32::INFINITY; 2]);
                assert_eq!(best.map(|n| n.value), [values[0], values[1]]);
            }
        }
    }
}
