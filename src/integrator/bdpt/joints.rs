//! Light paths joined with the point of a gather, so that one sample of it has several sources [Ribardiere11, Fig. 1].

use super::vertex::Vertex;
use crate::accel::Ray;
use crate::gather::{Bundle, Joint};
use crate::geometry::{SurfacePoint, offset_origin};
use crate::integrator::path::{LONGEST_PATH, MAX_SURVIVAL, PathTracer, ROULETTE_AFTER, Sampled};
use crate::light::{EmissionSampler, LightSource};
use crate::material::{Bsdf, Lobe};
use crate::math::{Color, Vec3};
use crate::sampling::{Sampler, hash};

/// A joining ray ends this share of its length before the other end.
const SHORTENING: f32 = 1e-4;
/// Joints under a smaller cosine at either end are left out; light that is lost so is found by no ray either.
const GRAZING: f32 = 1e-3;

/// Light paths for gathers.
///
/// Whether light comes to the point x of a gather from y on the way of a ray from x, or on that of a light path that visits y, is decided by weights that depend on x and y alone: `p/(p + q)` for rays, p being
/// their density per area at y, and `q/(p + q)` for light paths, with q one path for each so much of the scene's surface. They sum to one whatever lies behind y, so that rays may end in caches there. They
/// take away, too, what makes joints of near points bright. Only surfaces without gloss take part: light paths cannot be joined to mirrors.
pub(in crate::integrator) struct LightPaths<'a> {
    tracer: PathTracer<'a>,
    emission: EmissionSampler<'a>,
    /// Area of the scene's surface, estimated.
    area: f32,
}

/// A surface that light paths may be joined to.
fn joinable(bsdf: &Bsdf) -> bool {
    bsdf.has_diffuse() && !bsdf.has_glossy() && !bsdf.transmits()
}

impl<'a> LightPaths<'a> {
    /// Of the lights of `tracer`'s scene.
    pub fn new(tracer: PathTracer<'a>) -> Self {
        let bounds = tracer.scene.bounds();
        let size = if bounds.is_empty() { Vec3::ONE } else { bounds.max - bounds.min };
        let walls = 2.0 * (size.x * size.y + size.y * size.z + size.z * size.x);
        Self { tracer, emission: EmissionSampler::new(tracer.scene.lights(), bounds), area: walls.max(f32::MIN_POSITIVE) }
    }

    /// q, for `paths` light paths.
    fn density(&self, paths: u32) -> f32 {
        paths as f32 / self.area
    }

    /// The weight of a ray with the density `pdf` per steradian, of all `rays` together, that met a surface with this BSDF at `distance` under the cosine `cos`.
    pub fn weight_of_ray(&self, bundle: &Bundle, bsdf: &Bsdf, pdf: f32, cos: f32, distance: f32) -> f32 {
        if !joinable(bsdf) || cos < GRAZING {
            return 1.0;
        }
        let p = bundle.len() as f32 * pdf * cos / (distance * distance);
        p / (p + self.density(bundle.light_paths))
    }

    /// Joins the light paths that `bundle` asks for with `from`, on `level`. Returns the number of joining rays.
    pub fn join(&self, from: &SurfacePoint, level: u8, bundle: &mut Bundle) -> u64 {
        // Interactions before the vertex that is joined: it and the point of the gather follow.
        let most = self.tracer.max_bounces.min(LONGEST_PATH).saturating_sub(u32::from(level));
        let (mut rays, mut joints) = (Vec::new(), Vec::new());
        let (paths, q) = (bundle.light_paths, self.density(bundle.light_paths));
        for number in 0..paths {
            self.walk(hash(&[bundle.seed, 2]), number, most, |vertex| {
                let offset = vertex.point.position - from.position;
                let squared = offset.length_squared();
                let distance = squared.sqrt();
                let dir = offset / distance.max(f32::MIN_POSITIVE);
                let (cos, cos_there) = (from.frame.n.dot(dir), -vertex.point.ng.dot(dir));
                if !joinable(&vertex.bsdf) || cos_there < GRAZING || cos < GRAZING || from.ng.dot(dir) <= 0.0 {
                    return;
                }
                let p = bundle.len() as f32 * bundle.density.pdf(cos) * cos_there / squared;
                let scattering = vertex.of_light_path(self.tracer.scene, -dir);
                let light = vertex.beta * scattering.f * (vertex.light_cosine(-dir) * cos / squared);
                let light = light * vertex.transmittance(self.tracer.scene, -dir, distance);
                let irradiance = light * (q / (p + q) / paths as f32);
                if irradiance != Color::ZERO && irradiance.is_finite() {
                    let mut ray = self.tracer.scene.spawn(from, dir);
                    ray.tmax = distance * (1.0 - SHORTENING);
                    rays.push(ray);
                    joints.push(Joint { offset, normal: vertex.point.ng, irradiance, area: 1.0 / (p + q) });
                }
            });
        }
        let mut blocked = vec![false; rays.len()];
        self.tracer.scene.occluded_many(&rays, &mut blocked);
        bundle.joints.extend(joints.into_iter().zip(blocked).filter(|(_, blocked)| !blocked).map(|(joint, _)| joint));
        rays.len() as u64
    }

    /// Walks from a light, as [`super::Bidirectional`] does, and shows each of at most `most` vertices.
    fn walk(&self, seed: u64, number: u32, most: u32, mut visit: impl FnMut(&Vertex)) {
        let scene = self.tracer.scene;
        let mut sampler = Sampler::new(seed, number);
        let (place, turn, select) = (sampler.next_2d(), sampler.next_2d(), sampler.next_1d());
        let Some(start) = self.emission.sample(select, place, turn) else { return };
        let emitted = match start.end.source {
            LightSource::Triangle { instance, triangle, u, v } if scene.emission_is_textured(instance) => {
                scene.emission_at(instance, triangle, u, v, -start.direction)
            }
            _ => start.emitted,
        };
        let origin = match start.end.normal {
            Vec3::ZERO => start.origin,
            normal => offset_origin(start.origin, normal, start.direction),
        };
        let mut ray = Ray { origin, tmin: 0.0, dir: start.direction, tmax: f32::INFINITY };
        let mut beta = emitted * start.measure;
        let (mut first, mut last): (Color, Option<Vertex>) = (Color::ONE, None);
        let alpha = hash(&[seed, u64::from(number)]);
        for count in 0..most {
            let Some((raw, distance)) = scene.intersect(&ray, alpha.wrapping_add(u64::from(count))) else { return };
            match &last {
                None => {
                    beta *= self.emission.window(&start.end, distance);
                    first = beta;
                }
                Some(last) => beta *= last.transmittance(scene, ray.dir, distance),
            }
            if beta == Color::ZERO || !beta.is_finite() {
                return;
            }
            let vertex = Vertex::new(scene, raw, beta, 0.0);
            visit(&vertex);
            if count >= ROULETTE_AFTER {
                let survival = (beta.max_element() / first.max_element()).min(MAX_SURVIVAL);
                if sampler.next_1d() >= survival {
                    return;
                }
                beta /= survival;
            }
            let Some((scattered, next)) = self.tracer.scatter(&vertex.site(), &mut sampler, Sampled::Everything) else { return };
            if scattered.lobe == Lobe::Delta {
                let corrected = vertex.light_cosine(next.dir) / vertex.point.frame.n.dot(next.dir).abs();
                beta *= scattered.weight * (scattered.eta * scattered.eta * corrected);
            } else {
                let f = vertex.of_light_path(scene, next.dir).f;
                beta *= f * (vertex.light_cosine(next.dir) / scattered.pdf);
            }
            (ray, last) = (next, Some(vertex));
        }
    }
}
