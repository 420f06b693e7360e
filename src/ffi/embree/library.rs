//! Embree loaded at run time, for us alone, and called through its own table.

use super::raw;
use crate::error::{Error, Result};
use crate::ffi::loading;
use std::ffi::OsString;
use std::path::Path;
use std::sync::OnceLock;

#[cfg(embree4)]
const NAME: &str = "libembree4.so.4";
#[cfg(not(embree4))]
const NAME: &str = "libembree3.so.3";

static NAMED: OnceLock<OsString> = OnceLock::new();
static LIBRARY: OnceLock<std::result::Result<raw::Embree, String>> = OnceLock::new();

/// Names the file to load in place of those that are searched. The first name counts, and only
/// before the first device.
pub fn name(path: OsString) {
    let _ = NAMED.set(path);
}

/// Loads the library, once.
///
/// # Errors
/// `Error::Device` that says where it was looked for.
pub fn load() -> Result<&'static raw::Embree> {
    LIBRARY.get_or_init(open).as_ref().map_err(|what| Error::Device(what.clone()))
}

/// The library; a device that was made has loaded it.
#[inline]
pub fn loaded() -> &'static raw::Embree {
    match LIBRARY.get() {
        Some(Ok(library)) => library,
        _ => unreachable!("Embree is loaded when its first device is made"),
    }
}

/// The files to try: the named one alone if there is one, else the one found when this was
/// compiled, then the usual places.
fn candidates() -> Vec<OsString> {
    if let Some(path) = NAMED.get() {
        return vec![path.clone()];
    }
    let folders = [
        "/usr/lib/x86_64-linux-gnu",
        "/usr/lib/aarch64-linux-gnu",
        "/usr/lib64",
        "/usr/lib",
        "/usr/local/lib",
    ];
    let mut all = vec![OsString::from(env!("LUMICACHE_EMBREE_FOUND"))];
    all.extend(folders.iter().map(|f| OsString::from(format!("{f}/{NAME}"))));
    all
}

fn open() -> std::result::Result<raw::Embree, String> {
    let mut reasons = Vec::new();
    for path in candidates() {
        // A bare name would find what the host has loaded.
        if !Path::new(&path).is_absolute() {
            reasons.push(format!("{}: not an absolute path", path.display()));
            continue;
        }
        let functions = |library| {
            // SAFETY: the library's functions have the types of the headers that bindgen read; its
            // version is checked when a device is made.
            unsafe { raw::Embree::from_library(library) }.map_err(|error| error.to_string())
        };
        match loading::open(Path::new(&path)).and_then(functions) {
            Ok(embree) => return Ok(embree),
            Err(error) => reasons.push(error),
        }
    }
    let tried = reasons.join("; ");
    Err(format!(
        "Embree was not found ({tried}): install Debian's libembree-dev, or name the file in LUMICACHE_EMBREE, or choose the backend \"bvh\""
    ))
}
