//! Fences: planes that a record's own rays found inside its area, behind which it must not be used.
//!
//! A record beside a thin wall reaches through it: on the other side lie points of the same plane
//! with the same normal, which no test of distance, normal or position can tell from those on its
//! own side. But the gather has seen the wall. The nearest low hit in each of eight sectors around
//! the normal, if it lies within the record's radius, becomes a plane; a point behind one of them
//! is refused. The idea is that of Radiance's corral, which sends a shadow ray where its flags say
//! that something stands between; here no ray is sent.

use crate::gather::HemisphereSamples;
use crate::math::{Vec3, Vec4};
use std::f32::consts::{FRAC_PI_4, TAU};

/// Hits higher above the tangent plane, by the sine of the elevation, make no fence: what hangs
/// over the record's surface or stands apart from it divides no two points of it.
const HIGHEST: f32 = 0.4;
/// Most fences of one record.
const MOST: usize = 4;
/// A point may lie this share of the record's radius behind a fence: the plane of a curved or a
/// slightly rough surface.
const SLACK: f32 = 1e-3;

/// The fences of one record: planes `xyz·x + w >= 0` on the record's side.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Fences {
    planes: [Vec4; MOST],
    count: u8,
}

impl Fences {
    /// Most fences of one record.
    pub const MOST: usize = MOST;

    /// The fences of the gather `samples` at `position`, whose record reaches as far as `radius`.
    pub fn new(samples: &HemisphereSamples, position: Vec3, radius: f32) -> Self {
        let b = samples.bundle();
        let mut nearest: [Option<usize>; 8] = [None; 8];
        for (k, (w, &r)) in b.dir_local.iter().zip(&b.distance).enumerate() {
            if r < radius && w.z < HIGHEST {
                let sector =
                    &mut nearest[((w.y.atan2(w.x).rem_euclid(TAU) / FRAC_PI_4) as usize).min(7)];
                if sector.is_none_or(|other| r < b.distance[other]) {
                    *sector = Some(k);
                }
            }
        }
        let mut hits: Vec<usize> = nearest.into_iter().flatten().collect();
        hits.sort_by(|&i, &j| b.distance[i].total_cmp(&b.distance[j]).then(i.cmp(&j)));
        let mut fences = Self::default();
        for k in hits {
            let normal = b.normal[k];
            let hit = position + b.distance[k] * samples.frame().to_world(b.dir_local[k]);
            let plane = normal.extend(SLACK * radius - normal.dot(hit));
            let known = fences
                .planes()
                .iter()
                .any(|p| p.truncate().dot(normal) > 0.95 && (p.w - plane.w).abs() < 0.1 * radius);
            if !known && usize::from(fences.count) < MOST {
                fences.planes[usize::from(fences.count)] = plane;
                fences.count += 1;
            }
        }
        fences
    }

    /// Fences at these planes; `None` if they are too many.
    pub(in crate::cache) fn from_planes(planes: &[Vec4]) -> Option<Self> {
        let mut fences = Self { count: planes.len() as u8, ..Self::default() };
        fences.planes.get_mut(..planes.len())?.copy_from_slice(planes);
        Some(fences)
    }

    /// The planes.
    pub fn planes(&self) -> &[Vec4] {
        &self.planes[..usize::from(self.count)]
    }

    /// True if `x` is on the record's side of all of them.
    #[inline]
    pub fn admit(&self, x: Vec3) -> bool {
        self.planes().iter().all(|p| p.truncate().dot(x) + p.w >= 0.0)
    }
}
