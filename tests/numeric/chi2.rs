//! Pearson's chi-square test: the directions that a BSDF draws follow the density that it states.
//!
//! Every surface of the collection, seen from four directions, by both samplers, in two grids: one
//! even over the sphere and, for sharp lobes, one that narrows towards the mirror direction. Draws
//! without a direction and delta directions form one more cell, which holds what the density leaves
//! of 1. The significance is 0.01 for each test function as a whole (Šidák), so with a fresh seed
//! one run in a hundred would raise a false alarm; the seeds are fixed.

use crate::support::bsdfs::{Chart, axis_of, cells, integrate, views, zoo};
use crate::support::statistics::Rng;
use lumicache::material::{Bsdf, BsdfSample};
use lumicache::math::{Vec2, Vec3};

const NT: usize = 24;
const NS: usize = 24;
const SAMPLES: usize = 60_000;
const SIGNIFICANCE: f64 = 0.01;

/// Probability that a normal variable exceeds `z` [Abramowitz64, Eq. 7.1.26].
fn normal_tail(z: f64) -> f64 {
    let x = z.abs() / std::f64::consts::SQRT_2;
    let t = 1.0 / (1.0 + 0.327_591_1 * x);
    let poly = t
        * (0.254_829_592
            + t * (-0.284_496_736
                + t * (1.421_413_741 + t * (-1.453_152_027 + t * 1.061_405_429))));
    let tail = 0.5 * poly * (-x * x).exp();
    if z < 0.0 { 1.0 - tail } else { tail }
}

/// Probability that a chi-square variable with `k` degrees of freedom exceeds `x` [Wilson31].
fn chi2_tail(x: f64, k: f64) -> f64 {
    let v = 2.0 / (9.0 * k);
    normal_tail(((x / k).cbrt() - (1.0 - v)) / v.sqrt())
}

type Sampler<'a> = &'a dyn Fn(f32, Vec2) -> Option<BsdfSample>;

/// The p-value of the hypothesis that the draws of `sample` have density `pdf`.
fn p_value(chart: &Chart, seed: u64, pdf: &dyn Fn(Vec3) -> f32, sample: Sampler) -> f64 {
    let density = |w: Vec3| [f64::from(pdf(w)), 0.0, 0.0, 0.0];
    let mut expected: Vec<f64> =
        cells(NT, NS).map(|c| integrate(chart, c, 3e-6, 7, &density)[0]).collect();
    let total: f64 = expected.iter().sum();
    assert!(total <= 1.0 + 1e-3, "the density integrates to {total}");
    expected.push((1.0 - total).max(0.0));
    let mut observed = vec![0.0; NT * NS + 1];
    let mut rng = Rng(seed);
    for _ in 0..SAMPLES {
        let cell = match sample(rng.next(), rng.vec2()) {
            Some(s) if s.pdf.is_finite() => {
                let (t, s) = chart.coordinates(s.wi);
                (t * NT as f64) as usize * NS + (s * NS as f64) as usize
            }
            _ => NT * NS,
        };
        observed[cell] += 1.0;
    }
    // Pool small cells until each pool expects at least five.
    let mut order: Vec<usize> = (0..expected.len()).collect();
    order.sort_by(|&a, &b| expected[a].total_cmp(&expected[b]));
    let (mut statistic, mut pools) = (0.0, 0);
    let (mut e, mut o) = (0.0, 0.0);
    for (rank, &cell) in order.iter().enumerate() {
        e += expected[cell] * SAMPLES as f64;
        o += observed[cell];
        if e >= 5.0 || (rank + 1 == order.len() && e > 0.0) {
            statistic += (o - e) * (o - e) / e;
            pools += 1;
            (e, o) = (0.0, 0.0);
        }
    }
    if pools < 2 { 1.0 } else { chi2_tail(statistic, f64::from(pools - 1)) }
}

/// Runs the test on both samplers of all surfaces with lobes of at most `width`, in the chart that
/// `chart` gives for each.
fn run(width: f64, chart: impl Fn(&Bsdf, Vec3) -> Chart) {
    let zoo: Vec<_> = zoo().into_iter().filter(|(_, _, w)| *w <= width).collect();
    let count = zoo.len() * views().len() * 2;
    let threshold = 1.0 - (1.0 - SIGNIFICANCE).powf(1.0 / count as f64);
    let mut failures = Vec::new();
    for (index, (name, b, _)) in zoo.iter().enumerate() {
        for (v, wo) in views().into_iter().enumerate() {
            let chart = chart(b, wo);
            let seed = (index * 16 + v) as u64;
            let all = p_value(&chart, seed, &|wi| b.pdf(wo, wi), &|x, u| b.sample(wo, x, u));
            let glossy = p_value(&chart, seed + 8, &|wi| b.pdf_glossy(wo, wi), &|x, u| {
                b.sample_glossy(wo, x, u)
            });
            for (which, p) in [("all lobes", all), ("glossy lobes", glossy)] {
                if p < threshold {
                    failures
                        .push(format!("{name}, {which}, view {wo}: p = {p:.2e} < {threshold:.2e}"));
                }
            }
        }
    }
    assert!(failures.is_empty(), "\n{}", failures.join("\n"));
}

#[test]
fn samples_follow_the_density_over_the_sphere() {
    run(f64::INFINITY, |_, _| Chart::normal());
}

#[test]
fn samples_follow_the_density_around_the_mirror_direction() {
    run(0.2, |b, wo| Chart::about(axis_of(b, wo)));
}

#[test]
fn the_density_from_below_a_boundary_is_the_one_sampled() {
    // `wo` below the surface, as seen by a path that comes from inside.
    let zoo = zoo();
    let transmitting: Vec<_> = zoo.iter().filter(|(_, b, _)| b.transmits()).collect();
    let threshold = 1.0 - (1.0 - SIGNIFICANCE).powf(1.0 / (2 * transmitting.len()) as f64);
    for (index, (name, b, _)) in transmitting.into_iter().enumerate() {
        for (v, wo) in
            [crate::support::bsdfs::at(150.0, 40.0), crate::support::bsdfs::at(110.0, 40.0)]
                .into_iter()
                .enumerate()
        {
            let seed = (1000 + index * 16 + v) as u64;
            let p =
                p_value(&Chart::normal(), seed, &|wi| b.pdf(wo, wi), &|x, u| b.sample(wo, x, u));
            assert!(p >= threshold, "{name}, view {wo}: p = {p:.2e} < {threshold:.2e}");
        }
    }
}

#[test]
fn the_test_itself_notices_a_wrong_density() {
    let (_, b, _) = zoo().swap_remove(2);
    let wo = views()[1];
    let wrong = |wi: Vec3| b.pdf(wo, wi) * 0.9 + 0.1 * wi.z.max(0.0) * std::f32::consts::FRAC_1_PI;
    assert!(p_value(&Chart::normal(), 1, &wrong, &|x, u| b.sample(wo, x, u)) < 1e-6);
    assert!(
        (chi2_tail(18.307, 10.0) - 0.05).abs() < 2e-3,
        "tabulated 5 % point of 10 degrees of freedom"
    );
}
