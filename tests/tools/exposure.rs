//! By how much previews are exposed where nobody says so.

use crate::support::desk::{Desk, QUICK, scene};
use crate::support::pictures::{build, own, settings};
use lumicache::camera::Camera;
use lumicache::imagefile::{Attribute, Picture, TexturePixels, exr, ldr};
use lumicache::light::EnvironmentMap;
use lumicache::math::{Affine3A, Color};
use lumicache::render::{IntegratorKind, Job, Rendering, Settings, workers};
use lumicache::scene::{Scene, SceneData};
use std::path::Path;

/// The bytes of a preview, and its exposure.
fn preview(picture: &Rendering) -> (Vec<u8>, f32) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("p.png");
    picture.write_preview(&path).unwrap();
    (pixels(&path), picture.exposure())
}

fn pixels(path: &Path) -> Vec<u8> {
    let TexturePixels::Rgba8(pixels) = ldr::decode(&std::fs::read(path).unwrap()).unwrap().pixels
    else {
        panic!("a preview has 8 bits")
    };
    pixels.iter().flat_map(|p| [p[0], p[1], p[2]]).collect()
}

fn paths(scene: &Scene) -> Settings {
    settings(scene, IntegratorKind::Path, [40, 30], 4)
}

/// A room whose lamps are so many times as bright.
fn room(factor: f32) -> SceneData {
    let mut data = own("cornell-box");
    data.materials.iter_mut().for_each(|m| m.emission *= factor);
    assert!(data.punctual.is_empty() && data.environment.is_none());
    data
}

/// A room without a lamp.
fn dark() -> Scene {
    build(SceneData { environment: Some(EnvironmentMap::constant(Color::ZERO)), ..room(0.0) })
}

#[test]
fn the_unit_of_light_does_not_change_a_preview() {
    let shot = |factor: f32| {
        let scene = build(room(factor));
        preview(&Job::with_settings(&scene, paths(&scene)).run().unwrap())
    };
    let (usual, stops) = shot(1.0);
    let mean = usual.iter().map(|b| f32::from(*b)).sum::<f32>() / usual.len() as f32;
    let white = usual.iter().filter(|b| **b == 255).count();
    assert!((30.0..200.0).contains(&mean) && 5 * white < usual.len(), "{mean} {white}");
    for factor in [1000.0, 1e-3, 1e12, 1e-12] {
        let (bytes, exposure) = shot(factor);
        assert!((exposure + factor.log2() - stops).abs() < 0.02, "{factor}: {exposure} {stops}");
        let largest = bytes.iter().zip(&usual).map(|(a, b)| a.abs_diff(*b)).max().unwrap();
        assert!(largest <= 1, "{factor}: the previews differ by {largest}");
    }
}

#[test]
fn a_black_picture_stays_black() {
    let scene = dark();
    let picture = Job::with_settings(&scene, paths(&scene)).run().unwrap();
    let (bytes, stops) = preview(&picture);
    assert!(bytes.iter().all(|b| *b == 0) && stops == 0.0, "{stops}");
    assert_eq!(picture.stats()["exposure"], 0.0);
}

#[test]
fn threads_that_flush_denormals_expose_the_brightest_light() {
    let bytes = workers(1)
        .unwrap()
        .install(|| ldr::to_srgb8(&[Color::splat(127f32.exp2()), Color::splat(f32::NAN)], -129.0));
    assert_eq!(bytes, [[137; 3], [0; 3]].concat());
}

#[test]
fn a_sequence_has_the_exposure_of_its_first_frame_with_light() {
    let scene = build(room(50.0));
    let camera = scene.cameras()[0].clone();
    let turned = |turn: Affine3A| Camera { to_world: camera.to_world * turn, ..camera.clone() };
    // The room lies behind the first camera, which sees nothing.
    let back = Affine3A::from_rotation_y(std::f32::consts::PI);
    let cameras = [back, Affine3A::IDENTITY, Affine3A::from_rotation_x(0.2)].map(turned);
    let alone = cameras.clone().map(|camera| {
        let settings = Settings { camera, ..paths(&scene) };
        Job::with_settings(&scene, settings).run().unwrap().exposure()
    });
    assert!(alone[0] == 0.0 && alone[1] < -1.0 && alone[2] != alone[1], "{alone:?}");
    let cameras: Vec<(u32, Camera)> = (0..).zip(cameras).collect();
    let exposures = |job: Job| {
        let mut exposures = Vec::new();
        let take = |_, picture: &Rendering| {
            exposures.push(picture.exposure());
            Ok(())
        };
        let last = job.run_sequence(&cameras, take).unwrap().last;
        assert_eq!(exposures.last(), Some(&last.exposure()));
        exposures
    };
    let job = || Job::with_settings(&scene, paths(&scene));
    assert_eq!(exposures(job()), [0.0, alone[1], alone[1]]);
    assert_eq!(exposures(job().exposure(-2.5)), [-2.5; 3]);
}

fn stored(picture: &Picture) -> f32 {
    match picture.attribute("previewExposure") {
        Some(Attribute::Float(stops)) => *stops,
        other => panic!("{other:?}"),
    }
}

#[test]
fn the_exposure_is_printed_and_stored_and_the_light_is_not_exposed() {
    let desk = Desk::new();
    let run = |more: &[&str]| {
        let room = scene("cornell-box");
        let head = ["render", &room, "-o", "out.exr", "--spp", "2", "--stats", "out.json"];
        let printed = desk.print(&[&head, QUICK, more].concat());
        (printed, exr::read(&desk.path("out.exr")).unwrap(), desk.json("out.json"))
    };
    let shown = ["--preview", "auto.png"];
    let (printed, auto, stats) = run(&shown);
    let stops = stored(&auto);
    assert_eq!(printed, format!("auto.png: exposed by {stops:+.2} stops\n"));
    let told = stats["exposure"].as_f64().unwrap() as f32;
    assert!(stops != 0.0 && told == stops, "{stats:#}");
    let given = format!("{stops:.2}");
    let (printed, again, _) = run(&["--preview", "given.png", "--exposure", &given]);
    assert_eq!((printed.as_str(), stored(&again)), ("", stops));
    assert!(pixels(&desk.path("given.png")) == pixels(&desk.path("auto.png")));
    let (printed, plain, stats) = run(&["--preview", "plain.png", "--exposure", "0"]);
    assert_eq!((printed.as_str(), stored(&plain)), ("", 0.0));
    assert_eq!(stats["exposure"], 0.0);
    assert!(pixels(&desk.path("plain.png")) != pixels(&desk.path("auto.png")));
    assert!(plain.channels == auto.channels && again.channels == auto.channels);
    // Nobody is told of a preview that is not written.
    let (printed, bare, _) = run(&[]);
    assert_eq!((printed.as_str(), stored(&bare)), ("", stops));
    assert_eq!(run(&[&shown[..], &["--quiet"]].concat()).0, "");
    assert_eq!(run(&[&shown[..], &["--prepass-only"]].concat()).0, "");
    for bad in ["bright", "nan", "inf"] {
        let output = desk.run(&["render", "a.gltf", "--exposure", bad]);
        assert_eq!(output.status.code(), Some(2), "{bad}");
    }
}
