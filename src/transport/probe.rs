//! The probe that gathers in our own scene: bundles of rays, shadow rays and cache lookups at their
//! hits, paths where no cache helps.

use super::bdpt::LightPaths;
use super::bright::{Bright, Cones};
use super::direct::LightPoints;
use super::find_bright::find_bright;
use super::focus::{Seen, seen};
use super::hit_change::{Change, Views};
use super::path::{PathTracer, Start, finite};
use super::vertex::{Aim, Origin, Vertex};
use super::{CachedLobes, IndirectLight};
use crate::accel::{Coherence, Hit, Ray};
use crate::gather::{Bundle, Deeper, DirectLight, HitChange, HitKind, LightChoice, RadianceProbe};
use crate::geometry::SurfacePoint;
use crate::math::{Color, Vec2, Vec3};
use crate::sampling::{Rng, Sampler, hash, stream};
use std::sync::OnceLock;
use std::sync::atomic::{AtomicU64, Ordering};

/// Sees indirect light: what the rays of a bundle hit reflects, but what it emits only if it was
/// seen in a mirror.
pub struct SceneProbe<'a> {
    tracer: PathTracer<'a>,
    lobes: Option<CachedLobes<'a>>,
    /// What the first fill is for.
    seen: OnceLock<Option<Seen>>,
    /// Made when a gather first asks for light paths.
    light_paths: OnceLock<LightPaths<'a>>,
    /// Found when the first fill begins.
    bright: OnceLock<Bright>,
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
        Self {
            tracer,
            lobes: None,
            seen: OnceLock::new(),
            light_paths: OnceLock::new(),
            bright: OnceLock::new(),
            counts: Counts::default(),
        }
    }

    /// Aims light paths from infinity at what lies around `points`, unless that was done before.
    pub fn aim_at(&self, points: &[SurfacePoint]) {
        self.seen(points);
    }

    /// What `points` show, or what those of the first fill did.
    fn seen(&self, points: &[SurfacePoint]) -> Option<Seen> {
        *self.seen.get_or_init(|| seen(points.len(), |i| points[i].position))
    }

    fn new_light_paths(&self) -> LightPaths<'a> {
        LightPaths::new(self.tracer, self.seen.get().and_then(|seen| Some(seen.as_ref()?.focus)))
    }

    /// Looks for the small bright surfaces that light up what lies around `points`, unless that was
    /// done before; `seed` chooses the light paths that find them.
    pub fn seek_bright(&self, points: &[SurfacePoint], seed: u64) {
        self.bright.get_or_init(|| find_bright(self.tracer, points, self.seen(points), seed));
    }

    /// The small bright surfaces that were found.
    pub(super) fn bright(&self) -> &Bright {
        static NONE: Bright = Bright { patches: Vec::new(), lit: Vec::new() };
        self.bright.get().unwrap_or(&NONE)
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
        let light_paths = joined.then(|| self.light_paths.get_or_init(|| self.new_light_paths()));

        let bright =
            self.bright.get().filter(|b| !b.patches.is_empty() && bundle.towards_bright > 0);
        let cones = bright.and_then(|b| b.seen_from(from.position, Some(from.ng)));
        let aimed = cones.as_ref().map(|cones| Aimed::new(cones, from, bundle));

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
        let indirect = IndirectLight { records: deeper, lobes: self.lobes, bright };
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
            if let Some(aimed) = &aimed {
                through *= aimed.weight(bundle.pdf[k], ray.dir);
            }
            let vertex = Vertex { point, bsdf };
            let mut sampler = Sampler::new(bundle.seed, k as u32);
            let step = self.tracer.step(&vertex, distance, &mut sampler, bounces, Some(indirect));
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

/// The rays of one gather that are aimed at small bright surfaces.
struct Aimed<'a> {
    cones: &'a Cones,
    /// Rays of the strata, and those beside.
    rays: [f32; 2],
}

/// The steps of a sequence that fills the square evenly at any length: powers of 1/x, x³ = x + 1.
const STEPS: Vec2 = Vec2::new(0.754_877_7, 0.569_840_3);

impl<'a> Aimed<'a> {
    /// Adds the rays that `bundle` asks for.
    fn new(cones: &'a Cones, from: &SurfacePoint, bundle: &mut Bundle) -> Self {
        let (strata, count) = (bundle.len(), bundle.towards_bright);
        let mut rng = Rng::new(hash(&[bundle.seed, stream::TOWARDS_BRIGHT]));
        let shift = rng.next_2d();
        for k in 0..count {
            let select = (k as f32 + rng.next_f32()) / count as f32;
            let dir = cones.sample(select, (shift + k as f32 * STEPS).fract());
            let w = from.frame.to_local(dir);
            if w.z > 0.0 {
                bundle.add(w);
            }
        }
        Self { cones, rays: [strata as f32, count as f32] }
    }

    /// The share of the strata in all rays with the direction `dir`, which have the density `pdf`
    /// there: by it counts the radiance of each of them.
    fn weight(&self, pdf: f32, dir: Vec3) -> f32 {
        let [strata, aimed] = self.rays;
        strata * pdf / (strata * pdf + aimed * self.cones.density(dir))
    }
}

fn add_change(bundle: &mut Bundle, k: usize, change: Change) {
    for (sum, c) in bundle.change.iter_mut().zip(change) {
        sum[k] += finite(c);
    }
}
