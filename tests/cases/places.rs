//! Scenes far from the origin, tiny, huge, in the middle of a desert.

use crate::support::gltf_maker::{Gltf, shorts};
use crate::support::pictures::{build, load, own, render, settings};
use crate::support::statistics::Rng;
use crate::support::testdata;
use glam::Quat;
use lumicache::accel::{Accel, Backend, Ray};
use lumicache::geometry::{Geometry, Instance, SurfacePoint, TriangleMesh, interpolate};
use lumicache::import::{ImportOptions, gltf};
use lumicache::math::{Affine3A, Mat3, Vec3, luminance};
use lumicache::render::{IntegratorKind, Settings};
use lumicache::scene::{Scene, SceneData};
use serde_json::{Value, json};
use std::path::Path;
use std::sync::Arc;

const INTEGRATORS: [IntegratorKind; 3] =
    [IntegratorKind::Cache, IntegratorKind::Path, IntegratorKind::Bdpt];

/// Mean of the channels of a picture, or of its middle.
fn mean(scene: &Scene, settings: &Settings, middle: bool) -> f32 {
    let film = render(scene, settings).film;
    let [width, height] = settings.size.map(|n| n as usize);
    let pixels = film.radiance();
    let inside = |i: &usize| {
        let (x, y) = (i % width, i / width);
        !middle || (x.abs_diff(width / 2) <= 2 && y.abs_diff(height / 2) <= 2)
    };
    let chosen: Vec<usize> = (0..width * height).filter(inside).collect();
    chosen.iter().map(|i| pixels[*i].element_sum() / 3.0).sum::<f32>() / chosen.len() as f32
}

/// A scene of scenes/ under one more node.
fn under(name: &str, node: Value) -> SceneData {
    changed(name, |document| {
        let nodes = document["nodes"].as_array_mut().unwrap();
        nodes.push(node);
        let root = nodes.len() - 1;
        let children = document["scenes"][0]["nodes"].take();
        document["nodes"][root]["children"] = children;
        document["scenes"][0]["nodes"] = json!([root]);
    })
}

fn changed(name: &str, change: impl FnOnce(&mut Value)) -> SceneData {
    let scenes = Path::new(env!("CARGO_MANIFEST_DIR")).join("scenes");
    let text = std::fs::read(scenes.join(format!("{name}.gltf"))).unwrap();
    let mut document: Value = serde_json::from_slice(&text).unwrap();
    change(&mut document);
    let folder = tempfile::tempdir().unwrap();
    let bin = format!("{name}.bin");
    std::fs::copy(scenes.join(&bin), folder.path().join(&bin)).unwrap();
    let path = folder.path().join("moved.gltf");
    std::fs::write(&path, document.to_string()).unwrap();
    gltf(&path, &ImportOptions::default()).unwrap()
}

/// Records on the first level and the mean of the picture, over a few seeds, by the cache; and the
/// mean by the path tracer.
fn look(data: SceneData) -> [f32; 3] {
    let scene = build(data);
    let size = [96, 64];
    let (mut records, mut sum) = (0, 0.0);
    const SEEDS: u64 = 4;
    for seed in 0..SEEDS {
        let settings = Settings { seed, ..settings(&scene, IntegratorKind::Cache, size, 16) };
        let frame = render(&scene, &settings);
        records += frame.caches.unwrap().cache.records(0).len();
        let pixels = frame.film.radiance();
        sum += pixels.iter().map(|c| luminance(*c)).sum::<f32>() / pixels.len() as f32;
    }
    let path = mean(&scene, &settings(&scene, IntegratorKind::Path, size, 64), false);
    [records as f32 / SEEDS as f32, sum / SEEDS as f32, path]
}

#[test]
fn scenes_look_the_same_wherever_they_are_and_whatever_their_unit() {
    for name in ["cornell-box", "staircase-room"] {
        let expected = look(own(name));
        let axis = Vec3::new(1.0, 2.0, 3.0).normalize();
        let turned = Quat::from_axis_angle(axis, 1.3).to_array();
        for node in [
            json!({"translation": [1e6 + 0.123, -3e5, 7.7e5]}),
            json!({"translation": [60.0, 3.0, -20.0]}),
            json!({"scale": [1e6, 1e6, 1e6]}),
            json!({"scale": [1e-6, 1e-6, 1e-6]}),
            json!({"rotation": turned}),
        ] {
            let text = node.to_string();
            let found = look(under(name, node));
            for (what, found, expected, tolerance) in [
                ("records", found[0], expected[0], 0.025),
                ("mean", found[1], expected[1], 0.015),
                ("mean of paths", found[2], expected[2], 0.03),
            ] {
                assert!(
                    (found / expected - 1.0).abs() < tolerance,
                    "{name} {text}: {what} {found}, not {expected}"
                );
            }
        }
    }
}

#[test]
fn a_ground_plane_of_100_km_leaves_the_records_of_a_room_alone() {
    let count = |data: SceneData| {
        let scene = build(data);
        let frame = render(&scene, &settings(&scene, IntegratorKind::Cache, [96, 64], 4));
        let cache = frame.caches.unwrap().cache;
        [0, 1].map(|level| cache.records(level).len() as f32)
    };
    let expected = count(own("staircase-room"));
    for reach in [1e3, 1e5] {
        let mut data = own("staircase-room");
        let floor = data.geometry.bounds().min.y - 0.5;
        let mesh = square(reach);
        data.geometry.meshes.push(Arc::new(mesh));
        data.geometry.instances.push(Instance {
            mesh: data.geometry.meshes.len() as u32 - 1,
            to_world: Affine3A::from_translation(floor * Vec3::Y),
        });
        let found = count(data);
        for (found, expected) in found.iter().zip(expected) {
            let difference = (found / expected - 1.0).abs();
            assert!(difference < 0.02, "a plane of {reach}: {found} records, not {expected}");
        }
    }
}

/// A square of the plane y = 0.
fn square(reach: f32) -> TriangleMesh {
    let corner = |x: f32, z: f32| Vec3::new(x * reach, 0.0, z * reach);
    TriangleMesh {
        positions: vec![corner(-1., -1.), corner(-1., 1.), corner(1., 1.), corner(1., -1.)].into(),
        indices: vec![[0, 1, 2], [0, 2, 3]].into(),
        ..Default::default()
    }
}

/// A table under a lamp 20 cm above it, moved to `at`: by the node or in the vertices.
fn lamp_above_table(at: [f64; 3], in_vertices: bool) -> SceneData {
    let mut file = Gltf::new();
    let diffuse = json!({"pbrMetallicRoughness": {"baseColorFactor": [0.5, 0.5, 0.5, 1.0],
        "metallicFactor": 0.0}, "doubleSided": true,
        "extensions": {"KHR_materials_specular": {"specularFactor": 0.0}}});
    let lamp = json!({"emissiveFactor": [1.0, 1.0, 1.0], "doubleSided": true,
        "extensions": {"KHR_materials_emissive_strength": {"emissiveStrength": 10.0}}});
    let mut nodes = Vec::new();
    for (height, half, material) in [(0.7, 0.6, diffuse), (0.9, 0.05, lamp)] {
        let material = file.add("materials", material);
        let offset = if in_vertices { at } else { [0.0; 3] };
        let corners = [[-half, -half], [-half, half], [half, half], [half, -half]];
        let place =
            |[x, z]: [f64; 2]| [x + offset[0], height + offset[1], z + offset[2]].map(|v| v as f32);
        let positions = file.positions(&corners.map(place).concat());
        let indices =
            file.accessor(&shorts(&[0, 1, 2, 0, 2, 3]), 5123, "SCALAR", 6, json!({}), None);
        let mesh = file.add(
            "meshes",
            json!({"primitives": [{"attributes": {"POSITION": positions}, "indices": indices,
                "material": material}]}),
        );
        let translation = if in_vertices { [0.0; 3] } else { at };
        nodes.push(file.node(json!({"mesh": mesh, "translation": translation})));
    }
    let camera = file.add(
        "cameras",
        json!({"type": "perspective", "perspective": {"yfov": 0.4, "znear": 0.01}}),
    );
    // From the side, below the lamp.
    let eye = [at[0], at[1] + 0.78, at[2] + 0.5];
    let tilt = -(0.08_f64 / 0.5).atan() / 2.0;
    nodes.push(file.node(json!({"camera": camera, "translation": eye,
        "rotation": [tilt.sin(), 0.0, 0.0, tilt.cos()]})));
    file.scene(&nodes);
    file.load()
}

#[test]
fn a_lamp_lights_its_table_wherever_both_stand() {
    for integrator in INTEGRATORS {
        let of = |data| {
            let scene = build(data);
            mean(&scene, &settings(&scene, integrator, [32, 24], 32), true)
        };
        let expected = of(lamp_above_table([0.0; 3], false));
        assert!(expected > 0.1, "{integrator:?}: {expected}");
        for at in [[6.0, 1.5, 3.0], [100.0, 0.0, 0.0], [1e6, 2e5, -3e5]] {
            for in_vertices in [false, true] {
                // Vertices resolve 6 cm there.
                if in_vertices && at[0] > 1e5 {
                    continue;
                }
                let found = of(lamp_above_table(at, in_vertices));
                assert!(
                    (found / expected - 1.0).abs() < 0.02,
                    "{integrator:?} at {at:?} {in_vertices}: {found}, not {expected}"
                );
            }
        }
    }
}

#[test]
fn rooms_and_lamps_of_the_cases_are_right() {
    let Some(folder) = testdata::find("cases") else { return };
    for (files, size, spp, middle, expected) in [
        (
            [
                "lamp-near-surface/same_at_origin",
                "lamp-near-surface/lamp_20cm_above_table_6m_from_origin",
            ],
            [64, 48],
            64,
            true,
            0.325,
        ),
        (["room-far/room_at_origin", "room-far/room_100m_from_origin"], [80, 60], 64, false, 0.176),
    ] {
        for file in files {
            let scene = build(load(&folder.join(format!("{file}.gltf"))));
            for integrator in INTEGRATORS {
                let found = mean(&scene, &settings(&scene, integrator, size, spp), middle);
                let difference = (found / expected - 1.0).abs();
                assert!(difference < 0.03, "{file} {integrator:?}: {found}, not {expected}");
            }
        }
    }
}

#[test]
fn rays_leave_the_triangle_that_they_start_on() {
    let mut rng = Rng(11);
    let number = &mut || rng.next() * 2.0 - 1.0;
    for backend in crate::support::pictures::backends() {
        for shared in [false, true] {
            for trial in 0..300 {
                let scale = 10.0_f32.powf(6.0 * number());
                let mut vector = |size: f32| size * Vec3::new(number(), number(), number());
                let shift = vector(100.0 * scale);
                let corners = [0; 3].map(|_| shift + vector(scale));
                let turn = Mat3::from_quat(Quat::from_axis_angle(
                    vector(1.0).try_normalize().unwrap_or(Vec3::X),
                    vector(3.0).x,
                ));
                let to_world = Affine3A::from_mat3_translation(turn, vector(1000.0 * scale));
                // A mesh of more triangles, used twice, is traced in its own space.
                let copies = if shared { 40 } else { 1 };
                let away = |k: usize| (k as f32) * 1e4 * scale * Vec3::ONE;
                let mesh = TriangleMesh {
                    positions: (0..copies)
                        .flat_map(|k| corners.map(|c| c + away(k)))
                        .collect::<Vec<_>>()
                        .into(),
                    indices: (0..copies as u32)
                        .map(|k| [3 * k, 3 * k + 1, 3 * k + 2])
                        .collect::<Vec<_>>()
                        .into(),
                    ..Default::default()
                };
                let far = Affine3A::from_translation(Vec3::splat(-1e6 * scale));
                let geometry = Geometry {
                    meshes: vec![Arc::new(mesh)],
                    instances: [to_world, far]
                        .into_iter()
                        .take(if shared { 2 } else { 1 })
                        .map(|to_world| Instance { mesh: 0, to_world })
                        .collect(),
                };
                leaves(&geometry, *backend, number, trial);
            }
        }
    }
}

/// Rays from points of the first triangle do not hit it.
fn leaves(geometry: &Geometry, backend: Backend, number: &mut impl FnMut() -> f32, trial: u32) {
    let data = SceneData {
        geometry: geometry.clone(),
        materials: vec![Default::default()],
        ..Default::default()
    };
    let scene = Scene::new(data, backend).unwrap().0;
    let accel: &Accel = scene.accel();
    for _ in 0..8 {
        let (a, b) = (number().abs(), number().abs());
        let (u, v) = if a + b < 1.0 { (a, b) } else { (1.0 - a, 1.0 - b) };
        let dir = Vec3::new(number(), number(), number());
        let Some(dir) = dir.try_normalize() else { continue };
        // As a hit of the scene: with the error that instances in their own space have.
        let seen = interpolate(geometry, 0, 0, u, v, -dir);
        let hit = lumicache::accel::Hit { t: 1.0, u, v, instance: 0, triangle: 0 };
        let point: SurfacePoint = scene.surface(&hit, -dir);
        assert!(point.error >= seen.error && point.error > 0.0);
        let ray = Ray::new(point.leave(dir), dir);
        let found = accel.intersect(&ray);
        assert!(
            !found.is_hit() || (found.instance, found.triangle) != (0, 0),
            "{} trial {trial}: {found:?} from {point:?}",
            backend.name()
        );
    }
}
