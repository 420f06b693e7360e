//! A cache file, its checksum put right: what loads is written again and loads as the same, and can
//! be asked.
#![no_main]

use libfuzzer_sys::{fuzz_mutator, fuzz_target, fuzzer_mutate};
use lumicache::cache::{CacheFile, Preset};
use lumicache::geometry::SurfacePoint;
use lumicache_fuzz::{Dice, change, replace};
use serde_json::Value;
use std::path::Path;

/// Bytes before the header, and of the checksum.
const FIXED: usize = 24;
const CHECKSUM: usize = 32;

/// `file` with a change in its header.
fn other_header(file: &[u8], dice: &mut Dice) -> Option<Vec<u8>> {
    let length = u64::from_le_bytes(file.get(16..FIXED)?.try_into().ok()?) as usize;
    let end = FIXED.checked_add(length)?;
    let old: Value = serde_json::from_slice(file.get(FIXED..end)?).ok()?;
    let mut header = old.clone();
    change(&mut header, &old, dice);
    let header = header.to_string().into_bytes();
    let length = (header.len() as u64).to_le_bytes();
    Some([&file[..16], &length, &header, &file[end..]].concat())
}

fuzz_mutator!(|data: &mut [u8], size: usize, most: usize, seed: u32| {
    let mut dice = Dice::new(seed);
    let other = (dice.below(3) == 0).then(|| other_header(&data[..size], &mut dice)).flatten();
    let length = other.and_then(|file| replace(data, most, &file));
    let length = length.unwrap_or_else(|| fuzzer_mutate(data, size, most));
    if let Some(end) = length.checked_sub(CHECKSUM)
        && dice.below(16) > 0
    {
        let checksum = blake3::hash(&data[..end]);
        data[end..length].copy_from_slice(checksum.as_bytes());
    }
    length
});

fuzz_target!(|bytes: &[u8]| {
    let path = Path::new("cache.lumi");
    let Ok(file) = CacheFile::from_bytes(bytes, path) else { return };
    let again = CacheFile::from_bytes(&file.to_bytes(), path).expect("what was written loads");
    assert_eq!(again.record_count(), file.record_count());
    let names = ["auto", "tabellion04", "krivanek05", "schwarzhaupt12"];
    let preset = Preset::by_name(names[file.record_count() % names.len()]).expect("a preset");
    let places: Vec<Vec<_>> = file
        .levels
        .iter()
        .map(|records| records.iter().take(16).map(|r| (r.position, r.normal)).collect())
        .collect();
    let origin = file.origin.clone();
    let Ok(cache) = file.into_cache(preset.scheme(), &origin, true, path) else { return };
    for (level, places) in (0..).zip(places) {
        for (position, normal) in places {
            let at = SurfacePoint::plain(position, normal);
            let answer = cache.lookup(level, &at, u32::MAX);
            assert!(answer.is_none_or(|a| a.irradiance.is_finite()));
        }
    }
});
