//! Hemispherical harmonics.

use super::functions::{Basis, Jet, LANES, Lane};
use super::sh::{Sh, outer};
use crate::math::{DVec3, Vec3};
use glam::DMat3;

/// Hemispherical harmonics [Gautron04], orthonormal on the upper hemisphere:
///
/// ```text
/// H_lm(θ, φ) ∝ P_l|m|(2 cos θ - 1) · { cos mφ; sin |m|φ }
/// ```
///
/// They are spherical harmonics of the direction ψ(w) with the same azimuth whose cosine is `2 cos
/// θ - 1`. The map ψ takes the hemisphere to the sphere and doubles every area, so `H_lm(w) = √2
/// Y_lm(ψ(w))`. At the horizon functions with odd m behave like √cos θ: their derivatives grow
/// without bound there.
pub struct Hsh(Sh);

impl Hsh {
    /// The harmonics of bands below `order`, which is in 1 ..= [`super::MAX_ORDER`].
    pub fn new(order: usize) -> Self {
        Self(Sh::scaled(order, 2f64.sqrt()))
    }
}

/// The coefficients of cos θ in hemispherical harmonics, `cos θ = a H_00 + b H_10` exactly: with
/// the coefficients λ of incident radiance, irradiance is `a λ_00 + b λ_10`.
pub const HSH_COSINE: [f32; 2] = [1.253_314_1, 0.723_601_2];

/// Least cos θ at which derivatives are taken.
const MIN_COS: f64 = 1e-6;

impl Basis for Hsh {
    fn order(&self) -> usize {
        self.0.order()
    }

    /// Directions below the horizon are taken to lie on it.
    fn values(&self, w: &[Vec3; LANES], out: &mut [Lane]) {
        let stretched = w.map(|w| {
            let z = w.z.max(0.0);
            let stretch = 2.0 * (z / (1.0 + z)).sqrt();
            Vec3::new(w.x * stretch, w.y * stretch, 2.0 * z - 1.0)
        });
        self.0.values(&stretched, out);
    }

    /// By the chain rule through ψ extended to `Ψ(v) = (g x, g y, 2z - r)`, `g = 2 sqrt(z/(r+z))`,
    /// r = |v|, for which |Ψ(v)| = |v|.
    fn jets(&self, w: DVec3, hessians: bool, out: &mut [Jet]) {
        let z = w.z.max(MIN_COS);
        let w = DVec3::new(w.x, w.y, z);
        let s = 1.0 + z;
        let g = 2.0 * (z / s).sqrt();
        // Derivatives of g(z, r) at r = 1.
        let (gz, gr) = (1.0 / (z * s.powi(3)).sqrt(), -(z / s.powi(3)).sqrt());
        let grad_g = DVec3::Z * gz + w * gr;
        let rows = [DVec3::X * g + grad_g * w.x, DVec3::Y * g + grad_g * w.y, 2.0 * DVec3::Z - w];
        // The matrix whose columns are the gradients of Ψ's components: the transposed Jacobian.
        let transposed = DMat3::from_cols(rows[0], rows[1], rows[2]);
        let unit = DVec3::new(w.x * g, w.y * g, 2.0 * z - 1.0);

        self.0.jets(unit, hessians, out);
        let mut bends = [DMat3::ZERO; 3];
        if hessians {
            let gzz = -0.5 * (1.0 + 3.0 * z / s) / (z * s).powf(1.5);
            let gzr = (1.0 - 1.5 / s) / (z * s.powi(3)).sqrt();
            let grr = 1.5 * z.sqrt() * s.powf(-2.5);
            let hess_r = DMat3::IDENTITY - outer(w, w);
            let hess_g = outer(DVec3::Z, DVec3::Z) * gzz
                + (outer(DVec3::Z, w) + outer(w, DVec3::Z)) * gzr
                + outer(w, w) * grr
                + hess_r * gr;
            let mixed =
                |e: DVec3, component: f64| outer(e, grad_g) + outer(grad_g, e) + hess_g * component;
            bends = [mixed(DVec3::X, w.x), mixed(DVec3::Y, w.y), -hess_r];
        }
        for jet in &mut out[..self.count()] {
            if hessians {
                let bent = bends[0] * jet.gradient.x
                    + bends[1] * jet.gradient.y
                    + bends[2] * jet.gradient.z;
                jet.hessian = transposed * jet.hessian * transposed.transpose() + bent;
            }
            jet.gradient = transposed * jet.gradient;
        }
    }
}
