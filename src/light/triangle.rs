//! One emissive triangle: its solid angle, sampling of directions towards it, and a fast estimate of the light that it sends to a point.

use super::{Emitter, polygon_irradiance, weight};
use crate::geometry::Geometry;
use crate::math::{Color, Vec2, Vec3};

/// Below this solid angle (steradians) single precision blurs the spherical triangle, and uniform sampling of the area is as good.
const MIN_SOLID_ANGLE: f32 = 1e-4;
/// Above this one the receiver all but touches the triangle and the vertices' directions are nearly coplanar.
const MAX_SOLID_ANGLE: f32 = 6.27;

/// An emissive triangle in world space, ready for sampling.
#[derive(Clone, Copy, Debug)]
pub struct TriangleLight {
    pub(super) corner: Vec3,
    pub(super) edges: [Vec3; 2],
    /// `edges[0] × edges[1]`: the front face's normal times twice the area.
    pub(super) cross: Vec3,
    pub(super) longest_squared: f32,
    pub(super) weight: f32,
    emitter: Emitter,
    mirrored: bool,
}

/// A direction from a receiver to a point of a triangle.
pub(super) struct TrianglePoint {
    pub wi: Vec3,
    pub distance: f32,
    /// Per steradian.
    pub pdf: f32,
    /// Weights of the mesh's second and third vertex.
    pub barycentric: Vec2,
}

/// A triangle as seen from a receiver that its emitting face looks at.
pub(super) struct View<'a> {
    pub light: &'a TriangleLight,
    /// First corner, relative to the receiver.
    corner: Vec3,
    /// Unit directions to the corners.
    directions: [Vec3; 3],
    /// Six times the volume of the tetrahedron of receiver and triangle.
    volume: f32,
    /// Steradians.
    solid_angle: f32,
}

impl TriangleLight {
    pub(super) fn new(geometry: &Geometry, emitter: Emitter) -> Self {
        let [a, b, c] = geometry.triangle(emitter.instance, emitter.triangle);
        let edges = [b - a, c - a];
        let mirrored = geometry.instances[emitter.instance as usize].to_world.matrix3.determinant() < 0.0;
        let longest_squared = edges[0].length_squared().max(edges[1].length_squared()).max((c - b).length_squared());
        Self {
            corner: a,
            edges,
            cross: edges[0].cross(edges[1]),
            longest_squared,
            weight: weight(emitter.radiance),
            emitter,
            mirrored,
        }
    }

    /// The emitter as the scene named it.
    pub fn emitter(&self) -> &Emitter {
        &self.emitter
    }

    /// World-space corners, counter-clockwise as seen from the front face.
    pub fn corners(&self) -> [Vec3; 3] {
        [self.corner, self.corner + self.edges[0], self.corner + self.edges[1]]
    }

    /// Area in square scene units.
    pub fn area(&self) -> f32 {
        0.5 * self.cross.length()
    }

    /// Unit normal of the front face; zero for a degenerate triangle.
    pub fn normal(&self) -> Vec3 {
        self.cross.normalize_or_zero()
    }

    /// Radiant power `π A L` of the emitting faces.
    pub fn power(&self) -> Color {
        let faces = if self.emitter.double_sided { 2.0 } else { 1.0 };
        self.emitter.radiance * (std::f32::consts::PI * faces * self.area())
    }

    /// Radiant intensity along the normal, as sampling weighs colours.
    pub(super) fn intensity(&self) -> f32 {
        self.weight * self.area()
    }

    /// Irradiance at `p` on a surface with unit normal `n`, per unit radiance and without occlusion; 0 where no emitting face is seen.
    pub fn irradiance(&self, p: Vec3, n: Vec3) -> f32 {
        if self.volume(p) > 0.0 { polygon_irradiance(&self.corners(), p, n) } else { 0.0 }
    }

    /// Six times the volume of the tetrahedron of receiver and triangle, positive only where the triangle emits.
    fn volume(&self, p: Vec3) -> f32 {
        let signed = self.cross.dot(p - self.corner);
        if self.emitter.double_sided { signed.abs() } else { signed }
    }

    /// `None` where `p` sees no emitting face.
    ///
    /// The solid angle is that of
    ///
    /// ```text
    /// tan(Ω/2) = |a·(b×c)| / (1 + a·b + b·c + c·a)          [VanOosterom83, Eq. 8]
    /// ```
    ///
    /// with unit vectors to the corners, the triple product taken from the plane's distance, where it does not cancel.
    pub(super) fn view(&self, p: Vec3) -> Option<View<'_>> {
        let volume = self.volume(p);
        if !(volume > 0.0) {
            return None;
        }
        let corner = self.corner - p;
        let corners = [corner, corner + self.edges[0], corner + self.edges[1]];
        let inverse = corners.map(|c| c.length_squared().sqrt().recip());
        let directions @ [a, b, c] = std::array::from_fn(|i| corners[i] * inverse[i]);
        let triple = volume * (inverse[0] * inverse[1] * inverse[2]);
        let solid_angle = 2.0 * triple.atan2(1.0 + a.dot(b) + b.dot(c) + c.dot(a));
        Some(View { light: self, corner, directions, volume, solid_angle })
    }

    /// The irradiance at `p` on a surface with normal `n` (solid angle times radiance without a normal) by which the light is chosen where `p` is close: the
    /// solid angle times the mean cosine. Zero if the triangle cannot light the receiver.
    pub(super) fn near_importance(&self, p: Vec3, n: Option<Vec3>) -> f32 {
        let Some(view) = self.view(p) else { return 0.0 };
        let [a, b, c] = view.directions;
        let cosine = |n: Vec3| {
            let center = (view.corner * 3.0 + self.edges[0] + self.edges[1]).normalize_or_zero();
            let [a, b, c, center] = [a, b, c, center].map(|x| n.dot(x).max(0.0));
            (a + b + c) * (1.0 / 12.0) + 0.75 * center
        };
        self.weight * view.solid_angle * n.map_or(1.0, cosine)
    }

    /// Density per steradian with which [`View::sample`] chooses a direction that meets the triangle at `distance`.
    pub(super) fn pdf(&self, p: Vec3, distance: f32) -> f32 {
        self.view(p).map_or(0.0, |view| view.pdf(distance)).min(f32::MAX)
    }
}

impl View<'_> {
    /// A direction to the triangle, uniform in solid angle (in area where the solid angle is very small or nearly a hemisphere).
    pub fn sample(&self, u: Vec2) -> Option<TrianglePoint> {
        let by_solid_angle = samples_by_solid_angle(self.solid_angle);
        let weights = if by_solid_angle { self.intersect(self.sample_direction(u)) } else { square_to_triangle(u) };
        let to_light = self.corner + self.light.edges[0] * weights.x + self.light.edges[1] * weights.y;
        let squared = to_light.length_squared();
        let inverse = squared.sqrt().recip();
        let distance = squared * inverse;
        let pdf = self.pdf(distance);
        let barycentric = if self.light.mirrored { Vec2::new(weights.y, weights.x) } else { weights };
        (pdf > 0.0 && pdf.is_finite()).then(|| TrianglePoint { wi: to_light * inverse, distance, pdf, barycentric })
    }

    /// Weights of the second and third corner where a direction from the receiver meets the plane, pulled into the triangle [Moeller97, Sec. 2].
    fn intersect(&self, direction: Vec3) -> Vec2 {
        let [e1, e2] = self.light.edges;
        let scale = direction.dot(self.light.cross).recip();
        let moment = direction.cross(self.corner);
        // max() before min() turns the NaN of a direction inside the plane into a corner.
        let beta = (e2.dot(moment) * -scale).max(0.0).min(1.0);
        let gamma = (e1.dot(moment) * scale).max(0.0).min(1.0);
        let weights = Vec2::new(beta, gamma);
        if beta + gamma > 1.0 { weights / (beta + gamma) } else { weights }
    }

    /// Density per steradian of a direction that meets the triangle at `distance`.
    fn pdf(&self, distance: f32) -> f32 {
        if samples_by_solid_angle(self.solid_angle) {
            self.solid_angle.recip()
        } else {
            // d² / (A cosθ'), with A cosθ' d = volume / 2.
            2.0 * distance * distance * distance / self.volume
        }
    }

    /// A direction, unit but for rounding and uniform over the spherical triangle: `u.x` chooses the arc from B to a point C' of the side AC, so that the triangle ABC' has
    /// the fraction `u.x` of the area, and `u.y` the place on the arc [Arvo95, Sec. 3].
    ///
    /// C' is found without the angles of the triangle. With T the unit tangent at A towards C, C' = A cosφ + T sinφ and τ = tan(φ/2), the formula for the
    /// solid angle Ω' of ABC' becomes linear in τ:
    ///
    /// ```text
    /// tan(Ω'/2) = τ |A·(B×T)| / (1 + A·B + τ B·T)
    /// ```
    ///
    /// Below, `rise` / `run` is τ.
    fn sample_direction(&self, u: Vec2) -> Vec3 {
        let [a, b, c] = self.directions;
        let chord = c - a;
        let tangent = chord + a * (0.5 * chord.length_squared());
        let squared = tangent.length_squared().max(f32::MIN_POSITIVE);
        let inverse = squared.sqrt().recip();
        let (sin, cos) = (0.5 * self.solid_angle * u.x).sin_cos();
        let rise = sin * 0.5 * (a + b).length_squared();
        let run = ((cos * a.cross(b).dot(tangent).abs() - sin * b.dot(tangent)) * inverse).max(1e-12);
        let on_side = (a * (run * run - rise * rise) + tangent * (2.0 * run * rise * inverse)) / (run * run + rise * rise);

        // 1 - cos of the arc BC' without cancellation.
        let chord = on_side - b;
        let versine = 0.5 * chord.length_squared();
        let step = u.y * versine;
        b * (1.0 - step) + (chord + b * versine) * (u.y * (2.0 - step) / (2.0 - versine).max(f32::MIN_POSITIVE)).sqrt()
    }
}

fn samples_by_solid_angle(solid_angle: f32) -> bool {
    (MIN_SOLID_ANGLE..=MAX_SOLID_ANGLE).contains(&solid_angle)
}

/// Uniform weights of the second and third corner; keeps strata compact [Heitz19, Listing 1].
fn square_to_triangle(u: Vec2) -> Vec2 {
    if u.y > u.x {
        let x = 0.5 * u.x;
        Vec2::new(x, u.y - x)
    } else {
        let y = 0.5 * u.y;
        Vec2::new(u.x - y, y)
    }
}
