//! Polygons, points and spots against closed forms.

use lumicache::light::*;
use lumicache::math::{Color, DVec3, Frame, INV_PI, Vec2, Vec3};
use std::f64::consts::PI;

const SQUARE: [Vec3; 4] = [
    Vec3::new(-1.0, -1.0, 2.0),
    Vec3::new(-1.0, 1.0, 2.0),
    Vec3::new(1.0, 1.0, 2.0),
    Vec3::new(1.0, -1.0, 2.0),
];

#[test]
fn square_above_the_receiver_has_its_known_irradiance() {
    let p = Vec3::new(0.45, 0.30, 0.0);
    let whole = polygon_irradiance(&SQUARE, p, Vec3::Z);
    assert!((f64::from(whole) - 0.692_236_14).abs() < 1e-7);
    let [a, b, c, d] = SQUARE;
    let halves =
        polygon_irradiance(&[a, b, c], p, Vec3::Z) + polygon_irradiance(&[c, a, d], p, Vec3::Z);
    assert!((f64::from(halves) - 0.692_236_14).abs() < 2e-7);
}

#[test]
fn triangle_has_its_known_irradiance() {
    let corners =
        [Vec3::new(-0.5, -0.4, 1.0), Vec3::new(-0.3, 0.7, 1.2), Vec3::new(0.6, 0.5, 1.5)];
    let e = polygon_irradiance(&corners, Vec3::new(0.1, 0.05, 0.0), Vec3::Z);
    assert!((f64::from(e) - 0.284_542_45).abs() < 1e-7);
}

#[test]
fn horizon_cuts_the_polygon() {
    // A wall from far below to far above the horizon, seen square on: above it lies half the
    // irradiance of a horizontal view ...
    let wall = [
        Vec3::new(1.0, -1e4, -1e4),
        Vec3::new(1.0, 1e4, -1e4),
        Vec3::new(1.0, 1e4, 1e4),
        Vec3::new(1.0, -1e4, 1e4),
    ];
    let e = f64::from(polygon_irradiance(&wall, Vec3::ZERO, Vec3::Z));
    assert!((e - 0.5 * PI).abs() < 1e-3, "{e}");
    // ... all of it faces a receiver turned towards the wall, and none a receiver that looks
    // away.
    assert!((f64::from(polygon_irradiance(&wall, Vec3::ZERO, Vec3::X)) - PI).abs() < 1e-3);
    assert_eq!(polygon_irradiance(&wall, Vec3::ZERO, -Vec3::X), 0.0);
    assert_eq!(polygon_irradiance(&SQUARE, Vec3::new(0.0, 0.0, 2.5), Vec3::Z), 0.0);
}

#[test]
fn small_distant_polygon_acts_as_a_point() {
    let s = 1e-3;
    let quad = [
        Vec3::new(3.0, 4.0, 12.0),
        Vec3::new(3.0 + s, 4.0, 12.0),
        Vec3::new(3.0 + s, 4.0 + s, 12.0),
        Vec3::new(3.0, 4.0 + s, 12.0),
    ];
    let expected =
        (quad[1].x - quad[0].x) * (quad[3].y - quad[0].y) * (12.0 / 13.0_f32).powi(2) / 169.0;
    let e = polygon_irradiance(&quad, Vec3::ZERO, Vec3::Z);
    assert!((e / expected - 1.0).abs() < 1e-3, "{e} {expected}");
}

#[test]
fn degenerate_input_gives_zero() {
    assert_eq!(polygon_irradiance(&[], Vec3::ZERO, Vec3::Z), 0.0);
    assert_eq!(polygon_irradiance(&[Vec3::ONE; 3], Vec3::ZERO, Vec3::Z), 0.0);
}

fn spot(cos_inner: f32, cos_outer: f32) -> PunctualLight {
    PunctualLight::Spot {
        position: Vec3::new(0.0, 2.0, 0.0),
        direction: -Vec3::Y,
        intensity: Vec3::splat(8.0),
        range: f32::INFINITY,
        cos_inner,
        cos_outer,
    }
}

#[test]
fn point_light_follows_the_inverse_square_within_its_range() {
    let light = |range| PunctualLight::Point {
        position: Vec3::new(0.0, 2.0, 0.0),
        intensity: Vec3::splat(8.0),
        range,
    };
    let free = light(f32::INFINITY).incidence(Vec3::ZERO).unwrap();
    assert_eq!((free.wi, free.distance, free.irradiance), (Vec3::Y, 2.0, Vec3::splat(2.0)));
    let windowed = light(4.0).incidence(Vec3::ZERO).unwrap();
    assert_eq!(windowed.irradiance, Vec3::splat(2.0 * (1.0 - 1.0 / 16.0)));
    assert!(
        light(2.0).incidence(Vec3::ZERO).is_none()
            && light(0.0).incidence(Vec3::ZERO).is_none()
    );
    assert!(light(f32::INFINITY).incidence(Vec3::new(0.0, 2.0, 0.0)).is_none());
}

#[test]
fn spot_light_ramps_between_its_cones() {
    let light = spot(0.9, 0.7);
    let at = |cos: f32| {
        let p = Vec3::new((1.0 - cos * cos).sqrt(), 2.0 - cos, 0.0);
        light.incidence(p).map_or(0.0, |i| i.irradiance.x / 8.0)
    };
    assert!((at(0.95) - 1.0).abs() < 1e-5 && (at(0.8) - 0.25).abs() < 1e-5 && at(0.69) == 0.0);
}

#[test]
fn spot_light_with_equal_angles_has_a_sharp_edge() {
    let light = spot(0.8, 0.8);
    assert!(light.incidence(Vec3::new(0.1, 0.0, 0.0)).unwrap().irradiance.is_finite());
    assert!(light.incidence(Vec3::new(5.0, 0.0, 0.0)).is_none());
}

#[test]
fn power_of_a_spot_light_is_the_integral_of_its_intensity() {
    let light = spot(0.9, 0.6);
    let steps = 20_000;
    let sum: f32 = (0..steps)
        .map(|i| {
            let cos = 1.0 - 2.0 * (i as f32 + 0.5) / steps as f32;
            let p = Vec3::new((1.0 - cos * cos).sqrt(), 2.0 - cos, 0.0);
            light.incidence(p).map_or(0.0, |i| i.irradiance.x)
        })
        .sum();
    let expected = sum * 4.0 * std::f32::consts::PI / steps as f32;
    assert!((light.power().x / expected - 1.0).abs() < 1e-3);
}
