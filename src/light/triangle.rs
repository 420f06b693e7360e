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
    corner: Vec3,
    edges: [Vec3; 2],
    /// `edges[0] × edges[1]`: the front face's normal times twice the area.
    cross: Vec3,
    longest_squared: f32,
    weight: f32,
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

/// A triangle as seen from a receiver: corners relative to it, and six times the volume of the tetrahedron that it spans with them, positive where the triangle emits.
struct View {
    corners: [Vec3; 3],
    volume: f32,
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
        if self.view(p).is_some() { polygon_irradiance(&self.corners(), p, n) } else { 0.0 }
    }

    /// `None` where `p` sees no emitting face.
    fn view(&self, p: Vec3) -> Option<View> {
        let a = self.corner - p;
        let signed = -self.cross.dot(a);
        let volume = if self.emitter.double_sided { signed.abs() } else { signed };
        (volume > 0.0).then(|| View { corners: [a, a + self.edges[0], a + self.edges[1]], volume })
    }

    /// An estimate of the irradiance at `p` (on a surface with normal `n`), or of solid angle times radiance without a normal, by which lights are chosen. Zero if and
    /// only if the triangle cannot light the receiver: it is below the horizon, turned away, degenerate or black.
    pub(super) fn importance(&self, p: Vec3, n: Option<Vec3>) -> f32 {
        let Some(view) = self.view(p) else { return 0.0 };
        let [a, b, c] = view.corners;
        let center = (a + b + c) * (1.0 / 3.0);
        let cosines = n.map(|n| [a, b, c, center].map(|x| n.dot(x).max(0.0)));
        let squares = [a, b, c, center].map(Vec3::length_squared);
        let estimate = if squares[3] > self.longest_squared {
            // Far: the quadrature rule of degree 2 with the corners, for the integral of cosθ cosθ' / d² over the area.
            let values = match cosines {
                Some(cosines) => std::array::from_fn(|i| cosines[i] / (squares[i] * squares[i])),
                None => squares.map(|s| 1.0 / (s * s.sqrt())),
            };
            0.5 * view.volume * quadrature(values)
        } else {
            // Near: the exact solid angle, and the mean cosine.
            let mean = cosines.map_or(1.0, |cosines| {
                quadrature(std::array::from_fn(|i| cosines[i] / squares[i].sqrt().max(f32::MIN_POSITIVE)))
            });
            view.solid_angle() * mean
        };
        self.weight * estimate
    }

    /// A direction to the triangle, uniform in solid angle (in area where the solid angle is very small or nearly a hemisphere).
    pub(super) fn sample(&self, p: Vec3, u: Vec2) -> Option<TrianglePoint> {
        let view = self.view(p)?;
        let solid_angle = view.solid_angle();
        let by_solid_angle = samples_by_solid_angle(solid_angle);
        let weights =
            if by_solid_angle { self.intersect(&view, view.sample_direction(solid_angle, u)) } else { square_to_triangle(u) };
        let to_light = view.corners[0] + self.edges[0] * weights.x + self.edges[1] * weights.y;
        let distance = to_light.length();
        let pdf = if by_solid_angle { solid_angle.recip() } else { area_pdf(distance, view.volume) };
        let usable = distance > 0.0 && pdf.is_finite() && pdf > 0.0;
        let barycentric = if self.mirrored { Vec2::new(weights.y, weights.x) } else { weights };
        usable.then(|| TrianglePoint { wi: to_light / distance, distance, pdf, barycentric })
    }

    /// Density per steradian with which [`TriangleLight::sample`] chooses a direction that meets the triangle at `distance`.
    pub(super) fn pdf(&self, p: Vec3, distance: f32) -> f32 {
        let Some(view) = self.view(p) else { return 0.0 };
        let solid_angle = view.solid_angle();
        let pdf = if samples_by_solid_angle(solid_angle) { solid_angle.recip() } else { area_pdf(distance, view.volume) };
        if pdf.is_finite() { pdf } else { 0.0 }
    }

    /// Weights of the second and third corner where a direction from the receiver meets the plane, pulled into the triangle.
    fn intersect(&self, view: &View, direction: Vec3) -> Vec2 {
        let [e1, e2] = self.edges;
        let across = direction.cross(e2);
        let scale = e1.dot(across).recip();
        let origin = -view.corners[0];
        // max() before min() turns the NaN of a direction inside the plane into a corner.
        let beta = (origin.dot(across) * scale).max(0.0).min(1.0);
        let gamma = (direction.dot(origin.cross(e1)) * scale).max(0.0).min(1.0);
        Vec2::new(beta, gamma) / (beta + gamma).max(1.0)
    }
}

impl View {
    /// Solid angle in steradians.
    ///
    ///     tan(Ω/2) = |a·(b×c)| / (|a||b||c| + (a·b)|c| + (b·c)|a| + (c·a)|b|)          [VanOosterom83, Eq. 8]
    fn solid_angle(&self) -> f32 {
        let [a, b, c] = self.corners;
        let (la, lb, lc) = (a.length(), b.length(), c.length());
        2.0 * self.volume.atan2(la * lb * lc + a.dot(b) * lc + b.dot(c) * la + c.dot(a) * lb)
    }

    /// A unit direction, uniform over the spherical triangle of the given solid angle: `u.x` chooses the arc from B to a point C' of the side AC, so that
    /// the triangle ABC' has the fraction `u.x` of the area, and `u.y` the place on the arc [Arvo95, Sec. 3].
    ///
    /// C' is found without the angles of the triangle. With T the unit tangent at A towards C, C' = A cosφ + T sinφ and τ = tan(φ/2), the
    /// formula for the solid angle Ω' of ABC' becomes linear in τ and is solved for it:
    ///
    ///     tan(Ω'/2) = τ |det(A,B,T)| / (1 + A·B + τ B·T)
    fn sample_direction(&self, solid_angle: f32, u: Vec2) -> Vec3 {
        let [a, b, c] = self.corners.map(Vec3::normalize);
        let chord = c - a;
        let t = (chord - a * chord.dot(a)).normalize_or_zero();
        let (sin, cos) = (0.5 * solid_angle * u.x).sin_cos();
        let one_plus_ab = 0.5 * (a + b).length_squared();
        let tau = sin * one_plus_ab / (cos * a.cross(b).dot(t).abs() - sin * b.dot(t)).max(f32::MIN_POSITIVE);
        let tau = tau.min(1e15);
        let on_ac = (a * (1.0 - tau * tau) + t * (2.0 * tau)) / (1.0 + tau * tau);

        let chord = on_ac - b;
        let tangent = (chord - b * chord.dot(b)).normalize_or_zero();
        let rise = u.y * 0.5 * chord.length_squared();
        b * (1.0 - rise) + tangent * (rise * (2.0 - rise)).max(0.0).sqrt()
    }
}

fn samples_by_solid_angle(solid_angle: f32) -> bool {
    (MIN_SOLID_ANGLE..=MAX_SOLID_ANGLE).contains(&solid_angle)
}

/// The density per steradian of uniform sampling by area, d² / (A cosθ'), with A cosθ' d = volume / 2.
fn area_pdf(distance: f32, volume: f32) -> f32 {
    2.0 * distance * distance * distance / volume
}

/// The mean over a triangle of a function known at the corners and the centre, exact for polynomials of degree 2.
fn quadrature([a, b, c, center]: [f32; 4]) -> f32 {
    (a + b + c) * (1.0 / 12.0) + 0.75 * center
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
