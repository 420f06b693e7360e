//! Small bright spots that light a room.

use crate::support::gltf_maker::Gltf;
use crate::support::pictures::{
    beauty, build, cached, difference, load, own, render, settings, with,
};
use crate::support::testdata;
use lumicache::imagefile::Picture;
use lumicache::render::{IntegratorKind, Settings};
use lumicache::scene::{Scene, SceneData};
use serde_json::json;
use std::f32::consts::{PI, TAU};

const SIZE: [u32; 2] = [64, 48];
/// Side of the room; reflectance of all its walls.
const SIDE: f32 = 5.0;
const GREY: f32 = 0.5;
/// Height of the uplight below the ceiling, radius of its spot there, luminous intensity.
const BELOW: f32 = 0.5;
const RADIUS: f32 = 0.045;
const CANDELA: f32 = 8e3;

/// Adds triangles of one material.
fn show(file: &mut Gltf, triangles: &[[[f32; 3]; 3]], material: usize) {
    let position = file.positions(&triangles.concat().concat());
    file.show(json!({"attributes": {"POSITION": position}, "material": material}));
}

/// Two triangles with the corner `at` and the sides `u` and `v`, the front towards `u × v`.
fn rectangle(at: [f32; 3], u: [f32; 3], v: [f32; 3]) -> [[[f32; 3]; 3]; 2] {
    let corner = |a: f32, b: f32| [0, 1, 2].map(|k| at[k] + a * u[k] + b * v[k]);
    let [a, b, c, d] = [corner(0.0, 0.0), corner(1.0, 0.0), corner(1.0, 1.0), corner(0.0, 1.0)];
    [[a, b, c], [a, c, d]]
}

/// A disc under the ceiling around (x, z), facing down.
fn disc([x, z]: [f32; 2], radius: f32) -> Vec<[[f32; 3]; 3]> {
    let at = |k: u32| {
        let (sin, cos) = (TAU * k as f32 / 32.0).sin_cos();
        [x + radius * cos, SIDE - 1e-3, z + radius * sin]
    };
    (0..32).map(|k| [[x, SIDE - 1e-3, z], at(k), at(k + 1)]).collect()
}

/// A cube of a room whose ceiling is lit around `spots` alone: by uplights, or, if `glowing`, by
/// discs there that emit the light which the ceiling reflects in truth. A tall box stands in it.
fn room(spots: &[[f32; 2]], glowing: bool) -> SceneData {
    let mut file = Gltf::new();
    let grey = |emission: f32| {
        let glow = f32::from(u8::from(emission > 0.0));
        json!({
            "pbrMetallicRoughness": {"baseColorFactor": [GREY, GREY, GREY, 1.0],
                "metallicFactor": 0.0},
            "emissiveFactor": [glow, glow, glow],
            "extensions": {
                "KHR_materials_specular": {"specularFactor": 0.0},
                "KHR_materials_emissive_strength": {"emissiveStrength": emission.max(1.0)}
            }
        })
    };
    let wall = file.add("materials", grey(0.0));
    let light = file.add("materials", grey(GREY * CANDELA / (PI * BELOW * BELOW)));
    let (x, y, z) = ([SIDE, 0.0, 0.0], [0.0, SIDE, 0.0], [0.0, 0.0, SIDE]);
    let walls = [
        rectangle([0.0; 3], z, x),
        rectangle(y, x, z),
        rectangle([0.0; 3], y, z),
        rectangle(x, z, y),
        rectangle([0.0; 3], x, y),
        rectangle(z, y, x),
        // The box, seen from above and from two sides.
        rectangle([3.2, 1.2, 0.6], [0.0, 0.0, 0.9], [0.9, 0.0, 0.0]),
        rectangle([3.2, 0.0, 1.5], [0.9, 0.0, 0.0], [0.0, 1.2, 0.0]),
        rectangle([3.2, 0.0, 0.6], [0.0, 0.0, 0.9], [0.0, 1.2, 0.0]),
    ];
    show(&mut file, &walls.concat(), wall);
    let half = (RADIUS / BELOW).atan();
    let lamp = json!({"lights": [{"type": "spot", "intensity": CANDELA,
        "spot": {"innerConeAngle": 0.999 * half, "outerConeAngle": half}}]});
    for &[x, z] in spots {
        if glowing {
            show(&mut file, &disc([x, z], RADIUS), light);
        } else {
            let upwards = [0.5_f32.sqrt(), 0.0, 0.0, 0.5_f32.sqrt()];
            file.node(json!({"translation": [x, SIDE - BELOW, z], "rotation": upwards,
                "extensions": {"KHR_lights_punctual": {"light": 0}}}));
        }
    }
    file.extension("KHR_lights_punctual", lamp);
    let camera = file.add(
        "cameras",
        json!({"type": "perspective", "perspective": {"yfov": 1.0, "znear": 0.01}}),
    );
    let turn = -0.35_f32;
    file.node(json!({"camera": camera, "translation": [0.4, 1.9, 4.7],
        "rotation": [0.0, turn.sin(), 0.0, turn.cos()]}));
    let nodes: Vec<usize> = (0..file.document()["nodes"].as_array().map_or(0, Vec::len)).collect();
    file.scene(&nodes);
    file.load()
}

/// Fills whose pictures are compared: at this size the mean of one is off by 1 to 2 % either way.
const SEEDS: u64 = 4;

/// The light that gathers find is right within 2 % in the mean over fills, with the records of the
/// default and with records closer together. No picture has blotches.
fn assert_without_blotches(name: &str, lit: &Scene, truth: &Picture) {
    for (error, share, relmse) in [(0.4, 0.02, 0.005), (0.1, 0.02, 0.005)] {
        let mut sum = 0.0;
        for seed in 0..SEEDS {
            let mut settings = Settings { seed, ..cached(lit, "auto", SIZE, 16) };
            settings.scheme.validity.error = error;
            let got = difference(&beauty(&render(lit, &settings)), truth);
            assert!(got.relmse < relmse, "{name}, error {error}: relMSE {}", got.relmse);
            sum += got.mean_ratio.unwrap();
        }
        let ratio = sum / SEEDS as f64;
        assert!((ratio - 1.0).abs() < share, "{name}, error {error}: mean {ratio}");
    }
}

#[test]
fn rooms_lit_by_spots_on_the_ceiling_have_no_blotches() {
    for spots in [&[[2.5, 2.5]][..], &[[1.2, 2.0], [3.9, 3.1]]] {
        let (lit, glowing) = (build(room(spots, false)), build(room(spots, true)));
        let truth = beauty(&render(&glowing, &settings(&glowing, IntegratorKind::Path, SIZE, 256)));
        assert_without_blotches(&format!("{} spots", spots.len()), &lit, &truth);
    }
}

#[test]
fn the_case_of_an_uplight_is_right() {
    let Some(file) = testdata::find("cases/uplight-splotches/splotch.gltf") else { return };
    let scene = build(load(&file));
    let truth = settings(&scene, IntegratorKind::Bdpt, SIZE, 256);
    assert_without_blotches("the case", &scene, &beauty(&render(&scene, &truth)));
}

#[test]
fn rooms_whose_light_is_spread_keep_their_bits() {
    let scene = build(own("cornell-box"));
    let settings = cached(&scene, "auto", [24, 24], 1);
    let scheme = with(settings.scheme.clone(), |s| s.gather.bright = 0.0);
    let without = Settings { scheme, ..settings.clone() };
    let [a, b] = [settings, without].map(|s| beauty(&render(&scene, &s)));
    assert_eq!(difference(&a, &b).rmse, 0.0);
}
