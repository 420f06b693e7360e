//! Geometry as Embree scenes.

use super::placement::{self, Placement};
use crate::error::Result;
use crate::ffi::embree::{BuildQuality, Device, Scene, SceneBuilder};
use crate::geometry::Geometry;
use std::sync::Arc;

/// One thread builds, so that equal input gives an equal hierarchy; no thread is pinned to a core, since the process may be a host's.
const OPTIONS: &str = "threads=1,set_affinity=0";

const QUALITY: BuildQuality = BuildQuality::Medium;

/// The geometry as a committed scene whose hits carry our instance and triangle numbers.
pub fn build(geometry: &Geometry) -> Result<Scene> {
    let device = Device::new(OPTIONS)?;
    let placement = Placement::of(geometry);
    let mut world = SceneBuilder::new(&device, QUALITY)?;
    let mut shared: Vec<Option<Arc<Scene>>> = vec![None; geometry.meshes.len()];
    for (i, instance) in geometry.instances.iter().enumerate() {
        let mesh = placement::mesh_of(geometry, i);
        if mesh.indices.is_empty() {
            continue;
        }
        let id = i as u32;
        if placement.to_object(i).is_none() {
            world.add_triangles(id, placement::world_positions(geometry, i).map(|p| p.to_array()), &mesh.indices)?;
            continue;
        }
        let slot = &mut shared[instance.mesh as usize];
        let scene = match slot {
            Some(scene) => scene,
            None => {
                let mut scene = SceneBuilder::new(&device, QUALITY)?;
                scene.add_triangles(0, mesh.positions.iter().map(|p| p.to_array()), &mesh.indices)?;
                slot.insert(Arc::new(scene.commit()?))
            }
        };
        world.add_instance(id, scene, &instance.to_world.to_cols_array())?;
    }
    world.commit()
}
