//! An OpenEXR file: every channel of what loads has all pixels.
#![no_main]

use libfuzzer_sys::fuzz_target;
use lumicache::imagefile::exr;

fuzz_target!(|bytes: &[u8]| {
    let Ok(layers) = exr::read_bytes(bytes) else { return };
    let pixels = layers.width as usize * layers.height as usize;
    assert!(layers.channels.iter().all(|c| c.samples.len() == pixels));
});
