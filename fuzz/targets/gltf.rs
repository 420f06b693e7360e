//! A glTF file, as text or binary, without files beside it.
#![no_main]

use libfuzzer_sys::fuzz_target;
use lumicache::import;
use lumicache_fuzz::as_file;

fuzz_target!(|bytes: &[u8]| {
    as_file("scene.gltf", bytes, |path| {
        let _ = import::gltf(path, &Default::default());
    });
});
