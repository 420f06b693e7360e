//! A cache file: what loads is written again and loads as the same.
#![no_main]

use libfuzzer_sys::fuzz_target;
use lumicache::cache::CacheFile;
use std::path::Path;

fuzz_target!(|bytes: &[u8]| {
    let path = Path::new("cache.lumi");
    let Ok(file) = CacheFile::from_bytes(bytes, path) else { return };
    let again = CacheFile::from_bytes(&file.to_bytes(), path).expect("what was written loads");
    assert_eq!(again.record_count(), file.record_count());
});
