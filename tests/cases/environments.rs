//! Maps of the environment as other programs write them.

use crate::support::desk::{Desk, text};
use crate::support::gltf_maker::{Gltf, shorts};
use lumicache::imagefile::{Picture, SampleKind, exr};
use serde_json::json;

/// A floor of albedo 0.5 that fills the view.
fn floor() -> Gltf {
    let mut file = Gltf::new();
    let material = file.add(
        "materials",
        json!({"pbrMetallicRoughness": {"baseColorFactor": [0.5, 0.5, 0.5, 1.0],
            "metallicFactor": 0.0},
            "extensions": {"KHR_materials_specular": {"specularFactor": 0.0}}}),
    );
    let corners = [[-2.0, 0.0, -2.0], [-2.0, 0.0, 2.0], [2.0, 0.0, 2.0], [2.0, 0.0, -2.0]];
    let positions = file.positions(&corners.concat());
    let indices = file.accessor(&shorts(&[0, 1, 2, 0, 2, 3]), 5123, "SCALAR", 6, json!({}), None);
    let mesh = file.add(
        "meshes",
        json!({"primitives": [{"attributes": {"POSITION": positions}, "indices": indices,
            "material": material}]}),
    );
    let floor = file.node(json!({"mesh": mesh}));
    let lens = json!({"yfov": 0.5, "znear": 0.01});
    let camera = file.add("cameras", json!({"type": "perspective", "perspective": lens}));
    // From above.
    let half = std::f64::consts::FRAC_1_SQRT_2;
    let eye = json!({"camera": camera, "translation": [0, 2, 0], "rotation": [-half, 0, 0, half]});
    let eye = file.node(eye);
    file.scene(&[floor, eye]);
    file
}

/// The mean of the floor's picture under `map` is `right` in all channels, whatever makes it, and
/// the program says `words`.
fn assert_floor(desk: &Desk, map: &str, right: [f32; 3], words: &str) {
    for integrator in ["path", "cache", "bdpt"] {
        let output = desk.run(&[
            "render",
            "floor.glb",
            "--env",
            map,
            "--integrator",
            integrator,
            "--size",
            "16x16",
            "--spp",
            "64",
            "-o",
            "out.exr",
        ]);
        let said = text(&output.stderr);
        assert_eq!(output.status.code(), Some(0), "{map}, {integrator}: {said}");
        assert!(said.contains(words) && words.is_empty() == said.is_empty(), "{map}: {said}");
        let colors = exr::read(&desk.path("out.exr")).unwrap().colors("").unwrap();
        for channel in 0..3 {
            let sum: f32 = colors.iter().map(|c| c[channel]).sum();
            let mean = sum / colors.len() as f32;
            let error = (mean / right[channel] - 1.0).abs();
            assert!(error < 0.02, "{map}, {integrator}: {mean} is not {}", right[channel]);
        }
    }
}

#[test]
fn exposure_and_infinite_pixels_of_a_map_leave_the_right_light() {
    let desk = Desk::new();
    std::fs::write(desk.path("floor.glb"), floor().glb()).unwrap();
    // Radiance 1 before the lines: the floor sends half of what the sky does.
    for (name, lines, right) in [
        ("plain.hdr", "", [0.5; 3]),
        ("exposed.hdr", "EXPOSURE=2\n", [0.25; 3]),
        ("corrected.hdr", "EXPOSURE=0.5\nCOLORCORR=1 2 4\n", [1.0, 0.5, 0.25]),
    ] {
        let head = format!("#?RADIANCE\n{lines}FORMAT=32-bit_rle_rgbe\n\n-Y 1 +X 1\n");
        let bytes = [head.as_bytes(), &[128, 128, 128, 129]].concat();
        std::fs::write(desk.path(name), bytes).unwrap();
        assert_floor(&desk, name, right, "");
    }
    let mut sky = Picture::new([8, 4]);
    for name in ["R", "G", "B"] {
        let mut samples = vec![0.6; 32];
        samples[11] = f32::INFINITY;
        sky.add(name, SampleKind::Float, samples);
    }
    exr::write(&desk.path("infinite.exr"), &sky).unwrap();
    assert_floor(&desk, "infinite.exr", [0.3; 3], "infinite.exr: 1 pixels were no finite numbers");
}
