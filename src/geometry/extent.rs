//! How far what is seen extends, whatever lies around it.

use super::Geometry;
use crate::math::Vec3;
use crate::sampling::{hash, stream};

/// The extent of what `n` points show, point i being `at(i)`: the middle distance between two of
/// them times 2.125, which for a closed room is about its diagonal. The median over pairs of points
/// does not notice what few of them lie on, be it a ground plane of a hundred kilometres, and
/// neither a motion of the scene nor its unit of length changes what is a share of it. `None` where
/// the points coincide.
pub fn extent(n: usize, at: impl Fn(usize) -> Vec3) -> Option<f32> {
    const PAIRS: usize = 4096;
    const WIDENING: f32 = 2.125;
    let count = n.min(PAIRS);
    let pair = |k: usize| {
        let other = hash(&[k as u64, stream::ORDER]) % n as u64;
        (at(k * n / count) - at(other as usize)).length()
    };
    Some(WIDENING * median_length((0..count).map(pair))?)
}

/// The median of the lengths that are positive and finite.
pub fn median_length(lengths: impl Iterator<Item = f32>) -> Option<f32> {
    let mut lengths: Vec<f32> = lengths.filter(|l| l.is_finite() && *l > 0.0).collect();
    let middle = lengths.len() / 2;
    (!lengths.is_empty()).then(|| *lengths.select_nth_unstable_by(middle, f32::total_cmp).1)
}

impl Geometry {
    /// The [`extent`] of what its triangles show, each of them as much as any other: a ground plane
    /// of two triangles counts little beside the furniture of a room.
    pub fn extent(&self) -> Option<f32> {
        let count = |end: &mut usize, instance: &super::Instance| {
            *end += self.meshes[instance.mesh as usize].indices.len();
            Some(*end)
        };
        let ends: Vec<usize> = self.instances.iter().scan(0, count).collect();
        extent(ends.last().copied().unwrap_or(0), |k| {
            let instance = ends.partition_point(|end| *end <= k);
            let first = instance.checked_sub(1).map_or(0, |before| ends[before]);
            let [a, b, c] = self.triangle(instance as u32, (k - first) as u32);
            (a + b + c) / 3.0
        })
    }
}
