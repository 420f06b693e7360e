//! A map of the environment, Radiance HDR or OpenEXR: all pixels of what loads are there and are
//! numbers that light can have.
#![no_main]

use libfuzzer_sys::fuzz_target;
use lumicache::imagefile::hdr;
use lumicache_fuzz::as_file;

fuzz_target!(|bytes: &[u8]| {
    as_file("sky.hdr", bytes, |path| {
        let Ok((image, _)) = hdr::read_environment(path, None) else { return };
        let colors = image.colors("").expect("an environment has colours");
        assert_eq!(colors.len(), image.width as usize * image.height as usize);
        assert!(colors.iter().all(|c| c.min_element() >= 0.0));
    });
});
