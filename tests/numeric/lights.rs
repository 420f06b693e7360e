//! Light sampling: densities agree with samples, estimates with closed forms, and the tree beats
//! choosing by power.

use lumicache::geometry::{Aabb, Geometry, Instance, TriangleMesh};
use lumicache::light::{Emitter, EnvironmentMap, LightSample, LightSource, Lights, PunctualLight};
use lumicache::math::{Affine3A, Color, Mat3, PI, Vec2, Vec3};
use std::sync::Arc;

/// A small generator for tests: PCG-XSH-RR.
pub struct Rng(pub u64);

impl Rng {
    pub fn next(&mut self) -> f32 {
        self.0 =
            self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        let bits = (((self.0 >> 18) ^ self.0) >> 27) as u32;
        (bits.rotate_right((self.0 >> 59) as u32) >> 8) as f32 / 16_777_216.0
    }

    pub fn vec2(&mut self) -> Vec2 {
        Vec2::new(self.next(), self.next())
    }

    /// Uniform in the cube [-1,1]³.
    fn cube(&mut self) -> Vec3 {
        Vec3::new(self.next(), self.next(), self.next()) * 2.0 - 1.0
    }

    pub fn direction(&mut self) -> Vec3 {
        loop {
            let v = self.cube();
            if (1e-4..1.0).contains(&v.length_squared()) {
                return v.normalize();
            }
        }
    }
}

/// One mesh with one instance for these triangles.
fn geometry(triangles: &[[Vec3; 3]]) -> Geometry {
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

fn emitter(triangle: usize, radiance: Color, double_sided: bool) -> Emitter {
    Emitter { instance: 0, triangle: triangle as u32, radiance, double_sided }
}

fn build(
    triangles: &[[Vec3; 3]],
    double_sided: bool,
    punctual: Vec<PunctualLight>,
    environment: Option<EnvironmentMap>,
) -> Lights {
    let geometry = geometry(triangles);
    let emitters = (0..triangles.len())
        .map(|i| emitter(i, Vec3::splat(1.0 + (i % 3) as f32), double_sided))
        .collect();
    let bounds = geometry.bounds().union(Aabb { min: Vec3::splat(-3.0), max: Vec3::splat(3.0) });
    Lights::build(&geometry, emitters, punctual, environment, bounds)
}

fn random_triangles(rng: &mut Rng, count: usize, size: f32) -> Vec<[Vec3; 3]> {
    (0..count)
        .map(|_| {
            let center = rng.cube() * 2.0;
            [(); 3].map(|()| center + rng.cube() * size)
        })
        .collect()
}

/// A map with a bright spot, a dark half and a smooth rest, 1 : 2 in size.
fn uneven_map(height: u32) -> EnvironmentMap {
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
fn pdf_of(lights: &Lights, p: Vec3, n: Option<Vec3>, s: &LightSample) -> f32 {
    match s.source {
        LightSource::Triangle { instance, triangle, .. } => {
            lights.pdf_triangle(p, n, instance, triangle, s.wi, s.distance)
        }
        LightSource::Environment => lights.pdf_environment(p, n, s.wi),
        LightSource::Punctual(_) => s.pdf,
    }
}

/// Upper tail of the chi-square distribution by the Wilson-Hilferty cube root: the z value of a
/// statistic.
fn chi2_z(statistic: f64, dof: f64) -> f64 {
    ((statistic / dof).cbrt() - (1.0 - 2.0 / (9.0 * dof))) / (2.0 / (9.0 * dof)).sqrt()
}

/// Compares counts with expectations, cells with an expectation below 5 pooled. Fails above z =
/// 4.5: a false alarm in 300 000 tests.
pub fn assert_chi2(observed: &[f64], expected: &[f64], what: &str) {
    let (mut statistic, mut dof, mut pooled) = (0.0, -1.0, (0.0, 0.0));
    for (&o, &e) in observed.iter().zip(expected) {
        if e < 5.0 {
            pooled = (pooled.0 + o, pooled.1 + e);
        } else {
            statistic += (o - e) * (o - e) / e;
            dof += 1.0;
        }
    }
    if pooled.1 >= 5.0 {
        statistic += (pooled.0 - pooled.1) * (pooled.0 - pooled.1) / pooled.1;
        dof += 1.0;
    } else {
        assert!(pooled.0 <= 25.0, "{what}: {} samples where {} are expected", pooled.0, pooled.1);
    }
    let z = chi2_z(statistic, dof);
    assert!(z < 4.5, "{what}: chi-square {statistic:.0} with {dof} degrees of freedom, z = {z:.1}");
}

/// Mean and standard error of the mean.
struct Mean {
    count: f64,
    sum: f64,
    squares: f64,
}

impl Mean {
    fn new() -> Self {
        Self { count: 0.0, sum: 0.0, squares: 0.0 }
    }

    fn add(&mut self, value: f64) {
        self.count += 1.0;
        self.sum += value;
        self.squares += value * value;
    }

    fn mean(&self) -> f64 {
        self.sum / self.count
    }

    fn variance(&self) -> f64 {
        (self.squares / self.count - self.mean() * self.mean()).max(0.0)
    }

    fn error(&self) -> f64 {
        (self.variance() / self.count).sqrt()
    }
}

fn assert_mean(mean: &Mean, expected: f64, what: &str) {
    let sigma = mean.error().max(1e-6 * expected.abs()).max(1e-12);
    let off = (mean.mean() - expected) / sigma;
    assert!(off.abs() < 4.5, "{what}: {} instead of {expected}, {off:.1} sigma", mean.mean());
}

#[test]
fn triangle_sampling_is_uniform_in_solid_angle() {
    let shapes = [
        [Vec3::new(-0.5, -0.4, 1.0), Vec3::new(-0.3, 0.7, 1.2), Vec3::new(0.6, 0.5, 1.5)],
        [Vec3::new(-9.0, -7.0, 0.3), Vec3::new(-3.0, 11.0, 0.2), Vec3::new(10.0, -1.0, 0.25)],
        [Vec3::new(5.0, 0.0, 0.4), Vec3::new(5.0, 0.3, 0.5), Vec3::new(-1.0, 0.2, 0.45)],
        [Vec3::new(0.1, 0.1, 9.0), Vec3::new(0.2, 0.1, 9.0), Vec3::new(0.2, 0.3, 9.1)],
        [Vec3::new(0.001, 0.1, 9.0), Vec3::new(0.01, 0.1, 9.0), Vec3::new(0.02, 0.13, 9.1)],
    ];
    let mut rng = Rng(1);
    for (index, shape) in shapes.iter().enumerate() {
        let lights = build(&[*shape], true, vec![], None);
        // Cells of equal weights of the vertices; each must get samples in proportion to its own
        // solid angle.
        const CELLS: usize = 8;
        let mut observed = vec![0.0; CELLS * CELLS];
        let mut expected = vec![0.0; CELLS * CELLS];
        let count = 40_000;
        for _ in 0..count {
            let s = lights.sample(Vec3::ZERO, None, rng.next(), rng.vec2()).unwrap();
            let LightSource::Triangle { u, v, .. } = s.source else { panic!("a triangle") };
            let place = shape[0] * (1.0 - u - v) + shape[1] * u + shape[2] * v;
            assert!((place - s.wi * s.distance).length() < 1e-4 * s.distance, "shape {index}");
            let cell = |x: f32| ((x * CELLS as f32) as usize).min(CELLS - 1);
            observed[cell(u) * CELLS + cell(v)] += 1.0;
        }
        let at = |u: f64, v: f64| {
            let [a, b, c] = shape.map(|x| x.as_dvec3());
            a * (1.0 - u - v) + b * u + c * v
        };
        let fine = 64;
        let step = 1.0 / (CELLS * fine) as f64;
        let cross = (shape[1] - shape[0]).as_dvec3().cross((shape[2] - shape[0]).as_dvec3());
        let mut total = 0.0;
        for i in 0..CELLS * fine {
            for j in 0..CELLS * fine - i {
                // The small square, or its lower triangle on the diagonal.
                let (offset, size) =
                    if i + j + 1 == CELLS * fine { (1.0 / 3.0, 0.5) } else { (0.5, 1.0) };
                let r = at((i as f64 + offset) * step, (j as f64 + offset) * step);
                let angle = size * cross.dot(r).abs() / r.length().powi(3);
                expected[i / fine * CELLS + j / fine] += angle;
                total += angle;
            }
        }
        expected.iter_mut().for_each(|e| *e *= f64::from(count) / total);
        assert_chi2(&observed, &expected, &format!("shape {index} of {total:.2e} sr"));
    }
}

#[test]
fn environment_sampling_follows_its_density() {
    for height in [4, 48, 160] {
        let map = uneven_map(height);
        let lights = build(&[], true, vec![], Some(map.clone()));
        let mut rng = Rng(u64::from(height));
        // Bands of equal area in world space, away from the map's own axes.
        let (rings, sectors) = (24, 48);
        let cell = |d: Vec3| {
            let ring = ((1.0 - d.z) * 0.5 * rings as f32).min(rings as f32 - 1.0) as usize;
            let sector = ((d.y.atan2(d.x) / PI + 1.0) * 0.5 * sectors as f32)
                .min(sectors as f32 - 1.0) as usize;
            ring * sectors + sector
        };
        let mut observed = vec![0.0; rings * sectors];
        let count = 60_000;
        for _ in 0..count {
            let s = lights.sample(Vec3::ZERO, None, rng.next(), rng.vec2()).unwrap();
            observed[cell(s.wi)] += 1.0;
            assert!((s.radiance - map.radiance(s.wi)).length() <= 1e-4 * s.radiance.length());
        }
        let mut expected = vec![0.0; rings * sectors];
        let fine = 40;
        let mut total = 0.0;
        for i in 0..rings * fine {
            for j in 0..sectors * fine {
                let z = 1.0 - 2.0 * (i as f32 + 0.5) / (rings * fine) as f32;
                let phi = (2.0 * (j as f32 + 0.5) / (sectors * fine) as f32 - 1.0) * PI;
                let r = (1.0 - z * z).sqrt();
                let d = Vec3::new(r * phi.cos(), r * phi.sin(), z);
                let pdf = lights.pdf_environment(Vec3::ZERO, None, d);
                assert!(
                    pdf > 0.0 || map.radiance(d).max_element() <= 0.0,
                    "light that is never sampled, towards {d}"
                );
                let mass = f64::from(pdf) * 4.0 * std::f64::consts::PI
                    / (rings * sectors * fine * fine) as f64;
                expected[i / fine * sectors + j / fine] += mass * f64::from(count);
                total += mass;
            }
        }
        assert!((total - 1.0).abs() < 2e-3, "density integrates to {total}");
        // The spot is as small as a pixel: where a cell of the comparison is not integrated finely,
        // its error is far below the noise of the count.
        assert_chi2(&observed, &expected, &format!("map of {height} rows"));
    }
}

#[test]
fn sample_and_pdf_agree() {
    let mut rng = Rng(5);
    let triangles = random_triangles(&mut rng, 200, 0.3);
    let sun =
        PunctualLight::Directional { direction: Vec3::new(0.0, -1.0, 0.0), irradiance: Vec3::ONE };
    let lamp = PunctualLight::Point {
        position: Vec3::new(1.0, 0.0, 0.0),
        intensity: Vec3::ONE,
        range: f32::INFINITY,
    };
    for count in [1, 2, 12, 200] {
        for environment in [None, Some(EnvironmentMap::constant(Vec3::ONE)), Some(uneven_map(16))] {
            let lights = build(
                &triangles[..count],
                count == 12,
                vec![sun.clone(), lamp.clone()],
                environment,
            );
            for _ in 0..3000 {
                let p = rng.cube() * 3.0;
                let n = (rng.next() < 0.7).then(|| rng.direction());
                let Some(s) = lights.sample(p, n, rng.next(), rng.vec2()) else { continue };
                let pdf = pdf_of(&lights, p, n, &s);
                assert!((pdf / s.pdf - 1.0).abs() < 1e-4, "{pdf} instead of {} from {s:?}", s.pdf);
                assert!(s.wi.is_normalized() && n.is_none_or(|n| n.dot(s.wi) > 0.0));
            }
        }
    }
}

/// The probability that a choice falls on each triangle, from the densities towards their centres.
fn selection(
    lights: &Lights,
    p: Vec3,
    n: Option<Vec3>,
    triangles: &[[Vec3; 3]],
    single: &[Lights],
) -> f64 {
    (0..triangles.len())
        .map(|i| {
            let [a, b, c] = triangles[i];
            let to = (a + b + c) / 3.0 - p;
            let (wi, distance) = (to.normalize(), to.length());
            let own = single[i].pdf_triangle(p, None, 0, 0, wi, distance);
            // Towards a centre below the horizon the density is 0; a normal that sees it has no
            // part in the choice without `n`.
            if own > 0.0 {
                f64::from(lights.pdf_triangle(p, n, 0, i as u32, wi, distance) / own)
            } else {
                0.0
            }
        })
        .sum()
}

#[test]
fn probabilities_of_all_lights_sum_to_one() {
    let mut rng = Rng(7);
    for count in [1, 2, 16, 300] {
        let triangles = random_triangles(&mut rng, count, 0.2);
        let lights = build(&triangles, true, vec![], None);
        let single: Vec<_> = triangles.iter().map(|t| build(&[*t], true, vec![], None)).collect();
        for _ in 0..50 {
            let sum = selection(&lights, rng.cube() * 3.0, None, &triangles, &single);
            assert!((sum - 1.0).abs() < 1e-4, "{count} lights: {sum}");
        }
    }
}

#[test]
fn every_light_that_reaches_a_surface_can_be_chosen() {
    let mut rng = Rng(8);
    for double_sided in [false, true] {
        let triangles = random_triangles(&mut rng, 400, 0.2);
        let lights = build(&triangles, double_sided, vec![], None);
        let mut reached = 0;
        for _ in 0..100 {
            let (p, n) = (rng.cube() * 3.0, rng.direction());
            for (i, corners) in triangles.iter().enumerate() {
                let u = rng.vec2();
                let (u, v) = if u.x + u.y > 1.0 { (1.0 - u.x, 1.0 - u.y) } else { (u.x, u.y) };
                let to = corners[0] * (1.0 - u - v) + corners[1] * u + corners[2] * v - p;
                let faces = (corners[1] - corners[0]).cross(corners[2] - corners[0]).dot(to) < 0.0;
                let lit = (double_sided || faces) && n.dot(to) > 1e-4;
                let pdf = lights.pdf_triangle(p, Some(n), 0, i as u32, to.normalize(), to.length());
                assert!(
                    pdf.is_finite() && (pdf > 0.0 || !lit),
                    "triangle {i} reaches {p}, {n} with density {pdf}"
                );
                reached += u32::from(lit);
            }
        }
        assert!(reached > 5000);
    }
}

#[test]
fn halves_of_a_lamp_are_chosen_by_their_irradiance() {
    let [a, b, c, d] =
        [(-0.35, -0.3), (0.35, -0.3), (0.35, 0.3), (-0.35, 0.3)].map(|(x, z)| Vec3::new(x, 2.0, z));
    let triangles = [[a, b, c], [a, c, d]];
    let geometry = geometry(&triangles);
    let lights = Lights::build(
        &geometry,
        vec![emitter(0, Vec3::ONE, true), emitter(1, Vec3::ONE, true)],
        vec![],
        None,
        geometry.bounds(),
    );
    let mut rng = Rng(9);
    for _ in 0..300 {
        let p = Vec3::new(2.0 * rng.next() - 1.0, 1.6 * rng.next(), 2.0 * rng.next() - 1.0);
        let [first, second] = [0, 1].map(|i| lights.emitter(0, i).unwrap().irradiance(p, Vec3::Y));
        let chosen = (0..1000).filter(|i| {
            let s = lights
                .sample(p, Some(Vec3::Y), (*i as f32 + 0.5) / 1000.0, Vec2::splat(0.5))
                .unwrap();
            matches!(s.source, LightSource::Triangle { triangle: 0, .. })
        });
        let (share, expected) = (chosen.count() as f32 / 1000.0, first / (first + second));
        assert!((share - expected).abs() < 0.05, "{share} instead of {expected} at {p}");
    }
}

#[test]
fn irradiance_of_triangles_is_the_closed_form() {
    let mut rng = Rng(11);
    for (count, size) in [(1, 1.0), (2, 3.0), (16, 0.5), (100, 0.3)] {
        let triangles = random_triangles(&mut rng, count, size);
        for double_sided in [false, true] {
            let lights = build(&triangles, double_sided, vec![], None);
            for with_normal in [false, true] {
                let (p, n) = (rng.cube() * 2.5, rng.direction());
                let expected = f64::from(lights.unoccluded_irradiance(p, n).x);
                let (mut mean, mut stratified) = (Mean::new(), Mean::new());
                for i in 0..20_000 {
                    let sample = lights.sample(p, with_normal.then_some(n), rng.next(), rng.vec2());
                    let value =
                        |s: &LightSample| f64::from(s.radiance.x * s.wi.dot(n).max(0.0) / s.pdf);
                    mean.add(sample.as_ref().map_or(0.0, value));
                    if i % 10 == 0 {
                        let mut sum = 0.0;
                        lights.stratified(p, with_normal.then_some(n), 7, i, &mut |s| {
                            sum += value(&s)
                        });
                        stratified.add(sum / 7.0);
                    }
                }
                let what =
                    format!("{count} triangles, double sided {double_sided}, normal {with_normal}");
                assert_mean(&mean, expected, &what);
                assert_mean(&stratified, expected, &format!("{what}, stratified"));
            }
        }
    }
}

#[test]
fn constant_environment_gives_pi_times_its_radiance() {
    let lights = build(&[], true, vec![], Some(EnvironmentMap::constant(Vec3::new(0.2, 0.5, 1.0))));
    assert!(
        !lights.is_empty()
            && (lights.environment(Vec3::X) - Vec3::new(0.2, 0.5, 1.0)).length() < 1e-6
    );
    let mut rng = Rng(13);
    let n = rng.direction();
    for _ in 0..100 {
        // In proportion to the cosine, every single sample is exact.
        let s = lights.sample(Vec3::ZERO, Some(n), rng.next(), rng.vec2()).unwrap();
        let e = s.radiance * (s.wi.dot(n) / s.pdf);
        assert!((e / (PI * Vec3::new(0.2, 0.5, 1.0)) - 1.0).abs().max_element() < 1e-3, "{e}");
    }
    let mut mean = Mean::new();
    for _ in 0..20_000 {
        let s = lights.sample(Vec3::ZERO, None, rng.next(), rng.vec2()).unwrap();
        mean.add(f64::from(s.radiance.y * s.wi.dot(n).max(0.0) / s.pdf));
    }
    assert_mean(&mean, 0.5 * std::f64::consts::PI, "constant environment without a normal");
}

#[test]
fn mixed_lights_add_up() {
    let mut rng = Rng(17);
    let triangles = random_triangles(&mut rng, 3, 0.8);
    let sun = PunctualLight::Directional {
        direction: Vec3::new(0.6, -0.8, 0.0),
        irradiance: Vec3::splat(2.0),
    };
    let lamp = PunctualLight::Point {
        position: Vec3::new(1.0, 2.5, 0.5),
        intensity: Vec3::splat(3.0),
        range: 20.0,
    };
    let lights =
        build(&triangles, true, vec![sun, lamp], Some(EnvironmentMap::constant(Vec3::splat(0.3))));
    let p = Vec3::new(0.3, -0.2, 0.1);
    let to_lamp = Vec3::new(1.0, 2.5, 0.5) - p;
    for n in [Vec3::Y, Vec3::new(-0.6, 0.8, 0.0), Vec3::NEG_Y] {
        let lamp =
            3.0 * (1.0 - (to_lamp.length() / 20.0).powi(4)) * n.dot(to_lamp.normalize()).max(0.0)
                / to_lamp.length_squared();
        let sun = 2.0 * n.dot(Vec3::new(-0.6, 0.8, 0.0)).max(0.0);
        let expected = f64::from(lights.unoccluded_irradiance(p, n).x + 0.3 * PI + lamp + sun);
        for receiver in [None, Some(n)] {
            let mut mean = Mean::new();
            for seed in 0..4000 {
                let mut sum = 0.0;
                lights.stratified(p, receiver, 5, seed, &mut |s| {
                    sum += f64::from(s.radiance.x * s.wi.dot(n).max(0.0) / s.pdf)
                });
                mean.add(sum / 5.0);
            }
            assert_mean(&mean, expected, "environment, sun, lamp and triangles");
        }
    }
}

#[test]
fn map_is_seen_where_it_should_be() {
    // Middle column towards +X, +Z a quarter of the width to its right, +Y at the top.
    let mut map = EnvironmentMap {
        pixels: vec![Vec3::ZERO; 8 * 9],
        width: 8,
        height: 9,
        ..EnvironmentMap::constant(Vec3::ZERO)
    };
    map.pixels[4 * 8 + 4] = Vec3::X;
    map.pixels[4 * 8 + 6] = Vec3::Y;
    map.pixels[..8].fill(Vec3::Z);
    let at = |column: f32| {
        let phi = (column + 0.5 - 4.0) / 8.0 * 2.0 * PI;
        map.radiance(Vec3::new(phi.cos(), 0.0, phi.sin()))
    };
    assert!((at(4.0) - Vec3::X).length() < 1e-5 && (at(6.0) - Vec3::Y).length() < 1e-5);
    assert!(
        (map.radiance(Vec3::X) - 0.5 * Vec3::X).length() < 1e-5
            && (map.radiance(Vec3::Z) - 0.5 * Vec3::Y).length() < 1e-5
    );
    assert!(
        (map.radiance(Vec3::Y) - Vec3::Z).length() < 1e-5 && map.radiance(-Vec3::Y).length() < 1e-5
    );
}

#[test]
fn mirrored_instance_emits_from_its_front_and_names_its_own_vertices() {
    let triangle = [Vec3::new(0.0, 0.0, 2.0), Vec3::new(0.0, 1.0, 2.0), Vec3::new(1.0, 0.0, 2.0)];
    let mut geometry = geometry(&[triangle]);
    geometry.instances[0].to_world = Affine3A::from_scale(Vec3::new(-1.0, 1.0, 1.0));
    let lights = Lights::build(
        &geometry,
        vec![emitter(0, Vec3::ONE, false)],
        vec![],
        None,
        geometry.bounds(),
    );
    let mut rng = Rng(19);
    // The front of the mesh's triangle faces -Z, and mirroring along X keeps it so.
    assert!(lights.sample(Vec3::new(0.0, 0.0, 4.0), None, 0.5, rng.vec2()).is_none());
    for _ in 0..100 {
        let s = lights.sample(Vec3::ZERO, None, rng.next(), rng.vec2()).unwrap();
        let LightSource::Triangle { u, v, .. } = s.source else { panic!("a triangle") };
        let object = triangle[0] * (1.0 - u - v) + triangle[1] * u + triangle[2] * v;
        assert!((object * Vec3::new(-1.0, 1.0, 1.0) - s.wi * s.distance).length() < 1e-5);
    }
}

#[test]
fn useless_lights_are_never_chosen() {
    let good = [Vec3::new(0.0, 0.0, 2.0), Vec3::new(0.0, 1.0, 2.0), Vec3::new(1.0, 0.0, 2.0)];
    let flat = [Vec3::Z, Vec3::Z + Vec3::X, Vec3::Z + 2.0 * Vec3::X];
    let geometry = geometry(&[flat, good, [Vec3::Z; 3], good, good]);
    let radiance = [Vec3::ONE, Vec3::ONE, Vec3::ONE, Vec3::ZERO, Vec3::NAN];
    let mut emitters: Vec<_> =
        radiance.iter().enumerate().map(|(i, &l)| emitter(i, l, true)).collect();
    emitters.push(Emitter { instance: 9, ..emitters[0] });
    emitters.push(Emitter { triangle: 99, ..emitters[0] });
    let dark =
        PunctualLight::Point { position: Vec3::ONE, intensity: Vec3::ZERO, range: f32::INFINITY };
    let broken = EnvironmentMap { width: 3, ..EnvironmentMap::constant(Vec3::ONE) };
    let lights =
        Lights::build(&geometry, emitters, vec![dark.clone()], Some(broken), geometry.bounds());
    let mut rng = Rng(23);
    let mut found = 0;
    for _ in 0..1000 {
        if let Some(s) = lights.sample(rng.cube(), None, rng.next(), rng.vec2()) {
            assert!(matches!(s.source, LightSource::Triangle { triangle: 1, .. }), "{s:?}");
            assert!(s.pdf.is_finite() && s.pdf > 0.0);
            found += 1;
        }
    }
    assert_eq!((found, lights.emitter_count()), (1000, 1));
    assert_eq!(lights.pdf_triangle(Vec3::ZERO, None, 0, 0, Vec3::Z, 1.0), 0.0);
    assert_eq!(lights.pdf_triangle(Vec3::ZERO, None, 7, 7, Vec3::Z, 1.0), 0.0);
    let none = Lights::build(
        &geometry,
        vec![],
        vec![dark],
        Some(EnvironmentMap::constant(Vec3::ZERO)),
        geometry.bounds(),
    );
    assert!(
        none.is_empty()
            && none.power() == Vec3::ZERO
            && none.sample(Vec3::ZERO, None, 0.3, Vec2::ZERO).is_none()
    );
}

#[test]
fn light_below_the_horizon_takes_no_samples() {
    let above = [Vec3::new(-1.0, 2.0, 0.0), Vec3::new(1.0, 2.0, 0.0), Vec3::new(0.0, 2.0, 1.0)];
    let below = above.map(|v| v - 4.0 * Vec3::Y);
    let lights = build(&[above, below], true, vec![], None);
    let mut rng = Rng(29);
    for _ in 0..200 {
        let s = lights.sample(Vec3::ZERO, Some(Vec3::Y), rng.next(), rng.vec2()).unwrap();
        assert!(matches!(s.source, LightSource::Triangle { triangle: 0, .. }));
    }
}

/// A hall of 5000 small ceiling lamps of two triangles, 100 m by 50 m and 4 m high.
fn hall() -> Vec<[Vec3; 3]> {
    let lamp = |i: u32| {
        let corner = Vec3::new((i % 100) as f32, 4.0, (i / 100) as f32);
        let (x, z) = (0.3 * Vec3::X, 0.3 * Vec3::Z);
        [[corner, corner + x, corner + x + z], [corner, corner + x + z, corner + z]]
    };
    (0..5000).flat_map(lamp).collect()
}

#[test]
fn no_ray_that_meets_an_emitter_is_said_to_meet_none() {
    let mut rng = Rng(8);
    let mut triangles = random_triangles(&mut rng, 40, 0.2);
    // One in a plane of the axes, which has no thickness.
    triangles.push([
        Vec3::new(-0.3, 1.5, -0.3),
        Vec3::new(0.3, 1.5, -0.3),
        Vec3::new(0.0, 1.5, 0.3),
    ]);
    let lights = build(&triangles, true, Vec::new(), None);
    let point = |rng: &mut Rng| Vec3::from_array(std::array::from_fn(|_| 6.0 * rng.next() - 3.0));
    let mut spared = 0;
    for k in 0..4000 {
        let origin = point(&mut rng);
        let [a, b, c] = triangles[k % triangles.len()];
        let (u, v) = (rng.next(), rng.next());
        let target = a + u.sqrt() * ((1.0 - v) * (b - a) + v * (c - a));
        assert!(lights.may_shine_along(origin, (target - origin).normalize()), "{origin} {target}");
        // Straight up, with zeros in the direction.
        assert!(lights.may_shine_along(target - Vec3::Y, Vec3::Y));
        spared += usize::from(!lights.may_shine_along(origin, point(&mut rng).normalize()));
    }
    assert!(spared > 400, "only {spared} rays are spared");
    assert!(!lights.may_shine_along(Vec3::splat(9.0), Vec3::ONE.normalize()));
    let sky = build(&[], true, Vec::new(), Some(uneven_map(4)));
    assert!(sky.may_shine_along(Vec3::ZERO, Vec3::Y));
}

#[test]
fn tree_beats_choice_by_power() {
    let triangles = hall();
    let geometry = geometry(&triangles);
    let mut rng = Rng(31);
    let emitters: Vec<_> = (0..triangles.len())
        .map(|i| emitter(i, Vec3::splat(1.0 + 4.0 * (i as f32 * 0.37).sin().abs()), false))
        .collect();
    let power: Vec<f64> = emitters
        .iter()
        .scan(0.0, |sum, e| {
            *sum += f64::from(e.radiance.x);
            Some(*sum)
        })
        .collect();
    let single: Vec<_> = emitters
        .iter()
        .map(|e| Lights::build(&geometry, vec![*e], vec![], None, geometry.bounds()))
        .step_by(10_000)
        .collect();
    drop(single);
    let lights = Lights::build(&geometry, emitters.clone(), vec![], None, geometry.bounds());
    assert_eq!(lights.emitter_count(), 10_000);
    let (mut by_tree, mut by_power, mut stratified) = (0.0, 0.0, 0.0);
    for _ in 0..20 {
        let p = Vec3::new(100.0 * rng.next(), 3.0 * rng.next(), 50.0 * rng.next());
        let n = if rng.next() < 0.5 { Vec3::Y } else { rng.direction() };
        let expected = f64::from(lights.unoccluded_irradiance(p, n).x);
        let (mut tree, mut flat, mut many) = (Mean::new(), Mean::new(), Mean::new());
        for seed in 0..2000 {
            let value = |s: &LightSample| f64::from(s.radiance.x * s.wi.dot(n).max(0.0) / s.pdf);
            tree.add(lights.sample(p, Some(n), rng.next(), rng.vec2()).as_ref().map_or(0.0, value));
            let target = f64::from(rng.next()) * power[power.len() - 1];
            let index = power.partition_point(|&s| s <= target);
            let chosen = lights.emitter(0, index as u32).unwrap();
            let probability = f64::from(emitters[index].radiance.x) / power[power.len() - 1];
            flat.add(f64::from(emitters[index].radiance.x * chosen.irradiance(p, n)) / probability);
            if seed < 200 {
                let mut sum = 0.0;
                lights.stratified(p, Some(n), 16, seed, &mut |s| sum += value(&s));
                many.add(sum / 16.0);
            }
        }
        assert_mean(&tree, expected, "light tree");
        by_tree += tree.variance() / (expected * expected);
        by_power += flat.variance() / (expected * expected);
        stratified += many.variance() * 16.0 / (expected * expected);
    }
    eprintln!(
        "variance relative to the light tree's: by power {:.0}, 16 stratified samples {:.2}",
        by_power / by_tree,
        stratified / by_tree
    );
    assert!(by_power > 10.0 * by_tree && stratified < 0.3 * by_tree);
}

#[test]
fn equal_input_gives_equal_bits() {
    let mut rng = Rng(37);
    let triangles = random_triangles(&mut rng, 500, 0.3);
    let (a, b) = (
        build(&triangles, false, vec![], Some(uneven_map(16))),
        build(&triangles, false, vec![], Some(uneven_map(16))),
    );
    for seed in 0..200 {
        let (p, n) = (rng.cube(), rng.direction());
        let collect = |lights: &Lights| {
            let mut samples = vec![];
            lights.stratified(p, Some(n), 9, seed, &mut |s| samples.push(s));
            samples
        };
        assert_eq!(collect(&a), collect(&b));
    }
}
