//! A glTF file, as text or binary, without files beside it. What loads becomes a scene, and some of
//! it a picture.
#![no_main]

use libfuzzer_sys::{fuzz_mutator, fuzz_target, fuzzer_mutate};
use lumicache::accel::Backend;
use lumicache::import;
use lumicache::render::Job;
use lumicache::scene::Scene;
use lumicache_fuzz::{Dice, as_file, change, json_of, replace, with_json};

/// One file of so many is rendered: that takes a hundred times as long as reading it.
const RENDERED: usize = 16;

fuzz_mutator!(|data: &mut [u8], size: usize, most: usize, seed: u32| {
    let mut dice = Dice::new(seed);
    // One change in eight is to the bytes, whatever they mean.
    if dice.below(8) > 0
        && let Some((mut json, before, after)) = json_of(&data[..size])
    {
        (0..1 + dice.below(3)).for_each(|_| change(&mut json, &mut dice));
        let file = with_json(&json, before, after);
        if let Some(length) = replace(data, most, &file) {
            return length;
        }
    }
    fuzzer_mutate(data, size, most)
});

fuzz_target!(|bytes: &[u8]| {
    as_file("scene.gltf", bytes, |path| {
        let Ok(data) = import::gltf(path, &Default::default()) else { return };
        let small = data.geometry.triangle_count() < 1000;
        let Ok((scene, _)) = Scene::new(data, Backend::Bvh) else { return };
        if small && bytes.iter().map(|b| usize::from(*b)).sum::<usize>() % RENDERED == 0 {
            let _ = Job::new(&scene).quality(0.01).size(4, 3).spp(1).run();
        }
    });
});
