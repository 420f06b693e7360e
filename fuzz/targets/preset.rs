//! A preset as text: what is read is sound, and what it is written as reads back as the same.
#![no_main]

use libfuzzer_sys::fuzz_target;
use lumicache::cache::Preset;

fuzz_target!(|bytes: &[u8]| {
    let Ok(text) = std::str::from_utf8(bytes) else { return };
    let Ok(preset) = Preset::from_text(text) else { return };
    let scheme = preset.scheme();
    scheme.check().expect("a preset is sound");
    let again = Preset::from_text(&preset.to_toml()).expect("what is written reads back");
    assert_eq!(again.scheme().settings(), scheme.settings());
});
