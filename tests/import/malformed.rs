//! Files that must fail, cleanly: one error that names the file and the place, no panic, no hang,
//! bounded memory.

use crate::support::gltf_maker::{Gltf, floats, shorts};
use crate::support::testdata::{self, gltf_files};
use lumicache::error::Error;
use lumicache::import::{ImportOptions, gltf};
use serde_json::{Value, json};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

/// What the import says, checked for what every error owes its reader: the file's name, and a
/// single line.
fn import(file: &Path) -> Result<Vec<String>, String> {
    import_with(file, &ImportOptions::default())
}

fn import_with(file: &Path, options: &ImportOptions) -> Result<Vec<String>, String> {
    match gltf(file, options) {
        Ok(scene) => Ok(scene.warnings),
        Err(error) => {
            let text = error.to_string();
            assert!(text.starts_with(file.to_str().unwrap()), "{text}");
            assert!(!text.contains(['\n', '\r']) && text.len() < 1000, "{text}");
            Err(text)
        }
    }
}

/// The places (JSON paths) of the errors in a validator's report, or `None` where the report has
/// none.
fn reported(report: &Path) -> Option<Vec<String>> {
    let report: Value = serde_json::from_slice(&std::fs::read(report).unwrap()).unwrap();
    let issues = &report["issues"];
    if issues["numErrors"] == json!(0) {
        return None;
    }
    let errors =
        issues["messages"].as_array().unwrap().iter().filter(|m| m["severity"] == json!(0));
    Some(errors.map(|m| m["pointer"].as_str().unwrap_or("").to_owned()).collect())
}

/// What is mended is told with its place.
#[test]
fn the_validator_s_verdict_is_that_of_the_strict_import() {
    let Some(folder) = testdata::find("scenes/malformed") else { return };
    let (mut good, mut bad, mut mended, mut allowed) = (0, 0, 0, 0);
    for file in gltf_files(&folder) {
        let report = PathBuf::from(format!("{}.report.json", file.display()));
        if !report.is_file() {
            continue;
        }
        let strict = ImportOptions { strict: true, ..ImportOptions::default() };
        let verdict = import_with(&file, &strict);
        match (&verdict, import(&file)) {
            (Ok(_), Err(text)) => panic!("{text}, which the strict import accepts"),
            (Err(text), Ok(warnings)) => {
                let (_, rest) = text.split_once(": ").unwrap();
                let end = rest.chars().rev().take(20).collect::<String>();
                let end: String = end.chars().rev().collect();
                let told = warnings.iter().any(|w| w.contains(&end));
                if !told {
                    eprintln!("{text}, which changes nothing");
                }
                allowed += usize::from(!told);
                mended += usize::from(told);
            }
            _ => {}
        }
        match (verdict, reported(&report)) {
            (Ok(_), None) => good += 1,
            (Err(text), Some(places)) => {
                // Our place is the validator's, or the object around it or a value in it.
                let (_, rest) = text.split_once(": ").unwrap();
                let ours =
                    if rest.starts_with('/') { rest.split(": ").next().unwrap() } else { "" };
                let near = |theirs: &String| {
                    ours.starts_with(theirs.trim_end_matches('/')) || theirs.starts_with(ours)
                };
                assert!(places.iter().any(near), "{text} but the validator: {places:?}");
                bad += 1;
            }
            (Ok(_), Some(places)) => {
                panic!("{} was accepted; the validator: {places:?}", file.display())
            }
            (Err(text), None) => panic!("{text}, which the validator accepts"),
        }
    }
    eprintln!("{good} sound and {bad} broken files, {mended} mended, {allowed} as good as sound");
    assert!(good >= 30 && bad >= 80, "{good} sound and {bad} broken files were found");
}

#[test]
fn files_that_broke_another_importer_are_refused_or_load() {
    let Some(folder) = testdata::find("scenes/malformed/assimp") else { return };
    for (file, says) in [
        (
            "BoxWithInfinites-glTF-Binary/BoxWithInfinites.glb",
            "/accessors/2: component 0 of element 0 is -inf",
        ),
        ("IncorrectVertexArrays/Cube.gltf", "/bufferViews/2"),
        ("IndexOutOfRange/AllIndicesOutOfRange.gltf", "/accessors/0"),
        ("IndexOutOfRange/IndexOutOfRange.gltf", "/accessors/0: element 0 is the vertex 255"),
        ("MissingBin/BoxTextured.gltf", "/buffers/0/uri"),
        ("RecursiveNodes/RecursiveNodes.gltf", "/nodes/0"),
        ("SchemaFailures/sceneWrongType.gltf", "/scene: must be an integer"),
        ("TestNoRootNode/NoScene.gltf", "/scene"),
        ("wrongTypes/badArray.gltf", "/meshes/0/primitives: must be an array"),
        ("wrongTypes/badExtension.gltf", "KHR_texture_transform: must be an object"),
        ("wrongTypes/badNumber.gltf", "/materials/0/normalTexture/scale: must be a number"),
        ("wrongTypes/badObject.gltf", "/materials/0/pbrMetallicRoughness: must be an object"),
        ("wrongTypes/badString.gltf", "/name: must be a string"),
        ("wrongTypes/badUint.gltf", "/materials/0/pbrMetallicRoughness/baseColorTexture/index"),
    ] {
        let text = import(&folder.join(file)).expect_err(file);
        assert!(text.contains(says), "{text}");
    }
    for file in [
        "BoxBadNormals-glTF-Binary/BoxBadNormals.glb",
        "TestNoRootNode/SceneWithoutNodes.gltf",
        "issue_3269/texcoord_crash.gltf",
    ] {
        import(&folder.join(file)).unwrap();
    }
}

#[test]
fn our_own_corpus_fails_as_expected() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/import/corpus");
    let expected = std::fs::read_to_string(folder.join("expected.tsv")).unwrap();
    let expected: Vec<(&str, &str)> =
        expected.lines().filter_map(|line| line.split_once('\t')).collect();
    let files = gltf_files(&folder);
    assert_eq!(files.len(), expected.len());
    for (name, says) in expected {
        match (import(&folder.join(name)), says.strip_prefix("loads with: ")) {
            (Ok(warnings), Some(warning)) => {
                assert!(
                    warning.is_empty() || warnings.iter().any(|w| w.contains(warning)),
                    "{name}: {warnings:?}"
                );
            }
            (Err(text), None) => assert!(text.contains(says), "{text}\nshould say {says}"),
            (Ok(_), None) => panic!("{name} was accepted"),
            (Err(text), Some(_)) => panic!("{text}"),
        }
    }
}

#[test]
fn what_is_no_regular_file_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let missing = folder.path().join("missing.gltf");
    assert!(matches!(gltf(&missing, &ImportOptions::default()), Err(Error::Io { .. })));
    assert!(import(folder.path()).unwrap_err().contains("not a regular file"));
    // A device never ends and a pipe without a writer never begins.
    let device = Path::new("/dev/zero");
    if device.exists() {
        assert!(import(device).unwrap_err().contains("not a regular file"));
        let file = folder.path().join("device.gltf");
        std::os::unix::fs::symlink(device, folder.path().join("data.bin")).unwrap();
        std::fs::write(&file, r#"{"asset": {"version": "2.0"}, "buffers": [{"byteLength": 1000, "uri": "data.bin"}]}"#).unwrap();
        assert!(import(&file).unwrap_err().contains("/buffers/0/uri"));
    }
}

#[test]
fn long_chains_of_nodes_are_no_problem() {
    let mut file = Gltf::new();
    let mesh = crate::support::gltf_maker::triangle(&mut file);
    let count = 100_000;
    for i in 1..count {
        file.node(json!({"children": [i]}));
    }
    file.node(json!({"mesh": mesh}));
    file.scene(&[0]);
    assert_eq!(file.load().geometry.instances.len(), 1);
}

#[test]
fn small_files_cannot_multiply_without_bound() {
    // A thousand nodes with a million instances each.
    let mut file = Gltf::new();
    let mesh = crate::support::gltf_maker::triangle(&mut file);
    let offsets =
        file.add("accessors", json!({"componentType": 5126, "type": "VEC3", "count": 1_000_000}));
    for _ in 0..1000 {
        file.node(json!({"mesh": mesh, "extensions": {"EXT_mesh_gpu_instancing": {"attributes": {"TRANSLATION": offsets}}}}));
    }
    let text = file.try_load(&ImportOptions::default()).unwrap_err().to_string();
    assert!(text.contains("a file of this size cannot sensibly ask for so much"), "{text}");

    // Many accessors of the same bytes.
    let mut file = Gltf::new();
    let view = file.view(&vec![0; 1 << 20], None);
    for _ in 0..20_000 {
        file.add(
            "accessors",
            json!({"bufferView": view, "componentType": 5121, "type": "SCALAR", "count": 1 << 20}),
        );
    }
    let text = file.try_load(&ImportOptions::default()).unwrap_err().to_string();
    assert!(text.contains("a file of this size cannot sensibly ask for so much"), "{text}");
}

/// A file with a bit of everything.
pub fn everything() -> Gltf {
    let mut file = Gltf::new();
    let position = file.positions(&[0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 1.0, 1.0, 0.0]);
    let delta = file.positions(&[0.0, 0.0, 1.0, 0.0, 0.0, 1.0, 0.0, 0.0, 1.0, 0.0, 0.0, 1.0]);
    let normal = file.accessor(
        &[0, 0, 127, 0].repeat(4),
        5120,
        "VEC3",
        4,
        json!({"normalized": true}),
        Some(4),
    );
    let uv = file.accessor(
        &shorts(&[0, 0, 1, 0, 0, 1, 1, 1]),
        5123,
        "VEC2",
        4,
        json!({"min": [0, 0], "max": [1, 1]}),
        None,
    );
    let joints = file.accessor(&[0; 16], 5121, "VEC4", 4, json!({}), None);
    let weights =
        file.accessor(&floats(&[1.0, 0.0, 0.0, 0.0].repeat(4)), 5126, "VEC4", 4, json!({}), None);
    let indices = file.accessor(&shorts(&[0, 1, 2, 2, 1, 3]), 5123, "SCALAR", 6, json!({}), None);
    let (places, values) = (file.view(&[1], None), file.view(&floats(&[2.0, 0.0, 0.0]), None));
    let sparse = json!({"count": 1, "indices": {"bufferView": places, "byteOffset": 0, "componentType": 5121},
        "values": {"bufferView": values, "byteOffset": 0}});
    let moved = file.add(
        "accessors",
        json!({"componentType": 5126, "type": "VEC3", "count": 4, "bufferView": 0, "byteOffset": 0, "sparse": sparse}),
    );
    let pixel = "data:image/png;base64,iVBORw0KGgoAAAANSUhEUgAAAAEAAAABCAIAAACQd1PeAAAADElEQVQYV2P4z/AfAAQAAf+I0P3MAAAAAElFTkSuQmCC";
    file.add("images", json!({"uri": pixel, "name": "pixel"}));
    file.add(
        "samplers",
        json!({"magFilter": 9728, "minFilter": 9987, "wrapS": 33071, "wrapT": 10497}),
    );
    file.add("textures", json!({"source": 0, "sampler": 0}));
    let transform = json!({"KHR_texture_transform": {"offset": [0, 0], "rotation": 1, "scale": [1, 1], "texCoord": 0}});
    file.add(
        "materials",
        json!({
            "pbrMetallicRoughness": {"baseColorFactor": [1, 1, 1, 1], "metallicFactor": 0, "roughnessFactor": 1,
                "baseColorTexture": {"index": 0, "texCoord": 0, "extensions": transform}},
            "normalTexture": {"index": 0, "scale": 1}, "emissiveFactor": [0, 0, 1], "alphaMode": "MASK", "alphaCutoff": 0.5,
            "extensions": {"KHR_materials_ior": {"ior": 1.5}, "KHR_materials_clearcoat": {"clearcoatFactor": 1},
                "KHR_materials_pbrSpecularGlossiness": {"specularGlossinessTexture": {"index": 0}, "glossinessFactor": 0.5},
                "KHR_materials_volume": {"thicknessFactor": 1, "attenuationDistance": 2, "attenuationColor": [1, 1, 1]}},
            "extras": {"lumicache": {"brdf": "lafortune", "kd": [0, 0, 0], "lobes": [{"cx": -1, "cz": 1, "exponent": 5}]}},
        }),
    );
    let attributes = json!({"POSITION": position, "NORMAL": normal, "TEXCOORD_0": uv, "JOINTS_0": joints, "WEIGHTS_0": weights});
    let primitive = json!({"attributes": attributes, "indices": indices, "material": 0, "mode": 4, "targets": [{"POSITION": delta}]});
    file.add("meshes", json!({"primitives": [primitive], "weights": [0.5]}));
    file.add("meshes", json!({"primitives": [{"attributes": {"POSITION": moved}, "mode": 5}]}));
    let lens = json!({"yfov": 1, "znear": 0.1, "zfar": 10, "aspectRatio": 1});
    file.add("cameras", json!({"type": "perspective", "perspective": lens}));
    file.extension(
        "KHR_lights_punctual",
        json!({"lights": [{"type": "spot", "intensity": 1, "spot": {"outerConeAngle": 0.5}}]}),
    );
    let offsets = json!({"EXT_mesh_gpu_instancing": {"attributes": {"TRANSLATION": position}}});
    file.add("skins", json!({"joints": [0], "skeleton": 0}));
    file.node(json!({"mesh": 0, "skin": 0, "weights": [0.25]}));
    file.node(
        json!({"mesh": 1, "extensions": offsets, "rotation": [0, 0, 0, 1], "scale": [1, 1, 1]}),
    );
    file.node(json!({"camera": 0, "extensions": {"KHR_lights_punctual": {"light": 0}}, "translation": [0, 0, 5]}));
    file.node(
        json!({"children": [1, 2], "matrix": [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1]}),
    );
    file.scene(&[0, 3]);
    file.set("scene", json!(0));
    file
}

/// Writes a new file in place of an old one; overwriting would make some file systems flush to the
/// disk each time.
fn replace(path: &Path, bytes: &[u8]) {
    if path.exists() {
        std::fs::remove_file(path).unwrap();
    }
    std::fs::write(path, bytes).unwrap();
}

/// The places (JSON pointers) of all values in a document, those in an object before the object.
fn paths(value: &Value, path: String, all: &mut Vec<String>) {
    let children: Vec<(String, &Value)> = match value {
        Value::Array(array) => array.iter().enumerate().map(|(i, v)| (i.to_string(), v)).collect(),
        Value::Object(object) => object.iter().map(|(k, v)| (k.clone(), v)).collect(),
        _ => Vec::new(),
    };
    for (key, child) in children {
        let path = format!("{path}/{key}");
        paths(child, path.clone(), all);
        all.push(path);
    }
}

/// Calls `visit` with the document in which one value after another is replaced by each of
/// `values`, or removed.
fn mutate(document: &Value, values: &[Value], visit: &mut dyn FnMut(Value)) {
    let mut all = Vec::new();
    paths(document, String::new(), &mut all);
    for path in &all {
        for value in values {
            let mut changed = document.clone();
            *changed.pointer_mut(path).unwrap() = value.clone();
            visit(changed);
        }
        let (parent, key) = path.rsplit_once('/').unwrap();
        let mut changed = document.clone();
        if let Some(object) = changed.pointer_mut(parent).and_then(Value::as_object_mut) {
            object.shift_remove(key);
            visit(changed);
        }
    }
}

/// Values that are wrong almost everywhere.
fn hostile() -> Vec<Value> {
    vec![
        json!(-1),
        json!(0),
        json!(3),
        json!(0.5),
        json!(255),
        json!(1_000_000_000),
        json!(u64::MAX),
        json!(1e300),
        json!(-1e38),
        json!("x"),
        json!(null),
        json!(true),
        json!([]),
        json!([0]),
        json!({}),
        json!({"index": 0}),
    ]
}

#[test]
fn no_single_wrong_value_makes_the_import_panic() {
    let sound = everything();
    assert_eq!(sound.load().geometry.instances.len(), 5);
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("mutant.glb");
    let (mut tried, mut refused) = (0, 0);
    mutate(sound.document(), &hostile(), &mut |changed| {
        replace(&path, &sound.glb_of(&changed));
        tried += 1;
        refused += usize::from(import(&path).is_err());
    });
    assert!(tried > 4000 && refused > tried / 2, "{refused} of {tried} were refused");
}

/// A fixed sequence of numbers (a linear congruential generator).
fn sequence() -> impl FnMut() -> usize {
    let mut state = 1u32;
    move || {
        state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        (state >> 8) as usize
    }
}

#[test]
fn no_truncation_and_no_flipped_bytes_make_the_import_panic() {
    let bytes = everything().glb();
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("mutant.glb");
    for n in (0..bytes.len()).step_by(7) {
        replace(&path, &bytes[..n]);
        assert!(import(&path).is_err(), "{n} bytes");
    }
    let mut next = sequence();
    for _ in 0..2000 {
        let mut mutant = bytes.clone();
        for _ in 0..1 + next() % 4 {
            let i = next() % mutant.len();
            mutant[i] = next() as u8;
        }
        replace(&path, &mutant);
        let _ = import(&path);
    }
}

#[test]
fn no_wrong_values_in_our_scenes_make_the_import_panic() {
    let scenes = Path::new(env!("CARGO_MANIFEST_DIR")).join("scenes");
    let folder = tempfile::tempdir().unwrap();
    for entry in std::fs::read_dir(&scenes).unwrap() {
        let file = entry.unwrap().path();
        if file.extension().is_some_and(|e| e != "gltf" && e != "toml" && e != "py") {
            std::fs::copy(&file, folder.path().join(file.file_name().unwrap())).unwrap();
        }
    }
    let path = folder.path().join("mutant.gltf");
    let (hostile, mut next, start) = (hostile(), sequence(), Instant::now());
    let (mut tried, mut refused) = (0, 0);
    for round in 0..20 {
        for file in gltf_files(&scenes) {
            let sound: Value = serde_json::from_slice(&std::fs::read(&file).unwrap()).unwrap();
            let mut all = Vec::new();
            paths(&sound, String::new(), &mut all);
            let mut mutant = sound.clone();
            for _ in 0..1 + next() % 3 {
                // Another value of the document is a likelier mistake than one from nowhere.
                let value = match next() % 3 {
                    0 => hostile[next() % hostile.len()].clone(),
                    _ => sound.pointer(&all[next() % all.len()]).unwrap().clone(),
                };
                if let Some(place) = mutant.pointer_mut(&all[next() % all.len()]) {
                    *place = value;
                }
            }
            replace(&path, mutant.to_string().as_bytes());
            tried += 1;
            refused += usize::from(import(&path).is_err());
        }
        if round > 0 && start.elapsed() > Duration::from_secs(20) {
            break;
        }
    }
    assert!(refused > tried / 4 && refused < tried, "{refused} of {tried} were refused");
}
