//! Rays and hits as every tracer takes and gives them: plain data of fixed layout.

use crate::math::Vec3;

/// Largest component of a ray's origin and direction: products of distances and areas must not
/// overflow.
pub const LIMIT: f32 = 1e12;

/// The segment `origin + t * dir`, `tmin < t <= tmax`, in world space. A ray that breaks the rules
/// of its fields, see [`Ray::is_valid`], hits nothing.
#[derive(Clone, Copy, Debug, PartialEq)]
#[repr(C)]
pub struct Ray {
    /// Start of the ray.
    pub origin: Vec3,
    /// Least distance of a hit, in multiples of `dir`'s length; at least 0.
    pub tmin: f32,
    /// Direction of the ray, not zero; need not have unit length.
    pub dir: Vec3,
    /// Greatest distance of a hit, in multiples of `dir`'s length; may be infinite.
    pub tmax: f32,
}

impl Ray {
    /// The ray from `origin` along `dir` to infinity.
    #[inline]
    pub fn new(origin: Vec3, dir: Vec3) -> Self {
        Self { origin, tmin: 0.0, dir, tmax: f32::INFINITY }
    }

    /// True if no number is NaN, no component of origin and direction is beyond [`LIMIT`], and
    /// `0 <= tmin <= tmax`.
    #[inline]
    pub fn is_valid(&self) -> bool {
        let limit = Vec3::splat(LIMIT);
        let in_range = self.origin.abs().cmple(limit) & self.dir.abs().cmple(limit);
        in_range.all() && 0.0 <= self.tmin && self.tmin <= self.tmax
    }

    /// The point at distance `t`.
    #[inline]
    pub fn at(&self, t: f32) -> Vec3 {
        self.origin + t * self.dir
    }
}

/// What a ray hits first.
#[derive(Clone, Copy, Debug, PartialEq)]
#[repr(C)]
pub struct Hit {
    /// Distance in multiples of the direction's length, infinite for a miss.
    pub t: f32,
    /// Barycentric weight of the triangle's second vertex, in the order of the mesh's own indices.
    pub u: f32,
    /// Barycentric weight of the triangle's third vertex, in the order of the mesh's own indices.
    pub v: f32,
    /// Index into the geometry's instances; `u32::MAX` for a miss.
    pub instance: u32,
    /// Index into the triangles of the instance's mesh; `u32::MAX` for a miss.
    pub triangle: u32,
}

impl Hit {
    /// What a ray that hits nothing returns.
    pub const MISS: Self =
        Self { t: f32::INFINITY, u: 0.0, v: 0.0, instance: u32::MAX, triangle: u32::MAX };

    /// True unless the ray missed.
    #[inline]
    pub fn is_hit(&self) -> bool {
        self.instance != u32::MAX
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_rays_with_sensible_numbers_are_valid() {
        let good = Ray::new(Vec3::ONE, Vec3::X);
        assert!(good.is_valid() && Ray { tmin: 2.0, tmax: 2.0, ..good }.is_valid());
        for bad in [
            Ray { tmin: -1e-3, ..good },
            Ray { tmin: 2.0, tmax: 1.0, ..good },
            Ray { tmin: f32::NAN, ..good },
            Ray { tmax: f32::NAN, ..good },
            Ray::new(Vec3::new(0.0, f32::NAN, 0.0), Vec3::X),
            Ray::new(Vec3::new(0.0, 0.0, f32::INFINITY), Vec3::X),
            Ray::new(Vec3::ZERO, Vec3::new(f32::NAN, 0.0, 1.0)),
            Ray::new(Vec3::ZERO, Vec3::new(0.0, -2e12, 1.0)),
        ] {
            assert!(!bad.is_valid(), "{bad:?}");
        }
    }
}
