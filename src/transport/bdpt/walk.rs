//! The two random walks: one from the camera, one from a light.

use super::Bidirectional;
use super::light_walk::{Follower, walk_from_light};
use super::vertex::Vertex;
use super::weight::LightDensity;
use crate::light::{Emission, LightEnd, LightSource};
use crate::material::Lobe;
use crate::math::{Color, Vec2, Vec3};
use crate::sampling::{LONGEST_PATH, MAX_SURVIVAL, ROULETTE_AFTER, hash, stream};
use crate::scene::same_direction;
use crate::transport::path::{Sampled, split};
use crate::transport::vertex::{Aim, Panes};
use crate::transport::{CameraSample, Shaded, Surface};

/// A camera path: the camera and its surface vertices.
#[derive(Default)]
pub(super) struct CameraPath {
    pub vertices: Vec<Seen>,
    /// How it left the scene.
    pub escaped: Option<Escape>,
    /// The weights of the first scattering by the diffuse lobe and by the others, which what later
    /// vertices carry does not include.
    pub first: (Color, Color),
}

/// Where a camera path left the scene.
#[derive(Clone, Copy)]
pub(super) struct Escape {
    pub direction: Vec3,
    /// Density per steradian.
    pub density: f64,
    /// What the path carried.
    pub carried: Color,
    /// As [`Seen::straight`].
    pub straight: Option<Straight>,
}

/// What a camera path sees straight through panes: their number, and the density per steradian with
/// which the vertex before them sampled the direction.
#[derive(Clone, Copy)]
pub(super) struct Straight {
    pub panes: usize,
    pub density: f32,
}

/// A surface vertex of a camera path.
pub(super) struct Seen {
    pub vertex: Vertex,
    /// What the path carried on arrival, before absorption on the way.
    pub arrived: Color,
    /// Numbers that choose a light.
    pub choice: (f32, Vec2),
    /// Set where panes alone lie before the vertex and the one behind which light samples see it,
    /// too.
    pub straight: Option<Straight>,
}

/// A light path: its end on the light and its surface vertices.
#[derive(Default)]
pub(super) struct LightPath {
    pub end: Option<LightEnd>,
    /// Densities of the end.
    pub density: LightDensity,
    pub vertices: Vec<Vertex>,
    /// Density and direction of its first ray.
    first: (f32, Vec3),
    /// First vertices that it left as ideal panes.
    panes: usize,
    /// The density with which a camera path would have sampled the way back at the vertex behind
    /// them.
    pub back: f32,
}

impl LightPath {
    /// The number of panes between the light and the first of the first `vertices` vertices that
    /// scatters, if that lies straight behind them: light samples there are another way to make
    /// the path. Then panes are no vertices, as if their surface was not there.
    pub fn panes(&self, vertices: usize) -> usize {
        let count = self.panes.min(vertices - 1);
        let mut panes = Panes::NONE;
        for pair in self.vertices[..=count].windows(2) {
            let (point, onward) = (&pair[0].point, -pair[1].point.wo);
            let straight = same_direction(self.first.1, onward);
            panes.add(point.frame.n, onward.dot(point.ng) < 0.0, straight);
        }
        let behind = -self.vertices[count].point.wo;
        if panes.are_passed(self.first.1, behind) { count } else { 0 }
    }

    /// Density per area of the vertex behind `panes` panes.
    pub fn forward(&self, panes: usize) -> f64 {
        let (vertex, (density, dir)) = (&self.vertices[panes], self.first);
        match self.end {
            Some(end) if !end.distant => vertex.per_area(density, end.position),
            _ => vertex.per_area_of_parallel(density, dir),
        }
    }
}

impl Bidirectional<'_> {
    /// Most surfaces that scatter on one path.
    pub(super) fn most_surfaces(&self) -> usize {
        self.tracer.max_bounces.min(LONGEST_PATH) as usize + 1
    }

    /// Walks from the camera; notes the first surface in `out`.
    pub(super) fn walk_from_camera(
        &self, sample: &CameraSample, path: &mut CameraPath, out: &mut Shaded,
    ) {
        path.vertices.clear();
        path.escaped = None;
        let (mut sampler, seed, mut ray) =
            (sample.sampler.clone(), sample.alpha_seed(), sample.ray());
        // As the path tracer's: without the first scattering, whose weight is kept apart.
        let (mut beta, mut carried, mut spread) = (Color::ONE, Color::ONE, 1.0);
        let mut density = f32::INFINITY;
        let mut aim: Option<Aim> = None;
        loop {
            let count = path.vertices.len();
            let Some((raw, distance)) =
                self.tracer.scene.intersect(&ray, seed.wrapping_add(count as u64))
            else {
                path.escaped = Some(Escape {
                    direction: ray.dir,
                    density: f64::from(density),
                    carried: beta,
                    straight: straight(aim.as_ref(), ray.dir),
                });
                return;
            };
            let arrived = beta;
            let straight = straight(aim.as_ref(), ray.dir);
            if count > 0 {
                let left = self.tracer.scene.transmittance(&raw, distance);
                (beta, carried) = (beta * left, carried * left);
            }
            let mut vertex = Vertex::new(self.tracer.scene, raw, beta, 0.0);
            vertex.forward = match path.vertices.last() {
                None => {
                    out.surface = Some(Surface::new(
                        self.tracer.scene,
                        &vertex.point,
                        &vertex.bsdf,
                        distance,
                    ));
                    self.camera_density(&vertex)
                }
                Some(last) => vertex.per_area(density, last.vertex.point.position),
            };
            let choice = (sampler.next_2d(), sampler.next_1d());
            path.vertices.push(Seen { vertex, arrived, choice: (choice.1, choice.0), straight });
            // One surface more than may scatter: it may still be a lamp, or a pane before one.
            let ended = count >= self.most_surfaces();
            let pane = aim.is_some_and(|aim| aim.sees_through())
                && self.tracer.scene.is_pane(vertex.point.material);
            if ended && !pane || count > LONGEST_PATH as usize {
                return;
            }
            let Some((scattered, next)) =
                self.tracer.scatter(&vertex.site(), &mut sampler, Sampled::Everything)
            else {
                return;
            };
            let (to, single) = (next.dir, scattered.lobe == Lobe::Delta);
            density = if single { 1.0 } else { scattered.pdf };
            let here = Aim::new(scattered.pdf, vertex.site().origin(), to);
            let onward =
                aim.unwrap_or(here).onward(self.tracer.scene, &vertex.site(), &scattered, &next);
            if ended && onward.panes() == 0 {
                return;
            }
            aim = Some(onward);
            if count == 0 {
                path.first = split(&vertex.site(), &scattered);
            } else {
                beta *= scattered.weight;
            }
            carried *= scattered.weight;
            spread *= scattered.eta * scattered.eta;
            let back = if single { 1.0 } else { vertex.camera_density(to) };
            path.vertices[count].vertex.delta = single;
            if let [.., before, _] = &mut path.vertices[..] {
                before.vertex.backward = before.vertex.per_area(back, vertex.point.position);
            }
            if count >= ROULETTE_AFTER as usize {
                let survival = (carried.max_element() * spread).min(MAX_SURVIVAL);
                if sampler.next_1d() >= survival {
                    return;
                }
                (beta, carried) = (beta / survival, carried / survival);
            }
            ray = next;
        }
    }

    /// Density per area with which the camera makes the first vertex, all samples of the window
    /// taken together.
    fn camera_density(&self, vertex: &Vertex) -> f64 {
        let view = self.camera.view(vertex.point.position, self.size);
        view.map_or(0.0, |v| {
            f64::from(v.pixels_per_area * vertex.point.ng.dot(v.to_camera).abs()) / self.pixels()
        })
    }

    /// Walks from a light.
    pub(super) fn walk_from_light(&self, sample: &CameraSample, path: &mut LightPath) {
        path.vertices.clear();
        (path.end, path.panes) = (None, 0);
        let seed = hash(&[sample.seed, stream::LIGHT_WALK]);
        let mut builder = Builder { bidirectional: self, path };
        walk_from_light(
            &self.tracer,
            &self.emission,
            (seed, sample.index),
            self.most_surfaces(),
            &mut builder,
        );
    }

    /// Density with which light sampling at `vertex` finds the end of a light path.
    pub(super) fn sampled_density(&self, vertex: &Vertex, end: &LightEnd) -> f64 {
        let lights = self.tracer.scene.lights();
        let origin = vertex.site().origin();
        let (p, n) = (origin.position, origin.facing);
        match end.source {
            LightSource::Punctual(index) => f64::from(lights.pdf_punctual(p, n, index)),
            LightSource::Environment => f64::from(lights.pdf_environment(p, n, vertex.point.wo)),
            LightSource::Triangle { instance, triangle, .. } => {
                let offset = end.position - p;
                let distance = offset.length();
                let pdf =
                    lights.pdf_triangle(p, n, instance, triangle, offset / distance, distance);
                hit_density(end, pdf, p)
            }
        }
    }
}

/// What a ray along `dir`, aimed so, sees behind panes.
fn straight(aim: Option<&Aim>, dir: Vec3) -> Option<Straight> {
    let aim = aim.filter(|aim| aim.panes() > 0 && aim.is_straight(dir))?;
    Some(Straight { panes: aim.panes(), density: aim.pdf(dir) })
}

/// Keeps a walk from a light, with the densities that weights are made of.
struct Builder<'a, 'b> {
    bidirectional: &'a Bidirectional<'b>,
    path: &'a mut LightPath,
}

impl Follower for Builder<'_, '_> {
    fn begin(&mut self, start: &Emission) {
        self.path.end = Some(start.end);
        self.path.first = (start.ray_density, start.direction);
        self.path.density =
            LightDensity { emitted: f64::from(start.end_density), ..LightDensity::default() };
    }

    fn arrive(&mut self, mut vertex: Vertex, density: f32, dir: Vec3) {
        let path = &mut *self.path;
        vertex.forward = match (path.vertices.last(), path.end) {
            (Some(last), _) => vertex.per_area(density, last.point.position),
            (None, Some(end)) if end.distant => vertex.per_area_of_parallel(density, dir),
            (None, end) => {
                vertex.per_area(density, end.map_or(vertex.point.position, |e| e.position))
            }
        };
        if let (true, Some(end)) = (path.vertices.is_empty(), path.end) {
            path.density.sampled = self.bidirectional.sampled_density(&vertex, &end);
        }
        path.vertices.push(vertex);
    }

    /// Sets the density with which a camera path that comes by the last vertex makes the one before
    /// it, or the light's end.
    fn leave(&mut self, delta: bool, pane: bool, back: f32) {
        let LightPath { end, density, vertices, panes, back: behind, .. } = &mut *self.path;
        if vertices.len() == *panes + 1 {
            if pane {
                *panes += 1;
            } else {
                *behind = back;
            }
        }
        match (&mut vertices[..], end) {
            ([.., before, last], _) => {
                last.delta = delta;
                before.backward = before.per_area(back, last.point.position);
            }
            ([only], Some(end)) => {
                only.delta = delta;
                density.hit = hit_density(end, back, only.point.position);
            }
            _ => {}
        }
    }
}

/// The density of a light's end for a camera path that samples the direction to it with `density`
/// per steradian at `from`: per area of a surface, per steradian for the environment, 0 for a light
/// without extent.
pub(super) fn hit_density(end: &LightEnd, density: f32, from: Vec3) -> f64 {
    if end.delta {
        return 0.0;
    }
    if end.distant {
        return f64::from(density);
    }
    let offset = from - end.position;
    let squared = offset.length_squared();
    if squared > 0.0 {
        f64::from(density * end.normal.dot(offset).abs() / (squared * squared.sqrt()))
    } else {
        0.0
    }
}
