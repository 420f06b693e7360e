//! How instances enter a hierarchy: flattened into the world, or sharing one hierarchy of their mesh.

use crate::error::{Error, Result};
use crate::geometry::{Geometry, TriangleMesh};
use crate::math::Vec3;

/// A mesh of at most this many triangles is copied for each of its instances: a hierarchy of its own would cost rays more than it saves in memory.
const SMALL: usize = 32;

/// Which meshes get a hierarchy of their own.
pub struct Placement {
    shared: Vec<bool>,
}

impl Placement {
    pub fn of(geometry: &Geometry) -> Self {
        let mut uses = vec![0_u32; geometry.meshes.len()];
        for instance in &geometry.instances {
            uses[instance.mesh as usize] += 1;
        }
        let shared = geometry.meshes.iter().zip(uses).map(|(mesh, uses)| uses > 1 && mesh.indices.len() > SMALL).collect();
        Self { shared }
    }

    /// True if the instances of mesh number `mesh` share one hierarchy in the mesh's own space.
    pub fn is_shared(&self, mesh: u32) -> bool {
        self.shared[mesh as usize]
    }
}

/// The positions of an instance's mesh in world space.
pub fn world_positions(geometry: &Geometry, instance: usize) -> impl ExactSizeIterator<Item = Vec3> + Clone {
    let to_world = geometry.instances[instance].to_world;
    mesh_of(geometry, instance).positions.iter().map(move |&p| to_world.transform_point3(p))
}

/// The mesh of an instance.
pub fn mesh_of(geometry: &Geometry, instance: usize) -> &TriangleMesh {
    &geometry.meshes[geometry.instances[instance].mesh as usize]
}

/// Checks that every index names something, so that nothing after this panics.
///
/// # Errors
/// `Error::InvalidArgument` that names the instance or mesh.
pub fn check(geometry: &Geometry) -> Result<()> {
    if u32::try_from(geometry.instances.len()).is_err_and(|_| true) || geometry.instances.len() == u32::MAX as usize {
        return Err(Error::InvalidArgument("more instances than 32 bits can number".into()));
    }
    for (i, instance) in geometry.instances.iter().enumerate() {
        if instance.mesh as usize >= geometry.meshes.len() {
            return Err(Error::InvalidArgument(format!("instance {i} refers to mesh {}, which does not exist", instance.mesh)));
        }
    }
    for (i, mesh) in geometry.meshes.iter().enumerate() {
        let vertices = mesh.positions.len();
        if let Some(triangle) = mesh.indices.iter().position(|t| t.iter().any(|&v| v as usize >= vertices)) {
            return Err(Error::InvalidArgument(format!(
                "mesh {i} ({}): triangle {triangle} refers to a vertex beyond its {vertices}",
                mesh.name
            )));
        }
    }
    Ok(())
}
