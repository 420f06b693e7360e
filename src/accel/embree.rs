//! Geometry as Embree scenes.

use super::placement::{self, Placement};
use crate::error::Result;
use crate::ffi::embree::{Device, Scene, SceneBuilder};
use crate::geometry::Geometry;
use std::sync::Arc;

/// No thread is pinned to a core, since the process may be a host's.
///
/// The number of threads is left alone. `threads=1` would limit all of TBB in the process, the
/// host's included, for as long as the device lives, and another device in the process would lift
/// the limit again; and no build with 1, 2 or 16 threads has differed from another in one bit of a
/// hit.
const OPTIONS: &str = "set_affinity=0";

/// The geometry as a committed scene whose hits carry our instance and triangle numbers.
pub fn build(geometry: &Geometry, placement: &Placement) -> Result<Scene> {
    build_on(&Device::new(OPTIONS)?, geometry, placement)
}

fn build_on(device: &Arc<Device>, geometry: &Geometry, placement: &Placement) -> Result<Scene> {
    let mut world = SceneBuilder::new(device)?;
    let mut shared: Vec<Option<Arc<Scene>>> = vec![None; geometry.meshes.len()];
    for (i, instance) in geometry.instances.iter().enumerate() {
        let mesh = placement::mesh_of(geometry, i);
        if mesh.indices.is_empty() {
            continue;
        }
        let id = i as u32;
        if placement.to_object(i).is_none() {
            world.add_triangles(
                id,
                placement::world_positions(geometry, i).map(|p| p.to_array()),
                &mesh.indices,
            )?;
            continue;
        }
        let slot = &mut shared[instance.mesh as usize];
        let scene = match slot {
            Some(scene) => scene,
            None => {
                let mut scene = SceneBuilder::new(device)?;
                scene.add_triangles(
                    0,
                    mesh.positions.iter().map(|p| p.to_array()),
                    &mesh.indices,
                )?;
                slot.insert(Arc::new(scene.commit()?))
            }
        };
        world.add_instance(id, scene, &instance.to_world.to_cols_array())?;
    }
    world.commit()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ffi::ray::{Hit, Ray};
    use crate::geometry::{Instance, TriangleMesh};
    use crate::math::{Affine3A, Vec3};

    /// A wavy sheet of `2 n²` triangles, each there twice, so that every hit is a tie.
    fn sheet(n: u32) -> Geometry {
        let at = |i: u32| i as f32 / n as f32;
        let positions = (0..(n + 1) * (n + 1)).map(|i| {
            let (x, y) = (at(i % (n + 1)), at(i / (n + 1)));
            Vec3::new(x, y, 0.1 * (9.0 * x).sin() * (7.0 * y).cos())
        });
        let corners = (0..n * n).map(|i| i / n * (n + 1) + i % n);
        let once = corners.flat_map(|a| [[a, a + 1, a + n + 2], [a, a + n + 2, a + n + 1]]);
        let mesh = TriangleMesh {
            positions: positions.collect(),
            indices: once.flat_map(|t| [t, t]).collect(),
            ..Default::default()
        };
        Geometry {
            meshes: vec![Arc::new(mesh)],
            instances: vec![Instance { mesh: 0, to_world: Affine3A::IDENTITY }],
        }
    }

    #[test]
    fn the_number_of_threads_that_build_does_not_change_a_bit() {
        let n = 200;
        let geometry = sheet(n);
        // Straight down, at vertices, on edges and inside.
        let rays: Vec<_> = (0..2 * n * n)
            .map(|i| {
                Ray::new(
                    Vec3::new(
                        (i % (2 * n)) as f32 / (2 * n) as f32,
                        (i / (2 * n)) as f32 / n as f32,
                        1.0,
                    ),
                    Vec3::NEG_Z,
                )
            })
            .collect();
        let trace = |options: &str| {
            let scene =
                build_on(&Device::new(options).unwrap(), &geometry, &Placement::of(&geometry))
                    .unwrap();
            let mut hits = vec![Hit::MISS; rays.len()];
            scene.intersect_packets(&rays, false, &mut hits);
            (hits, rays.iter().map(|ray| scene.intersect(ray)).collect::<Vec<_>>())
        };
        let one = trace("threads=1");
        assert!(one.0.iter().filter(|hit| hit.is_hit()).count() > rays.len() / 2);
        for _ in 0..4 {
            assert!(trace(OPTIONS) == one);
        }
    }
}
