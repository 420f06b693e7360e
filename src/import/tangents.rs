//! Shading normals and tangents: repaired where the file's cannot be used, made where they are
//! needed and absent.

use crate::geometry::TriangleMesh;
use crate::math::{Frame, Vec2, Vec3, Vec4};

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
/// Each corner's tangent is weighted by the angle there and summed over the triangles around a
/// vertex. A vertex between triangles whose textures run left-handed and right-handed is split into
/// two; a mesh without normals is split into separate triangles.
pub(super) fn generate_tangents(
    mesh: &mut TriangleMesh, uv_set: usize, coordinates: impl Fn(Vec2) -> Vec2,
) {
    if mesh.uv[uv_set].is_none() {
        return;
    }
    if mesh.normals.is_none() {
        let corners: Vec<u32> = mesh.indices.as_flattened().to_vec();
        select(mesh, &corners);
        mesh.indices =
            (0..mesh.indices.len() as u32).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect();
    }
    let Some(uv) = &mesh.uv[uv_set] else { return };
    let uv: Vec<Vec2> = uv.iter().map(|t| coordinates(*t)).collect();
    // Left-handed triangles use a vertex's twin.
    let count = mesh.positions.len();
    let mut sums = vec![Vec3::ZERO; 2 * count];
    let mut used = vec![false; 2 * count];
    let mut handed = Vec::with_capacity(mesh.indices.len());
    for triangle in &mesh.indices {
        let [a, b, c] = triangle.map(|i| i as usize);
        let p = [a, b, c].map(|i| mesh.positions[i]);
        let (e1, e2) = (p[1] - p[0], p[2] - p[0]);
        let (t1, t2) = (uv[b] - uv[a], uv[c] - uv[a]);
        let area = t1.perp_dot(t2);
        // The bitangent points up in the image, against the second coordinate.
        let twin = if area > 0.0 { count } else { 0 };
        let tangent = unit((e1 * t2.y - e2 * t1.y) * area.signum()).unwrap_or(Vec3::ZERO);
        handed.push(twin);
        for (k, i) in [a, b, c].into_iter().enumerate() {
            let (to_next, to_last) = (p[(k + 1) % 3] - p[k], p[(k + 2) % 3] - p[k]);
            let normal = mesh.normals.as_ref().map_or_else(|| e1.cross(e2), |n| n[i]);
            let normal = unit(normal).unwrap_or(Vec3::Y);
            let flat = tangent - normal * normal.dot(tangent);
            let angle = to_next.angle_between(to_last);
            if let Some(flat) = unit(flat).filter(|_| angle.is_finite()) {
                sums[i + twin] += flat * angle;
            }
            used[i + twin] = true;
        }
    }
    // Split what both kinds use.
    let mut source: Vec<u32> = (0..count as u32).collect();
    let mut place: Vec<u32> = (0..count as u32).chain(0..count as u32).collect();
    let mut sign = vec![1.0; count];
    let mut tangents: Vec<Vec3> = sums[..count].to_vec();
    for i in 0..count {
        match (used[i], used[i + count]) {
            (false, true) => {
                sign[i] = -1.0;
                tangents[i] = sums[i + count];
            }
            (true, true) => {
                place[i + count] = source.len() as u32;
                source.push(i as u32);
                sign.push(-1.0);
                tangents.push(sums[i + count]);
            }
            _ => {}
        }
    }
    if source.len() > count {
        select(mesh, &source);
    }
    for (triangle, twin) in mesh.indices.iter_mut().zip(handed) {
        *triangle = triangle.map(|i| place[i as usize + twin]);
    }
    let fallback = |i: usize| mesh.normals.as_ref().map_or(Vec3::X, |n| Frame::from_normal(n[i]).s);
    let tangents = tangents
        .iter()
        .enumerate()
        .map(|(i, t)| unit(*t).unwrap_or_else(|| fallback(i)).extend(sign[i]));
    mesh.tangents = Some(tangents.collect::<Vec<Vec4>>());
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
