//! The hierarchy in Rust: one over all triangles that stand in the world, one for each mesh that
//! instances share, and one over those instances.

use super::build::{Built, LIMIT, build};
use super::placement::{self, Placement};
use super::traverse::{self, Node, Walker};
use super::triangle::Triangle;
use crate::ffi::ray::{Hit, Ray};
use crate::geometry::Geometry;
use crate::math::{Affine3A, Vec3};
use glam::{DAffine3, Vec3A};
use obvhs::aabb::Aabb;

/// What builds the hierarchy.
pub const VERSION: &str = "obvhs CWBVH 0.4";

/// What [`Bvh::intersect`] walks.
pub struct Bvh {
    world: Triangles,
    meshes: Vec<Triangles>,
    instances: Vec<Node>,
    placed: Vec<Placed>,
}

/// Triangles of one space, in the order of their leaves.
#[derive(Default)]
struct Triangles {
    nodes: Vec<Node>,
    triangles: Vec<Triangle>,
    /// Instance and triangle number of each; the instance is unused for shared meshes.
    ids: Vec<[u32; 2]>,
}

/// An instance of a shared mesh.
#[derive(Clone, Copy)]
struct Placed {
    instance: u32,
    /// Index into [`Bvh::meshes`].
    mesh: u32,
    to_object: DAffine3,
}

impl Triangles {
    fn new(triangles: &[Triangle], ids: &[[u32; 2]]) -> Self {
        let bounds: Vec<_> =
            triangles.iter().map(|t| Aabb::from_points(&t.vertices().map(Into::into))).collect();
        let Built { nodes, order } = build(&bounds);
        Self {
            nodes,
            triangles: order.iter().map(|&i| triangles[i as usize]).collect(),
            ids: order.iter().map(|&i| ids[i as usize]).collect(),
        }
    }

    /// Shortens `tmax` to the closest hit and tells it in `hit`; `instance` replaces the one in
    /// `ids` for shared meshes.
    #[inline]
    fn intersect(
        &self, origin: Vec3, dir: Vec3, tmin: f32, tmax: &mut f32, instance: Option<u32>,
        hit: &mut Hit,
    ) {
        if self.nodes.is_empty() {
            return;
        }
        traverse::traverse(&self.nodes, &Walker::new(origin, dir, tmin), tmax, |i, tmax| {
            if let Some(found) = self.triangles[i as usize].intersect(origin, dir, tmin, *tmax) {
                let [own, triangle] = self.ids[i as usize];
                let instance = instance.unwrap_or(own);
                if found.t < hit.t || (instance, triangle) < (hit.instance, hit.triangle) {
                    *tmax = found.t;
                    *hit = Hit { t: found.t, u: found.u, v: found.v, instance, triangle };
                }
            }
            false
        });
    }

    #[inline]
    fn occluded(&self, origin: Vec3, dir: Vec3, tmin: f32, tmax: f32) -> bool {
        if self.nodes.is_empty() {
            return false;
        }
        let mut blocked = false;
        traverse::traverse(
            &self.nodes,
            &Walker::new(origin, dir, tmin),
            &mut { tmax },
            |i, tmax| {
                blocked = self.triangles[i as usize].intersect(origin, dir, tmin, *tmax).is_some();
                blocked
            },
        );
        blocked
    }

    fn memory_bytes(&self) -> usize {
        size_of_val(&*self.nodes) + size_of_val(&*self.triangles) + size_of_val(&*self.ids)
    }
}

/// Bounds in the world of an object-space box, widened by the rounding errors of the way there and
/// back.
fn world_bounds(bounds: &crate::geometry::Aabb, to_world: &Affine3A) -> Aabb {
    let corner = |i: u32| {
        let pick = |bit: u32, low: f32, high: f32| if i & bit == 0 { low } else { high };
        to_world.transform_point3(Vec3::new(
            pick(1, bounds.min.x, bounds.max.x),
            pick(2, bounds.min.y, bounds.max.y),
            pick(4, bounds.min.z, bounds.max.z),
        ))
    };
    let world = (0..8).map(corner).fold(crate::geometry::Aabb::EMPTY, crate::geometry::Aabb::with);
    let slack =
        Vec3::splat(4.0 * f32::EPSILON * world.min.abs().max(world.max.abs()).max_element());
    Aabb::new((world.min - slack).into(), (world.max + slack).into())
}

impl Bvh {
    /// Builds all hierarchies.
    pub fn new(geometry: &Geometry, placement: &Placement) -> Self {
        let (mut triangles, mut ids) = (Vec::new(), Vec::new());
        let mut meshes = Vec::new();
        let mut mesh_slot: Vec<Option<u32>> = vec![None; geometry.meshes.len()];
        let mut placed = Vec::new();
        let mut boxes = Vec::new();
        for (i, instance) in geometry.instances.iter().enumerate() {
            let mesh = placement::mesh_of(geometry, i);
            let Some(to_object) = placement.to_object(i) else {
                let positions: Vec<Vec3> = placement::world_positions(geometry, i).collect();
                for (k, corners) in (0_u32..).zip(&mesh.indices) {
                    if let Some(triangle) = Triangle::new(corners.map(|v| positions[v as usize])) {
                        triangles.push(triangle);
                        ids.push([i as u32, k]);
                    }
                }
                continue;
            };
            let slot = match mesh_slot[instance.mesh as usize] {
                Some(slot) => slot,
                None => {
                    let (own, own_ids): (Vec<_>, Vec<_>) = (0_u32..)
                        .zip(&mesh.indices)
                        .filter_map(|(k, c)| {
                            Some((Triangle::new(c.map(|v| mesh.positions[v as usize]))?, [0, k]))
                        })
                        .unzip();
                    meshes.push(Triangles::new(&own, &own_ids));
                    *mesh_slot[instance.mesh as usize].insert(meshes.len() as u32 - 1)
                }
            };
            let bounds = mesh
                .indices
                .iter()
                .flatten()
                .fold(crate::geometry::Aabb::EMPTY, |b, &v| b.with(mesh.positions[v as usize]));
            let bounds = world_bounds(&bounds, &instance.to_world);
            if bounds.min.abs().max(bounds.max.abs()).cmple(Vec3A::splat(LIMIT)).all() {
                placed.push(Placed { instance: i as u32, mesh: slot, to_object });
                boxes.push(bounds);
            }
        }
        let Built { nodes: instances, order } = build(&boxes);
        let placed = order.iter().map(|&i| placed[i as usize]).collect();
        Self { world: Triangles::new(&triangles, &ids), meshes, instances, placed }
    }

    /// The closest hit of one ray.
    pub fn intersect(&self, ray: &Ray) -> Hit {
        let mut hit = Hit::MISS;
        if !ray.is_valid() {
            return hit;
        }
        // An infinite distance is how a parallel triangle shows.
        let mut tmax = ray.tmax.min(f32::MAX);
        self.world.intersect(ray.origin, ray.dir, ray.tmin, &mut tmax, None, &mut hit);
        if !self.instances.is_empty() {
            traverse::traverse(
                &self.instances,
                &Walker::new(ray.origin, ray.dir, ray.tmin),
                &mut tmax,
                |i, tmax| {
                    let placed = &self.placed[i as usize];
                    let (origin, dir) = placed.object_ray(ray);
                    self.meshes[placed.mesh as usize].intersect(
                        origin,
                        dir,
                        ray.tmin,
                        tmax,
                        Some(placed.instance),
                        &mut hit,
                    );
                    false
                },
            );
        }
        hit
    }

    /// Whether anything is on one ray.
    pub fn occluded(&self, ray: &Ray) -> bool {
        let mut tmax = ray.tmax.min(f32::MAX);
        if !ray.is_valid() {
            return false;
        }
        if self.world.occluded(ray.origin, ray.dir, ray.tmin, tmax) {
            return true;
        }
        let mut blocked = false;
        if !self.instances.is_empty() {
            traverse::traverse(
                &self.instances,
                &Walker::new(ray.origin, ray.dir, ray.tmin),
                &mut tmax,
                |i, tmax| {
                    let placed = &self.placed[i as usize];
                    let (origin, dir) = placed.object_ray(ray);
                    blocked =
                        self.meshes[placed.mesh as usize].occluded(origin, dir, ray.tmin, *tmax);
                    blocked
                },
            );
        }
        blocked
    }

    /// The closest hits of many rays, one after another: this tracer has no packets.
    pub fn intersect_packets(&self, rays: &[Ray], _coherent: bool, hits: &mut [Hit]) {
        for (ray, hit) in rays.iter().zip(hits) {
            *hit = self.intersect(ray);
        }
    }

    /// Whether anything is on each of many rays.
    pub fn occluded_packets(&self, rays: &[Ray], blocked: &mut [bool]) {
        for (ray, blocked) in rays.iter().zip(blocked) {
            *blocked = self.occluded(ray);
        }
    }

    /// There is nothing below this interface to compare it to.
    pub fn bare_seconds(&self, _rays: &[Ray]) -> Option<f64> {
        None
    }

    /// Bytes of all hierarchies.
    pub fn memory_bytes(&self) -> usize {
        let meshes: usize = self.meshes.iter().map(Triangles::memory_bytes).sum();
        self.world.memory_bytes()
            + meshes
            + size_of_val(&*self.instances)
            + size_of_val(&*self.placed)
    }
}

impl Placed {
    /// Origin and direction of `ray` in the mesh's space; distances stay what they are.
    #[inline]
    fn object_ray(&self, ray: &Ray) -> (Vec3, Vec3) {
        // In single precision an origin far from a small instance would lose its last digits.
        let origin = self.to_object.transform_point3(ray.origin.as_dvec3());
        let dir = self.to_object.transform_vector3(ray.dir.as_dvec3());
        (origin.as_vec3(), dir.as_vec3())
    }
}
