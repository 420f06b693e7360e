//! Orthonormal bases for functions of direction: real spherical harmonics on the sphere,
//! hemispherical harmonics on the hemisphere.
//!
//! A function of *order* n has the bands l = 0 .. n-1, n² coefficients; function (l, m), -l ≤ m ≤
//! l, has the index `l² + l + m`. Every basis function is a zonal part times a trigonometric one,
//!
//! ```text
//! B_lm(θ, φ) = T_l|m|(θ) · { cos mφ  for m ≥ 0;  sin |m|φ  for m < 0 }
//! ```
//!
//! without the Condon-Shortley sign (-1)^m. z is the pole: for the hemisphere, the surface normal.

mod functions;
mod quadrature;
mod sh;
mod hsh;
mod rotation;
mod tilt;

pub use functions::{Basis, Jet, LANES, Lane, MAX_ORDER, index, triangle, zonal_factors};
pub use hsh::{HSH_COSINE, Hsh};
pub use quadrature::gauss_legendre;
pub use rotation::{ShRotation, Turn, rotate_z};
pub use sh::Sh;
pub use tilt::Tilt;

use serde::{Deserialize, Serialize};

/// Which basis.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum BasisKind {
    /// Hemispherical harmonics, in the local frame.
    Hsh,
    /// Spherical harmonics.
    Sh,
}

impl BasisKind {
    /// The basis with the bands below `order`, which is in 1 ..= [`MAX_ORDER`].
    pub fn basis(self, order: usize) -> Box<dyn Basis> {
        match self {
            Self::Hsh => Box::new(Hsh::new(order)),
            Self::Sh => Box::new(Sh::new(order)),
        }
    }
}
