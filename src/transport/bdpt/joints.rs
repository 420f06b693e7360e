//! Light paths joined with the point of a gather, so that one sample of it has several sources
//! [Ribardiere11, Fig. 1].

use super::light_walk::{Follower, walk_from_light};
use super::vertex::Vertex;
use crate::accel::Ray;
use crate::gather::{Bundle, Joint};
use crate::geometry::SurfacePoint;
use crate::light::{EmissionSampler, Focus};
use crate::material::Bsdf;
use crate::math::{Color, Vec3};
use crate::sampling::{LONGEST_PATH, hash, stream};
use crate::transport::path::PathTracer;

/// Joints under a smaller cosine at either end are left out; light that is lost so is found by no
/// ray either.
const GRAZING: f32 = 1e-3;

/// Light paths for gathers.
///
/// Whether light comes to the point x of a gather from y on the way of a ray from x, or on that of
/// a light path that visits y, is decided by weights that depend on x and y alone: `p/(p + q)` for
/// rays, p being their density per area at y, and `q/(p + q)` for light paths, with q one path for
/// each so much of that surface. They sum to one whatever lies behind y, so that rays may
/// end in caches there. They take away, too, what makes joints of near points bright. Only surfaces
/// without gloss take part: light paths cannot be joined to mirrors.
pub(in crate::transport) struct LightPaths<'a> {
    tracer: PathTracer<'a>,
    emission: EmissionSampler<'a>,
    /// Area of the surface that gathers see, estimated.
    area: f32,
}

/// Joins the vertices of light paths with the point of a gather, but for what lies between.
struct Joining<'a> {
    paths: &'a LightPaths<'a>,
    from: &'a SurfacePoint,
    bundle: &'a Bundle,
    rays: Vec<Ray>,
    joints: Vec<Joint>,
}

/// A surface that light paths may be joined to.
fn joinable(bsdf: &Bsdf) -> bool {
    bsdf.has_diffuse() && !bsdf.has_glossy() && !bsdf.transmits()
}

impl<'a> LightPaths<'a> {
    /// Of the lights of `tracer`'s scene, for gathers in the focus.
    pub fn new(tracer: PathTracer<'a>, focus: Option<Focus>) -> Self {
        let bounds = tracer.scene.bounds();
        let size = if bounds.is_empty() { Vec3::ONE } else { bounds.max - bounds.min };
        let walls = 2.0 * (size.x * size.y + size.y * size.z + size.z * size.x);
        // The walls of the cube in the focus: surfaces far from there say nothing of its own.
        let walls = focus.map_or(walls, |focus| walls.min(8.0 * focus.radius * focus.radius));
        Self {
            tracer,
            emission: tracer.scene.emission_sampler(focus),
            area: walls.max(f32::MIN_POSITIVE),
        }
    }

    /// q, for `paths` light paths.
    fn density(&self, paths: u32) -> f32 {
        paths as f32 / self.area
    }

    /// The weight of a ray with the density `pdf` per steradian, of all `rays` together, that met a
    /// surface with this BSDF at `distance` under the cosine `cos`.
    pub fn weight_of_ray(
        &self, bundle: &Bundle, bsdf: &Bsdf, pdf: f32, cos: f32, distance: f32,
    ) -> f32 {
        if !joinable(bsdf) || cos < GRAZING {
            return 1.0;
        }
        let p = bundle.len() as f32 * pdf * cos / (distance * distance);
        p / (p + self.density(bundle.light_paths))
    }

    /// Joins the light paths that `bundle` asks for with `from`, on `level`. Returns the number of
    /// joining rays.
    pub fn join(&self, from: &SurfacePoint, level: u8, bundle: &mut Bundle) -> u64 {
        // Interactions before the vertex that is joined: it and the point of the gather follow.
        let most = self.tracer.max_bounces.min(LONGEST_PATH).saturating_sub(u32::from(level));
        let mut joining =
            Joining { paths: self, from, bundle, rays: Vec::new(), joints: Vec::new() };
        for number in 0..bundle.light_paths {
            let walk = (hash(&[bundle.seed, stream::LIGHT_PATHS]), number);
            walk_from_light(&self.tracer, &self.emission, walk, most as usize, &mut joining);
        }
        let Joining { rays, joints, .. } = joining;
        let mut blocked = vec![false; rays.len()];
        self.tracer.scene.occluded_many(&rays, &mut blocked);
        bundle.joints.extend(
            joints.into_iter().zip(blocked).filter(|(_, blocked)| !blocked).map(|(joint, _)| joint),
        );
        rays.len() as u64
    }
}

impl Follower for Joining<'_> {
    fn arrive(&mut self, vertex: Vertex, _: f32, _: Vec3) {
        let (scene, from) = (self.paths.tracer.scene, self.from);
        let offset = vertex.point.position - from.position;
        let squared = offset.length_squared();
        let distance = squared.sqrt();
        let dir = offset / distance.max(f32::MIN_POSITIVE);
        let (cos, cos_there) = (from.frame.n.dot(dir), -vertex.point.ng.dot(dir));
        if !joinable(&vertex.bsdf)
            || cos_there < GRAZING
            || cos < GRAZING
            || from.ng.dot(dir) <= 0.0
        {
            return;
        }
        let q = self.paths.density(self.bundle.light_paths);
        let p = self.bundle.len() as f32 * self.bundle.density.pdf(cos) * cos_there / squared;
        let scattering = vertex.of_light_path(scene, -dir);
        let light = vertex.beta * scattering.f * (vertex.light_cosine(-dir) * cos / squared);
        let light = light * vertex.transmittance(scene, -dir, distance);
        let irradiance = light * (q / (p + q) / self.bundle.light_paths as f32);
        if irradiance != Color::ZERO && irradiance.is_finite() {
            self.rays.push(scene.between(from, &vertex.point));
            self.joints.push(Joint {
                offset,
                normal: vertex.point.ng,
                irradiance,
                area: 1.0 / (p + q),
            });
        }
    }
}
