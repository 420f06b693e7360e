//! The GGX microfacet distribution with height-correlated Smith shadowing, Fresnel reflectance, and
//! the warps they need.
//!
//! Everything is in the local shading frame, z the normal. α is the isotropic GGX roughness, the
//! square of glTF's perceptual one.

use crate::math::{INV_PI, PI, Vec2, Vec3};

/// Below this α a lobe is treated as a perfect mirror: single precision no longer resolves it, and
/// no pixel does.
pub(super) const DELTA_ALPHA: f32 = 1e-3;

/// `v` mirrored at the plane whose normal is the unit vector `axis`: `2 (v·axis) axis - v`.
#[inline]
pub(super) fn reflect(v: Vec3, axis: Vec3) -> Vec3 {
    2.0 * v.dot(axis) * axis - v
}

/// `v` on the other side of the surface.
#[inline]
pub(super) fn flip(v: Vec3) -> Vec3 {
    Vec3::new(v.x, v.y, -v.z)
}

/// Density of microfacet normals per unit area of surface and steradian [Walter07, Eq. 33].
///
/// ```text
/// D(h) = 1 / (π α² ((h_x² + h_y²)/α² + h_z²)²)
/// ```
///
/// In this form no digits cancel near the normal.
#[inline]
pub(super) fn ggx_d(h: Vec3, alpha: f32) -> f32 {
    if h.z <= 0.0 {
        return 0.0;
    }
    let a2 = alpha * alpha;
    let e = (h.x * h.x + h.y * h.y) / a2 + h.z * h.z;
    INV_PI / (a2 * e * e)
}

/// `sqrt(α² + (1 - α²) cos²θ) = cosθ (1 + 2Λ)`, the root in Smith's functions [Heitz14, Eq. 72].
#[inline]
fn smith_root(cos: f32, alpha: f32) -> f32 {
    let a2 = alpha * alpha;
    (a2 + (1.0 - a2) * cos * cos).sqrt()
}

/// `G1(ω)/cosθ`, finite at the horizon.
#[inline]
pub(super) fn g1_over_cos(cos: f32, alpha: f32) -> f32 {
    2.0 / (cos + smith_root(cos, alpha)).max(1e-12)
}

/// `G2 / (4 cosθ_o cosθ_i)` with the height-correlated `G2 = 1/(1 + Λ_o + Λ_i)` [Heitz14, Eq. 99];
/// both cosines positive.
#[inline]
pub(super) fn visibility(cos_o: f32, cos_i: f32, alpha: f32) -> f32 {
    0.5 / (cos_o * smith_root(cos_i, alpha) + cos_i * smith_root(cos_o, alpha)).max(1e-12)
}

/// Density per steradian of the microfacet normal `h` that [`sample_visible_normal`] draws: `G1(wo)
/// (wo·h) D(h) / wo_z` [Heitz18].
#[inline]
pub(super) fn visible_normal_pdf(wo: Vec3, h: Vec3, alpha: f32) -> f32 {
    g1_over_cos(wo.z, alpha) * wo.dot(h).max(0.0) * ggx_d(h, alpha)
}

/// Draws a microfacet normal in proportion to its area as seen from `wo` (`wo_z ≥ 0`), by the
/// spherical cap of [Dupuy23].
#[inline]
pub(super) fn sample_visible_normal(wo: Vec3, alpha: f32, u: Vec2) -> Vec3 {
    let stretched = Vec3::new(alpha * wo.x, alpha * wo.y, wo.z).normalize_or(Vec3::Z);
    let z = (1.0 - u.y) * (1.0 + stretched.z) - stretched.z;
    let r = (1.0 - z * z).max(0.0).sqrt();
    let (sin, cos) = (2.0 * PI * u.x).sin_cos();
    let h = Vec3::new(r * cos, r * sin, z) + stretched;
    Vec3::new(alpha * h.x, alpha * h.y, h.z.max(0.0)).normalize_or(Vec3::Z)
}

/// The grazing term of Schlick's Fresnel formula, `(1 - cosθ)⁵` [Schlick94, Eq. 15].
#[inline]
pub(super) fn schlick_weight(cos: f32) -> f32 {
    let m = (1.0 - cos).clamp(0.0, 1.0);
    let m2 = m * m;
    m2 * m2 * m
}

/// Unpolarised reflectance of a smooth boundary between dielectrics, and the cosine of the
/// refracted direction.
///
/// * `cos`: cosine of the angle of incidence, in [0, 1].
/// * `eta`: index of refraction on the far side over that on the near side.
///
/// Returns `(1, 0)` on total internal reflection. [Walter07, Eq. 22], from the sum of the two
/// polarisations.
#[inline]
pub(super) fn fresnel_dielectric(cos: f32, eta: f32) -> (f32, f32) {
    let sin2_t = (1.0 - cos * cos).max(0.0) / (eta * eta);
    if sin2_t >= 1.0 {
        return (1.0, 0.0);
    }
    let cos_t = (1.0 - sin2_t).sqrt();
    let parallel = (eta * cos - cos_t) / (eta * cos + cos_t);
    let perpendicular = (cos - eta * cos_t) / (cos + eta * cos_t);
    (0.5 * (parallel * parallel + perpendicular * perpendicular), cos_t)
}

/// The direction into which a boundary with unit normal `h` (`wo·h > 0`) refracts light, given the
/// cosine that [`fresnel_dielectric`] found.
#[inline]
pub(super) fn refract(wo: Vec3, h: Vec3, eta: f32, cos_t: f32) -> Vec3 {
    (wo.dot(h) / eta - cos_t) * h - wo / eta
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn refraction_obeys_snell_and_reflectance_its_known_values() {
        for eta in [1.5, 1.0 / 1.5, 1.33] {
            for cos in [1.0, 0.9, 0.8] {
                let wo = Vec3::new((1.0f32 - cos * cos).sqrt(), 0.0, cos);
                let (_, cos_t) = fresnel_dielectric(cos, eta);
                let wi = refract(wo, Vec3::Z, eta, cos_t);
                assert!((wi.length() - 1.0).abs() < 1e-5 && wi.z < 0.0);
                assert!(
                    (wo.x + eta * wi.x).abs() < 1e-6,
                    "sines in the ratio of the indices, opposite sides"
                );
            }
        }
        assert!((fresnel_dielectric(1.0, 1.5).0 - 0.04).abs() < 1e-6);
        assert!((fresnel_dielectric(1.0, 1.0 / 1.5).0 - 0.04).abs() < 1e-6);
        // Glass at 60 degrees: perpendicular 0.17658, parallel 0.00179, mean 0.08919.
        assert!((fresnel_dielectric(0.5, 1.5).0 - 0.08919).abs() < 2e-5);
        assert_eq!(fresnel_dielectric(0.0, 1.5).0, 1.0);
        // Inside glass beyond the critical angle of 41.8 degrees.
        assert_eq!(fresnel_dielectric(0.7, 1.0 / 1.5), (1.0, 0.0));
    }

    #[test]
    fn normals_cover_the_surface_and_visible_ones_the_view() {
        // ∫ D(h) h_z = 1 and ∫ D_visible = 1, by midpoints in (θ, φ) warped towards the normal.
        for alpha in [0.002, 0.05, 0.3, 1.0f32] {
            for wo in [Vec3::Z, Vec3::new(0.8, 0.0, 0.6), Vec3::new(0.9999, 0.0, 0.014_142)] {
                let (mut area, mut visible) = (0.0f64, 0.0f64);
                let (nt, np) = (400, 200);
                for i in 0..nt {
                    // tan θ = α t/(1-t) spreads the lobe evenly.
                    let t = (i as f32 + 0.5) / nt as f32;
                    let tan = alpha * t / (1.0 - t);
                    let cos = 1.0 / (1.0 + tan * tan).sqrt();
                    let dtheta = alpha / ((1.0 - t) * (1.0 - t)) * cos * cos / nt as f32;
                    for j in 0..np {
                        let phi = 2.0 * PI * (j as f32 + 0.5) / np as f32;
                        let h = Vec3::new(tan * cos * phi.cos(), tan * cos * phi.sin(), cos);
                        let dw = f64::from(tan * cos * dtheta * 2.0 * PI / np as f32);
                        area += f64::from(ggx_d(h, alpha) * h.z) * dw;
                        visible += f64::from(visible_normal_pdf(wo, h, alpha)) * dw;
                    }
                }
                assert!(
                    (area - 1.0).abs() < 2e-3 && (visible - 1.0).abs() < 3e-3,
                    "α {alpha}, wo {wo}: {area}, {visible}"
                );
            }
        }
    }
}
