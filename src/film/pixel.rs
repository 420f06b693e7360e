//! Pixels while they are rendered: sums over samples.

use crate::math::{Color, Vec3, luminance};
use crate::transport::{Shaded, Status};

/// The five parts of the radiance, in the order of [`crate::transport::Radiance::parts`].
pub type Parts = [Color; 5];

/// Sums over the samples of one pixel.
#[derive(Clone, Copy, Debug, Default)]
pub struct Pixel {
    pub(super) parts: Parts,
    pub(super) albedo: Color,
    pub(super) normal: Vec3,
    position: Vec3,
    distance: f32,
    pub(super) irradiance: Color,
    pub(super) records: f32,
    pub(super) error: f32,
    allowed: f32,
    pub(super) traced: f32,
    pub(super) cached: f32,
    /// Samples that saw a surface.
    pub(super) covered: f32,
    squares: Color,
    samples: u32,
    lookups: u32,
    misses: u32,
    /// Samples that saw a glossy surface, and those of them with cached lobes.
    glossy: [u32; 2],
}

impl Pixel {
    /// Adds one sample. A sample that is not finite counts as black and cannot spoil the pixel.
    pub fn add(&mut self, s: &Shaded) {
        self.samples += 1;
        self.lookups += s.lookups;
        self.misses += s.misses;
        if s.radiance.is_finite() {
            for (sum, part) in self.parts.iter_mut().zip(s.radiance.parts()) {
                *sum += part;
            }
            let total = s.radiance.total();
            self.squares += total * total;
        }
        if let Some(surface) = &s.surface {
            self.covered += 1.0;
            self.albedo += surface.albedo;
            self.normal += surface.normal;
            self.position += surface.position;
            self.distance += surface.distance;
        }
        match s.status {
            Status::None => {}
            Status::Cached => self.cached += 1.0,
            Status::Traced => self.traced += 1.0,
        }
        self.glossy[0] += u32::from(s.glossy != Status::None);
        self.glossy[1] += u32::from(s.glossy == Status::Cached);
        self.irradiance += s.irradiance;
        self.records += s.records as f32;
        self.error += s.error;
        self.allowed += s.allowed;
    }

    /// Adds the samples of `other`.
    pub fn merge(&mut self, other: &Self) {
        for (sum, part) in self.parts.iter_mut().zip(other.parts) {
            *sum += part;
        }
        self.albedo += other.albedo;
        self.normal += other.normal;
        self.position += other.position;
        self.distance += other.distance;
        self.irradiance += other.irradiance;
        self.records += other.records;
        self.error += other.error;
        self.allowed += other.allowed;
        self.traced += other.traced;
        self.cached += other.cached;
        self.covered += other.covered;
        self.squares += other.squares;
        self.samples += other.samples;
        self.lookups += other.lookups;
        self.misses += other.misses;
        self.glossy[0] += other.glossy[0];
        self.glossy[1] += other.glossy[1];
    }

    /// Number of samples.
    pub fn samples(&self) -> u32 {
        self.samples
    }

    /// Lookups of the cache, and those without a valid record.
    pub fn lookups(&self) -> (u64, u64) {
        (u64::from(self.lookups), u64::from(self.misses))
    }

    /// Samples that saw a glossy surface, and those of them with cached lobes.
    pub fn glossy(&self) -> (u64, u64) {
        (u64::from(self.glossy[0]), u64::from(self.glossy[1]))
    }

    /// Mean radiance.
    pub fn radiance(&self) -> Color {
        self.parts.iter().sum::<Color>() * self.weight()
    }

    /// Variance of the luminance of the pixel's mean. The estimate takes samples as independent
    /// and channels as fully correlated.
    pub fn luminance_variance(&self) -> f32 {
        let v = self.variance();
        luminance(Color::new(v.x.sqrt(), v.y.sqrt(), v.z.sqrt())).powi(2)
    }

    /// Means of the parts of the radiance.
    pub fn parts(&self) -> Parts {
        self.parts.map(|sum| sum * self.weight())
    }

    /// Mean albedo.
    pub fn albedo(&self) -> Color {
        self.albedo * self.weight()
    }

    /// Unit mean normal; zero without a surface.
    pub fn normal(&self) -> Vec3 {
        self.normal.normalize_or_zero()
    }

    /// The shares of diffuse and of glossy indirect light that paths brought, not records; 1 where
    /// records were not asked.
    pub fn traced(&self) -> [f32; 2] {
        let share = |of_records: f32, all: f32| {
            if all > 0.0 { 1.0 - of_records / all } else { 1.0 }
        };
        let [glossy, cached] = self.glossy.map(|n| n as f32);
        [share(self.cached, self.cached + self.traced), share(cached, glossy)]
    }

    /// Mean of part `k` of the radiance.
    pub(super) fn part(&self, k: usize) -> Color {
        self.parts[k] * self.weight()
    }

    /// Mean position of the surfaces; zero without any.
    pub(super) fn position(&self) -> Vec3 {
        if self.covered > 0.0 { self.position / self.covered } else { Vec3::ZERO }
    }

    /// Mean distance of the surfaces; infinite without any.
    pub(super) fn distance(&self) -> f32 {
        if self.covered > 0.0 { self.distance / self.covered } else { f32::INFINITY }
    }

    /// Mean of the errors that records were allowed. Samples without a record do not count: the
    /// map shows how finely records were made.
    pub(super) fn allowed_error(&self) -> f32 {
        if self.cached > 0.0 { self.allowed / self.cached } else { 0.0 }
    }

    /// The share of one sample.
    pub(super) fn weight(&self) -> f32 {
        if self.samples > 0 { 1.0 / self.samples as f32 } else { 0.0 }
    }

    /// Variance of the pixel's mean. The estimate takes samples as independent; 0 below two
    /// samples.
    pub(super) fn variance(&self) -> Color {
        if self.samples < 2 {
            return Color::ZERO;
        }
        let mean = self.radiance();
        (self.squares * self.weight() - mean * mean).max(Color::ZERO) / (self.samples - 1) as f32
    }
}
