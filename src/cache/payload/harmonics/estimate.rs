//! Radiance records as the fill and the refinement see them.

use super::projector::Projection;
use super::record::Harmonics;
use crate::cache::payload::irradiance::Irradiance;
use crate::cache::payload::kind::{Payload, Seen, diffuse};
use crate::cache::record::{RadiusRule, Record};
use crate::gather::{HemisphereSamples, LobeCoefficients};
use crate::geometry::SurfacePoint;
use crate::math::luminance;

impl Payload for Harmonics {
    type Context<'a> = Projection<'a>;
    const HOLDS_RADIANCE: bool = true;

    fn estimate(
        context: Projection, samples: &HemisphereSamples, at: &SurfacePoint, order: u8,
        irradiance: Record<Irradiance>, rule: &RadiusRule,
    ) -> Record<Self> {
        context.project(samples, at, order, irradiance, rule)
    }

    fn irradiance(&self) -> &Irradiance {
        &self.irradiance
    }

    fn heap_bytes(&self) -> usize {
        self.vectors.bytes() + size_of_val(&self.hits[..])
    }

    fn luminance(
        Projection { projector, .. }: Projection, record: &Record<Self>, seen: &Seen,
        rule: &RadiusRule, scratch: &mut LobeCoefficients,
    ) -> Option<(f32, f32)> {
        let (diffuse, irradiance, slope) = diffuse(record, seen, rule);
        if !seen.lobes.is_some_and(|lobes| lobes(seen.number, scratch)) {
            return Some(diffuse);
        }
        if !projector.answers(&record.payload, scratch) {
            return None;
        }
        projector.prepare(seen.at, scratch);
        let offset = slope * (seen.at.position - record.position);
        let leaving =
            projector.leaving_with_error(&record.payload, seen.at, offset, irradiance, scratch);
        // Both come from the same rays.
        Some((diffuse.0 + luminance(leaving.0), diffuse.1 + leaving.1))
    }
}
