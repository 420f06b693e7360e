//! The functions in which a render spends its time: lookups, gathers, the bundles of rays under
//! them, and shading. `make bench-hot` runs them; docs/TESTING.md says how to compare two versions.

#[allow(dead_code, reason = "the tests use all of it")]
#[path = "../tests/support/pictures.rs"]
mod pictures;

use criterion::{BatchSize, Criterion, Throughput, criterion_group, criterion_main};
use lumicache::accel::{Coherence, Hit, Ray};
use lumicache::gather::{Density, HemisphereSamples, Layout, NoDeeper, TriangleRadiance};
use lumicache::geometry::SurfacePoint;
use lumicache::sampling::{Rng, hash, square_to_cosine_hemisphere};
use lumicache::scene::Scene;
use lumicache::transport::{PathTracer, SceneProbe};
use std::hint::black_box;
use std::time::Duration;

const SCENES: [&str; 2] = ["cornell-box", "indirect-room"];
const SIZE: [u32; 2] = [160, 120];
const RAYS: Layout = Layout::Concentric { n: 16 };

/// A scene, and the surface points that a picture of [`SIZE`] sees.
fn seen(name: &str) -> (Scene, Vec<SurfacePoint>) {
    let scene = pictures::build(pictures::own(name));
    let points = pictures::seen(&scene, &scene.cameras()[0], SIZE, 1);
    (scene, points)
}

/// All points of a picture, looked up in records that were made for another one.
fn lookup(c: &mut Criterion) {
    let mut group = c.benchmark_group("lookup");
    for name in SCENES {
        let (scene, asked) = seen(name);
        let points = pictures::seen(&scene, &scene.cameras()[0], SIZE, 2);
        let scheme = pictures::scheme("auto");
        let (cache, _) = pictures::fill(&scene, scheme, &points.into());
        group.throughput(Throughput::Elements(asked.len() as u64));
        group.bench_function(name, |b| {
            b.iter(|| asked.iter().filter_map(|p| cache.lookup(0, p, u32::MAX)).count());
        });
    }
}

/// One hemisphere: its rays traced and shaded, then the estimates that a record is made from.
fn gather(c: &mut Criterion) {
    let mut group = c.benchmark_group("gather");
    for name in SCENES {
        let (scene, points) = seen(name);
        let probe = SceneProbe::new(PathTracer { scene: &scene, max_bounces: u32::MAX });
        let mut samples = HemisphereSamples::new(RAYS, Density::Cosine);
        let mut at = points.iter().cycle().step_by(97);
        let mut next = || at.next().expect("the scene is seen");
        group.bench_function(name, |b| {
            b.iter(|| samples.gather(&probe, next(), 0, &NoDeeper, 1));
        });
        group.bench_function(format!("estimates/{name}"), |b| {
            b.iter(|| {
                let derivatives = samples.triangulated(TriangleRadiance::Hybrid);
                (samples.irradiance(), samples.sigma(), samples.harmonic_distance(), derivatives)
            });
        });
    }
}

/// The rays of one hemisphere, traced together.
fn bundle(c: &mut Criterion) {
    let mut group = c.benchmark_group("bundle");
    for name in SCENES {
        let (scene, points) = seen(name);
        let mut rng = Rng::new(3);
        let bundles: Vec<Vec<Ray>> = points
            .iter()
            .step_by(97)
            .map(|at| {
                let direction = |u| at.frame.to_world(square_to_cosine_hemisphere(u));
                (0..RAYS.rays()).map(|_| scene.spawn(at, direction(rng.next_2d()))).collect()
            })
            .collect();
        let mut hits = vec![Hit::MISS; RAYS.rays()];
        let mut rays = bundles.iter().cycle();
        group.throughput(Throughput::Elements(RAYS.rays() as u64));
        group.bench_function(name, |b| {
            b.iter(|| {
                let rays = rays.next().expect("the scene is seen");
                scene.intersect_many(rays, Coherence::Bundle, &mut hits);
            });
        });
    }
}

/// The material at every point of a picture: shaded, sampled and evaluated.
fn shading(c: &mut Criterion) {
    let mut group = c.benchmark_group("shading");
    for name in ["cornell-box", "cornell-box-glossy", "glossy-still-life"] {
        let (scene, points) = seen(name);
        group.throughput(Throughput::Elements(points.len() as u64));
        group.bench_function(name, |b| {
            b.iter_batched_ref(
                || points.clone(),
                |points| {
                    for (i, point) in points.iter_mut().enumerate() {
                        let bsdf = scene.shade(point);
                        let wo = point.frame.to_local(point.wo);
                        let mut rng = Rng::new(hash(&[i as u64]));
                        let drawn = bsdf.sample(wo, rng.next_f32(), rng.next_2d());
                        black_box(drawn.map(|s| bsdf.f_pdf(wo, s.wi)));
                    }
                },
                BatchSize::LargeInput,
            );
        });
    }
}

fn briefly() -> Criterion {
    Criterion::default()
        .warm_up_time(Duration::from_secs(1))
        .measurement_time(Duration::from_secs(3))
        .without_plots()
}

criterion_group! { name = hot; config = briefly(); targets = lookup, gather, bundle, shading }
criterion_main!(hot);
