//! Daylight: the skies light what they should, are sampled as they say, and the sun is where and
//! what it should be.

use crate::support::pictures::{build, render, settings};
use crate::support::rooms::{diffuse, plane};
use crate::support::statistics::{Rng, assert_chi2};
use lumicache::geometry::{Aabb, Geometry};
use lumicache::import::{self, LightUnits};
use lumicache::light::{LightSource, Lights, Sky, SkyKind, SunKind};
use lumicache::math::{Color, PI, Vec3, luminance};
use lumicache::render::IntegratorKind;

/// The lights of a sky in an empty scene.
fn lights(sky: &Sky) -> Lights {
    let (map, sun) = import::sky(sky, LightUnits::Photometric, 0.0, 1.0).unwrap();
    let bounds = Aabb { min: Vec3::splat(-1.0), max: Vec3::splat(1.0) };
    Lights::build(&Geometry::default(), vec![], sun.into_iter().collect(), Some(map), bounds)
}

/// Illuminance on a surface with normal `n` and its standard error, by light sampling.
fn illuminance(lights: &Lights, n: Vec3) -> (f64, f64) {
    let (count, mut sum, mut squares, mut rng) = (40_000, 0.0, 0.0, Rng(7));
    for _ in 0..count {
        let sample = lights.sample(Vec3::ZERO, Some(n), rng.next(), rng.vec2());
        let value = sample.map_or(0.0, |s| f64::from(luminance(s.radiance) * n.dot(s.wi) / s.pdf));
        (sum, squares) = (sum + value, squares + value * value);
    }
    let mean = sum / f64::from(count);
    (mean, ((squares / f64::from(count) - mean * mean).max(0.0) / f64::from(count)).sqrt())
}

/// Within five standard errors and the table's own error.
fn assert_illuminance(lights: &Lights, n: Vec3, expected: f64) {
    let (mean, error) = illuminance(lights, n);
    assert!(
        (mean - expected).abs() < 5.0 * error + 1e-3 * expected,
        "{mean} ± {error} lx, not {expected}"
    );
}

#[test]
fn the_overcast_sky_lights_floors_and_walls() {
    let sky = Sky { elevation: 30.0, ground: Color::splat(0.3), ..Sky::new(SkyKind::Overcast) };
    let lights = lights(&sky);
    let (zenith, horizontal) = (sky.zenith_luminance(), 300.0 + 21_000.0 * 0.5);
    let pi = std::f64::consts::PI;
    assert!((horizontal - 7.0 / 9.0 * pi * zenith).abs() < 1e-6 * horizontal);
    assert_illuminance(&lights, Vec3::Y, horizontal);
    // A wall: (π/6 + 4/9) L_z from the sky, half of the ground's radiosity; a ceiling: all of that.
    assert_illuminance(&lights, Vec3::X, (pi / 6.0 + 4.0 / 9.0) * zenith + 0.5 * 0.3 * horizontal);
    assert_illuminance(&lights, Vec3::NEG_Y, 0.3 * horizontal);
}

#[test]
fn clear_and_general_skies_have_the_illuminance_they_should() {
    for kind in
        [SkyKind::General(3), SkyKind::General(8), SkyKind::General(12), SkyKind::General(15)]
    {
        for elevation in [10.0, 60.0] {
            let sky = Sky {
                elevation,
                sun: SunKind::None,
                illuminance: Some(20_000.0),
                ..Sky::new(kind)
            };
            assert_illuminance(&lights(&sky), Vec3::Y, 20_000.0);
        }
    }
}

#[test]
fn the_sun_adds_its_own_light() {
    for sun in [SunKind::Disc, SunKind::Direction] {
        let sky = Sky {
            azimuth: 90.0,
            elevation: 30.0,
            sun,
            ground: Color::ZERO,
            ..Sky::parse("clear,illuminance=1").unwrap()
        };
        let (lights, across) = (lights(&sky), sky.sun_illuminance());
        assert!((50_000.0..90_000.0).contains(&across), "{across}");
        assert_illuminance(&lights, Vec3::Y, 0.5 * across + 1.0);
        // The sun stands in the east: a wall that faces it, and one that faces away.
        assert_illuminance(&lights, Vec3::X, 0.75f64.sqrt() * across);
        assert!(illuminance(&lights, Vec3::NEG_X).0 < 3.0);
        // A disc is seen, with the radiance of its illuminance over its solid angle; a direction is
        // not.
        let radiance = f64::from(lights.environment(sky.sun_direction()).x);
        let expected = across / (std::f64::consts::PI * 0.265f64.to_radians().sin().powi(2));
        match sun {
            SunKind::Disc => {
                assert!((radiance / expected - 1.0).abs() < 1e-4, "{radiance} {expected}")
            }
            _ => assert!(radiance < 100.0, "{radiance}"),
        }
        let beside = |degrees: f32| {
            let across = sky.sun_direction().cross(Vec3::Y).normalize();
            f64::from(lights.environment(sky.sun_direction() + across * degrees.to_radians()).x)
        };
        assert!(sun != SunKind::Disc || (beside(0.26) > 1e6 && beside(0.27) < 100.0));
    }
}

#[test]
fn samples_of_sky_and_sun_follow_their_density() {
    let sky = Sky::parse("clear,azimuth=200,elevation=35,sun-illuminance=12000").unwrap();
    let lights = lights(&sky);
    let (rows, columns, fine, count) = (24, 36, 24, 300_000);
    let inside = |d: Vec3| (d - sky.sun_direction()).length() < 0.265f32.to_radians();
    for n in [None, Some(Vec3::Y), Some(Vec3::new(0.48, 0.6, 0.64))] {
        let mut rng = Rng(5);
        // The last cell is the sun.
        let mut observed = vec![0.0; rows * columns + 1];
        let mut lost = 0.0;
        for _ in 0..count {
            let Some(s) = lights.sample(Vec3::ZERO, n, rng.next(), rng.vec2()) else {
                lost += 1.0;
                continue;
            };
            let pdf = lights.pdf_environment(Vec3::ZERO, n, s.wi);
            assert!(
                s.source == LightSource::Environment && (pdf / s.pdf - 1.0).abs() < 1e-3,
                "{s:?} {pdf}"
            );
            let v = s.wi.y.clamp(-1.0, 1.0).acos() / PI * rows as f32;
            let h = s.wi.z.atan2(s.wi.x).rem_euclid(2.0 * PI) / (2.0 * PI) * columns as f32;
            let cell = (v as usize).min(rows - 1) * columns + (h as usize).min(columns - 1);
            observed[if inside(s.wi) { rows * columns } else { cell }] += 1.0;
        }
        let mut expected = vec![0.0; rows * columns + 1];
        for i in 0..rows * fine {
            let theta = PI * (i as f32 + 0.5) / (rows * fine) as f32;
            for j in 0..columns * fine {
                let phi = 2.0 * PI * (j as f32 + 0.5) / (columns * fine) as f32;
                let d = Vec3::new(theta.sin() * phi.cos(), theta.cos(), theta.sin() * phi.sin());
                let angle = 2.0 * PI * PI * theta.sin() / (rows * columns * fine * fine) as f32;
                if !inside(d) {
                    expected[i / fine * columns + j / fine] +=
                        count as f64 * f64::from(angle * lights.pdf_environment(Vec3::ZERO, n, d));
                }
            }
        }
        let angle = PI * 0.265f32.to_radians().powi(2);
        expected[rows * columns] = count as f64
            * f64::from(angle * lights.pdf_environment(Vec3::ZERO, n, sky.sun_direction()));
        assert!(observed[rows * columns] > 0.05 * count as f64);
        if n.is_some() {
            // What falls below the horizon is lost: it is a cell of its own.
            observed.push(lost);
            expected.push(count as f64 - expected.iter().sum::<f64>());
        }
        assert_chi2(&observed, &expected, &format!("{n:?}"));
    }
}

#[test]
fn a_plane_under_an_overcast_sky_has_its_closed_form() {
    let mut data = plane(diffuse());
    let sky = Sky::parse("overcast,illuminance=12000").unwrap();
    data.environment = Some(import::sky(&sky, LightUnits::Radiometric, 0.0, 0.5).unwrap().0);
    let scene = build(data);
    for integrator in [IntegratorKind::Path, IntegratorKind::Cache] {
        let frame = render(&scene, &settings(&scene, integrator, [24, 16], 64));
        let pixels = frame.film.radiance();
        let mean = pixels.iter().sum::<Color>() / pixels.len() as f32;
        let expected = Color::new(0.2, 0.5, 0.7) * (0.5 * 12_000.0 / 683.0 / PI);
        // 24 576 samples with a spread below 40 % of the mean: 0.3 % is beyond 10 standard errors.
        assert!(
            (mean / expected - Color::ONE).abs().max_element() < 3e-3,
            "{integrator:?}: {mean}, not {expected}"
        );
    }
}

#[test]
fn a_rotation_turns_the_sun_as_it_turns_a_map() {
    let sky = Sky { azimuth: 90.0, elevation: 0.1, ..Sky::new(SkyKind::General(12)) };
    // From +X counter-clockwise as seen from above: to -Z.
    let (map, sun) = import::sky(&sky, LightUnits::Photometric, 90.0, 1.0).unwrap();
    let bounds = Aabb { min: Vec3::splat(-1.0), max: Vec3::splat(1.0) };
    let lights =
        Lights::build(&Geometry::default(), vec![], sun.into_iter().collect(), Some(map), bounds);
    let bright = |d: Vec3| lights.environment((d + Vec3::Y * 0.002).normalize()).x;
    assert!(
        bright(Vec3::NEG_Z) > 100.0 * bright(Vec3::X),
        "{} {}",
        bright(Vec3::NEG_Z),
        bright(Vec3::X)
    );
    for (rotation, scale) in [(f32::NAN, 1.0), (0.0, -1.0), (0.0, f32::INFINITY)] {
        assert!(import::sky(&sky, LightUnits::Photometric, rotation, scale).is_err());
    }
}
