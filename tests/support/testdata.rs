//! The extra test data that the variable `LUMICACHE_TEST_DATA` points to. Without it the tests that
//! need it say so and pass.

use std::io::Write;
use std::path::{Path, PathBuf};

/// Says on stderr that the calling test is skipped, past libtest, which shows what a test prints
/// only when it fails.
pub fn skipped(why: &str) {
    let line = format!("SKIPPED {}: {why}\n", std::thread::current().name().unwrap_or("a test"));
    std::io::stderr().write_all(line.as_bytes()).expect("stderr takes a line");
}

/// The path of `name` in the extra test data, or `None` after a line on stderr that the calling
/// test is skipped.
pub fn find(name: &str) -> Option<PathBuf> {
    let Some(root) = std::env::var_os("LUMICACHE_TEST_DATA").filter(|r| !r.is_empty()) else {
        skipped(&format!("needs {name}, and LUMICACHE_TEST_DATA is not set"));
        return None;
    };
    let path = PathBuf::from(root).join(name);
    assert!(path.exists(), "LUMICACHE_TEST_DATA is set but {} is missing", path.display());
    Some(path)
}

/// Every glTF file below `folder`, in order.
pub fn gltf_files(folder: &Path) -> Vec<PathBuf> {
    let mut files = Vec::new();
    let mut folders = vec![folder.to_owned()];
    while let Some(folder) = folders.pop() {
        for entry in std::fs::read_dir(&folder).unwrap() {
            let path = entry.unwrap().path();
            if path.is_dir() {
                folders.push(path);
            } else if path.extension().is_some_and(|e| e == "gltf" || e == "glb") {
                files.push(path);
            }
        }
    }
    files.sort();
    files
}
