//! Triangle meshes, their instances, and the points of their surfaces.

mod buffer;
mod extent;
mod surface;

pub use buffer::Buffer;
pub use extent::{extent, median_length};
pub use surface::{MAP_ROUNDING, SurfacePoint, interpolate};

use crate::math::{Affine3A, Vec2, Vec3, Vec4};
use std::sync::Arc;

/// Triangles with one material, in object space. Attribute arrays have one entry per position.
#[derive(Clone, Debug, Default)]
pub struct TriangleMesh {
    /// Name for messages.
    pub name: String,
    /// Vertex positions, finite.
    pub positions: Buffer<Vec3>,
    /// Vertex indices of each triangle, all below `positions.len()`; the front face is the one
    /// whose vertices run counter-clockwise.
    pub indices: Buffer<[u32; 3]>,
    /// Shading normals, unit length; `None` means flat shading.
    pub normals: Option<Vec<Vec3>>,
    /// Tangents for normal maps: xyz is a unit vector, w the sign of the bitangent.
    pub tangents: Option<Vec<Vec4>>,
    /// The two texture coordinate sets.
    pub uv: [Option<Vec<Vec2>>; 2],
    /// Vertex colours, linear RGBA, multiplied into the base colour.
    pub colors: Option<Vec<Vec4>>,
    /// Index into the scene's materials.
    pub material: u32,
}

/// A mesh placed in the world. Instances of one mesh share its geometry in memory.
#[derive(Clone, Debug)]
pub struct Instance {
    /// Index into the scene's meshes.
    pub mesh: u32,
    /// Object to world; may mirror (negative determinant), never singular.
    pub to_world: Affine3A,
}

/// What rays are traced against: meshes and where they stand.
#[derive(Clone, Debug, Default)]
pub struct Geometry {
    /// The distinct meshes.
    pub meshes: Vec<Arc<TriangleMesh>>,
    /// Their placements.
    pub instances: Vec<Instance>,
}

/// An axis-aligned box.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Aabb {
    /// Lowest corner.
    pub min: Vec3,
    /// Highest corner.
    pub max: Vec3,
}

impl Aabb {
    /// The box that contains nothing.
    pub const EMPTY: Self = Self { min: Vec3::INFINITY, max: Vec3::NEG_INFINITY };

    /// The smallest box that contains `self` and `p`.
    #[must_use]
    pub fn with(self, p: Vec3) -> Self {
        Self { min: self.min.min(p), max: self.max.max(p) }
    }

    /// The smallest box that contains both.
    #[must_use]
    pub fn union(self, other: Self) -> Self {
        Self { min: self.min.min(other.min), max: self.max.max(other.max) }
    }

    /// True if the box contains nothing.
    pub fn is_empty(&self) -> bool {
        !(self.min.x <= self.max.x && self.min.y <= self.max.y && self.min.z <= self.max.z)
    }

    /// Length of the diagonal, 0 when empty.
    pub fn diagonal(&self) -> f32 {
        if self.is_empty() { 0.0 } else { (self.max - self.min).length() }
    }

    /// True if a ray from `origin` meets the box; `inverse` holds one over each component of its
    /// direction, infinite ones for zeros.
    #[inline]
    pub fn is_met(&self, origin: Vec3, inverse: Vec3) -> bool {
        let (a, b) = ((self.min - origin) * inverse, (self.max - origin) * inverse);
        // A ray within the plane of a side gives 0 · ∞ there, which bounds nothing.
        let known = |v: Vec3, other: Vec3| Vec3::select(v.is_nan_mask(), -other, v);
        let (a, b) = (known(a, b), known(b, a));
        a.min(b).max_element().max(0.0) <= a.max(b).min_element()
    }

    /// Middle of the box.
    pub fn center(&self) -> Vec3 {
        0.5 * (self.min + self.max)
    }
}

impl Geometry {
    /// The three world-space corners of a triangle, in the order of its front face as seen in the
    /// world: a mirroring instance keeps the mesh's front face in front, as glTF demands.
    pub fn triangle(&self, instance: u32, triangle: u32) -> [Vec3; 3] {
        let inst = &self.instances[instance as usize];
        let mesh = &self.meshes[inst.mesh as usize];
        let [a, b, c] = mesh.indices[triangle as usize]
            .map(|i| inst.to_world.transform_point3(mesh.positions[i as usize]));
        if inst.to_world.matrix3.determinant() < 0.0 { [a, c, b] } else { [a, b, c] }
    }

    /// The instances alone whose mesh has a wanted material, under their old mesh numbers.
    pub fn of_materials(&self, is_wanted: impl Fn(u32) -> bool) -> Self {
        let wanted = |i: &&Instance| is_wanted(self.meshes[i.mesh as usize].material);
        let instances = self.instances.iter().filter(wanted).cloned().collect();
        Self { meshes: self.meshes.clone(), instances }
    }

    /// World-space bounds of every triangle.
    pub fn bounds(&self) -> Aabb {
        self.instances.iter().fold(Aabb::EMPTY, |bounds, inst| {
            let mesh = &self.meshes[inst.mesh as usize];
            mesh.indices.iter().flatten().fold(bounds, |b, &i| {
                b.with(inst.to_world.transform_point3(mesh.positions[i as usize]))
            })
        })
    }

    /// Number of triangles as seen by rays, instances counted each time.
    pub fn triangle_count(&self) -> usize {
        self.instances.iter().map(|i| self.meshes[i.mesh as usize].indices.len()).sum()
    }
}
