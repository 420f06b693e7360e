//! Radiance coefficients of a gather, their gradients, and the tables of lobes that they are
//! multiplied with.
//!
//! The gradients are compared with exact ones in the scene of the derivative tests: a square lamp
//! of radiance 1 at height 2, and black rectangles at height 1. What the receiver sees of the lamp
//! is the square without the shadows of the rectangles, which are rectangles too, so a coefficient
//! is a sum of smooth integrals over rectangles, and its gradient a difference of those.

use crate::numeric::derivative::{LampAndOccluders, occluder, receiver};
use crate::support::bsdfs::{hemisphere, values};
use lumicache::basis::{Basis, HSH_COSINE, Hsh, Jet, Sh, gauss_legendre};
use lumicache::gather::{
    Bundle, Coefficients, Deeper, Density, HemisphereSamples, Layout, NoDeeper, RadianceGradient,
    RadianceProbe,
};
use lumicache::geometry::SurfacePoint;
use lumicache::math::{Color, DVec3, Vec3};
use lumicache::sampling::Rng;
use std::f64::consts::TAU;

/// The part of the lamp's plane between `min` and `max`.
pub type Area = [[f64; 2]; 2];

/// The lamp without the shadow that `blocker` at height 1 throws from `(x, y, 0)`, as rectangles.
fn visible([x, y]: [f64; 2], blocker: Option<Area>) -> Vec<Area> {
    let lamp = [[-1.0, -1.0], [1.0, 1.0]];
    let Some(blocker) = blocker else { return vec![lamp] };
    // Twice as high, twice as far.
    let shadow = |c: [f64; 2]| [2.0 * c[0] - x, 2.0 * c[1] - y].map(|v| v.clamp(-1.0, 1.0));
    let [low, high] = blocker.map(shadow);
    vec![
        [[-1.0, -1.0], [1.0, low[1]]],
        [[-1.0, high[1]], [1.0, 1.0]],
        [[-1.0, low[1]], [low[0], high[1]]],
        [[high[0], low[1]], [1.0, high[1]]],
    ]
}

/// The exact coefficients at `(x, y, 0)`.
pub fn exact(basis: &dyn Basis, [x, y]: [f64; 2], blocker: Option<Area>) -> Vec<f64> {
    let mut c = vec![0.0; basis.count()];
    let mut jets = vec![Jet::default(); basis.count()];
    for [low, high] in visible([x, y], blocker) {
        for (u, weight_u) in gauss_legendre(24, low[0], high[0]) {
            for (v, weight_v) in gauss_legendre(24, low[1], high[1]) {
                let to = DVec3::new(u - x, v - y, 2.0);
                let w = to.normalize();
                basis.jets(w, false, &mut jets);
                let solid_angle = weight_u * weight_v * w.z / to.length_squared();
                c.iter_mut().zip(&jets).for_each(|(c, j)| *c += solid_angle * j.value);
            }
        }
    }
    c
}

pub fn exact_gradient(basis: &dyn Basis, blocker: Option<Area>) -> [Vec<f64>; 2] {
    let (x, y, h) = (0.45, 0.30, 1e-4);
    let difference =
        |a: Vec<f64>, b: Vec<f64>| a.iter().zip(b).map(|(a, b)| (a - b) / (2.0 * h)).collect();
    [
        difference(exact(basis, [x + h, y], blocker), exact(basis, [x - h, y], blocker)),
        difference(exact(basis, [x, y + h], blocker), exact(basis, [x, y - h], blocker)),
    ]
}

/// Means over seeds of the red coefficients and their gradient.
fn estimate(
    probe: &LampAndOccluders, basis: &dyn Basis, layout: Layout, density: Density,
    kind: RadianceGradient,
) -> (Vec<f64>, [Vec<f64>; 2]) {
    let mut samples = HemisphereSamples::new(layout, density);
    let n = basis.count();
    let (mut value, mut gradient) = (vec![0.0; n], [vec![0.0; n], vec![0.0; n]]);
    let runs = 12;
    let add = |sum: &mut Vec<f64>, c: &Coefficients| {
        sum.iter_mut().zip(c).for_each(|(s, c)| *s += f64::from(*c) / runs as f64)
    };
    for seed in 0..runs {
        samples.gather(probe, &receiver(), 0, &NoDeeper, seed);
        add(&mut value, &samples.project(basis));
        let g = samples.radiance_gradient(basis, kind);
        gradient.iter_mut().zip(&g).for_each(|(sum, g)| add(sum, g));
    }
    (value, gradient)
}

pub fn norm(v: &[f64]) -> f64 {
    v.iter().map(|x| x * x).sum::<f64>().sqrt()
}

/// The distance of two pairs of vectors over the norm of the second.
pub fn off(a: &[Vec<f64>; 2], b: &[Vec<f64>; 2]) -> f64 {
    let difference = |k: usize| a[k].iter().zip(&b[k]).map(|(a, b)| a - b).collect::<Vec<f64>>();
    norm(&difference(0)).hypot(norm(&difference(1))) / norm(&b[0]).hypot(norm(&b[1]))
}

const POLAR: Layout = Layout::Polar { m: 48, n: 150 };
pub const T2: Area = [[0.2, -0.5], [1.2, 0.5]];
pub const T3: Area = [[0.25, 0.1], [0.55, 0.4]];

#[test]
fn radiance_and_irradiance_of_one_gather_agree() {
    let probe = LampAndOccluders::open();
    for (layout, density) in
        [(Layout::polar(1000), Density::Cosine), (Layout::concentric(900), Density::Uniform)]
    {
        let mut samples = HemisphereSamples::new(layout, density);
        samples.gather(&probe, &receiver(), 0, &NoDeeper, 3);
        let c = samples.project(&Hsh::new(6));
        let e = samples.irradiance();
        for channel in 0..3 {
            let sum = HSH_COSINE[0] * c[36 * channel] + HSH_COSINE[1] * c[36 * channel + 2];
            assert!((sum - e[channel]).abs() < 3e-6, "{sum} {}", e[channel]);
        }
    }
}

#[test]
fn open_lamp_by_every_gradient() {
    let open = LampAndOccluders::open();
    for basis in [&Hsh::new(6) as &dyn Basis, &Sh::new(6)] {
        let (value, gradient) = (exact(basis, [0.45, 0.30], None), exact_gradient(basis, None));
        for kind in [
            RadianceGradient::Boundary,
            RadianceGradient::PerSample,
            RadianceGradient::Displacement,
        ] {
            for density in [Density::Cosine, Density::Uniform] {
                let (v, g) = estimate(&open, basis, POLAR, density, kind);
                let error = norm(&v.iter().zip(&value).map(|(a, b)| a - b).collect::<Vec<_>>());
                assert!(error < 6e-3 * norm(&value), "{error}");
                assert!(
                    off(&g, &gradient) < 0.02,
                    "{kind:?} {density:?}: off by {}",
                    off(&g, &gradient)
                );
            }
        }
    }
}

#[test]
fn only_the_boundary_gradient_sees_silhouettes() {
    // The rectangle of T3 is no wider than five strata, or than three with uniform density.
    for (blocker, name, tolerance) in [(T2, "T2", 0.03), (T3, "T3", 0.1)] {
        let probe = occluder(blocker[0].map(|v| v as f32), blocker[1].map(|v| v as f32));
        for basis in [&Hsh::new(6) as &dyn Basis, &Sh::new(6)] {
            let gradient = exact_gradient(basis, Some(blocker));
            for density in [Density::Cosine, Density::Uniform] {
                let (_, g) = estimate(&probe, basis, POLAR, density, RadianceGradient::Boundary);
                assert!(
                    off(&g, &gradient) < tolerance,
                    "{name} {density:?}: off by {}",
                    off(&g, &gradient)
                );
            }
            let (_, g) =
                estimate(&probe, basis, POLAR, Density::Cosine, RadianceGradient::PerSample);
            assert!(
                off(&g, &gradient) > 0.1,
                "{name}: patches that keep their visibility are off by {}",
                off(&g, &gradient)
            );
        }
    }
}

#[test]
fn displacement_is_the_per_sample_gradient() {
    let probe = occluder([0.2, -0.5], [1.2, 0.5]);
    let basis = Hsh::new(5);
    let (_, a) = estimate(
        &probe,
        &basis,
        Layout::concentric(1024),
        Density::Cosine,
        RadianceGradient::Displacement,
    );
    let (_, b) = estimate(
        &probe,
        &basis,
        Layout::concentric(1024),
        Density::Cosine,
        RadianceGradient::PerSample,
    );
    assert!(off(&a, &b) < 2e-3, "{}", off(&a, &b));
}

/// Light that is uniform at random between 0 and 2 where x > 0, and 1 elsewhere.
struct Coins;

impl RadianceProbe for Coins {
    fn incoming(&self, _: &SurfacePoint, _: u8, _: &dyn Deeper, bundle: &mut Bundle) {
        let mut rng = Rng::new(bundle.seed);
        for (radiance, w) in bundle.radiance.iter_mut().zip(&bundle.dir_local) {
            let random = 2.0 * rng.next_f32();
            *radiance = Color::splat(if w.x > 0.0 { random } else { 1.0 });
        }
    }
}

#[test]
fn uncertainty_is_where_the_noise_is() {
    // The variance of a sample is 1/3, and it stands for 2π/N: of the lobe c = 1 + x over the half
    // x > 0, ∫ c² = π + π + π/3.
    let basis = Hsh::new(6);
    let (layout, runs) = (Layout::polar(512), 400);
    let mut samples = HemisphereSamples::new(layout, Density::Uniform);
    let (mut spread, mut expected, mut sides) = (0.0, 0.0, [0.0; 2]);
    let integrate = |v: &[f32], f: &dyn Fn(Vec3) -> f64| -> f64 {
        let at =
            |w: Vec3| values(&basis, w).iter().zip(v).map(|(b, v)| f64::from(b * v)).sum::<f64>();
        hemisphere().into_iter().map(|(w, solid_angle)| solid_angle * at(w) * f(w)).sum()
    };
    for seed in 0..runs {
        samples.gather(&Coins, &receiver(), 0, &NoDeeper, seed);
        let mean =
            |k: usize| samples.bundle().radiance[k].x * (1.0 + samples.bundle().dir_local[k].x);
        // The quadrature of a constant world is no part of the noise.
        let excess: f32 =
            (0..layout.rays()).map(|k| mean(k) - (1.0 + samples.bundle().dir_local[k].x)).sum();
        spread += (f64::from(excess) * TAU / layout.rays() as f64).powi(2) / runs as f64;
        if seed < 20 {
            let v = samples.uncertainty(&basis);
            expected += integrate(&v, &|w| f64::from(1.0 + w.x).powi(2)) / 20.0;
            sides[0] += integrate(&v, &|w| f64::from(w.x > 0.3)) / 20.0;
            sides[1] += integrate(&v, &|w| f64::from(w.x < -0.3)) / 20.0;
        }
    }
    let exact = 7.0 / 3.0 * TAU / 2.0 / 3.0 * TAU / layout.rays() as f64;
    // The empirical variance of 400 runs is off by 7 % in one standard deviation.
    assert!((spread / exact - 1.0).abs() < 0.3, "{spread} {exact}");
    assert!((expected / exact - 1.0).abs() < 0.1, "{expected} {exact}");
    assert!(sides[1].abs() < 0.1 * sides[0], "{sides:?}");
}
