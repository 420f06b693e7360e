//! How far a radiance record's extrapolation can be trusted, from the derivatives of its
//! coefficients or of what a surface makes of them.
//!
//! The error of a vector of coefficients bounds the error of the light that any lobe makes of it
//! [Zhao, Eq. 3.21]. To first order it is `|J x|`, J being the matrix of the gradients; to second
//! order `½ sqrt(Σ_i (xᵀ H_i x)²)`, which the thesis bounds by the eigenvalues of `Σ_i |H_i|`. Its
//! |H_i| must be the spectral absolute value; taken element by element it would depend on the
//! tangents. All errors are relative: to the norm of the same vector, or to one percent of that of
//! incident radiance where a surface reflects less.
//!
//! The vector is that of *incident* radiance, which does not know surfaces; of *outgoing* radiance
//! `O = M Λ`, so that the same error means larger areas on surfaces that blur more; or the one
//! number `c(wo)·Λ`, the radiance that leaves towards the viewer.

use crate::cache::record::Area;
use crate::cache::record::metric::{Curvature, FLOOR, absolute, eigen};
use crate::cache::scheme::{GlossyMetric, Measure, Outline, Placement, Scheme};
use crate::gather::{Coefficients, HemisphereSamples};
use crate::geometry::SurfacePoint;
use crate::material::tables::BrdfMatrix;
use crate::math::{Color, DMat2, DVec2, Frame, PI, luminance};
use std::f64::consts::TAU;

/// How surfaces reflect, in the basis of the radiance records. Both answers are in the frame of the
/// point, whose position, normal and `wo` count; of what material it is, is looked up.
pub trait Reflector: Sync {
    /// Coefficients of all lobes times the cosine towards `at.wo`, three runs. `None` if there is
    /// no surface.
    fn lobe(&self, at: &SurfacePoint) -> Option<Coefficients>;

    /// The matrix that makes coefficients of outgoing radiance of those of incident radiance.
    /// `None` if there is no surface.
    fn matrix(&self, at: &SurfacePoint) -> Option<BrdfMatrix>;
}

/// Coefficients per channel with derivatives along the tangents of a frame; `hessian` may be empty.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Response {
    pub value: Coefficients,
    pub gradient: [Coefficients; 2],
    pub hessian: [Coefficients; 3],
}

impl Response {
    /// What `placement` takes the error of, `self` being incident radiance at `at`.
    pub fn placed(
        self, placement: Placement, reflector: Option<&dyn Reflector>, at: &SurfacePoint,
    ) -> Self {
        let reflected = match (placement, reflector) {
            (Placement::Outgoing, Some(r)) => r.matrix(at).map(|m| self.map(|v| m.apply(v))),
            (Placement::View, Some(r)) => r.lobe(at).map(|c| self.map(|v| products(&c, v))),
            _ => None,
        };
        reflected.unwrap_or(self)
    }

    fn map(&self, f: impl Fn(&[f32]) -> Coefficients) -> Self {
        let each = |v: &Coefficients| if v.is_empty() { Vec::new() } else { f(v) };
        Self {
            value: f(&self.value),
            gradient: self.gradient.each_ref().map(each),
            hessian: self.hessian.each_ref().map(each),
        }
    }

    /// Calls `visit(colour of coefficient i)` for every i of one of the vectors.
    fn colors(v: &[f32]) -> impl Iterator<Item = Color> {
        let n = v.len() / 3;
        (0..n).map(move |i| Color::new(v[i], v[n + i], v[2 * n + i]))
    }

    /// The norm over coefficients and channels, weighted as luminance weighs them.
    pub fn norm(&self) -> f64 {
        Self::colors(&self.value).map(|c| f64::from(luminance(c * c))).sum::<f64>().sqrt()
    }

    /// The distance over which the gradient changes the coefficients by as much as they are,
    /// `|Λ|/|∇Λ|` over all coefficients and channels; infinite without a gradient.
    pub fn length(&self) -> f32 {
        let [value, s, t] =
            [&self.value, &self.gradient[0], &self.gradient[1]].map(|c| super::vectors::dot(c, c));
        if s + t > 0.0 { (value / (s + t)).sqrt() } else { f32::INFINITY }
    }

    /// `Jᵀ J` with the channels weighted.
    fn slopes(&self) -> DMat2 {
        let mut g = [0.0; 3];
        for (s, t) in Self::colors(&self.gradient[0]).zip(Self::colors(&self.gradient[1])) {
            for (sum, product) in g.iter_mut().zip([s * s, s * t, t * t]) {
                *sum += f64::from(luminance(product));
            }
        }
        DMat2::from_cols(DVec2::new(g[0], g[1]), DVec2::new(g[1], g[2]))
    }

    /// The Hessian of each coefficient and channel with the weight of the channel.
    fn hessians(&self) -> impl Iterator<Item = (f64, DMat2)> {
        let weights = [Color::X, Color::Y, Color::Z].map(|c| f64::from(luminance(c)));
        let n = self.hessian[0].len() / 3;
        (0..3 * n).map(move |i| {
            let [ss, st, tt] = self.hessian.each_ref().map(|h| f64::from(h[i]));
            (weights[i / n], DMat2::from_cols(DVec2::new(ss, st), DVec2::new(st, tt)))
        })
    }
}

/// The products of two vectors, channel by channel.
fn products(a: &[f32], b: &[f32]) -> Coefficients {
    let n = a.len().min(b.len()) / 3;
    let run = |v: &[f32], c: usize| v[c * (v.len() / 3)..][..n].to_vec();
    (0..3).map(|c| super::vectors::dot(&run(a, c), &run(b, c))).collect()
}

/// What bounds areas where light itself says nothing: the curvature and the slope that the
/// surroundings could cause, as a share of what they shine.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Surroundings {
    curvature: DMat2,
    slope: f64,
    /// Norm of the coefficients of incident radiance.
    incident: f64,
}

impl Surroundings {
    /// Those of a gather whose coefficients are `incident`.
    pub fn new(samples: &HemisphereSamples, incident: &Response) -> Self {
        let incident = incident.norm();
        let share = if incident > 0.0 { FLOOR } else { 1.0 } / f64::from(PI);
        Self {
            curvature: share * samples.geometric_curvature(),
            slope: share * f64::from(samples.geometric_slope()),
            incident,
        }
    }
}

/// The lengths R_i of a record: its radii where the allowed error is 1. `scale` is what takes
/// lengths to radii, for the bound on the gradient.
pub(super) fn shape(
    scheme: &Scheme, response: &Response, surroundings: &Surroundings, frame: &Frame, extent: f32,
    scale: f32,
) -> Area {
    let norm = response.norm().max(FLOOR * surroundings.incident);
    let inverse = if norm > 0.0 { 1.0 / norm } else { 0.0 };
    let curvature = Curvature { scheme, size: f64::from(extent), e: 1.0, frame };
    let slopes = inverse * inverse * response.slopes();
    let shape = match scheme.glossy().metric {
        GlossyMetric::First(_) => first_order(&curvature, slopes, surroundings.slope),
        GlossyMetric::Second(_) | GlossyMetric::Irradiance => {
            second_order(&curvature, response, inverse, surroundings.curvature)
        }
    };
    if !scheme.clamping.gradient() {
        return shape;
    }
    shape.bounded(frame.n, |axis| {
        let slope = match axis {
            Some(u) => {
                let u = DVec2::new(f64::from(u.dot(frame.s)), f64::from(u.dot(frame.t)));
                u.dot(slopes * u).max(0.0).sqrt()
            }
            None => eigen(slopes).0[0].max(0.0).sqrt(),
        };
        if slope > 0.0 { 1.0 / (slope as f32 * scale) } else { f32::INFINITY }
    })
}

/// Areas over which `|J x|`, relative, is as large as it may be: along the axes `R_i = t/sqrt(g_i)`
/// with the eigenvalues g of JᵀJ, and `∫ |J x| = (2π/3) t³/sqrt(g_1 g_2)`. The thesis prints `π R²
/// |∇Λ|` for a disc [Zhao, Eq. 3.25], which has another dimension.
fn first_order(c: &Curvature, slopes: DMat2, floor: f64) -> Area {
    let disc = |slope: f64| match c.scheme.radius.metric.measure() {
        Measure::Average => 1.5 / slope,
        Measure::Total => (3.0 * c.size * c.size / (TAU * slope)).cbrt(),
    };
    match c.scheme.radius.area {
        Outline::Sectors => c.axes(|u| u.dot(slopes * u).max(0.0).sqrt() + floor, disc),
        Outline::Disc => {
            Area::Disc { r: disc((slopes.x_axis.x + slopes.y_axis.y).sqrt() + floor) as f32 }
        }
        Outline::Ellipse | Outline::OptimalEllipse => {
            let ([large, small], axis) = eigen(slopes);
            let [large, small] = [large, small].map(|g| g.max(0.0).sqrt() + floor);
            let t = match c.scheme.radius.metric.measure() {
                Measure::Average => 1.5,
                Measure::Total => (3.0 * c.size * c.size * large * small / TAU).cbrt(),
            };
            let short = t / large;
            c.outline(
                axis,
                [
                    short as f32,
                    (t / small).min(f64::from(c.scheme.radius.max_aspect) * short) as f32,
                ],
            )
        }
    }
}

/// Areas over which the second-order error, relative, is as large as it may be: ellipses from the
/// sum of the spectral absolute values, sectors from the quartic form of each direction.
fn second_order(c: &Curvature, response: &Response, inverse: f64, floor: DMat2) -> Area {
    if c.scheme.radius.area != Outline::Sectors {
        let sum = response
            .hessians()
            .map(|(weight, h)| weight * absolute(h))
            .fold(DMat2::ZERO, |a, b| a + b);
        return c.ellipse(inverse * sum + floor);
    }
    let quartic = Quartic::new(response);
    c.sectors(|u| inverse * quartic.at(u) + u.dot(floor * u))
}

/// `Σ_i (uᵀ H_i u)²` as a form of fourth degree in u.
struct Quartic([f64; 5]);

impl Quartic {
    fn new(response: &Response) -> Self {
        let mut q = [0.0; 5];
        for (weight, h) in response.hessians() {
            let (a, b, c) = (h.x_axis.x, h.x_axis.y, h.y_axis.y);
            for (sum, term) in q.iter_mut().zip([
                a * a,
                4.0 * a * b,
                2.0 * a * c + 4.0 * b * b,
                4.0 * b * c,
                c * c,
            ]) {
                *sum += weight * term;
            }
        }
        Self(q)
    }

    /// The root at the unit vector `u`.
    fn at(&self, u: DVec2) -> f64 {
        let (x, y) = (u.x, u.y);
        let powers = [x * x * x * x, x * x * x * y, x * x * y * y, x * y * y * y, y * y * y * y];
        self.0.iter().zip(powers).map(|(q, p)| q * p).sum::<f64>().max(0.0).sqrt()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cache::{Clamping, Glossy, Metric, Preset, Radius};
    use crate::math::Vec3;
    use crate::sampling::Rng;

    const FIRST: GlossyMetric = GlossyMetric::First(Placement::Incoming);
    const SECOND: GlossyMetric = GlossyMetric::Second(Placement::Incoming);

    fn response(seed: u64, turn: f32) -> Response {
        let mut rng = Rng::new(seed);
        let mut vector =
            || -> Coefficients { (0..48).map(|_| 2.0 * rng.next_f32() - 1.0).collect() };
        let (value, s, t, ss, st, tt) =
            (vector(), vector(), vector(), vector(), vector(), vector());
        // The same field with the tangents turned by `turn`.
        let (sin, cos) = turn.sin_cos();
        let mix = |parts: [(f32, &Coefficients); 3]| -> Coefficients {
            (0..48).map(|i| parts.iter().map(|(w, v)| w * v[i]).sum()).collect()
        };
        let none = (0.0, &s);
        let gradient = [mix([(cos, &s), (sin, &t), none]), mix([(-sin, &s), (cos, &t), none])];
        let hessian = [
            mix([(cos * cos, &ss), (2.0 * sin * cos, &st), (sin * sin, &tt)]),
            mix([(-sin * cos, &ss), (cos * cos - sin * sin, &st), (sin * cos, &tt)]),
            mix([(sin * sin, &ss), (-2.0 * sin * cos, &st), (cos * cos, &tt)]),
        ];
        Response { value, gradient, hessian }
    }

    fn scheme(metric: GlossyMetric, area: Outline, measure: Measure) -> Scheme {
        let mut scheme = Preset::by_name("schwarzhaupt12").unwrap().scheme();
        let (error, max_aspect) = (Metric::Hessian(measure), 1e6);
        scheme.radius = Radius { metric: error, area, max_aspect, ..scheme.radius };
        scheme.glossy = Some(Glossy { metric, ..Glossy::default() });
        scheme.clamping = Clamping::None;
        scheme
    }

    const NOTHING: Surroundings =
        Surroundings { curvature: DMat2::ZERO, slope: 0.0, incident: 0.0 };

    /// `|error|` at x, relative, of first or second order.
    fn error(r: &Response, metric: GlossyMetric, x: DVec2) -> f64 {
        let n = r.value.len() / 3;
        let square = |i: usize| -> f64 {
            let e = if metric == FIRST {
                x.x * f64::from(r.gradient[0][i]) + x.y * f64::from(r.gradient[1][i])
            } else {
                let [ss, st, tt] = r.hessian.each_ref().map(|h| f64::from(h[i]));
                0.5 * (x.x * x.x * ss + 2.0 * x.x * x.y * st + x.y * x.y * tt)
            };
            let weight = [0.2126, 0.7152, 0.0722][i / n];
            weight * e * e
        };
        (0..3 * n).map(square).sum::<f64>().sqrt() / r.norm()
    }

    #[test]
    fn areas_err_by_what_they_may_at_most() {
        let frame = Frame::from_normal(Vec3::Z);
        let size = 3.0;
        for seed in 0..4 {
            let r = response(seed, 0.0);
            for metric in [FIRST, SECOND] {
                for outline in [Outline::Disc, Outline::OptimalEllipse, Outline::Sectors] {
                    for measure in [Measure::Average, Measure::Total] {
                        let scheme = scheme(metric, outline, measure);
                        let area = shape(&scheme, &r, &NOTHING, &frame, size as f32, 1.0);
                        let (axis, other) = (area.axis(Vec3::Z), Vec3::Z.cross(area.axis(Vec3::Z)));
                        let (mut total, mut whole) = (0.0, 0.0);
                        let n = 200;
                        for k in 0..n * n {
                            let (s, phi) = (
                                (f64::from(k / n) + 0.5) / f64::from(n),
                                TAU * (f64::from(k % n) + 0.5) / f64::from(n),
                            );
                            let flat = DVec2::from_angle(phi);
                            let extent = f64::from(area.boundary(flat.as_vec2()));
                            let world = axis * flat.x as f32 + other * flat.y as f32;
                            let x = s * extent * DVec2::new(f64::from(world.x), f64::from(world.y));
                            let cell = s * extent * extent * TAU / f64::from(n * n);
                            total += cell * error(&r, metric, x);
                            whole += cell;
                        }
                        let got = if measure == Measure::Average {
                            total / whole
                        } else {
                            total / (size * size)
                        };
                        // Norms of sums are below sums of norms, and sectors take the worst of
                        // their range; by how much depends on the vectors.
                        assert!(
                            got < 1.001 && got > 0.1,
                            "{metric:?} {outline:?} {measure:?}: {got}"
                        );
                    }
                }
            }
        }
    }

    #[test]
    fn areas_do_not_depend_on_the_tangents() {
        for (metric, outline) in
            [(FIRST, Outline::Ellipse), (SECOND, Outline::Ellipse), (SECOND, Outline::Disc)]
        {
            let mut scheme = scheme(metric, outline, Measure::Total);
            scheme.clamping = Clamping::Gradient;
            let turn = 0.6_f32;
            let straight = Frame::from_normal(Vec3::Z);
            let turned = Frame {
                s: turn.cos() * straight.s + turn.sin() * straight.t,
                t: turn.cos() * straight.t - turn.sin() * straight.s,
                ..straight
            };
            let a = shape(&scheme, &response(1, 0.0), &NOTHING, &straight, 2.0, 0.1);
            let b = shape(&scheme, &response(1, turn), &NOTHING, &turned, 2.0, 0.1);
            for (a, b) in a.radii().iter().zip(b.radii()) {
                assert!((a / b - 1.0).abs() < 1e-3, "{metric:?}: {a} {b}");
            }
        }
    }

    #[test]
    fn the_quartic_form_is_the_sum_of_squares() {
        let r = response(2, 0.0);
        let quartic = Quartic::new(&r);
        for k in 0..10 {
            let u = DVec2::from_angle(0.3 * f64::from(k));
            assert!((quartic.at(u) - 2.0 * error(&r, SECOND, u) * r.norm()).abs() < 1e-6);
        }
    }

    #[test]
    fn of_the_viewer_s_lobe_one_number_is_left() {
        struct Mirrorish;
        impl Reflector for Mirrorish {
            fn lobe(&self, _: &SurfacePoint) -> Option<Coefficients> {
                Some([vec![0.0; 16], vec![0.5; 16], vec![1.0; 16]].concat())
            }
            fn matrix(&self, _: &SurfacePoint) -> Option<BrdfMatrix> {
                Some(BrdfMatrix::black(4))
            }
        }
        let at = SurfacePoint::plain(Vec3::ZERO, Vec3::Z);
        let r = response(3, 0.0);
        let seen = r.clone().placed(Placement::View, Some(&Mirrorish), &at);
        let sum = |v: &[f32]| v.iter().sum::<f32>();
        assert_eq!((seen.value.len(), seen.hessian[2].len()), (3, 3));
        assert!(
            (seen.value[1] - 0.5 * sum(&r.value[16..32])).abs() < 1e-5
                && (seen.hessian[0][2] - sum(&r.hessian[0][32..])).abs() < 1e-5
        );
        let out = r.clone().placed(Placement::Outgoing, Some(&Mirrorish), &at);
        assert!(out.norm() == 0.0);
        assert_eq!(r.clone().placed(Placement::Incoming, Some(&Mirrorish), &at), r);
    }
}
