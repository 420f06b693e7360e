//! One cache record: where it lies and how far it is valid.

use super::area::Area;
use super::envelope::Envelope;
use super::fence::Fences;
use crate::math::Vec3;
use rayon::prelude::*;

/// A point at which light was gathered, with what is needed to use its light nearby. World space.
#[derive(Clone, Debug, PartialEq)]
pub struct Record<P> {
    /// Where the gather started.
    pub position: Vec3,
    /// Unit shading normal of the gather.
    pub normal: Vec3,
    /// What the record holds of the light there.
    pub payload: P,
    /// The lengths R_i as the gather gave them, clamped by the record's own gradient. Neighbours
    /// and pixels do not change them.
    pub shape: Area,
    /// What the neighbours allow each length to be [Krivanek06, Sec. 5.3]; infinite where the
    /// scheme does not clamp to neighbours.
    pub limit: f32,
    /// R_i: the shortest of `shape`.
    pub length_unclamped: f32,
    /// R_i after neighbour clamping: no more than `limit`.
    pub length: f32,
    /// a_i, the error up to which the record is used: the scheme's on this level, or less where
    /// the record was [refined](crate::cache::Cache::refine).
    pub error: f32,
    /// Diameter of a pixel at the record, world units.
    pub footprint: f32,
    /// Standard error of the luminance of the irradiance.
    pub sigma: f32,
    /// Planes behind which the record is not used.
    pub fences: Fences,
}

impl<P> Record<P> {
    /// The same record with another payload.
    pub fn map<Q>(self, payload: impl FnOnce(P) -> Q) -> Record<Q> {
        Record {
            position: self.position,
            normal: self.normal,
            payload: payload(self.payload),
            shape: self.shape,
            limit: self.limit,
            length_unclamped: self.length_unclamped,
            length: self.length,
            error: self.error,
            footprint: self.footprint,
            sigma: self.sigma,
            fences: self.fences,
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
    pub(in crate::cache) fn reshape(&mut self, shape: Area) {
        self.shape = shape;
        self.length_unclamped = shape.shortest();
        self.length = self.length_unclamped;
    }

    /// Bounds every length by `most`, as the gather gave it.
    pub fn shorten(&mut self, most: f32) {
        self.reshape(self.shape.map(|r| r.min(most)));
    }
}

/// Bounds the lengths of all records by those of the others, `envelope` being made of all of them.
pub(in crate::cache) fn clamp_to_neighbours<P: Send>(
    records: &mut [Record<P>], envelope: &Envelope,
) {
    records.par_iter_mut().enumerate().for_each(|(id, r)| {
        // The lowest value of another record: a record's own length does not bound its other axes.
        let [first, second] = envelope.lowest_two(r.position);
        r.clamp(if first.id == id as u32 { second.value } else { first.value });
    });
}
