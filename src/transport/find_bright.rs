//! Where the small bright surfaces are that [`super::bright`] sends rays to.

use super::bdpt::FirstHits;
use super::bright::{Bright, Patch};
use super::focus::Seen;
use super::path::PathTracer;
use crate::geometry::{Aabb, SurfacePoint};
use crate::math::Vec3;
use crate::sampling::{hash, stream};
use rayon::prelude::*;

/// Light paths are traced in batches of so many ...
const BATCH: u32 = 2048;
/// ... until so many have lit what the points see ...
const ENOUGH: usize = 1024;
/// ... or there are so many of them.
const MOST: u32 = 1 << 16;
/// Clusters of fewer hits are not told apart.
const FEWEST: usize = 8;
/// Two clusters become one unless they are so much more concentrated apart.
const APART: f32 = 2.0;
/// A ball reaches so far beyond the hits that were found.
const MARGIN: f32 = 1.05;
/// Around each cluster some rays go to a ball so many times wider, for faint edges that no light
/// path found are still far brighter than all else ...
const HALO: f32 = 3.0;
/// ... as if the cluster reflected this share of its light from there.
const HALO_SHARE: f32 = 0.2;
/// Radius of the smallest ball as a share of the extent of what is lit.
const SMALLEST: f32 = 1e-5;
/// Points from which the clusters are looked at.
const VIEWPOINTS: usize = 64;
/// Rays of a gather for which noise is reckoned.
const RAYS: f32 = 512.0;
/// Clusters that bring less variance than this to a gather, its irradiance being 1, need no rays of
/// their own: the rays of its strata find them.
const VARIANCE: f32 = 0.02;
/// The brightest so many clusters get rays.
const PATCHES: usize = 32;

/// A place that light reaches straight from a lamp, or by mirrors and panes.
#[derive(Clone, Copy)]
struct Lit {
    point: SurfacePoint,
    position: Vec3,
    normal: Vec3,
    /// The flux that it reflects.
    flux: f32,
}

/// The bright surfaces that light up what lies around `points`, which show `seen`, without those
/// that gathers find easily.
pub(super) fn find_bright(
    tracer: PathTracer, points: &[SurfacePoint], seen: Option<Seen>, seed: u64,
) -> Bright {
    if points.is_empty() || tracer.max_bounces == 0 || tracer.scene.lights().is_empty() {
        return Bright::default();
    }
    let seed = hash(&[seed, stream::BRIGHT]);
    let walks = FirstHits::new(tracer, seen.map(|seen| seen.focus));
    let lit = |number: u32| {
        let (vertex, flux) = walks.trace(seed, number)?;
        let words = hash(&[seed, u64::from(number)]);
        // What no point sees, such as the ground around a house, lights nothing up.
        let from = &points[(words % points.len() as u64) as usize];
        let offset = vertex.position - from.position;
        let faces = offset.dot(from.ng) > 0.0 && offset.dot(vertex.ng) < 0.0;
        (flux > 0.0 && faces && !tracer.scene.occluded(&tracer.scene.between(from, &vertex), words))
            .then_some(Lit { point: vertex, position: vertex.position, normal: vertex.ng, flux })
    };
    let mut found: Vec<Lit> = Vec::new();
    for first in (0..MOST).step_by(BATCH as usize) {
        found.par_extend((first..first + BATCH).into_par_iter().filter_map(lit));
        if found.len() >= ENOUGH {
            break;
        }
    }
    let extent = seen.map_or(f32::MIN_POSITIVE, |seen| seen.extent);
    let lit = found.iter().map(|l| l.point).collect();
    let mut patches = clusters(&mut found, SMALLEST * extent);
    let needed = variances(&patches, points);
    let mut order: Vec<usize> = (0..patches.len()).filter(|&k| needed[k] > VARIANCE).collect();
    order.sort_by(|&a, &b| needed[b].total_cmp(&needed[a]));
    order.truncate(PATCHES);
    patches = order.into_iter().map(|k| patches[k]).collect();
    patches.extend(patches.clone().into_iter().map(|p| Patch {
        radius: HALO * p.radius,
        flux: HALO_SHARE * p.flux,
        ..p
    }));
    Bright { patches, lit }
}

/// Balls around hits that lie close together.
///
/// The hits are halved again and again, and halves are joined again unless that makes them much
/// less concentrated: unless `Σ flux²/area`, the variance of rays that meet areas by chance, falls
/// by [`APART`]. So an evenly lit surface is one cluster, and a spot on it is another.
fn clusters(lit: &mut [Lit], smallest: f32) -> Vec<Patch> {
    if lit.is_empty() {
        return Vec::new();
    }
    let whole = ball(lit, smallest);
    if lit.len() < 2 * FEWEST {
        return vec![whole];
    }
    let size = whole_box(lit);
    let axis = (size.max - size.min).max_position();
    let middle = lit.len() / 2;
    lit.select_nth_unstable_by(middle, |a, b| a.position[axis].total_cmp(&b.position[axis]));
    let (low, high) = lit.split_at_mut(middle);
    let mut parts = clusters(low, smallest);
    parts.extend(clusters(high, smallest));
    let concentration = |p: &Patch| p.flux * p.flux / p.area();
    let apart: f32 = parts.iter().map(concentration).sum();
    if apart <= APART * concentration(&whole) { vec![whole] } else { parts }
}

fn whole_box(lit: &[Lit]) -> Aabb {
    lit.iter().fold(Aabb::EMPTY, |sum, l| sum.with(l.position))
}

/// The ball around hits.
fn ball(lit: &[Lit], smallest: f32) -> Patch {
    let bounds = whole_box(lit);
    let center = bounds.center();
    let radius = lit.iter().map(|l| l.position.distance_squared(center)).fold(0.0, f32::max).sqrt();
    let flux = lit.iter().map(|l| l.flux).sum::<f32>();
    let normal = lit.iter().map(|l| l.flux * l.normal).sum::<Vec3>() / flux;
    Patch { center, radius: (MARGIN * radius).max(smallest), normal, flux }
}

/// For each patch the variance that it brings to a gather of [`RAYS`] rays whose irradiance is 1,
/// the mean over `points`.
fn variances(patches: &[Patch], points: &[SurfacePoint]) -> Vec<f32> {
    let mut sums = vec![0.0; patches.len()];
    let count = VIEWPOINTS.min(points.len());
    for k in 0..count {
        let at = &points[k * points.len() / count];
        let seen: Vec<(f32, f32)> =
            patches.iter().map(|p| p.seen_from(at.position, Some(at.ng))).collect();
        let all = seen.iter().map(|(weight, _)| weight).sum::<f32>().max(f32::MIN_POSITIVE);
        for ((sum, (weight, wide)), patch) in sums.iter_mut().zip(seen).zip(patches) {
            // The share of cosine-distributed rays that meet it.
            let cos = (patch.center - at.position).normalize_or(at.ng).dot(at.ng).max(0.1);
            let hit = (2.0 * wide * cos).min(1.0);
            *sum += (weight / all).powi(2) / (RAYS * hit) / count as f32;
        }
    }
    sums
}
