//! One emissive triangle: its solid angle, sampling of directions towards it, and a fast estimate
//! of the light that it sends to a point.

use super::pattern::Pattern;
use super::polygon::polygon_irradiance;
use super::simd::{LANES, Vec3x4, sin_cos};
use super::source::{Emitter, weight};
use crate::geometry::{Geometry, MAP_ROUNDING};
use crate::math::{Color, Vec2, Vec3, Vec4};
use crate::sampling::square_to_triangle;

/// Below this solid angle (steradians) single precision blurs the spherical triangle, and uniform
/// sampling of the area is as good.
const MIN_SOLID_ANGLE: f32 = 1e-4;
/// Above this one the receiver all but touches the triangle and the vertices' directions are nearly
/// coplanar.
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
    error: f32,
}

/// Directions from a receiver to four points of a triangle.
pub(super) struct TrianglePoints {
    wi: Vec3x4,
    distance: Vec4,
    pdf: Vec4,
    /// Weights of the mesh's second and third vertex.
    barycentric: [Vec4; 2],
}

/// A direction from a receiver to a point of a triangle.
pub(super) struct TrianglePoint {
    pub wi: Vec3,
    pub distance: f32,
    /// Per steradian.
    pub pdf: f32,
    /// Weights of the mesh's second and third vertex.
    pub barycentric: [f32; 2],
}

impl TrianglePoints {
    /// `None` where rounding left no direction.
    #[inline]
    pub fn get(&self, i: usize) -> Option<TrianglePoint> {
        let (distance, pdf) = (self.distance[i], self.pdf[i]);
        let usable = distance > 0.0 && pdf > 0.0 && pdf.is_finite();
        usable.then(|| TrianglePoint {
            wi: self.wi.lane(i),
            distance,
            pdf,
            barycentric: self.barycentric.map(|b| b[i]),
        })
    }
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
        let mirrored =
            geometry.instances[emitter.instance as usize].to_world.matrix3.determinant() < 0.0;
        let longest_squared =
            edges[0].length_squared().max(edges[1].length_squared()).max((c - b).length_squared());
        Self {
            corner: a,
            edges,
            cross: edges[0].cross(edges[1]),
            longest_squared,
            weight: weight(emitter.radiance),
            emitter,
            mirrored,
            error: MAP_ROUNDING * a.abs().max(b.abs()).max(c.abs()).max_element(),
        }
    }

    /// How far the triangle that rays are traced against may lie off this one, along its normal.
    pub fn error(&self) -> f32 {
        self.error
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

    /// Weights of the mesh's second and third vertex at a point of the plane.
    pub(super) fn weights(&self, position: Vec3) -> [f32; 2] {
        let [e1, e2] = self.edges;
        let (offset, scale) = (position - self.corner, self.cross.length_squared().recip());
        let beta = self.cross.dot(offset.cross(e2)) * scale;
        let gamma = self.cross.dot(e1.cross(offset)) * scale;
        if self.mirrored { [gamma, beta] } else { [beta, gamma] }
    }

    /// The point with these weights of the mesh's second and third vertex.
    pub(super) fn position(&self, [u, v]: [f32; 2]) -> Vec3 {
        let [beta, gamma] = if self.mirrored { [v, u] } else { [u, v] };
        self.corner + self.edges[0] * beta + self.edges[1] * gamma
    }

    /// A point uniform over the area for `u` in [0, 1)²: the weights of the mesh's second and third
    /// vertex, and its position.
    pub(super) fn point(&self, u: Vec2) -> ([f32; 2], Vec3) {
        let [beta, gamma] = square_to_triangle(u);
        let weights = if self.mirrored { [gamma, beta] } else { [beta, gamma] };
        (weights, self.position(weights))
    }

    /// Radiant intensity along the normal, as sampling weighs colours.
    pub(super) fn intensity(&self) -> f32 {
        self.weight * self.area()
    }

    /// Irradiance at `p` on a surface with unit normal `n`, per unit radiance and without
    /// occlusion; 0 where no emitting face is seen.
    pub fn irradiance(&self, p: Vec3, n: Vec3) -> f32 {
        if self.volume(p) > 0.0 { polygon_irradiance(&self.corners(), p, n) } else { 0.0 }
    }

    /// Six times the volume of the tetrahedron of receiver and triangle, positive only where the
    /// triangle emits.
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
    /// with unit vectors to the corners, the triple product taken from the plane's distance, where
    /// it does not cancel.
    pub(super) fn view(&self, p: Vec3) -> Option<View<'_>> {
        let volume = self.volume(p);
        if volume.is_nan() || volume <= 0.0 {
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

    /// The irradiance at `p` on a surface with normal `n` (solid angle times radiance without a
    /// normal) by which the light is chosen where `p` is close: the solid angle times the mean
    /// cosine. Zero if the triangle cannot light the receiver.
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

    /// Density per steradian with which [`View::sample`] chooses a direction that meets the
    /// triangle at `distance` along `wi`.
    pub(super) fn pdf(&self, p: Vec3, wi: Vec3, distance: f32, pattern: Option<&Pattern>) -> f32 {
        let Some(view) = self.view(p) else { return 0.0 };
        let pdf = match pattern {
            None => view.pdf(distance),
            Some(pattern) => view.patterned_pdf(pattern, self.weights(p + wi * distance), distance),
        };
        pdf.min(f32::MAX)
    }
}

impl View<'_> {
    /// Four directions to the triangle, uniform in solid angle (in area where the solid angle is
    /// very small or nearly a hemisphere).
    pub fn sample(&self, u: [Vec2; LANES]) -> TrianglePoints {
        let by_solid_angle = samples_by_solid_angle(self.solid_angle);
        let ([beta, gamma], light) = (
            if by_solid_angle {
                self.intersect(self.sample_directions(u))
            } else {
                squares_to_triangle(u)
            },
            self.light,
        );
        let to_light = Vec3x4::splat(self.corner)
            + Vec3x4::splat(light.edges[0]) * beta
            + Vec3x4::splat(light.edges[1]) * gamma;
        let squared = to_light.dot(to_light);
        let inverse = squared.sqrt().recip();
        let distance = squared * inverse;
        let pdf = if by_solid_angle {
            Vec4::splat(self.solid_angle.recip())
        } else {
            distance * distance * distance * (2.0 / self.volume)
        };
        let barycentric = if light.mirrored { [gamma, beta] } else { [beta, gamma] };
        TrianglePoints { wi: to_light * inverse, distance, pdf, barycentric }
    }

    /// A direction to the triangle, drawn where it glows or, for a part of `u`, by solid angle.
    pub fn sample_pattern(&self, pattern: &Pattern, u: Vec2) -> Option<TrianglePoint> {
        let Some(weights) = pattern.draw(u) else {
            let point = self.sample([Pattern::rest(u); LANES]).get(0)?;
            let pdf = self.patterned_pdf(pattern, point.barycentric, point.distance);
            return Some(TrianglePoint { pdf, ..point });
        };
        let [beta, gamma] = if self.light.mirrored { [weights[1], weights[0]] } else { weights };
        let to_light = self.corner + self.light.edges[0] * beta + self.light.edges[1] * gamma;
        let distance = to_light.length();
        let pdf = self.patterned_pdf(pattern, weights, distance);
        (distance > 0.0 && pdf > 0.0 && pdf.is_finite()).then(|| TrianglePoint {
            wi: to_light / distance,
            distance,
            pdf,
            barycentric: weights,
        })
    }

    /// Density per steradian of [`View::sample_pattern`].
    fn patterned_pdf(&self, pattern: &Pattern, weights: [f32; 2], distance: f32) -> f32 {
        let share = pattern.share();
        share * pattern.density(weights) * self.area_pdf(distance)
            + (1.0 - share) * self.pdf(distance)
    }

    /// Weights of the second and third corner where directions from the receiver meet the plane,
    /// pulled into the triangle [Moeller97, Sec. 2].
    fn intersect(&self, directions: Vec3x4) -> [Vec4; 2] {
        let [e1, e2] = self.light.edges;
        let scale = directions.dot(Vec3x4::splat(self.light.cross)).recip();
        let beta = directions.dot(Vec3x4::splat(e2.cross(self.corner))) * scale;
        let gamma = directions.dot(Vec3x4::splat(self.corner.cross(e1))) * scale;
        let (beta, gamma) = (beta.max(Vec4::ZERO), gamma.max(Vec4::ZERO));
        let shrink = (beta + gamma).max(Vec4::ONE).recip();
        [beta * shrink, gamma * shrink]
    }

    /// Density per steradian of a direction that meets the triangle at `distance`.
    fn pdf(&self, distance: f32) -> f32 {
        if samples_by_solid_angle(self.solid_angle) {
            self.solid_angle.recip()
        } else {
            self.area_pdf(distance)
        }
    }

    /// Density per steradian of a direction to a point uniform over the area: d² / (A cosθ'), with
    /// A cosθ' d = volume / 2.
    fn area_pdf(&self, distance: f32) -> f32 {
        2.0 * distance * distance * distance / self.volume
    }

    /// Directions, unit but for rounding and uniform over the spherical triangle: `u.x` chooses the
    /// arc from B to a point C' of the side AC, so that the triangle ABC' has the fraction
    /// `u.x` of the area, and `u.y` the place on the arc [Arvo95, pp. 437-438].
    ///
    /// C' is found without the angles of the triangle. With T the unit tangent at A towards C, C' =
    /// A cosφ + T sinφ and τ = tan(φ/2), the formula for the solid angle Ω' of ABC' becomes
    /// linear in τ:
    ///
    /// ```text
    /// tan(Ω'/2) = τ |A·(B×T)| / (1 + A·B + τ B·T)
    /// ```
    ///
    /// Below, `rise` / `run` is τ.
    fn sample_directions(&self, u: [Vec2; LANES]) -> Vec3x4 {
        let [a, b, c] = self.directions;
        let chord = c - a;
        let tangent = (chord + a * (0.5 * chord.length_squared())).normalize_or_zero();
        let (ux, uy) = (Vec4::from_array(u.map(|u| u.x)), Vec4::from_array(u.map(|u| u.y)));
        let (sin, cos) = sin_cos(ux * (0.5 * self.solid_angle));
        let rise = sin * (0.5 * (a + b).length_squared());
        let run =
            (cos * a.cross(b).dot(tangent).abs() - sin * b.dot(tangent)).max(Vec4::splat(1e-12));
        let scale = (run * run + rise * rise).recip();
        let on_side = Vec3x4::splat(a) * ((run * run - rise * rise) * scale)
            + Vec3x4::splat(tangent) * (run * rise * scale * 2.0);

        // The versine 1 - cos of the arc BC', without cancellation.
        let b = Vec3x4::splat(b);
        let chord = on_side - b;
        let versine = chord.dot(chord) * 0.5;
        let step = uy * versine;
        let two = Vec4::splat(2.0);
        let across =
            (uy * (two - step) / (two - versine).max(Vec4::splat(f32::MIN_POSITIVE))).sqrt();
        b * (Vec4::ONE - step) + (chord + b * versine) * across
    }
}

fn samples_by_solid_angle(solid_angle: f32) -> bool {
    (MIN_SOLID_ANGLE..=MAX_SOLID_ANGLE).contains(&solid_angle)
}

/// Uniform weights of the second and third corner; keeps strata compact [Heitz19, pp. 1-2].
fn squares_to_triangle(u: [Vec2; LANES]) -> [Vec4; 2] {
    let weights = u.map(|u| {
        if u.y > u.x {
            Vec2::new(0.5 * u.x, u.y - 0.5 * u.x)
        } else {
            Vec2::new(u.x - 0.5 * u.y, 0.5 * u.y)
        }
    });
    [Vec4::from_array(weights.map(|w| w.x)), Vec4::from_array(weights.map(|w| w.y))]
}
