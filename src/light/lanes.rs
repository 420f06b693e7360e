//! Four at once: choosing among lights and sampling one, with one light or one sample per component
//! of a vector.

use super::TriangleLight;
use super::bounds::LightBounds;
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

    fn gather<T>(items: &[T], get: impl Fn(&T) -> Vec3) -> Self {
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
fn gather<T>(items: &[T], get: impl Fn(&T) -> f32) -> Vec4 {
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

/// Up to four triangles.
#[derive(Clone, Copy, Debug)]
pub(super) struct TriangleLanes {
    corner: Vec3x4,
    edges: [Vec3x4; 2],
    cross: Vec3x4,
    longest_squared: Vec4,
    weight: Vec4,
    /// -1 where both faces emit, else 0.
    back: Vec4,
}

impl TriangleLanes {
    pub fn new(triangles: &[TriangleLight]) -> Self {
        Self {
            corner: Vec3x4::gather(triangles, |t| t.corner),
            edges: [
                Vec3x4::gather(triangles, |t| t.edges[0]),
                Vec3x4::gather(triangles, |t| t.edges[1]),
            ],
            cross: Vec3x4::gather(triangles, |t| t.cross),
            longest_squared: gather(triangles, |t| t.longest_squared),
            weight: gather(triangles, |t| t.weight),
            back: gather(triangles, |t| if t.emitter().double_sided { -1.0 } else { 0.0 }),
        }
    }

    /// An estimate of the irradiance at `p` on a surface with normal `n` (of the integral of
    /// radiance over solid angle without a normal), by which lights are chosen: the integral of
    /// cosθ cosθ' / d² over the area by the quadrature rule of degree 2 with the corners and the
    /// centre. Zero if the triangle cannot light the receiver. The second value has a bit set
    /// for each triangle that is too close for the rule and lit from the right side.
    #[inline]
    pub fn importance(&self, p: Vec3, n: Option<Vec3>) -> (Vec4, u32) {
        let a = self.corner - Vec3x4::splat(p);
        let (b, c) = (a + self.edges[0], a + self.edges[1]);
        let center = (a + b + c) * Vec4::splat(1.0 / 3.0);
        let signed = self.cross.dot(a);
        let volume = (-signed).max(self.back * -signed).max(Vec4::ZERO);
        let center_squared = center.dot(center);
        let lit = volume.cmpgt(Vec4::ZERO);
        let near = center_squared.cmple(self.longest_squared) & lit;
        let value = |x: Vec3x4, squared: Vec4| match n {
            Some(n) => x.dot(Vec3x4::splat(n)).max(Vec4::ZERO) / (squared * squared),
            None => (squared * squared.sqrt()).recip(),
        };
        let corners = value(a, a.dot(a)) + value(b, b.dot(b)) + value(c, c.dot(c));
        let estimate = corners * (1.0 / 12.0) + value(center, center_squared) * 0.75;
        (Vec4::select(lit, self.weight * volume * estimate * 0.5, Vec4::ZERO), near.bitmask())
    }
}

/// The bounds of up to four groups of lights, in the form that the estimate at a point needs.
#[derive(Clone, Copy, Debug)]
pub(super) struct GroupLanes {
    center: Vec3x4,
    half: Vec3x4,
    radius_squared: Vec4,
    axis: Vec3x4,
    cos_o: Vec4,
    sin_o: Vec4,
    intensity: Vec4,
}

impl GroupLanes {
    pub fn new(groups: &[LightBounds]) -> Self {
        let half = |g: &LightBounds| 0.5 * (g.bounds.max - g.bounds.min);
        Self {
            center: Vec3x4::gather(groups, |g| g.bounds.center()),
            half: Vec3x4::gather(groups, half),
            radius_squared: gather(groups, |g| half(g).length_squared()),
            axis: Vec3x4::gather(groups, |g| g.axis),
            cos_o: gather(groups, |g| g.theta_o.cos()),
            // The sine of the single precision π is not 0.
            sin_o: gather(groups, |g| {
                if g.theta_o >= std::f32::consts::PI { 0.0 } else { g.theta_o.sin() }
            }),
            intensity: gather(groups, |g| g.intensity),
        }
    }

    /// An estimate of the irradiance at `p` from each group: intensity cosθ' cosθ / d², both
    /// cosines the largest that the bounding sphere and the cone of normals allow [Conty18,
    /// Sec. 4]. Zero only if no light of the group can reach a surface with normal `n`.
    #[inline]
    pub fn importance(&self, p: Vec3, n: Option<Vec3>) -> Vec4 {
        let to = self.center - Vec3x4::splat(p);
        // Inside the bounding sphere every direction is possible.
        let distance_squared =
            to.dot(to).max(self.radius_squared).max(Vec4::splat(f32::MIN_POSITIVE));
        let inverse_squared = distance_squared.recip();
        let wi = to * inverse_squared.sqrt();
        let sin2_b = self.radius_squared * inverse_squared;
        let inside = to.dot(to).cmple(self.radius_squared);
        let (sin_b, cos_b) = (sin2_b.sqrt(), (Vec4::ONE - sin2_b).max(Vec4::ZERO).sqrt());
        let cos_w = -self.axis.dot(wi);
        let (cos_x, sin_x) = subtract_angle(cos_w, sine(cos_w), self.cos_o, self.sin_o);
        let (cos_light, _) = subtract_angle(cos_x, sin_x, cos_b, sin_b);
        let mut value = self.intensity * inverse_squared;
        let mut cosines = cos_light.max(Vec4::ZERO);
        if let Some(n) = n {
            let n4 = Vec3x4::splat(n);
            let cos = n4.dot(wi);
            cosines *= subtract_angle(cos, sine(cos), cos_b, sin_b).0.max(Vec4::ZERO);
            let highest = n4.dot(to) + Vec3x4::splat(n.abs()).dot(self.half);
            value = Vec4::select(highest.cmpgt(Vec4::ZERO), value, Vec4::ZERO);
        }
        value * Vec4::select(inside, Vec4::ONE, cosines)
    }
}

#[inline]
fn sine(cos: Vec4) -> Vec4 {
    (Vec4::ONE - cos * cos).max(Vec4::ZERO).sqrt()
}

/// Cosine and sine of max(0, a - b) for angles in [0, π].
#[inline]
fn subtract_angle(cos_a: Vec4, sin_a: Vec4, cos_b: Vec4, sin_b: Vec4) -> (Vec4, Vec4) {
    let smaller = cos_a.cmpgt(cos_b);
    let (cos, sin) = (cos_a * cos_b + sin_a * sin_b, sin_a * cos_b - cos_a * sin_b);
    (Vec4::select(smaller, Vec4::ONE, cos), Vec4::select(smaller, Vec4::ZERO, sin))
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
