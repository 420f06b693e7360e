//! Directional albedo of single-scattering GGX surfaces: how much of the light the microfacet model
//! loses to multiple scattering, and how much of it a layer leaves to the ones below.
//!
//! The tables are integrated once per process, at first use, in a fixed order: same bits on every
//! run.

use super::microfacet::{
    fresnel_dielectric, g1_over_cos, reflect, refract, sample_visible_normal, schlick_weight,
    visibility,
};
use crate::math::{Vec2, Vec3, cell};
use std::sync::LazyLock;

/// Nodes of the reflection table along the view angle and along the roughness.
const REFLECTION: (usize, usize) = (48, 32);
/// Cells of its quadrature, in azimuth and steepness.
const REFLECTION_CELLS: (usize, usize) = (12, 24);
/// Nodes of the glass table along the view angle, the roughness and the index.
const GLASS: (usize, usize, usize) = (24, 12, 12);
/// Cells of its quadrature.
const GLASS_CELLS: (usize, usize) = (8, 12);
/// Largest `(η-1)/(η+1)` of the glass table, an index of 3; beyond it the value of the border is
/// used.
const GLASS_S: f32 = 0.5;

static REFLECTION_TABLE: LazyLock<Vec<Vec2>> = LazyLock::new(|| {
    let mut table = Vec::with_capacity(REFLECTION.0 * REFLECTION.1);
    for j in 0..REFLECTION.1 {
        let alpha = node_alpha(j, REFLECTION.1);
        for i in 0..REFLECTION.0 {
            table.push(integrate_reflection(
                node_cos(i, REFLECTION.0, alpha),
                alpha,
                REFLECTION_CELLS,
            ));
        }
    }
    table
});

static GLASS_TABLE: LazyLock<[Vec<f32>; 2]> = LazyLock::new(|| {
    [false, true].map(|inside| {
        let mut table = Vec::with_capacity(GLASS.0 * GLASS.1 * GLASS.2);
        for k in 0..GLASS.2 {
            let s = (GLASS_S * (k as f32 / (GLASS.2 - 1) as f32).powi(2)).max(1e-3);
            let ior = (1.0 + s) / (1.0 - s);
            let eta = if inside { 1.0 / ior } else { ior };
            for j in 0..GLASS.1 {
                let alpha = node_alpha(j, GLASS.1);
                for i in 0..GLASS.0 {
                    table.push(integrate_glass(
                        node_cos(i, GLASS.0, alpha),
                        alpha,
                        eta,
                        GLASS_CELLS,
                    ));
                }
            }
        }
        table
    })
});

/// Directional albedo of a GGX reflector with height-correlated Smith shadowing and no multiple
/// scattering:
///
/// ```text
/// ∫ f cosθ_i dω_i = F0·a + F90·b   for   F = F0 + (F90 - F0)(1 - cosθ_h)⁵
/// ```
///
/// Returns `(a, b)`; `a + b` is the albedo E(cosθ_o, α) of a perfect reflector. `cos` in [0, 1],
/// `alpha` in (0, 1].
#[inline]
pub(super) fn reflection_albedo(cos: f32, alpha: f32) -> (f32, f32) {
    let table = &*REFLECTION_TABLE;
    let (i, x) = cell(cos_coordinate(cos, alpha), REFLECTION.0);
    let (j, y) = cell(alpha.sqrt(), REFLECTION.1);
    let row = |j: usize| table[j * REFLECTION.0 + i].lerp(table[j * REFLECTION.0 + i + 1], x);
    let v = row(j).lerp(row(j + 1), y);
    (v.x, v.y)
}

/// Share of the light that a rough boundary between clear dielectrics reflects or transmits after
/// one scattering, the rest being lost in the model. `eta` as in [`fresnel_dielectric`].
pub(super) fn glass_albedo(cos: f32, alpha: f32, eta: f32) -> f32 {
    let table = &GLASS_TABLE[usize::from(eta < 1.0)];
    let ior = eta.max(1.0 / eta);
    let (i, x) = cell(cos_coordinate(cos, alpha), GLASS.0);
    let (j, y) = cell(alpha.sqrt(), GLASS.1);
    let (k, z) = cell(((ior - 1.0) / ((ior + 1.0) * GLASS_S)).sqrt(), GLASS.2);
    let at = |k: usize, j: usize| {
        let base = (k * GLASS.1 + j) * GLASS.0 + i;
        table[base] + (table[base + 1] - table[base]) * x
    };
    let plane = |k: usize| at(k, j) + (at(k, j + 1) - at(k, j)) * y;
    plane(k) + (plane(k + 1) - plane(k)) * z
}

/// The view angle's coordinate in [0, 1]. Shadowing depends on `cosθ/α` near the horizon and
/// Fresnel reflectance on `cosθ`, so half of the nodes are even in a function of the one and half
/// in the other.
#[inline]
fn cos_coordinate(cos: f32, alpha: f32) -> f32 {
    (0.5 * (cos * (1.0 + alpha) / (cos + alpha) + cos)).sqrt()
}

/// The cosine at a node: the inverse of [`cos_coordinate`], the root of `c² + (1 + 2α - 2t) c -
/// 2αt`.
fn node_cos(i: usize, count: usize, alpha: f32) -> f32 {
    let (t, alpha) = ((i as f64 / (count - 1) as f64).powi(2), f64::from(alpha));
    let b = 0.5 + alpha - t;
    let root = (b * b + 2.0 * alpha * t).sqrt();
    let cos = if b > 0.0 { 2.0 * alpha * t / (b + root) } else { root - b };
    (cos as f32).clamp(1e-5, 1.0)
}

/// The roughness α at a node: nodes are even in its square root.
fn node_alpha(j: usize, count: usize) -> f32 {
    let r = j as f32 / (count - 1) as f32;
    (r * r).max(1e-5)
}

/// The mean of `value` over visible normals `h` at `cos`: midpoints of `nx` by `ny` cells of the
/// half square that [`sample_visible_normal`] maps to `h_y > 0` (the rest is symmetric), narrower
/// towards the steep normals where shadowing sets in.
fn mean_over_visible_normals(
    cos: f32, alpha: f32, (nx, ny): (usize, usize), value: impl Fn(Vec3, Vec3) -> Vec2,
) -> Vec2 {
    let wo = Vec3::new((1.0 - cos * cos).sqrt(), 0.0, cos);
    let mut sum = Vec2::ZERO;
    for j in 0..ny {
        let t = 1.0 - (j as f32 + 0.5) / ny as f32;
        let density = 2.0 * t / (nx * ny) as f32;
        for i in 0..nx {
            let u = Vec2::new(0.5 * (i as f32 + 0.5) / nx as f32, 1.0 - t * t);
            sum += density * value(wo, sample_visible_normal(wo, alpha, u));
        }
    }
    sum
}

/// `G2/G1`, what arrives of the light that a visible normal sends towards `cos_i`.
fn escaping(cos_o: f32, cos_i: f32, alpha: f32) -> f32 {
    if cos_i > 0.0 {
        4.0 * visibility(cos_o, cos_i, alpha) * cos_i / g1_over_cos(cos_o, alpha)
    } else {
        0.0
    }
}

/// `(a, b)` of [`reflection_albedo`].
fn integrate_reflection(cos: f32, alpha: f32, resolution: (usize, usize)) -> Vec2 {
    mean_over_visible_normals(cos, alpha, resolution, |wo, h| {
        let grazing = schlick_weight(wo.dot(h));
        escaping(wo.z, reflect(wo, h).z, alpha) * Vec2::new(1.0 - grazing, grazing)
    })
}

/// [`glass_albedo`].
fn integrate_glass(cos: f32, alpha: f32, eta: f32, resolution: (usize, usize)) -> f32 {
    let sum = mean_over_visible_normals(cos, alpha, resolution, |wo, h| {
        let (fresnel, cos_t) = fresnel_dielectric(wo.dot(h).clamp(0.0, 1.0), eta);
        let reflected = fresnel * escaping(wo.z, reflect(wo, h).z, alpha);
        let transmitted = (1.0 - fresnel) * escaping(wo.z, -refract(wo, h, eta, cos_t).z, alpha);
        Vec2::new(reflected, transmitted)
    });
    sum.x + sum.y
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn interpolated_reflection_matches_fine_quadrature() {
        let mut worst = 0.0f32;
        for a in 0..25 {
            let alpha = (0.032 + (1.0 - 0.032) * (a as f32 + 0.37) / 25.0f32).powi(2);
            for c in 0..60 {
                let cos = ((c as f32 + 0.41) / 60.0f32).powi(2);
                let (x, y) = reflection_albedo(cos, alpha);
                let exact = integrate_reflection(cos, alpha, (64, 192));
                worst = worst.max((x - exact.x).abs()).max((y - exact.y).abs());
            }
        }
        assert!(worst < 8e-3, "largest error {worst}");
    }

    #[test]
    fn interpolated_glass_matches_fine_quadrature() {
        let mut worst = 0.0f32;
        for eta in [1.1, 1.33, 1.5, 2.4, 1.0 / 1.1, 1.0 / 1.33, 1.0 / 1.5, 1.0 / 2.4] {
            for a in 0..12 {
                let alpha = (0.032 + (1.0 - 0.032) * (a as f32 + 0.37) / 12.0f32).powi(2);
                for c in 0..30 {
                    let cos = ((c as f32 + 0.41) / 30.0f32).powi(2);
                    worst = worst.max(
                        (glass_albedo(cos, alpha, eta)
                            - integrate_glass(cos, alpha, eta, (32, 96)))
                        .abs(),
                    );
                }
            }
        }
        assert!(worst < 4e-2, "largest error {worst}");
    }

    #[test]
    fn average_albedo_at_alpha_0_3() {
        // 2 ∫ E cosθ dcosθ: single scattering loses 15 % of the light that a perfect reflector of α
        // = 0.3 receives from a uniform surrounding.
        let n = 2000;
        let average: f32 = (0..n)
            .map(|i| {
                let cos = (i as f32 + 0.5) / n as f32;
                let (a, b) = reflection_albedo(cos, 0.3);
                2.0 * (a + b) * cos / n as f32
            })
            .sum();
        assert!((average - 0.846).abs() < 0.002, "{average}");
    }
}
