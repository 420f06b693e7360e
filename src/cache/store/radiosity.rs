//! All light that arrives at surfaces behind the first, direct light included: where traced rays
//! end.

use super::records::Store;
use crate::cache::payload::{Irradiance, Lit};
use crate::cache::record::Record;
use crate::gather::Arriving;
use crate::geometry::SurfacePoint;
use crate::math::{Color, Vec3, luminance};
use rayon::prelude::*;
use std::sync::Arc;

/// Where the direct light of two places that share a record differs by more than this share of all
/// light, direct light is sampled.
const SHARP: f32 = 0.25;

/// Records of all light, in which rays end behind the first surface.
pub struct Radiosity {
    store: Arc<Store<Irradiance>>,
    /// The radius of each record.
    radii: Vec<f32>,
}

impl Radiosity {
    /// The cache of the records in `store`, with these radii.
    pub(in crate::cache) fn new(store: Arc<Store<Irradiance>>, radii: Vec<f32>) -> Self {
        Self { store, radii }
    }

    /// The numbers of the records around which direct light changes fast: by what other records
    /// know, and by what it is at `samples`.
    pub(in crate::cache) fn sharp(&self, samples: &[(SurfacePoint, Color)]) -> Vec<u32> {
        let of_record = |r: &Record<Irradiance>| (r.position, r.normal, lit(r).irradiance);
        let of_sample = |(at, direct): &(SurfacePoint, Color)| (at.position, at.frame.n, *direct);
        let records = self.records().par_iter().map(of_record);
        let mut sharp: Vec<u32> = records
            .chain(samples.par_iter().map(of_sample))
            .flat_map_iter(|place| self.unlike(place))
            .collect();
        sharp.sort_unstable();
        sharp.dedup();
        sharp
    }

    /// The records that are valid at a place with this normal, but know of other direct light than
    /// that of the place.
    fn unlike(&self, (position, normal, direct): (Vec3, Vec3, Color)) -> Vec<u32> {
        let mut unlike = Vec::new();
        self.weights(&SurfacePoint::plain(position, normal), f32::INFINITY, |id, _| {
            let record = &self.records()[id as usize];
            let all = luminance(record.payload.irradiance.max(direct));
            if luminance((lit(record).irradiance - direct).abs()) > SHARP * all {
                unlike.push(id);
            }
        });
        unlike
    }

    /// The store of the records.
    pub(in crate::cache) fn store(&self) -> &Arc<Store<Irradiance>> {
        &self.store
    }

    /// The records. Their irradiance is that of all light, and `lit` the part of it that came
    /// straight from light sources.
    pub fn records(&self) -> &[Record<Irradiance>] {
        self.store.records()
    }

    /// Light at `at`, the weighted mean of the records that are valid: without direct light where
    /// that changes fast, and where one of them has a radius above `longest`. `None` where none is
    /// valid.
    #[inline]
    pub fn lookup(&self, at: &SurfacePoint, longest: f32) -> Option<Arriving> {
        let (mut sum, mut of_lights, mut weights) = (Color::ZERO, Color::ZERO, 0.0);
        let all = self.weights(at, longest, |id, w| {
            let record = &self.records()[id as usize];
            sum += w * record.payload.irradiance;
            of_lights += w * lit(record).irradiance;
            weights += w;
        });
        let sum = if all { sum } else { (sum - of_lights).max(Color::ZERO) };
        (weights > 0.0).then(|| Arriving { irradiance: sum / weights, all })
    }

    /// Calls `visit` with the number and the weight of each record that [`Radiosity::lookup`] takes
    /// the mean of. Returns whether direct light is part of that mean.
    #[inline]
    pub fn weights(
        &self, at: &SurfacePoint, longest: f32, mut visit: impl FnMut(u32, f32),
    ) -> bool {
        let mut all = true;
        self.store.index().lookup(at, u32::MAX, |v| {
            let sharp = lit(&self.records()[v.id as usize]).sharp;
            all &= !sharp && self.radii[v.id as usize] <= longest;
            visit(v.id, v.weight);
            false
        });
        all
    }

    /// Bytes that are held beside the store.
    pub fn bytes(&self) -> usize {
        size_of_val(&self.radii[..])
    }
}

fn lit(record: &Record<Irradiance>) -> Lit {
    record.payload.lit.unwrap_or_default()
}
