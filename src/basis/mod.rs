//! Orthonormal bases for functions of direction: real spherical harmonics on the sphere, hemispherical harmonics on the hemisphere.
//!
//! A function of *order* n has the bands l = 0 .. n-1, n² coefficients; function (l, m), -l ≤ m ≤ l, has the index `l² + l + m`. Every basis function is a zonal part
//! times a trigonometric one,
//!
//! ```text
//! B_lm(θ, φ) = T_l|m|(θ) · { cos mφ  for m ≥ 0;  sin |m|φ  for m < 0 }
//! ```
//!
//! without the Condon-Shortley sign (-1)^m. z is the pole: for the hemisphere, the surface normal.

mod hsh;
mod quadrature;
mod rotation;
mod sh;
mod tilt;

pub use hsh::Hsh;
pub use quadrature::gauss_legendre;
pub use rotation::{ShRotation, Turn, rotate_z};
pub use sh::Sh;
pub use tilt::Tilt;

use crate::math::{DVec3, Vec3};
use glam::DMat3;

/// Directions that [`Basis::values`] takes at once.
pub const LANES: usize = 8;

/// One number for each of [`LANES`] directions.
pub type Lane = [f32; LANES];

/// The highest order that the bases accept.
pub const MAX_ORDER: usize = 32;

/// A basis function at a direction with its derivatives as a function on the sphere of directions.
///
/// The function is taken to be constant along rays from the origin, `B(v) = B(v/|v|)`; the derivatives are those with respect to v at the unit vector w. For the direction
/// `w = (y - x)/r` from a moving point x to a fixed y, `∇_x B = -gradient/r` and `Hess_x B = hessian/r²`.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Jet {
    /// B(w).
    pub value: f64,
    /// The gradient, tangential to the sphere at w.
    pub gradient: DVec3,
    /// The matrix of second derivatives; zero where it was not asked for.
    pub hessian: DMat3,
}

/// Orthonormal functions of direction, up to some order.
pub trait Basis: Send + Sync {
    /// Number of bands.
    fn order(&self) -> usize;

    /// Number of functions, the square of the order.
    fn count(&self) -> usize {
        self.order() * self.order()
    }

    /// All functions at eight unit directions; the first [`Basis::count`] elements of `out` are written.
    fn values(&self, w: &[Vec3; LANES], out: &mut [Lane]);

    /// All functions at one unit direction with their first derivatives, and with the second ones if `hessians` is set. Double precision: second derivatives of high bands cancel.
    fn jets(&self, w: DVec3, hessians: bool, out: &mut [Jet]);
}

/// Index of function (l, m).
#[inline]
pub fn index(l: usize, m: i32) -> usize {
    ((l * l + l) as i32 + m) as usize
}

/// The coefficients of cos θ in hemispherical harmonics, `cos θ = a H_00 + b H_10` exactly: with the coefficients λ of incident radiance, irradiance is `a λ_00 + b λ_10`.
pub const HSH_COSINE: [f32; 2] = [1.253_314_1, 0.723_601_25];
