//! The bidirectional path tracer: the same light as the path tracer's, and closed forms where that
//! finds nothing.
//!
//! Two integrators agree when the difference of their mean pictures is within six standard errors,
//! which come from eight seeds of each: with 14 degrees of freedom a false alarm in 30 000
//! comparisons.

use crate::support::pictures::{build, own, render, settings};
use crate::support::rooms::{cube, diffuse, furnace, scene_of};
use lumicache::camera::Projection;
use lumicache::film::LAYERS;
use lumicache::geometry::{Instance, TriangleMesh};
use lumicache::import::{self, LightUnits, ies};
use lumicache::light::{EnvironmentMap, PunctualLight, Sky};
use lumicache::material::Material;
use lumicache::math::{Affine3A, Color, Mat3, PI, Vec3};
use lumicache::render::{IntegratorKind, Settings};
use lumicache::scene::{Scene, SceneData};
use std::path::Path;
use std::sync::Arc;

const SIZE: [u32; 2] = [24, 18];
const PARTS: [&str; 5] =
    ["diffuse_direct", "diffuse_indirect", "glossy_direct", "glossy_indirect", "emission"];

/// The mean of each part over the picture and the channels.
fn parts(scene: &Scene, settings: &Settings) -> [f64; 5] {
    let frame = render(scene, settings);
    PARTS.map(|name| {
        let channels = frame.film.channels(LAYERS.iter().find(|l| l.name == name).unwrap());
        channels.iter().flatten().map(|v| f64::from(*v)).sum::<f64>()
            / channels.iter().map(Vec::len).sum::<usize>() as f64
    })
}

/// The mean and its squared standard error.
fn statistics(values: &[f64]) -> (f64, f64) {
    let n = values.len() as f64;
    let mean = values.iter().sum::<f64>() / n;
    (mean, values.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / (n * (n - 1.0)))
}

/// Both integrators agree in all five parts and in the beauty.
fn assert_alike(what: &str, scene: &Scene, spp: [u32; 2], change: impl Fn(&mut Settings)) {
    let runs = |integrator, spp| -> Vec<[f64; 5]> {
        let run = |seed| {
            let mut settings = Settings { seed, ..settings(scene, integrator, SIZE, spp) };
            change(&mut settings);
            parts(scene, &settings)
        };
        (0..8).map(run).collect()
    };
    let (path, bdpt) = (runs(IntegratorKind::Path, spp[0]), runs(IntegratorKind::Bdpt, spp[1]));
    for k in 0..=5 {
        let pick = |runs: &[[f64; 5]]| {
            statistics(
                &runs
                    .iter()
                    .map(|r| r.get(k).copied().unwrap_or_else(|| r.iter().sum()))
                    .collect::<Vec<_>>(),
            )
        };
        let ((a, va), (b, vb)) = (pick(&path), pick(&bdpt));
        let (error, name) = ((va + vb).sqrt(), PARTS.get(k).unwrap_or(&"beauty"));
        eprintln!("{what}, {name}: {a:.5} ± {:.5} path, {b:.5} ± {:.5} bdpt", va.sqrt(), vb.sqrt());
        assert!(
            (a - b).abs() <= 6.0 * error + 1e-6 * a,
            "{what}, {name}: {a} by path, {b} by bdpt, standard error {error}"
        );
    }
}

#[test]
fn the_cornell_box_is_the_path_tracer_s() {
    assert_alike("diffuse", &build(own("cornell-box")), [24, 8], |_| ());
    assert_alike("two bounces", &build(own("cornell-box")), [24, 8], |s| s.max_bounces = 2);
    assert_alike("window", &build(own("cornell-box")), [24, 8], |s| s.window = [5, 3, 20, 17]);
}

#[test]
fn gloss_glass_and_caustics_are_the_path_tracer_s() {
    assert_alike("glossy floor", &build(own("cornell-box-glossy")), [24, 8], |_| ());
    assert_alike("still life", &build(own("glossy-still-life")), [16, 8], |_| ());
    assert_alike("mirrors and their caustics", &build(own("mirror-room")), [32, 8], |_| ());
    assert_alike("leaves", &build(own("alpha-leaves")), [16, 6], |_| ());
}

/// Those scenes of `scenes/` that the tests above do not have.
#[test]
fn every_scene_is_the_path_tracer_s() {
    for name in [
        "cornell-box-phong",
        "curved-spheres",
        "glossy-walk",
        "ies-hall",
        "indirect-room",
        "many-light-hall",
        "metal-hall",
        "phong-pot",
        "pyramid-metal",
        "slit-light",
        "staircase",
        "staircase-room",
        "two-glossy-planes",
        "two-rooms-gap",
        "ward-floor",
    ] {
        assert_alike(name, &build(own(name)), [12, 6], |_| ());
    }
}

#[test]
fn absorbing_glass_is_the_path_tracer_s() {
    // A solid of rough green glass around a diffuse core, under a sky.
    let mut data = own("curved-spheres");
    let sphere = data.materials.iter().position(|m| m.emission == Color::ZERO).unwrap();
    let glass = Material {
        transmission: 1.0,
        thin: false,
        metallic: 0.0,
        specular: 1.0,
        roughness: 0.4,
        attenuation_color: Color::new(0.4, 0.9, 0.5),
        attenuation_distance: 0.3,
        ..data.materials[sphere].clone()
    };
    data.materials[sphere] = glass;
    assert_alike("glass", &build(data), [32, 12], |_| ());
}

#[test]
fn skies_and_smooth_normals_are_the_path_tracer_s() {
    let mut data = own("curved-spheres");
    let sky = Sky::parse("clear,azimuth=150,elevation=40").unwrap();
    let (map, sun) = import::sky(&sky, LightUnits::Radiometric, 0.0, 0.1).unwrap();
    data.environment = Some(map);
    data.punctual.extend(sun);
    assert_alike("sky and sun", &build(data), [24, 12], |_| ());
}

/// A room of 4 by 3 by 4 with a window of 1 by 1, under a sky and its sun, on a black ground. On
/// its floor a `mirror` may lie where the sun shines.
fn room_with_a_window(ground: f32, mirror: bool) -> SceneData {
    let quad = |corner: Vec3, u: Vec3, v: Vec3, material| TriangleMesh {
        positions: vec![corner, corner + u, corner + u + v, corner + v].into(),
        indices: vec![[0, 1, 2], [0, 2, 3]].into(),
        material,
        ..TriangleMesh::default()
    };
    let at = Vec3::new;
    let (x, y, z) = (Vec3::X, Vec3::Y, Vec3::Z);
    let floor = quad(at(-2.0, 0.0, 2.0), 4.0 * x, -4.0 * z, 0);
    let wall = Material {
        base_color: Color::splat(0.7),
        metallic: 0.0,
        specular: 0.0,
        double_sided: true,
        ..Material::default()
    };
    let mut data =
        scene_of(floor, wall.clone(), Vec3::new(1.8, 1.5, -1.8), Vec3::new(-1.0, 1.5, 2.0));
    data.materials.push(Material { base_color: Color::ZERO, ..wall.clone() });
    let polished = Material { metallic: 1.0, roughness: 0.0, ..wall.clone() };
    data.materials.push(if mirror { polished } else { wall });
    for mesh in [
        quad(at(-2.0, 3.0, 2.0), 4.0 * x, -4.0 * z, 0),
        quad(at(-2.0, 0.0, 2.0), 4.0 * x, 3.0 * y, 0),
        quad(at(2.0, 0.0, 2.0), -4.0 * z, 3.0 * y, 0),
        quad(at(-2.0, 0.0, 2.0), -4.0 * z, 3.0 * y, 0),
        // The wall with the window: below, above and beside it.
        quad(at(-2.0, 0.0, -2.0), 4.0 * x, 1.0 * y, 0),
        quad(at(-2.0, 2.0, -2.0), 4.0 * x, 1.0 * y, 0),
        quad(at(-2.0, 1.0, -2.0), 1.5 * x, 1.0 * y, 0),
        quad(at(0.5, 1.0, -2.0), 1.5 * x, 1.0 * y, 0),
        quad(at(-0.5, 0.01, 0.2), 1.5 * x, -1.5 * z, 2),
        quad(at(-ground, -0.5, ground), 2.0 * ground * x, -2.0 * ground * z, 1),
    ] {
        let number = data.geometry.meshes.len() as u32;
        data.geometry.meshes.push(Arc::new(mesh));
        data.geometry.instances.push(Instance { mesh: number, to_world: Affine3A::IDENTITY });
    }
    // Dark below the horizon, where a small ground would let light pass.
    let sky = [Color::ONE, Color::ZERO].map(|c| vec![c; 64 * 64]).concat();
    data.environment = Some(EnvironmentMap {
        width: 64,
        height: 128,
        pixels: sky,
        scale: 1.0,
        from_world: Affine3A::IDENTITY,
    });
    data.punctual = vec![PunctualLight::Directional {
        direction: Vec3::new(0.2, -1.0, 1.0).normalize(),
        irradiance: Color::splat(3.0),
    }];
    data
}

#[test]
fn a_ground_plane_of_100_km_leaves_light_from_the_sky_alone() {
    assert_alike("a room on a plane", &build(room_with_a_window(1e5, false)), [64, 8], |_| ());
    // Sums over the pixels, of means and of their variances, with a caustic that light paths alone
    // find.
    let [small, large] = [3.0, 1e5].map(|ground| {
        let scene = build(room_with_a_window(ground, true));
        let run = |seed| {
            let settings = Settings { seed, ..settings(&scene, IntegratorKind::Bdpt, SIZE, 32) };
            render(&scene, &settings).film.radiance()
        };
        let runs: Vec<_> = (0..16).map(run).collect();
        let pixel =
            |k: usize| statistics(&runs.iter().map(|r| f64::from(r[k].x)).collect::<Vec<_>>());
        let pixels = (0..runs[0].len()).map(pixel);
        pixels.fold([0.0; 2], |sums, (mean, variance)| [sums[0] + mean, sums[1] + variance])
    });
    eprintln!("mean and variance: {small:?} on a small ground, {large:?} on a large one");
    let error = (small[1] + large[1]).sqrt();
    assert!((large[0] - small[0]).abs() < 6.0 * error, "{small:?} {large:?}");
    assert!(6.0 * error < 0.2 * small[0], "the caustic, a third of all light, would be noise");
    assert!(large[1] / small[1] < 2.0, "noise: {small:?} {large:?}");
}

#[test]
fn punctual_lights_and_luminaires_are_the_path_tracer_s() {
    let profile =
        ies(&Path::new(env!("CARGO_MANIFEST_DIR"))
            .join("tests/import/corpus/ies/c-90-270-1995.ies"))
        .unwrap();
    let mut data = cube(diffuse());
    data.punctual = vec![
        PunctualLight::Point {
            position: Vec3::new(0.3, 0.5, -0.2),
            intensity: Color::new(1.0, 2.0, 3.0),
            range: 2.0,
        },
        PunctualLight::Spot {
            position: Vec3::new(-0.5, 0.8, 0.0),
            direction: Vec3::new(0.6, -0.8, 0.0),
            intensity: Color::splat(6.0),
            range: f32::INFINITY,
            inner: 0.1,
            outer: 0.3,
        },
        PunctualLight::Ies {
            position: Vec3::new(0.0, 0.9, 0.3),
            from_world: Mat3::from_rotation_x(0.5 * PI),
            scale: Color::splat(0.01),
            range: f32::INFINITY,
            profile: Arc::new(profile),
        },
    ];
    let scene = build(data);
    assert_alike("punctual", &scene, [16, 6], |_| ());
    // Seen by a parallel projection too.
    assert_alike("orthographic", &scene, [16, 6], |s| {
        s.camera.projection = Projection::Orthographic { xmag: 0.4, ymag: 0.3 }
    });
}

#[test]
fn the_furnace_has_its_series() {
    let scene = furnace(diffuse());
    for (max_bounces, terms) in [(0, 2), (1, 3), (u32::MAX, 200)] {
        let settings =
            Settings { max_bounces, ..settings(&scene, IntegratorKind::Bdpt, [24, 16], 32) };
        let pixels = render(&scene, &settings).film.radiance();
        let mean = pixels.iter().sum::<Color>() / pixels.len() as f32;
        let series = |albedo: f32| (1.0 - albedo.powi(terms)) / (1.0 - albedo);
        let expected = Color::new(series(0.2), 0.5 * series(0.5), 0.3 * series(0.7));
        // 12 288 samples, each spread by less than half its mean: a standard error below 0.5 %.
        assert!(
            (mean / expected - Color::ONE).abs().max_element() < 0.02,
            "{max_bounces} bounces: {mean}, not {expected}"
        );
    }
}

/// A wall of side 0.2 beside a mirror on the floor, a spot light above both.
fn mirror_and_wall() -> SceneData {
    let quad = |corner: Vec3, u: Vec3, v: Vec3, material| TriangleMesh {
        positions: vec![corner, corner + u, corner + u + v, corner + v].into(),
        indices: vec![[0, 1, 2], [0, 2, 3]].into(),
        material,
        ..TriangleMesh::default()
    };
    let wall = quad(Vec3::new(2.0, 0.9, 0.1), Vec3::Z * -0.2, Vec3::Y * 0.2, 0);
    let mirror = quad(Vec3::new(-3.0, 0.0, 3.0), Vec3::X * 6.0, Vec3::Z * -6.0, 1);
    let material = Material {
        base_color: Color::splat(0.5),
        metallic: 0.0,
        specular: 0.0,
        double_sided: true,
        ..Material::default()
    };
    let mut data =
        scene_of(wall, material.clone(), Vec3::new(1.0, 1.0, 0.0), Vec3::new(2.0, 1.0, 0.0));
    data.geometry.meshes.push(Arc::new(mirror));
    data.geometry.instances.push(Instance { mesh: 1, to_world: Affine3A::IDENTITY });
    data.materials.push(Material {
        base_color: Color::splat(0.8),
        metallic: 1.0,
        roughness: 0.0,
        ..material
    });
    // It shines on the mirror alone, where that shows the wall.
    data.punctual = vec![PunctualLight::Spot {
        position: Vec3::new(0.0, 1.0, 0.0),
        direction: Vec3::new(1.0, -1.0, 0.0).normalize(),
        intensity: Color::splat(10.0),
        range: f32::INFINITY,
        inner: 0.015,
        outer: 0.02,
    }];
    data
}

#[test]
fn a_caustic_of_a_spot_light_has_its_closed_form() {
    let scene = build(mirror_and_wall());
    let mut settings =
        Settings { max_bounces: 1, ..settings(&scene, IntegratorKind::Bdpt, [8, 8], 1024) };
    settings.camera.projection = Projection::Orthographic { xmag: 0.09, ymag: 0.09 };
    let frame = render(&scene, &settings);
    let channels =
        frame.film.channels(LAYERS.iter().find(|l| l.name == "diffuse_indirect").unwrap());
    let mean = channels[0].iter().map(|v| f64::from(*v)).sum::<f64>() / 64.0;
    // The light's image stands as far below the mirror; F is Schlick's at the angle of incidence,
    // with F0 = 0.8.
    let (mut expected, n) = (0.0, 200);
    for i in 0..n * n {
        let place = |k: i32| -0.09 + 0.18 * (f64::from(k) + 0.5) / f64::from(n);
        let (y, z) = (1.0 + place(i / n), place(i % n));
        let (dx, dy) = (2.0, y + 1.0);
        let squared = dx * dx + dy * dy + z * z;
        let fresnel = 0.8 + 0.2 * (1.0 - dy / squared.sqrt()).powi(5);
        expected +=
            10.0 * fresnel * dx / squared.powf(1.5) * 0.5 / std::f64::consts::PI / f64::from(n * n);
    }
    // About 1500 of the 65 536 light paths find the 0.18 m square by the mirror: a standard error
    // of 2.6 %.
    assert!((mean / expected - 1.0).abs() < 0.15, "{mean}, not {expected}");
    let path =
        render(&scene, &Settings { integrator: IntegratorKind::Path, spp: 4, ..settings.clone() });
    let found = path.film.channels(LAYERS.iter().find(|l| l.name == "diffuse_indirect").unwrap());
    assert!(found[0].iter().all(|v| *v == 0.0), "a path tracer cannot find this caustic");
}

#[test]
fn threads_do_not_change_a_bit() {
    let scene = build(own("mirror-room"));
    let run = |threads, seed| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        // More tiles than are merged at once, and two passes.
        let settings = Settings {
            seed,
            max_bounces: 2,
            ..settings(&scene, IntegratorKind::Bdpt, [176, 112], 17)
        };
        pool.install(|| render(&scene, &settings)).film.radiance()
    };
    let one = run(1, 0);
    assert!(run(2, 0) == one && run(3, 0) == one && run(2, 1) != one);
    assert!(one.iter().all(|c| c.is_finite() && c.min_element() >= 0.0));
}
