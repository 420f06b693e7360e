//! The irradiance of polygons in closed form.

use lumicache::light::polygon_irradiance;
use lumicache::math::Vec3;
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
    let corners = [Vec3::new(-0.5, -0.4, 1.0), Vec3::new(-0.3, 0.7, 1.2), Vec3::new(0.6, 0.5, 1.5)];
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
