//! One cache record, how it is made from a gather, and how far it reaches.

use super::axes::{self, Axes, DirectSamples};
use super::envelope::Envelope;
use super::fence::Fences;
use super::footprint::Footprint;
use super::metric;
use super::scheme::{Extrapolation, Kernel, Scheme};
use crate::gather::{HemisphereSamples, Hessian};
use crate::geometry::SurfacePoint;
use crate::math::{Color, Mat3, Vec2, Vec3, luminance};
use rayon::prelude::*;
use std::f32::consts::SQRT_2;
use std::sync::Arc;

/// The second-order term of an extrapolation is no larger than the first-order one and this share
/// of the irradiance: where a silhouette crosses another edge the Hessian may be wrong.
pub(super) const SECOND_ORDER: f32 = 0.25;
/// The share of the rays that are the nearest, for the bound on R_i.
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

/// Irradiance of indirect light at a point, with what is needed to use it nearby. World space.
#[derive(Clone, Debug, PartialEq)]
pub struct Record {
    /// Where the gather started.
    pub position: Vec3,
    /// Unit shading normal of the gather.
    pub normal: Vec3,
    /// Irradiance E_i.
    pub irradiance: Color,
    /// Takes `n_i × n` to the change of irradiance.
    pub rotation: Mat3,
    /// Takes `x - x_i` to the change of irradiance.
    pub translation: Mat3,
    /// How irradiance bends with translation, for schemes that extrapolate to second order.
    pub curve: Option<Curve>,
    /// How irradiance goes on along eight axes, for schemes that extrapolate by them; with direct
    /// light, if the record holds that.
    pub axes: Option<Arc<Axes>>,
    /// The record's lengths R_i as the gather gave them, clamped by its own gradient; neighbours
    /// and pixels do not touch them.
    pub shape: Footprint,
    /// What the neighbours allow each length to be [Krivanek06, Sec. 5.3]; infinite where they are
    /// not asked.
    pub limit: f32,
    /// R_i: the shortest of `shape`.
    pub length_unclamped: f32,
    /// R_i after neighbour clamping: no more than `limit`.
    pub length: f32,
    /// a_i, the error up to which the record is used: the scheme's on this level, or less where it
    /// was [refined](super::Cache::converge).
    pub error: f32,
    /// Diameter of a pixel at the record, world units.
    pub footprint: f32,
    /// Standard error of the luminance of `irradiance`.
    pub sigma: f32,
    /// Planes behind which the record is not used.
    pub fences: Fences,
}

impl Record {
    /// The record of a gather at `at`, used as far as `reach` says. It holds direct light, too, if
    /// `direct` says what there is.
    pub fn new(
        scheme: &Scheme,
        reach: &Reach,
        at: &SurfacePoint,
        samples: &HemisphereSamples,
        direct: Option<&DirectSamples>,
    ) -> Self {
        let irradiance = samples.irradiance();
        let rotation = if scheme.extrapolation.rotates() {
            samples.rotational_gradient().to_world(&at.frame)
        } else {
            Mat3::ZERO
        };
        let derivatives = metric::derivatives(scheme, samples);
        let gradient = derivatives.gradient;
        let mut shape = metric::shape(scheme, samples, irradiance, &derivatives, reach.scene_size);
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
                let scale = if scheme.radius.metric.is_distance() { 1.0 } else { reach.scale };
                if value > 0.0 && slope > 0.0 { value / (slope * scale) } else { f32::INFINITY }
            });
        }
        let mut axes = None;
        if scheme.extrapolation.has_axes() {
            let (fitted, fitting) =
                axes::fit(scheme, reach, at, samples, irradiance, shape, direct);
            (axes, shape) = (Some(Arc::new(fitted)), fitting);
        }
        let fences = if scheme.validity.fences {
            Fences::new(samples, at.position, reach.radius(shape.longest(), at.footprint).0)
        } else {
            Fences::default()
        };
        let length = shape.shortest();
        Self {
            position: at.position,
            normal: at.frame.n,
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
            shape,
            limit: f32::INFINITY,
            length_unclamped: length,
            length,
            error: reach.error,
            footprint: at.footprint,
            sigma: samples.sigma(),
            fences,
        }
    }

    /// Bounds every length by what the neighbours allow.
    ///
    /// For an ellipse or sectors the neighbours are asked for their shortest lengths: R_i along
    /// each axis is at most `R_j,min + |x_i - x_j|`.
    pub fn clamp(&mut self, limit: f32) {
        self.limit = limit;
        self.length = self.length_unclamped.min(limit);
    }

    /// Replaces the lengths that the gather gave.
    pub(super) fn reshape(&mut self, shape: Footprint) {
        self.shape = shape;
        self.length_unclamped = shape.shortest();
        self.length = self.length_unclamped;
    }

    /// Bounds every length by `most`, as the gather gave it.
    pub fn shorten(&mut self, most: f32) {
        self.reshape(self.shape.map(|r| r.min(most)));
    }

    /// The error of using the record at `at` as a share of the level's allowed error, so that the
    /// record is valid below [`Reach::share`]. `None` where it must not be used at any
    /// distance: it faces away, lies more than `in_front` in front of the point, or fences stand
    /// between.
    pub fn error_at(&self, reach: &Reach, at: &SurfacePoint, in_front: f32) -> Option<f32> {
        let (offset, cosine) = (at.position - self.position, at.frame.n.dot(self.normal));
        let d = offset.length();
        let hidden = 0.5 * offset.dot(at.frame.n + self.normal) < -0.05 * d - in_front;
        if cosine <= reach.least_cosine || hidden || !self.fences.admit(at.position) {
            return None;
        }
        let (area, _) = reach.area(self);
        Some(reach.relative_error(area.share(self.normal, offset), cosine, reach.normal_scale()))
    }

    /// The irradiance at `at` extrapolated from the record alone: `max(0, E_i + (n_i × n)·∇_r E_i +
    /// (x - x_i)·∇_t E_i)` [WardHeckbert92].
    pub fn irradiance_at(&self, reach: &Reach, at: &SurfacePoint) -> Color {
        let (_, slope) = reach.radius(self.length, self.footprint);
        let turned = self.rotation * self.normal.cross(at.frame.n);
        (self.irradiance + turned + slope * (self.translation * (at.position - self.position)))
            .max(Color::ZERO)
    }
}

/// Bounds the lengths of all records by those of the others, `envelope` being made of all of them.
pub(super) fn clamp_to_neighbours(records: &mut [Record], envelope: &Envelope) {
    records.par_iter_mut().enumerate().for_each(|(id, r)| {
        // The lowest value of another record: a record's own length does not bound its other axes.
        let [first, second] = envelope.lowest_two(r.position);
        r.clamp(if first.id == id as u32 { second.value } else { first.value });
    });
}

/// How far records reach on one level: the numbers of a [`Scheme`] worked out once.
#[derive(Clone, Copy, Debug)]
pub struct Reach {
    kernel: Kernel,
    /// sqrt(1 - cos) of the largest angle between normals, and the cosine.
    widest_normal: f32,
    least_cosine: f32,
    error: f32,
    scale: f32,
    smallest_error: f32,
    smoothing: f32,
    min_pixels: f32,
    max_pixels: f32,
    max_radius: f32,
    scene_size: f32,
}

impl Reach {
    /// The reach on `level`; `smoothing` is 1 while the level fills.
    pub fn new(scheme: &Scheme, level: u8, scene_size: f32, smoothing: f32) -> Self {
        Self {
            kernel: scheme.validity.kernel,
            widest_normal: SQRT_2 * (0.5 * scheme.validity.normal_limit).sin(),
            // Other kernels end there by themselves, or a little later once they are smoothed.
            least_cosine: if scheme.validity.kernel == Kernel::Ward {
                scheme.validity.normal_limit.cos().max(0.0)
            } else {
                0.0
            },
            error: scheme.error_at(level),
            scale: scheme.radius_scale(level),
            smallest_error: scheme.error_min(),
            smoothing,
            min_pixels: scheme.radius.min_pixels,
            // Pixels bound records from above for the eye's sake; it does not see the deeper
            // levels.
            max_pixels: if level == 0 { scheme.radius.max_pixels } else { 0.0 },
            max_radius: scheme.radius.max_radius * scene_size,
            scene_size,
        }
    }

    /// The cosine between normals down to which records are used, exclusive.
    pub(super) fn least_cosine(&self) -> f32 {
        self.least_cosine
    }

    /// What takes lengths to radii under kernels that bound an error.
    pub(super) fn scale(&self) -> f32 {
        self.scale
    }

    /// The radius of validity for a length R_i: where the positional error alone reaches the
    /// allowed one. Returns also the factor in (0, 1] by which the translational gradient must
    /// shrink because a lower limit has raised the radius: over the larger area the linear term
    /// must not grow.
    pub fn radius(&self, length: f32, footprint: f32) -> (f32, f32) {
        let wanted = match self.kernel {
            Kernel::Ward | Kernel::Schwarzhaupt | Kernel::Ribardiere => self.scale * length,
            Kernel::Tabellion => 0.5 * length,
        };
        let upper = if self.max_pixels > 0.0 {
            self.max_radius.min(self.max_pixels * footprint)
        } else {
            self.max_radius
        };
        let lower = (self.min_pixels * footprint).min(upper).max(1e-6 * self.max_radius);
        let clamped = wanted.clamp(lower, upper);
        let scale = if self.kernel == Kernel::Tabellion { self.scale } else { 1.0 };
        (clamped * scale * self.smoothing, (wanted / clamped).min(1.0))
    }

    /// [`Reach::radius`] while the level fills.
    pub(super) fn radius_filling(&self, length: f32, footprint: f32) -> f32 {
        self.radius(length, footprint).0 / self.smoothing
    }

    /// The length R_i whose radius, limits aside, is `radius` while the level fills.
    pub(super) fn length_of(&self, radius: f32) -> f32 {
        if self.kernel == Kernel::Tabellion {
            2.0 * radius / self.scale
        } else {
            radius / self.scale
        }
    }

    /// The area in which `record` is valid, by its position alone: each length turned into a
    /// radius. Returns also the factor for its gradient, see [`Reach::radius`].
    pub fn area(&self, record: &Record) -> (Footprint, f32) {
        let (_, slope) = self.radius(record.length, record.footprint);
        (record.shape.map(|r| self.radius(r.min(record.limit), record.footprint).0), slope)
    }

    /// a_i of `record` as a share of the level's allowed error, in (0, 1]: the radius of validity
    /// is this share of [`Reach::radius`].
    #[inline]
    pub fn share(&self, record: &Record) -> f32 {
        record.error / self.error
    }

    /// The smallest a_i to which refinement may take `record`: the scheme's, or the one at which
    /// the record is as small as pixels allow. At most the level's allowed error.
    pub fn floor(&self, record: &Record) -> f32 {
        let (radius, _) = self.radius(record.length, record.footprint);
        let scale =
            self.smoothing * if self.kernel == Kernel::Tabellion { self.error } else { 1.0 };
        let pixels = self.error * (scale * self.min_pixels * record.footprint / radius);
        self.smallest_error.max(pixels).min(self.error)
    }

    /// a of the scheme on this level, the largest a_i.
    pub fn allowed_error(&self) -> f32 {
        self.error
    }

    /// What `sqrt(1 - n·n_i)` is multiplied by to be a share of the allowed error, or the root of
    /// one.
    pub fn normal_scale(&self) -> f32 {
        match self.kernel {
            Kernel::Ward => 1.0 / (self.error * self.smoothing),
            Kernel::Tabellion => 1.0 / (self.widest_normal * self.error * self.smoothing),
            Kernel::Schwarzhaupt | Kernel::Ribardiere => {
                1.0 / (self.widest_normal * self.smoothing)
            }
        }
    }

    /// The error of a record as a share of the allowed one: `position` is the distance as a share
    /// of its area's extent, [`Footprint::share`], `cosine` that of the normals.
    #[inline]
    pub fn relative_error(&self, position: f32, cosine: f32, normal_scale: f32) -> f32 {
        let normal = (1.0 - cosine).max(0.0).sqrt() * normal_scale;
        match self.kernel {
            Kernel::Ward => position + normal,
            Kernel::Tabellion => position.max(normal),
            // Where the normal alone is too far off, the product could deceive.
            Kernel::Schwarzhaupt => 1.0 - (1.0 - position) * (1.0 - normal * normal).max(0.0),
            // The chord stands for the angle, of which it is the same share within 0.4 % at 20°.
            Kernel::Ribardiere => 1.0 - (1.0 - position) * (1.0 - normal).max(0.0),
        }
    }
}
