//! Shading of camera samples: direct light sampled, indirect light of diffuse surfaces from the cache, everything else by paths that end in it.

use super::path::{PathTracer, Reflected, Sampled, Start, Vertex, split};
use super::points::{LONGEST_CHAIN, footprint};
use super::{CameraSample, Shaded, Status, Surface};
use crate::accel::{Coherence, Hit, Ray};
use crate::cache::Cache;
use crate::gather::Deeper;
use crate::material::Lobe;
use crate::math::{Color, INV_PI};

/// Shades camera samples by a filled cache.
pub struct CachedIntegrator<'a> {
    tracer: PathTracer<'a>,
    cache: &'a Cache,
}

/// A shadow ray under way, for the sample `sample`.
struct Pending {
    sample: usize,
    light: Reflected,
    /// The camera's own surface reflects it; else a mirror showed that surface, and everything counts as glossy.
    first: bool,
}

impl<'a> CachedIntegrator<'a> {
    /// Shading by `cache`, whose levels are filled.
    pub fn new(tracer: PathTracer<'a>, cache: &'a Cache) -> Self {
        Self { tracer, cache }
    }

    /// Shades `samples`; the results are in their order and do not depend on how samples are grouped into calls.
    pub fn shade(&self, samples: &[CameraSample], out: &mut Vec<Shaded>) {
        let scene = self.tracer.scene;
        let rays: Vec<Ray> = samples.iter().map(CameraSample::ray).collect();
        let mut hits = vec![Hit::MISS; rays.len()];
        scene.intersect_many(&rays, Coherence::Camera, &mut hits);

        let mut shadows = Vec::with_capacity(rays.len());
        let mut pending = Vec::with_capacity(rays.len());
        out.clear();
        for ((sample, ray), hit) in samples.iter().zip(&rays).zip(&hits) {
            let number = out.len();
            out.push(self.shade_one(sample, ray, *hit, |shadow, light, first| {
                shadows.push(shadow);
                pending.push(Pending { sample: number, light, first });
            }));
        }

        let mut blocked = vec![false; shadows.len()];
        scene.occluded_many(&shadows, &mut blocked, samples.first().map_or(0, |s| s.seed));
        for (p, blocked) in pending.iter().zip(blocked) {
            if !blocked {
                let radiance = &mut out[p.sample].radiance;
                if p.first {
                    radiance.diffuse_direct += p.light.diffuse;
                    radiance.glossy_direct += p.light.glossy;
                } else {
                    radiance.glossy_indirect += p.light.sum();
                }
            }
        }
    }

    fn shade_one(&self, sample: &CameraSample, ray: &Ray, hit: Hit, mut shadow: impl FnMut(Ray, Reflected, bool)) -> Shaded {
        let scene = self.tracer.scene;
        let mut out = Shaded::default();
        let mut sampler = sample.sampler.clone();
        let seed = sample.alpha_seed();
        let mut found = scene.resolve(ray, hit, seed);
        let (mut ray, mut beta, mut travelled) = (*ray, Color::ONE, 0.0);
        // Follow the path through ideal mirrors and panes: what they show deserves the same care as what is seen directly.
        for bounces in 0..LONGEST_CHAIN {
            let emitted = match &found {
                Some((point, _)) => scene.emission(point),
                None => scene.lights().environment(ray.dir),
            };
            match bounces {
                0 => out.radiance.emission += emitted,
                1 => out.radiance.glossy_direct += beta * emitted,
                _ => out.radiance.glossy_indirect += beta * emitted,
            }
            let Some((mut point, distance)) = found else { return out };
            travelled += distance;
            point.footprint = footprint(&sample.camera, travelled, point.wo.dot(point.ng));
            let bsdf = scene.shade(&mut point);
            beta *= scene.transmittance(&point, distance);
            let vertex = Vertex { point, bsdf };
            if bounces == 0 {
                out.surface = Some(Surface::new(&point, &bsdf, distance));
            }

            let cached = self.cached(&vertex, bounces, sample.limit, &mut out);
            let sampled = if cached.is_some() { Sampled::Glossy } else { Sampled::Everything };
            if let Some(indirect) = cached {
                if bounces == 0 {
                    out.radiance.diffuse_indirect += indirect;
                } else {
                    out.radiance.glossy_indirect += beta * indirect;
                }
            }
            if let Some((ray, light)) = self.tracer.light(&vertex, &mut sampler, sampled) {
                shadow(ray, light.scaled(beta), bounces == 0);
            }
            let Some((scattered, next)) = self.tracer.scatter(&vertex, &mut sampler, sampled) else { return out };
            if scattered.lobe != Lobe::Delta {
                let start = Start { bounces, pdf: scattered.pdf, origin: vertex.origin() };
                let light = self.tracer.incoming(&next, &start, &mut sampler, seed, Some(self.cache as &dyn Deeper));
                if bounces == 0 {
                    let weights = match sampled {
                        Sampled::Everything => split(&vertex, &scattered),
                        // The cache has the diffuse lobe: all of this weight is the others'.
                        Sampled::Glossy => (Color::ZERO, scattered.weight),
                    };
                    out.radiance.add(weights, light);
                } else {
                    out.radiance.glossy_indirect += beta * scattered.weight * (light.direct + light.indirect);
                }
                return out;
            }
            if bounces >= self.tracer.max_bounces {
                // The mirror still shows emitters.
                let hit = scene.intersect(&next, seed);
                let emitted = hit.map_or_else(|| scene.lights().environment(next.dir), |(p, _)| scene.emission(&p));
                let part = if bounces == 0 { &mut out.radiance.glossy_direct } else { &mut out.radiance.glossy_indirect };
                *part += beta * scattered.weight * emitted;
                return out;
            }
            beta *= scattered.weight;
            ray = next;
            found = scene.intersect(&ray, seed);
        }
        out
    }

    /// Radiance of indirect light that leaves by the diffuse lobe, from the cache.
    fn cached(&self, v: &Vertex, bounces: u32, limit: u32, out: &mut Shaded) -> Option<Color> {
        if !v.bsdf.has_diffuse() {
            return None;
        }
        if bounces >= self.tracer.max_bounces {
            return Some(Color::ZERO);
        }
        // With a bound on the path length a surface behind mirrors is owed fewer bounces than one seen directly.
        let level = if self.tracer.max_bounces == u32::MAX { 0 } else { u8::try_from(bounces).unwrap_or(u8::MAX) };
        let answer = self.cache.lookup(level, &v.point, limit);
        out.lookups += 1;
        match answer {
            Some(a) => {
                if bounces == 0 {
                    out.status = Status::Cached;
                    out.error = a.error;
                    out.records = a.records;
                    out.irradiance = a.irradiance;
                }
                Some(v.bsdf.diffuse_albedo(v.point.frame.to_local(v.point.wo)) * a.irradiance * INV_PI)
            }
            None => {
                out.misses += 1;
                if bounces == 0 {
                    out.status = Status::Traced;
                }
                None
            }
        }
    }
}
