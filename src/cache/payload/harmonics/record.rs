//! Radiance records: incident radiance in harmonics beside the irradiance.

use super::placement::Surroundings;
use super::vectors::Vectors;
use crate::cache::payload::irradiance::Irradiance;
use crate::gather::StoredHit;
use crate::math::{Color, Frame, Vec2, Vec3};

/// Incident radiance at a point in harmonics, and the irradiance there. What a glossy surface sends
/// to the viewer is the product of two vectors: the coefficients of the record and those of the
/// lobe [Krivanek05].
#[derive(Clone)]
pub struct Harmonics {
    pub(super) irradiance: Irradiance,
    /// The frame of its tangents.
    pub(super) frame: Frame,
    pub(super) order: usize,
    /// The coefficients and their derivatives along `frame.s` and `frame.t`.
    pub(super) vectors: Vectors,
    /// The direction towards the viewer that the record was made for.
    pub(super) wo: Vec3,
    /// What bounds the area besides the coefficients; `None` if those have no part in it.
    pub(super) surroundings: Option<Surroundings>,
    /// What the rays hit, if the scheme keeps hits.
    pub(super) hits: Vec<StoredHit>,
    /// How uncertain the light is, see [`crate::gather::HemisphereSamples::uncertainty`], in the
    /// frame of the coefficients; empty if the scheme does not ask.
    pub(super) uncertainty: Vec<f32>,
}

impl Harmonics {
    /// The product, channel by channel, of the coefficients extrapolated by `offset` with `c`, by
    /// no more vectors than `most`.
    pub(super) fn product(&self, offset: Vec3, c: [&[f32]; 3], most: usize) -> Color {
        let along = Vec2::new(offset.dot(self.frame.s), offset.dot(self.frame.t));
        self.vectors.product(along, c, most)
    }

    /// The hits of the gather, if the scheme keeps hits.
    pub(in crate::cache) fn hits(&self) -> &[StoredHit] {
        &self.hits
    }
}
