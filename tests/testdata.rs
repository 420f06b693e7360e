//! The extra test data that the variable `LUMICACHE_TEST_DATA` points to. Without it the tests that need it say so and pass.

use std::path::PathBuf;

/// The path of `name` in the extra test data, or `None` after a line on stderr that the calling test is skipped.
pub fn find(name: &str) -> Option<PathBuf> {
    let Some(root) = std::env::var_os("LUMICACHE_TEST_DATA").filter(|r| !r.is_empty()) else {
        eprintln!("SKIPPED: needs {name}, and LUMICACHE_TEST_DATA is not set");
        return None;
    };
    let path = PathBuf::from(root).join(name);
    assert!(path.exists(), "LUMICACHE_TEST_DATA is set but {} is missing", path.display());
    Some(path)
}
