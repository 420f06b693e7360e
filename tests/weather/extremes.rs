//! Valid scenes with extreme numbers: no panic, no hang, and every pixel a number.

use crate::support::gltf_maker::Gltf;
use crate::support::pictures::{build, render, scheme, settings, with_rays};
use lumicache::import::ImportOptions;
use lumicache::render::{IntegratorKind, Settings};
use lumicache::sampling::{hash, unit_f32};
use serde_json::{Value, json};

/// Random choices.
struct Dice(u64, u64);

impl Dice {
    fn next(&mut self) -> f32 {
        self.1 += 1;
        unit_f32(hash(&[self.0, self.1]) as u32)
    }

    fn of<T: Copy>(&mut self, choices: &[T]) -> T {
        choices[(self.next() * choices.len() as f32) as usize % choices.len()]
    }

    /// A number of any size between two powers of ten.
    fn size(&mut self, low: f32, high: f32) -> f32 {
        10.0f32.powf(low + (high - low) * self.next())
    }

    fn vector(&mut self, low: f32, high: f32) -> [f32; 3] {
        [0; 3].map(|_| self.size(low, high) * self.of(&[-1.0, 1.0]))
    }
}

fn material(dice: &mut Dice) -> Value {
    let unit = |dice: &mut Dice| {
        let any = dice.next();
        dice.of(&[0.0, 1.0, 1e-30, any])
    };
    let [r, g, b] = [0; 3].map(|_| unit(dice));
    json!({
        "pbrMetallicRoughness": {"baseColorFactor": [r, g, b, unit(dice)],
            "metallicFactor": unit(dice), "roughnessFactor": unit(dice)},
        "emissiveFactor": [unit(dice) * dice.of(&[0.0, 0.0, 1.0]), 0, 0],
        "alphaMode": dice.of(&["OPAQUE", "OPAQUE", "MASK", "BLEND"]),
        "doubleSided": dice.of(&[true, false]),
        "extensions": {
            "KHR_materials_emissive_strength": {"emissiveStrength": dice.size(-6.0, 9.0)},
            "KHR_materials_ior": {"ior": dice.of(&[0.0, 0.5, 1.0, 1.5, 100.0])},
            "KHR_materials_transmission": {"transmissionFactor": dice.of(&[0.0, 0.0, 1.0, 0.5])},
            "KHR_materials_volume": {"thicknessFactor": dice.of(&[0.0, 1.0]),
                "attenuationDistance": dice.size(-9.0, 9.0), "attenuationColor": [unit(dice), 1, 0.5]},
            "KHR_materials_clearcoat": {"clearcoatFactor": unit(dice)},
        },
    })
}

fn scene(dice: &mut Dice) -> Gltf {
    let mut file = Gltf::new();
    let mut nodes = Vec::new();
    let far = dice.of(&[-1.0, 1.0, 3.0, 6.0, 9.0]);
    for _ in 0..1 + (4.0 * dice.next()) as usize {
        let size = dice.of(&[-6.0, -1.0, 0.0, 1.0, 5.0]);
        let corners: Vec<f32> = (0..4).flat_map(|_| dice.vector(size - 1.0, size)).collect();
        let position = file.positions(&corners);
        let material = material(dice);
        let material = file.add("materials", material);
        let attributes = json!({"POSITION": position});
        let primitive = json!({"attributes": attributes, "material": material, "mode": 5});
        let mesh = file.add("meshes", json!({"primitives": [primitive]}));
        let scale = dice.vector(-3.0, 3.0);
        nodes.push(file.node(
            json!({"mesh": mesh, "scale": scale, "translation": dice.vector(far - 2.0, far)}),
        ));
    }
    let lamp = |dice: &mut Dice| {
        json!({"type": dice.of(&["point", "directional", "spot"]), "intensity": dice.size(-9.0, 12.0),
            "range": dice.size(-3.0, 9.0), "spot": {"outerConeAngle": dice.of(&[1e-4, 0.5, 1.57])}})
    };
    file.extension("KHR_lights_punctual", json!({"lights": [lamp(dice), lamp(dice)]}));
    for light in 0..2 {
        let place = dice.vector(far - 2.0, far);
        let extensions = json!({"KHR_lights_punctual": {"light": light}});
        nodes.push(file.node(json!({"translation": place, "extensions": extensions})));
    }
    let near = dice.size(-6.0, 3.0);
    let lens = json!({"yfov": dice.of(&[1e-4, 0.5, 3.1]), "znear": near, "zfar": near * dice.size(0.1, 6.0)});
    file.add("cameras", json!({"type": "perspective", "perspective": lens}));
    nodes.push(file.node(json!({"camera": 0, "translation": dice.vector(far - 2.0, far)})));
    file.scene(&nodes);
    file
}

#[test]
fn extreme_scenes_render_to_numbers() {
    let presets = ["auto", "ward88", "tabellion04", "krivanek05", "schwarzhaupt12", "aric11"];
    for seed in 0..240 {
        let mut dice = Dice(seed, 0);
        let file = scene(&mut dice);
        let options = ImportOptions { no_clip: dice.of(&[true, false]), ..Default::default() };
        let data = match file.try_load(&options) {
            Ok(data) => data,
            // Some are out of the range of single precision.
            Err(error) => {
                assert!(error.to_string().contains("range of numbers"), "seed {seed}: {error}");
                continue;
            }
        };
        let scene = build(data);
        let kind = dice.of(&[
            IntegratorKind::Cache,
            IntegratorKind::Cache,
            IntegratorKind::Path,
            IntegratorKind::Bdpt,
        ]);
        let scheme = with_rays(scheme(dice.of(&presets)), 32);
        let few = settings(&scene, kind, [8, 6], 1);
        let film = render(&scene, &Settings { scheme, max_bounces: 8, seed, ..few }).film;
        let radiance = film.radiance();
        assert!(radiance.iter().all(|c| c.is_finite()), "seed {seed}: {radiance:?}");
    }
}
