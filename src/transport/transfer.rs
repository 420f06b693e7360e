//! The rays of the radiosity cache in our own scene.

use super::bright::{Bright, Cones};
use super::lobes::NEAREST;
use super::path::{GLOSS_SURVIVAL, PathTracer, Sampled, finite, power_heuristic};
use super::vertex::{Aim, Origin, Vertex};
use crate::accel::{Coherence, Hit, Ray};
use crate::cache::{Casting, Found, Radiosity, Share, Transfer};
use crate::gather::{Bundle, Deeper, Density, HitKind, Layout, RadianceProbe};
use crate::geometry::SurfacePoint;
use crate::math::{Color, PI, Vec3};
use crate::sampling::{
    LONGEST_PATH, MAX_SURVIVAL, ROULETTE_AFTER, Rng, Sampler, cosine_hemisphere_pdf, hash, stream,
};

/// Which records of all light the rays of others end in.
pub(super) struct SceneTransfer<'a> {
    pub tracer: PathTracer<'a>,
    /// The small bright surfaces, and points that light sources light up.
    pub bright: &'a Bright,
}

/// How the rays of a record are spread over its hemisphere.
struct Spread {
    /// Strata of the cosine density.
    strata: f32,
    /// Rays towards small bright surfaces.
    aimed: f32,
    cones: Option<Cones>,
}

impl Spread {
    /// The sum of the densities of all rays in the direction `w`, `dir` in the world.
    fn density(&self, w: Vec3, dir: Vec3) -> f32 {
        let aimed = self.cones.as_ref().map_or(0.0, |cones| self.aimed * cones.density(dir));
        self.strata * cosine_hemisphere_pdf(w) + aimed
    }
}

impl RadianceProbe for SceneTransfer<'_> {
    /// Distances and normals alone.
    fn incoming(&self, from: &SurfacePoint, _: u8, _: &dyn Deeper, bundle: &mut Bundle) {
        let numbers: Vec<u32> = (0..bundle.len() as u32).collect();
        for (k, _, found) in self.trace(from, &bundle.dir_local, &numbers, bundle.seed) {
            match found {
                Some((point, distance)) => {
                    bundle.distance[k] = distance;
                    bundle.normal[k] = point.ng;
                    bundle.kind[k] = HitKind::Surface;
                }
                None => bundle.kind[k] = HitKind::Environment,
            }
        }
    }
}

/// A ray with its number, and what it met.
type Traced = (usize, Ray, Option<(SurfacePoint, f32)>);

impl SceneTransfer<'_> {
    fn spread(&self, from: &SurfacePoint, casting: Casting) -> Spread {
        let cones = (casting.aimed > 0)
            .then(|| self.bright.seen_from(from.position, Some(from.ng)))
            .flatten();
        let strata = match casting.rays {
            0 => 0.0,
            rays => Layout::concentric(rays).rays() as f32,
        };
        Spread { strata, aimed: casting.aimed as f32, cones }
    }

    /// Traces the rays with these numbers that leave the surface on its outer side.
    fn trace(
        &self, from: &SurfacePoint, directions: &[Vec3], numbers: &[u32], seed: u64,
    ) -> Vec<Traced> {
        let scene = self.tracer.scene;
        let (mut kept, mut rays) = (Vec::new(), Vec::new());
        for &k in numbers {
            let dir = from.frame.to_world(directions[k as usize]);
            if dir.dot(from.ng) > 0.0 {
                kept.push(k as usize);
                rays.push(scene.spawn(from, dir));
            }
        }
        let mut hits = vec![Hit::MISS; rays.len()];
        scene.intersect_many(&rays, Coherence::Bundle, &mut hits);
        let resolve = |((k, ray), hit): ((usize, Ray), Hit)| {
            (k, ray, scene.resolve(&ray, hit, hash(&[seed, k as u64])))
        };
        kept.into_iter().zip(rays).zip(hits).map(resolve).collect()
    }

    /// Follows a ray, which stands for the share `weight` of the hemisphere, to the records that it
    /// ends in.
    fn follow(
        &self, (ray, mut hit): (Ray, Option<(SurfacePoint, f32)>), mut aim: Aim, weight: f32,
        seed: u64, records: &Radiosity,
    ) -> Found {
        let (tracer, scene) = (&self.tracer, self.tracer.scene);
        let (mut found, mut beta) = (Found::default(), Color::splat(weight));
        let mut sampler = Sampler::new(seed, 0);
        let (mut ray, mut first) = (ray, true);
        for bounces in 1..LONGEST_PATH {
            let emitted = tracer.emitted(&ray, hit.as_ref().map(|(p, d)| (p, *d)), &aim);
            let straight = first && aim.is_straight(ray.dir);
            *(if straight { &mut found.direct } else { &mut found.known }) +=
                finite(beta * emitted);
            let Some((mut point, distance)) = hit else { break };
            let bsdf = scene.shade(&mut point);
            beta *= scene.transmittance(&point, distance);
            let vertex = Vertex { point, bsdf };
            let longest = distance / (NEAREST + sampler.next_1d());
            let ends = bsdf.has_diffuse().then(|| end(&vertex, longest, beta, records, &mut found));
            let sampled = match ends.flatten() {
                Some(true) => Sampled::GlossyAlone,
                Some(false) => Sampled::Glossy,
                None => Sampled::Everything,
            };
            if let Some((shadow, lit)) = tracer.light(&vertex, &mut sampler, sampled) {
                found.known += finite(beta * lit.behind(scene.visibility(&shadow, seed)).sum());
            }
            let Some((sample, next)) = tracer.scatter(&vertex, &mut sampler, sampled) else {
                break;
            };
            let share = if sampled == Sampled::Everything { 1.0 } else { GLOSS_SURVIVAL };
            let kept = share * sample.weight.max_element() * sample.eta * sample.eta;
            let most = if bounces < ROULETTE_AFTER { 1.0 } else { MAX_SURVIVAL };
            let survival = kept.min(most);
            if sampler.next_1d() >= survival {
                break;
            }
            beta *= sample.weight / survival;
            aim = aim.onward(scene, &vertex, &sample, &next);
            first &= aim.panes() > 0;
            ray = next;
            hit = scene.intersect(&ray, seed.wrapping_add(u64::from(bounces)));
        }
        found
    }
}

/// Ends a ray that counts `beta` in the records at `v`. Returns whether their direct light counts,
/// which it does up to a radius of `longest`; `None` if there is no record.
fn end(
    v: &Vertex, longest: f32, beta: Color, records: &Radiosity, found: &mut Found,
) -> Option<bool> {
    let (first, mut sum) = (found.shares.len(), 0.0);
    let all = records.weights(&v.point, longest, |record, weight| {
        found.shares.push(Share { record, all: true, factor: Color::splat(weight) });
        sum += weight;
    });
    let light = beta * v.bsdf.diffuse_albedo(v.point.frame.to_local(v.point.wo)) / (PI * sum);
    for share in &mut found.shares[first..] {
        (share.all, share.factor) = (all, share.factor * light);
    }
    (sum > 0.0).then_some(all)
}

impl Transfer for SceneTransfer<'_> {
    fn distances(&self) -> &dyn RadianceProbe {
        self
    }

    fn lit(&self) -> Vec<SurfacePoint> {
        self.bright.lit.clone()
    }

    fn direct(&self, from: &SurfacePoint, casting: Casting) -> Color {
        let scene = self.tracer.scene;
        let (mut shadows, mut light) = (Vec::new(), Vec::new());
        let (spread, lights) = (self.spread(from, casting), casting.lights as f32);
        let words = hash(&[casting.seed, stream::APPEARANCE]) as u32;
        let (position, facing) = (from.position, Some(from.ng));
        scene.lights().stratified(position, facing, casting.lights, words, &mut |sample| {
            let w = from.frame.to_local(sample.wi);
            if w.z > 0.0 {
                let radiance = scene.sent(sample.source, sample.radiance, sample.wi);
                let other = spread.density(w, sample.wi) / lights;
                let weight = if sample.delta { 1.0 } else { power_heuristic(sample.pdf, other) };
                shadows.push(scene.shadow_ray(from, &sample));
                light.push(radiance * (weight * w.z / sample.pdf));
            }
        });
        let visible = scene.visibility_many(&shadows);
        light.into_iter().zip(visible).map(|(l, v)| finite(l * v)).sum::<Color>() / lights
    }

    fn cast(
        &self, from: &SurfacePoint, casting: Casting, numbers: &[u32], records: &Radiosity,
    ) -> Vec<Found> {
        let (mut directions, mut pdf) = (Vec::new(), Vec::new());
        let layout = Layout::concentric(casting.rays);
        layout.directions(Density::Cosine, casting.seed, &mut directions, &mut pdf);
        let spread = self.spread(from, casting);
        let mut rng = Rng::new(hash(&[casting.seed, stream::TOWARDS_BRIGHT]));
        for _ in 0..casting.aimed {
            let (select, u) = (rng.next_f32(), rng.next_2d());
            // Rays into the surface find nothing.
            let dir = spread.cones.as_ref().map_or(-from.frame.n, |c| c.sample(select, u));
            directions.push(from.frame.to_local(dir));
        }
        let origin = Origin { position: from.position, facing: Some(from.ng) };
        let traced = self.trace(from, &directions, numbers, casting.seed);
        let mut found = vec![Found::default(); directions.len()];
        for (k, ray, hit) in traced.into_iter().filter(|(k, ..)| directions[*k].z > 0.0) {
            let seed = hash(&[casting.seed, k as u64]);
            let density = spread.density(directions[k], ray.dir);
            let aim = Aim::new(density / casting.lights as f32, origin, ray.dir);
            let weight = directions[k].z / density;
            found[k] = self.follow((ray, hit), aim, weight, seed, records);
        }
        numbers.iter().map(|&k| std::mem::take(&mut found[k as usize])).collect()
    }
}
