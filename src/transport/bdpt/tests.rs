//! The densities that the walks collect step by step are those of the whole paths, evaluated from
//! scratch.

use super::vertex::Vertex;
use super::weight::{LightDensity, weight};
use super::{Bidirectional, Workspace};
use crate::accel::Backend;
use crate::camera::{Camera, Projection};
use crate::geometry::{Geometry, Instance, TriangleMesh};
use crate::light::{EnvironmentMap, Focus, PunctualLight};
use crate::material::Material;
use crate::math::{Affine3A, Color, Vec3};
use crate::scene::{Scene, SceneData};
use crate::transport::{CameraSample, PathTracer, Shaded};
use std::sync::Arc;

/// A room without a front, with a diffuse floor, a glossy wall, a mirror, a lamp that shines both
/// ways, a sky, a point and a spot.
fn scene() -> Scene {
    let diffuse = Material {
        base_color: Color::splat(0.6),
        metallic: 0.0,
        specular: 0.0,
        double_sided: true,
        ..Material::default()
    };
    let glossy = Material { roughness: 0.5, metallic: 0.3, specular: 1.0, ..diffuse.clone() };
    let mirror = Material { roughness: 0.0, metallic: 1.0, ..diffuse.clone() };
    let lamp = Material { emission: Color::splat(4.0), ..diffuse.clone() };
    let quads = [
        // Floor, back wall, left wall, lamp below the ceiling.
        ([Vec3::new(-1.0, -1.0, 1.0), Vec3::X * 2.0, Vec3::Z * -2.0], 0),
        ([Vec3::new(-1.0, -1.0, -1.0), Vec3::X * 2.0, Vec3::Y * 2.0], 1),
        ([Vec3::new(-1.0, -1.0, 1.0), Vec3::Z * -2.0, Vec3::Y * 2.0], 2),
        ([Vec3::new(-0.3, 0.8, -0.3), Vec3::X * 0.6, Vec3::Z * 0.6], 3),
    ];
    let mut geometry = Geometry::default();
    for (k, ([corner, u, v], material)) in quads.into_iter().enumerate() {
        let positions = vec![corner, corner + u, corner + u + v, corner + v];
        let mesh = TriangleMesh {
            positions: positions.into(),
            indices: vec![[0, 1, 2], [0, 2, 3]].into(),
            material,
            ..TriangleMesh::default()
        };
        geometry.meshes.push(Arc::new(mesh));
        geometry.instances.push(Instance { mesh: k as u32, to_world: Affine3A::IDENTITY });
    }
    let punctual = vec![
        PunctualLight::Point {
            position: Vec3::new(0.5, 0.2, 0.5),
            intensity: Color::ONE,
            range: f32::INFINITY,
        },
        PunctualLight::Spot {
            position: Vec3::new(0.6, 0.9, 0.0),
            direction: Vec3::NEG_Y,
            intensity: Color::splat(3.0),
            range: f32::INFINITY,
            inner: 0.1,
            outer: 0.5,
        },
        PunctualLight::Directional {
            direction: Vec3::new(0.0, -0.6, -0.8),
            irradiance: Color::splat(0.5),
        },
    ];
    let materials = vec![diffuse, glossy, mirror, lamp];
    let environment = Some(EnvironmentMap::constant(Color::splat(0.3)));
    Scene::new(
        SceneData { geometry, materials, punctual, environment, ..SceneData::default() },
        Backend::Bvh,
    )
    .unwrap()
    .0
}

/// Density per steradian of going on at a vertex that was reached from `from`.
fn onward(v: &Vertex, from: Vec3, to: Vec3) -> f32 {
    if v.delta {
        return 1.0;
    }
    v.bsdf.pdf(v.point.frame.to_local(from), v.point.frame.to_local(to))
}

#[test]
fn densities_are_those_of_the_paths_and_weights_sum_to_one() {
    check(None);
}

#[test]
fn so_they_are_where_light_from_infinity_is_aimed() {
    check(Some(Focus { center: Vec3::new(0.3, -0.5, 0.2), radius: 0.6 }));
}

fn check(focus: Option<Focus>) {
    let scene = scene();
    let camera = Camera {
        name: String::new(),
        projection: Projection::Perspective { yfov: 0.9 },
        aspect: None,
        to_world: Affine3A::from_translation(Vec3::new(0.0, 0.0, 3.2)),
        clip: Camera::NO_CLIP,
    };
    let size = [16, 16];
    let tracer = PathTracer { scene: &scene, max_bounces: u32::MAX };
    let mut bdpt = Bidirectional::new(tracer, camera.clone(), size, [0, 0, 16, 16]);
    bdpt.emission = scene.emission_sampler(focus);
    let mut work = Workspace::default();
    let mut kinds = [0; 4];
    for index in 0..2400 {
        let sample =
            CameraSample::new(&camera, [index % 16, index / 16 % 16], size, 5, index, u32::MAX);
        bdpt.walk_from_camera(&sample, &mut work.seen, &mut Shaded::default());
        bdpt.walk_from_light(&sample, &mut work.lit);
        for t in 1..=work.seen.vertices.len() + 1 {
            for s in 2..=work.lit.vertices.len() + 1 {
                let Some(link) = bdpt.link(&work, s, t) else { continue };
                bdpt.collect(&mut work, &link, s, t);
                let Some(end) = work.lit.end else { panic!("a light path without an end") };
                // The surfaces from the light on; those at the joint scatter into other directions
                // than their walks did.
                let mut path: Vec<Vertex> = work.lit.vertices[..s - 1].to_vec();
                path.extend(work.seen.vertices[..t - 1].iter().rev().map(|seen| seen.vertex));
                for joint in [s - 2, s - 1] {
                    if let Some(v) = path.get_mut(joint) {
                        v.delta = false;
                    }
                }
                let at = |i: usize| path[i].point.position;
                let towards = |a: Vec3, b: Vec3| (b - a).normalize();
                let start =
                    if end.distant { -path[0].point.wo } else { towards(end.position, at(0)) };
                let eye = Vec3::from(camera.to_world.translation);
                let next = |i: usize| if i + 1 < path.len() { at(i + 1) } else { eye };
                for (i, v) in path.iter().enumerate() {
                    let from_light = match i {
                        0 if end.distant => v.per_area_of_parallel(
                            bdpt.emission.ray_density(&end, start, at(0)),
                            start,
                        ),
                        0 => {
                            v.per_area(bdpt.emission.ray_density(&end, start, at(0)), end.position)
                        }
                        _ => {
                            let before = &path[i - 1];
                            let from = if i == 1 { -start } else { towards(at(i - 1), at(i - 2)) };
                            v.per_area(onward(before, from, towards(at(i - 1), at(i))), at(i - 1))
                        }
                    };
                    let from_camera = if i + 1 == path.len() {
                        let view = camera.view(at(i), size).unwrap();
                        f64::from(view.pixels_per_area * v.point.ng.dot(view.to_camera).abs())
                            / 256.0
                    } else {
                        let after = &path[i + 1];
                        v.per_area(
                            onward(
                                after,
                                towards(at(i + 1), next(i + 1)),
                                towards(at(i + 1), at(i)),
                            ),
                            at(i + 1),
                        )
                    };
                    let found = work.densities[i];
                    let close = |a: f64, b: f64| (a - b).abs() <= 2e-3 * a.max(b) + 1e-12;
                    assert!(
                        close(found.from_light, from_light)
                            && close(found.from_camera, from_camera)
                            && found.open != v.delta,
                        "s {s}, t {t}, vertex {i} of {}: {found:?}, not {from_light} and {from_camera}",
                        path.len()
                    );
                }
                let sampled = bdpt.sampled_density(&path[0], &end);
                let emitted = f64::from(bdpt.emission.end_density(&end, start));
                let LightDensity { sampled: s1, emitted: s2, hit } = link.end;
                assert!(
                    (s1 - sampled).abs() <= 1e-3 * sampled
                        && (s2 - emitted).abs() <= 1e-3 * emitted,
                    "{:?}",
                    link.end
                );
                let expected = super::walk::hit_density(
                    &end,
                    onward(&path[0], towards(at(0), next(0)), -start),
                    at(0),
                );
                assert!((hit - expected).abs() <= 2e-3 * expected, "{hit}, not {expected}");
                kinds[usize::from(t == 1) + 2 * usize::from(end.delta)] += 1;

                let open = |i: usize| i == 0 || work.densities[i - 1].open;
                let ways = (0..=path.len() + 1)
                    .filter(|&w| if w == 0 { hit > 0.0 } else { open(w - 1) && open(w) });
                let sum: f64 = ways.map(|w| weight(&link.end, &work.densities, w)).sum();
                assert!(
                    (sum - 1.0).abs() < 1e-6,
                    "the weights sum to {sum}: {:?} {:?}",
                    link.end,
                    work.densities
                );
            }
        }
    }
    assert!(kinds.iter().all(|k| *k > 100), "{kinds:?}");
}
