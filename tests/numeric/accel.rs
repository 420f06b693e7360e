//! Both back ends against each other and against what a tracer must hold: no leaks, equal bits,
//! whole intervals.

use crate::support::meshes::*;
use crate::support::statistics::Rng;
use lumicache::accel::{Accel, Backend, Coherence, Hit, Ray};
use lumicache::geometry::Geometry;
use lumicache::math::Vec3;

/// True if the hit lies within rounding error of its triangle's border.
fn at_an_edge(hit: &Hit) -> bool {
    hit.u.min(hit.v).min(1.0 - hit.u - hit.v) < 1e-4
}

#[test]
fn the_back_ends_agree_on_random_rays() {
    if backends().len() < 2 {
        crate::support::testdata::skipped("this build has one back end");
        return;
    }
    for (name, geometry) in scenes() {
        let [embree, bvh] = Backend::ALL.map(|b| build(&geometry, b));
        let rays = random_rays(1_000_000, 3);
        let mut disagree = 0;
        let mut hits = 0;
        let mut worst = 0.0_f32;
        for ray in &rays {
            let (a, b) = (embree.intersect(ray), bvh.intersect(ray));
            hits += usize::from(a.is_hit());
            if a.is_hit() != b.is_hit() {
                disagree += 1;
                assert!(
                    at_an_edge(if a.is_hit() { &a } else { &b }),
                    "{name}: {a:?} and {b:?} of {ray:?}"
                );
            } else if a.is_hit() {
                // A millionth of the scene's size across the triangle is more along a grazing ray.
                let [p, q, r] = geometry.triangle(a.instance, a.triangle);
                let cosine = (q - p).cross(r - p).normalize().dot(ray.dir).abs();
                let difference = (a.t - b.t).abs();
                if difference > 1e-4 * a.t + 1e-6 / cosine {
                    disagree += 1;
                    assert!(at_an_edge(&a) || at_an_edge(&b), "{name}: {a:?} and {b:?} of {ray:?}");
                } else {
                    worst = worst.max(difference * cosine);
                }
            }
        }
        eprintln!(
            "{name}: {hits} of {} hit, {disagree} disagree, at most {worst:e} apart",
            rays.len()
        );
        assert!(hits > rays.len() / 4, "{name}: {hits} hits test little");
        assert!(disagree * 100_000 <= rays.len(), "{name}: {disagree} disagreements");
    }
}

#[test]
fn no_ray_leaves_a_closed_mesh() {
    // Few large and many small triangles; seen from the inside every ray must hit, also those aimed
    // at vertices and along axes.
    for (rings, sectors) in [(3, 4), (16, 16), (200, 300)] {
        let mesh = sphere(rings, sectors);
        let vertices = mesh.positions.clone();
        let geometry = once(mesh);
        for backend in backends() {
            let accel = build(&geometry, backend);
            let mut random = Rng(4);
            let mut leaks = [0; 4];
            for i in 0..300_000 {
                let origin = 0.3 * random.cube();
                let dir = match i % 4 {
                    0 => vertices[random.bits() as usize % vertices.len()] - origin,
                    1 => {
                        let [a, b, _] = geometry.meshes[0].indices
                            [random.bits() as usize % geometry.meshes[0].indices.len()];
                        vertices[a as usize].lerp(vertices[b as usize], random.next()) - origin
                    }
                    2 => [Vec3::X, Vec3::Y, Vec3::Z, -Vec3::X, -Vec3::Y, -Vec3::Z]
                        [random.bits() as usize % 6],
                    _ => random.direction(),
                };
                let ray = Ray::new(if i % 8 == 2 { Vec3::ZERO } else { origin }, dir);
                let hit = accel.intersect(&ray).is_hit();
                assert_eq!(hit, accel.occluded(&ray), "{backend}: {ray:?}");
                leaks[i % 4] += usize::from(!hit);
            }
            // Embree's robust mode compares single precision values, which near a vertex of small
            // triangles are all rounding error.
            let allowed = if backend == Backend::Embree { [3_000, 0, 0, 0] } else { [0; 4] };
            eprintln!("{backend}, {rings} x {sectors}: {leaks:?} of 75000 each");
            assert!(
                leaks.iter().zip(allowed).all(|(leaks, allowed)| *leaks <= allowed),
                "{backend}, {rings} x {sectors}: {leaks:?}"
            );
        }
    }
}

#[test]
fn nothing_is_hit_where_there_is_nothing() {
    let no_triangles = once(mesh(vec![Vec3::ZERO; 3], vec![]));
    let unused = geometry(vec![sphere(4, 4)], vec![]);
    let no_area = once(mesh(
        vec![Vec3::ZERO, Vec3::X, Vec3::X, 2.0 * Vec3::X],
        vec![[0, 0, 0], [0, 1, 2], [0, 1, 3]],
    ));
    for geometry in [Geometry::default(), no_triangles, unused, no_area] {
        for backend in backends() {
            let accel = build(&geometry, backend);
            let rays = random_rays(40, 5);
            let mut hits =
                vec![Hit { t: 0.0, u: 0.0, v: 0.0, instance: 0, triangle: 0 }; rays.len()];
            let mut blocked = vec![true; rays.len()];
            accel.intersect_many(&rays, Coherence::Bundle, &mut hits);
            accel.occluded_many(&rays, &mut blocked);
            assert!(
                hits.iter().all(|h| *h == Hit::MISS) && blocked.iter().all(|b| !b),
                "{backend}"
            );
            assert!(rays.iter().all(|r| accel.intersect(r) == Hit::MISS && !accel.occluded(r)));
        }
    }
}

#[test]
fn hits_lie_in_the_ray_s_interval() {
    let geometry = soup(5_000);
    for backend in backends() {
        let accel = build(&geometry, backend);
        let mut random = Rng(6);
        let mut found = 0;
        for mut ray in random_rays(100_000, 7) {
            let first = accel.intersect(&ray);
            // Past the first hit comes the next; before it comes nothing.
            if first.is_hit() {
                let next = accel.intersect(&Ray { tmin: first.t * 1.00001, ..ray });
                assert!(next.t > first.t, "{backend}: {first:?}, then {next:?}");
                assert!(
                    !accel.intersect(&Ray { tmax: first.t * 0.999, ..ray }).is_hit(),
                    "{backend}"
                );
            }
            (ray.tmin, ray.tmax) = (random.next(), 2.0 * random.next());
            let hit = accel.intersect(&ray);
            assert_eq!(hit.is_hit(), accel.occluded(&ray), "{backend}: {ray:?}");
            if hit.is_hit() {
                found += 1;
                assert!(hit.t > ray.tmin && hit.t <= ray.tmax, "{backend}: {hit:?} of {ray:?}");
            }
        }
        assert!(found > 1_000, "{found}");
    }
}

#[test]
fn hits_name_the_point_by_instance_triangle_and_weights() {
    for (name, geometry) in scenes() {
        for backend in backends() {
            let accel = build(&geometry, backend);
            let mut worst = 0.0_f32;
            for ray in random_rays(50_000, 8) {
                let hit = accel.intersect(&ray);
                if !hit.is_hit() {
                    continue;
                }
                let instance = &geometry.instances[hit.instance as usize];
                let mesh = &geometry.meshes[instance.mesh as usize];
                let [a, b, c] =
                    mesh.indices[hit.triangle as usize].map(|i| mesh.positions[i as usize]);
                let point =
                    instance.to_world.transform_point3(a + hit.u * (b - a) + hit.v * (c - a));
                assert!(
                    (0.0..=1.0).contains(&hit.u)
                        && (0.0..=1.0).contains(&hit.v)
                        && hit.u + hit.v < 1.0 + 1e-5,
                    "{name}: {hit:?}"
                );
                // A grazing ray magnifies rounding errors by the inverse of the cosine.
                let normal = instance
                    .to_world
                    .transform_vector3(b - a)
                    .cross(instance.to_world.transform_vector3(c - a))
                    .normalize();
                let error =
                    (point - ray.at(hit.t)).length() * normal.dot(ray.dir.normalize()).abs();
                worst = worst.max(error);
            }
            eprintln!("{name}, {backend}: point off by {worst:e}");
            assert!(worst < 2e-6, "{name}, {backend}: {worst}");
        }
    }
}

#[test]
fn packets_find_what_single_rays_find() {
    for (name, geometry) in scenes() {
        for backend in backends() {
            let accel = build(&geometry, backend);
            // 16 does not divide the count: the last packet is partly empty.
            let mut rays = random_rays(200_003, 9);
            rays.sort_by_key(|r| r.dir.cmplt(Vec3::ZERO).bitmask());
            let mut hits = vec![Hit::MISS; rays.len()];
            let mut blocked = vec![false; rays.len()];
            accel.occluded_many(&rays, &mut blocked);
            for coherence in [Coherence::Bundle, Coherence::Camera] {
                accel.intersect_many(&rays, coherence, &mut hits);
                let (mut unequal, mut disagree) = (0, 0);
                for ((ray, hit), blocked) in rays.iter().zip(&hits).zip(&blocked) {
                    let alone = accel.intersect(ray);
                    unequal += usize::from(alone != *hit);
                    disagree += usize::from(
                        alone.is_hit() != hit.is_hit()
                            || (alone.t != hit.t
                                && (alone.t - hit.t).abs() > 1e-4 * alone.t.max(hit.t)),
                    );
                    disagree += usize::from(*blocked != alone.is_hit());
                }
                eprintln!(
                    "{name}, {backend}, {coherence:?}: {unequal} of {} not bit-equal, {disagree} disagree",
                    rays.len()
                );
                assert!(disagree <= 2, "{name}, {backend}: {disagree}");
                assert!(
                    backend == Backend::Embree || unequal == 0,
                    "{name}: the BVH has no packets"
                );
            }
        }
    }
}

#[test]
fn builds_and_threads_do_not_change_a_bit() {
    for (name, geometry) in scenes() {
        for backend in backends() {
            let mut rays = random_rays(20_000, 10);
            rays.truncate(20_000 / 16 * 16);
            let trace = |accel: &Accel, threads: usize| {
                let mut hits = vec![Hit::MISS; rays.len()];
                let share = rays.len().div_ceil(16 * threads) * 16;
                std::thread::scope(|scope| {
                    for (rays, hits) in rays.chunks(share).zip(hits.chunks_mut(share)) {
                        scope.spawn(|| accel.intersect_many(rays, Coherence::Bundle, hits));
                    }
                });
                hits
            };
            let first = trace(&build(&geometry, backend), 1);
            for threads in [1, 2, 7] {
                let accel = build(&geometry, backend);
                assert!(trace(&accel, threads) == first, "{name}, {backend}, {threads} threads");
            }
        }
    }
}

#[test]
fn a_tracer_is_shared_by_threads() {
    fn shared<T: Send + Sync>() {}
    shared::<Accel>();
}

#[test]
fn back_ends_have_names() {
    for backend in Backend::ALL {
        assert_eq!(backend.name().parse::<Backend>().unwrap(), backend);
    }
    assert!(
        "optix"
            .parse::<Backend>()
            .unwrap_err()
            .to_string()
            .contains("choose \"embree\" or \"bvh\"")
    );
    assert_eq!(backends().contains(&Backend::Embree), Backend::default() == Backend::Embree);
    if cfg!(not(feature = "embree")) {
        let text = Accel::build(&Geometry::default(), Backend::Embree).err().unwrap().to_string();
        assert!(text.contains("compiled without Embree"), "{text}");
    }
}
