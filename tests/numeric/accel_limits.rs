//! Both back ends at the edge of their input: near, tiny, degenerate, not a number.

use crate::support::meshes::*;
use lumicache::accel::{Accel, Backend, Coherence, Hit, Ray};
use lumicache::ffi::mxcsr::FlushDenormals;
use lumicache::geometry::{Geometry, Instance};
use lumicache::math::{Affine3A, Vec3};

#[test]
fn of_equally_distant_triangles_the_bvh_takes_the_first() {
    // The same triangles three times, once from a second instance.
    let twice = {
        let m = sphere(5, 8);
        mesh(m.positions.to_vec(), m.indices.iter().chain(&m.indices).copied().collect())
    };
    let place = |mesh| Instance { mesh, to_world: Affine3A::IDENTITY };
    let first = sphere(5, 8).indices.len() as u32;
    let geometry = geometry(vec![twice.clone(), twice], vec![place(0), place(1)]);
    let accel = build(&geometry, Backend::Bvh);
    for ray in random_rays(10_000, 11) {
        let hit = accel.intersect(&ray);
        assert!(!hit.is_hit() || (hit.instance == 0 && hit.triangle < first), "{hit:?}");
    }
}

#[test]
fn very_near_and_very_small_things_are_hit() {
    // A sphere of a micrometre, also through a direction of small length and one almost along an
    // axis.
    for scale in [1e-6, 1.0, 1e6] {
        let mut small = sphere(16, 32);
        small.positions.iter_mut().for_each(|p| *p *= scale);
        let geometry = once(small);
        for backend in backends() {
            let accel = build(&geometry, backend);
            for dir in [
                Vec3::new(1.0, 1e-9, -1e-9),
                Vec3::new(1e-3, 2e-3, 1e-3),
                Vec3::new(300.0, -200.0, 100.0),
            ] {
                let hit = accel.intersect(&Ray::new(Vec3::ZERO, dir));
                let distance = hit.t * dir.length() / scale;
                assert!(
                    (0.97..1.001).contains(&distance),
                    "{backend}, scale {scale}, {dir}: {hit:?}"
                );
            }
        }
    }
}

#[test]
fn rays_that_are_not_numbers_hit_nothing() {
    let geometry = once(sphere(16, 32));
    let bad = [
        Ray::new(Vec3::NAN, Vec3::X),
        Ray::new(Vec3::ZERO, Vec3::NAN),
        Ray::new(Vec3::ZERO, Vec3::ZERO),
        Ray { tmin: f32::NAN, ..Ray::new(Vec3::ZERO, Vec3::X) },
        Ray { tmax: f32::NAN, ..Ray::new(Vec3::ZERO, Vec3::X) },
        Ray { tmin: 2.0, tmax: 1.0, ..Ray::new(Vec3::ZERO, Vec3::X) },
    ];
    for backend in backends() {
        let accel = build(&geometry, backend);
        let mut hits = [Hit::MISS; 6];
        accel.intersect_many(&bad, Coherence::Bundle, &mut hits);
        for (ray, hit) in bad.iter().zip(hits) {
            assert!(
                !accel.intersect(ray).is_hit() && !hit.is_hit() && !accel.occluded(ray),
                "{backend}: {ray:?}"
            );
        }
    }
}

#[test]
fn degenerate_input_is_survived() {
    // A hundred thousand copies of one triangle, and a fan of needles.
    let copies = mesh(vec![Vec3::ZERO, Vec3::X, Vec3::Y], vec![[0, 1, 2]; 100_000]);
    let needles = {
        let tips = (0..1000).map(|i| Vec3::new(1.0, 1e-7 * i as f32, 0.0));
        mesh(
            std::iter::once(Vec3::ZERO).chain(tips).collect(),
            (1..1000).map(|i| [0, i, i + 1]).collect(),
        )
    };
    let flat = Instance { mesh: 0, to_world: Affine3A::from_scale(Vec3::new(1.0, 1.0, 1e-20)) };
    let huge = |size: f32| {
        once(mesh(
            (0..4).map(|i| size * Vec3::new(i as f32, 1.0, (i * i) as f32)).collect(),
            vec![[0, 1, 2], [1, 2, 3]],
        ))
    };
    let singular = Instance { mesh: 0, to_world: Affine3A::from_scale(Vec3::new(1.0, 0.0, 1.0)) };
    let far = Instance { mesh: 0, to_world: Affine3A::from_translation(Vec3::splat(1e30)) };
    let odd_instances = geometry(vec![copies.clone()], vec![flat.clone(), flat, singular, far]);
    let not_numbers = once(mesh(
        vec![Vec3::NAN, Vec3::X, Vec3::INFINITY, Vec3::Y, Vec3::Z],
        vec![[0, 1, 2], [1, 2, 3], [0, 3, 4]],
    ));
    for geometry in [
        once(copies),
        once(needles),
        odd_instances,
        huge(1e10),
        huge(1e17),
        huge(1e30),
        not_numbers,
    ] {
        for backend in backends() {
            let accel = build(&geometry, backend);
            random_rays(100, 12).iter().for_each(|ray| {
                accel.intersect(ray);
                accel.occluded(ray);
            });
        }
    }
    let accel = build(
        &once(mesh(vec![Vec3::ZERO, Vec3::X, Vec3::Y], vec![[0, 1, 2]; 100_000])),
        Backend::Bvh,
    );
    let hit = accel.intersect(&Ray::new(Vec3::new(0.25, 0.5, 3.0), Vec3::NEG_Z));
    assert_eq!((hit.t, hit.u, hit.v, hit.triangle), (3.0, 0.25, 0.5, 0));
}

#[test]
fn indices_that_name_nothing_are_refused() {
    let beyond = once(mesh(vec![Vec3::ZERO; 3], vec![[0, 1, 2], [0, 1, 3]]));
    let no_mesh = geometry(vec![], vec![Instance { mesh: 0, to_world: Affine3A::IDENTITY }]);
    for backend in backends() {
        let text = |g: &Geometry| Accel::build(g, backend).err().unwrap().to_string();
        assert!(
            text(&beyond).contains("triangle 1 refers to a vertex beyond its 3"),
            "{}",
            text(&beyond)
        );
        assert!(text(&no_mesh).contains("instance 0 refers to mesh 0"), "{}", text(&no_mesh));
    }
}

#[test]
fn building_and_tracing_leave_the_thread_s_floating_point_mode() {
    // The product is looked at, too, so that it is made where it stands: the compiler knows nothing
    // of the mode.
    let half_of_the_least_normal = || {
        std::hint::black_box(std::hint::black_box(f32::MIN_POSITIVE) * std::hint::black_box(0.5))
    };
    let geometry = soup(20_000);
    for backend in backends() {
        let trace = || {
            let accel = build(&geometry, backend);
            let rays = random_rays(1_000, 13);
            accel.intersect_many(&rays, Coherence::Bundle, &mut vec![Hit::MISS; rays.len()]);
        };
        trace();
        assert!(half_of_the_least_normal() > 0.0, "{backend}");
        let guard = FlushDenormals::new();
        trace();
        let flushed = half_of_the_least_normal();
        drop(guard);
        assert!(flushed == 0.0 || cfg!(not(target_arch = "x86_64")), "{backend}");
        // Threads that Rust's pool or TBB own are not ours to look at; this one is.
        assert!(half_of_the_least_normal() > 0.0, "{backend}");
    }
}
