//! Pixels whose first samples found nothing.

use crate::support::pictures::{build, render, settings};
use crate::support::rooms::{diffuse, plane};
use lumicache::geometry::{Instance, TriangleMesh};
use lumicache::material::Material;
use lumicache::math::{Affine3A, Color, Vec3};
use lumicache::render::{IntegratorKind, Settings};
use std::sync::Arc;

/// A floor that a lamp lights by way of a mirror: a path finds it about once in a hundred samples.
/// The mean over many pictures is that of pictures in which all pixels get the same.
#[test]
fn rare_light_is_not_lost_where_pixels_get_more_samples() {
    let mut data = plane(diffuse());
    let square = |half: f32, x: f32, height: f32, up: f32, material| TriangleMesh {
        positions: [[-1.0, 1.0], [1.0, 1.0], [1.0, -1.0], [-1.0, -1.0]]
            .map(|[s, t]: [f32; 2]| Vec3::new(half * s + x, height, half * t * up))
            .to_vec()
            .into(),
        indices: vec![[0, 1, 2], [0, 2, 3]].into(),
        material,
        ..TriangleMesh::default()
    };
    for mesh in [square(3.0, 0.0, 3.0, -1.0, 1), square(0.3, 1.5, 0.5, 1.0, 2)] {
        let number = data.geometry.meshes.len() as u32;
        data.geometry.meshes.push(Arc::new(mesh));
        data.geometry.instances.push(Instance { mesh: number, to_world: Affine3A::IDENTITY });
    }
    data.materials.push(Material { roughness: 0.0, ..Material::default() });
    data.materials.push(Material { emission: Color::splat(50.0), ..Material::default() });
    let scene = build(data);
    let mean = |noise: f32, seed: u64| {
        let set = settings(&scene, IntegratorKind::Path, [32, 32], 4);
        let frame = render(&scene, &Settings { noise, seed, max_bounces: 3, ..set });
        let samples: u32 = frame.film.pixels().iter().map(|p| p.samples()).sum();
        (frame.film.mean_luminance(), samples)
    };
    let seeds = 400;
    let (mut sums, mut squares, mut refined) = ([0.0_f64; 2], [0.0_f64; 2], 0);
    for seed in 0..seeds {
        for (k, noise) in [0.0, 0.05].into_iter().enumerate() {
            let (mean, samples) = mean(noise, seed + 1000 * k as u64);
            sums[k] += f64::from(mean);
            squares[k] += f64::from(mean).powi(2);
            refined += u32::from(samples > 32 * 32 * 4);
        }
    }
    assert!(u64::from(refined) > seeds * 9 / 10, "{refined}");
    let n = seeds as f64;
    let [even, adaptive] = sums.map(|s| s / n);
    let variance = [0, 1].map(|k| (squares[k] / n - (sums[k] / n).powi(2)) / n);
    let deviation = (variance[0] + variance[1]).sqrt();
    assert!(even > 0.0 && deviation < 0.03 * even, "{even} ± {deviation}");
    // A false alarm in 15 000 runs.
    assert!((adaptive - even).abs() < 4.0 * deviation, "{adaptive} is not {even} ± {deviation}");
}
