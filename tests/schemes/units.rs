//! The units of length and of light do not matter.

use crate::schemes::presets::{quick, staircase};
use crate::support::pictures::{assert_alike, beauty, build, cached, fill, own, render};
use lumicache::cache::PRESETS;
use lumicache::math::{Affine3A, Vec3};
use lumicache::render::{Frame, Settings};
use lumicache::scene::SceneData;

/// The scene `factor` times as large.
fn scaled(mut data: SceneData, factor: f32) -> SceneData {
    for instance in &mut data.geometry.instances {
        instance.to_world = Affine3A::from_scale(Vec3::splat(factor)) * instance.to_world;
    }
    for camera in &mut data.cameras {
        camera.to_world.translation *= factor;
        camera.clip = camera.clip.map(|plane| plane * factor);
    }
    data
}

#[test]
fn the_unit_of_length_does_not_matter() {
    for preset in ["ward-heckbert92", "jarosz12", "schwarzhaupt12"] {
        scaled_pictures(preset);
    }
}

fn scaled_pictures(preset: &str) {
    let shot = |factor: f32| {
        let scene = build(scaled(own("cornell-box"), factor));
        let [frame, other] = [0, 1]
            .map(|seed| render(&scene, &Settings { seed, ..cached(&scene, preset, [64, 64], 4) }));
        let records = |frame: &Frame| frame.caches.as_ref().unwrap().cache.record_count();
        ((records(&frame) + records(&other)) as f32, beauty(&frame))
    };
    let (records, picture) = shot(1.0);
    for factor in [1000.0, 0.001] {
        let (scaled_records, scaled_picture) = shot(factor);
        // The random numbers are others, since they belong to positions; so the numbers of records
        // differ a little, too.
        assert!(
            (scaled_records / records - 1.0).abs() < 0.03,
            "{preset}: {records} records, and {scaled_records} at scale {factor}"
        );
        assert_alike(
            &format!("{preset}, scale {factor}"),
            &scaled_picture,
            &picture,
            0.0,
            5e-4,
            0.006,
        );
    }
}

#[test]
fn the_unit_of_light_does_not_matter() {
    let (scene, points) = staircase(0);
    let brighter = |factor: f32| {
        let mut data = own("staircase");
        data.materials.iter_mut().for_each(|m| m.emission *= factor);
        assert!(data.punctual.is_empty() && data.environment.is_none());
        build(data)
    };
    for preset in PRESETS.iter() {
        let (cache, _) = fill(&scene, quick(preset.scheme()), &points);
        // A power of two changes no rounding; 100 changes at worst a decision that was undecided
        // before.
        for (factor, tolerance) in [(128.0, 0.0), (100.0, 0.01)] {
            let (other, _) = fill(&brighter(factor), quick(preset.scheme()), &points);
            let (a, b) = (cache.records(0), other.records(0));
            assert!(
                a.len().abs_diff(b.len()) as f32 <= tolerance * a.len() as f32,
                "{}: {} and {}",
                preset.name,
                a.len(),
                b.len()
            );
            if tolerance == 0.0 {
                for (a, b) in a.iter().zip(b) {
                    assert_eq!(
                        (a.position, a.length, factor * a.payload.irradiance),
                        (b.position, b.length, b.payload.irradiance),
                        "{}",
                        preset.name
                    );
                }
            }
        }
    }
}
