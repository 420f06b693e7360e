//! Light that leaves a surface by its glossy lobes, for hosts that shade the rest themselves.

use super::Known;
use super::path::{PathTracer, Sampled, Start, Vertex};
use crate::accel::Ray;
use crate::geometry::SurfacePoint;
use crate::material::Lobe;
use crate::math::Color;
use crate::sampling::{Sampler, hash};

/// The surface is looked for this share of the scene's diagonal around a point.
const NEARBY: f32 = 1e-4;

impl PathTracer<'_> {
    /// The surface that passes through `at`, seen from `at.wo`; `None` if there is none. `seed`
    /// decides where it is partly transparent.
    pub(super) fn surface_at(&self, at: &SurfacePoint, seed: u64) -> Option<Vertex> {
        let reach = NEARBY * self.scene.size();
        let towards =
            Ray { origin: at.position + reach * at.ng, tmin: 0.0, dir: -at.ng, tmax: 2.0 * reach };
        let (mut point, _) = self.scene.intersect(&towards, seed)?;
        point.footprint = at.footprint;
        point.wo = at.wo;
        let bsdf = self.scene.shade(&mut point);
        Some(Vertex { point, bsdf })
    }

    /// Radiance towards `at.wo` of indirect light that the lobes of finite width other than the
    /// diffuse one reflect: from radiance records of the first level where those serve them, else
    /// by `samples` paths that end where light is `known`; what the first segment of a path
    /// sees shine is direct light and left out. `None` if no surface passes through the point.
    pub fn glossy_indirect(
        &self,
        at: &SurfacePoint,
        samples: u32,
        seed: u64,
        known: Known,
    ) -> Option<Color> {
        let vertex = self.surface_at(at, seed)?;
        if let Some(answer) = known.gloss.and_then(|g| g.first(&vertex)) {
            return Some(answer.glossy);
        }
        let mut sum = Color::ZERO;
        for i in 0..samples {
            let mut sampler = Sampler::new(seed, i);
            let Some((sample, next)) = self.scatter(&vertex, &mut sampler, Sampled::Glossy) else {
                continue;
            };
            if sample.lobe == Lobe::Delta {
                continue;
            }
            let start = Start { bounces: 0, pdf: sample.pdf, origin: vertex.origin() };
            let light = self.incoming(
                &next,
                &start,
                &mut sampler,
                hash(&[seed, u64::from(i)]),
                Some(known),
            );
            let arrived = sample.weight * light.indirect;
            if arrived.is_finite() {
                sum += arrived;
            }
        }
        Some(sum / samples.max(1) as f32)
    }
}
