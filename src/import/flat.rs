//! Meshes that their node's transform flattens.

use super::tangents;
use super::topology::drop_degenerate;
use crate::geometry::TriangleMesh;
use crate::math::{Vec3, Vec4};
use glam::{DAffine3, DMat3, DVec3};

/// A transform is flat where it shrinks one direction this much more than the others: less is left
/// of that direction than single precision knows of the others.
const FLAT: f64 = 1e-6;
/// Below this share even double precision does not know whether the transform mirrors.
const SIDELESS: f64 = 1e-12;

/// The matrix that takes normals to the world, up to a scale: where the matrix has an inverse, its
/// transpose times the determinant. Of a flattened object this is the normal of the plane.
fn cofactors(m: &DMat3) -> DMat3 {
    DMat3::from_cols(m.y_axis.cross(m.z_axis), m.z_axis.cross(m.x_axis), m.x_axis.cross(m.y_axis))
}

/// The determinant as a share of what the two longest directions alone would let it be; 0 for a
/// transform to a line or a point.
fn thickness(m: &DMat3) -> f64 {
    let longest = |m: &DMat3| m.x_axis.length().max(m.y_axis.length()).max(m.z_axis.length());
    let unit = *m * longest(m).max(f64::MIN_POSITIVE).recip();
    let area = longest(&cofactors(&unit));
    if area > SIDELESS { unit.determinant() / area } else { 0.0 }
}

/// True if instances under the transform are flat, so that nothing can be taken back from the world
/// to the mesh.
pub(super) fn is_flat(to_world: &DAffine3) -> bool {
    thickness(&to_world.matrix3).abs() < FLAT
}

/// The mesh in world space; without triangles where the transform leaves a line or a point of it.
pub(super) fn flattened(mesh: &TriangleMesh, to_world: &DAffine3) -> TriangleMesh {
    let linear = &to_world.matrix3;
    let mirrored = thickness(linear) < -SIDELESS;
    let of_normals = cofactors(linear) * if mirrored { -1.0 } else { 1.0 };
    // The longest column; of a flattened object all of them are along the normal of its plane.
    let plane = [of_normals.x_axis, of_normals.y_axis, of_normals.z_axis]
        .into_iter()
        .max_by(|a, b| a.length_squared().total_cmp(&b.length_squared()))
        .unwrap_or(DVec3::Y);
    let scale = plane.length().max(f64::MIN_POSITIVE).recip();
    let mut flat = mesh.clone();
    let to_plane = |p: &mut Vec3| *p = to_world.transform_point3(p.as_dvec3()).as_vec3();
    flat.positions.to_mut().iter_mut().for_each(to_plane);
    if mirrored {
        flat.indices.to_mut().iter_mut().for_each(|t| t.swap(1, 2));
    }
    let along = |v: Vec3| (*linear * v.as_dvec3()).normalize_or_zero().as_vec3();
    for n in flat.normals.iter_mut().flatten() {
        let world = of_normals * n.as_dvec3() * scale;
        // What looked along the plane says nothing of its side.
        *n = if world.length() > FLAT { world } else { plane * scale }.as_vec3();
    }
    let sign = if mirrored { -1.0 } else { 1.0 };
    for t in flat.tangents.iter_mut().flatten() {
        *t = Vec4::from((along(t.truncate()), sign * t.w));
    }
    drop_degenerate(flat.indices.to_mut(), &flat.positions);
    tangents::normalize(&mut flat);
    flat
}
