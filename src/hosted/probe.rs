//! The probe that gathers in a hosted scene.

use super::batch::Batch;
use super::exchange::Exchange;
use super::host::Host;
use crate::gather::{Bundle, Deeper, HitKind, RadianceProbe};
use crate::geometry::{MAP_ROUNDING, SurfacePoint};
use crate::math::{Color, INV_PI, Vec2, Vec3};
use crate::progress::Progress;
use crate::sampling::{
    LONGEST_PATH, MAX_SURVIVAL, ROULETTE_AFTER, hash, square_to_cosine_hemisphere, stream, unit_f32,
};

/// Sees the light that the host's tracer answers, and follows paths where no cache knows the
/// indirect light.
pub struct HostProbe<'a> {
    /// The host.
    pub host: &'a Host,
    /// Where the rays are handed in.
    pub exchange: &'a Exchange,
    /// Most surface interactions after the camera hit.
    pub max_bounces: u32,
    /// Cancelled when the host fails.
    pub progress: &'a Progress,
}

/// A surface point of which position, normals, direction to the viewer and footprint are known.
pub fn surface_point(
    position: Vec3, normal: Vec3, ng: Vec3, wo: Vec3, footprint: f32,
) -> SurfacePoint {
    SurfacePoint {
        ng: if ng.dot(normal) < 0.0 { -ng } else { ng },
        wo,
        footprint,
        ..SurfacePoint::plain(position, normal)
    }
}

/// A path of one ray of the bundle.
struct Path {
    ray: usize,
    origin: Vec3,
    dir: Vec3,
    weight: Color,
    seed: u64,
}

impl Path {
    /// The path that leaves `from` in the direction `local`.
    fn new(ray: usize, from: &SurfacePoint, local: Vec3, weight: Color, seed: u64) -> Self {
        let dir = from.frame.to_world(local);
        Self { ray, origin: from.leave(dir), dir, weight, seed }
    }

    /// False if the path leaves `from` to the inside: a bent shading normal sends some there.
    fn is_outside(&self, from: &SurfacePoint) -> bool {
        self.dir.dot(from.ng) > 0.0
    }
}

fn cosine_direction(seed: u64) -> Vec3 {
    let numbers = Vec2::new(unit_f32(seed as u32), unit_f32((seed >> 32) as u32));
    square_to_cosine_hemisphere(numbers)
}

impl HostProbe<'_> {
    fn trace(&self, paths: &[Path], bounces: u32) -> Option<Batch> {
        let mut batch = Batch::default();
        for p in paths {
            batch.push(p.origin, p.dir, bounces, hash(&[p.seed, stream::HOST_RAY]));
        }
        let answers = self.exchange.ask(batch);
        if answers.is_none() {
            self.progress.cancel();
        }
        answers
    }

    /// The hit of path `p`, answer `i`, as a point; the normal faces the ray.
    fn hit(&self, p: &Path, answers: &Batch, i: usize) -> SurfacePoint {
        let n = answers.normal[i];
        let n = if n.dot(p.dir) > 0.0 { -n } else { n };
        let distance = answers.distance[i];
        let error = MAP_ROUNDING * (p.origin.abs().max_element() + distance);
        let position = p.origin + distance * p.dir;
        SurfacePoint { error, ..surface_point(position, n, n, -p.dir, 0.0) }
    }

    /// The points with a diffuse lobe that cosine-distributed rays from `points` meet: `count`
    /// rays, spread evenly over the points. None where the host answers light of all bounces:
    /// deeper levels have no use then.
    pub(super) fn meet(
        &self, points: &[SurfacePoint], count: usize, bounces: u32, seed: u64,
    ) -> Vec<SurfacePoint> {
        if points.is_empty() || self.host.all_bounces {
            return Vec::new();
        }
        let path = |k: usize| {
            let (seed, from) = (hash(&[seed, k as u64]), &points[k * points.len() / count]);
            let path = Path::new(k, from, cosine_direction(seed), Color::ONE, seed);
            path.is_outside(from).then_some(path)
        };
        let paths: Vec<Path> = (0..count).filter_map(path).collect();
        let Some(answers) = self.trace(&paths, bounces) else { return Vec::new() };
        let is_diffuse =
            |i: &usize| answers.distance[*i] < f32::INFINITY && answers.albedo[*i] != Color::ZERO;
        (0..paths.len()).filter(is_diffuse).map(|i| self.hit(&paths[i], &answers, i)).collect()
    }
}

impl RadianceProbe for HostProbe<'_> {
    fn incoming(&self, from: &SurfacePoint, level: u8, deeper: &dyn Deeper, bundle: &mut Bundle) {
        let path = |k: usize| {
            let seed = hash(&[bundle.seed, k as u64]);
            Path::new(k, from, bundle.dir_local[k], Color::ONE, seed)
        };
        let mut paths: Vec<Path> =
            (0..bundle.len()).map(path).filter(|p| p.is_outside(from)).collect();
        let first = u32::from(level) + 1;
        let longest = self.max_bounces.min(LONGEST_PATH);
        let mut bounces = first;
        while !paths.is_empty() {
            let Some(answers) = self.trace(&paths, bounces) else { return };
            let mut on = Vec::new();
            for (i, p) in paths.iter().enumerate() {
                let radiance = p.weight * answers.radiance[i];
                if answers.distance[i] == f32::INFINITY {
                    if bounces == first {
                        bundle.kind[p.ray] = HitKind::Environment;
                    }
                    if self.host.environment {
                        bundle.radiance[p.ray] += radiance;
                    }
                    continue;
                }
                let at = self.hit(p, &answers, i);
                if bounces == first {
                    bundle.kind[p.ray] = HitKind::Surface;
                    bundle.distance[p.ray] = answers.distance[i];
                    bundle.normal[p.ray] = at.ng;
                }
                if bounces <= self.max_bounces {
                    bundle.radiance[p.ray] += radiance;
                }
                let mut weight = p.weight * answers.albedo[i];
                if self.host.all_bounces || bounces >= longest || weight == Color::ZERO {
                    continue;
                }
                let level = u8::try_from(bounces).unwrap_or(u8::MAX);
                if let Some(e) = deeper.irradiance(level, &at) {
                    bundle.radiance[p.ray] += weight * e * INV_PI;
                    continue;
                }
                let seed = hash(&[p.seed, u64::from(bounces), stream::HOST_VERTEX]);
                if bounces >= ROULETTE_AFTER {
                    let survival = weight.max_element().min(MAX_SURVIVAL);
                    if unit_f32(hash(&[seed, stream::HOST_ROULETTE]) as u32) >= survival {
                        continue;
                    }
                    weight /= survival;
                }
                on.push(Path::new(p.ray, &at, cosine_direction(seed), weight, seed));
            }
            paths = on;
            bounces += 1;
        }
    }
}
