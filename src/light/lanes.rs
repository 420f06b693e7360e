//! The importance of four lights or four groups of lights at once.

use super::bounds::LightBounds;
use super::simd::{Vec3x4, gather};
use super::triangle::TriangleLight;
use crate::math::{Vec3, Vec4};

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
