//! Orthonormality, derivatives and rotations of both bases against quadrature, differences and
//! exact values.

use lumicache::basis::{
    Basis, HSH_COSINE, Hsh, Jet, LANES, Lane, Sh, ShRotation, Tilt, Turn, gauss_legendre, index,
    rotate_z,
};
use lumicache::math::{DVec3, Frame, Vec3};
use lumicache::sampling::Rng;
use std::f64::consts::{PI, TAU};

/// All functions at one direction.
fn at(basis: &dyn Basis, w: Vec3) -> Vec<f32> {
    let mut out = vec![Lane::default(); basis.count()];
    basis.values(&[w; LANES], &mut out);
    out.iter().map(|v| v[0]).collect()
}

fn jets(basis: &dyn Basis, w: DVec3) -> Vec<Jet> {
    let mut out = vec![Jet::default(); basis.count()];
    basis.jets(w, true, &mut out);
    out
}

/// Directions with weights: `n` cosines from `low` to 1, 2n azimuths.
fn sphere(n: usize, low: f64) -> Vec<(DVec3, f64)> {
    let columns = 2 * n;
    let mut nodes = Vec::new();
    for (z, weight) in gauss_legendre(n, low, 1.0) {
        let r = (1.0 - z * z).sqrt();
        for k in 0..columns {
            let (s, c) = (TAU * k as f64 / columns as f64).sin_cos();
            nodes.push((DVec3::new(r * c, r * s, z), weight * TAU / columns as f64));
        }
    }
    nodes
}

fn random_direction(rng: &mut Rng) -> DVec3 {
    let (u, v) = (f64::from(rng.next_f32()), f64::from(rng.next_f32()));
    let z = 2.0 * u - 1.0;
    let (s, c) = (TAU * v).sin_cos();
    DVec3::new((1.0 - z * z).sqrt() * c, (1.0 - z * z).sqrt() * s, z)
}

fn random_coefficients(rng: &mut Rng, count: usize) -> Vec<f32> {
    (0..count).map(|_| rng.next_f32() - 0.5).collect()
}

fn norm(c: &[f32]) -> f32 {
    c.iter().map(|x| x * x).sum::<f32>().sqrt()
}

#[test]
fn orthonormal() {
    // Products of spherical harmonics are polynomials of the direction, those of hemispherical ones
    // of cos θ and the azimuth: the quadrature is exact for both.
    let bases: [(Box<dyn Basis>, f64); 4] = [
        (Box::new(Sh::new(10)), -1.0),
        (Box::new(Hsh::new(10)), 0.0),
        (Box::new(Sh::new(20)), -1.0),
        (Box::new(Hsh::new(20)), 0.0),
    ];
    for (basis, low) in bases {
        let n = basis.count();
        let mut gram = vec![0.0; n * n];
        for (w, weight) in sphere(2 * basis.order(), low) {
            let values: Vec<f64> = jets(basis.as_ref(), w).iter().map(|j| j.value).collect();
            for i in 0..n {
                for j in 0..n {
                    gram[i * n + j] += weight * values[i] * values[j];
                }
            }
        }
        let worst = (0..n * n)
            .map(|k| (gram[k] - f64::from(u8::from(k / n == k % n))).abs())
            .fold(0.0, f64::max);
        assert!(worst < 1e-11, "order {}: {worst}", basis.order());
    }
}

#[test]
fn single_precision_values_agree_with_double_precision() {
    let mut rng = Rng::new(1);
    for basis in [&Sh::new(20) as &dyn Basis, &Hsh::new(20), &Sh::new(1), &Hsh::new(2)] {
        for _ in 0..200 {
            let mut w = random_direction(&mut rng);
            w.z = w.z.abs().max(1e-3);
            let w = w.normalize();
            let values = at(basis, w.as_vec3());
            for (j, v) in jets(basis, w).iter().zip(values) {
                assert!((j.value - f64::from(v)).abs() < 1e-4, "{w}: {} {v}", j.value);
            }
        }
    }
}

#[test]
fn derivatives_agree_with_differences() {
    let mut rng = Rng::new(2);
    let h = 1e-4;
    for (basis, hemisphere) in [(&Sh::new(10) as &dyn Basis, false), (&Hsh::new(10), true)] {
        for k in 0..60 {
            let mut w = random_direction(&mut rng);
            if hemisphere {
                // Near the horizon differences of this step say nothing of the √cos θ.
                w.z = w.z.abs().max(0.1);
                w = w.normalize();
            }
            if k == 0 {
                w = DVec3::Z;
            }
            let here = jets(basis, w);
            let near: Vec<(Vec<Jet>, Vec<Jet>)> = [DVec3::X, DVec3::Y, DVec3::Z]
                .map(|e| {
                    (jets(basis, (w + h * e).normalize()), jets(basis, (w - h * e).normalize()))
                })
                .into();
            let scale = if hemisphere { 10.0 } else { 1.0 };
            for (i, jet) in here.iter().enumerate() {
                assert!(jet.gradient.dot(w).abs() < 1e-9 * scale * 100.0, "tangential");
                for axis in 0..3 {
                    let (plus, minus) = (&near[axis].0[i], &near[axis].1[i]);
                    let slope = (plus.value - minus.value) / (2.0 * h);
                    assert!(
                        (slope - jet.gradient[axis]).abs() < 2e-5 * scale,
                        "{i} {w}: {slope} {}",
                        jet.gradient
                    );
                    // The gradient of the extension at v is that at v/|v| over |v|.
                    let length =
                        |sign: f64| (w + sign * h * [DVec3::X, DVec3::Y, DVec3::Z][axis]).length();
                    let bend =
                        (plus.gradient / length(1.0) - minus.gradient / length(-1.0)) / (2.0 * h);
                    let error = (bend - jet.hessian.col(axis)).length();
                    assert!(error < 2e-4 * scale * scale, "{i} {w} {axis}: {bend} {}", jet.hessian);
                }
            }
        }
    }
}

#[test]
fn the_cosine_is_two_hemispherical_harmonics() {
    let hsh = Hsh::new(2);
    for w in [Vec3::Z, Vec3::new(0.6, 0.0, 0.8), Vec3::new(0.3, -0.9, 0.316_227_76).normalize()] {
        let h = at(&hsh, w);
        assert!((HSH_COSINE[0] * h[0] + HSH_COSINE[1] * h[2] - w.z).abs() < 1e-6);
    }
    assert!((f64::from(HSH_COSINE[0]) - (2.0 * PI).sqrt() / 2.0).abs() < 1e-7);
    assert!((f64::from(HSH_COSINE[1]) - 0.5 * (2.0 * PI / 3.0).sqrt()).abs() < 1e-7);
    // A constant has one coefficient, sqrt(2π).
    let sum: f64 = sphere(8, 0.0).iter().map(|(w, weight)| weight * jets(&hsh, *w)[0].value).sum();
    assert!((sum - TAU.sqrt()).abs() < 1e-12);
}

/// Zonal coefficients of a function of cos θ.
fn zonal(basis: &dyn Basis, low: f64, f: impl Fn(f64) -> f64) -> Vec<f64> {
    let mut c = vec![0.0; basis.order()];
    for (z, weight) in gauss_legendre(200, low, 1.0) {
        let values = jets(basis, DVec3::new((1.0 - z * z).sqrt(), 0.0, z));
        (0..basis.order()).for_each(|l| c[l] += TAU * weight * f(z) * values[index(l, 0)].value);
    }
    c
}

#[test]
fn a_clamped_cosine_in_spherical_harmonics() {
    let c = zonal(&Sh::new(9), 0.0, |z| z);
    let known = [
        0.886_226_9,
        1.023_326_7,
        0.495_415_9,
        0.0,
        -0.110_778_4,
        0.0,
        0.049_927_1,
        0.0,
        -0.028_546_9,
    ];
    let total = TAU / 3.0;
    let shares = [0.375, 0.875, 0.992_2, 0.992_2, 0.998_0];
    let mut sum = 0.0;
    for (l, (c, known)) in c.iter().zip(known).enumerate() {
        assert!((c - known).abs() < 1e-6, "{l}: {c}");
        sum += c * c;
        if let Some(share) = shares.get(l) {
            assert!((sum / total - share).abs() < 1e-4, "{l}: {}", sum / total);
        }
    }
}

#[test]
fn phong_lobes_have_their_known_coefficients_and_orders() {
    let sh = Sh::new(20);
    for (s, bands) in [(4, 4), (7, 5), (15, 7), (22, 9), (50, 13), (100, 18)] {
        let lobe = |z: f64| f64::from(s + 1) / TAU * z.powi(s);
        let c = zonal(&sh, 0.0, lobe);
        // Normalised to 1 for l = 0: A_l = A_{l-2} (s-l+2)/(s+l+1).
        let s = f64::from(s);
        let mut a = vec![1.0, (s + 1.0) / (s + 2.0)];
        (2..20).for_each(|l| a.push(a[l - 2] * (s - l as f64 + 2.0) / (s + l as f64 + 1.0)));
        for l in 0..20 {
            let normalised = c[l] / ((2 * l + 1) as f64 / (4.0 * PI)).sqrt();
            assert!((normalised - a[l]).abs() < 1e-9, "{s} {l}: {normalised} {}", a[l]);
        }
        let energy = (s + 1.0).powi(2) / TAU / (2.0 * s + 1.0);
        let mut lost = 1.0;
        let first = (0..20).find(|&l| {
            lost -= c[l] * c[l] / energy;
            lost < 0.05
        });
        assert_eq!(first, Some(bands - 1), "exponent {s}");
    }
}

#[test]
fn rotation_about_the_pole_is_exact() {
    let mut rng = Rng::new(3);
    for basis in [&Sh::new(10) as &dyn Basis, &Hsh::new(10)] {
        let c = random_coefficients(&mut rng, 100);
        for angle in [0.3, -2.0, 3.1] {
            let mut rotated = c.clone();
            rotate_z(&mut rotated, angle);
            let w = Vec3::new(0.48, -0.64, 0.6);
            let turn = Turn { alpha: -angle, beta: 0.0, gamma: 0.0 };
            let value = |c: &[f32], w| at(basis, w).iter().zip(c).map(|(h, c)| h * c).sum::<f32>();
            assert!((value(&rotated, w) - value(&c, turn.apply(w))).abs() < 1e-4);
        }
    }
}

#[test]
fn turns_between_frames() {
    let mut rng = Rng::new(4);
    for k in 0..200 {
        let from = Frame::from_normal(random_direction(&mut rng).as_vec3());
        let n = if k % 3 == 0 { from.n } else { random_direction(&mut rng).as_vec3() };
        let to = Frame::from_normal_tangent(n, random_direction(&mut rng).as_vec3());
        let turn = Turn::between(&from, &to);
        let v = random_direction(&mut rng).as_vec3();
        let expected = to.to_local(from.to_world(v));
        assert!(
            (turn.apply(v) - expected).length() < 2e-5,
            "{turn:?} {} {expected}",
            turn.apply(v)
        );
        assert!((turn.inverse().apply(expected) - v).length() < 2e-5);
    }
}

#[test]
fn spherical_harmonics_rotate_exactly() {
    let mut rng = Rng::new(5);
    for order in [1, 2, 5, 10, 20] {
        let (sh, rotation) = (Sh::new(order), ShRotation::new(order));
        let value = |c: &[f32], w| at(&sh, w).iter().zip(c).map(|(h, c)| h * c).sum::<f32>();
        for beta in [0.0, 0.4, 1.5, 3.0] {
            let c = random_coefficients(&mut rng, sh.count());
            let turn = Turn { alpha: 1.0, beta, gamma: -2.5 };
            let mut rotated = c.clone();
            rotation.rotate(&mut rotated, turn);
            for _ in 0..10 {
                let w = random_direction(&mut rng).as_vec3();
                let (a, b) = (value(&rotated, w), value(&c, turn.inverse().apply(w)));
                assert!(
                    (a - b).abs() < 2e-5 * order as f32 * order as f32,
                    "{order} {beta}: {a} {b}"
                );
            }
            let mut back = rotated;
            rotation.rotate(&mut back, turn.inverse());
            let error: Vec<f32> = back.iter().zip(&c).map(|(a, b)| a - b).collect();
            assert!(
                norm(&error) < 1e-5 * norm(&c) * order as f32,
                "{order} {beta}: {}",
                norm(&error)
            );
            // Two rotations are one.
            let second = Turn { alpha: 0.2, beta: 0.7, gamma: 0.4 };
            let both = Frame {
                s: second.apply(turn.apply(Vec3::X)),
                t: second.apply(turn.apply(Vec3::Y)),
                n: second.apply(turn.apply(Vec3::Z)),
            };
            let world = Frame { s: Vec3::X, t: Vec3::Y, n: Vec3::Z };
            let once = Turn::between(&both, &world);
            let (mut x, mut y) = (c.clone(), c.clone());
            rotation.rotate(&mut x, turn);
            rotation.rotate(&mut x, second);
            rotation.rotate(&mut y, once);
            let error: Vec<f32> = x.iter().zip(&y).map(|(a, b)| a - b).collect();
            assert!(norm(&error) < 1e-4 * norm(&c), "{order}: {}", norm(&error));
        }
    }
}

#[test]
fn small_tilts_err_by_less_than_a_thousandth() {
    let mut rng = Rng::new(6);
    for order in [3, 5, 10] {
        let rotation = ShRotation::new(order);
        for degrees in [0.2f32, 1.0, 1.1, 2.0, 2.5, 5.0] {
            let beta = degrees.to_radians();
            let c = random_coefficients(&mut rng, order * order);
            // A small tilt at once, and as the difference of two large ones, which no series makes.
            let (mut a, mut b) = (c.clone(), c.clone());
            rotation.rotate(&mut a, Turn { alpha: 0.5, beta, gamma: 1.0 });
            rotation.rotate(&mut b, Turn { alpha: 0.0, beta: 1.0 + beta, gamma: 1.0 });
            rotation.rotate(&mut b, Turn { alpha: 0.0, beta: 1.0, gamma: 0.0 }.inverse());
            rotate_z(&mut b, 0.5);
            let error: Vec<f32> = a.iter().zip(&b).map(|(a, b)| a - b).collect();
            assert!(
                norm(&error) < 1e-3 * norm(&c),
                "{order} {degrees}: {}",
                norm(&error) / norm(&c)
            );
        }
    }
}

#[test]
fn tilting_a_constant_loses_what_sinks() {
    let tilt = Tilt::new(10);
    for (degrees, share) in [(0.0f32, 1.0), (5.0, 0.984), (10.0, 0.967), (20.0, 0.938)] {
        let mut c = vec![0.0; 100];
        c[0] = 1.0;
        tilt.rotate(&mut c, Turn { alpha: 0.3, beta: degrees.to_radians(), gamma: 2.0 });
        assert!((norm(&c) - share).abs() < 2e-3, "{degrees}: {}", norm(&c));
    }
}

#[test]
fn a_tilted_lobe_is_the_lobe_elsewhere() {
    // A lobe about a direction high above both horizons loses nothing, and its projection onto
    // order 10 is exact to its own truncation.
    let (hsh, tilt) = (Hsh::new(10), Tilt::new(10));
    let project = |axis: DVec3| {
        let mut c = vec![0f32; 100];
        for (w, weight) in sphere(40, 0.0) {
            let lobe = w.dot(axis).max(0.0).powi(12) * weight;
            c.iter_mut().zip(jets(&hsh, w)).for_each(|(c, j)| *c += (lobe * j.value) as f32);
        }
        c
    };
    let turn = Turn { alpha: 0.7, beta: 14.2f32.to_radians(), gamma: 1.1 };
    let axis = DVec3::new(0.1, 0.05, 0.99).normalize();
    let mut tilted = project(axis);
    tilt.rotate(&mut tilted, turn);
    let expected = project(turn.apply(axis.as_vec3()).as_dvec3());
    let error: Vec<f32> = tilted.iter().zip(&expected).map(|(a, b)| a - b).collect();
    assert!(norm(&error) < 0.01 * norm(&expected), "{}", norm(&error) / norm(&expected));
    let mut wrong = project(axis);
    tilt.rotate(&mut wrong, turn.inverse());
    let error: Vec<f32> = wrong.iter().zip(&expected).map(|(a, b)| a - b).collect();
    assert!(norm(&error) > 0.3 * norm(&expected), "the test tells a rotation from its inverse");
}

#[test]
fn tilts_never_add_energy() {
    let mut rng = Rng::new(7);
    for order in [2, 6, 14] {
        let tilt = Tilt::new(order);
        for degrees in [0.3f32, 4.0, 17.0, 44.0] {
            let c = random_coefficients(&mut rng, order * order);
            let mut tilted = c.clone();
            tilt.rotate(&mut tilted, Turn { alpha: 0.4, beta: degrees.to_radians(), gamma: 1.0 });
            assert!(
                norm(&tilted) < 1.0001 * norm(&c),
                "order {order}, {degrees}: {}",
                norm(&tilted) / norm(&c)
            );
            // A function of a lower order is the same function in a table of a higher one, up to
            // what is cut off.
            let half = (order / 2).max(1).pow(2);
            let (mut short, mut long) = (c[..half].to_vec(), c.clone());
            long[half..].fill(0.0);
            let turn = Turn { alpha: 0.0, beta: degrees.to_radians(), gamma: 2.0 };
            tilt.rotate(&mut short, turn);
            tilt.rotate(&mut long, turn);
            let error: Vec<f32> = short.iter().zip(&long).map(|(a, b)| a - b).collect();
            assert!(norm(&error) < 1e-5 * norm(&c));
        }
    }
}
