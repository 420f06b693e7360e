//! Shading normals and tangents: repaired where the file's cannot be used, made where they are
//! needed and absent.

use crate::geometry::TriangleMesh;
use crate::math::{Frame, Vec2, Vec3, Vec4};
use bevy_mikktspace::TangentSpace;
use std::collections::HashMap;

/// Makes normals and tangents unit; a normal that has no direction gets that of the triangles
/// around it. Returns how many had none.
pub(super) fn normalize(mesh: &mut TriangleMesh) -> usize {
    let TriangleMesh { normals, tangents, positions, indices, .. } = mesh;
    let Some(normals) = normals else { return 0 };
    let mut lost = Vec::new();
    for (i, normal) in normals.iter_mut().enumerate() {
        match unit(*normal) {
            Some(unit) => *normal = unit,
            None => lost.push(i as u32),
        }
    }
    if !lost.is_empty() {
        let mut sums = vec![Vec3::ZERO; lost.len()];
        for triangle in indices.iter() {
            let [a, b, c] = triangle.map(|i| positions[i as usize]);
            for corner in triangle {
                if let Ok(k) = lost.binary_search(corner) {
                    sums[k] += (b - a).cross(c - a);
                }
            }
        }
        for (i, sum) in lost.iter().zip(sums) {
            normals[*i as usize] = unit(sum).unwrap_or(Vec3::Y);
        }
    }
    if let Some(tangents) = tangents {
        for (tangent, normal) in tangents.iter_mut().zip(normals) {
            let along = unit(tangent.truncate()).unwrap_or_else(|| Frame::from_normal(*normal).s);
            *tangent = along.extend(if tangent.w < 0.0 { -1.0 } else { 1.0 });
        }
    }
    lost.len()
}

/// The direction of a vector, also where its square leaves the range of single precision.
fn unit(v: Vec3) -> Option<Vec3> {
    v.as_dvec3().try_normalize().map(|v| v.as_vec3())
}

/// Tangents along the rising first coordinate of a texture, as a normal map needs them:
/// `coordinates` maps the mesh's set `uv_set` to the place in the image.
///
/// They are those of MikkTSpace, as the specification asks [glTF20, 3.7.2.1]. A vertex whose
/// corners have different ones is split; a mesh without normals is split into separate triangles.
pub(super) fn generate_tangents(
    mesh: &mut TriangleMesh, uv_set: usize, coordinates: impl Fn(Vec2) -> Vec2,
) {
    let Some(uv) = &mesh.uv[uv_set] else { return };
    let uv = uv.iter().map(|t| coordinates(*t)).collect();
    let mut corners = Corners { mesh, uv, tangents: vec![None; 3 * mesh.indices.len()] };
    // There is no error that it could return.
    let _ = bevy_mikktspace::generate_tangents(&mut corners);
    let made = corners.tangents;
    let mut places: HashMap<(u32, [u32; 4]), u32> = HashMap::new();
    let (mut source, mut tangents) = (Vec::new(), Vec::new());
    let flat = mesh.normals.is_none();
    for (corner, made) in mesh.indices.to_mut().as_flattened_mut().iter_mut().zip(made) {
        let axis = made.and_then(|t| unit(t.truncate()));
        let fallback =
            || mesh.normals.as_ref().map_or(Vec3::X, |n| Frame::from_normal(n[*corner as usize]).s);
        let tangent = axis.unwrap_or_else(fallback).extend(made.map_or(1.0, |t| t.w));
        let new = source.len() as u32;
        let place = match flat {
            true => new,
            false => *places.entry((*corner, tangent.to_array().map(f32::to_bits))).or_insert(new),
        };
        if place == new {
            source.push(*corner);
            tangents.push(tangent);
        }
        *corner = place;
    }
    select(mesh, &source);
    mesh.tangents = Some(tangents);
}

/// The corners of a mesh's triangles as MikkTSpace wants to see them.
struct Corners<'m> {
    mesh: &'m TriangleMesh,
    uv: Vec<Vec2>,
    tangents: Vec<Option<Vec4>>,
}

impl Corners<'_> {
    fn vertex(&self, face: usize, corner: usize) -> usize {
        self.mesh.indices[face][corner] as usize
    }
}

impl bevy_mikktspace::Geometry for Corners<'_> {
    fn num_faces(&self) -> usize {
        self.mesh.indices.len()
    }

    fn num_vertices_of_face(&self, _: usize) -> usize {
        3
    }

    fn position(&self, face: usize, corner: usize) -> [f32; 3] {
        self.mesh.positions[self.vertex(face, corner)].to_array()
    }

    fn normal(&self, face: usize, corner: usize) -> [f32; 3] {
        if let Some(normals) = &self.mesh.normals {
            return normals[self.vertex(face, corner)].to_array();
        }
        let [a, b, c] = self.mesh.indices[face].map(|i| self.mesh.positions[i as usize]);
        unit((b - a).cross(c - a)).unwrap_or(Vec3::Y).to_array()
    }

    /// The bitangent points up in the image, against the second coordinate.
    fn tex_coord(&self, face: usize, corner: usize) -> [f32; 2] {
        let uv = self.uv[self.vertex(face, corner)];
        [uv.x, -uv.y]
    }

    fn set_tangent(&mut self, made: Option<TangentSpace>, face: usize, corner: usize) {
        self.tangents[3 * face + corner] = made.map(|t| Vec4::from_array(t.tangent_encoded()));
    }
}

/// Replaces the vertices by those at the places `source`; indices stay as they are.
fn select(mesh: &mut TriangleMesh, source: &[u32]) {
    fn pick<T: Copy>(values: &mut Vec<T>, source: &[u32]) {
        *values = source.iter().map(|i| values[*i as usize]).collect();
    }
    pick(mesh.positions.to_mut(), source);
    mesh.normals.iter_mut().for_each(|v| pick(v, source));
    mesh.tangents.iter_mut().for_each(|v| pick(v, source));
    mesh.uv.iter_mut().flatten().for_each(|v| pick(v, source));
    mesh.colors.iter_mut().for_each(|v| pick(v, source));
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Two triangles in the xy plane that share the edge x = 0; the left one's texture is mirrored
    /// if asked for.
    fn quad(mirrored: bool) -> TriangleMesh {
        let left = if mirrored { 1.0 } else { -1.0 };
        TriangleMesh {
            positions: vec![Vec3::ZERO, Vec3::Y, Vec3::X, Vec3::NEG_X].into(),
            indices: vec![[0, 2, 1], [0, 1, 3]].into(),
            normals: Some(vec![Vec3::Z; 4]),
            uv: [Some(vec![Vec2::ZERO, Vec2::NEG_Y, Vec2::X, Vec2::new(left, 0.0)]), None],
            ..TriangleMesh::default()
        }
    }

    #[test]
    fn an_upright_texture_has_its_bitangent_up() {
        let mut mesh = quad(false);
        generate_tangents(&mut mesh, 0, |uv| uv);
        assert_eq!(mesh.positions.len(), 4);
        for tangent in mesh.tangents.unwrap() {
            assert!((tangent - Vec4::new(1.0, 0.0, 0.0, 1.0)).length() < 1e-6, "{tangent}");
        }
    }

    #[test]
    fn vertices_on_a_mirror_seam_are_split() {
        let mut mesh = quad(true);
        generate_tangents(&mut mesh, 0, |uv| uv);
        assert_eq!((mesh.positions.len(), mesh.normals.as_ref().unwrap().len()), (6, 6));
        let tangents = mesh.tangents.unwrap();
        for (triangle, wanted) in mesh
            .indices
            .iter()
            .zip([Vec4::new(1.0, 0.0, 0.0, 1.0), Vec4::new(-1.0, 0.0, 0.0, -1.0)])
        {
            for corner in triangle {
                assert!(
                    (tangents[*corner as usize] - wanted).length() < 1e-6,
                    "{}",
                    tangents[*corner as usize]
                );
            }
        }
        let corners = mesh.indices.map_positions(&mesh.positions);
        assert_eq!(corners, [[Vec3::ZERO, Vec3::X, Vec3::Y], [Vec3::ZERO, Vec3::Y, Vec3::NEG_X]]);
    }

    trait MapPositions {
        fn map_positions(&self, positions: &[Vec3]) -> Vec<[Vec3; 3]>;
    }

    impl MapPositions for [[u32; 3]] {
        fn map_positions(&self, positions: &[Vec3]) -> Vec<[Vec3; 3]> {
            self.iter().map(|t| t.map(|i| positions[i as usize])).collect()
        }
    }

    #[test]
    fn flat_meshes_get_a_tangent_per_triangle() {
        let mut mesh = quad(true);
        mesh.normals = None;
        generate_tangents(&mut mesh, 0, |uv| uv);
        assert_eq!((mesh.positions.len(), mesh.indices.len()), (6, 2));
        let signs: Vec<f32> = mesh.tangents.unwrap().iter().map(|t| t.w).collect();
        assert_eq!(signs, [1.0, 1.0, 1.0, -1.0, -1.0, -1.0]);
    }

    #[test]
    fn a_rotated_texture_turns_the_tangents() {
        let mut mesh = quad(false);
        // The image stands on its side: its first coordinate rises with the set's second one.
        generate_tangents(&mut mesh, 0, |uv| Vec2::new(uv.y, -uv.x));
        for tangent in mesh.tangents.unwrap() {
            assert!((tangent - Vec4::new(0.0, -1.0, 0.0, 1.0)).length() < 1e-6, "{tangent}");
        }
    }

    #[test]
    fn lost_normals_come_from_the_triangles_around() {
        let mut mesh = quad(false);
        mesh.normals = Some(vec![Vec3::ZERO, Vec3::splat(3e30), Vec3::Z, Vec3::Z]);
        assert_eq!(normalize(&mut mesh), 1);
        let normals = mesh.normals.unwrap();
        assert!((normals[0] - Vec3::Z).length() < 1e-6);
        assert!((normals[1].length() - 1.0).abs() < 1e-6);
    }
}
