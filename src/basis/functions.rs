//! What every basis offers, and the numbering of its functions.

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
/// The function is taken to be constant along rays from the origin, `B(v) = B(v/|v|)`; the
/// derivatives are those with respect to v at the unit vector w. For the direction `w = (y - x)/r`
/// from a moving point x to a fixed y, `∇_x B = -gradient/r` and `Hess_x B = hessian/r²`.
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

    /// All functions at eight unit directions; the first [`Basis::count`] elements of `out` are
    /// written.
    fn values(&self, w: &[Vec3; LANES], out: &mut [Lane]);

    /// All functions at one unit direction with their first derivatives, and with the second ones
    /// if `hessians` is set. Double precision: second derivatives of high bands cancel.
    fn jets(&self, w: DVec3, hessians: bool, out: &mut [Jet]);
}

/// The zonal factors T_lm, 0 ≤ m ≤ l, at the angle with the cosine `z`, in the order of
/// [`triangle`]; `out` is overwritten.
pub fn zonal_factors(basis: &dyn Basis, z: &[f32; LANES], out: &mut Vec<Lane>) {
    // What the functions are at azimuth 0.
    let mut values = vec![Lane::default(); basis.count()];
    basis.values(&z.map(|z| Vec3::new((1.0 - z * z).max(0.0).sqrt(), 0.0, z)), &mut values);
    out.clear();
    for l in 0..basis.order() {
        out.extend((0..=l).map(|m| values[index(l, m as i32)]));
    }
}

/// Index of (l, m), 0 ≤ m ≤ l, among the functions without those of negative m.
#[inline]
pub fn triangle(l: usize, m: usize) -> usize {
    l * (l + 1) / 2 + m
}

/// Index of function (l, m).
#[inline]
pub fn index(l: usize, m: i32) -> usize {
    ((l * l + l) as i32 + m) as usize
}
