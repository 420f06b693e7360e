//! Whole pictures against references: those of another renderer, and our own path tracer's.

use crate::support::pictures::{
    assert_alike, beauty, blocks, build, cached, difference, load, own, render, settings, window,
};
use crate::support::testdata;
use lumicache::cache::PRESETS;
use lumicache::film::LAYERS;
use lumicache::imagefile::{Picture, exr};
use lumicache::light::EnvironmentMap;
use lumicache::math::Color;
use lumicache::render::{Facts, IntegratorKind, Selection, Settings, write_exr};
use lumicache::scene::Scene;

/// A converged picture of another renderer, with its scene and the relMSE of its own noise.
struct Reference {
    scene: Scene,
    picture: Picture,
    noise: f64,
}

impl Reference {
    fn find(name: &str) -> Option<Self> {
        let scene = testdata::find(&format!("references/{name}.gltf"))?;
        let picture = testdata::find(&format!("references/{name}_full.exr"))?;
        let noise = std::fs::read(testdata::find("references/noise.json")?).unwrap();
        let noise: serde_json::Value = serde_json::from_slice(&noise).unwrap();
        let noise = noise[format!("{name}_full")].as_f64().unwrap();
        Some(Self { scene: build(load(&scene)), picture: exr::read(&picture).unwrap(), noise })
    }

    fn size(&self) -> [u32; 2] {
        [self.picture.width, self.picture.height]
    }
}

#[test]
fn the_path_tracer_has_the_reference_s_mean() {
    for name in ["cornell_diffuse", "cornell_glossy"] {
        let Some(r) = Reference::find(name) else { return };
        let image =
            beauty(&render(&r.scene, &settings(&r.scene, IntegratorKind::Path, r.size(), 4)));
        // The standard error of the mean is below 0.1 %. relMSE at 4 samples only shows that it is
        // the same picture.
        assert_alike(&format!("{name} path"), &image, &r.picture, r.noise, 0.05, 0.005);
    }
}

#[test]
fn the_path_tracer_s_error_falls_as_one_over_n() {
    for name in ["cornell_diffuse", "cornell_glossy"] {
        let Some(r) = Reference::find(name) else { return };
        let part = [160, 256, 288, 384];
        let reference = window(&r.picture, part);
        let relmse = [4, 16, 64].map(|spp| {
            let settings = Settings {
                window: part,
                ..settings(&r.scene, IntegratorKind::Path, r.size(), spp)
            };
            difference(&beauty(&render(&r.scene, &settings)), &reference).relmse - r.noise
        });
        // A quarter at each step but for a few rare bright samples, a sixteenth from end to end.
        let falls = relmse[1] * 3.0 < relmse[0]
            && relmse[2] * 3.0 < relmse[1]
            && relmse[2] * 16.0 < relmse[0] * 1.1;
        assert!(falls, "{name}: relMSE {relmse:?} at 4, 16 and 64 samples");
    }
}

#[test]
fn presets_come_near_the_reference() {
    let Some(r) = Reference::find("cornell_diffuse") else { return };
    for preset in ["ward-heckbert92", "tabellion04", "auto"] {
        let image = beauty(&render(&r.scene, &cached(&r.scene, preset, r.size(), 4)));
        assert_alike(&format!("cornell_diffuse {preset}"), &image, &r.picture, r.noise, 1e-3, 0.01);
    }
}

#[test]
fn presets_come_near_the_path_tracer() {
    // So few rays and pixels leave the room's mean to chance: the deepest records have 16 rays, and
    // there is 2 % of bias without gradients. Means over blocks of 4 x 4 pixels, which quiet
    // the path tracer: what is left of its noise is taken off.
    for (name, size, relmse, mean) in
        [("cornell-box", [64, 64], 6e-4, 0.01), ("indirect-room", [96, 54], 1.6e-2, 0.08)]
    {
        let scene = build(own(name));
        let half = |seed| {
            let settings = Settings { seed, ..settings(&scene, IntegratorKind::Path, size, 64) };
            blocks(&beauty(&render(&scene, &settings)), 4)
        };
        let (mut reference, other) = (half(1), half(2));
        // The variance of the mean of two is a quarter of their squared difference.
        let noise = 0.25 * difference(&reference, &other).relmse;
        for (a, b) in reference.channels.iter_mut().zip(&other.channels) {
            a.samples.iter_mut().zip(&b.samples).for_each(|(a, b)| *a = 0.5 * (*a + b));
        }
        for preset in PRESETS.iter() {
            let mut settings = cached(&scene, &preset.name, size, 8);
            settings.scheme.gather.rays = settings.scheme.gather.rays.min(256);
            let image = blocks(&beauty(&render(&scene, &settings)), 4);
            assert_alike(
                &format!("{name} {}", preset.name),
                &image,
                &reference,
                noise,
                relmse,
                mean,
            );
        }
    }
}

/// The five parts of the beauty.
const PARTS: [&str; 5] =
    ["diffuse_direct", "diffuse_indirect", "glossy_direct", "glossy_indirect", "emission"];

#[test]
fn the_five_parts_sum_to_the_beauty() {
    // Diffuse, glossy, coated and transparent things under lamps and a sky; the things glow a
    // little, since the lamps are out of sight.
    let mut data = own("glossy-still-life");
    data.environment = Some(EnvironmentMap::constant(Color::new(0.1, 0.2, 0.3)));
    data.materials.iter_mut().for_each(|m| m.emission += 0.01);
    let scene = build(data);
    let path = settings(&scene, IntegratorKind::Path, [60, 40], 4);
    let presets = ["auto", "ward88", "aric11"].map(|preset| cached(&scene, preset, [60, 40], 4));
    for settings in std::iter::once(path).chain(presets) {
        let what = format!("{} {}", settings.integrator.name(), settings.describe());
        let frame = render(&scene, &settings);
        let parts =
            PARTS.map(|name| frame.film.channels(LAYERS.iter().find(|l| l.name == name).unwrap()));
        let largest: Vec<f32> =
            parts.iter().map(|p| p.iter().flatten().fold(0.0, |m: f32, &x| m.max(x))).collect();
        assert!(largest.iter().all(|&x| x > 0.0), "{what}: {PARTS:?} reach {largest:?}");
        for (k, color) in frame.film.radiance().iter().enumerate() {
            for c in 0..3 {
                let sum: f32 = parts.iter().map(|p| p[c][k]).sum();
                assert!(
                    (sum - color[c]).abs() <= 1e-5 * color[c],
                    "{what}: pixel {k}: {sum} for {}",
                    color[c]
                );
            }
        }

        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("parts.exr");
        write_exr(&file, &frame, &settings, &Selection::parse("basic").unwrap(), &Facts::default())
            .unwrap();
        let layers = exr::read(&file).unwrap();
        for c in ["R", "G", "B"] {
            let beauty = &layers.channel(c).unwrap().samples;
            let parts = PARTS.map(|name| &layers.channel(&format!("{name}.{c}")).unwrap().samples);
            for (k, &whole) in beauty.iter().enumerate() {
                let sum: f32 = parts.iter().map(|p| p[k]).sum();
                // Six numbers rounded to 11 bits, or to 2^-25 where they are subnormal.
                assert!(
                    (sum - whole).abs() <= 1e-3 * whole + 2e-7,
                    "{what}: pixel {k} of the file: {sum} for {whole}"
                );
            }
        }
    }
}
