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
    corners: &[Vec3], p: DVec3, n: DVec3, out: &mut [DVec3; MAX_CORNERS + 1],
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
