//! Points of the unit square and warps from it, where needed with their density and inverse.

use crate::math::{INV_PI, Vec2, Vec3};
use std::f32::consts::{FRAC_PI_2, FRAC_PI_4};

/// The unit square to the unit disk, equal areas to equal areas, neighbours to neighbours (Shirley
/// & Chiu 1997 [Shirley97]).
#[inline]
pub fn square_to_disk(u: Vec2) -> Vec2 {
    let (a, b) = (2.0 * u.x - 1.0, 2.0 * u.y - 1.0);
    let (r, phi) = if a == 0.0 && b == 0.0 {
        (0.0, 0.0)
    } else if a.abs() > b.abs() {
        (a, FRAC_PI_4 * (b / a))
    } else {
        (b, FRAC_PI_2 - FRAC_PI_4 * (a / b))
    };
    let (sin, cos) = phi.sin_cos();
    Vec2::new(r * cos, r * sin)
}

/// Inverse of [`square_to_disk`].
pub fn disk_to_square(p: Vec2) -> Vec2 {
    let r = p.length();
    let mut phi = p.y.atan2(p.x);
    if phi < -FRAC_PI_4 {
        phi += 2.0 * std::f32::consts::PI;
    }
    let (a, b) = if phi < FRAC_PI_4 {
        (r, phi * r / FRAC_PI_4)
    } else if phi < 3.0 * FRAC_PI_4 {
        (-(phi - FRAC_PI_2) * r / FRAC_PI_4, r)
    } else if phi < 5.0 * FRAC_PI_4 {
        (-r, (phi - 4.0 * FRAC_PI_4) * -r / FRAC_PI_4)
    } else {
        ((phi - 6.0 * FRAC_PI_4) * r / FRAC_PI_4, -r)
    };
    Vec2::new(0.5 * (a + 1.0), 0.5 * (b + 1.0))
}

/// The unit square to the upper hemisphere with density cos θ/π per steradian.
#[inline]
pub fn square_to_cosine_hemisphere(u: Vec2) -> Vec3 {
    let d = square_to_disk(u);
    d.extend((1.0 - d.length_squared()).max(0.0).sqrt())
}

/// Density of [`square_to_cosine_hemisphere`] per steradian, 0 below the horizon.
#[inline]
pub fn cosine_hemisphere_pdf(w: Vec3) -> f32 {
    w.z.max(0.0) * INV_PI
}

/// Inverse of [`square_to_cosine_hemisphere`].
pub fn cosine_hemisphere_to_square(w: Vec3) -> Vec2 {
    disk_to_square(w.truncate())
}

/// Inverts the distribution function of the density on the unit interval that runs linearly from
/// `a` to `b`.
pub fn sample_linear(u: f32, a: f32, b: f32) -> f32 {
    let x = u * (a + b) / (a + (a * a + u * (b * b - a * a)).max(0.0).sqrt());
    if x.is_finite() { x.clamp(0.0, 1.0) } else { 0.5 }
}

/// The unit square to a triangle, uniformly: the weights of its second and third corner.
#[inline]
pub fn square_to_triangle(u: Vec2) -> [f32; 2] {
    let root = u.x.sqrt();
    [root * (1.0 - u.y), root * u.y]
}

/// Point `k` of `count` that cover the unit square evenly: Fibonacci's lattice.
pub fn lattice_point(k: u32, count: u32) -> Vec2 {
    Vec2::new((k as f32 + 0.5) / count as f32, (k as f32 * 0.618_034).fract())
}
