//! Vectors of four, one light or one sample in each component.

use crate::math::{Vec3, Vec4};

/// Lights per group.
pub(super) const LANES: usize = 4;

/// Four points or directions.
#[derive(Clone, Copy, Debug)]
pub(super) struct Vec3x4 {
    pub x: Vec4,
    pub y: Vec4,
    pub z: Vec4,
}

impl Vec3x4 {
    #[inline]
    pub fn splat(v: Vec3) -> Self {
        Self { x: Vec4::splat(v.x), y: Vec4::splat(v.y), z: Vec4::splat(v.z) }
    }

    /// One of the four.
    #[inline]
    pub fn lane(self, i: usize) -> Vec3 {
        Vec3::new(self.x[i], self.y[i], self.z[i])
    }

    pub fn gather<T>(items: &[T], get: impl Fn(&T) -> Vec3) -> Self {
        Self {
            x: gather(items, |i| get(i).x),
            y: gather(items, |i| get(i).y),
            z: gather(items, |i| get(i).z),
        }
    }

    #[inline]
    pub fn dot(self, other: Self) -> Vec4 {
        self.x * other.x + self.y * other.y + self.z * other.z
    }
}

impl std::ops::Add for Vec3x4 {
    type Output = Self;

    #[inline]
    fn add(self, other: Self) -> Self {
        Self { x: self.x + other.x, y: self.y + other.y, z: self.z + other.z }
    }
}

impl std::ops::Sub for Vec3x4 {
    type Output = Self;

    #[inline]
    fn sub(self, other: Self) -> Self {
        Self { x: self.x - other.x, y: self.y - other.y, z: self.z - other.z }
    }
}

impl std::ops::Mul<Vec4> for Vec3x4 {
    type Output = Self;

    #[inline]
    fn mul(self, scale: Vec4) -> Self {
        Self { x: self.x * scale, y: self.y * scale, z: self.z * scale }
    }
}

/// One number of each item; zero in lanes without one.
pub(super) fn gather<T>(items: &[T], get: impl Fn(&T) -> f32) -> Vec4 {
    Vec4::from_array(std::array::from_fn(|i| items.get(i).map_or(0.0, &get)))
}

/// Sine and cosine of angles in [0, π], absolute error below 1e-6: the polynomials [Abramowitz64,
/// Eq. 4.3.97, 4.3.99] at half the angle, doubled.
#[inline]
pub(super) fn sin_cos(angle: Vec4) -> (Vec4, Vec4) {
    let half = angle * 0.5;
    let x = half * half;
    let sin = ((((x * -2.39e-8 + 2.7526e-6) * x - 1.984_09e-4) * x + 8.333_332e-3) * x - 1.0 / 6.0)
        * x
        + 1.0;
    let cos = ((((x * -2.605e-7 + 2.476_09e-5) * x - 1.388_839_7e-3) * x + 4.166_664e-2) * x - 0.5)
        * x
        + 1.0;
    let sin = sin * half;
    (sin * cos * 2.0, Vec4::ONE - sin * sin * 2.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sine_and_cosine_are_those_of_the_library() {
        for i in 0..=1000 {
            let angle = i as f32 / 1000.0 * std::f32::consts::PI;
            let (sin, cos) = sin_cos(Vec4::splat(angle));
            assert!(
                (sin.x - angle.sin()).abs() < 1e-6 && (cos.x - angle.cos()).abs() < 1e-6,
                "{angle}: {sin} {cos}"
            );
        }
    }
}
