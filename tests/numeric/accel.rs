//! Both back ends against each other and against what a tracer must hold: no leaks, equal bits,
//! whole intervals.

use lumicache::accel::{Accel, Backend, Coherence, Hit, Ray};
use lumicache::ffi::mxcsr::FlushDenormals;
use lumicache::geometry::{Geometry, Instance, TriangleMesh};
use lumicache::math::{Affine3A, Mat3, Vec3};
use std::sync::Arc;

/// SplitMix64: enough randomness for rays.
struct Random(u64);

impl Random {
    fn bits(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let z = (self.0 ^ (self.0 >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        let z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    /// Uniform in [0, 1).
    fn unit(&mut self) -> f32 {
        (self.bits() >> 40) as f32 / (1 << 24) as f32
    }

    /// Uniform in the cube of edge 2 around the origin.
    fn cube(&mut self) -> Vec3 {
        Vec3::new(self.unit(), self.unit(), self.unit()) * 2.0 - 1.0
    }

    /// Uniform on the unit sphere.
    fn direction(&mut self) -> Vec3 {
        loop {
            let p = self.cube();
            if (0.01..1.0).contains(&p.length_squared()) {
                return p.normalize();
            }
        }
    }
}

fn mesh(positions: Vec<Vec3>, indices: Vec<[u32; 3]>) -> TriangleMesh {
    TriangleMesh {
        name: "test".into(),
        positions: positions.into(),
        indices: indices.into(),
        ..Default::default()
    }
}

fn geometry(meshes: Vec<TriangleMesh>, instances: Vec<Instance>) -> Geometry {
    Geometry { meshes: meshes.into_iter().map(Arc::new).collect(), instances }
}

fn once(mesh: TriangleMesh) -> Geometry {
    geometry(vec![mesh], vec![Instance { mesh: 0, to_world: Affine3A::IDENTITY }])
}

/// A closed sphere around the origin; neighbours share vertices.
fn sphere(rings: u32, sectors: u32) -> TriangleMesh {
    let mut positions = vec![Vec3::Y];
    for ring in 1..rings {
        let theta = std::f32::consts::PI * ring as f32 / rings as f32;
        positions.extend((0..sectors).map(|sector| {
            let phi = std::f32::consts::TAU * sector as f32 / sectors as f32;
            Vec3::new(theta.sin() * phi.cos(), theta.cos(), theta.sin() * phi.sin())
        }));
    }
    positions.push(Vec3::NEG_Y);
    let at = |ring: u32, sector: u32| 1 + (ring - 1) * sectors + sector % sectors;
    let mut indices = Vec::new();
    for sector in 0..sectors {
        indices.push([0, at(1, sector + 1), at(1, sector)]);
        for ring in 1..rings - 1 {
            let [a, b] = [at(ring, sector), at(ring, sector + 1)];
            let [c, d] = [at(ring + 1, sector), at(ring + 1, sector + 1)];
            indices.extend([[a, b, c], [b, d, c]]);
        }
        indices.push([
            at(rings - 1, sector),
            at(rings - 1, sector + 1),
            positions.len() as u32 - 1,
        ]);
    }
    mesh(positions, indices)
}

/// An axis-aligned box of the given half sizes with outer faces.
fn cuboid(half: Vec3) -> TriangleMesh {
    let corner = |i: u32| {
        half * Vec3::new((i & 1) as f32, (i >> 1 & 1) as f32, (i >> 2) as f32) * 2.0 - half
    };
    let quads =
        [[0, 4, 6, 2], [1, 3, 7, 5], [0, 1, 5, 4], [2, 6, 7, 3], [0, 2, 3, 1], [4, 5, 7, 6]];
    mesh(
        (0..8).map(corner).collect(),
        quads.iter().flat_map(|&[a, b, c, d]| [[a, b, c], [a, c, d]]).collect(),
    )
}

/// A room with two turned blocks, as separate meshes in place.
fn cornell() -> Geometry {
    let meshes =
        vec![cuboid(Vec3::ONE), cuboid(Vec3::new(0.3, 0.6, 0.3)), cuboid(Vec3::splat(0.3))];
    let place = |mesh, angle, x, y, z| Instance {
        mesh,
        to_world: Affine3A::from_rotation_y(angle) * Affine3A::from_translation(Vec3::new(x, y, z)),
    };
    geometry(
        meshes,
        vec![
            place(0, 0.0, 0.0, 0.0, 0.0),
            place(1, 0.3, -0.35, -0.4, -0.3),
            place(2, -0.3, 0.35, -0.7, 0.35),
        ],
    )
}

fn soup(triangles: usize) -> Geometry {
    let mut random = Random(1);
    let mut positions = Vec::new();
    for _ in 0..triangles {
        let center = random.cube();
        let size = 0.005 + 0.1 * random.unit().powi(4);
        positions.extend([0; 3].map(|_| center + size * random.cube()));
    }
    once(mesh(positions, (0..triangles as u32).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect()))
}

/// 300 turned, stretched and partly mirrored spheres that share their triangles, over a floor.
fn field() -> Geometry {
    let mut random = Random(2);
    let floor = mesh(
        [[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]]
            .map(|[x, z]| Vec3::new(x, -1.0, z))
            .to_vec(),
        vec![[0, 2, 1], [0, 3, 2]],
    );
    let mut instances = vec![Instance { mesh: 0, to_world: Affine3A::IDENTITY }];
    for i in 0..300 {
        let turn = Mat3::from_axis_angle(random.direction(), 6.0 * random.unit());
        let scale = 0.03 + 0.1 * Vec3::new(random.unit(), random.unit(), random.unit());
        let mirror = if i % 3 == 0 { Vec3::new(-1.0, 1.0, 1.0) } else { Vec3::ONE };
        let to_world = Affine3A::from_mat3_translation(
            turn * Mat3::from_diagonal(scale * mirror),
            0.9 * random.cube(),
        );
        instances.push(Instance { mesh: 1, to_world });
    }
    geometry(vec![floor, sphere(12, 24)], instances)
}

fn scenes() -> [(&'static str, Geometry); 4] {
    [
        ("sphere", once(sphere(64, 128))),
        ("cornell", cornell()),
        ("soup", soup(50_000)),
        ("field", field()),
    ]
}

/// Rays of random direction and length from in and around the cube of edge 2, in random order.
fn random_rays(count: usize, seed: u64) -> Vec<Ray> {
    let mut random = Random(seed);
    (0..count)
        .map(|_| Ray::new(1.2 * random.cube(), random.direction() * (0.1 + random.unit())))
        .collect()
}

fn build(geometry: &Geometry, backend: Backend) -> Accel {
    Accel::build(geometry, backend).unwrap()
}

/// The back ends that this build has.
fn backends() -> Vec<Backend> {
    Backend::ALL.into_iter().filter(|&b| Accel::build(&Geometry::default(), b).is_ok()).collect()
}

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
            let mut random = Random(4);
            let mut leaks = [0; 4];
            for i in 0..300_000 {
                let origin = 0.3 * random.cube();
                let dir = match i % 4 {
                    0 => vertices[random.bits() as usize % vertices.len()] - origin,
                    1 => {
                        let [a, b, _] = geometry.meshes[0].indices
                            [random.bits() as usize % geometry.meshes[0].indices.len()];
                        vertices[a as usize].lerp(vertices[b as usize], random.unit()) - origin
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
        let mut random = Random(6);
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
            (ray.tmin, ray.tmax) = (random.unit(), 2.0 * random.unit());
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
