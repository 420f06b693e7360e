//! The rules of the glTF validator, one by one: what makes the meaning of a file ambiguous or
//! unsafe is an error, what does not is mended with a warning, and both are errors of the strict
//! import.

use crate::import::malformed::everything;
use crate::support::gltf_maker::Gltf;
use lumicache::import::{ImportOptions, gltf};
use serde_json::{Value, json};

/// What becomes of a broken file.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Verdict {
    /// An error.
    Refused,
    /// A warning.
    Mended,
    /// Nothing: it changes nothing.
    Allowed,
    /// The file is sound.
    Sound,
}
use Verdict::{Allowed, Mended, Refused, Sound};

/// A file with a bit of everything, in which nothing is wrong.
fn sound() -> (Gltf, Value) {
    let file = everything();
    let mut document = file.document().clone();
    document["extensionsUsed"] = json!([
        "EXT_mesh_gpu_instancing",
        "KHR_lights_punctual",
        "KHR_materials_clearcoat",
        "KHR_materials_ior",
        "KHR_materials_pbrSpecularGlossiness",
        "KHR_materials_volume",
        "KHR_mesh_quantization",
        "KHR_texture_transform"
    ]);
    for (accessor, max) in [(0, [1, 1, 0]), (1, [0, 0, 1]), (7, [2, 1, 0])] {
        let min = if accessor == 1 { [0, 0, 1] } else { [0, 0, 0] };
        document["accessors"][accessor]["min"] = json!(min);
        document["accessors"][accessor]["max"] = json!(max);
    }
    (file, document)
}

/// The text of the error, or the warnings.
fn read(file: &Gltf, document: &Value, strict: bool) -> Result<Vec<String>, String> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.glb");
    std::fs::write(&path, file.glb_of(document)).unwrap();
    let options = ImportOptions { strict, ..ImportOptions::default() };
    match gltf(&path, &options) {
        Ok(scene) => Ok(scene.warnings),
        Err(error) => Err(error.to_string().split_once("a.glb: ").unwrap().1.to_owned()),
    }
}

#[test]
#[rustfmt::skip]
fn each_rule_has_its_verdict() {
    let mesh = "/meshes/0/primitives/0";
    let rules: &[(&str, Verdict, String, Value)] = &[
        ("ARRAY_LENGTH_NOT_IN_LIST", Refused, "/nodes/2/translation".into(), json!([0, 0])),
        ("ARRAY_TYPE_MISMATCH", Refused, "/nodes/2/translation/1".into(), json!("x")),
        ("DUPLICATE_ELEMENTS", Mended, "/skins/0/joints".into(), json!([0, 0])),
        ("DUPLICATE_ELEMENTS", Mended, "/extensionsUsed/1".into(), json!("EXT_mesh_gpu_instancing")),
        ("EMPTY_ENTITY", Mended, "/animations".into(), json!([])),
        ("EMPTY_ENTITY", Mended, "/nodes/2/children".into(), json!([])),
        ("EMPTY_ENTITY", Mended, "/meshes/1/primitives/0/attributes".into(), json!({})),
        ("EMPTY_ENTITY", Refused, "/skins/0/joints".into(), json!([])),
        ("INVALID_INDEX", Refused, "/nodes/2/camera".into(), json!(-1)),
        ("INVALID_URI", Mended, "/images/0/uri".into(), json!("data:x")),
        ("ONE_OF_MISMATCH", Refused, "/images/0/bufferView".into(), json!(0)),
        ("PATTERN_MISMATCH", Refused, "/asset/version".into(), json!("two")),
        ("TYPE_MISMATCH", Refused, "/nodes/2/name".into(), json!(1)),
        ("TYPE_MISMATCH", Refused, "/accessors/0/extensions".into(), json!(1)),
        ("TYPE_MISMATCH", Refused, "/samplers/0/extensions/FOO_bar".into(), json!(1)),
        ("UNDEFINED_PROPERTY", Refused, "/cameras/0/perspective".into(), json!({"yfov": 1})),
        ("UNEXPECTED_PROPERTY", Sound, "/nodes/2/colour".into(), json!(1)),
        ("UNSATISFIED_DEPENDENCY", Refused, "/nodes/2/weights".into(), json!([1])),
        ("UNSATISFIED_DEPENDENCY", Mended, "/extensionsRequired".into(), json!(["KHR_materials_unlit"])),
        ("VALUE_MULTIPLE_OF", Refused, "/bufferViews/2/byteStride".into(), json!(5)),
        ("VALUE_NOT_IN_LIST", Mended, "/samplers/0/wrapS".into(), json!(1)),
        ("VALUE_NOT_IN_LIST", Refused, format!("{mesh}/mode"), json!(7)),
        ("VALUE_NOT_IN_RANGE", Mended, "/materials/0/pbrMetallicRoughness/roughnessFactor".into(), json!(1.5)),
        ("VALUE_NOT_IN_RANGE", Refused, "/materials/0/pbrMetallicRoughness/roughnessFactor".into(), json!(50)),
        ("VALUE_NOT_IN_RANGE", Refused, "/cameras/0/perspective/znear".into(), json!(0)),
        ("ACCESSOR_NORMALIZED_INVALID", Refused, "/accessors/0/normalized".into(), json!(true)),
        ("ACCESSOR_OFFSET_ALIGNMENT", Refused, "/accessors/6/byteOffset".into(), json!(1)),
        ("ACCESSOR_SPARSE_COUNT_OUT_OF_RANGE", Refused, "/accessors/7/sparse/count".into(), json!(5)),
        ("CAMERA_ZFAR_LEQUAL_ZNEAR", Refused, "/cameras/0/perspective/zfar".into(), json!(0.05)),
        ("INTEGER_WRITTEN_AS_FLOAT", Allowed, "/nodes/2/camera".into(), json!(0.0)),
        ("MESH_INVALID_WEIGHTS_COUNT", Refused, "/meshes/0/weights".into(), json!([1, 2])),
        ("MESH_PRIMITIVE_INDEXED_SEMANTIC_CONTINUITY", Mended, format!("{mesh}/attributes/COLOR_1"), json!(4)),
        ("MESH_PRIMITIVE_INVALID_ATTRIBUTE", Mended, format!("{mesh}/attributes/COLOUR"), json!(4)),
        ("MESH_PRIMITIVE_NO_POSITION", Sound, "/extras".into(), json!({"index": 99})),
        ("NODE_MATRIX_NON_TRS", Allowed, "/nodes/3/matrix".into(), json!([1, 1, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1])),
        ("NODE_MATRIX_TRS", Refused, "/nodes/3/scale".into(), json!([1, 1, 1])),
        ("NODE_ROTATION_NON_UNIT", Mended, "/nodes/1/rotation".into(), json!([0, 0, 0, 2])),
        ("UNKNOWN_ASSET_MAJOR_VERSION", Refused, "/asset/version".into(), json!("3.0")),
        ("ACCESSOR_TOO_LONG", Refused, "/accessors/3/count".into(), json!(5)),
        ("ACCESSOR_SMALL_BYTESTRIDE", Refused, "/bufferViews/1/byteStride".into(), json!(8)),
        ("BUFFER_VIEW_TOO_LONG", Refused, "/bufferViews/0/byteLength".into(), json!(9999)),
        ("MESH_PRIMITIVE_ATTRIBUTES_ACCESSOR_INVALID_FORMAT", Refused, format!("{mesh}/attributes/NORMAL"), json!(4)),
        ("MESH_PRIMITIVE_INDICES_ACCESSOR_INVALID_FORMAT", Refused, format!("{mesh}/indices"), json!(0)),
        ("MESH_PRIMITIVE_MORPH_TARGET_NO_BASE_ACCESSOR", Mended, format!("{mesh}/targets/0/TANGENT"), json!(1)),
        ("NODE_LOOP", Refused, "/nodes/2/children".into(), json!([3])),
        ("NODE_PARENT_OVERRIDE", Refused, "/nodes/2/children".into(), json!([1])),
        ("NODE_SKIN_WITH_NON_SKINNED_MESH", Mended, "/nodes/1/skin".into(), json!(0)),
        ("NODE_WEIGHTS_INVALID", Refused, "/nodes/0/weights".into(), json!([1, 2])),
        ("SCENE_NON_ROOT_NODE", Refused, "/scenes/0/nodes/0".into(), json!(1)),
        ("UNDECLARED_EXTENSION", Allowed, "/extensionsUsed".into(), json!(["KHR_lights_punctual"])),
        ("UNEXPECTED_EXTENSION_OBJECT", Mended, "/nodes/2/extensions/KHR_materials_ior".into(), json!({})),
        ("UNRESOLVED_REFERENCE", Refused, "/materials/0/occlusionTexture".into(), json!({"index": 9})),
        ("UNRESOLVED_REFERENCE", Refused, "/materials/0/extensions/KHR_materials_sheen".into(), json!({"sheenColorTexture": {"index": 9}})),
        ("UNRESOLVED_REFERENCE", Refused, "/materials/0/extensions/KHR_materials_clearcoat/clearcoatNormalTexture".into(), json!({"index": 9})),
        ("UNRESOLVED_REFERENCE", Refused, format!("{mesh}/extensions"), json!({"KHR_materials_variants": {"mappings": [{"material": 9, "variants": [0]}]}})),
        ("UNRESOLVED_REFERENCE", Refused, format!("{mesh}/attributes/_CUSTOM"), json!(99)),
        ("UNRESOLVED_REFERENCE", Refused, "/textures/0/source".into(), json!(9)),
        ("UNRESOLVED_REFERENCE", Mended, "/textures/1".into(), json!({"source": 9})),
        ("UNSUPPORTED_EXTENSION", Sound, "/extensionsUsed/8".into(), json!("FOO_bar")),
        ("ANIMATION_SAMPLER_INPUT_ACCESSOR_INVALID_FORMAT", Mended, "/animations".into(),
            json!([{"samplers": [{"input": 0, "output": 0}], "channels": [{"sampler": 0, "target": {"node": 1, "path": "translation"}}]}])),
        ("UNUSED_OBJECT", Sound, "/images/1".into(), json!({"uri": "x.png", "name": ""})),
        ("UNUSED_OBJECT", Sound, "/samplers/1".into(), json!({"name": "", "extras": [1, {"index": 99}]})),
        ("UNUSED_OBJECT", Sound, "/cameras/1".into(), json!({"type": "orthographic", "name": "é\u{0}", "orthographic": {"xmag": -1, "ymag": 1, "znear": 0, "zfar": 1}})),
        ("UNUSED_OBJECT", Sound, "/materials/1".into(), json!({"extensions": {"FOO_bar": {"index": 99}}, "extras": 5})),
        ("UNUSED_OBJECT", Sound, "/animations".into(), json!([{"name": "", "samplers": [{"input": 0, "output": 0}], "channels": [{"sampler": 0, "target": {"path": "pointer"}}]}])),
        ("UNUSED_OBJECT", Sound, "/bufferViews/9".into(), json!({"buffer": 0, "byteLength": 4, "name": "", "target": 34962})),
        ("UNUSED_OBJECT", Sound, "/skins/1".into(), json!({"joints": [3], "name": "other"})),
        ("UNUSED_OBJECT", Sound, "/scenes/1".into(), json!({"name": ""})),
        ("UNUSED_OBJECT", Sound, "/nodes/4".into(), json!({})),
    ];
    let (file, sound) = sound();
    let warnings = read(&file, &sound, true).unwrap();
    let mut wrong = Vec::new();
    for (rule, verdict, place, value) in rules {
        let mut document = sound.clone();
        put(&mut document, place, value.clone());
        let (lenient, strict) = (read(&file, &document, false), read(&file, &document, true));
        let near = |text: &String| {
            let at = text.split(": ").next().unwrap();
            place.starts_with(at) || at.starts_with(place.as_str()) || at == "/accessors/7"
        };
        let is = match (&lenient, &strict) {
            (Ok(w), Ok(_)) if *w == warnings => Sound,
            (Ok(w), Err(_)) if *w == warnings => Allowed,
            (Ok(_), Err(_)) => Mended,
            (Err(text), Err(_)) if near(text) || text.contains(place.as_str()) => Refused,
            _ => return assert_eq!(lenient, strict, "{rule} {place}"),
        };
        if is != *verdict {
            wrong.push(format!("{rule} {place}: {is:?}, not {verdict:?}: {lenient:?}, {strict:?}"));
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

/// Puts a value at a JSON path, of which the last step may be new.
fn put(document: &mut Value, path: &str, value: Value) {
    let (parent, key) = path.rsplit_once('/').unwrap();
    if document.pointer(parent).is_none() {
        put(document, parent, json!({}));
    }
    match document.pointer_mut(parent).unwrap() {
        Value::Array(array) => {
            let i: usize = key.parse().unwrap();
            if i < array.len() { array[i] = value } else { array.push(value) }
        }
        object => object[key] = value,
    }
}
