//! A Radiance HDR file: all pixels of what loads are there.
#![no_main]

use libfuzzer_sys::fuzz_target;
use lumicache::imagefile::hdr;
use lumicache_fuzz::as_file;

fuzz_target!(|bytes: &[u8]| {
    as_file("sky.hdr", bytes, |path| {
        let Ok(image) = hdr::read_hdr(path) else { return };
        assert_eq!(image.pixels.len(), image.width as usize * image.height as usize);
    });
});
