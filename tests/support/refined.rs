//! Caches refined to convergence, over scenes and over a floor in a field of light.

use crate::support::pictures::{build, one_level, own, scheme, with_rays};
use lumicache::cache::{
    Appearance, Appearances, Cache, FillStats, Irradiance, LevelPoints, RadiusRule, Record, Scheme,
};
use lumicache::gather::{Bundle, Deeper, HitKind, RadianceProbe};
use lumicache::geometry::SurfacePoint;
use lumicache::math::{Color, Frame, Vec3};
use lumicache::progress::Progress;
use lumicache::sampling::{Rng, hash};
use lumicache::scene::Scene;
use lumicache::transport::{CameraSample, PathTracer, SceneProbe};

/// A refined first level and the points it was refined for.
pub struct Refined {
    pub cache: Cache,
    pub points: Vec<SurfacePoint>,
    pub appearance: Vec<Appearance>,
    /// Of the fill before the refinement, and of the refinement.
    pub stats: [FillStats; 2],
    pub unrefined: usize,
}

impl Refined {
    pub fn new(
        probe: &dyn RadianceProbe, scheme: Scheme, seen: Vec<(SurfacePoint, Appearance)>,
    ) -> Self {
        let mut cache = Cache::new(one_level(scheme), u32::MAX);
        let (points, appearance): (Vec<_>, Vec<_>) = seen.into_iter().unzip();
        let points = LevelPoints::from(points);
        let first = cache.fill(probe, 0, &points, 0, &Progress::default()).unwrap();
        let unrefined = records(&cache).len();
        let appearances = Appearances { of_points: appearance, lobes: None };
        let second =
            cache.refine(probe, 0, &points, &appearances, 0, &Progress::default()).unwrap();
        let appearance = appearances.of_points;
        Self { cache, points: points.points, appearance, stats: [first, second], unrefined }
    }

    /// What the camera of `scene` sees, refined.
    pub fn scene(scene: &Scene, scheme: Scheme, size: [u32; 2]) -> Self {
        Self::new(&probe(scene), scheme, seen(scene, size))
    }

    pub fn records(&self) -> &[Record<Irradiance>] {
        records(&self.cache)
    }
}

pub fn records(cache: &Cache) -> &[Record<Irradiance>] {
    cache.records(0)
}

pub fn probe(scene: &Scene) -> SceneProbe<'_> {
    SceneProbe::new(PathTracer { scene, max_bounces: u32::MAX })
}

/// The shading points of the camera's pixels in a scattered order.
pub fn seen(scene: &Scene, size: [u32; 2]) -> Vec<(SurfacePoint, Appearance)> {
    let mut pixels: Vec<u32> = (0..size[0] * size[1]).collect();
    pixels.sort_by_cached_key(|p| hash(&[u64::from(*p)]));
    let ray = |p: u32| {
        let seed = hash(&[0, u64::from(p % size[0]), u64::from(p / size[0])]);
        let sample = CameraSample::new(
            &scene.cameras()[0],
            [p % size[0], p / size[0]],
            size,
            seed,
            0,
            u32::MAX,
        );
        (sample.camera, sample.seed)
    };
    let rays: Vec<_> = pixels.into_iter().map(ray).collect();
    let views = PathTracer { scene, max_bounces: u32::MAX }.views(&rays, None);
    views.into_iter().flatten().map(|(point, _, appearance)| (point, appearance)).collect()
}

/// The irradiance at `at` extrapolated from `record` alone, to first order.
pub fn extrapolated(record: &Record<Irradiance>, rule: &RadiusRule, at: &SurfacePoint) -> Color {
    let (_, slope) = rule.radius(record.length, record.footprint);
    record.payload.at(record.normal, at.frame.n, at.position - record.position, slope)
}

/// With few rays: what is tested does not depend on their number.
pub fn quick(preset: &str) -> Scheme {
    with_rays(scheme(preset), 128)
}

/// Light that is the same from every direction; how much there is depends on where it arrives.
pub struct Field<F> {
    pub radiance: F,
    pub distance: f32,
}

impl<F: Fn(Vec3, u64) -> f32 + Sync> RadianceProbe for Field<F> {
    fn incoming(&self, from: &SurfacePoint, _: u8, _: &dyn Deeper, bundle: &mut Bundle) {
        for k in 0..bundle.len() {
            bundle.radiance[k] =
                Color::splat((self.radiance)(from.position, hash(&[bundle.seed, k as u64])));
            bundle.distance[k] = self.distance;
            bundle.normal[k] = -bundle.dir_local[k];
            bundle.kind[k] = HitKind::Surface;
        }
    }
}

/// Points scattered over the square [-2, 2]² of a floor of reflectance 1/π, under direct light.
pub fn floor(direct: f32) -> Vec<(SurfacePoint, Appearance)> {
    let mut rng = Rng::new(9);
    let template = seen(&build(own("cornell-box")), [1, 1])[0].0;
    (0..40_000)
        .map(|_| {
            let position = Vec3::new(4.0 * rng.next_f32() - 2.0, 4.0 * rng.next_f32() - 2.0, 0.0);
            let at = SurfacePoint {
                position,
                ng: Vec3::Z,
                frame: Frame::from_normal(Vec3::Z),
                footprint: 0.005,
                ..template
            };
            (at, Appearance { reflectance: Color::splat(std::f32::consts::FRAC_1_PI), direct })
        })
        .collect()
}
