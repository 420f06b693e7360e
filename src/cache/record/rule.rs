//! How far records are valid on one level: the numbers of a [`Scheme`] worked out once.

use super::area::Area;
use super::one::Record;
use crate::cache::scheme::{Kernel, Scheme};
use crate::geometry::SurfacePoint;
use std::f32::consts::SQRT_2;

/// The radii of validity and the allowed errors of the records of one level.
#[derive(Clone, Copy, Debug)]
pub struct RadiusRule {
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
    extent: f32,
}

impl RadiusRule {
    /// The rule of `level`; `smoothing` is 1 while the level fills.
    pub fn new(scheme: &Scheme, level: u8, extent: f32, smoothing: f32) -> Self {
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
            max_radius: scheme.radius.max_radius * extent,
            extent,
        }
    }

    /// The cosine between normals down to which records are used, exclusive.
    pub(in crate::cache) fn least_cosine(&self) -> f32 {
        self.least_cosine
    }

    /// The length that errors in total are relative to.
    pub(in crate::cache) fn extent(&self) -> f32 {
        self.extent
    }

    /// What takes lengths to radii under kernels that bound an error.
    pub(in crate::cache) fn scale(&self) -> f32 {
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
        let pixels = self.max_pixels * footprint;
        let upper = if pixels > 0.0 { self.max_radius.min(pixels) } else { self.max_radius };
        let lower = (self.min_pixels * footprint).max(1e-6 * self.max_radius).min(upper);
        let clamped = wanted.clamp(lower, upper);
        let scale = if self.kernel == Kernel::Tabellion { self.scale } else { 1.0 };
        (clamped * scale * self.smoothing, (wanted / clamped).min(1.0))
    }

    /// [`RadiusRule::radius`] while the level fills.
    pub(in crate::cache) fn radius_filling(&self, length: f32, footprint: f32) -> f32 {
        self.radius(length, footprint).0 / self.smoothing
    }

    /// The length R_i whose radius, limits aside, is `radius` while the level fills.
    pub(in crate::cache) fn length_of(&self, radius: f32) -> f32 {
        if self.kernel == Kernel::Tabellion {
            2.0 * radius / self.scale
        } else {
            radius / self.scale
        }
    }

    /// The area in which `record` is valid, by its position alone: each length turned into a
    /// radius. Returns also the factor for its gradient, see [`RadiusRule::radius`].
    pub fn area<P>(&self, record: &Record<P>) -> (Area, f32) {
        let (_, slope) = self.radius(record.length, record.footprint);
        (record.shape.map(|r| self.radius(r.min(record.limit), record.footprint).0), slope)
    }

    /// a_i of `record` as a share of the level's allowed error, in (0, 1]: the radius of validity
    /// is this share of [`RadiusRule::radius`].
    #[inline]
    pub fn share<P>(&self, record: &Record<P>) -> f32 {
        record.error / self.error
    }

    /// The smallest a_i to which refinement may take `record`: the scheme's, or the one at which
    /// the record is as small as pixels allow. At most the level's allowed error.
    pub fn floor<P>(&self, record: &Record<P>) -> f32 {
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
    /// of its area's extent, [`Area::share`], `cosine` that of the normals.
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

    /// The error of using `record` at `at` as a share of the level's allowed error. The record is
    /// valid below [`RadiusRule::share`]. `None` where the record must not be used at any distance:
    /// its normal faces away, it lies farther in front of the point than `in_front`, or a fence
    /// stands between.
    pub fn error_of<P>(&self, record: &Record<P>, at: &SurfacePoint, in_front: f32) -> Option<f32> {
        let (offset, cosine) = (at.position - record.position, at.frame.n.dot(record.normal));
        let d = offset.length();
        let hidden = 0.5 * offset.dot(at.frame.n + record.normal) < -0.05 * d - in_front;
        if cosine <= self.least_cosine || hidden || !record.fences.admit(at.position) {
            return None;
        }
        let (area, _) = self.area(record);
        Some(self.relative_error(area.share(record.normal, offset), cosine, self.normal_scale()))
    }
}
