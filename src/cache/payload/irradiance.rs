//! Irradiance at a record, and how it is estimated and extrapolated.

use super::axes::{self, Axes, DirectSamples};
use crate::cache::record::{Area, Fences, RadiusRule, Record, metric};
use crate::cache::scheme::{Extrapolation, Scheme};
use crate::gather::{HemisphereSamples, Hessian};
use crate::geometry::SurfacePoint;
use crate::math::{Color, Mat3, Vec2, Vec3, luminance};
use std::sync::Arc;

/// The second-order term of an extrapolation is no larger than the first-order one and this share
/// of the irradiance: where a silhouette crosses another edge the Hessian may be wrong.
pub(super) const SECOND_ORDER: f32 = 0.25;

/// Share of the rays whose mean distance bounds R_i.
const NEAREST: f32 = 0.02;

/// The second-order part of a record's extrapolation.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Curve {
    /// Tangents that the Hessian refers to.
    pub tangents: [Vec3; 2],
    /// The Hessian of irradiance.
    pub hessian: Hessian,
}

impl Curve {
    /// `½ xᵀHx` at the offset x, no larger than the first-order change `first` and a quarter of
    /// `irradiance` together, in each channel.
    #[inline]
    pub fn term(&self, offset: Vec3, first: Color, irradiance: Color) -> Color {
        let x = Vec2::new(offset.dot(self.tangents[0]), offset.dot(self.tangents[1]));
        let most = first.abs() + SECOND_ORDER * irradiance;
        (0.5 * self.hessian.apply(x, x)).clamp(-most, most)
    }
}

/// Light that came straight from light sources.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Lit {
    /// Its part of the irradiance.
    pub irradiance: Color,
    /// It changes so fast around the record that it has to be sampled anew at each point.
    pub sharp: bool,
}

/// Irradiance E_i of indirect light, or of all light, with its derivatives. World space.
#[derive(Clone, Debug, PartialEq)]
pub struct Irradiance {
    /// E_i.
    pub irradiance: Color,
    /// Takes `n_i × n` to the change of irradiance.
    pub rotation: Mat3,
    /// Takes `x - x_i` to the change of irradiance.
    pub translation: Mat3,
    /// The second-order change with translation, for schemes that extrapolate to second order.
    pub curve: Option<Curve>,
    /// The change along eight axes, for schemes that extrapolate along axes; with direct light, if
    /// the record holds direct light.
    pub axes: Option<Arc<Axes>>,
    /// Of records of all light the part that came straight from light sources.
    pub lit: Option<Lit>,
}

/// Where light of small bright surfaces bends irradiance, a record reaches no farther than to where
/// that, left out, is this share of its irradiance.
const BEND: f32 = 0.07;

/// Bounds the lengths by what the light of small bright surfaces, which distances to the
/// surroundings know nothing of, bends irradiance: by `½ |uᵀHu| R² = BEND E`.
fn bounded_by_found(
    shape: Area, scheme: &Scheme, rule: &RadiusRule, at: &SurfacePoint,
    samples: &HemisphereSamples, irradiance: f32,
) -> Area {
    let h = samples.found_hessian();
    if h == Hessian::default() || irradiance <= 0.0 {
        return shape;
    }
    let [ss, st, tt] = [h.ss, h.st, h.tt].map(luminance);
    let (middle, half) = (0.5 * (ss + tt), (0.5 * (ss - tt)).hypot(st));
    let reach = rule.scale() * scheme.validity.smoothing;
    shape.bounded(at.frame.n, |axis| {
        let bend = match axis {
            Some(u) => {
                let u = Vec2::new(u.dot(at.frame.s), u.dot(at.frame.t));
                luminance(h.apply(u, u)).abs()
            }
            None => middle.abs() + half,
        };
        (2.0 * BEND * irradiance / bend).sqrt() / reach
    })
}

impl Irradiance {
    /// The record of the gather `samples` at `at`, valid as far as `rule` says. The record holds
    /// direct light, too, if `direct` says what there is.
    pub fn gathered(
        scheme: &Scheme, rule: &RadiusRule, at: &SurfacePoint, samples: &HemisphereSamples,
        direct: Option<&DirectSamples>,
    ) -> Record<Self> {
        let irradiance = samples.irradiance();
        let rotation = if scheme.extrapolation.rotates() {
            samples.rotational_gradient().to_world(&at.frame)
        } else {
            Mat3::ZERO
        };
        let derivatives = metric::derivatives(scheme, samples);
        let gradient = derivatives.gradient;
        let mut shape = metric::shape(scheme, samples, irradiance, &derivatives, rule.extent());
        if scheme.radius.nearest > 0.0 {
            let nearest = scheme.radius.nearest * samples.nearest_distance(NEAREST);
            shape = shape.map(|r| r.min(nearest));
        }
        if scheme.clamping.gradient() {
            // Luminance, not the smallest channel: a channel that is nearly black would shrink
            // every record beside a coloured wall.
            let slope = [luminance(gradient.s), luminance(gradient.t)];
            let value = luminance(irradiance);
            shape = shape.bounded(at.frame.n, |axis| {
                let slope = match axis {
                    Some(u) => (slope[0] * u.dot(at.frame.s) + slope[1] * u.dot(at.frame.t)).abs(),
                    None => slope[0].hypot(slope[1]),
                };
                // The published clamps bound R_i of metrics that are distances, but the radius
                // itself of those that estimate an error.
                let scale = if scheme.radius.metric.is_distance() { 1.0 } else { rule.scale() };
                if value > 0.0 && slope > 0.0 { value / (slope * scale) } else { f32::INFINITY }
            });
        }
        shape = bounded_by_found(shape, scheme, rule, at, samples, luminance(irradiance));
        let mut axes = None;
        if scheme.extrapolation.has_axes() {
            let (fitted, fitting) = axes::fit(scheme, rule, at, samples, irradiance, shape, direct);
            (axes, shape) = (Some(Arc::new(fitted)), fitting);
        }
        let fences = if scheme.validity.fences {
            Fences::new(samples, at.position, rule.radius(shape.longest(), at.footprint).0)
        } else {
            Fences::default()
        };
        let length = shape.shortest();
        Record {
            position: at.position,
            normal: at.frame.n,
            payload: Self {
                irradiance,
                rotation,
                translation: if !scheme.extrapolation.translates() {
                    Mat3::ZERO
                } else {
                    gradient.to_world(&at.frame)
                },
                curve: (scheme.extrapolation == Extrapolation::Second).then_some(Curve {
                    tangents: [at.frame.s, at.frame.t],
                    hessian: derivatives.hessian,
                }),
                axes,
                lit: None,
            },
            shape,
            limit: f32::INFINITY,
            length_unclamped: length,
            length,
            error: rule.allowed_error(),
            footprint: at.footprint,
            sigma: samples.sigma(),
            fences,
        }
    }

    /// The irradiance at the point that lies `offset` from a record with the normal `normal`, with
    /// the normal `n`: `max(0, E_i + (n_i × n)·∇_r E_i + (x - x_i)·∇_t E_i)` [WardHeckbert92].
    /// `slope` is the factor of [`RadiusRule::radius`] on the gradient.
    pub fn at(&self, normal: Vec3, n: Vec3, offset: Vec3, slope: f32) -> Color {
        let turned = self.rotation * normal.cross(n);
        (self.irradiance + turned + slope * (self.translation * offset)).max(Color::ZERO)
    }
}
