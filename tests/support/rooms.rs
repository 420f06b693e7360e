//! Closed boxes and planes of known radiance.

use crate::support::pictures::build;
use lumicache::camera::{Camera, Projection};
use lumicache::geometry::{Geometry, Instance, TriangleMesh};
use lumicache::material::Material;
use lumicache::math::{Affine3A, Color, Mat3, Vec3};
use lumicache::scene::{Scene, SceneData};
use std::sync::Arc;

pub const ALBEDO: Color = Color::new(0.2, 0.5, 0.7);
pub const EMISSION: Color = Color::new(1.0, 0.5, 0.3);
pub const SIZE: [u32; 2] = [24, 16];

pub fn diffuse() -> Material {
    Material { base_color: ALBEDO, metallic: 0.0, specular: 0.0, ..Material::default() }
}

/// The walls of the cube [-1, 1]³ seen from inside, front faces inwards, each a square of two
/// triangles.
pub fn cube(material: Material) -> SceneData {
    let mut mesh = TriangleMesh::default();
    for axis in 0..3 {
        for sign in [-1.0, 1.0_f32] {
            let n = -sign * Vec3::AXES[axis];
            let (s, t) = (Vec3::AXES[(axis + 1) % 3], n.cross(Vec3::AXES[(axis + 1) % 3]));
            let first = mesh.positions.len() as u32;
            mesh.positions.to_mut().extend([-s - t, s - t, s + t, -s + t].map(|p| p - n));
            mesh.indices
                .to_mut()
                .extend([[first, first + 1, first + 2], [first, first + 2, first + 3]]);
        }
    }
    scene_of(
        mesh,
        Material { double_sided: true, ..material },
        Vec3::new(-0.5, 0.3, 0.7),
        Vec3::new(1.0, -0.8, -0.6),
    )
}

/// A square of side 2 in the plane y = 0, seen from above.
pub fn plane(material: Material) -> SceneData {
    let positions = vec![
        Vec3::new(-1.0, 0.0, 1.0),
        Vec3::new(1.0, 0.0, 1.0),
        Vec3::new(1.0, 0.0, -1.0),
        Vec3::new(-1.0, 0.0, -1.0),
    ];
    let mesh = TriangleMesh {
        positions: positions.into(),
        indices: vec![[0, 1, 2], [0, 2, 3]].into(),
        ..TriangleMesh::default()
    };
    scene_of(mesh, material, Vec3::new(0.0, 1.0, 0.2), Vec3::ZERO)
}

pub fn scene_of(mesh: TriangleMesh, material: Material, eye: Vec3, target: Vec3) -> SceneData {
    let back = (eye - target).normalize();
    let right = Vec3::Y.cross(back).normalize();
    let camera = Camera {
        name: "camera".into(),
        projection: Projection::Perspective { yfov: 1.0 },
        aspect: None,
        to_world: Affine3A::from_mat3_translation(
            Mat3::from_cols(right, back.cross(right), back),
            eye,
        ),
        clip: Camera::NO_CLIP,
    };
    let geometry = Geometry {
        meshes: vec![Arc::new(mesh)],
        instances: vec![Instance { mesh: 0, to_world: Affine3A::IDENTITY }],
    };
    SceneData { geometry, materials: vec![material], cameras: vec![camera], ..SceneData::default() }
}

/// A furnace of `material` that glows.
pub fn furnace(material: Material) -> Scene {
    build(cube(Material { emission: EMISSION, ..material }))
}
