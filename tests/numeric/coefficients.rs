//! Derivatives of radiance coefficients from the triangulated hemisphere, in the scene of
//! [`crate::numeric::derivative`], against differences of exact coefficients.

use crate::numeric::derivative::receiver;
use crate::numeric::hessians::{Ceiling, gathered, open, t2, t3};
use crate::numeric::radiance::{T2, T3, exact, exact_gradient, norm, off};
use lumicache::basis::{Basis, Sh};
use lumicache::gather::{RadianceDerivatives, RadianceProbe, TriangleRadiance};

type Area = crate::numeric::radiance::Area;

/// The exact second derivatives: along x twice, x and y, y twice.
fn exact_hessian(basis: &dyn Basis, blocker: Option<Area>) -> [Vec<f64>; 3] {
    let (x, y, h) = (0.45, 0.30, 2e-3);
    let at = |i: f64, j: f64| exact(basis, [x + h * i, y + h * j], blocker);
    let middle = at(0.0, 0.0);
    let twice = |a: Vec<f64>, b: Vec<f64>| {
        (0..middle.len()).map(|i| (a[i] - 2.0 * middle[i] + b[i]) / (h * h)).collect()
    };
    let (pp, pm, mp, mm) = (at(1.0, 1.0), at(1.0, -1.0), at(-1.0, 1.0), at(-1.0, -1.0));
    let mixed =
        (0..middle.len()).map(|i| (pp[i] - pm[i] - mp[i] + mm[i]) / (4.0 * h * h)).collect();
    [twice(at(1.0, 0.0), at(-1.0, 0.0)), mixed, twice(at(0.0, 1.0), at(0.0, -1.0))]
}

/// Means over `runs` seeds of the red channel.
fn estimate(
    probe: &dyn RadianceProbe, basis: &Sh, n: u32, runs: u64, rule: TriangleRadiance,
) -> ([Vec<f64>; 2], [Vec<f64>; 3]) {
    let count = basis.count();
    let (mut gradient, mut hessian) = (
        [vec![0.0; count], vec![0.0; count]],
        [vec![0.0; count], vec![0.0; count], vec![0.0; count]],
    );
    for seed in 0..runs {
        let d: RadianceDerivatives =
            gathered(probe, &receiver(), n, seed).radiance_derivatives(basis, rule, true);
        for (sum, got) in
            gradient.iter_mut().chain(&mut hessian).zip(d.gradient.iter().chain(&d.hessian))
        {
            sum.iter_mut().zip(got).for_each(|(s, g)| *s += f64::from(*g) / runs as f64);
        }
    }
    (gradient, hessian)
}

/// The distance of two triples of vectors over the norm of the second; the mixed derivative counts
/// twice, as in Frobenius' norm.
fn off_twice(a: &[Vec<f64>; 3], b: &[Vec<f64>; 3]) -> f64 {
    let square = |f: &dyn Fn(usize, usize) -> f64| -> f64 {
        (0..3)
            .map(|d| [1.0, 2.0, 1.0][d] * (0..b[0].len()).map(|i| f(d, i).powi(2)).sum::<f64>())
            .sum()
    };
    (square(&|d, i| a[d][i] - b[d][i]) / square(&|d, i| b[d][i])).sqrt()
}

fn errors(
    probe: &Ceiling, blocker: Option<Area>, order: usize, n: u32, runs: u64, rule: TriangleRadiance,
) -> (f64, f64) {
    let basis = Sh::new(order);
    let (gradient, hessian) = estimate(probe, &basis, n, runs, rule);
    (
        off(&gradient, &exact_gradient(&basis, blocker)),
        off_twice(&hessian, &exact_hessian(&basis, blocker)),
    )
}

#[test]
fn an_open_lamp_has_the_derivatives_of_its_coefficients() {
    for (order, gradient, hessian) in [(3, 0.01, 0.05), (10, 0.02, 0.08)] {
        let (g, h) = errors(&open(), None, order, 96, 8, TriangleRadiance::Hybrid);
        println!("order {order}: gradient off by {g:.4}, Hessian by {h:.4}");
        assert!(g < gradient && h < hessian, "order {order}: gradient off by {g}, Hessian by {h}");
    }
}

#[test]
fn silhouettes_move_the_coefficients() {
    for (probe, blocker, name, limits) in
        [(t2(), T2, "T2", [0.06, 0.1]), (t3(), T3, "T3", [0.11, 0.14])]
    {
        for (order, limit) in [3, 10].into_iter().zip(limits) {
            let (g, h) = errors(&probe, Some(blocker), order, 96, 8, TriangleRadiance::Hybrid);
            println!("{name}, order {order}: gradient off by {g:.4}, Hessian by {h:.4}");
            assert!(g < limit, "{name}, order {order}: gradient off by {g}");
        }
    }
}

#[test]
fn a_shadow_s_hessian_is_approached_as_the_samples_get_denser() {
    let [coarse, fine] =
        [48, 192].map(|n| errors(&t3(), Some(T3), 6, n, 8, TriangleRadiance::Hybrid).1);
    println!("{coarse:.3} {fine:.3}");
    assert!(fine < 0.45 * coarse, "{coarse} {fine}");
}

#[test]
fn the_constant_and_the_cosine_agree_with_irradiance() {
    // Irradiance is a sum of coefficients: its derivatives from the same mesh are the sums of
    // theirs, up to the bands that the cosine lacks.
    let samples = gathered(&t2(), &receiver(), 48, 5);
    let basis = Sh::new(9);
    let d = samples.radiance_derivatives(&basis, TriangleRadiance::Hybrid, true);
    let e = samples.triangulated(TriangleRadiance::Hybrid);
    // The clamped cosine.
    let zonal = [
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
    let sum = |c: &[f32]| -> f64 {
        zonal.iter().enumerate().map(|(l, a)| a * f64::from(c[l * l + l])).sum()
    };
    let got = [
        sum(&d.gradient[0]),
        sum(&d.gradient[1]),
        sum(&d.hessian[0]),
        sum(&d.hessian[1]),
        sum(&d.hessian[2]),
    ];
    let expected = [e.gradient.s.x, e.gradient.t.x, e.hessian.ss.x, e.hessian.st.x, e.hessian.tt.x]
        .map(f64::from);
    for (g, x) in got.iter().zip(expected) {
        assert!((g - x).abs() < 0.05 * norm(&expected), "{got:?} {expected:?}");
    }
}

#[test]
fn a_uniform_world_has_no_derivatives() {
    struct Uniform;
    impl RadianceProbe for Uniform {
        fn incoming(
            &self, _: &lumicache::geometry::SurfacePoint, _: u8, _: &dyn lumicache::gather::Deeper,
            bundle: &mut lumicache::gather::Bundle,
        ) {
            for k in 0..bundle.len() {
                bundle.radiance[k] = lumicache::math::Color::ONE;
                bundle.distance[k] = if k % 3 == 0 { f32::INFINITY } else { 1.0 + (k % 7) as f32 };
            }
        }
    }
    let d = gathered(&Uniform, &receiver(), 32, 1).radiance_derivatives(
        &Sh::new(10),
        TriangleRadiance::Hybrid,
        true,
    );
    assert!(d.gradient.iter().chain(&d.hessian).flatten().all(|x| x.abs() < 1e-6));
}
