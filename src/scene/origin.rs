//! The place of a scene's coordinates in the world.
//!
//! Single precision resolves a room in the middle of its coordinates far better than the same room
//! a thousand kilometres away, so a scene that lies far from the origin of its file is moved to its
//! own middle. [`SceneData::origin`] takes positions back.

use super::SceneData;
use crate::geometry::{Aabb, Geometry, Instance, TriangleMesh};
use glam::{DAffine3, DVec3};
use std::sync::Arc;

/// A scene this many times farther from the origin than it is large is moved.
const FAR: f64 = 8.0;
/// The same for a mesh and the origin of its own coordinates.
const FAR_MESH: f32 = 256.0;

/// An instance of a mesh, as the place of a scene is judged by it.
pub struct Part {
    /// Middle of its bounds in the world.
    pub middle: DVec3,
    /// Half the diagonal of its bounds.
    pub size: f64,
    /// How much detail it has: its number of triangles.
    pub weight: f64,
}

impl Part {
    /// The instance, with the transform `to_world`, of a mesh of `triangles` in `bounds`.
    pub fn new(bounds: &Aabb, triangles: usize, to_world: &DAffine3) -> Self {
        let (min, max) = (bounds.min.as_dvec3(), bounds.max.as_dvec3());
        let half = 0.5 * (max - min);
        let m = to_world.matrix3.abs();
        Self {
            middle: to_world.transform_point3(0.5 * (min + max)),
            size: (m * half).length(),
            weight: triangles as f64,
        }
    }
}

/// Where the zero of a scene's coordinates should be: along each axis the middle of its detail, so
/// that a few large triangles do not count, rounded to single precision; the origin where that is
/// near enough.
pub fn middle(parts: &[Part]) -> DVec3 {
    let median = |value: &dyn Fn(&Part) -> f64| {
        let mut values: Vec<(f64, f64)> = parts.iter().map(|p| (value(p), p.weight)).collect();
        values.sort_unstable_by(|a, b| a.0.total_cmp(&b.0));
        let half = 0.5 * values.iter().map(|v| v.1).sum::<f64>();
        let mut sum = 0.0;
        let found = values.iter().find(|(_, weight)| {
            sum += weight;
            sum >= half
        });
        found.map_or(0.0, |v| v.0)
    };
    let middle =
        DVec3::new(median(&|p| p.middle.x), median(&|p| p.middle.y), median(&|p| p.middle.z));
    let spread = median(&|p| (p.middle - middle).length() + p.size);
    if middle.abs().max_element() <= FAR * spread {
        return DVec3::ZERO;
    }
    let step = spread.log2().ceil().exp2();
    if step.is_normal() { (middle / step).round() * step } else { middle }
}

/// Moves the vertices of a mesh around the origin of its own coordinates where they lie far from
/// it. Returns by how much, which instances must be placed that much farther, and the mesh's bounds
/// from then on.
pub fn center(mesh: &mut Arc<TriangleMesh>) -> (DVec3, Aabb) {
    let bounds = mesh.positions.iter().fold(Aabb::EMPTY, |b, p| b.with(*p));
    let middle = bounds.center();
    if bounds.is_empty() || middle.abs().max_element() <= FAR_MESH * bounds.diagonal() {
        return (DVec3::ZERO, bounds);
    }
    let positions = Arc::make_mut(mesh).positions.to_mut();
    positions.iter_mut().for_each(|p| *p -= middle);
    (middle.as_dvec3(), Aabb { min: bounds.min - middle, max: bounds.max - middle })
}

impl SceneData {
    /// Moves meshes and instances that lie far from the origin of their coordinates to their own
    /// middle, and the lights along. For scenes without cameras.
    pub fn recenter(&mut self) {
        let (moved, bounds): (Vec<DVec3>, Vec<Aabb>) =
            self.geometry.meshes.iter_mut().map(center).unzip();
        let Geometry { meshes, instances } = &mut self.geometry;
        let place = |i: &Instance| {
            i.to_world.as_daffine3() * DAffine3::from_translation(moved[i.mesh as usize])
        };
        let placed: Vec<DAffine3> = instances.iter().map(place).collect();
        let part = |(i, to_world): (&Instance, &DAffine3)| {
            let mesh = i.mesh as usize;
            Part::new(&bounds[mesh], meshes[mesh].indices.len(), to_world)
        };
        let parts: Vec<Part> = instances.iter().zip(&placed).map(part).collect();
        let origin = middle(&parts);
        for (instance, to_world) in instances.iter_mut().zip(placed) {
            instance.to_world.translation = (to_world.translation - origin).as_vec3a();
        }
        self.punctual.iter_mut().for_each(|light| light.shift(-origin));
        self.origin += origin;
    }
}
