//! Vectors, colours, frames and the small algebra the metrics need.
//!
//! Vectors and matrices are [`glam`]'s. Single precision everywhere, except where a formula says
//! why not.

pub use glam::{Affine3A, DMat2, DVec2, DVec3, Mat3, Vec2, Vec3, Vec4};

/// A linear Rec. 709 triple: radiance, irradiance, albedo, whatever the name beside it says.
pub type Color = Vec3;

/// 1/π.
pub const INV_PI: f32 = std::f32::consts::FRAC_1_PI;
/// π.
pub const PI: f32 = std::f32::consts::PI;

/// The luminance of a linear Rec. 709 colour, Y of CIE 1931.
#[inline]
pub fn luminance(c: Color) -> f32 {
    0.2126 * c.x + 0.7152 * c.y + 0.0722 * c.z
}

/// A right-handed orthonormal frame: `s × t = n`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Frame {
    /// First tangent.
    pub s: Vec3,
    /// Second tangent.
    pub t: Vec3,
    /// Normal.
    pub n: Vec3,
}

impl Frame {
    /// The frame of the unit normal `n` whose tangents depend on `n` alone, so that all points of a
    /// plane share them.
    ///
    /// Duff et al. 2017 [Duff17, Listing 3], with components of `n` below 1e-4 taken as zero when
    /// the sign is chosen: rounding noise on an axis-aligned wall must not flip its tangents.
    #[inline]
    pub fn from_normal(n: Vec3) -> Self {
        let sign = if n.z < -1e-4 { -1.0 } else { 1.0 };
        let a = -1.0 / (sign + n.z);
        let b = n.x * n.y * a;
        let s = Vec3::new(1.0 + sign * n.x * n.x * a, sign * b, -sign * n.x);
        let t = Vec3::new(b, sign + n.y * n.y * a, -n.y);
        Self { s, t, n }
    }

    /// The frame of the unit normal `n` whose first tangent is `tangent` made orthogonal to it;
    /// [`Frame::from_normal`] where they are within about 0.1° of parallel.
    pub fn from_normal_tangent(n: Vec3, tangent: Vec3) -> Self {
        let across = tangent - n * n.dot(tangent);
        // Also where the tangent is zero or no number.
        let apart = across.length_squared() > 4e-6 * tangent.length_squared();
        if !apart {
            return Self::from_normal(n);
        }
        // Cancellation leaves a little of n in a short difference: once more.
        let s = across.normalize();
        let s = (s - n * n.dot(s)).normalize();
        Self { s, t: n.cross(s), n }
    }

    /// World to local: `(v·s, v·t, v·n)`.
    #[inline]
    pub fn to_local(&self, v: Vec3) -> Vec3 {
        Vec3::new(v.dot(self.s), v.dot(self.t), v.dot(self.n))
    }

    /// Local to world.
    #[inline]
    pub fn to_world(&self, v: Vec3) -> Vec3 {
        self.s * v.x + self.t * v.y + self.n * v.z
    }
}

/// The cell of a grid of `count` nodes over [0, 1] that contains `t`, and the place of `t` in the
/// cell.
#[inline]
pub fn cell(t: f32, count: usize) -> (usize, f32) {
    let x = t.clamp(0.0, 1.0) * (count - 1) as f32;
    let i = (x as usize).min(count - 2);
    (i, x - i as f32)
}
