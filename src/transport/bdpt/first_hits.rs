//! Where light falls first.

use super::light_walk::{Follower, walk_from_light};
use super::vertex::Vertex;
use crate::geometry::SurfacePoint;
use crate::light::{EmissionSampler, Focus};
use crate::math::{Vec3, luminance};
use crate::transport::path::PathTracer;

/// Mirrors and panes that light may pass on its way.
const LONGEST: usize = 4;

/// Traces light to the first surface with a diffuse lobe.
pub(in crate::transport) struct FirstHits<'a> {
    tracer: PathTracer<'a>,
    emission: EmissionSampler<'a>,
}

/// Waits for a surface with a diffuse lobe.
#[derive(Default)]
struct Waiting {
    found: Option<Vertex>,
    done: bool,
}

impl<'a> FirstHits<'a> {
    /// Of the lights of `tracer`'s scene; light from infinity is wanted at the focus.
    pub fn new(tracer: PathTracer<'a>, focus: Option<Focus>) -> Self {
        Self { tracer, emission: tracer.scene.emission_sampler(focus) }
    }

    /// Where light path `number` of those of `seed` arrives, and the luminance of the flux that is
    /// reflected there.
    pub fn trace(&self, seed: u64, number: u32) -> Option<(SurfacePoint, f32)> {
        let mut waiting = Waiting::default();
        walk_from_light(&self.tracer, &self.emission, (seed, number), LONGEST, &mut waiting);
        let Vertex { point, bsdf, beta, .. } = waiting.found?;
        Some((point, luminance(beta * bsdf.diffuse_albedo(point.frame.to_local(point.wo)))))
    }
}

impl Follower for Waiting {
    fn arrive(&mut self, vertex: Vertex, _: f32, _: Vec3) {
        if vertex.bsdf.has_diffuse() {
            self.found = Some(vertex);
        }
        self.done = !vertex.bsdf.is_delta_only();
    }

    fn is_done(&self) -> bool {
        self.done
    }
}
