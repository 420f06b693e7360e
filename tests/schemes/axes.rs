//! Records with eight axes: their lengths, the quadratics along them, equivalent point sources,
//! direct light in records, and light paths joined to gathers.

use crate::support::pictures::{
    assert_alike, beauty, build, cached, fill, own, render, scheme, seen, settings, with, with_rays,
};
use lumicache::cache::{
    Area, Axes, CacheFile, Contents, DirectSamples, Extrapolation, Irradiance, LevelPoints, Origin,
    Outline, RadiusRule, Record, SECTORS, Scheme,
};
use lumicache::gather::{
    Arrival, Bundle, Deeper, Density, DirectLight, HemisphereSamples, HitKind, Layout, LightChoice,
    NoDeeper, RadianceProbe,
};
use lumicache::geometry::SurfacePoint;
use lumicache::light::EnvironmentMap;
use lumicache::math::{Color, Vec2, Vec3, luminance};
use lumicache::render::IntegratorKind;
use lumicache::scene::SceneData;
use lumicache::transport::{PathTracer, SceneProbe};
use std::collections::BTreeMap;
use std::path::Path;

/// Radiance and distance by direction, and the normal there; a lamp that is a point of intensity 1,
/// seen from where `lit` says.
struct World<F, G> {
    see: F,
    lamp: Vec3,
    lit: G,
}

impl<F: Fn(Vec3, Vec3) -> (f32, f32, Vec3) + Sync, G: Fn(Vec3) -> bool + Sync> RadianceProbe
    for World<F, G>
{
    fn incoming(&self, from: &SurfacePoint, _: u8, _: &dyn Deeper, bundle: &mut Bundle) {
        for k in 0..bundle.len() {
            let (radiance, distance, normal) =
                (self.see)(from.position, from.frame.to_world(bundle.dir_local[k]));
            (bundle.radiance[k], bundle.distance[k], bundle.normal[k]) =
                (Color::splat(radiance), distance, normal);
            bundle.kind[k] = HitKind::Surface;
        }
    }

    fn lights<'a>(
        &'a self, _: &SurfacePoint, _: &Bundle, _: LightChoice,
    ) -> Option<Box<dyn DirectLight + 'a>> {
        Some(Box::new(Lamp(self.lamp, &self.lit)))
    }
}

struct Lamp<'a>(Vec3, &'a (dyn Fn(Vec3) -> bool + Sync));

impl DirectLight for Lamp<'_> {
    fn arriving(&self, points: &[Vec3], out: &mut Vec<Arrival>) {
        out.extend(points.iter().map(|&x| {
            let d = self.0 - x;
            let light = if (self.1)(x) { 1.0 / d.length_squared() } else { 0.0 };
            Arrival { dir: d.normalize(), light: Color::splat(light) }
        }));
    }
}

fn floor(position: Vec3) -> SurfacePoint {
    SurfacePoint { footprint: 1e-3, ..SurfacePoint::plain(position, Vec3::Z) }
}

fn gathered(probe: &dyn RadianceProbe, at: &SurfacePoint, rays: u32) -> HemisphereSamples {
    let mut samples = HemisphereSamples::new(Layout::polar(rays), Density::Cosine);
    samples.gather(probe, at, 0, &NoDeeper, 7);
    samples
}

/// The record at the origin of a floor, in a scene of diagonal 10.
fn record(probe: &dyn RadianceProbe, scheme: &Scheme) -> Record<Irradiance> {
    let at = floor(Vec3::ZERO);
    let samples = gathered(probe, &at, 4096);
    let direct = DirectSamples::new(probe, &at, &samples, 1);
    let rule = RadiusRule::new(scheme, 0, 10.0, 1.0);
    Irradiance::gathered(scheme, &rule, &at, &samples, direct.as_ref())
}

/// The preset whose axes err by `error` at most.
fn aric11(error: f32) -> Scheme {
    with(scheme("aric11"), |s| s.extrapolation = Extrapolation::Axes { error, light_paths: 0 })
}

fn axes(record: &Record<Irradiance>) -> &Axes {
    record.payload.axes.as_deref().expect("the scheme extrapolates along axes")
}

/// Black, and a black ceiling at the height 100.
fn dark(from: Vec3, w: Vec3) -> (f32, f32, Vec3) {
    (0.0, (100.0 - from.z) / w.z, Vec3::NEG_Z)
}

/// Irradiance at `x` on the floor by a point of intensity 1 at the height h above the origin.
fn below_lamp(h: f32, x: f32) -> f32 {
    h / (h * h + x * x).powf(1.5)
}

/// Places and normals as shares of an axis and of the largest tilt.
fn lookup(record: &Record<Irradiance>, offset: Vec3, n: Vec3) -> f32 {
    axes(record).at(record.normal, offset, n).1.unwrap().x
}

#[test]
fn areas_end_at_what_is_near_on_each_side() {
    // A block of the height 2 beside the record: from x = 0.3, 0.4 wide. All else is far.
    let see = |from: Vec3, w: Vec3| {
        let t = (0.3 - from.x) / w.x;
        let hit = from + t * w;
        if t > 0.0 && hit.y.abs() < 0.2 && hit.z < 2.0 {
            (1.0, t, Vec3::NEG_X)
        } else {
            (1.0, 20.0, -w)
        }
    };
    let probe = World { see, lamp: Vec3::Z, lit: |_| true };
    let scheme = with(aric11(0.0), |s| {
        (s.contents, s.radius.max_aspect) = (Contents::Indirect, 100.0);
    });
    let Area::Sectors { axis, r } = record(&probe, &scheme).shape else { panic!("no sectors") };
    let towards = (0..SECTORS).find(|k| {
        let (sin, cos) = (std::f32::consts::FRAC_PI_4 * *k as f32).sin_cos();
        (cos * axis + sin * Vec3::Z.cross(axis)).dot(Vec3::X) > 0.99
    });
    let k = towards.expect("an axis points at the block");
    // The nearest of the rays more than 10° above the floor.
    assert!(r[k] > 0.3 && r[k] < 0.33, "{r:?}");
    assert!(
        (0..SECTORS)
            .filter(|j| j.abs_diff(k).min(SECTORS - j.abs_diff(k)) > 1)
            .all(|j| r[j] == 20.0),
        "{r:?}"
    );
    // A disc is as small as the smallest.
    let round = record(&probe, &with(scheme, |s| s.radius.area = Outline::Disc));
    assert!(round.shape.longest() < 0.33);
}

#[test]
fn quadratics_go_through_the_light_of_a_lamp() {
    let h = 2.0;
    let probe = World { see: dark, lamp: Vec3::new(0.0, 0.0, h), lit: |_| true };
    let record = record(&probe, &aric11(0.0));
    let a = axes(&record);
    assert!((a.direct.unwrap().irradiance.x - below_lamp(h, 0.0)).abs() < 1e-6);
    for k in 0..SECTORS {
        let angle = std::f32::consts::FRAC_PI_4 * k as f32;
        let u = angle.cos() * a.axis + angle.sin() * Vec3::Z.cross(a.axis);
        // As long as radii get: a tenth of the scene.
        assert!((a.lengths[k] - 1.0).abs() < 1e-5, "{:?}", a.lengths);
        for (share, tolerance) in
            [(0.0, 1e-6), (0.5, 1e-5), (1.0, 1e-5), (0.25, 0.01), (0.75, 0.01)]
        {
            let (x, expected) = (share * a.lengths[k] * u, below_lamp(h, share * a.lengths[k]));
            let got = lookup(&record, x, Vec3::Z);
            assert!(
                (got / expected - 1.0).abs() < tolerance,
                "axis {k} at {share}: {got} for {expected}"
            );
        }
        // Under a tilt by α the lamp straight above gives its light times cos α: 20° is the
        // largest.
        for (degrees, tolerance) in [(5.0_f32, 1e-3), (10.0, 1e-5), (20.0, 1e-5)] {
            let (sin, cos) = degrees.to_radians().sin_cos();
            let got = lookup(&record, Vec3::ZERO, sin * u + cos * Vec3::Z);
            assert!(
                (got / (cos * below_lamp(h, 0.0)) - 1.0).abs() < tolerance,
                "axis {k}, {degrees} degrees: {got}"
            );
        }
    }
}

#[test]
fn axes_end_before_the_edge_of_a_shadow() {
    // The lamp is seen up to x = 0.4. Where that is, no quadratic can say.
    let probe = World { see: dark, lamp: Vec3::new(0.0, 0.0, 4.0), lit: |x: Vec3| x.x < 0.4 };
    for error in [0.01, 0.1] {
        let record = record(&probe, &aric11(error));
        let a = axes(&record);
        for k in 0..SECTORS {
            let angle = std::f32::consts::FRAC_PI_4 * k as f32;
            let u = angle.cos() * a.axis + angle.sin() * Vec3::Z.cross(a.axis);
            let end = 0.4 / u.x;
            if u.x < 0.1 {
                assert!(
                    a.lengths[k] > 0.99,
                    "axis {k} away from the edge was shortened: {:?}",
                    a.lengths
                );
                continue;
            }
            // Steps of a quarter: it ends less than 1/0.75 before the edge.
            assert!(
                a.lengths[k] <= end && a.lengths[k] > 0.74 * end.min(1.0),
                "axis {k}: {:?} for {end}",
                a.lengths
            );
            for share in [0.1, 0.25, 0.6, 0.75, 0.9] {
                let x = share * a.lengths[k];
                let (got, expected) = (lookup(&record, x * u, Vec3::Z), below_lamp(4.0, x));
                assert!((got / expected - 1.0).abs() < 1.1 * error, "{got} for {expected}");
            }
        }
    }
}

#[test]
fn what_records_say_has_no_jump() {
    // All around, crossing every axis, with axes of very different lengths: by the edge of a
    // shadow.
    let probe =
        World { see: dark, lamp: Vec3::new(1.0, 0.5, 2.0), lit: |x: Vec3| x.x + 0.3 * x.y < 0.2 };
    let record = record(&probe, &scheme("aric11"));
    let steps = 7200;
    let at = |k: usize, radius: f32, tilt: f32| {
        let (sin, cos) = (std::f32::consts::TAU * k as f32 / steps as f32).sin_cos();
        let n = Vec3::new(tilt * cos, tilt * sin, 1.0).normalize();
        [
            lookup(&record, radius * Vec3::new(cos, sin, 0.0), Vec3::Z),
            lookup(&record, Vec3::ZERO, n),
        ]
    };
    for k in 0..steps {
        let (a, b) = (at(k, 0.1, 0.3), at((k + 1) % steps, 0.1, 0.3));
        assert!((0..2).all(|i| (a[i] - b[i]).abs() < 2e-3 * a[i]), "{k}: {a:?} {b:?}");
    }
    // The limit towards the record is its own light from all sides.
    let own = axes(&record).direct.unwrap().irradiance.x;
    assert!((0..steps).all(|k| at(k, 1e-6, 1e-3).iter().all(|x| (x / own - 1.0).abs() < 2e-3)));
}

#[test]
fn sources_give_back_the_irradiance_and_a_uniform_world_does_not_change() {
    let mut rng = lumicache::sampling::Rng::new(5);
    let numbers: Vec<f32> = (0..4096).map(|_| rng.next_f32()).collect();
    let place = |w: Vec3| ((w.x * 31.0 + w.y * 17.0 + w.z * 7.0).abs() * 100.0) as usize % 4096;
    // Distances at random, and patches that look anywhere.
    let see = |radiance: Option<f32>| {
        let numbers = &numbers;
        move |_: Vec3, w: Vec3| {
            let [a, b, c] = [0, 1, 2].map(|k| numbers[(place(w) + k) % 4096]);
            (radiance.unwrap_or(a), 0.2 + 3.0 * b, (Vec3::new(c, b, a) - 0.5 - w).normalize())
        }
    };
    let at = floor(Vec3::ZERO);
    let noise = gathered(&World { see: see(None), lamp: Vec3::Z, lit: |_| true }, &at, 1024);
    let e = noise.irradiance().x;
    assert!((noise.point_sources().irradiance_at(Vec2::ZERO).x / e - 1.0).abs() < 1e-4);
    let furnace = gathered(&World { see: see(Some(1.0)), lamp: Vec3::Z, lit: |_| true }, &at, 1024);
    let e = furnace.irradiance().x;
    for d in [Vec2::new(0.1, 0.0), Vec2::new(-0.3, 0.4), Vec2::new(0.0, 2.0)] {
        assert!((furnace.point_sources().irradiance_at(d).x / e - 1.0).abs() < 1e-4, "{d}");
        // The wedge that was not seen shines like what was.
        let tilted = furnace.point_sources().irradiance_tilted(d.normalize(), 0.3).x;
        assert!((tilted / e - 1.0).abs() < 0.01, "{tilted} for {e}");
    }
}

#[test]
fn sources_know_the_irradiance_beside_a_bright_square() {
    // A square of radiance 1 in a black ceiling at the height 2, as seen from the floor: what a
    // gather there finds, another one predicts.
    let see = |from: Vec3, w: Vec3| {
        let t = (2.0 - from.z) / w.z;
        let hit = from + t * w;
        (f32::from(u8::from(hit.x.abs() < 1.0 && hit.y.abs() < 1.0)), t, Vec3::NEG_Z)
    };
    let probe = World { see, lamp: Vec3::Z, lit: |_| true };
    let start = Vec3::new(0.45, 0.30, 0.0);
    let here = gathered(&probe, &floor(start), 16_384);
    for d in [Vec2::new(0.5, 0.0), Vec2::new(-0.6, 0.2), Vec2::new(0.3, -0.9)] {
        let at = floor(start + d.x * here.frame().s + d.y * here.frame().t);
        let there = gathered(&probe, &at, 16_384).irradiance().x;
        let predicted = here.point_sources().irradiance_at(d).x;
        assert!((predicted / there - 1.0).abs() < 0.02, "{d}: {predicted} for {there}");
    }
}

#[test]
fn light_paths_change_no_mean() {
    // Means over places and seeds of the box, with rays alone and with light paths: 3 % is four
    // standard errors of their ratio.
    let scene = build(own("cornell-box"));
    let tracer = PathTracer { scene: &scene, max_bounces: 3 };
    let probe = SceneProbe::new(tracer);
    let points = seen(&scene, &scene.cameras()[0], [12, 12], 0);
    let mean = |paths: u32| {
        let mut samples =
            HemisphereSamples::new(Layout::polar(256), Density::Cosine).with_light_paths(paths);
        let one = |(k, at): (usize, &SurfacePoint)| {
            samples.gather(&probe, at, 0, &NoDeeper, k as u64);
            assert!(
                (samples.point_sources().irradiance_at(Vec2::ZERO) / samples.irradiance() - 1.0)
                    .abs()
                    .max_element()
                    < 1e-3
            );
            assert!(paths == 0 || !samples.bundle().joints.is_empty());
            samples.irradiance()
        };
        points.iter().enumerate().map(one).sum::<Color>()
    };
    let (rays, both) = (mean(0), mean(128));
    assert!((both / rays - 1.0).abs().max_element() < 0.03, "{both} for {rays}");
}

#[test]
fn direct_light_from_records_makes_the_picture_that_shadow_rays_make() {
    let scene = build(own("cornell-box"));
    let size = [64, 64];
    let with = |contents: Contents| {
        let mut settings = cached(&scene, "aric11", size, 8);
        settings.scheme = with(aric11(0.02), |s| (s.contents, s.gather.rays) = (contents, 512));
        render(&scene, &settings)
    };
    let (records, rays) = (with(Contents::DirectAndIndirect), with(Contents::Indirect));
    assert_alike("direct light from records", &beauty(&records), &beauty(&rays), 0.0, 4e-3, 0.015);
    let direct = |frame: &lumicache::render::Frame| {
        let layer = lumicache::film::LAYERS.iter().find(|l| l.name == "diffuse_direct").unwrap();
        frame.film.channels(layer).iter().flatten().sum::<f32>()
    };
    assert!(
        (direct(&records) / direct(&rays) - 1.0).abs() < 0.02,
        "{} for {}",
        direct(&records),
        direct(&rays)
    );
    // Deeper caches and gathers read indirect light alone from the first level, too.
    let reference = render(&scene, &settings(&scene, IntegratorKind::Path, size, 128));
    assert_alike(
        "records with direct light",
        &beauty(&records),
        &beauty(&reference),
        0.0,
        1.5e-2,
        0.015,
    );
}

#[test]
fn records_hold_what_lamps_and_sky_send() {
    // A hall under luminaires and panels, and a sky that comes in by windows: the records' direct
    // light against that of many more samples.
    let environment = Some(EnvironmentMap::constant(Color::splat(2000.0)));
    let scene = build(SceneData { environment, ..own("ies-hall") });
    let points = LevelPoints::from(seen(&scene, &scene.cameras()[0], [32, 18], 0));
    let scheme = with_rays(aric11(0.1), 64);
    let (cache, _) = fill(&scene, scheme, &points);
    let records = cache.records(0);
    let held = |r: &Record<Irradiance>| luminance(axes(r).direct.unwrap().irradiance);
    assert!(records.iter().map(held).sum::<f32>() > 0.0);
    let interpolated = |p: &SurfacePoint| cache.lookup(0, p, u32::MAX)?.direct;
    let got: f32 = points.points.iter().filter_map(interpolated).map(luminance).sum();
    let probe = SceneProbe::new(PathTracer { scene: &scene, max_bounces: u32::MAX });
    let direct = |p: &SurfacePoint| {
        let samples = gathered(&probe, p, 64);
        let choice = LightChoice { samples: 4096, every: 1, seen: true, seed: 1 };
        let mut all = Vec::new();
        probe.lights(p, samples.bundle(), choice).unwrap().arriving(&[p.position], &mut all);
        all.iter().map(|a| luminance(a.light) * a.dir.dot(p.frame.n).max(0.0)).sum::<f32>()
    };
    let expected: f32 = points.points.iter().map(direct).sum();
    println!("{got} for {expected}");
    // Records with 64 rays see the sky through windows by a handful of them.
    assert!((got / expected - 1.0).abs() < 0.05, "{got} for {expected}");
}

#[test]
fn files_keep_axes_and_spare_records_without() {
    let scene = build(own("staircase"));
    let points = LevelPoints::from(seen(&scene, &scene.cameras()[0], [24, 32], 0));
    for (preset, most) in [("aric11", 1300), ("ward88", 350)] {
        let (cache, _) = fill(&scene, with_rays(scheme(preset), 64), &points);
        let file = CacheFile::new(
            &cache,
            Origin::new(BTreeMap::new(), cache.scheme(), u32::MAX, glam::DVec3::ZERO),
        );
        let bytes = file.to_bytes();
        assert!(bytes.len() < most * file.record_count() + 8192, "{preset}: {} bytes", bytes.len());
        let read = CacheFile::from_bytes(&bytes, Path::new("memory")).unwrap();
        assert!(read == file, "{preset}: the file changed a record");
        assert!(
            read.levels[0].iter().all(|r| r
                .payload
                .axes
                .as_ref()
                .is_some_and(|a| a.direct.is_some())
                == (preset == "aric11"))
        );
    }
}
