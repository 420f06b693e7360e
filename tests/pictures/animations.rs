//! Cameras that move: read from glTF, and rendered with records that all frames share.

use crate::support::desk::{Desk, QUICK, scene, text};
use crate::support::gltf_maker::{Gltf, floats, shorts, triangle};
use crate::support::pictures::{beauty, build, cached, difference, own};
use lumicache::imagefile::exr;
use lumicache::math::Vec3;
use lumicache::render::{Frames, Job, Rendering, workers};
use lumicache::scene::SceneData;
use serde_json::{Value, json};

const LENS: &str = r#"{"type": "perspective", "perspective": {"yfov": 1, "znear": 0.1}}"#;

/// A file with a camera on node 1 below node 0, and a triangle.
fn camera_below(parent: Value, own: Value) -> Gltf {
    let mut file = Gltf::new();
    let mesh = triangle(&mut file);
    file.add("cameras", serde_json::from_str(LENS).unwrap());
    let mut parent = parent;
    parent["children"] = json!([1]);
    let mut own = own;
    own["camera"] = json!(0);
    file.node(parent);
    file.node(own);
    file.node(json!({"mesh": mesh}));
    file
}

/// Adds an animation of one property of one node.
fn animate(
    file: &mut Gltf, node: usize, path: &str, interpolation: &str, times: &[f32], values: &[f32],
) {
    let shape = if path == "rotation" { "VEC4" } else { "VEC3" };
    let width = if path == "rotation" { 4 } else { 3 };
    let bounds = json!({"min": [times[0]], "max": [times[times.len() - 1]]});
    let input = file.accessor(&floats(times), 5126, "SCALAR", times.len(), bounds, None);
    let output = file.accessor(&floats(values), 5126, shape, values.len() / width, json!({}), None);
    file.add(
        "animations",
        json!({
            "samplers": [{"input": input, "output": output, "interpolation": interpolation}],
            "channels": [{"sampler": 0, "target": {"node": node, "path": path}}]
        }),
    );
}

/// Where the camera stands at some second, and where it looks.
fn at(scene: &SceneData, seconds: f64) -> (Vec3, Vec3) {
    let to_world = scene.motions[0].as_ref().expect("a motion").at(seconds).expect("a direction");
    (to_world.translation.into(), -Vec3::from(to_world.matrix3.z_axis))
}

fn near(a: Vec3, b: Vec3) -> bool {
    (a - b).length() < 1e-5
}

#[test]
fn tracks_of_the_camera_and_of_nodes_above_it() {
    let quarter = std::f32::consts::FRAC_1_SQRT_2;
    let mut file = camera_below(json!({"translation": [0, 0, 5]}), json!({"scale": [2, 2, 2]}));
    animate(&mut file, 1, "translation", "LINEAR", &[0.0, 2.0], &[0.0, 0.0, 0.0, 4.0, 0.0, 0.0]);
    animate(
        &mut file,
        0,
        "rotation",
        "STEP",
        &[0.0, 1.0],
        &[0.0, 0.0, 0.0, 1.0, 0.0, quarter, 0.0, quarter],
    );
    let scene = file.load();
    assert!(scene.warnings.iter().all(|w| w.contains("no scene")), "{:?}", scene.warnings);
    let (place, looks) = at(&scene, 0.5);
    assert!(near(place, Vec3::new(1.0, 0.0, 5.0)) && near(looks, Vec3::NEG_Z), "{place} {looks}");
    // The parent has turned by a quarter: its x points along -z.
    let (place, looks) = at(&scene, 1.5);
    assert!(near(place, Vec3::new(0.0, 0.0, 2.0)) && near(looks, Vec3::NEG_X), "{place} {looks}");
    // Without animation the camera is where it always was.
    assert!(near(scene.cameras[0].to_world.translation.into(), Vec3::new(0.0, 0.0, 5.0)));
}

#[test]
fn cubic_and_packed_tracks() {
    let mut file = camera_below(
        json!({"matrix": [0, 0, -1, 0, 0, 1, 0, 0, 1, 0, 0, 0, 7, 8, 9, 1]}),
        json!({}),
    );
    let cubic = [[0.0; 3], [1.0; 3], [0.0; 3], [0.0; 3], [3.0; 3], [0.0; 3]].concat();
    animate(&mut file, 1, "translation", "CUBICSPLINE", &[1.0, 3.0], &cubic);
    let input = file.accessor(
        &floats(&[0.0, 1.0]),
        5126,
        "SCALAR",
        2,
        json!({"min": [0], "max": [1]}),
        None,
    );
    let turns = shorts(&[0, 0, 0, 32767, 0, 32767, 0, 0]);
    let output = file.accessor(&turns, 5122, "VEC4", 2, json!({"normalized": true}), None);
    file.add(
        "animations",
        json!({
            "samplers": [{"input": input, "output": output}],
            "channels": [{"sampler": 0, "target": {"node": 1, "path": "rotation"}}]
        }),
    );
    let scene = file.load();
    // Half way along a cubic with flat ends, by half a turn; the matrix takes z to x.
    let (place, looks) = at(&scene, 2.0);
    assert!(
        near(place, Vec3::new(7.0 + 2.0, 8.0 + 2.0, 9.0 - 2.0)) && near(looks, Vec3::X),
        "{place} {looks}"
    );
}

#[test]
fn cameras_that_stand_still_say_so() {
    let mut file = camera_below(json!({}), json!({}));
    animate(&mut file, 2, "translation", "LINEAR", &[0.0], &[0.0, 0.0, 0.0]);
    assert_eq!(file.load().motions, [None]);
    // Of two animations of one property the first counts.
    let mut file = camera_below(json!({}), json!({}));
    animate(&mut file, 1, "translation", "STEP", &[0.0], &[1.0, 0.0, 0.0]);
    animate(&mut file, 1, "translation", "STEP", &[0.0], &[2.0, 0.0, 0.0]);
    let scene = file.load();
    assert!(near(at(&scene, 0.0).0, Vec3::X));
    assert!(
        scene.warnings.iter().any(|w| w.contains("/animations/1/channels/0")),
        "{:?}",
        scene.warnings
    );
}

#[test]
fn broken_animations_are_refused_by_place() {
    let line = [0.0, 0.0, 0.0, 1.0, 0.0, 0.0];
    for (path, interpolation, times, values, place) in [
        ("translation", "LINEAR", &[1.0, 0.5][..], &line[..], "/animations/0/samplers/0/input"),
        ("translation", "LINEAR", &[-1.0, 0.5], &line, "/animations/0/samplers/0/input"),
        ("translation", "CUBICSPLINE", &[0.0, 1.0], &line, "/animations/0/samplers/0/output"),
        ("translation", "SPLINE", &[0.0, 1.0], &line, "/animations/0/samplers/0/interpolation"),
        ("rotation", "LINEAR", &[0.0], &[0.0; 8], "/animations/0/samplers/0/output"),
    ] {
        let mut file = camera_below(json!({}), json!({}));
        animate(&mut file, 1, path, interpolation, times, values);
        // The declared bounds of the times are not what is looked at here.
        let mut document = file.document().clone();
        for accessor in document["accessors"].as_array_mut().unwrap() {
            let accessor = accessor.as_object_mut().unwrap();
            accessor.remove("min");
            accessor.remove("max");
        }
        let folder = tempfile::tempdir().unwrap();
        let file_name = folder.path().join("made.glb");
        std::fs::write(&file_name, file.glb_of(&document)).unwrap();
        let error =
            lumicache::import::gltf(&file_name, &Default::default()).unwrap_err().to_string();
        assert!(error.contains(place), "{error} does not name {place}");
    }
    let mut file = camera_below(json!({}), json!({}));
    file.add(
        "animations",
        json!({"samplers": [], "channels": [{"sampler": 0, "target": {"path": "scale"}}]}),
    );
    let error = file.try_load(&Default::default()).unwrap_err().to_string();
    assert!(error.contains("/animations/0/channels/0/sampler"), "{error}");
}

#[test]
fn frames_share_records() {
    let data = own("glossy-walk");
    let scene = build(data);
    let mut scheme = cached(&scene, "krivanek05", [48, 48], 4).scheme;
    scheme.gather.rays = 128;
    let run = |threads: usize| {
        let job = Job::new(&scene).scheme(scheme.clone()).size(48, 48).spp(4);
        let cameras = job.cameras(Frames { first: 0, last: 3 }, 24.0).unwrap();
        let mut pictures = Vec::new();
        let take = |_, picture: &Rendering| {
            let film = &picture.frame.film;
            let lookups = film.pixels().iter().map(|p| p.lookups());
            let lookups = lookups.fold((0, 0), |(a, b), (c, d)| (a + c, b + d));
            pictures.push((beauty(&picture.frame), lookups));
            Ok(())
        };
        let sequence =
            workers(threads).unwrap().install(|| job.run_sequence(&cameras, take)).unwrap();
        let growth: Vec<_> = sequence.costs.into_iter().map(|cost| cost.growth).collect();
        let cache = sequence.last.frame.caches.unwrap().cache;
        let records = cache.record_count() + cache.radiance_record_count();
        (growth, records, pictures)
    };
    let (growth, records, pictures) = run(2);
    assert_eq!(growth.iter().map(|g| g.records()).sum::<usize>(), records);
    assert!(growth[0].radiance > 50 && growth[0].levels[0] > 50, "{growth:?}");
    for later in &growth[1..] {
        assert!(
            5 * later.records() < growth[0].records(),
            "a step of the camera needs hardly any records: {growth:?}"
        );
    }
    for (_, (lookups, misses)) in &pictures {
        assert!(20 * misses < *lookups, "{misses} of {lookups} lookups found nothing");
    }
    assert!(difference(&pictures[0].0, &pictures[3].0).relmse > 1e-4, "the camera moves");
    let (_, _, again) = run(1);
    for ((a, _), (b, _)) in pictures.iter().zip(&again) {
        assert!(a.channels == b.channels, "the picture depends on the number of threads");
    }
}

#[test]
fn a_sequence_is_numbered_and_its_records_are_counted() {
    let desk = Desk::new();
    let walk = scene("glossy-walk");
    let sequence =
        [&["render", &walk, "--spp", "1", "--preview", "p.png", "--stats", "s.json"], QUICK]
            .concat();
    let table = desk.print(&[&sequence[..], &["--frames", "3..5", "-o", "a.%02d.exr"]].concat());
    assert_eq!(
        desk.files(),
        ["a.03.exr", "a.04.exr", "a.05.exr", "p.0003.png", "p.0004.png", "p.0005.png", "s.json"]
    );
    assert_eq!(table.lines().count(), 5, "{table}");
    assert!(table.lines().last().unwrap().starts_with("p.png: exposed by "), "{table}");
    let stats = desk.json("s.json");
    let frames = stats["frames"].as_array().unwrap();
    let records = |k: usize| frames[k]["new_records"].as_u64().unwrap();
    assert_eq!(frames.iter().map(|f| f["frame"].as_u64().unwrap()).collect::<Vec<_>>(), [3, 4, 5]);
    assert_eq!(records(0) + records(1) + records(2), stats["records"].as_u64().unwrap());
    assert!(records(0) > 4 * records(1), "{table}");
    let place = |name: &str| exr::read(&desk.path(name)).unwrap().attributes;
    assert!(place("a.03.exr") != place("a.05.exr"), "the camera has moved");
    // Paths need no records, and quiet runs say nothing.
    let paths =
        [&["render", &walk, "--integrator", "path", "--spp", "1", "--quiet"], &QUICK[..2]].concat();
    assert_eq!(desk.print(&[&paths[..], &["--frames", "7", "--fps", "12"]].concat()), "");
    assert!(desk.files().contains(&"glossy-walk.0007.exr".to_owned()));
}

#[test]
fn a_sequence_that_cannot_be_is_refused() {
    let desk = Desk::new();
    let frames = |name: &str, more: &[&str]| {
        let arguments = ["render", &scene(name), "--frames", "1..3"].map(str::to_owned);
        arguments.into_iter().chain(more.iter().map(|s| (*s).to_owned())).collect::<Vec<_>>()
    };
    let fail = |arguments: Vec<String>, words: &[&str]| {
        desk.fail(&arguments.iter().map(String::as_str).collect::<Vec<_>>(), words)
    };
    fail(frames("cornell-box", &[]), &["cornell-box.gltf", "camera `camera`", "animation"]);
    fail(frames("glossy-walk", &["-o", "a.%s.exr"]), &["a.%s.exr", "%04d"]);
    fail(frames("glossy-walk", &["-o", "nowhere/a.exr"]), &["nowhere/a.0001.exr"]);
    for bad in [&["--frames", "3..1"][..], &["--frames", "1..3", "--fps", "0"]] {
        let output = desk.run(&[&["render", &scene("glossy-walk")], bad].concat());
        assert_eq!(output.status.code(), Some(2), "{}", text(&output.stderr));
    }
}
