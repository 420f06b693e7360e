//! glTF files that must load, and what must be in them afterwards.

use crate::support::testdata::{self, gltf_files};
use lumicache::camera::Projection;
use lumicache::error::Error;
use lumicache::geometry::Geometry;
use lumicache::import::{ImportOptions, gltf};
use lumicache::light::{PunctualLight, versine};
use lumicache::math::{Vec3, Vec4};
use lumicache::scene::SceneData;
use std::path::Path;

/// What every imported scene promises to the rest of the program.
fn check_promises(scene: &SceneData, file: &Path) {
    let at = file.display();
    for mesh in &scene.geometry.meshes {
        let count = mesh.positions.len();
        assert!(
            !mesh.indices.is_empty() && mesh.positions.iter().all(|p| p.is_finite()),
            "{at}: {}",
            mesh.name
        );
        assert!(
            mesh.indices.as_flattened().iter().all(|i| (*i as usize) < count),
            "{at}: {}",
            mesh.name
        );
        assert!((mesh.material as usize) < scene.materials.len(), "{at}: {}", mesh.name);
        if let Some(normals) = &mesh.normals {
            assert!(
                normals.len() == count && normals.iter().all(|n| (n.length() - 1.0).abs() < 1e-5),
                "{at}: {}",
                mesh.name
            );
        }
        if let Some(tangents) = &mesh.tangents {
            let sound = |t: &Vec4| (t.truncate().length() - 1.0).abs() < 1e-5 && t.w.abs() == 1.0;
            assert!(tangents.len() == count && tangents.iter().all(sound), "{at}: {}", mesh.name);
        }
        assert!(mesh.uv.iter().flatten().all(|uv| uv.len() == count), "{at}: {}", mesh.name);
        assert!(mesh.colors.iter().all(|c| c.len() == count), "{at}: {}", mesh.name);
    }
    for instance in &scene.geometry.instances {
        assert!((instance.mesh as usize) < scene.geometry.meshes.len(), "{at}");
        assert!(
            instance.to_world.is_finite() && instance.to_world.matrix3.determinant() != 0.0,
            "{at}"
        );
    }
    for material in &scene.materials {
        let textures = [
            &material.base_color_texture,
            &material.normal_texture,
            &material.metallic_roughness_texture,
        ];
        assert!(
            textures.into_iter().flatten().all(|t| (t.texture as usize) < scene.textures.len()),
            "{at}"
        );
    }
}

/// World-space triangles.
fn triangles(geometry: &Geometry) -> Vec<[Vec3; 3]> {
    let of_instance = |i: usize| geometry.meshes[geometry.instances[i].mesh as usize].indices.len();
    (0..geometry.instances.len())
        .flat_map(|i| (0..of_instance(i)).map(move |t| geometry.triangle(i as u32, t as u32)))
        .collect()
}

pub fn load(path: &Path) -> SceneData {
    gltf(path, &ImportOptions::default()).unwrap_or_else(|e| panic!("{e}"))
}

#[test]
fn the_conformance_files_load_or_name_the_extension_that_they_require() {
    let Some(folder) = testdata::find("scenes/conformance") else { return };
    // File name ending, and what its error says. The last five are broken themselves.
    let refused = [
        ("draco/2CylinderEngine.gltf", "KHR_draco_mesh_compression"),
        ("DracoSparseMesh.gltf", "KHR_draco_mesh_compression"),
        ("DenseSphere.glb", "KHR_draco_mesh_compression"),
        ("heart_draco.glb", "KHR_draco_mesh_compression"),
        ("BoxTextured-glTF-techniqueWebGL/BoxTextured.gltf", "KHR_technique_webgl"),
        ("ACMEBox.gltf", "ACME_gizmo"),
        ("BoxDraco.gltf", "/buffers/0/uri"),
        ("Lantern.gltf", "/buffers/0/uri"),
        ("BoxWithInfinites.glb", "/accessors/2"),
        ("minimal_accessor_invalid.gltf", "/accessors/1/max"),
        ("non_sparse_accessor_without_buffer_view.gltf", "/accessors/0/byteOffset"),
    ];
    let (mut loaded, mut refusals) = (0, 0);
    for file in gltf_files(&folder) {
        let expected = refused.iter().find(|(name, _)| file.ends_with(name));
        match (gltf(&file, &ImportOptions::default()), expected) {
            (Ok(scene), None) => {
                check_promises(&scene, &file);
                loaded += 1;
            }
            (Err(error), Some((_, says))) => {
                let text = error.to_string();
                assert!(text.contains(says) && text.contains(file.to_str().unwrap()), "{text}");
                let unsupported = matches!(error, Error::Unsupported { .. });
                assert_eq!(unsupported, !says.starts_with('/'), "{text}");
                refusals += 1;
            }
            (Ok(_), Some(_)) => panic!("{} was accepted", file.display()),
            (Err(error), None) => panic!("{error}"),
        }
    }
    assert_eq!(refusals, refused.len());
    assert!(loaded >= 55, "only {loaded} files were found");
}

#[test]
fn the_scenes_load_whole() {
    let Some(folder) = testdata::find("scenes/scenes") else { return };
    for (name, triangles, materials, textures, lights, cameras) in [
        ("bevy-CornellBox/CornellBox.glb", 36, 5, 0, 0, 0),
        ("cornell-box/cornell-box.gltf", 36, 8, 0, 0, 1),
        ("dining-room/dining-room.gltf", 269_538, 15, 3, 1, 1),
        ("living-room/living-room.gltf", 142_973, 19, 4, 0, 1),
        ("nvpro-cornell/cornellBox.gltf", 16_352, 9, 0, 0, 1),
        ("sponza-dabrovic/sponza-dabrovic.gltf", 70_413, 20, 10, 0, 1),
        ("staircase2/staircase2.gltf", 28_815, 21, 3, 0, 1),
        ("veach-bidir/veach-bidir.gltf", 11_544, 6, 0, 0, 1),
        ("veach-mis/veach-mis.gltf", 11_956, 8, 0, 0, 1),
    ] {
        let file = folder.join(name);
        let scene = load(&file);
        check_promises(&scene, &file);
        let counts = (scene.geometry.triangle_count(), scene.materials.len(), scene.textures.len());
        assert_eq!(counts, (triangles, materials, textures), "{name}");
        assert_eq!((scene.punctual.len(), scene.cameras.len()), (lights, cameras), "{name}");
    }
}

#[test]
fn twins_of_the_box_are_the_same_box() {
    let Some(folder) = testdata::find("scenes/conformance") else { return };
    for (twin, tolerance) in [
        ("gltf-rs/examples/Box.glb", 0.0),
        ("gltf-rs/examples/Box.gltf", 0.0),
        ("gltf-rs/tests/box_sparse.glb", 0.0),
        ("gltf-rs/tests/box_sparse.gltf", 0.0),
        ("glTF-Transform/core/test/in/Box_glTF-Embedded/Box.gltf", 0.0),
        ("glTF-Transform/core/test/in/BoxTextured_glTF/BoxTextured.gltf", 0.0),
        ("glTF-Transform/extensions/test/in/BoxMeshopt.gltf", 1e-4),
        ("glTF-Transform/extensions/test/in/BoxMeshopt.glb", 1e-4),
    ] {
        let scene = load(&folder.join(twin));
        let triangles = triangles(&scene.geometry);
        assert_eq!(triangles.len(), 12, "{twin}");
        let on_a_corner =
            |v: &Vec3| (v.abs() - Vec3::splat(0.5)).abs().max_element() <= tolerance + 1e-6;
        assert!(triangles.as_flattened().iter().all(on_a_corner), "{twin}");
        // The front faces look outwards and enclose the unit cube; in one file of the corpus they
        // look inwards.
        let sign = if twin.contains("sparse") { -1.0 } else { 1.0 };
        let volume: f32 = triangles.iter().map(|[a, b, c]| a.dot(b.cross(*c)) / 6.0).sum();
        assert!((volume - sign).abs() < 1e-3, "{twin}: {volume}");
        let mesh = &scene.geometry.meshes[0];
        if let Some(normals) = &mesh.normals {
            for [a, b, c] in mesh.indices.iter().map(|t| t.map(|i| i as usize)) {
                let p = &mesh.positions;
                let flat = (p[b] - p[a]).cross(p[c] - p[a]).normalize();
                assert!((normals[a] - flat).length() < 0.02, "{twin}: {} and {flat}", normals[a]);
            }
        }
    }
}

#[test]
fn primitive_modes_instances_and_skins_have_the_expected_numbers() {
    let Some(folder) = testdata::find("scenes/conformance") else { return };
    for mode in 0..16 {
        let scene = load(&folder.join(format!(
            "assimp/glTF-Asset-Generator/Mesh_PrimitiveMode/Mesh_PrimitiveMode_{mode:02}.gltf"
        )));
        let made = scene.geometry.triangle_count();
        assert_eq!(made, if mode % 7 < 4 && mode < 11 { 0 } else { 2 }, "mode {mode}");
        assert!(
            triangles(&scene.geometry).iter().all(|[a, b, c]| (*b - *a).cross(*c - *a).z > 0.0),
            "mode {mode}"
        );
    }
    let instancing = load(&folder.join("playcanvas/simple-instancing.glb"));
    assert_eq!((instancing.geometry.meshes.len(), instancing.geometry.instances.len()), (1, 125));
    let engine = load(&folder.join("assimp/2CylinderEngine-glTF-Binary/2CylinderEngine.glb"));
    assert_eq!((engine.geometry.meshes.len(), engine.geometry.instances.len()), (34, 115));
    // The skin's second joint turns by no angle in the rest pose: the strip stands upright.
    let skin = load(&folder.join("assimp/simple_skin/simple_skin.gltf"));
    let bounds = skin.geometry.bounds();
    assert!(
        (bounds.min - Vec3::new(-0.5, 0.0, 0.0)).length() < 1e-5
            && (bounds.max - Vec3::new(0.5, 2.0, 0.0)).length() < 1e-5
    );
}

#[test]
fn cameras_and_lights_of_files_have_the_expected_numbers() {
    let Some(folder) = testdata::find("scenes/conformance") else { return };
    let scene = load(&folder.join("playcanvas/geometry-camera-light.glb"));
    let [persp, ortho] = scene.cameras.as_slice() else {
        panic!("{} cameras", scene.cameras.len())
    };
    assert_eq!((persp.name.as_str(), ortho.name.as_str()), ("Persp", "Ortho"));
    let Projection::Perspective { yfov } = persp.projection else {
        panic!("{:?}", persp.projection)
    };
    assert!((yfov - 0.399_596_5).abs() < 1e-6);
    assert_eq!(ortho.projection, Projection::Orthographic { xmag: 13.5, ymag: 13.5 });
    assert!((persp.aspect.unwrap() - 16.0 / 9.0).abs() < 1e-6);
    let at = Vec3::from(persp.to_world.translation);
    assert!((at - Vec3::new(4.559_937_5, -7.584_074, 4.958_309)).length() < 1e-6);
    let [PunctualLight::Point { position, .. }, PunctualLight::Spot { outer, intensity, .. }] =
        scene.punctual[..]
    else {
        panic!("{:?}", scene.punctual)
    };
    assert!((position - Vec3::new(4.076_245, 1.005_454, 5.903_862)).length() < 1e-6);
    assert!((outer - versine(0.654_498_46)).abs() < 1e-6 && (intensity.x - 1000.0).abs() < 1e-3);
}

#[test]
fn made_tangents_agree_with_those_of_files() {
    let Some(folder) = testdata::find("scenes/conformance/playcanvas") else { return };
    let name = "ClearCoatTest.glb";
    // The same file with its tangents under another name, which nobody reads.
    let mut bytes = std::fs::read(folder.join(name)).unwrap();
    while let Some(at) = bytes.windows(9).position(|w| w == b"\"TANGENT\"") {
        bytes[at + 1] = b'_';
    }
    let stripped = tempfile::tempdir().unwrap();
    let path = stripped.path().join(name);
    std::fs::write(&path, bytes).unwrap();
    let (own, made) = (load(&folder.join(name)), load(&path));
    let (mut compared, mut apart) = (0, 0);
    for (own, made) in own.geometry.meshes.iter().zip(&made.geometry.meshes) {
        let (Some(given), Some(ours)) = (&own.tangents, &made.tangents) else { continue };
        for (a, b) in own.indices.as_flattened().iter().zip(made.indices.as_flattened()) {
            let (given, ours) = (given[*a as usize], ours[*b as usize]);
            compared += 1;
            apart += usize::from(given.truncate().dot(ours.truncate()) < 0.95 || given.w != ours.w);
        }
    }
    assert!(compared > 1000 && apart == 0, "{apart} of {compared} tangents differ");
}
