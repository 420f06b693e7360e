//! Meshes that rays are traced in.

use crate::support::statistics::Rng;
use lumicache::accel::{Accel, Backend, Ray};
use lumicache::geometry::{Geometry, Instance, TriangleMesh};
use lumicache::math::{Affine3A, Mat3, Vec3};
use std::sync::Arc;

pub fn mesh(positions: Vec<Vec3>, indices: Vec<[u32; 3]>) -> TriangleMesh {
    TriangleMesh {
        name: "test".into(),
        positions: positions.into(),
        indices: indices.into(),
        ..Default::default()
    }
}

pub fn geometry(meshes: Vec<TriangleMesh>, instances: Vec<Instance>) -> Geometry {
    Geometry { meshes: meshes.into_iter().map(Arc::new).collect(), instances }
}

pub fn once(mesh: TriangleMesh) -> Geometry {
    geometry(vec![mesh], vec![Instance { mesh: 0, to_world: Affine3A::IDENTITY }])
}

/// A closed sphere around the origin; neighbours share vertices.
pub fn sphere(rings: u32, sectors: u32) -> TriangleMesh {
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
pub fn cuboid(half: Vec3) -> TriangleMesh {
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
pub fn cornell() -> Geometry {
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

pub fn soup(triangles: usize) -> Geometry {
    let mut random = Rng(1);
    let mut positions = Vec::new();
    for _ in 0..triangles {
        let center = random.cube();
        let size = 0.005 + 0.1 * random.next().powi(4);
        positions.extend([0; 3].map(|_| center + size * random.cube()));
    }
    once(mesh(positions, (0..triangles as u32).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect()))
}

/// 300 turned, stretched and partly mirrored spheres that share their triangles, over a floor.
pub fn field() -> Geometry {
    let mut random = Rng(2);
    let floor = mesh(
        [[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]]
            .map(|[x, z]| Vec3::new(x, -1.0, z))
            .to_vec(),
        vec![[0, 2, 1], [0, 3, 2]],
    );
    let mut instances = vec![Instance { mesh: 0, to_world: Affine3A::IDENTITY }];
    for i in 0..300 {
        let turn = Mat3::from_axis_angle(random.direction(), 6.0 * random.next());
        let scale = 0.03 + 0.1 * Vec3::new(random.next(), random.next(), random.next());
        let mirror = if i % 3 == 0 { Vec3::new(-1.0, 1.0, 1.0) } else { Vec3::ONE };
        let to_world = Affine3A::from_mat3_translation(
            turn * Mat3::from_diagonal(scale * mirror),
            0.9 * random.cube(),
        );
        instances.push(Instance { mesh: 1, to_world });
    }
    geometry(vec![floor, sphere(12, 24)], instances)
}

pub fn scenes() -> [(&'static str, Geometry); 4] {
    [
        ("sphere", once(sphere(64, 128))),
        ("cornell", cornell()),
        ("soup", soup(50_000)),
        ("field", field()),
    ]
}

/// Rays of random direction and length from in and around the cube of edge 2, in random order.
pub fn random_rays(count: usize, seed: u64) -> Vec<Ray> {
    let mut random = Rng(seed);
    (0..count)
        .map(|_| Ray::new(1.2 * random.cube(), random.direction() * (0.1 + random.next())))
        .collect()
}

pub fn build(geometry: &Geometry, backend: Backend) -> Accel {
    Accel::build(geometry, backend).unwrap()
}

/// The back ends that this build has.
pub fn backends() -> Vec<Backend> {
    Backend::ALL.into_iter().filter(|&b| Accel::build(&Geometry::default(), b).is_ok()).collect()
}
