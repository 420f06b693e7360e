//! Shading of camera samples: direct light sampled, indirect light of diffuse surfaces from the
//! cache, everything else by paths that end in it.

use super::path::{PathTracer, Reflected, Sampled, Start, split};
use super::points::footprint;
use super::vertex::{Aim, Vertex};
use super::{CachedLobes, CameraSample, IndirectLight, Shaded, Status, Surface};
use crate::accel::{Coherence, Hit, Ray};
use crate::cache::{Behind, Cache};
use crate::gather::{Deeper, LobeCoefficients};
use crate::material::Lobe;
use crate::math::{Color, INV_PI};
use crate::sampling::{LONGEST_PATH, MAX_SURVIVAL, ROULETTE_AFTER, Sampler};
use nix::sys::time::TimeValLike;
use nix::time::{ClockId, clock_gettime};
use std::sync::atomic::{AtomicU64, Ordering};

/// Shades camera samples by a filled cache.
pub struct CachedIntegrator<'a> {
    tracer: PathTracer<'a>,
    cache: &'a Cache,
    behind: Behind<'a>,
    lobes: Option<CachedLobes<'a>>,
    interpolate_ns: AtomicU64,
    direct_ns: AtomicU64,
}

/// Paths from a diffuse surface that no record covers ...
const PATHS: u32 = 8;
/// ... and if they end in a radiosity cache.
const SHORT_PATHS: u32 = 2;
/// Every so many samples the parts of shading are timed, which costs too much to do always.
const TIMED: usize = 32;

/// Nanoseconds of its thread that parts of shading took.
#[derive(Default)]
struct Spent {
    interpolate: u64,
    direct: u64,
}

/// Runs `f`, and adds the nanoseconds it took to `spent` if there is one.
fn timed<T>(spent: Option<&mut u64>, f: impl FnOnce() -> T) -> T {
    let Some(spent) = spent else { return f() };
    let start = thread_ns();
    let out = f();
    *spent += thread_ns().saturating_sub(start);
    out
}

/// CPU nanoseconds of this thread so far: by the clock on the wall, one sample that another program
/// interrupts would speak for many that it does not.
fn thread_ns() -> u64 {
    clock_gettime(ClockId::CLOCK_THREAD_CPUTIME_ID).map_or(0, |t| t.num_nanoseconds() as u64)
}

/// A shadow ray under way, for the sample `sample`.
struct Pending {
    sample: usize,
    light: Reflected,
    /// The camera's own surface reflects it; else a mirror showed that surface, and everything
    /// counts as glossy.
    first: bool,
}

impl<'a> CachedIntegrator<'a> {
    /// Shading by `cache`, whose levels are filled; its radiance records answer for `lobes`.
    pub fn new(tracer: PathTracer<'a>, cache: &'a Cache, lobes: Option<CachedLobes<'a>>) -> Self {
        Self {
            tracer,
            cache,
            behind: cache.behind(0),
            lobes,
            interpolate_ns: AtomicU64::new(0),
            direct_ns: AtomicU64::new(0),
        }
    }

    /// CPU seconds spent on cache lookups and on direct light so far, estimated from every 32nd
    /// sample.
    pub fn seconds(&self) -> [f64; 2] {
        [&self.interpolate_ns, &self.direct_ns].map(|ns| ns.load(Ordering::Relaxed) as f64 * 1e-9)
    }

    /// Shades `samples`; the results are in their order and do not depend on how samples are
    /// grouped into calls.
    pub fn shade(&self, samples: &[CameraSample], out: &mut Vec<Shaded>) {
        let scene = self.tracer.scene;
        let rays: Vec<Ray> = samples.iter().map(CameraSample::ray).collect();
        let mut hits = vec![Hit::MISS; rays.len()];
        scene.intersect_many(&rays, Coherence::Camera, &mut hits);

        let mut shadows = Vec::with_capacity(rays.len());
        let mut pending = Vec::with_capacity(rays.len());
        let mut spent = Spent::default();
        let mut lobe = LobeCoefficients::default();
        out.clear();
        for ((sample, ray), hit) in samples.iter().zip(&rays).zip(&hits) {
            let number = out.len();
            let clock = number.is_multiple_of(TIMED).then_some(&mut spent);
            out.push(self.shade_one(
                sample,
                ray,
                *hit,
                clock,
                &mut lobe,
                |shadow, light, first| {
                    shadows.push(shadow);
                    pending.push(Pending { sample: number, light, first });
                },
            ));
        }
        self.interpolate_ns.fetch_add(spent.interpolate * TIMED as u64, Ordering::Relaxed);
        let mut shadow_ns = 0;

        let visible = timed(Some(&mut shadow_ns), || scene.visibility_many(&shadows));
        self.direct_ns.fetch_add(spent.direct * TIMED as u64 + shadow_ns, Ordering::Relaxed);
        for (p, visible) in pending.iter().zip(visible) {
            let (radiance, light) = (&mut out[p.sample].radiance, p.light.behind(visible));
            if p.first {
                radiance.diffuse_direct += light.diffuse;
                radiance.glossy_direct += light.glossy;
            } else {
                radiance.glossy_indirect += light.sum();
            }
        }
    }

    fn shade_one(
        &self, sample: &CameraSample, ray: &Ray, hit: Hit, mut clock: Option<&mut Spent>,
        lobe: &mut LobeCoefficients, mut shadow: impl FnMut(Ray, Reflected, bool),
    ) -> Shaded {
        let scene = self.tracer.scene;
        let mut out = Shaded::default();
        let mut sampler = sample.sampler.clone();
        let seed = sample.alpha_seed();
        let mut found = scene.resolve(ray, hit, seed);
        let (mut ray, mut beta, mut travelled, mut spread) = (*ray, Color::ONE, 0.0, 1.0);
        // Follow the path through ideal mirrors and panes: what they show deserves the same care as
        // what is seen directly.
        for bounces in 0..LONGEST_PATH {
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
                out.surface = Some(Surface::new(self.tracer.scene, &point, &bsdf, distance));
            }

            let mut lit = None;
            let (cached, served) = timed(clock.as_mut().map(|c| &mut c.interpolate), || {
                let reflected = self.reflected(&vertex, bounces, sample.limit, lobe, &mut out);
                let served = reflected.is_some();
                let mut diffuse = || {
                    let (indirect, direct) =
                        self.cached(&vertex, bounces, sample.limit, &mut out)?;
                    lit = direct;
                    Some(indirect)
                };
                (
                    reflected
                        .or_else(|| Some(Reflected { diffuse: diffuse()?, glossy: Color::ZERO })),
                    served,
                )
            });
            let sampled = match (cached, lit) {
                (Some(_), Some(_)) => Sampled::GlossyAlone,
                (Some(_), None) => self.tracer.beside_cache(&vertex),
                (None, _) => Sampled::Everything,
            };
            let indirect = cached.unwrap_or_default();
            if bounces == 0 {
                out.radiance.diffuse_indirect += indirect.diffuse;
                out.radiance.diffuse_direct += lit.unwrap_or_default();
                out.radiance.glossy_indirect += indirect.glossy;
            } else {
                out.radiance.glossy_indirect += beta * (indirect.sum() + lit.unwrap_or_default());
            }
            let light = timed(clock.as_mut().map(|c| &mut c.direct), || {
                [
                    self.tracer.light(&vertex, &mut sampler, sampled),
                    self.tracer.sky(&vertex, &mut sampler, sampled),
                ]
            });
            for (ray, light) in light.into_iter().flatten() {
                shadow(ray, light.scaled(beta), bounces == 0);
            }
            if sampled == Sampled::Everything && bounces == 0 && !vertex.bsdf.has_glossy() {
                self.gather(&vertex, &mut sampler, seed, &mut out);
                return out;
            }
            let Some((scattered, next)) = self.tracer.scatter(&vertex, &mut sampler, sampled)
            else {
                return out;
            };
            if scattered.lobe != Lobe::Delta {
                // Where records serve the gloss too, the direction only looks for emitters, which
                // light samples alone would find with more noise.
                if served && !scene.lights().may_shine_along(next.origin, next.dir) {
                    return out;
                }
                let aim = Aim::new(scattered.pdf, vertex.origin(), next.dir);
                let start = Start { bounces, aim };
                let tracer = if served {
                    PathTracer { max_bounces: bounces, ..self.tracer }
                } else {
                    self.tracer
                };
                let light =
                    tracer.incoming(&next, &start, &mut sampler, seed, Some(self.indirect()));
                if bounces == 0 {
                    let weights = match sampled {
                        Sampled::Everything => split(&vertex, &scattered),
                        // The cache has the diffuse lobe: all of this weight is the others'.
                        _ => (Color::ZERO, scattered.weight),
                    };
                    out.radiance.add(weights, light);
                } else {
                    out.radiance.glossy_indirect +=
                        beta * scattered.weight * (light.direct + light.indirect);
                }
                return out;
            }
            if bounces >= self.tracer.max_bounces {
                // The mirror still shows emitters.
                let hit = scene.intersect(&next, seed);
                let emitted = hit.map_or_else(
                    || scene.lights().environment(next.dir),
                    |(p, _)| scene.emission(&p),
                );
                let part = if bounces == 0 {
                    &mut out.radiance.glossy_direct
                } else {
                    &mut out.radiance.glossy_indirect
                };
                *part += beta * scattered.weight * emitted;
                return out;
            }
            beta *= scattered.weight;
            spread *= scattered.eta * scattered.eta;
            if bounces + 1 >= ROULETTE_AFTER {
                let survival = (beta.max_element() * spread).min(MAX_SURVIVAL);
                if sampler.next_1d() >= survival {
                    return out;
                }
                beta /= survival;
            }
            ray = next;
            found = scene.intersect(&ray, seed);
        }
        out
    }

    /// Light of a diffuse surface that no record covers, from a few paths: among pixels that
    /// records serve, the noise of one path would be a speck.
    fn gather(&self, v: &Vertex, sampler: &mut Sampler, seed: u64, out: &mut Shaded) {
        let paths = if self.cache.radiosity().is_some() { SHORT_PATHS } else { PATHS };
        for _ in 0..paths {
            if let Some((scattered, next)) = self.tracer.scatter(v, sampler, Sampled::Everything) {
                let aim = Aim::new(scattered.pdf, v.origin(), next.dir);
                let start = Start { bounces: 0, aim };
                let light =
                    self.tracer.incoming(&next, &start, sampler, seed, Some(self.indirect()));
                let (diffuse, glossy) = split(v, &scattered);
                out.radiance.add((diffuse / paths as f32, glossy / paths as f32), light);
            }
        }
    }

    /// Where the paths that go on from visible surfaces may end.
    fn indirect(&self) -> IndirectLight<'_> {
        IndirectLight { lobes: self.lobes, ..(&self.behind as &dyn Deeper).into() }
    }

    /// The level that a surface behind `bounces` mirrors is looked up on.
    fn level(&self, bounces: u32) -> u8 {
        // With a bound on the path length a surface behind mirrors is owed fewer bounces than one
        // seen directly.
        if self.tracer.max_bounces == u32::MAX {
            0
        } else {
            u8::try_from(bounces).unwrap_or(u8::MAX)
        }
    }

    /// Radiance of indirect light that leaves a surface whose glossy lobes radiance records serve,
    /// by all its lobes.
    fn reflected(
        &self, v: &Vertex, bounces: u32, limit: u32, lobe: &mut LobeCoefficients, out: &mut Shaded,
    ) -> Option<Reflected> {
        if v.bsdf.is_delta_only() || !v.bsdf.has_glossy() {
            return None;
        }
        out.glossy = Status::Traced;
        let albedo = out.surface.filter(|_| bounces == 0).map(|s| s.albedo);
        let (lobes, projector) = (self.lobes?, self.cache.projector()?);
        let level = self.level(bounces);
        let records = self.cache.level(level)?.radiance()?;
        let limit = if level == 0 { limit } else { u32::MAX };
        let answer = if projector.hits().are_kept() {
            self.tracer.reflect_hits(v, limit, (records, projector.hits()), self.indirect())
        } else {
            lobe.order = lobes.project(&v.point, &v.bsdf, albedo, &mut lobe.values)?;
            records.lookup_lobe(projector, &v.point, limit, lobe)
        };
        out.lookups += 1;
        let Some(answer) = answer else {
            out.misses += 1;
            return None;
        };
        out.glossy = Status::Cached;
        if bounces == 0 {
            out.error = answer.error;
            out.records = answer.records;
            out.irradiance = answer.irradiance;
            if v.bsdf.has_diffuse() {
                out.status = Status::Cached;
            }
        }
        let diffuse =
            v.bsdf.diffuse_albedo(v.point.frame.to_local(v.point.wo)) * answer.irradiance * INV_PI;
        Some(Reflected { diffuse, glossy: answer.glossy })
    }

    /// Radiance of indirect light that leaves by the diffuse lobe, from the cache, and that of
    /// direct light, if records hold it.
    fn cached(
        &self, v: &Vertex, bounces: u32, limit: u32, out: &mut Shaded,
    ) -> Option<(Color, Option<Color>)> {
        if !v.bsdf.has_diffuse() {
            return None;
        }
        if bounces >= self.tracer.max_bounces {
            return Some((Color::ZERO, None));
        }
        let answer = self.cache.lookup(self.level(bounces), &v.point, limit);
        out.lookups += 1;
        match answer {
            Some(a) => {
                if bounces == 0 {
                    out.status = Status::Cached;
                    out.error = a.error;
                    out.allowed = a.allowed;
                    out.records = a.records;
                    out.irradiance = a.irradiance;
                }
                let reflectance =
                    v.bsdf.diffuse_albedo(v.point.frame.to_local(v.point.wo)) * INV_PI;
                Some((reflectance * a.irradiance, a.direct.map(|e| reflectance * e)))
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
