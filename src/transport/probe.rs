//! The probe that gathers in our own scene: bundles of rays, shadow rays and cache lookups at their
//! hits, paths where no cache helps.

use super::bdpt::LightPaths;
use super::direct::LightPoints;
use super::hit_change::{Change, Views};
use super::path::{PathTracer, Start};
use super::vertex::{Aim, Origin, Vertex};
use super::{CachedLobes, IndirectLight};
use crate::accel::{Coherence, Hit, Ray};
use crate::gather::{Bundle, Deeper, DirectLight, HitChange, HitKind, LightChoice, RadianceProbe};
use crate::geometry::SurfacePoint;
use crate::math::Color;
use crate::sampling::{Sampler, hash};
use std::sync::OnceLock;
use std::sync::atomic::{AtomicU64, Ordering};

/// Sees indirect light: what the rays of a bundle hit reflects, but what it emits only if it was
/// seen in a mirror.
pub struct SceneProbe<'a> {
    tracer: PathTracer<'a>,
    lobes: Option<CachedLobes<'a>>,
    /// Made when a gather first asks for light paths.
    light_paths: OnceLock<LightPaths<'a>>,
    counts: Counts,
}

/// Rays traced and caches asked, over all bundles so far.
#[derive(Debug, Default)]
pub struct Counts {
    /// Rays of bundles.
    pub bundle_rays: AtomicU64,
    /// Shadow rays at their hits, and those of records that hold direct light.
    pub shadow_rays: AtomicU64,
    /// Paths that went on behind a hit.
    pub paths: AtomicU64,
}

impl Counts {
    /// Bundle rays, shadow rays and paths.
    pub fn totals(&self) -> [u64; 3] {
        [&self.bundle_rays, &self.shadow_rays, &self.paths].map(|c| c.load(Ordering::Relaxed))
    }
}

impl<'a> SceneProbe<'a> {
    /// The probe of `tracer`'s scene and path length.
    pub fn new(tracer: PathTracer<'a>) -> Self {
        Self { tracer, lobes: None, light_paths: OnceLock::new(), counts: Counts::default() }
    }

    /// The same probe with the lobes that radiance records answer for.
    #[must_use]
    pub fn with_lobes(self, lobes: Option<CachedLobes<'a>>) -> Self {
        Self { lobes, ..self }
    }

    /// What has been traced so far.
    pub fn counts(&self) -> &Counts {
        &self.counts
    }
}

impl RadianceProbe for SceneProbe<'_> {
    fn incoming(&self, from: &SurfacePoint, level: u8, deeper: &dyn Deeper, bundle: &mut Bundle) {
        let scene = self.tracer.scene;
        let bounces = u32::from(level) + 1;
        let joined = bundle.light_paths > 0
            && !scene.lights().is_empty()
            && bounces <= self.tracer.max_bounces;
        let light_paths =
            joined.then(|| self.light_paths.get_or_init(|| LightPaths::new(self.tracer)));

        // Trace the rays that leave the surface on its outer side; a bent shading normal sends some
        // of them inside.
        let mut number = Vec::with_capacity(bundle.len());
        let mut rays = Vec::with_capacity(bundle.len());
        for (k, w) in bundle.dir_local.iter().enumerate() {
            let dir = from.frame.to_world(*w);
            if dir.dot(from.ng) > 0.0 {
                number.push(k);
                rays.push(scene.spawn(from, dir));
            }
        }
        let mut hits = vec![Hit::MISS; rays.len()];
        scene.intersect_many(&rays, Coherence::Bundle, &mut hits);

        // Shade the hits; shadow rays wait to be traced together.
        let mut shadows: Vec<Ray> = Vec::with_capacity(rays.len());
        let mut lit: Vec<(usize, Color, Option<Change>)> = Vec::with_capacity(rays.len());
        if bundle.hit_change != HitChange::None {
            bundle.change = [0, 1].map(|_| vec![Color::ZERO; bundle.len()]);
        }
        let mut paths = 0;
        let indirect = IndirectLight { records: deeper, lobes: self.lobes };
        let tables = self.lobes.map(|l| l.tables);
        for ((&k, ray), hit) in number.iter().zip(&rays).zip(&hits) {
            let seed = hash(&[bundle.seed, k as u64]);
            let Some((mut point, distance)) = scene.resolve(ray, *hit, seed) else {
                bundle.kind[k] = HitKind::Environment;
                continue;
            };
            bundle.distance[k] = distance;
            bundle.normal[k] = point.ng;
            bundle.kind[k] = if scene.emission(&point) == Color::ZERO {
                HitKind::Surface
            } else {
                HitKind::Emitter
            };
            if bounces > self.tracer.max_bounces {
                continue;
            }
            let bsdf = scene.shade(&mut point);
            let mut through = scene.transmittance(&point, distance);
            if let Some(light_paths) = light_paths {
                let cos = -point.ng.dot(ray.dir);
                through *= light_paths.weight_of_ray(bundle, &bsdf, bundle.pdf[k], cos, distance);
            }
            let vertex = Vertex { point, bsdf };
            let mut sampler = Sampler::new(bundle.seed, k as u32);
            let step = self.tracer.step(&vertex, &mut sampler, bounces, Some(indirect));
            let views = Views::new(bundle.hit_change, tables, from, &vertex, distance);
            if let Some((shadow, reflected)) = step.light {
                let change =
                    views.as_ref().map(|v| v.of_light(&shadow, &reflected).map(|c| through * c));
                shadows.push(shadow);
                lit.push((k, through * reflected.sum(), change));
            }
            let mut followed = Color::ZERO;
            if let Some((sample, next)) = &step.next {
                // Light that comes straight through panes is direct light, like the light of lamps.
                let origin = Origin { position: from.position, facing: Some(from.ng) };
                let aim = Aim::new(0.0, origin, ray.dir).onward(scene, &vertex, sample, next);
                let start = Start { bounces, aim };
                let light = self.tracer.incoming(next, &start, &mut sampler, seed, Some(indirect));
                followed = sample.weight * (light.direct + light.indirect);
                paths += 1;
            }
            bundle.radiance[k] = finite(through * (step.cached.sum() + followed));
            if let Some(views) = views {
                add_change(
                    bundle,
                    k,
                    views
                        .of_step(&step, followed, (indirect, level.saturating_add(1)))
                        .map(|c| through * c),
                );
            }
        }

        for ((k, radiance, change), visible) in lit.into_iter().zip(scene.visibility_many(&shadows))
        {
            bundle.radiance[k] += finite(visible * radiance);
            if let Some(change) = change {
                add_change(bundle, k, change.map(|c| visible * c));
            }
        }
        let joining = light_paths.map_or(0, |paths| paths.join(from, level, bundle));
        self.counts.bundle_rays.fetch_add(rays.len() as u64, Ordering::Relaxed);
        self.counts.shadow_rays.fetch_add(shadows.len() as u64 + joining, Ordering::Relaxed);
        self.counts.paths.fetch_add(paths, Ordering::Relaxed);
    }

    fn lights<'a>(
        &'a self, from: &SurfacePoint, bundle: &Bundle, choice: LightChoice,
    ) -> Option<Box<dyn DirectLight + 'a>> {
        Some(Box::new(LightPoints::new(
            self.tracer.scene,
            from,
            bundle,
            choice,
            &self.counts.shadow_rays,
        )))
    }
}

fn add_change(bundle: &mut Bundle, k: usize, change: Change) {
    for (sum, c) in bundle.change.iter_mut().zip(change) {
        sum[k] += finite(c);
    }
}

/// A sample that is not a number must not spoil a record.
fn finite(c: Color) -> Color {
    if c.is_finite() { c } else { Color::ZERO }
}
