//! Irradiance from a polygon of constant radiance in closed form.

use crate::math::{DVec3, Vec3};

/// Most corners of a polygon that [`polygon_irradiance`] takes.
const MAX_CORNERS: usize = 8;

/// Irradiance at `p` on a surface with unit normal `n` from a planar convex polygon that emits unit
/// radiance from both faces, without occlusion: Lambert's formula over the part of the polygon
/// above the horizon,
///
/// ```text
/// E = ½ |Σ Θᵢ n·(rᵢ × rᵢ₊₁) / |rᵢ × rᵢ₊₁||          [Arvo94]
/// ```
///
/// where rᵢ leads from `p` to corner i and Θᵢ is the angle between rᵢ and rᵢ₊₁. From 0 to π. Takes
/// up to 8 corners and ignores others. In double precision, because the terms of a small or distant
/// polygon cancel.
pub fn polygon_irradiance(corners: &[Vec3], p: Vec3, n: Vec3) -> f32 {
    let (p, n) = (p.as_dvec3(), n.as_dvec3());
    let mut clipped = [DVec3::ZERO; MAX_CORNERS + 1];
    let count = clip_to_horizon(corners, p, n, &mut clipped);
    if count < 3 {
        return 0.0;
    }
    let mut sum = 0.0;
    for i in 0..count {
        let (r, next) = (clipped[i], clipped[if i + 1 == count { 0 } else { i + 1 }]);
        let cross = r.cross(next);
        let sine = cross.length();
        if sine > 0.0 {
            sum += sine.atan2(r.dot(next)) * n.dot(cross) / sine;
        }
    }
    (0.5 * sum.abs()) as f32
}

/// The corners relative to `p` of the part of a polygon above the plane through `p` with normal `n`
/// [Sutherland74, pp. 32-42]. Returns their number.
fn clip_to_horizon(
    corners: &[Vec3],
    p: DVec3,
    n: DVec3,
    out: &mut [DVec3; MAX_CORNERS + 1],
) -> usize {
    let corners = &corners[..corners.len().min(MAX_CORNERS)];
    let Some(last) = corners.last() else { return 0 };
    let mut count = 0;
    let mut previous = last.as_dvec3() - p;
    let mut previous_height = n.dot(previous);
    for corner in corners {
        let current = corner.as_dvec3() - p;
        let height = n.dot(current);
        if (height > 0.0) != (previous_height > 0.0) && count <= MAX_CORNERS {
            out[count] =
                previous + (current - previous) * (previous_height / (previous_height - height));
            count += 1;
        }
        if height > 0.0 && count <= MAX_CORNERS {
            out[count] = current;
            count += 1;
        }
        (previous, previous_height) = (current, height);
    }
    count
}

#[cfg(test)]
mod tests {
    use super::*;
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
}
