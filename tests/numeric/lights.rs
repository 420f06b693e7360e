//! Light sampling: densities agree with samples, estimates with closed forms, and the tree beats
//! choosing by power.

use crate::support::lights::*;
use crate::support::statistics::*;
use lumicache::light::{EnvironmentMap, LightSample, LightSource, Lights, PunctualLight};
use lumicache::math::{Affine3A, PI, Vec3};

#[test]
fn triangle_sampling_is_uniform_in_solid_angle() {
    let shapes = [
        [Vec3::new(-0.5, -0.4, 1.0), Vec3::new(-0.3, 0.7, 1.2), Vec3::new(0.6, 0.5, 1.5)],
        [Vec3::new(-9.0, -7.0, 0.3), Vec3::new(-3.0, 11.0, 0.2), Vec3::new(10.0, -1.0, 0.25)],
        [Vec3::new(5.0, 0.0, 0.4), Vec3::new(5.0, 0.3, 0.5), Vec3::new(-1.0, 0.2, 0.45)],
        [Vec3::new(0.1, 0.1, 9.0), Vec3::new(0.2, 0.1, 9.0), Vec3::new(0.2, 0.3, 9.1)],
        [Vec3::new(0.001, 0.1, 9.0), Vec3::new(0.01, 0.1, 9.0), Vec3::new(0.02, 0.13, 9.1)],
    ];
    let mut rng = Rng(1);
    for (index, shape) in shapes.iter().enumerate() {
        let lights = build(&[*shape], true, vec![], None);
        // Cells of equal weights of the vertices; each must get samples in proportion to its own
        // solid angle.
        const CELLS: usize = 8;
        let mut observed = vec![0.0; CELLS * CELLS];
        let mut expected = vec![0.0; CELLS * CELLS];
        let count = 40_000;
        for _ in 0..count {
            let s = lights.sample(Vec3::ZERO, None, rng.next(), rng.vec2()).unwrap();
            let LightSource::Triangle { u, v, .. } = s.source else { panic!("a triangle") };
            let place = shape[0] * (1.0 - u - v) + shape[1] * u + shape[2] * v;
            assert!((place - s.wi * s.distance).length() < 1e-4 * s.distance, "shape {index}");
            let cell = |x: f32| ((x * CELLS as f32) as usize).min(CELLS - 1);
            observed[cell(u) * CELLS + cell(v)] += 1.0;
        }
        let at = |u: f64, v: f64| {
            let [a, b, c] = shape.map(|x| x.as_dvec3());
            a * (1.0 - u - v) + b * u + c * v
        };
        let fine = 64;
        let step = 1.0 / (CELLS * fine) as f64;
        let cross = (shape[1] - shape[0]).as_dvec3().cross((shape[2] - shape[0]).as_dvec3());
        let mut total = 0.0;
        for i in 0..CELLS * fine {
            for j in 0..CELLS * fine - i {
                // The small square, or its lower triangle on the diagonal.
                let (offset, size) =
                    if i + j + 1 == CELLS * fine { (1.0 / 3.0, 0.5) } else { (0.5, 1.0) };
                let r = at((i as f64 + offset) * step, (j as f64 + offset) * step);
                let angle = size * cross.dot(r).abs() / r.length().powi(3);
                expected[i / fine * CELLS + j / fine] += angle;
                total += angle;
            }
        }
        expected.iter_mut().for_each(|e| *e *= f64::from(count) / total);
        assert_chi2(&observed, &expected, &format!("shape {index} of {total:.2e} sr"));
    }
}

#[test]
fn environment_sampling_follows_its_density() {
    for height in [4, 48, 160] {
        let map = uneven_map(height);
        let lights = build(&[], true, vec![], Some(map.clone()));
        let mut rng = Rng(u64::from(height));
        // Bands of equal area in world space, away from the map's own axes.
        let (rings, sectors) = (24, 48);
        let cell = |d: Vec3| {
            let ring = ((1.0 - d.z) * 0.5 * rings as f32).min(rings as f32 - 1.0) as usize;
            let sector = ((d.y.atan2(d.x) / PI + 1.0) * 0.5 * sectors as f32)
                .min(sectors as f32 - 1.0) as usize;
            ring * sectors + sector
        };
        let mut observed = vec![0.0; rings * sectors];
        let count = 60_000;
        for _ in 0..count {
            let s = lights.sample(Vec3::ZERO, None, rng.next(), rng.vec2()).unwrap();
            observed[cell(s.wi)] += 1.0;
            assert!((s.radiance - map.radiance(s.wi)).length() <= 1e-4 * s.radiance.length());
        }
        let mut expected = vec![0.0; rings * sectors];
        let fine = 40;
        let mut total = 0.0;
        for i in 0..rings * fine {
            for j in 0..sectors * fine {
                let z = 1.0 - 2.0 * (i as f32 + 0.5) / (rings * fine) as f32;
                let phi = (2.0 * (j as f32 + 0.5) / (sectors * fine) as f32 - 1.0) * PI;
                let r = (1.0 - z * z).sqrt();
                let d = Vec3::new(r * phi.cos(), r * phi.sin(), z);
                let pdf = lights.pdf_environment(Vec3::ZERO, None, d);
                assert!(
                    pdf > 0.0 || map.radiance(d).max_element() <= 0.0,
                    "light that is never sampled, towards {d}"
                );
                let mass = f64::from(pdf) * 4.0 * std::f64::consts::PI
                    / (rings * sectors * fine * fine) as f64;
                expected[i / fine * sectors + j / fine] += mass * f64::from(count);
                total += mass;
            }
        }
        assert!((total - 1.0).abs() < 2e-3, "density integrates to {total}");
        // The spot is as small as a pixel: where a cell of the comparison is not integrated finely,
        // its error is far below the noise of the count.
        assert_chi2(&observed, &expected, &format!("map of {height} rows"));
    }
}

#[test]
fn sample_and_pdf_agree() {
    let mut rng = Rng(5);
    let triangles = random_triangles(&mut rng, 200, 0.3);
    let sun =
        PunctualLight::Directional { direction: Vec3::new(0.0, -1.0, 0.0), irradiance: Vec3::ONE };
    let lamp = PunctualLight::Point {
        position: Vec3::new(1.0, 0.0, 0.0),
        intensity: Vec3::ONE,
        range: f32::INFINITY,
    };
    for count in [1, 2, 12, 200] {
        for environment in [None, Some(EnvironmentMap::constant(Vec3::ONE)), Some(uneven_map(16))] {
            let lights = build(
                &triangles[..count],
                count == 12,
                vec![sun.clone(), lamp.clone()],
                environment,
            );
            for _ in 0..3000 {
                let p = rng.cube() * 3.0;
                let n = (rng.next() < 0.7).then(|| rng.direction());
                let Some(s) = lights.sample(p, n, rng.next(), rng.vec2()) else { continue };
                let pdf = pdf_of(&lights, p, n, &s);
                assert!((pdf / s.pdf - 1.0).abs() < 1e-4, "{pdf} instead of {} from {s:?}", s.pdf);
                assert!(s.wi.is_normalized() && n.is_none_or(|n| n.dot(s.wi) > 0.0));
            }
        }
    }
}

#[test]
fn irradiance_of_triangles_is_the_closed_form() {
    let mut rng = Rng(11);
    for (count, size) in [(1, 1.0), (2, 3.0), (16, 0.5), (100, 0.3)] {
        let triangles = random_triangles(&mut rng, count, size);
        for double_sided in [false, true] {
            let lights = build(&triangles, double_sided, vec![], None);
            for with_normal in [false, true] {
                let (p, n) = (rng.cube() * 2.5, rng.direction());
                let expected = f64::from(lights.unoccluded_irradiance(p, n).x);
                let (mut mean, mut stratified) = (Mean::new(), Mean::new());
                for i in 0..20_000 {
                    let sample = lights.sample(p, with_normal.then_some(n), rng.next(), rng.vec2());
                    let value =
                        |s: &LightSample| f64::from(s.radiance.x * s.wi.dot(n).max(0.0) / s.pdf);
                    mean.add(sample.as_ref().map_or(0.0, value));
                    if i % 10 == 0 {
                        let mut sum = 0.0;
                        lights.stratified(p, with_normal.then_some(n), 7, i, &mut |s| {
                            sum += value(&s)
                        });
                        stratified.add(sum / 7.0);
                    }
                }
                let what =
                    format!("{count} triangles, double sided {double_sided}, normal {with_normal}");
                assert_mean(&mean, expected, &what);
                assert_mean(&stratified, expected, &format!("{what}, stratified"));
            }
        }
    }
}

#[test]
fn constant_environment_gives_pi_times_its_radiance() {
    let lights = build(&[], true, vec![], Some(EnvironmentMap::constant(Vec3::new(0.2, 0.5, 1.0))));
    assert!(
        !lights.is_empty()
            && (lights.environment(Vec3::X) - Vec3::new(0.2, 0.5, 1.0)).length() < 1e-6
    );
    let mut rng = Rng(13);
    let n = rng.direction();
    for _ in 0..100 {
        // In proportion to the cosine, every single sample is exact.
        let s = lights.sample(Vec3::ZERO, Some(n), rng.next(), rng.vec2()).unwrap();
        let e = s.radiance * (s.wi.dot(n) / s.pdf);
        assert!((e / (PI * Vec3::new(0.2, 0.5, 1.0)) - 1.0).abs().max_element() < 1e-3, "{e}");
    }
    let mut mean = Mean::new();
    for _ in 0..20_000 {
        let s = lights.sample(Vec3::ZERO, None, rng.next(), rng.vec2()).unwrap();
        mean.add(f64::from(s.radiance.y * s.wi.dot(n).max(0.0) / s.pdf));
    }
    assert_mean(&mean, 0.5 * std::f64::consts::PI, "constant environment without a normal");
}

#[test]
fn mixed_lights_add_up() {
    let mut rng = Rng(17);
    let triangles = random_triangles(&mut rng, 3, 0.8);
    let sun = PunctualLight::Directional {
        direction: Vec3::new(0.6, -0.8, 0.0),
        irradiance: Vec3::splat(2.0),
    };
    let lamp = PunctualLight::Point {
        position: Vec3::new(1.0, 2.5, 0.5),
        intensity: Vec3::splat(3.0),
        range: 20.0,
    };
    let lights =
        build(&triangles, true, vec![sun, lamp], Some(EnvironmentMap::constant(Vec3::splat(0.3))));
    let p = Vec3::new(0.3, -0.2, 0.1);
    let to_lamp = Vec3::new(1.0, 2.5, 0.5) - p;
    for n in [Vec3::Y, Vec3::new(-0.6, 0.8, 0.0), Vec3::NEG_Y] {
        let lamp =
            3.0 * (1.0 - (to_lamp.length() / 20.0).powi(4)) * n.dot(to_lamp.normalize()).max(0.0)
                / to_lamp.length_squared();
        let sun = 2.0 * n.dot(Vec3::new(-0.6, 0.8, 0.0)).max(0.0);
        let expected = f64::from(lights.unoccluded_irradiance(p, n).x + 0.3 * PI + lamp + sun);
        for receiver in [None, Some(n)] {
            let mut mean = Mean::new();
            for seed in 0..4000 {
                let mut sum = 0.0;
                lights.stratified(p, receiver, 5, seed, &mut |s| {
                    sum += f64::from(s.radiance.x * s.wi.dot(n).max(0.0) / s.pdf)
                });
                mean.add(sum / 5.0);
            }
            assert_mean(&mean, expected, "environment, sun, lamp and triangles");
        }
    }
}

#[test]
fn map_is_seen_where_it_should_be() {
    // Middle column towards +X, +Z a quarter of the width to its right, +Y at the top.
    let mut map = EnvironmentMap {
        pixels: vec![Vec3::ZERO; 8 * 9],
        width: 8,
        height: 9,
        ..EnvironmentMap::constant(Vec3::ZERO)
    };
    map.pixels[4 * 8 + 4] = Vec3::X;
    map.pixels[4 * 8 + 6] = Vec3::Y;
    map.pixels[..8].fill(Vec3::Z);
    let at = |column: f32| {
        let phi = (column + 0.5 - 4.0) / 8.0 * 2.0 * PI;
        map.radiance(Vec3::new(phi.cos(), 0.0, phi.sin()))
    };
    assert!((at(4.0) - Vec3::X).length() < 1e-5 && (at(6.0) - Vec3::Y).length() < 1e-5);
    assert!(
        (map.radiance(Vec3::X) - 0.5 * Vec3::X).length() < 1e-5
            && (map.radiance(Vec3::Z) - 0.5 * Vec3::Y).length() < 1e-5
    );
    assert!(
        (map.radiance(Vec3::Y) - Vec3::Z).length() < 1e-5 && map.radiance(-Vec3::Y).length() < 1e-5
    );
}

#[test]
fn mirrored_instance_emits_from_its_front_and_names_its_own_vertices() {
    let triangle = [Vec3::new(0.0, 0.0, 2.0), Vec3::new(0.0, 1.0, 2.0), Vec3::new(1.0, 0.0, 2.0)];
    let mut geometry = geometry(&[triangle]);
    geometry.instances[0].to_world = Affine3A::from_scale(Vec3::new(-1.0, 1.0, 1.0));
    let lights = Lights::build(
        &geometry,
        vec![emitter(0, Vec3::ONE, false)],
        vec![],
        None,
        geometry.bounds(),
    );
    let mut rng = Rng(19);
    // The front of the mesh's triangle faces -Z, and mirroring along X keeps it so.
    assert!(lights.sample(Vec3::new(0.0, 0.0, 4.0), None, 0.5, rng.vec2()).is_none());
    for _ in 0..100 {
        let s = lights.sample(Vec3::ZERO, None, rng.next(), rng.vec2()).unwrap();
        let LightSource::Triangle { u, v, .. } = s.source else { panic!("a triangle") };
        let object = triangle[0] * (1.0 - u - v) + triangle[1] * u + triangle[2] * v;
        assert!((object * Vec3::new(-1.0, 1.0, 1.0) - s.wi * s.distance).length() < 1e-5);
    }
}

#[test]
fn no_ray_that_meets_an_emitter_is_said_to_meet_none() {
    let mut rng = Rng(8);
    let mut triangles = random_triangles(&mut rng, 40, 0.2);
    // One in a plane of the axes, which has no thickness.
    triangles.push([
        Vec3::new(-0.3, 1.5, -0.3),
        Vec3::new(0.3, 1.5, -0.3),
        Vec3::new(0.0, 1.5, 0.3),
    ]);
    let lights = build(&triangles, true, Vec::new(), None);
    let point = |rng: &mut Rng| Vec3::from_array(std::array::from_fn(|_| 6.0 * rng.next() - 3.0));
    let mut spared = 0;
    for k in 0..4000 {
        let origin = point(&mut rng);
        let [a, b, c] = triangles[k % triangles.len()];
        let (u, v) = (rng.next(), rng.next());
        let target = a + u.sqrt() * ((1.0 - v) * (b - a) + v * (c - a));
        assert!(lights.may_shine_along(origin, (target - origin).normalize()), "{origin} {target}");
        // Straight up, with zeros in the direction.
        assert!(lights.may_shine_along(target - Vec3::Y, Vec3::Y));
        spared += usize::from(!lights.may_shine_along(origin, point(&mut rng).normalize()));
    }
    assert!(spared > 400, "only {spared} rays are spared");
    assert!(!lights.may_shine_along(Vec3::splat(9.0), Vec3::ONE.normalize()));
    let sky = build(&[], true, Vec::new(), Some(uneven_map(4)));
    assert!(sky.may_shine_along(Vec3::ZERO, Vec3::Y));
}

#[test]
fn equal_input_gives_equal_bits() {
    let mut rng = Rng(37);
    let triangles = random_triangles(&mut rng, 500, 0.3);
    let (a, b) = (
        build(&triangles, false, vec![], Some(uneven_map(16))),
        build(&triangles, false, vec![], Some(uneven_map(16))),
    );
    for seed in 0..200 {
        let (p, n) = (rng.cube(), rng.direction());
        let collect = |lights: &Lights| {
            let mut samples = vec![];
            lights.stratified(p, Some(n), 9, seed, &mut |s| samples.push(s));
            samples
        };
        assert_eq!(collect(&a), collect(&b));
    }
}
