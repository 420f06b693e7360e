//! Glossy reflection of the hits that records keep: slow, without harmonics and derivatives, to see
//! what those are worth.

use super::IndirectLight;
use super::path::{PathTracer, Start};
use super::points::position_hash;
use super::vertex::{Aim, Origin, Vertex};
use crate::cache::{Answer, Harmonics, Hits, Store};
use crate::gather::StoredHit;
use crate::geometry::SurfacePoint;
use crate::math::{Color, Vec3};
use crate::sampling::{Sampler, hash};

impl PathTracer<'_> {
    /// Radiance that leaves the hit `hit` along the unit direction `towards` to `from`, as a gather
    /// of the first level sees it: its indirect light where it is known by `indirect`, no emission.
    fn leaving(
        &self, hit: &StoredHit, (from, towards): (Origin, Vec3), seed: u64, indirect: IndirectLight,
    ) -> Color {
        let plain = SurfacePoint::plain(hit.position, hit.normal);
        let Some(vertex) = self.surface_at(&SurfacePoint { wo: towards, ..plain }, seed) else {
            return Color::ZERO;
        };
        let mut sampler = Sampler::new(seed, 0);
        let step = self.step(&vertex, f32::INFINITY, &mut sampler, 1, Some(indirect));
        let mut radiance = step.cached.sum();
        if let Some((shadow, lit)) = &step.light {
            radiance += lit.behind(self.scene.visibility(shadow, seed)).sum();
        }
        if let Some((sample, next)) = &step.next {
            let aim = Aim::new(0.0, from, -towards).onward(self.scene, &vertex, sample, next);
            let start = Start { bounces: 1, aim };
            let light = self.incoming(next, &start, &mut sampler, seed, Some(indirect));
            radiance += sample.weight * (light.direct + light.indirect);
        }
        if radiance.is_finite() { radiance } else { Color::ZERO }
    }

    /// The glossy reflection at `v` of the hits that `records` keep as `storage` says; with
    /// [`Hits::Retraced`] the light that leaves each of them towards `v` is found anew.
    pub(super) fn reflect_hits(
        &self, v: &Vertex, limit: u32, (records, storage): (&Store<Harmonics>, Hits),
        indirect: IndirectLight,
    ) -> Option<Answer> {
        let seed = position_hash(&v.point);
        let wo = v.point.frame.to_local(v.point.wo);
        let traced = storage == Hits::Retraced && self.max_bounces > 0;
        let mut number = 0;
        records.lookup_hits(&v.point, limit, |hit, direction, solid_angle| {
            number += 1;
            let wi = v.point.frame.to_local(direction);
            if wi.z <= 0.0 || direction.dot(v.point.ng) <= 0.0 {
                return Color::ZERO;
            }
            let share = v.bsdf.f_glossy(wo, wi) * (wi.z * solid_angle);
            if share == Color::ZERO || hit.normal == Vec3::ZERO || !traced {
                return share * hit.radiance;
            }
            let to = (v.origin(), -direction);
            share * self.leaving(hit, to, hash(&[seed, number]), indirect)
        })
    }
}
