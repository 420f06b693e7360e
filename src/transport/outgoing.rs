//! Light that leaves a surface by its glossy lobes, for hosts that shade the rest themselves.

use super::path::{PathTracer, Sampled, Start};
use super::vertex::{Aim, Vertex};
use super::{CachedLobes, IndirectLight};
use crate::accel::Ray;
use crate::cache::Cache;
use crate::gather::{Deeper, LobeCoefficients};
use crate::geometry::SurfacePoint;
use crate::material::Lobe;
use crate::math::Color;
use crate::sampling::{Sampler, hash};

/// The surface is looked for around a point over this multiple of the point's error, and over this
/// share of its footprint.
const NEARBY: (f32, f32) = (64.0, 0.05);

impl PathTracer<'_> {
    /// The surface that passes through `at`, seen from `at.wo`; `None` if there is none. `seed`
    /// decides where it is partly transparent.
    pub(super) fn surface_at(&self, at: &SurfacePoint, seed: u64) -> Option<Vertex> {
        let radius = NEARBY.0 * at.error + NEARBY.1 * at.footprint;
        let towards = Ray {
            origin: at.position + radius * at.ng,
            tmin: 0.0,
            dir: -at.ng,
            tmax: 2.0 * radius,
        };
        let (mut point, _) = self.scene.intersect(&towards, seed)?;
        point.footprint = at.footprint;
        point.wo = at.wo;
        let bsdf = self.scene.shade(&mut point);
        Some(Vertex { point, bsdf })
    }

    /// Radiance towards `at.wo` of indirect light that the lobes of finite width other than the
    /// diffuse one reflect: from radiance records of the first level of `cache` where `lobes` are
    /// cached, else by `samples` paths that end in `cache`. What the first segment of a path sees
    /// shine is direct light and left out. `None` if no surface passes through the point.
    pub fn glossy_indirect(
        &self, at: &SurfacePoint, samples: u32, seed: u64, cache: &Cache,
        lobes: Option<CachedLobes>,
    ) -> Option<Color> {
        let vertex = self.surface_at(at, seed)?;
        let (point, bsdf) = (&vertex.point, &vertex.bsdf);
        if let Some(lobes) = lobes.filter(|_| !bsdf.is_delta_only()) {
            let mut lobe = LobeCoefficients::default();
            if let Some(order) = lobes.project(point, bsdf, None, &mut lobe.values) {
                lobe.order = order;
                if let Some(answer) = cache.lookup_lobe(0, point, u32::MAX, &mut lobe) {
                    return Some(answer.glossy);
                }
            }
        }
        let behind = cache.behind(0);
        let indirect = IndirectLight { lobes, ..(&behind as &dyn Deeper).into() };
        let mut sum = Color::ZERO;
        for i in 0..samples {
            let mut sampler = Sampler::new(seed, i);
            let Some((sample, next)) = self.scatter(&vertex, &mut sampler, Sampled::Glossy) else {
                continue;
            };
            if sample.lobe == Lobe::Delta {
                continue;
            }
            let start = Start { bounces: 0, aim: Aim::new(sample.pdf, vertex.origin(), next.dir) };
            let light = self.incoming(
                &next,
                &start,
                &mut sampler,
                hash(&[seed, u64::from(i)]),
                Some(indirect),
            );
            let arrived = sample.weight * light.indirect;
            if arrived.is_finite() {
                sum += arrived;
            }
        }
        Some(sum / samples.max(1) as f32)
    }
}
