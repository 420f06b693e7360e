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
    for focus in FOCI {
        let sampler = EmissionSampler::new(&lights, bounds).aimed_at(focus);
        assert_power(&lights, &sampler);
    }
}

/// None, and one that lies in part outside the scene.
const FOCI: [Option<Focus>; 2] =
    [None, Some(Focus { center: Vec3::new(-0.5, 1.0, 2.0), radius: 1.0 })];

fn assert_power(lights: &Lights, sampler: &EmissionSampler) {
    let mut rng = Rng::new(1);
    let count = 400_000;
    let mut sum = Color::ZERO;
    for _ in 0..count {
        if let Some(e) = sampler.sample(rng.next_f32(), rng.next_2d(), rng.next_2d()) {
            sum += e.emitted * e.measure / count as f32;
        }
    }
    // The spread of one path's flux is below four times the mean, that of paths beside the focus
    // being large: 3 % is beyond 4 standard errors.
    assert!(
        (sum / lights.power() - Color::ONE).abs().max_element() < 0.03,
        "{sum} {}",
        lights.power()
    );
}

#[test]
fn densities_are_those_of_the_samples() {
    let (lights, bounds) = lights();
    for focus in FOCI {
        assert_densities(&EmissionSampler::new(&lights, bounds).aimed_at(focus));
    }
}

fn assert_densities(sampler: &EmissionSampler) {
    let mut rng = Rng::new(2);
    let mut kinds = [0; 3];
    for _ in 0..20_000 {
        let Some(e) = sampler.sample(rng.next_f32(), rng.next_2d(), rng.next_2d()) else {
            continue;
        };
        let end = sampler.end_density(&e.end, e.direction);
        let ray = sampler.ray_density(&e.end, e.direction, e.origin);
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
fn paths_from_infinity_cross_the_scene_and_most_of_them_its_focus() {
    // A ground of 100 km around a room.
    let bounds = Aabb { min: Vec3::new(-1e5, -1.0, -1e5), max: Vec3::new(1e5, 3.0, 1e5) };
    let sky = Some(EnvironmentMap::constant(Color::ONE));
    let lights = Lights::build(&Geometry::default(), vec![], vec![], sky, bounds);
    let focus = Focus { center: Vec3::new(300.0, 1.0, -200.0), radius: 2.0 };
    let sampler = EmissionSampler::new(&lights, bounds).aimed_at(Some(focus));
    let (mut rng, mut near) = (Rng::new(4), 0);
    for _ in 0..10_000 {
        let e = sampler.sample(rng.next_f32(), rng.next_2d(), rng.next_2d()).unwrap();
        let offset = e.origin - focus.center;
        let aside = offset - e.direction * offset.dot(e.direction);
        near += u32::from(aside.length() < focus.radius);
        // It starts outside, beside where it enters, so that rounding does not shift it.
        let inside = e.origin.cmpgt(bounds.min).all() && e.origin.cmplt(bounds.max).all();
        assert!(!inside, "{e:?}");
    }
    assert!((7800..8200).contains(&near), "{near}");
}

#[test]
fn a_ground_plane_does_not_decide_between_lamps_and_sky() {
    let choice = |ground: f32| {
        let mut rng = Rng::new(5);
        let mut positions: Vec<Vec3> = (0..40)
            .flat_map(|_| {
                let at = 2.0 * Vec3::new(rng.next_f32(), rng.next_f32(), rng.next_f32()) - 1.0;
                [at, at + 0.1 * Vec3::X, at + 0.1 * Vec3::Y]
            })
            .collect();
        let corner = |x: f32, z: f32| Vec3::new(x * ground, -1.0, z * ground);
        positions.extend([corner(-1.0, -1.0), corner(-1.0, 1.0), corner(1.0, 1.0)]);
        positions.extend([corner(1.0, 1.0), corner(1.0, -1.0), corner(-1.0, -1.0)]);
        let triangles = positions.len() as u32 / 3;
        let indices: Vec<_> = (0..triangles).map(|k| [3 * k, 3 * k + 1, 3 * k + 2]).collect();
        let mesh = TriangleMesh {
            indices: indices.into(),
            positions: positions.into(),
            ..TriangleMesh::default()
        };
        let geometry = Geometry {
            meshes: vec![Arc::new(mesh)],
            instances: vec![Instance { mesh: 0, to_world: Affine3A::IDENTITY }],
        };
        let lamp = PunctualLight::Point {
            position: Vec3::ZERO,
            intensity: Color::splat(2.0),
            range: f32::INFINITY,
        };
        let sky = Some(EnvironmentMap::constant(Color::ONE));
        let bounds = geometry.bounds();
        let lights = Lights::build(&geometry, vec![], vec![lamp], sky, bounds);
        lights.pdf_punctual(Vec3::splat(0.5), None, 0)
    };
    let [small, large] = [1.0, 1e5].map(choice);
    assert!((0.25..0.75).contains(&small), "{small}");
    assert!((large / small - 1.0).abs() < 0.2, "{small} {large}");
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
