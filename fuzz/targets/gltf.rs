//! A glTF file, as text or binary, without files beside it. What loads becomes a scene, and some of
//! it a picture.
#![no_main]

use libfuzzer_sys::{fuzz_crossover, fuzz_mutator, fuzz_target, fuzzer_mutate};
use lumicache::accel::Backend;
use lumicache::import;
use lumicache::render::{IntegratorKind, Job};
use lumicache::scene::Scene;
use lumicache_fuzz::{Dice, as_file, change, json_of, replace, with_json};

/// One file of so many is rendered: that takes a thousand times as long as reading it.
const RENDERED: usize = 64;
/// Bytes of a binary chunk before its data.
const CHUNK: usize = 8;

fuzz_mutator!(|data: &mut [u8], size: usize, most: usize, seed: u32| {
    let mut dice = Dice::new(seed);
    let choice = dice.below(8);
    // Bytes, whatever they mean.
    if choice == 0 {
        return fuzzer_mutate(data, size, most);
    }
    let Some((mut json, before, after)) = json_of(&data[..size]) else {
        return fuzzer_mutate(data, size, most);
    };
    // What the accessors and images of a binary file show.
    if choice == 1 && after.len() > CHUNK && size <= most {
        let start = size - after.len() + CHUNK;
        fuzzer_mutate(&mut data[start..size], size - start, size - start);
        return size;
    }
    let old = json.clone();
    (0..1 + dice.below(3)).for_each(|_| change(&mut json, &old, &mut dice));
    let file = with_json(&json, before, after);
    replace(data, most, &file).unwrap_or_else(|| fuzzer_mutate(data, size, most))
});

fuzz_crossover!(|one: &[u8], other: &[u8], out: &mut [u8], seed: u32| {
    let (Some((mut json, before, after)), Some((theirs, ..))) = (json_of(one), json_of(other))
    else {
        return 0;
    };
    let mut dice = Dice::new(seed);
    (0..1 + dice.below(8)).for_each(|_| change(&mut json, &theirs, &mut dice));
    let most = out.len();
    replace(out, most, &with_json(&json, before, after)).unwrap_or(0)
});

fuzz_target!(|bytes: &[u8]| {
    as_file("scene.gltf", bytes, |path| {
        let Ok(data) = import::gltf(path, &Default::default()) else { return };
        let small = data.geometry.triangle_count() < 100;
        let Ok((scene, _)) = Scene::new(data, Backend::Bvh) else { return };
        let sum = bytes.iter().map(|b| usize::from(*b)).sum::<usize>();
        if small && sum % RENDERED == 0 {
            let kinds = [IntegratorKind::Cache, IntegratorKind::Path, IntegratorKind::Bdpt];
            let job = Job::new(&scene).integrator(kinds[sum / RENDERED % 3]);
            let Ok(mut settings) = job.quality(0.01).size(2, 2).spp(1).settings() else { return };
            (settings.max_bounces, settings.scheme.levels) = (2, 1);
            let _ = Job::with_settings(&scene, settings).run();
        }
    });
});
