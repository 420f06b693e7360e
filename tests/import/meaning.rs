//! Small glTF files made on the spot: each part of the format means what it says.

use crate::import::conformance::load;
use crate::support::gltf_maker::{Gltf, floats, shorts, triangle};
use lumicache::import::{ImportOptions, LightUnits, SceneChoice};
use lumicache::light::{PunctualLight, versine};
use lumicache::material::AlphaMode;
use lumicache::math::{Color, Vec2, Vec3, Vec4};
use lumicache::texture::{ColorSpace, TexturePixels, Wrap};
use serde_json::json;
use std::f64::consts::FRAC_1_SQRT_2 as SQRT_HALF;

#[test]
fn quantized_and_normalized_attributes() {
    let mut file = Gltf::new();
    let position = file.accessor(
        &shorts(&[-32767, 0, 0, 0, 0, 32767, 0, 0, 0, 0, -32768, 0]),
        5122,
        "VEC3",
        3,
        json!({"normalized": true}),
        Some(8),
    );
    let normal = file.accessor(
        &[0, 0, 127, 0, 0, 0, 127, 0, 0, 0, 127, 0],
        5120,
        "VEC3",
        3,
        json!({"normalized": true}),
        Some(4),
    );
    let color = file.accessor(
        &[255, 0, 51, 0, 255, 0, 51, 0, 255, 0, 51, 0],
        5121,
        "VEC3",
        3,
        json!({"normalized": true}),
        Some(4),
    );
    let uv =
        file.accessor(&[1, 2, 0, 0, 3, 4, 0, 0, 5, 6, 0, 0], 5121, "VEC2", 3, json!({}), Some(4));
    file.show(json!({"attributes": {"POSITION": position, "NORMAL": normal, "COLOR_0": color, "TEXCOORD_1": uv}}));
    let scene = file.load();
    let mesh = &scene.geometry.meshes[0];
    assert_eq!(*mesh.positions, [Vec3::NEG_X, Vec3::Y, Vec3::NEG_Z]);
    assert_eq!(mesh.normals.as_ref().unwrap()[0], Vec3::Z);
    assert_eq!(mesh.colors.as_ref().unwrap()[1], Vec4::new(1.0, 0.0, 0.2, 1.0));
    assert_eq!(mesh.uv[1].as_ref().unwrap()[2], Vec2::new(5.0, 6.0));
    assert!(mesh.uv[0].is_none());
}

#[test]
fn sparse_accessors_with_and_without_a_view() {
    let mut file = Gltf::new();
    let places = file.view(&shorts(&[1, 2]), None);
    let values = file.view(&floats(&[1.0, 0.0, 0.0, 0.0, 1.0, 0.0]), None);
    let sparse = json!({"count": 2, "indices": {"bufferView": places, "componentType": 5123}, "values": {"bufferView": values}});
    let bare = file.add(
        "accessors",
        json!({"componentType": 5126, "type": "VEC3", "count": 3, "sparse": sparse}),
    );
    let base = file.view(&floats(&[0.0; 9]), None);
    let over =
        file.add("accessors", json!({"componentType": 5126, "type": "VEC3", "count": 3, "bufferView": base, "sparse": sparse}));
    file.show(json!({"attributes": {"POSITION": bare}}));
    file.show(json!({"attributes": {"POSITION": over}}));
    let scene = file.load();
    assert_eq!(scene.geometry.meshes.len(), 2);
    for mesh in &scene.geometry.meshes {
        assert_eq!(*mesh.positions, [Vec3::ZERO, Vec3::X, Vec3::Y]);
    }
}

#[test]
fn transforms_mirrors_and_shared_meshes() {
    let mut file = Gltf::new();
    let mesh = triangle(&mut file);
    let trs =
        file.node(json!({"mesh": mesh, "translation": [1, 2, 3], "rotation": [0, 0, SQRT_HALF, SQRT_HALF], "scale": [2, 2, 2]}));
    let matrix = file
        .node(json!({"mesh": mesh, "matrix": [0, 2, 0, 0, -2, 0, 0, 0, 0, 0, 2, 0, 1, 2, 3, 1]}));
    let child = file.node(json!({"mesh": mesh, "translation": [0, 0, 1]}));
    let mirror = file.node(json!({"scale": [-1, 1, 1], "children": [child]}));
    let flat = file.node(json!({"mesh": mesh, "scale": [1, 0, 1]}));
    file.scene(&[trs, matrix, mirror, flat]);
    let scene = file.load();
    assert_eq!((scene.geometry.meshes.len(), scene.geometry.instances.len()), (1, 3));
    assert!(scene.warnings.iter().any(|w| w.contains("a line or a point")), "{:?}", scene.warnings);
    let corners = |i| scene.geometry.triangle(i, 0);
    for i in [0, 1] {
        let wanted =
            [Vec3::new(1.0, 2.0, 3.0), Vec3::new(1.0, 4.0, 3.0), Vec3::new(-1.0, 2.0, 3.0)];
        assert!(
            corners(i).iter().zip(wanted).all(|(a, b)| (*a - b).length() < 1e-6),
            "{:?}",
            corners(i)
        );
    }
    // The front face of a mirrored mesh stays in front.
    let [a, b, c] = corners(2);
    assert!((b - a).cross(c - a).z > 0.0 && a.z == 1.0);
}

#[test]
fn morph_targets_have_their_default_weights() {
    let mut file = Gltf::new();
    let position = file.positions(&[0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0]);
    let delta = file.positions(&[0.0, 0.0, 4.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]);
    let mesh = file.add(
        "meshes",
        json!({"primitives": [{"attributes": {"POSITION": position}, "targets": [{"POSITION": delta}]}], "weights": [0.5]}),
    );
    let plain = file.node(json!({"mesh": mesh}));
    let own = file.node(json!({"mesh": mesh, "weights": [0.25]}));
    let same = file.node(json!({"mesh": mesh, "weights": [0.5]}));
    file.scene(&[plain, own, same]);
    let scene = file.load();
    assert_eq!((scene.geometry.meshes.len(), scene.geometry.instances.len()), (2, 3));
    let heights: Vec<f32> = (0..3).map(|i| scene.geometry.triangle(i, 0)[0].z).collect();
    assert_eq!(heights, [2.0, 1.0, 2.0]);
}

#[test]
fn skins_follow_their_joints_and_not_their_node() {
    let mut file = Gltf::new();
    let position = file.positions(&[0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0]);
    let joints =
        file.accessor(&[0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0], 5121, "VEC4", 3, json!({}), None);
    let weights = file.accessor(
        &floats(&[1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.5, 0.5, 0.0, 0.0]),
        5126,
        "VEC4",
        3,
        json!({}),
        None,
    );
    let shift = [1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 1.0];
    let bind = file.accessor(&floats(&[shift, shift].concat()), 5126, "MAT4", 2, json!({}), None);
    let mesh = file
        .add("meshes", json!({"primitives": [{"attributes": {"POSITION": position, "JOINTS_0": joints, "WEIGHTS_0": weights}}]}));
    let a = file.node(json!({}));
    let b = file.node(json!({"translation": [10, 0, 0]}));
    file.add("skins", json!({"joints": [a, b], "inverseBindMatrices": bind}));
    let skinned = file.node(json!({"mesh": mesh, "skin": 0, "translation": [100, 100, 100]}));
    file.scene(&[a, b, skinned]);
    let corners = file.load().geometry.triangle(0, 0);
    assert_eq!(
        corners,
        [Vec3::new(0.0, 0.0, 1.0), Vec3::new(11.0, 0.0, 1.0), Vec3::new(5.0, 1.0, 1.0)]
    );
}

#[test]
fn materials_and_their_extensions() {
    let mut file = Gltf::new();
    let image = file.add("images", json!({"uri": PIXEL}));
    file.add("samplers", json!({"wrapS": 33071, "wrapT": 33648, "magFilter": 9728}));
    let texture = file.add("textures", json!({"source": image, "sampler": 0}));
    let other = file.add("textures", json!({"source": image}));
    let transform = json!({"offset": [0.25, 0.5], "rotation": 0.5, "scale": [2, 3], "texCoord": 1});
    file.add(
        "materials",
        json!({
            "name": "all", "alphaMode": "MASK", "alphaCutoff": 0.75, "doubleSided": true, "emissiveFactor": [1, 0.5, 0],
            "normalTexture": {"index": other, "scale": 0.5},
            "pbrMetallicRoughness": {
                "baseColorFactor": [0.1, 0.2, 0.3, 0.4], "metallicFactor": 0.5, "roughnessFactor": 0.25,
                "baseColorTexture": {"index": texture, "extensions": {"KHR_texture_transform": transform}},
            },
            "extensions": {
                "KHR_materials_emissive_strength": {"emissiveStrength": 8}, "KHR_materials_ior": {"ior": 0},
                "KHR_materials_specular": {"specularFactor": 0.5, "specularColorFactor": [2, 1, 1]},
                "KHR_materials_transmission": {"transmissionFactor": 0.5},
                "KHR_materials_volume": {"thicknessFactor": 0.1, "attenuationDistance": 3, "attenuationColor": [1, 0.5, 0.5]},
                "KHR_materials_clearcoat": {"clearcoatFactor": 1, "clearcoatRoughnessFactor": 0.125},
                "KHR_materials_unlit": {},
            },
            "extras": {"lumicache": {"brdf": "phong", "kd": 0.5, "exponent": 3}},
        }),
    );
    file.add(
        "materials",
        json!({"extensions": {"KHR_materials_transmission": {"transmissionFactor": 1}}}),
    );
    show(&mut file, 2);
    let scene = file.load();
    let m = &scene.materials[0];
    assert_eq!(
        (m.name.as_str(), m.base_color, m.base_alpha),
        ("all", Color::new(0.1, 0.2, 0.3), 0.4)
    );
    assert_eq!(
        (m.metallic, m.roughness, m.normal_scale, m.double_sided, m.unlit),
        (0.5, 0.25, 0.5, true, true)
    );
    assert_eq!((m.alpha_mode, m.emission), (AlphaMode::Mask(0.75), Color::new(8.0, 4.0, 0.0)));
    assert_eq!(
        (m.ior, m.specular, m.specular_color, m.transmission),
        (0.0, 0.5, Color::new(2.0, 1.0, 1.0), 0.5)
    );
    assert_eq!(
        (m.thin, m.attenuation_distance, m.attenuation_color),
        (false, 3.0, Color::new(1.0, 0.5, 0.5))
    );
    assert_eq!((m.clearcoat, m.clearcoat_roughness), (1.0, 0.125));
    assert!(m.native.is_some());
    let base = m.base_color_texture.unwrap();
    assert_eq!((base.texture, base.uv_set, base.color_space), (0, 1, ColorSpace::Srgb));
    assert_eq!(
        (base.offset, base.rotation, base.scale),
        (Vec2::new(0.25, 0.5), 0.5, Vec2::new(2.0, 3.0))
    );
    let normal = m.normal_texture.unwrap();
    assert_eq!((normal.texture, normal.uv_set, normal.color_space), (1, 0, ColorSpace::Linear));
    let [first, second] = scene.textures.as_slice() else {
        panic!("{} textures", scene.textures.len())
    };
    assert_eq!((first.wrap_s, first.wrap_t, first.nearest), (Wrap::Clamp, Wrap::Mirror, true));
    assert_eq!((second.wrap_s, second.wrap_t, second.nearest), (Wrap::Repeat, Wrap::Repeat, false));
    assert!(std::sync::Arc::ptr_eq(&first.image, &second.image));
    assert!(scene.materials[1].thin && scene.materials[1].native.is_none());
}

/// Shows the first `count` materials.
fn show(file: &mut Gltf, count: usize) {
    let position = file.positions(&[0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0]);
    for material in 0..count {
        file.show(json!({"attributes": {"POSITION": position}, "material": material}));
    }
}

/// One pixel, RGBA (200, 100, 50, 64).
const PIXEL: &str = "data:image/png;base64,iVBORw0KGgoAAAANSUhEUgAAAAEAAAABCAYAAAAfFcSJAAAADUlEQVR4nGM4kWLkAAAE9QGfhM72PAAAAABJRU5ErkJggg==";

#[test]
fn specular_glossiness_becomes_a_dielectric_with_its_f0() {
    let mut file = Gltf::new();
    let image = file.add("images", json!({"uri": PIXEL}));
    let texture = file.add("textures", json!({"source": image}));
    let old = json!({"diffuseFactor": [0.5, 0.5, 0.5, 1], "specularFactor": [0.25, 0.5, 1], "glossinessFactor": 0.5,
        "specularGlossinessTexture": {"index": texture}});
    file.add("materials", json!({"extensions": {"KHR_materials_pbrSpecularGlossiness": old}}));
    show(&mut file, 1);
    let scene = file.load();
    let m = &scene.materials[0];
    assert_eq!(
        (m.base_color, m.metallic, m.ior, m.specular_color),
        (Color::splat(0.5), 0.0, 0.0, Color::new(0.25, 0.5, 1.0))
    );
    assert_eq!(
        (m.roughness, m.specular_color_texture.unwrap().color_space),
        (1.0, ColorSpace::Srgb)
    );
    let image = &scene.textures[m.metallic_roughness_texture.unwrap().texture as usize].image;
    // 1 - 0.5 * 64/255 in green.
    assert_eq!(image.pixels, TexturePixels::Rgba8(vec![[255, 223, 255, 255]]));
}

#[test]
fn lights_stand_where_their_nodes_are_whatever_the_scale() {
    let mut file = Gltf::new();
    file.extension(
        "KHR_lights_punctual",
        json!({"lights": [
            {"type": "point", "intensity": 683, "color": [1, 0.5, 0], "range": 7},
            {"type": "spot", "spot": {"innerConeAngle": 0.25, "outerConeAngle": 0.5}},
            {"type": "directional", "intensity": 2},
        ]}),
    );
    let light = |i: u32| json!({"KHR_lights_punctual": {"light": i}});
    let lights: Vec<usize> = (0..3).map(|i| file.node(json!({"extensions": light(i)}))).collect();
    // A quarter turn about +X takes -Z to +Y.
    let turned = file.node(
        json!({"children": lights, "translation": [1, 2, 3], "rotation": [SQRT_HALF, 0, 0, SQRT_HALF], "scale": [5, 5, 5]}),
    );
    file.scene(&[turned]);
    let radiometric =
        ImportOptions { light_units: LightUnits::Radiometric, ..ImportOptions::default() };
    for (options, unit) in [(ImportOptions::default(), 683.0), (radiometric, 1.0)] {
        let scene = file.load_with(&options);
        let [PunctualLight::Point { position, intensity, range }, ref spot, ref sun] =
            scene.punctual[..]
        else {
            panic!()
        };
        assert_eq!((position, range), (Vec3::new(1.0, 2.0, 3.0), 7.0));
        assert!((intensity - unit * Color::new(1.0, 0.5, 0.0)).length() < 1e-4, "{intensity}");
        let PunctualLight::Spot { direction, inner, outer, range, .. } = *spot else {
            panic!("{spot:?}")
        };
        assert!((direction - Vec3::Y).length() < 1e-6 && range == f32::INFINITY);
        assert_eq!((inner, outer), (versine(0.25), versine(0.5)));
        let PunctualLight::Directional { irradiance, .. } = *sun else { panic!("{sun:?}") };
        assert!((irradiance.x - 2.0 * unit / 683.0).abs() < 1e-6);
    }
}

#[test]
fn the_chosen_scene_is_shown() {
    let mut file = Gltf::new();
    let mesh = triangle(&mut file);
    let nodes: Vec<usize> = (0..3).map(|_| file.node(json!({"mesh": mesh}))).collect();
    let count = |file: &Gltf, scene| {
        let options = ImportOptions { scene, ..ImportOptions::default() };
        file.try_load(&options).map(|s| s.geometry.instances.len()).map_err(|e| e.to_string())
    };
    assert_eq!(count(&file, None), Ok(3));
    file.add("scenes", json!({"name": "one", "nodes": [nodes[0]]}));
    file.add("scenes", json!({"name": "two", "nodes": [nodes[1], nodes[2]]}));
    assert_eq!(count(&file, None), Ok(1));
    file.set("scene", json!(1));
    assert_eq!(count(&file, None), Ok(2));
    assert_eq!(count(&file, Some(SceneChoice::Index(0))), Ok(1));
    assert_eq!(count(&file, Some(SceneChoice::Name("two".into()))), Ok(2));
    assert!(count(&file, Some(SceneChoice::Index(2))).unwrap_err().contains("the file has 2"));
    assert!(
        count(&file, Some(SceneChoice::Name("x".into()))).unwrap_err().contains("\"one\", \"two\"")
    );
}

#[test]
fn gpu_instances_are_placed_relative_to_their_node() {
    let mut file = Gltf::new();
    let mesh = triangle(&mut file);
    let offsets =
        file.accessor(&floats(&[1.0, 0.0, 0.0, 0.0, 2.0, 0.0]), 5126, "VEC3", 2, json!({}), None);
    // No turn, and a half turn about +Z.
    let turns = file.accessor(
        &shorts(&[0, 0, 0, 32767, 0, 0, 32767, 0]),
        5122,
        "VEC4",
        2,
        json!({"normalized": true}),
        None,
    );
    let attributes = json!({"TRANSLATION": offsets, "ROTATION": turns, "_ID": 99});
    let node = file.node(
        json!({"mesh": mesh, "scale": [10, 10, 10], "extensions": {"EXT_mesh_gpu_instancing": {"attributes": attributes}}}),
    );
    file.scene(&[node]);
    let scene = file.load();
    assert_eq!((scene.geometry.meshes.len(), scene.geometry.instances.len()), (1, 2));
    assert!((scene.geometry.triangle(0, 0)[1] - Vec3::new(20.0, 0.0, 0.0)).length() < 1e-5);
    assert!((scene.geometry.triangle(1, 0)[1] - Vec3::new(-10.0, 20.0, 0.0)).length() < 1e-5);
}

#[test]
fn triangles_without_area_and_unused_vertices_are_left_out() {
    let mut file = Gltf::new();
    let position = file
        .positions(&[9.0, 9.0, 9.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 2.0, 0.0, 0.0]);
    let indices =
        file.accessor(&shorts(&[1, 2, 3, 1, 2, 4, 3, 3, 1]), 5123, "SCALAR", 9, json!({}), None);
    file.show(json!({"attributes": {"POSITION": position}, "indices": indices}));
    let scene = file.load();
    let mesh = &scene.geometry.meshes[0];
    assert_eq!((mesh.indices.len(), mesh.positions.len()), (1, 4));
    assert_eq!(scene.geometry.triangle(0, 0), [Vec3::ZERO, Vec3::X, Vec3::Y]);
    assert!(
        scene
            .warnings
            .iter()
            .any(|w| w.contains("/meshes/0/primitives/0: 2 triangles without area")),
        "{:?}",
        scene.warnings
    );
}

#[test]
fn images_beside_the_file_are_found_and_shared() {
    let folder = tempfile::tempdir().unwrap();
    let webp = image::RgbaImage::from_pixel(2, 1, image::Rgba([10, 20, 30, 40]));
    webp.save_with_format(folder.path().join("a b.webp"), image::ImageFormat::WebP).unwrap();
    let mut file = Gltf::new();
    for uri in [PIXEL, "a%20b.webp", "./a%20b.webp", "a b.webp"] {
        file.add("images", json!({"uri": uri}));
    }
    file.add("textures", json!({"source": 0, "extensions": {"EXT_texture_webp": {"source": 1}}}));
    file.add("textures", json!({"source": 0}));
    file.add("textures", json!({"extensions": {"EXT_texture_webp": {"source": 3}}}));
    for i in 0..3 {
        file.add("materials", json!({"emissiveTexture": {"index": i}}));
    }
    show(&mut file, 3);
    let path = folder.path().join("scene.glb");
    std::fs::write(&path, file.glb()).unwrap();
    let scene = load(&path);
    let pixels = |i: usize| match &scene.textures[i].image.pixels {
        TexturePixels::Rgba8(pixels) => pixels.as_slice(),
        TexturePixels::Rgba16(_) => panic!("16 bits"),
    };
    assert_eq!(
        (pixels(0), pixels(1)),
        ([[10, 20, 30, 40]; 2].as_slice(), [[200, 100, 50, 64]].as_slice())
    );
    assert!(std::sync::Arc::ptr_eq(&scene.textures[0].image, &scene.textures[2].image));
}
