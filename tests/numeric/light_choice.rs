//! Which lights are chosen: by what they may give, all that can give anything, and better than by
//! power alone.

use crate::support::lights::*;
use crate::support::statistics::*;
use lumicache::light::{Emitter, EnvironmentMap, LightSample, LightSource, Lights, PunctualLight};
use lumicache::math::{Vec2, Vec3};

/// The probability that a choice falls on each triangle, from the densities towards their centres.
fn selection(
    lights: &Lights, p: Vec3, n: Option<Vec3>, triangles: &[[Vec3; 3]], single: &[Lights],
) -> f64 {
    (0..triangles.len())
        .map(|i| {
            let [a, b, c] = triangles[i];
            let to = (a + b + c) / 3.0 - p;
            let (wi, distance) = (to.normalize(), to.length());
            let own = single[i].pdf_triangle(p, None, 0, 0, wi, distance);
            // Towards a centre below the horizon the density is 0; a normal that sees it has no
            // part in the choice without `n`.
            if own > 0.0 {
                f64::from(lights.pdf_triangle(p, n, 0, i as u32, wi, distance) / own)
            } else {
                0.0
            }
        })
        .sum()
}

#[test]
fn probabilities_of_all_lights_sum_to_one() {
    let mut rng = Rng(7);
    for count in [1, 2, 16, 300] {
        let triangles = random_triangles(&mut rng, count, 0.2);
        let lights = build(&triangles, true, vec![], None);
        let single: Vec<_> = triangles.iter().map(|t| build(&[*t], true, vec![], None)).collect();
        for _ in 0..50 {
            let sum = selection(&lights, rng.cube() * 3.0, None, &triangles, &single);
            assert!((sum - 1.0).abs() < 1e-4, "{count} lights: {sum}");
        }
    }
}

#[test]
fn every_light_that_reaches_a_surface_can_be_chosen() {
    let mut rng = Rng(8);
    for double_sided in [false, true] {
        let triangles = random_triangles(&mut rng, 400, 0.2);
        let lights = build(&triangles, double_sided, vec![], None);
        let mut reached = 0;
        for _ in 0..100 {
            let (p, n) = (rng.cube() * 3.0, rng.direction());
            for (i, corners) in triangles.iter().enumerate() {
                let u = rng.vec2();
                let (u, v) = if u.x + u.y > 1.0 { (1.0 - u.x, 1.0 - u.y) } else { (u.x, u.y) };
                let to = corners[0] * (1.0 - u - v) + corners[1] * u + corners[2] * v - p;
                let faces = (corners[1] - corners[0]).cross(corners[2] - corners[0]).dot(to) < 0.0;
                let lit = (double_sided || faces) && n.dot(to) > 1e-4;
                let pdf = lights.pdf_triangle(p, Some(n), 0, i as u32, to.normalize(), to.length());
                assert!(
                    pdf.is_finite() && (pdf > 0.0 || !lit),
                    "triangle {i} reaches {p}, {n} with density {pdf}"
                );
                reached += u32::from(lit);
            }
        }
        assert!(reached > 5000);
    }
}

#[test]
fn halves_of_a_lamp_are_chosen_by_their_irradiance() {
    let [a, b, c, d] =
        [(-0.35, -0.3), (0.35, -0.3), (0.35, 0.3), (-0.35, 0.3)].map(|(x, z)| Vec3::new(x, 2.0, z));
    let triangles = [[a, b, c], [a, c, d]];
    let geometry = geometry(&triangles);
    let lights = Lights::build(
        &geometry,
        vec![emitter(0, Vec3::ONE, true), emitter(1, Vec3::ONE, true)],
        vec![],
        None,
        geometry.bounds(),
    );
    let mut rng = Rng(9);
    for _ in 0..300 {
        let p = Vec3::new(2.0 * rng.next() - 1.0, 1.6 * rng.next(), 2.0 * rng.next() - 1.0);
        let [first, second] = [0, 1].map(|i| lights.emitter(0, i).unwrap().irradiance(p, Vec3::Y));
        let chosen = (0..1000).filter(|i| {
            let s = lights
                .sample(p, Some(Vec3::Y), (*i as f32 + 0.5) / 1000.0, Vec2::splat(0.5))
                .unwrap();
            matches!(s.source, LightSource::Triangle { triangle: 0, .. })
        });
        let (share, expected) = (chosen.count() as f32 / 1000.0, first / (first + second));
        assert!((share - expected).abs() < 0.05, "{share} instead of {expected} at {p}");
    }
}

#[test]
fn useless_lights_are_never_chosen() {
    let good = [Vec3::new(0.0, 0.0, 2.0), Vec3::new(0.0, 1.0, 2.0), Vec3::new(1.0, 0.0, 2.0)];
    let flat = [Vec3::Z, Vec3::Z + Vec3::X, Vec3::Z + 2.0 * Vec3::X];
    let geometry = geometry(&[flat, good, [Vec3::Z; 3], good, good]);
    let radiance = [Vec3::ONE, Vec3::ONE, Vec3::ONE, Vec3::ZERO, Vec3::NAN];
    let mut emitters: Vec<_> =
        radiance.iter().enumerate().map(|(i, &l)| emitter(i, l, true)).collect();
    emitters.push(Emitter { instance: 9, ..emitters[0] });
    emitters.push(Emitter { triangle: 99, ..emitters[0] });
    let dark =
        PunctualLight::Point { position: Vec3::ONE, intensity: Vec3::ZERO, range: f32::INFINITY };
    let broken = EnvironmentMap { width: 3, ..EnvironmentMap::constant(Vec3::ONE) };
    let lights =
        Lights::build(&geometry, emitters, vec![dark.clone()], Some(broken), geometry.bounds());
    let mut rng = Rng(23);
    let mut found = 0;
    for _ in 0..1000 {
        if let Some(s) = lights.sample(rng.cube(), None, rng.next(), rng.vec2()) {
            assert!(matches!(s.source, LightSource::Triangle { triangle: 1, .. }), "{s:?}");
            assert!(s.pdf.is_finite() && s.pdf > 0.0);
            found += 1;
        }
    }
    assert_eq!((found, lights.emitter_count()), (1000, 1));
    assert_eq!(lights.pdf_triangle(Vec3::ZERO, None, 0, 0, Vec3::Z, 1.0), 0.0);
    assert_eq!(lights.pdf_triangle(Vec3::ZERO, None, 7, 7, Vec3::Z, 1.0), 0.0);
    let none = Lights::build(
        &geometry,
        vec![],
        vec![dark],
        Some(EnvironmentMap::constant(Vec3::ZERO)),
        geometry.bounds(),
    );
    assert!(
        none.is_empty()
            && none.power() == Vec3::ZERO
            && none.sample(Vec3::ZERO, None, 0.3, Vec2::ZERO).is_none()
    );
}

#[test]
fn light_below_the_horizon_takes_no_samples() {
    let above = [Vec3::new(-1.0, 2.0, 0.0), Vec3::new(1.0, 2.0, 0.0), Vec3::new(0.0, 2.0, 1.0)];
    let below = above.map(|v| v - 4.0 * Vec3::Y);
    let lights = build(&[above, below], true, vec![], None);
    let mut rng = Rng(29);
    for _ in 0..200 {
        let s = lights.sample(Vec3::ZERO, Some(Vec3::Y), rng.next(), rng.vec2()).unwrap();
        assert!(matches!(s.source, LightSource::Triangle { triangle: 0, .. }));
    }
}

/// A hall of 5000 small ceiling lamps of two triangles, 100 m by 50 m and 4 m high.
fn hall() -> Vec<[Vec3; 3]> {
    let lamp = |i: u32| {
        let corner = Vec3::new((i % 100) as f32, 4.0, (i / 100) as f32);
        let (x, z) = (0.3 * Vec3::X, 0.3 * Vec3::Z);
        [[corner, corner + x, corner + x + z], [corner, corner + x + z, corner + z]]
    };
    (0..5000).flat_map(lamp).collect()
}

#[test]
fn tree_beats_choice_by_power() {
    let triangles = hall();
    let geometry = geometry(&triangles);
    let mut rng = Rng(31);
    let emitters: Vec<_> = (0..triangles.len())
        .map(|i| emitter(i, Vec3::splat(1.0 + 4.0 * (i as f32 * 0.37).sin().abs()), false))
        .collect();
    let power: Vec<f64> = emitters
        .iter()
        .scan(0.0, |sum, e| {
            *sum += f64::from(e.radiance.x);
            Some(*sum)
        })
        .collect();
    let single: Vec<_> = emitters
        .iter()
        .map(|e| Lights::build(&geometry, vec![*e], vec![], None, geometry.bounds()))
        .step_by(10_000)
        .collect();
    drop(single);
    let lights = Lights::build(&geometry, emitters.clone(), vec![], None, geometry.bounds());
    assert_eq!(lights.emitter_count(), 10_000);
    let (mut by_tree, mut by_power, mut stratified) = (0.0, 0.0, 0.0);
    for _ in 0..20 {
        let p = Vec3::new(100.0 * rng.next(), 3.0 * rng.next(), 50.0 * rng.next());
        let n = if rng.next() < 0.5 { Vec3::Y } else { rng.direction() };
        let expected = f64::from(lights.unoccluded_irradiance(p, n).x);
        let (mut tree, mut flat, mut many) = (Mean::new(), Mean::new(), Mean::new());
        for seed in 0..2000 {
            let value = |s: &LightSample| f64::from(s.radiance.x * s.wi.dot(n).max(0.0) / s.pdf);
            tree.add(lights.sample(p, Some(n), rng.next(), rng.vec2()).as_ref().map_or(0.0, value));
            let target = f64::from(rng.next()) * power[power.len() - 1];
            let index = power.partition_point(|&s| s <= target);
            let chosen = lights.emitter(0, index as u32).unwrap();
            let probability = f64::from(emitters[index].radiance.x) / power[power.len() - 1];
            flat.add(f64::from(emitters[index].radiance.x * chosen.irradiance(p, n)) / probability);
            if seed < 200 {
                let mut sum = 0.0;
                lights.stratified(p, Some(n), 16, seed, &mut |s| sum += value(&s));
                many.add(sum / 16.0);
            }
        }
        assert_mean(&tree, expected, "light tree");
        by_tree += tree.variance() / (expected * expected);
        by_power += flat.variance() / (expected * expected);
        stratified += many.variance() * 16.0 / (expected * expected);
    }
    eprintln!(
        "variance relative to the light tree's: by power {:.0}, 16 stratified samples {:.2}",
        by_power / by_tree,
        stratified / by_tree
    );
    assert!(by_power > 10.0 * by_tree && stratified < 0.3 * by_tree);
}
