//! Unidirectional path tracing with next-event estimation and multiple importance sampling.

use super::bright::Cones;
use super::vertex::{Aim, Vertex};
use super::{CameraSample, IndirectLight, Radiance, Shaded, Surface};
use crate::accel::Ray;
use crate::geometry::SurfacePoint;
use crate::light::{LightSample, LightSource};
use crate::material::{Bsdf, BsdfSample, Lobe};
use crate::math::{Color, INV_PI};
use crate::sampling::{
    LONGEST_PATH, MAX_SURVIVAL, ROULETTE_AFTER, Sampler, cosine_hemisphere_pdf,
    square_to_cosine_hemisphere,
};
use crate::scene::Scene;

/// The gloss beside a cached diffuse lobe is followed with this multiple of its weight as
/// probability.
pub(super) const GLOSS_SURVIVAL: f32 = 2.0;

/// Traces light paths through a scene.
#[derive(Clone, Copy)]
pub struct PathTracer<'a> {
    /// The scene.
    pub scene: &'a Scene,
    /// Most surface interactions after the camera hit, `u32::MAX` for no bound.
    pub max_bounces: u32,
}

/// A path that is already under way.
pub struct Start {
    /// Surface interactions that lie behind, the camera hit not counted.
    pub bounces: u32,
    /// How its direction was sampled.
    pub aim: Aim,
}

/// Which lobes the path goes on by, beside the light samples taken at a vertex.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(super) enum Sampled {
    /// All of them.
    Everything,
    /// All but the diffuse one, whose indirect light a cache knows: light samples alone account for
    /// its direct light.
    Glossy,
    /// The same, but light samples share the environment's direct light with [`PathTracer::sky`]:
    /// seen through a window they hardly ever find it.
    GlossyAndSky,
    /// All but the diffuse one, whose direct light a cache knows, too: light samples are for the
    /// others alone.
    GlossyAlone,
    /// None, since caches know the indirect light of all: light samples alone account for direct
    /// light.
    Nothing,
}

/// What happens at a vertex: see [`PathTracer::step`].
pub(super) struct Step {
    /// Radiance towards `wo` of indirect light that a cache knows.
    pub cached: Reflected,
    /// A shadow ray, and what it brings if nothing is in its way.
    pub light: Option<(Ray, Reflected)>,
    /// The sampled direction and the ray into it.
    pub next: Option<(BsdfSample, Ray)>,
    /// What was sampled.
    pub sampled: Sampled,
    /// The ray may go to a small bright surface. Its weight is small then, but not what it brings;
    /// whether it is followed has been decided.
    pub guided: bool,
}

/// Light leaving a surface, by the diffuse lobe and by the others.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Reflected {
    pub diffuse: Color,
    pub glossy: Color,
}

impl Reflected {
    pub fn sum(&self) -> Color {
        self.diffuse + self.glossy
    }

    /// What is left of it if the share `visible` of its light arrives.
    pub fn behind(self, visible: Color) -> Self {
        if visible == Color::ZERO { Self::default() } else { self.scaled(visible) }
    }

    pub fn scaled(self, by: Color) -> Self {
        Self { diffuse: by * self.diffuse, glossy: by * self.glossy }
    }
}

/// Seed of the alpha decisions of the shadow ray behind `bounces` interactions.
fn shadow_seed(seed: u64, bounces: u32) -> u64 {
    seed ^ u64::from(bounces + 1).rotate_left(32)
}

/// Light that arrives directly, and light that was scattered before.
#[derive(Clone, Copy, Default)]
pub(super) struct Incoming {
    pub direct: Color,
    pub indirect: Color,
}

/// Power heuristic with exponent 2 for a sample of density `a` that could have come with density
/// `b` too [Veach97, Eq. 9.13].
#[inline]
pub(super) fn power_heuristic(a: f32, b: f32) -> f32 {
    if a.is_infinite() {
        return 1.0;
    }
    let (a2, b2) = (a * a, b * b);
    if a2 + b2 > 0.0 { a2 / (a2 + b2) } else { 0.0 }
}

impl PathTracer<'_> {
    /// Shades one camera sample.
    pub(super) fn shade(&self, sample: &CameraSample) -> Shaded {
        let mut out = Shaded::default();
        let (mut sampler, seed, ray) = (sample.sampler.clone(), sample.alpha_seed(), sample.ray());
        let Some((mut point, distance)) = self.scene.intersect(&ray, seed) else {
            out.radiance.emission = self.scene.lights().environment(ray.dir);
            return out;
        };
        out.radiance.emission = self.scene.emission(&point);
        let bsdf = self.scene.shade(&mut point);
        out.surface = Some(Surface::new(self.scene, &point, &bsdf, distance));
        let vertex = Vertex { point, bsdf };
        if let Some((shadow, lit)) = self.light(&vertex, &mut sampler, Sampled::Everything) {
            let lit = lit.behind(self.scene.visibility(&shadow, shadow_seed(seed, 0)));
            out.radiance.diffuse_direct = lit.diffuse;
            out.radiance.glossy_direct = lit.glossy;
        }
        if let Some((scattered, next)) = self.scatter(&vertex, &mut sampler, Sampled::Everything) {
            let aim = Aim::new(scattered.pdf, vertex.origin(), next.dir);
            let start = Start { bounces: 0, aim };
            let light = self.incoming(&next, &start, &mut sampler, seed, None);
            out.radiance.add(split(&vertex, &scattered), light);
        }
        out
    }

    /// The radiance that `ray` brings to the path that began as `start` says.
    ///
    /// Where indirect light is known by `indirect` the path ends.
    pub(super) fn incoming(
        &self, ray: &Ray, start: &Start, sampler: &mut Sampler, seed: u64,
        indirect: Option<IndirectLight>,
    ) -> Incoming {
        let mut light = Incoming::default();
        let mut beta = Color::ONE;
        let (mut ray, mut aim) = (*ray, start.aim);
        // Interactions after the camera hit that light seen at the end of `ray` has had.
        let mut bounces = start.bounces;
        // What refraction took from radiance on the way, and will give back.
        let mut spread = 1.0;
        let mut first = true;
        loop {
            let hit = self.scene.intersect(&ray, seed.wrapping_add(u64::from(bounces)));
            let straight = aim.is_straight(ray.dir);
            if straight || bounces <= self.max_bounces {
                let emitted = beta * self.emitted(&ray, hit.as_ref().map(|(p, d)| (p, *d)), &aim);
                if first && straight {
                    light.direct += emitted;
                } else {
                    light.indirect += emitted;
                }
            }
            let Some((mut point, distance)) = hit else { return light };
            // Panes on the way to a light do not count: light samples pass them, too.
            let ended = bounces >= self.max_bounces;
            let blocked = !aim.sees_through() || !self.scene.is_pane(point.material);
            if bounces >= LONGEST_PATH || (ended && blocked) {
                return light;
            }
            let bsdf = self.scene.shade(&mut point);
            beta *= self.scene.transmittance(&point, distance);
            let vertex = Vertex { point, bsdf };
            bounces += 1;

            let (next, guided) = if ended {
                let next = self.scatter(&vertex, sampler, Sampled::Everything);
                (next.filter(|(sample, _)| sample.lobe == Lobe::Delta), false)
            } else {
                let step = self.step(&vertex, distance, sampler, bounces, indirect);
                light.indirect += beta * step.cached.sum();
                if let Some((shadow, lit)) = step.light {
                    let visible = self.scene.visibility(&shadow, shadow_seed(seed, bounces));
                    light.indirect += beta * lit.behind(visible).sum();
                }
                (step.next, step.guided)
            };
            let Some((sample, next)) = next else { return light };
            beta *= sample.weight;
            spread *= sample.eta * sample.eta;
            if bounces >= ROULETTE_AFTER && !guided {
                let survival = (beta.max_element() * spread).min(MAX_SURVIVAL);
                if sampler.next_1d() >= survival {
                    return light;
                }
                beta /= survival;
            }
            aim = aim.onward(self.scene, &vertex, &sample, &next);
            (ray, first) = (next, first && aim.panes() > 0);
        }
    }

    /// Light emitted towards the ray by what it hit, weighed against the light sampling done where
    /// it was aimed.
    pub(super) fn emitted(&self, ray: &Ray, hit: Option<(&SurfacePoint, f32)>, aim: &Aim) -> Color {
        let (lights, pdf, origin) = (self.scene.lights(), aim.pdf(ray.dir), aim.origin());
        match hit {
            None => {
                let radiance = lights.environment(ray.dir);
                if radiance == Color::ZERO {
                    return radiance;
                }
                radiance
                    * power_heuristic(
                        pdf,
                        lights.pdf_environment(origin.position, origin.facing, ray.dir),
                    )
            }
            Some((at, distance)) => {
                let radiance = self.scene.emission(at);
                if radiance == Color::ZERO {
                    return radiance;
                }
                let (dir, distance) = aim.towards(at.position, ray, distance);
                let other = lights.pdf_triangle(
                    origin.position,
                    origin.facing,
                    at.instance,
                    at.triangle,
                    dir,
                    distance,
                );
                radiance * power_heuristic(pdf, other)
            }
        }
    }

    /// What happens at a vertex that is not the camera's: indirect light from a cache where one
    /// knows it, one light sample, and the next ray.
    pub(super) fn step(
        &self, v: &Vertex, distance: f32, sampler: &mut Sampler, bounces: u32,
        indirect: Option<IndirectLight>,
    ) -> Step {
        let level = u8::try_from(bounces).unwrap_or(u8::MAX);
        let known = indirect.filter(|_| bounces < self.max_bounces);
        let all = known.and_then(|k| k.radiosity(v, distance, sampler));
        let of = |diffuse| Reflected { diffuse, glossy: Color::ZERO };
        let (cached, sampled) = match all {
            Some((diffuse, true)) => (of(diffuse), Sampled::GlossyAlone),
            Some((diffuse, false)) => (of(diffuse), Sampled::Glossy),
            None => match known.and_then(|k| k.leaving(level, v)) {
                Some((diffuse, Some(glossy))) => (Reflected { diffuse, glossy }, Sampled::Nothing),
                Some((diffuse, None)) => (of(diffuse), Sampled::Glossy),
                None => (Reflected::default(), Sampled::Everything),
            },
        };
        let light = self.light(v, sampler, sampled);
        let guide = indirect
            .filter(|_| sampled == Sampled::Everything && v.bsdf.has_diffuse())
            .and_then(|i| i.bright?.seen_from(v.point.position, v.origin().facing));
        if let Some(cones) = guide {
            let next = self.scatter_guided(v, sampler, &cones);
            return Step { cached, light, next, sampled, guided: true };
        }
        let mut next = self.scatter(v, sampler, sampled);
        // Where a cache was asked, the path is one of very many that are averaged, and the rest of
        // it costs more than what it has brought so far. A faint gloss on top of cached
        // light is followed only as often as it matters, and what no cache knows as often as the
        // surface reflects.
        if let (Some(_), Some((sample, _))) = (indirect, &mut next) {
            let share = if sampled == Sampled::Everything { 1.0 } else { GLOSS_SURVIVAL };
            let weight = sample.weight.max_element() * sample.eta * sample.eta;
            let survival = (share * weight).min(1.0);
            if sampler.next_1d() < survival {
                sample.weight /= survival;
            } else {
                next = None;
            }
        }
        Step { cached, light, next, sampled, guided: false }
    }

    /// Next-event estimation at a vertex: a shadow ray, and what is reflected if nothing blocks it.
    pub(super) fn light(
        &self, v: &Vertex, sampler: &mut Sampler, sampled: Sampled,
    ) -> Option<(Ray, Reflected)> {
        // In this order a pixel's place, the light sample and the choices after it take two whole
        // sets of the sequence.
        let u = sampler.next_2d();
        let select = sampler.next_1d();
        let unlit =
            v.bsdf.is_delta_only() || (sampled == Sampled::GlossyAlone && !v.bsdf.has_glossy());
        if unlit || self.scene.lights().is_empty() {
            return None;
        }
        let origin = v.origin();
        let light = self.scene.lights().sample(origin.position, origin.facing, select, u)?;
        let lit = reflected(self.scene, &v.point, &v.bsdf, &light, sampled)?;
        Some((self.scene.shadow_ray(&v.point, &light), lit))
    }

    /// What is sampled at a vertex that the camera sees and whose diffuse lobe a cache serves.
    /// Gathers average over so many vertices that a second ray at each does not pay.
    pub(super) fn beside_cache(&self, v: &Vertex) -> Sampled {
        if v.bsdf.has_diffuse() && self.scene.lights().has_environment() {
            Sampled::GlossyAndSky
        } else {
            Sampled::Glossy
        }
    }

    /// Direct light of the environment by a direction of the diffuse lobe, weighed against light
    /// samples; `None` unless that is `sampled`.
    pub(super) fn sky(
        &self, v: &Vertex, sampler: &mut Sampler, sampled: Sampled,
    ) -> Option<(Ray, Reflected)> {
        if sampled != Sampled::GlossyAndSky {
            return None;
        }
        let local = square_to_cosine_hemisphere(sampler.next_2d());
        let wi = v.point.frame.to_world(local);
        let radiance = self.scene.lights().environment(wi);
        if wi.dot(v.point.ng) <= 0.0 || radiance == Color::ZERO {
            return None;
        }
        let origin = v.origin();
        let other = self.scene.lights().pdf_environment(origin.position, origin.facing, wi);
        let weight = power_heuristic(cosine_hemisphere_pdf(local), other);
        let diffuse = v.bsdf.diffuse_albedo(v.point.frame.to_local(v.point.wo)) * radiance * weight;
        Some((self.scene.spawn(&v.point, wi), Reflected { diffuse, glossy: Color::ZERO }))
    }

    /// Samples the BSDF at a vertex, or its lobes other than the diffuse one, and makes the next
    /// ray.
    pub(super) fn scatter(
        &self, v: &Vertex, sampler: &mut Sampler, sampled: Sampled,
    ) -> Option<(BsdfSample, Ray)> {
        if sampled == Sampled::Nothing || (sampled != Sampled::Everything && !v.bsdf.has_glossy()) {
            return None;
        }
        let (lobe, u) = (sampler.next_1d(), sampler.next_2d());
        let wo = v.point.frame.to_local(v.point.wo);
        let sample = match sampled {
            Sampled::Everything => v.bsdf.sample(wo, lobe, u),
            _ => v.bsdf.sample_glossy(wo, lobe, u),
        };
        self.leave(v, sample?)
    }

    /// As [`PathTracer::scatter`] by all lobes, or in half of all cases into a direction of
    /// `cones`, as often as the surface reflects.
    fn scatter_guided(
        &self, v: &Vertex, sampler: &mut Sampler, cones: &Cones,
    ) -> Option<(BsdfSample, Ray)> {
        let (choice, u) = (2.0 * sampler.next_1d(), sampler.next_2d());
        let wo = v.point.frame.to_local(v.point.wo);
        let albedo = v.bsdf.albedo(wo).max_element().min(MAX_SURVIVAL);
        if sampler.next_1d() >= albedo {
            return None;
        }
        let mut sample = if choice < 1.0 {
            v.bsdf.sample(wo, choice, u)?
        } else {
            let wi = v.point.frame.to_local(cones.sample(choice - 1.0, u));
            let (f, pdf) = v.bsdf.f_pdf(wo, wi);
            let weight = f * (wi.z.abs() / pdf.max(f32::MIN_POSITIVE));
            let transmitted = wi.z * wo.z < 0.0;
            BsdfSample { wi, weight, pdf, lobe: Lobe::Diffuse, transmitted, eta: 1.0 }
        };
        // The sample keeps the density of the lobes, with which light samples are weighed.
        if sample.lobe == Lobe::Delta {
            sample.weight *= 2.0 / albedo;
        } else {
            let other = cones.density(v.point.frame.to_world(sample.wi));
            sample.weight *= 2.0 * sample.pdf / (sample.pdf + other) / albedo;
        }
        self.leave(v, sample)
    }

    fn leave(&self, v: &Vertex, sample: BsdfSample) -> Option<(BsdfSample, Ray)> {
        let wi = v.point.frame.to_world(sample.wi);
        // A shading normal must not make reflected light come through the surface, nor transmitted
        // light bounce off it.
        let below = wi.dot(v.point.ng) <= 0.0;
        let valid = below == sample.transmitted
            && sample.weight.is_finite()
            && sample.weight != Color::ZERO;
        valid.then(|| (sample, self.scene.spawn(&v.point, wi)))
    }
}

impl Radiance {
    /// Adds the light that a direction sampled at the camera's surface brings; `(diffuse, glossy)`
    /// are the sample's weights by the lobes it leaves by.
    pub(super) fn add(&mut self, (diffuse, glossy): (Color, Color), light: Incoming) {
        self.diffuse_direct += diffuse * light.direct;
        self.diffuse_indirect += diffuse * light.indirect;
        self.glossy_direct += glossy * light.direct;
        self.glossy_indirect += glossy * light.indirect;
    }
}

/// Splits the weight of a sample of the whole BSDF into what leaves by the diffuse lobe and by the
/// others.
pub(super) fn split(v: &Vertex, sample: &BsdfSample) -> (Color, Color) {
    if sample.lobe == Lobe::Delta || !v.bsdf.has_diffuse() || sample.transmitted {
        return (Color::ZERO, sample.weight);
    }
    if !v.bsdf.has_glossy() {
        return (sample.weight, Color::ZERO);
    }
    let wo = v.point.frame.to_local(v.point.wo);
    let diffuse = v.bsdf.diffuse_albedo(wo) * (INV_PI * sample.wi.z.max(0.0) / sample.pdf);
    let diffuse = diffuse.min(sample.weight);
    (diffuse, sample.weight - diffuse)
}

/// Light of one sample reflected at `at`, by the diffuse lobe and by the others, before occlusion,
/// weighed against sampling the lobes that `sampled` says. `None` where nothing is reflected.
pub(super) fn reflected(
    scene: &Scene, at: &SurfacePoint, bsdf: &Bsdf, light: &LightSample, sampled: Sampled,
) -> Option<Reflected> {
    let frame = &at.frame;
    let (wo, wi) = (frame.to_local(at.wo), frame.to_local(light.wi));
    if (wi.z > 0.0) != (light.wi.dot(at.ng) > 0.0) {
        return None;
    }
    let lit = sampled != Sampled::GlossyAlone && wi.z > 0.0 && bsdf.has_diffuse();
    let diffuse = if lit { bsdf.diffuse_albedo(wo) * INV_PI } else { Color::ZERO };
    let (glossy, glossy_pdf) = bsdf.f_pdf_glossy(wo, wi);
    if diffuse + glossy == Color::ZERO {
        return None;
    }
    let radiance = scene.sent(light.source, light.radiance, light.wi);
    let weight = |pdf: f32| if light.delta { 1.0 } else { power_heuristic(light.pdf, pdf) };
    let (for_diffuse, for_glossy) = match sampled {
        Sampled::Everything => {
            let w = weight(bsdf.pdf(wo, wi));
            (w, w)
        }
        Sampled::GlossyAndSky if matches!(light.source, LightSource::Environment) => {
            (weight(cosine_hemisphere_pdf(wi)), weight(glossy_pdf))
        }
        Sampled::Glossy | Sampled::GlossyAndSky | Sampled::GlossyAlone => (1.0, weight(glossy_pdf)),
        Sampled::Nothing => (1.0, 1.0),
    };
    let scale = radiance * (wi.z.abs() / light.pdf);
    Some(Reflected { diffuse: diffuse * scale * for_diffuse, glossy: glossy * scale * for_glossy })
}

/// A sample that is not a number must not spoil a record.
pub(super) fn finite(c: Color) -> Color {
    if c.is_finite() { c } else { Color::ZERO }
}
