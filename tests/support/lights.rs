//! Lights that tests sample.

use crate::support::statistics::*;
use lumicache::geometry::{Aabb, Geometry, Instance, TriangleMesh};
use lumicache::light::{Emitter, EnvironmentMap, LightSample, LightSource, Lights, PunctualLight};
use lumicache::math::{Affine3A, Color, Mat3, Vec3};
use std::sync::Arc;

/// One mesh with one instance for these triangles.
pub fn geometry(triangles: &[[Vec3; 3]]) -> Geometry {
    let mesh = TriangleMesh {
        positions: triangles.iter().flatten().copied().collect(),
        indices: (0..triangles.len() as u32).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect(),
        ..TriangleMesh::default()
    };
    Geometry {
        meshes: vec![Arc::new(mesh)],
        instances: vec![Instance { mesh: 0, to_world: Affine3A::IDENTITY }],
    }
}

pub fn emitter(triangle: usize, radiance: Color, double_sided: bool) -> Emitter {
    Emitter { instance: 0, triangle: triangle as u32, radiance, double_sided }
}

pub fn build(
    triangles: &[[Vec3; 3]], double_sided: bool, punctual: Vec<PunctualLight>,
    environment: Option<EnvironmentMap>,
) -> Lights {
    let geometry = geometry(triangles);
    let emitters = (0..triangles.len())
        .map(|i| emitter(i, Vec3::splat(1.0 + (i % 3) as f32), double_sided))
        .collect();
    let bounds = geometry.bounds().union(Aabb { min: Vec3::splat(-3.0), max: Vec3::splat(3.0) });
    Lights::build(&geometry, emitters, punctual, environment, bounds)
}

pub fn random_triangles(rng: &mut Rng, count: usize, size: f32) -> Vec<[Vec3; 3]> {
    (0..count)
        .map(|_| {
            let center = rng.cube() * 2.0;
            [(); 3].map(|()| center + rng.cube() * size)
        })
        .collect()
}

/// A map with a bright spot, a dark half and a smooth rest, 1 : 2 in size.
pub fn uneven_map(height: u32) -> EnvironmentMap {
    let width = 2 * height;
    let pixels = (0..width * height)
        .map(|i| {
            let (x, y) = (i % width, i / width);
            let spot = if (x, y) == (width / 5, height / 4) { 300.0 } else { 0.0 };
            let smooth = if 4 * y > 3 * height { 0.0 } else { 1.0 + (x as f32 * 0.3).sin() };
            Vec3::new(spot + smooth, spot + 0.5 * smooth, 0.25 * smooth)
        })
        .collect();
    let from_world = Affine3A::from_mat3(Mat3::from_rotation_y(0.7) * Mat3::from_rotation_x(0.2));
    EnvironmentMap { width, height, pixels, scale: 0.5, from_world }
}

/// The density of a sample as a BSDF sample in its direction would ask for it.
pub fn pdf_of(lights: &Lights, p: Vec3, n: Option<Vec3>, s: &LightSample) -> f32 {
    match s.source {
        LightSource::Triangle { instance, triangle, .. } => {
            lights.pdf_triangle(p, n, instance, triangle, s.wi, s.distance)
        }
        LightSource::Environment => lights.pdf_environment(p, n, s.wi),
        LightSource::Punctual(_) => s.pdf,
    }
}
