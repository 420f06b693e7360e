//! Light paths begin as bright and as densely as their lights say.

use lumicache::geometry::{Aabb, Geometry, Instance, TriangleMesh};
use lumicache::light::*;
use lumicache::math::{Affine3A, Color, Vec3};
use lumicache::sampling::Rng;
use std::sync::Arc;

fn lights() -> (Lights, Aabb) {
    let positions = vec![
        Vec3::ZERO,
        Vec3::X,
        Vec3::Y,
        Vec3::new(0.0, 0.0, 2.0),
        Vec3::new(2.0, 0.0, 2.0),
        Vec3::new(0.0, 1.0, 2.0),
    ];
    let mesh = TriangleMesh {
        positions: positions.into(),
        indices: vec![[0, 1, 2], [3, 4, 5]].into(),
        ..TriangleMesh::default()
    };
    let geometry = Geometry {
        meshes: vec![Arc::new(mesh)],
        instances: vec![Instance { mesh: 0, to_world: Affine3A::IDENTITY }],
    };
    let emitter = |triangle, double_sided| Emitter {
        instance: 0,
        triangle,
        radiance: Color::new(3.0, 2.0, 1.0),
        double_sided,
    };
    let punctual = vec![
        PunctualLight::Directional { direction: Vec3::NEG_Y, irradiance: Color::splat(0.7) },
        PunctualLight::Point {
            position: Vec3::ONE,
            intensity: Color::splat(2.0),
            range: f32::INFINITY,
        },
        PunctualLight::Disc { direction: Vec3::X, irradiance: Color::splat(0.5), radius: 0.1 },
        PunctualLight::Spot {
            position: Vec3::ZERO,
            direction: Vec3::Z,
            intensity: Color::splat(9.0),
            range: f32::INFINITY,
            inner: 0.1,
            outer: 0.4,
        },
    ];
    let bounds = Aabb { min: Vec3::splat(-1.0), max: Vec3::splat(3.0) };
    let environment = Some(EnvironmentMap::constant(Color::splat(0.1)));
    (
        Lights::build(
            &geometry,
            vec![emitter(0, false), emitter(1, true)],
            punctual,
            environment,
            bounds,
        ),
        bounds,
    )
}

#[test]
fn the_flux_of_all_paths_is_the_power_of_all_lights() {
    let (lights, bounds) = lights();
    let sampler = EmissionSampler::new(&lights, bounds);
    let mut rng = Rng::new(1);
    let count = 200_000;
    let mut sum = Color::ZERO;
    for _ in 0..count {
        if let Some(e) = sampler.sample(rng.next_f32(), rng.next_2d(), rng.next_2d()) {
            sum += e.emitted * e.measure / count as f32;
        }
    }
    // The spread of one path's flux is below twice the mean: 2 % is beyond 4 standard errors.
    assert!(
        (sum / lights.power() - Color::ONE).abs().max_element() < 0.02,
        "{sum} {}",
        lights.power()
    );
}

#[test]
fn densities_are_those_of_the_samples() {
    let (lights, bounds) = lights();
    let sampler = EmissionSampler::new(&lights, bounds);
    let mut rng = Rng::new(2);
    let mut kinds = [0; 3];
    for _ in 0..20_000 {
        let Some(e) = sampler.sample(rng.next_f32(), rng.next_2d(), rng.next_2d()) else {
            continue;
        };
        let end = sampler.end_density(&e.end, e.direction);
        let ray = sampler.ray_density(&e.end, e.direction);
        assert!(
            (end / e.end_density - 1.0).abs() < 1e-3 && (ray / e.ray_density - 1.0).abs() < 1e-3,
            "{e:?} {end} {ray}"
        );
        let cos = if e.end.normal == Vec3::ZERO { 1.0 } else { e.end.normal.dot(e.direction) };
        assert!((e.measure * end * ray / cos - 1.0).abs() < 2e-3, "{e:?}");
        kinds[match e.end.source {
            LightSource::Triangle { .. } => 0,
            LightSource::Environment => 1,
            LightSource::Punctual(_) => 2,
        }] += 1;
    }
    assert!(kinds.iter().all(|k| *k > 500), "{kinds:?}");
}

#[test]
fn punctual_lights_are_chosen_as_their_probability_says() {
    let (lights, _) = lights();
    let mut rng = Rng::new(3);
    for _ in 0..5000 {
        let p = Vec3::new(rng.next_f32(), rng.next_f32(), rng.next_f32()) * 3.0;
        let n = (rng.next_f32() < 0.5).then_some(Vec3::Y);
        if let Some(s) = lights.sample(p, n, rng.next_f32(), rng.next_2d())
            && let LightSource::Punctual(index) = s.source
        {
            let pdf = lights.pdf_punctual(p, n, index);
            assert!((pdf / s.pdf - 1.0).abs() < 1e-4, "{s:?} {pdf}");
        }
    }
    assert_eq!(lights.pdf_punctual(Vec3::ZERO, None, 99), 0.0);
}
