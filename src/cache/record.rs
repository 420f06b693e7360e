//! One cache record, how it is made from a gather, and how far it reaches.

use super::fence::Fences;
use super::scheme::{Kernel, Metric, Scheme};
use crate::gather::HemisphereSamples;
use crate::geometry::SurfacePoint;
use crate::math::{Color, Mat3, Vec3, luminance};

/// sqrt(1 - cos 10°): the normal deviation at which a record of [Tabellion04] ends.
const TABELLION_NORMAL: f32 = 0.123_257;

/// Irradiance of indirect light at a point, with what is needed to use it nearby. World space.
#[derive(Clone, Copy, Debug, PartialEq)]
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
    /// R_i as the gather gave it, clamped by its own gradient; neighbours and pixels do not touch it.
    pub length_unclamped: f32,
    /// R_i after neighbour clamping.
    pub length: f32,
    /// a_i, the error up to which the record is used: the scheme's on this level, or less where it was [refined](super::Cache::converge).
    pub error: f32,
    /// Diameter of a pixel at the record, world units.
    pub footprint: f32,
    /// Standard error of the luminance of `irradiance`.
    pub sigma: f32,
    /// Planes behind which the record is not used.
    pub fences: Fences,
}

impl Record {
    /// The record of a gather at `at`, used as far as `reach` says.
    pub fn new(scheme: &Scheme, reach: &Reach, at: &SurfacePoint, samples: &HemisphereSamples) -> Self {
        let irradiance = samples.irradiance();
        let rotation = if scheme.rotational_gradient { samples.rotational_gradient().to_world(&at.frame) } else { Mat3::ZERO };
        let gradient = samples.translational_gradient(scheme.translational_gradient);
        let mut length = match scheme.metric {
            Metric::Harmonic => samples.harmonic_distance(),
            Metric::Minimum => samples.minimum_distance(),
            Metric::MinimumRestricted => samples.minimum_distance_restricted(),
        };
        if scheme.nearest_fraction > 0.0 {
            length = length.min(scheme.nearest_scale * samples.nearest_distance(scheme.nearest_fraction));
        }
        if scheme.gradient_clamp {
            // Luminance, not the smallest channel: a channel that is nearly black would shrink every record beside a coloured wall.
            let slope = luminance(gradient.s).hypot(luminance(gradient.t));
            let value = luminance(irradiance);
            if value > 0.0 && slope > 0.0 {
                length = length.min(value / slope);
            }
        }
        let fences = if scheme.fences {
            Fences::new(samples, at.position, reach.radius(length, at.footprint).0)
        } else {
            Fences::default()
        };
        Self {
            position: at.position,
            normal: at.frame.n,
            irradiance,
            rotation,
            translation: gradient.to_world(&at.frame),
            length_unclamped: length,
            length,
            error: reach.error,
            footprint: at.footprint,
            sigma: samples.sigma(),
            fences,
        }
    }

    /// The error of using the record at `at` as a share of the level's allowed error, so that the record is valid below [`Reach::share`]. `None` where it must
    /// not be used at any distance: it faces away, lies in front of the point and `in_front` says by how much it may not, or fences stand between.
    pub fn error_at(&self, reach: &Reach, at: &SurfacePoint, in_front: Option<f32>) -> Option<f32> {
        let (offset, cosine) = (at.position - self.position, at.frame.n.dot(self.normal));
        let d = offset.length();
        let hidden = in_front.is_some_and(|tolerance| 0.5 * offset.dot(at.frame.n + self.normal) < -0.05 * d - tolerance);
        if cosine <= 0.0 || hidden || !self.fences.admit(at.position) {
            return None;
        }
        let (radius, _) = reach.radius(self.length, self.footprint);
        Some(reach.relative_error(d, 1.0 / radius, cosine, reach.normal_scale()))
    }

    /// The irradiance at `at` extrapolated from the record alone: `max(0, E_i + (n_i × n)·∇_r E_i + (x - x_i)·∇_t E_i)` [WardHeckbert92].
    pub fn irradiance_at(&self, reach: &Reach, at: &SurfacePoint) -> Color {
        let (_, slope) = reach.radius(self.length, self.footprint);
        let turned = self.rotation * self.normal.cross(at.frame.n);
        (self.irradiance + turned + slope * (self.translation * (at.position - self.position))).max(Color::ZERO)
    }
}

/// How far records reach on one level: the numbers of a [`Scheme`] worked out once.
#[derive(Clone, Copy, Debug)]
pub struct Reach {
    kernel: Kernel,
    error: f32,
    smallest_error: f32,
    smoothing: f32,
    min_pixels: f32,
    max_pixels: f32,
    max_radius: f32,
}

impl Reach {
    /// The reach on `level`; `smoothing` is 1 while the level fills.
    pub fn new(scheme: &Scheme, level: u8, scene_size: f32, smoothing: f32) -> Self {
        Self {
            kernel: scheme.kernel,
            error: scheme.error_at(level),
            smallest_error: scheme.error_min,
            smoothing,
            min_pixels: scheme.min_pixels,
            // Pixels bound records from above for the eye's sake; it does not see the deeper levels.
            max_pixels: if level == 0 { scheme.max_pixels } else { 0.0 },
            max_radius: scheme.max_radius * scene_size,
        }
    }

    /// The radius of validity for a length R_i: where the positional error alone reaches the allowed one. Returns also the factor in (0, 1] by which the
    /// translational gradient must shrink because a lower limit has raised the radius: over the larger area the linear term must not grow.
    pub fn radius(&self, length: f32, footprint: f32) -> (f32, f32) {
        let wanted = match self.kernel {
            Kernel::Ward => self.error * length,
            Kernel::Tabellion => 0.5 * length,
        };
        let upper = if self.max_pixels > 0.0 { self.max_radius.min(self.max_pixels * footprint) } else { self.max_radius };
        let lower = (self.min_pixels * footprint).min(upper).max(1e-6 * self.max_radius);
        let clamped = wanted.clamp(lower, upper);
        let scale = if self.kernel == Kernel::Tabellion { self.error } else { 1.0 };
        (clamped * scale * self.smoothing, (wanted / clamped).min(1.0))
    }

    /// a_i of `record` as a share of the level's allowed error, in (0, 1]: the radius of validity is this share of [`Reach::radius`].
    #[inline]
    pub fn share(&self, record: &Record) -> f32 {
        record.error / self.error
    }

    /// The smallest a_i to which refinement may take `record`: the scheme's, or the one at which the record is as small as pixels allow. At most the level's allowed
    /// error.
    pub fn floor(&self, record: &Record) -> f32 {
        let (radius, _) = self.radius(record.length, record.footprint);
        let scale = self.smoothing * if self.kernel == Kernel::Tabellion { self.error } else { 1.0 };
        let pixels = self.error * (scale * self.min_pixels * record.footprint / radius);
        self.smallest_error.max(pixels).min(self.error)
    }

    /// a of the scheme on this level, the largest a_i.
    pub fn allowed_error(&self) -> f32 {
        self.error
    }

    /// What `sqrt(1 - n·n_i)` is multiplied by to be a share of the allowed error.
    pub fn normal_scale(&self) -> f32 {
        match self.kernel {
            Kernel::Ward => 1.0 / (self.error * self.smoothing),
            Kernel::Tabellion => 1.0 / (TABELLION_NORMAL * self.error * self.smoothing),
        }
    }

    /// The error at distance `d` of a record of radius `1/inverse_radius` with normal cosine `cosine`, as a share of the allowed one.
    #[inline]
    pub fn relative_error(&self, d: f32, inverse_radius: f32, cosine: f32, normal_scale: f32) -> f32 {
        let position = d * inverse_radius;
        let normal = (1.0 - cosine).max(0.0).sqrt() * normal_scale;
        match self.kernel {
            Kernel::Ward => position + normal,
            Kernel::Tabellion => position.max(normal),
        }
    }
}
