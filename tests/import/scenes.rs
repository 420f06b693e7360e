//! Our own scenes: made by their script, complete, and described.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

fn folder() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("scenes")
}

/// The names of the scenes, without extension.
fn names() -> Vec<String> {
    let entries = fs::read_dir(folder())
        .expect("scenes/ is part of the project")
        .map(|e| e.expect("readable").path());
    let mut names: Vec<_> = entries
        .filter(|p| p.extension().is_some_and(|e| e == "gltf"))
        .map(|p| p.file_stem().expect("a file has a name").to_string_lossy().into_owned())
        .collect();
    names.sort();
    assert!(names.len() >= 11, "scenes are missing: {names:?}");
    names
}

#[test]
fn the_script_makes_the_same_bytes() {
    let made = tempfile::tempdir().unwrap();
    let run = Command::new("python3")
        .arg(folder().join("make_scenes.py"))
        .arg(made.path())
        .env("PYTHONDONTWRITEBYTECODE", "1")
        .output();
    let run = match run {
        Err(e) if e.kind() == std::io::ErrorKind::NotFound => {
            return crate::support::testdata::skipped(
                "there is no python3 to make the scenes with",
            );
        }
        run => run.unwrap(),
    };
    assert!(run.status.success(), "{}", String::from_utf8_lossy(&run.stderr));
    let mut files: Vec<_> =
        fs::read_dir(made.path()).unwrap().map(|e| e.unwrap().file_name()).collect();
    files.sort();
    assert_eq!(
        files.len(),
        3 * names().len(),
        "one .gltf, .bin and .toml for each scene: {files:?}"
    );
    for name in files {
        let (new, old) = (
            fs::read(made.path().join(&name)).unwrap(),
            fs::read(folder().join(&name)).unwrap_or_default(),
        );
        assert!(
            new == old,
            "scenes/{} is not what make_scenes.py writes: run `make scenes`",
            name.to_string_lossy()
        );
    }
}

#[test]
fn each_scene_says_what_it_is() {
    for name in names() {
        let description = fs::read_to_string(folder().join(format!("{name}.toml")))
            .unwrap_or_else(|e| panic!("{name}.toml: {e}"));
        let value =
            |key: &str| description.lines().find_map(|l| l.strip_prefix(key)?.strip_prefix(" = "));
        assert_eq!(value("licence"), Some("\"CC0-1.0\""), "{name}.toml");
        for key in ["title", "size", "camera", "notes"] {
            assert!(
                value(key).is_some_and(|v| v.len() > 2),
                "{name}.toml: {key} is missing or empty"
            );
        }
    }
}

#[test]
fn each_scene_loads_without_a_warning() {
    for name in names() {
        let path = folder().join(format!("{name}.gltf"));
        let scene =
            lumicache::import::gltf(&path, &Default::default()).unwrap_or_else(|e| panic!("{e}"));
        assert!(scene.warnings.is_empty(), "{name}: {:?}", scene.warnings);
        assert_eq!(scene.cameras.len(), 1, "{name}: cameras");
        assert!(
            !scene.geometry.instances.is_empty() && !scene.materials.is_empty(),
            "{name} is empty"
        );
    }
}
