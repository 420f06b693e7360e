//! The records of one kind on one level with their index.

use super::index::{Answer, Index};
use crate::cache::payload::{Harmonics, Irradiance, Payload, Projector};
use crate::cache::record::{Envelope, RadiusRule, Record, clamp_to_neighbours};
use crate::cache::scheme::Scheme;
use crate::gather::{LobeCoefficients, StoredHit};
use crate::geometry::SurfacePoint;
use crate::math::{Color, Vec3};
use std::sync::Arc;

/// The scheme of one kind of records, and the length that its radii are relative to.
#[derive(Clone, Copy)]
pub(in crate::cache) struct Rules<'a> {
    pub scheme: &'a Scheme,
    pub extent: f32,
}

impl Rules<'_> {
    /// How far records are valid while `level` fills.
    pub fn while_filling(&self, level: u8) -> RadiusRule {
        RadiusRule::new(self.scheme, level, self.extent, 1.0)
    }

    /// How far records are valid once `level` is filled.
    pub fn when_filled(&self, level: u8) -> RadiusRule {
        RadiusRule::new(self.scheme, level, self.extent, self.scheme.validity.smoothing)
    }

    /// How far a record may lie in front of a point beside it.
    pub fn in_front(&self) -> f32 {
        1e-4 * self.extent
    }

    pub fn index<P: Payload>(&self, records: &[Record<P>], rule: RadiusRule) -> Index {
        Index::build(records, rule, self.scheme.validity.weight, self.in_front())
    }

    /// The longest radius of each of `records`, as shading uses them.
    pub fn radii<P>(&self, records: &[Record<P>]) -> Vec<f32> {
        let rule = self.when_filled(0);
        records.iter().map(|r| rule.area(r).0.longest()).collect()
    }

    /// `records` indexed as shading needs them.
    pub fn store<P: Payload>(&self, level: u8, records: Vec<Record<P>>) -> Store<P> {
        let index = Arc::new(self.index(&records, self.when_filled(level)));
        Store { records, index }
    }

    /// The same of records whose neighbours are not known to them yet.
    pub fn clamped_store<P: Payload>(&self, level: u8, mut records: Vec<Record<P>>) -> Store<P> {
        if self.scheme.clamping.neighbours() {
            let sites = records.iter().map(|r| (r.position, r.length_unclamped));
            let envelope = Envelope::build(sites);
            clamp_to_neighbours(&mut records, &envelope);
        }
        self.store(level, records)
    }
}

/// Records of one kind with their index.
pub struct Store<P> {
    records: Vec<Record<P>>,
    index: Arc<Index>,
}

impl<P: Payload> Store<P> {
    /// The records. Their positions in the slice are their ids, in the order in which they were
    /// made.
    pub fn records(&self) -> &[Record<P>] {
        &self.records
    }

    /// The index over them.
    pub fn index(&self) -> &Index {
        &self.index
    }

    /// Number of records.
    pub fn len(&self) -> usize {
        self.records.len()
    }

    /// True without records.
    pub fn is_empty(&self) -> bool {
        self.records.is_empty()
    }

    /// Interpolated irradiance at `at` from the records with ids below `limit`.
    #[inline]
    pub fn lookup(&self, at: &SurfacePoint, limit: u32) -> Option<Answer> {
        self.index.lookup(at, limit, |_| true)
    }

    /// Bytes that records and index occupy.
    pub fn bytes(&self) -> usize {
        let heap: usize = self.records.iter().map(|r| r.payload.heap_bytes()).sum();
        self.records.len() * size_of::<Record<P>>() + heap + self.index.bytes()
    }
}

impl Store<Harmonics> {
    /// The irradiance of the same records.
    pub(in crate::cache) fn irradiance(&self) -> Store<Irradiance> {
        let of = |r: &Record<Harmonics>| r.clone().map(|p| p.irradiance().clone());
        Store { records: self.records.iter().map(of).collect(), index: self.index.clone() }
    }

    /// Interpolated light at `at` from the records with ids below `limit`, with the radiance that
    /// leaves towards `at.wo` by the lobe with the coefficients `lobe`:
    ///
    /// ```text
    /// L = Σ w_i max(0, c · R_i (Λ_i + dx ∂Λ_i/∂x + dy ∂Λ_i/∂y)) / Σ w_i
    /// ```
    ///
    /// [Krivanek05, Eq. 12-13]. The gradient is applied before the rotation R_i from the record's
    /// frame to the point's. Instead of Λ_i the one vector c is rotated, by the inverse. Each
    /// record is clamped by itself. A tilted record is scaled so that its irradiance is what the
    /// rotational gradient predicts. `None` where no record is valid.
    pub fn lookup_lobe(
        &self, projector: &Projector, at: &SurfacePoint, limit: u32, lobe: &mut LobeCoefficients,
    ) -> Option<Answer> {
        let mut glossy = Color::ZERO;
        projector.prepare(at, lobe);
        let answer = self.index.lookup(at, limit, |v| {
            let held = &self.records[v.id as usize].payload;
            let answers = projector.answers(held, lobe);
            if answers {
                let offset = v.offset * v.slope;
                glossy += v.weight * projector.leaving(held, at, offset, v.irradiance, lobe);
            }
            answers
        })?;
        Some(Answer { glossy: glossy / answer.weight, ..answer })
    }

    /// As [`Store::lookup_lobe`], from the hits that the records keep:
    /// `reflect(hit, direction, solid angle)` is what the surface at `at` makes of one of them.
    pub fn lookup_hits(
        &self, at: &SurfacePoint, limit: u32,
        mut reflect: impl FnMut(&StoredHit, Vec3, f32) -> Color,
    ) -> Option<Answer> {
        let mut glossy = Color::ZERO;
        let answer = self.index.lookup(at, limit, |v| {
            for hit in self.records[v.id as usize].payload.hits() {
                if let Some((direction, solid_angle)) = hit.seen_from(at.position) {
                    glossy += v.weight * reflect(hit, direction, solid_angle);
                }
            }
            true
        })?;
        Some(Answer { glossy: glossy / answer.weight, ..answer })
    }
}
