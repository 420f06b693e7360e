//! The gather's view of a host.

use super::host::{Answers, Exchange, Host, Rays};
use crate::gather::{Bundle, Deeper, HitKind, RadianceProbe};
use crate::geometry::{SurfacePoint, offset_origin};
use crate::math::{Color, INV_PI, Vec2, Vec3};
use crate::progress::Progress;
use crate::sampling::{
    LONGEST_PATH, MAX_SURVIVAL, ROULETTE_AFTER, hash, square_to_cosine_hemisphere, unit_f32,
};

/// Sees what the host's tracer shows, and goes on behind it where no cache knows the indirect
/// light.
pub(super) struct HostProbe<'a> {
    pub host: &'a Host,
    pub exchange: &'a Exchange,
    /// Most surface interactions after the camera hit.
    pub max_bounces: u32,
    /// Footprint of points that the camera does not see.
    pub footprint: f32,
    /// Stopped when the host fails.
    pub progress: &'a Progress,
}

/// A surface point of which no more is known than where it is and how it lies.
pub(super) fn surface_point(
    position: Vec3,
    normal: Vec3,
    ng: Vec3,
    wo: Vec3,
    footprint: f32,
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

impl HostProbe<'_> {
    fn trace(&self, paths: &[Path], bounces: u32) -> Option<Answers> {
        let mut rays = Rays::default();
        for p in paths {
            rays.push(p.origin, p.dir, bounces, hash(&[p.seed, 0]));
        }
        let answers = self.exchange.ask(rays);
        if answers.is_none() {
            self.progress.cancel();
        }
        answers
    }

    /// The hit of path `p`, answer `i`, as a point; the normal faces the ray.
    fn hit(&self, p: &Path, answers: &Answers, i: usize) -> SurfacePoint {
        let n = answers.normal[i];
        let n = if n.dot(p.dir) > 0.0 { -n } else { n };
        surface_point(p.origin + answers.distance[i] * p.dir, n, n, -p.dir, self.footprint)
    }

    /// The points with a diffuse lobe that cosine-distributed rays from `points` meet: `count`
    /// rays, spread evenly over the points.
    pub fn next_points(
        &self,
        points: &[SurfacePoint],
        count: usize,
        bounces: u32,
        seed: u64,
    ) -> Vec<SurfacePoint> {
        if points.is_empty() {
            return Vec::new();
        }
        let from = |k: usize| &points[k * points.len() / count];
        let paths: Vec<Path> = (0..count)
            .filter_map(|k| {
                let seed = hash(&[seed, k as u64]);
                let at = from(k);
                let dir = at.frame.to_world(square_to_cosine_hemisphere(numbers(seed)));
                let origin = offset_origin(at.position, at.ng, dir);
                (dir.dot(at.ng) > 0.0).then_some(Path {
                    ray: k,
                    origin,
                    dir,
                    weight: Color::ONE,
                    seed,
                })
            })
            .collect();
        let Some(answers) = self.trace(&paths, bounces) else { return Vec::new() };
        let hits =
            |i: &usize| answers.distance[*i] < f32::INFINITY && answers.albedo[*i] != Color::ZERO;
        (0..paths.len()).filter(hits).map(|i| self.hit(&paths[i], &answers, i)).collect()
    }
}

fn numbers(seed: u64) -> Vec2 {
    Vec2::new(unit_f32(seed as u32), unit_f32((seed >> 32) as u32))
}

impl RadianceProbe for HostProbe<'_> {
    fn incoming(&self, from: &SurfacePoint, level: u8, deeper: &dyn Deeper, bundle: &mut Bundle) {
        let mut paths: Vec<Path> = (0..bundle.len())
            .filter_map(|k| {
                let dir = from.frame.to_world(bundle.dir_local[k]);
                let origin = offset_origin(from.position, from.ng, dir);
                let seed = hash(&[bundle.seed, k as u64]);
                (dir.dot(from.ng) > 0.0).then_some(Path {
                    ray: k,
                    origin,
                    dir,
                    weight: Color::ONE,
                    seed,
                })
            })
            .collect();
        let first = u32::from(level) + 1;
        let mut bounces = first;
        while !paths.is_empty() {
            let Some(answers) = self.trace(&paths, bounces) else { return };
            let mut on = Vec::new();
            for (i, p) in paths.iter().enumerate() {
                let hit = answers.distance[i] < f32::INFINITY;
                if bounces == first {
                    bundle.kind[p.ray] = if hit { HitKind::Surface } else { HitKind::Environment };
                }
                if !hit {
                    if self.host.has_environment() {
                        bundle.radiance[p.ray] += p.weight * answers.radiance[i];
                    }
                    continue;
                }
                let at = self.hit(p, &answers, i);
                if bounces == first {
                    bundle.distance[p.ray] = answers.distance[i];
                    bundle.normal[p.ray] = at.ng;
                }
                if bounces > self.max_bounces {
                    continue;
                }
                bundle.radiance[p.ray] += p.weight * answers.radiance[i];
                let weight = p.weight * answers.albedo[i];
                if self.host.is_full()
                    || bounces >= self.max_bounces
                    || bounces >= LONGEST_PATH
                    || weight == Color::ZERO
                {
                    continue;
                }
                let level = u8::try_from(bounces).unwrap_or(u8::MAX);
                if let Some(e) = deeper.irradiance(level, &at) {
                    bundle.radiance[p.ray] += weight * e * INV_PI;
                    continue;
                }
                let seed = hash(&[p.seed, u64::from(bounces), 1]);
                let mut path =
                    Path { ray: p.ray, origin: at.position, dir: Vec3::ZERO, weight, seed };
                if bounces >= ROULETTE_AFTER {
                    let survival = weight.max_element().min(MAX_SURVIVAL);
                    if unit_f32(hash(&[seed, 2]) as u32) >= survival {
                        continue;
                    }
                    path.weight /= survival;
                }
                path.dir = at.frame.to_world(square_to_cosine_hemisphere(numbers(seed)));
                path.origin = offset_origin(at.position, at.ng, path.dir);
                on.push(path);
            }
            paths = on;
            bounces += 1;
        }
    }
}
