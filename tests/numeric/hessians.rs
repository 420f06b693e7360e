//! Gradients and Hessians of irradiance from the triangulated hemisphere against closed forms: the
//! lamp and the rectangles of [`crate::numeric::derivative`].
//!
//! The expected values are finite differences (step 1e-4) of Lambert's formula with the occluder's
//! shadow taken out of the lamp. Seeds are fixed; the standard errors of the means over `runs`
//! gathers are below a third of every tolerance.

use crate::numeric::derivative::{LampAndOccluders, Rectangle, occluder, receiver};
use crate::support::pictures::{build, load, own, seen};
use crate::support::testdata;
use lumicache::gather::{
    Bundle, Deeper, Density, Derivatives, HemisphereSamples, Layout, NoDeeper, RadianceProbe,
    TriangleRadiance,
};
use lumicache::geometry::SurfacePoint;
use lumicache::math::{Color, Frame, Vec2, Vec3};
use lumicache::scene::Scene;
use lumicache::transport::{PathTracer, SceneProbe};
use std::time::{Duration, Instant};

/// The lamp's plane goes on around the lamp, black: without it the lamp would have silhouettes of
/// its own.
pub struct Ceiling(pub LampAndOccluders);

impl RadianceProbe for Ceiling {
    fn incoming(&self, from: &SurfacePoint, level: u8, deeper: &dyn Deeper, bundle: &mut Bundle) {
        self.0.incoming(from, level, deeper, bundle);
        for (r, w) in bundle.distance.iter_mut().zip(&bundle.dir_local) {
            if r.is_infinite() {
                *r = (2.0 - from.position.z) / w.z;
            }
        }
    }
}

/// Gradient (x, y) and Hessian (xx, xy, yy), red channel.
type Golden = ([f64; 2], [f64; 3]);

const T1: Golden = ([-0.176_765_88, -0.117_087_09], [-0.346_251_95, 0.036_601_93, -0.370_251_68]);
const T2: Golden = ([-0.501_796_86, 0.222_261_32], [0.358_465_28, 0.342_230_26, 0.093_175_32]);
const T3: Golden = ([-0.160_513_38, -0.100_834_59], [-0.025_642_84, 0.032_153_28, -0.049_642_57]);
const T4: Golden = ([-0.560_892_2, -0.042_570_0], [0.486_947_73, 0.103_170_48, -0.134_710_1]);

fn values(d: &Derivatives) -> Golden {
    let (g, h) = (&d.gradient, &d.hessian);
    ([g.s.x, g.t.x].map(f64::from), [h.ss.x, h.st.x, h.tt.x].map(f64::from))
}

pub fn gathered(
    probe: &dyn RadianceProbe, at: &SurfacePoint, n: u32, seed: u64,
) -> HemisphereSamples {
    let mut samples = HemisphereSamples::new(Layout::Concentric { n }, Density::Cosine);
    samples.gather(probe, at, 0, &NoDeeper, seed);
    samples
}

/// Mean over `runs` seeds of what `estimate` makes of n x n samples.
fn mean(
    probe: &dyn RadianceProbe, n: u32, runs: u64,
    estimate: impl Fn(&HemisphereSamples) -> Derivatives,
) -> Golden {
    let (mut g, mut h) = ([0.0; 2], [0.0; 3]);
    for seed in 0..runs {
        let (g1, h1) = values(&estimate(&gathered(probe, &receiver(), n, seed)));
        for (sum, x) in g.iter_mut().chain(&mut h).zip(g1.iter().chain(&h1)) {
            *sum += x / runs as f64;
        }
    }
    (g, h)
}

fn hybrid(samples: &HemisphereSamples) -> Derivatives {
    samples.triangulated(TriangleRadiance::Hybrid)
}

fn gradient_error(got: &Golden, expected: &Golden) -> f64 {
    let [x, y] = [0, 1].map(|k| got.0[k] - expected.0[k]);
    x.hypot(y) / expected.0[0].hypot(expected.0[1])
}

/// Frobenius norm.
fn norm(h: [f64; 3]) -> f64 {
    (h[0] * h[0] + 2.0 * h[1] * h[1] + h[2] * h[2]).sqrt()
}

fn hessian_difference(got: &Golden, expected: &Golden) -> f64 {
    norm([0, 1, 2].map(|k| got.1[k] - expected.1[k]))
}

pub fn open() -> Ceiling {
    Ceiling(LampAndOccluders(Vec::new()))
}

pub fn t2() -> Ceiling {
    Ceiling(occluder([0.2, -0.5], [1.2, 0.5]))
}

pub fn t3() -> Ceiling {
    Ceiling(occluder([0.25, 0.1], [0.55, 0.4]))
}

fn t4() -> Ceiling {
    Ceiling(occluder([0.2, -3.0], [3.0, 3.0]))
}

#[test]
fn an_open_lamp_has_its_gradient_and_hessian() {
    let got = mean(&open(), 96, 8, hybrid);
    let (g, h) = (gradient_error(&got, &T1), hessian_difference(&got, &T1) / norm(T1.1));
    assert!(g < 0.02 && h < 0.05, "gradient off by {g}, Hessian by {h}: {got:?}");
}

#[test]
fn a_shadow_inside_the_lamp_is_approached_as_the_samples_get_denser() {
    let errors = [48, 96, 192].map(|n| {
        let got = mean(&t3(), n, 12, hybrid);
        if n == 96 {
            let g = gradient_error(&got, &T3);
            assert!(g < 0.04, "gradient off by {g}: {got:?}");
        }
        hessian_difference(&got, &T3)
    });
    for k in [0, 1] {
        let ratio = errors[k] / errors[k + 1];
        assert!(ratio > 1.6 && ratio < 2.6, "Hessian errors {errors:?} do not halve");
    }
}

#[test]
fn silhouettes_that_cross_other_edges_have_the_right_gradient_and_a_hessian_of_the_right_size() {
    for (probe, expected, name) in [(t2(), T2, "T2"), (t4(), T4, "T4")] {
        let got = mean(&probe, 96, 12, hybrid);
        let (g, h) = (gradient_error(&got, &expected), norm(got.1) / norm(expected.1));
        assert!(g < 0.04, "{name}: gradient off by {g}: {got:?}");
        assert!(h > 0.5 && h < 2.0, "{name}: Hessian {h} times as large: {got:?}");
    }
}

#[test]
fn the_farthest_corner_displaces_texture_and_finds_silhouettes() {
    let farthest = |s: &HemisphereSamples| s.triangulated(TriangleRadiance::Farthest);
    let [open, shadowed] = [(open(), T1), (t2(), T2)]
        .map(|(probe, expected)| gradient_error(&mean(&probe, 96, 8, farthest), &expected));
    assert!(open > 0.03 && open < 0.15, "T1 off by {open}");
    assert!(shadowed < 0.04, "T2 off by {shadowed}");
}

#[test]
fn without_occlusion_the_hessian_of_patches_is_right_and_with_it_blind() {
    let patches = |s: &HemisphereSamples| Derivatives {
        gradient: Default::default(),
        hessian: s.unoccluded_hessian(),
    };
    let got = mean(&open(), 96, 8, patches);
    let h = hessian_difference(&got, &T1) / norm(T1.1);
    assert!(h < 0.02, "T1 off by {h}: {got:?}");
    let got = mean(&t2(), 96, 8, patches);
    let h = hessian_difference(&got, &T2) / norm(T2.1);
    assert!(h > 0.5, "T2 off by {h} only: {got:?}");
}

/// The receiver, its surroundings and its frame `factor` times as large.
#[test]
fn derivatives_scale_with_length_and_radiance() {
    struct Scaled(f32, f32);
    impl RadianceProbe for Scaled {
        fn incoming(
            &self, from: &SurfacePoint, level: u8, deeper: &dyn lumicache::gather::Deeper,
            bundle: &mut lumicache::gather::Bundle,
        ) {
            let from = SurfacePoint { position: from.position / self.0, ..*from };
            t2().incoming(&from, level, deeper, bundle);
            bundle.distance.iter_mut().for_each(|r| *r *= self.0);
            bundle.radiance.iter_mut().for_each(|l| *l *= self.1);
        }
    }
    let (g, h) = values(&hybrid(&gathered(&Scaled(1.0, 1.0), &receiver(), 32, 1)));
    for length in [1000.0_f32, 0.001] {
        for radiance in [1.0_f32, 1e4] {
            let at = SurfacePoint { position: receiver().position * length, ..receiver() };
            let (g1, h1) = values(&hybrid(&gathered(&Scaled(length, radiance), &at, 32, 1)));
            let (s, l) = (f64::from(length), f64::from(radiance));
            for (a, b) in g.iter().zip(g1) {
                assert!((a * l / s - b).abs() < 1e-3 * (l / s), "{length} {radiance}: {a} {b}");
            }
            for (a, b) in h.iter().zip(h1) {
                assert!(
                    (a * l / (s * s) - b).abs() < 1e-3 * (l / (s * s)),
                    "{length} {radiance}: {a} {b}"
                );
            }
        }
    }
}

#[test]
fn derivatives_turn_with_the_frame() {
    // The same directions from a frame turned by 0.4: other samples of the same field.
    let (sin, cos) = 0.4_f32.sin_cos();
    let frame = Frame { s: Vec3::new(cos, sin, 0.0), t: Vec3::new(-sin, cos, 0.0), n: Vec3::Z };
    let at = SurfacePoint { frame, ..receiver() };
    let (mut g, mut h) = ([Color::ZERO; 2], [Color::ZERO; 3]);
    for seed in 0..8 {
        let d = hybrid(&gathered(&t3(), &at, 96, seed));
        let x = Vec2::new(cos, -sin);
        let y = Vec2::new(sin, cos);
        g[0] += (d.gradient.s * x.x + d.gradient.t * x.y) / 8.0;
        g[1] += (d.gradient.s * y.x + d.gradient.t * y.y) / 8.0;
        h[0] += d.hessian.apply(x, x) / 8.0;
        h[1] += d.hessian.apply(x, y) / 8.0;
        h[2] += d.hessian.apply(y, y) / 8.0;
    }
    let turned = (g.map(|c| f64::from(c.x)), h.map(|c| f64::from(c.x)));
    let straight = mean(&t3(), 96, 8, hybrid);
    assert!(gradient_error(&turned, &straight) < 0.04, "{turned:?} {straight:?}");
    assert!(hessian_difference(&turned, &straight) < 0.04, "{turned:?} {straight:?}");
}

/// A rectangle of radiance 1 in a black world must not depend on which side of it is the near one:
/// this is what a wrong winding would break.
#[test]
fn the_gradient_points_to_the_light() {
    let lamp = |min: [f32; 2], max: [f32; 2]| Rectangle {
        min: Vec2::from(min),
        max: Vec2::from(max),
        z: 1.0,
    };
    struct Bright(Rectangle);
    impl RadianceProbe for Bright {
        fn incoming(
            &self, from: &SurfacePoint, _: u8, _: &dyn lumicache::gather::Deeper,
            bundle: &mut lumicache::gather::Bundle,
        ) {
            for k in 0..bundle.len() {
                let w = from.frame.to_world(bundle.dir_local[k]);
                let t = (self.0.z - from.position.z) / w.z;
                let p = (from.position + t * w).truncate();
                if p.cmpge(self.0.min).all() && p.cmple(self.0.max).all() {
                    bundle.distance[k] = t;
                    bundle.radiance[k] = Color::ONE;
                }
            }
        }
    }
    let at = SurfacePoint { position: Vec3::ZERO, ..receiver() };
    for (min, max, towards) in
        [([0.5, -1.0], [1.5, 1.0], Vec2::X), ([-1.0, -1.5], [1.0, -0.5], Vec2::NEG_Y)]
    {
        let (g, _) = values(&hybrid(&gathered(&Bright(lamp(min, max)), &at, 32, 3)));
        let direction = Vec2::new(g[0] as f32, g[1] as f32).normalize();
        assert!(direction.dot(towards) > 0.97, "{direction}");
    }
}

/// Share of the time of a 1024-ray gather that the derivatives from it take, at a hundred points
/// that the camera of `scene` sees; both are the fastest of five runs. The cheapest gather: one
/// bounce, so a shadow ray at each hit and nothing behind it.
fn cost(scene: &Scene) -> f64 {
    let probe = SceneProbe::new(PathTracer { scene, max_bounces: 1 });
    let points = seen(scene, &scene.cameras()[0], [10, 10], 0);
    let mut samples = HemisphereSamples::new(Layout::concentric(1024), Density::Cosine);
    let mut fastest = [Duration::MAX; 2];
    for _ in 0..5 {
        let (mut spent, mut sum) = ([Duration::ZERO; 2], 0.0);
        for (k, at) in points.iter().enumerate() {
            let start = Instant::now();
            samples.gather(&probe, at, 0, &NoDeeper, k as u64);
            spent[0] += start.elapsed();
            let start = Instant::now();
            sum += hybrid(&samples).hessian.ss.x;
            spent[1] += start.elapsed();
        }
        assert!(sum.is_finite());
        fastest = [0, 1].map(|k| fastest[k].min(spent[k]));
    }
    let [gather, derivatives] = fastest.map(|t| 1e6 * t.as_secs_f64() / points.len() as f64);
    println!("gather {gather:.0} µs, derivatives {derivatives:.0} µs");
    derivatives / gather
}

#[test]
#[ignore = "measures time: run it alone"]
fn derivatives_cost_less_than_a_tenth_of_the_rays() {
    assert!(cost(&build(own("cornell-box"))) < 0.1);
    if let Some(sponza) = testdata::find("scenes/scenes/sponza-dabrovic/sponza-dabrovic.gltf") {
        assert!(cost(&build(load(&sponza))) < 0.1);
    }
}
