//! A measured luminaire: what loads can be asked and sampled.
#![no_main]

use libfuzzer_sys::fuzz_target;
use lumicache::import;
use lumicache::math::{Vec2, Vec3};
use lumicache_fuzz::as_file;

fuzz_target!(|bytes: &[u8]| {
    as_file("lamp.ies", bytes, |path| {
        let Ok(profile) = import::ies(path) else { return };
        assert!(profile.flux().is_finite() && profile.intensity(Vec3::NEG_Z).is_finite());
        if let Some(direction) = profile.sample(Vec2::splat(0.5)) {
            assert!(direction.is_finite() && profile.pdf(direction) > 0.0);
        }
    });
});
