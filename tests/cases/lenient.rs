//! Files that other programs read: what is harmless is a warning and a picture, what is not is an
//! error that says what to do.

use crate::support::desk::{Desk, QUICK, text};
use crate::support::gltf_maker::{Gltf, floats};
use crate::support::testdata;
use lumicache::import::{self, ImportOptions};
use lumicache::scene::SceneData;
use serde_json::{Value, json};

/// A red pixel.
pub const PIXEL: &str = "data:image/png;base64,iVBORw0KGgoAAAANSUhEUgAAAAEAAAABCAIAAACQd1PeAAAADElEQVQYV2P4z/AfAAQAAf+I0P3MAAAAAElFTkSuQmCC";

/// A triangle of `material` under the spot `spot`.
fn scene(material: &Value, spot: &Value) -> Gltf {
    let mut file = Gltf::new();
    let bounds = json!({"min": [0, 0, 0], "max": [1, 1, 0]});
    let corners = floats(&[0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0]);
    let position = file.accessor(&corners, 5126, "VEC3", 3, bounds, None);
    let uv = file.accessor(&floats(&[0.0; 6]), 5126, "VEC2", 3, json!({}), None);
    file.add("materials", material.clone());
    file.show(json!({"attributes": {"POSITION": position, "TEXCOORD_0": uv}, "material": 0}));
    file.extension("KHR_lights_punctual", json!({"lights": [{"type": "spot", "spot": spot}]}));
    file.node(
        json!({"translation": [0, 0, 3], "extensions": {"KHR_lights_punctual": {"light": 0}}}),
    );
    file.scene(&[0, 1]);
    file.set("extensionsUsed", json!(["KHR_lights_punctual", "KHR_materials_ior"]));
    file
}

/// The scene with one warning that begins with `warning`; an error that begins with its place where
/// the import is strict.
fn mended(file: &Gltf, warning: &str) -> SceneData {
    let scene = file.load();
    assert!(
        matches!(&scene.warnings[..], [one] if one.starts_with(warning)),
        "{warning}: {:?}",
        scene.warnings
    );
    let strict = ImportOptions { strict: true, ..ImportOptions::default() };
    let place = warning.split(": ").next().unwrap();
    let error = file.try_load(&strict).unwrap_err().to_string();
    assert!(error.contains(&format!("made.glb: {place}: ")), "{error}");
    scene
}

#[test]
fn factors_beside_their_range_are_clamped() {
    let sound = json!({"outerConeAngle": 0.5});
    let base = "/materials/0/pbrMetallicRoughness";
    let factor =
        |name: &str, value: Value| scene(&json!({"pbrMetallicRoughness": {name: value}}), &sound);
    let colour = mended(
        &factor("baseColorFactor", json!([1.00016, 0.5, 0.5, 1])),
        &format!("{base}/baseColorFactor/0: 1.00016 is not from 0 to 1; taken as 1"),
    );
    assert_eq!(colour.materials[0].base_color.x, 1.0);
    let rough =
        mended(&factor("roughnessFactor", json!(1.5)), &format!("{base}/roughnessFactor: 1.5"));
    assert_eq!(rough.materials[0].roughness, 1.0);
    let metal =
        mended(&factor("metallicFactor", json!(-0.25)), &format!("{base}/metallicFactor: -0.25"));
    assert_eq!(metal.materials[0].metallic, 0.0);
    // Less than single precision tells apart is no news.
    assert!(factor("metallicFactor", json!(1.0000001)).load().warnings.is_empty());
    // Bytes and percents are another matter.
    let error = factor("baseColorFactor", json!([255, 0, 0, 1]))
        .try_load(&ImportOptions::default())
        .unwrap_err()
        .to_string();
    assert!(error.contains("/baseColorFactor/0: 255 is not from 0 to 1"), "{error}");
}

#[test]
fn cones_and_indices_of_refraction_are_read_as_they_are() {
    let cone = |inner: f64, outer: f64| {
        scene(&json!({}), &json!({"innerConeAngle": inner, "outerConeAngle": outer}))
    };
    let at = "/extensions/KHR_lights_punctual/lights/0/spot/innerConeAngle: ";
    let swapped = mended(&cone(0.6, 0.4), &format!("{at}0.6 exceeds"));
    let straight = cone(0.4, 0.6).load();
    assert!(straight.warnings.is_empty());
    assert_eq!(format!("{:?}", swapped.punctual), format!("{:?}", straight.punctual));
    mended(&cone(0.4, 0.4), &format!("{at}it equals"));
    let sound = json!({"outerConeAngle": 0.5});
    let ior = |n: f64| scene(&json!({"extensions": {"KHR_materials_ior": {"ior": n}}}), &sound);
    let at = "/materials/0/extensions/KHR_materials_ior/ior: ";
    assert_eq!(mended(&ior(0.47), &format!("{at}0.47")).materials[0].ior, 0.47);
    assert!(ior(-0.5).try_load(&ImportOptions::default()).is_err());
}

#[test]
fn empty_arrays_are_ignored() {
    for name in ["images", "animations", "textures", "samplers", "skins", "cameras"] {
        let mut file = scene(&json!({}), &json!({"outerConeAngle": 0.5}));
        file.set(name, json!([]));
        mended(&file, &format!("/{name}: an empty array"));
    }
}

/// A scene whose material shows `image`, and further ones that nothing shows.
fn showing(image: Value, others: &[Value]) -> Gltf {
    let material = json!({"pbrMetallicRoughness": {"baseColorFactor": [0.5, 0.5, 0.5, 1], "baseColorTexture": {"index": 0}}});
    let mut file = scene(&material, &json!({"outerConeAngle": 0.5}));
    file.add("images", image);
    file.add("textures", json!({"source": 0}));
    for image in others {
        let source = file.add("images", image.clone());
        let index = file.add("textures", json!({"source": source}));
        file.add("materials", json!({"emissiveTexture": {"index": index}}));
    }
    file
}

#[test]
fn images_that_cannot_be_shown_leave_their_factors() {
    for (image, warning) in [
        (json!({"uri": "missing.png"}), "/images/0/uri: the image cannot be shown"),
        (json!({"uri": "https://example.com/a.png"}), "/images/0/uri: the image cannot be shown"),
        (json!({"uri": "data:image/png;base64,aGVsbG8="}), "/images/0: the image cannot be shown"),
        (json!({"uri": &format!("{}AAAA", &PIXEL[..90])}), "/images/0: the image cannot be shown"),
        (json!({"uri": "data:image/png;base64,A==="}), "/images/0/uri: the image cannot be shown"),
    ] {
        let scene = mended(&showing(image, &[]), warning);
        assert!(scene.textures.is_empty() && scene.materials[0].base_color_texture.is_none());
        assert_eq!(scene.materials[0].base_color.x, 0.5);
    }
    let declared = mended(
        &showing(json!({"uri": PIXEL.replace("png", "jpeg")}), &[]),
        "/images/0/uri: declared as \"image/jpeg\", and is image/png",
    );
    assert_eq!(declared.textures.len(), 1);
}

#[test]
fn what_nothing_shows_is_not_even_opened() {
    let others = [
        json!({"uri": "missing.png"}),
        json!({"uri": "../../../../etc/passwd"}),
        json!({"uri": "data:image/png;base64,aGVsbG8="}),
    ];
    let scene = showing(json!({"uri": PIXEL}), &others).load();
    assert_eq!((scene.textures.len(), scene.warnings.len()), (1, 0), "{:?}", scene.warnings);
}

#[test]
fn warnings_of_a_kind_are_counted() {
    let mut file = Gltf::new();
    for i in 0..42 {
        let roughness = 1.25 + f64::from(i) / 100.0;
        file.add("materials", json!({"pbrMetallicRoughness": {"roughnessFactor": roughness}}));
    }
    assert_eq!(
        file.load().warnings,
        [
            "/materials/0/pbrMetallicRoughness/roughnessFactor: 1.25 is not from 0 to 1; taken as 1 (and 41 more like it)"
        ]
    );
}

#[test]
fn files_of_other_kinds_are_named_with_what_to_do() {
    let desk = Desk::new();
    for (name, head, words) in [
        ("a.gltf", &b"PK\x03\x04\x14\0\0\0"[..], ["ZIP archive", "unpack it"]),
        ("a.obj", b"# Blender\nmtllib a.mtl\nv 0 0 0\n", ["OBJ", "export it as glTF 2.0"]),
        ("b.gltf", b"v 0 0 0\nv 1 0 0\nf 1 2 3\n", ["OBJ", "export it as glTF 2.0"]),
        ("a.fbx", b"Kaydara FBX Binary  \0\x1a\0", ["FBX", "export it as glTF 2.0"]),
        ("a.usda", b"#usda 1.0\n(\n)\n", ["USD", "export it as glTF 2.0"]),
        ("a.blend", b"\x28\xb5\x2f\xfd", ["Blender", "export it as glTF 2.0"]),
        ("a.glb", b"BLENDER-v401", ["Blender", "export it as glTF 2.0"]),
    ] {
        std::fs::write(desk.path(name), head).unwrap();
        for command in ["render", "info"] {
            desk.fail(&[command, name], &[name, words[0], words[1]]);
        }
    }
}

#[test]
fn the_cases_of_other_programs_render() {
    for name in [
        "strict-import/i_basecol",
        "strict-import/i_mime",
        "strict-import/i_missing",
        "strict-import/i_spot_gt",
        "strict-import/i_ior05",
        "empty-arrays/empty_images",
        "empty-arrays/empty_animations",
    ] {
        let Some(file) = testdata::find(&format!("cases/{name}.gltf")) else { return };
        let (desk, file) = (Desk::new(), file.to_str().unwrap().to_owned());
        let output = desk.run(&[&["render", &file, "-o", "a.exr", "--spp", "1"], QUICK].concat());
        let said = text(&output.stderr);
        assert_eq!(output.status.code(), Some(0), "{said}");
        assert!(said.contains("warning: /"), "{name}: {said}");
        desk.fail(&["render", &file, "-o", "b.exr", "--strict"], &["/"]);
    }
    for (name, word) in [("e.zip", "ZIP"), ("e.obj", "OBJ")] {
        let Some(file) = testdata::find(&format!("cases/wrong-file-type/{name}")) else { return };
        Desk::new().fail(&["render", file.to_str().unwrap()], &[word, "glTF 2.0"]);
    }
}

/// A Radiance file of 4 x 2 pixels is not able to hold what is no number; OpenEXR is.
#[test]
fn environments_with_pixels_that_are_no_numbers_light_the_scene() {
    use lumicache::imagefile::{Picture, SampleKind, exr};
    let desk = Desk::new();
    let mut picture = Picture::new([4, 2]);
    for name in ["R", "G", "B"] {
        let samples = vec![1.0, 1.0, f32::INFINITY, 1.0, 1.0, f32::NAN, 1.0, 1.0];
        picture.add(name, SampleKind::Float, samples);
    }
    exr::write(&desk.path("env.exr"), &picture).unwrap();
    let (map, warnings) = import::environment(&desk.path("env.exr"), 0.0, 1.0, None).unwrap();
    assert!(map.pixels.iter().all(|c| (*c - 1.0).abs().max_element() < 1e-6), "{:?}", map.pixels);
    assert!(matches!(&warnings[..], [one] if one.contains("env.exr: 2 pixels")), "{warnings:?}");
    let Some(file) = testdata::find("cases/env-header/env_infh.exr") else { return };
    assert_eq!(import::environment(&file, 0.0, 1.0, None).unwrap().1.len(), 1);
}
