//! The random walk from a light.

use super::vertex::Vertex;
use crate::accel::Ray;
use crate::geometry::SurfacePoint;
use crate::light::{Emission, EmissionSampler};
use crate::material::Lobe;
use crate::math::{Color, Vec3};
use crate::sampling::{LONGEST_PATH, MAX_SURVIVAL, ROULETTE_AFTER, Sampler, hash};
use crate::transport::path::{PathTracer, Sampled};

/// Who follows a walk.
pub(super) trait Follower {
    /// The light was chosen; `emitted` is what it sends along the first ray.
    fn begin(&mut self, start: &Emission) {
        let _ = start;
    }

    /// A vertex was met by a ray along `dir`, which was sampled with `density`: per steradian, or
    /// per area of the front where the light is distant; 1 behind a delta lobe.
    fn arrive(&mut self, vertex: Vertex, density: f32, dir: Vec3);

    /// The walk left the last vertex by a delta lobe, or not, and by one of an ideal `pane`; `back`
    /// is the density with which a camera path would have sampled the way back.
    fn leave(&mut self, delta: bool, pane: bool, back: f32) {
        let _ = (delta, pane, back);
    }

    /// The walk may end.
    fn is_done(&self) -> bool {
        false
    }
}

/// Walk number `number` of those of `seed` from a light of `emission`, over at most `most`
/// vertices, panes before the first other one not counted.
pub(super) fn walk_from_light(
    tracer: &PathTracer, emission: &EmissionSampler, (seed, number): (u64, u32), most: usize,
    follower: &mut impl Follower,
) {
    let scene = tracer.scene;
    let mut sampler = Sampler::new(seed, number);
    let (place, turn, select) = (sampler.next_2d(), sampler.next_2d(), sampler.next_1d());
    let Some(start) = emission.sample(select, place, turn) else { return };
    let emitted = scene.sent(start.end.source, start.emitted, -start.direction);
    follower.begin(&start);
    let origin = match start.end.normal {
        Vec3::ZERO => start.origin,
        normal => SurfacePoint::plain(start.origin, normal).leave(start.direction),
    };
    let mut ray = Ray { origin, tmin: 0.0, dir: start.direction, tmax: f32::INFINITY };
    let (mut beta, mut density) = (emitted * start.measure, start.ray_density);
    let (mut first, mut last): (Color, Option<Vertex>) = (Color::ONE, None);
    let alpha = hash(&[seed, u64::from(number)]);
    let mut panes = 0;
    for count in 0..LONGEST_PATH as usize {
        let Some((raw, distance)) = scene.intersect(&ray, alpha.wrapping_add(count as u64)) else {
            return;
        };
        match &last {
            None => {
                beta *= emission.window(&start.end, distance);
                first = beta;
            }
            Some(last) => beta *= last.transmittance(scene, ray.dir, distance),
        }
        if beta == Color::ZERO || !beta.is_finite() {
            return;
        }
        let vertex = Vertex::new(scene, raw, beta, 0.0);
        follower.arrive(vertex, density, ray.dir);
        let at_end = count + 1 >= most + panes && !scene.is_pane(vertex.point.material);
        if at_end || follower.is_done() {
            return;
        }
        if count >= ROULETTE_AFTER as usize {
            let survival = (beta.max_element() / first.max_element()).min(MAX_SURVIVAL);
            if sampler.next_1d() >= survival {
                return;
            }
            beta /= survival;
        } else {
            // The next set of numbers starts with the lobe and the direction.
            sampler.next_1d();
        }
        let Some((scattered, next)) =
            tracer.scatter(&vertex.site(), &mut sampler, Sampled::Everything)
        else {
            return;
        };
        let delta = scattered.lobe == Lobe::Delta;
        let pane = delta && scene.is_pane(vertex.point.material);
        if pane && panes == count {
            panes += 1;
        } else if count + 1 >= most + panes {
            return;
        }
        density = if delta { 1.0 } else { scattered.pdf };
        let back = if delta {
            // Light loses nothing by the change of its solid angle, and the cosines of shading
            // normals are not those of a camera path.
            let corrected =
                vertex.light_cosine(next.dir) / vertex.point.frame.n.dot(next.dir).abs();
            beta *= scattered.weight * (scattered.eta * scattered.eta * corrected);
            1.0
        } else {
            let scattering = vertex.of_light_path(scene, next.dir);
            beta *= scattering.f * (vertex.light_cosine(next.dir) / scattered.pdf);
            scattering.to_light
        };
        follower.leave(delta, pane, back);
        (ray, last) = (next, Some(vertex));
    }
}
