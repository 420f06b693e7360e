//! How instances enter a hierarchy: flattened into the world, or sharing one hierarchy of their
//! mesh.

use crate::error::{Error, Result};
use crate::ffi::ray::LIMIT;
use crate::geometry::{Geometry, Instance, TriangleMesh};
use crate::math::{Affine3A, Vec3};
use glam::DAffine3;

/// A mesh of at most this many triangles is copied for each of its instances: a hierarchy of its
/// own would cost rays more than it saves in memory.
const SMALL: usize = 32;

/// Largest number in the linear part of a shared instance's world-to-object map. Rays have numbers
/// up to [`crate::ffi::ray::LIMIT`], and Embree wants those of a ray in object space to stay below
/// 1.8e18.
const STEEPEST: f32 = 1e5;

/// Which instances share a hierarchy of their mesh; the others are flattened.
pub struct Placement {
    to_object: Vec<Option<DAffine3>>,
}

impl Placement {
    pub fn of(geometry: &Geometry) -> Self {
        let mut uses = vec![0_u32; geometry.meshes.len()];
        for instance in &geometry.instances {
            uses[instance.mesh as usize] += 1;
        }
        let place = |instance: &Instance| {
            let mesh = instance.mesh as usize;
            (uses[mesh] > 1 && geometry.meshes[mesh].indices.len() > SMALL)
                .then(|| object_map(&instance.to_world))
                .flatten()
        };
        Self { to_object: geometry.instances.iter().map(place).collect() }
    }

    /// The map from the world to the space of its mesh if the instance shares its mesh's hierarchy.
    pub fn to_object(&self, instance: usize) -> Option<DAffine3> {
        self.to_object[instance]
    }
}

/// Most by which the way to object space and back may multiply the rounding of a ray's origin
/// there, 3 for a rotation; what is bent out of shape more than that is flattened.
const MOST_ROUNDING: f64 = 8.0;

/// The inverse of `to_world`; `None` if rays could overflow or lose their precision there, as in an
/// instance that is almost flat.
fn object_map(to_world: &Affine3A) -> Option<DAffine3> {
    let map = to_world.as_daffine3().inverse();
    let [x, y, z] =
        [map.matrix3.x_axis, map.matrix3.y_axis, map.matrix3.z_axis].map(|axis| axis.abs());
    let in_range = x.max(y).max(z).max_element() <= f64::from(STEEPEST)
        && map.translation.abs().max_element() <= f64::from(STEEPEST * LIMIT);
    let there = map.matrix3.abs();
    let back = to_world.matrix3.as_dmat3().abs() * there;
    let rounding = (back.x_axis + back.y_axis + back.z_axis).max_element();
    (map.is_finite() && in_range && rounding <= MOST_ROUNDING).then_some(map)
}

/// The positions of an instance's mesh in world space.
pub fn world_positions(
    geometry: &Geometry, instance: usize,
) -> impl ExactSizeIterator<Item = Vec3> + Clone {
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
    let most = u32::MAX as usize;
    if geometry.instances.len() >= most
        || geometry.meshes.iter().any(|mesh| mesh.indices.len() >= most)
    {
        return Err(Error::InvalidArgument(
            "more instances or triangles than 32 bits can number".into(),
        ));
    }
    for (i, instance) in geometry.instances.iter().enumerate() {
        if instance.mesh as usize >= geometry.meshes.len() {
            return Err(Error::InvalidArgument(format!(
                "instance {i} refers to mesh {}, which does not exist",
                instance.mesh
            )));
        }
    }
    for (i, mesh) in geometry.meshes.iter().enumerate() {
        let vertices = mesh.positions.len();
        if let Some(triangle) =
            mesh.indices.iter().position(|t| t.iter().any(|&v| v as usize >= vertices))
        {
            return Err(Error::InvalidArgument(format!(
                "mesh {i} ({}): triangle {triangle} refers to a vertex beyond its {vertices}",
                mesh.name
            )));
        }
    }
    Ok(())
}
