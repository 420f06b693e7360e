//! Gradients of irradiance against closed forms: a square lamp above a plane, with and without
//! rectangles in between.
//!
//! The expected values are finite differences (step 1e-4) of Lambert's formula with the occluder's
//! shadow taken out of the lamp.

use crate::support::bsdfs::point;
use lumicache::gather::{
    Bundle, Deeper, Density, Gradient, HemisphereSamples, HitKind, Layout, NoDeeper, RadianceProbe,
    TranslationalGradient,
};
use lumicache::geometry::SurfacePoint;
use lumicache::math::{Color, Frame, Vec2, Vec3};

/// A horizontal rectangle `[min, max]` at height `z`.
#[derive(Clone, Copy)]
pub struct Rectangle {
    pub min: Vec2,
    pub max: Vec2,
    pub z: f32,
}

/// The lamp [-1,1]² at z = 2 of radiance 1 over black rectangles.
pub struct LampAndOccluders(pub Vec<Rectangle>);

impl LampAndOccluders {
    /// The lamp alone.
    pub fn open() -> Self {
        Self(Vec::new())
    }
}

const LAMP: Rectangle = Rectangle { min: Vec2::NEG_ONE, max: Vec2::ONE, z: 2.0 };

impl RadianceProbe for LampAndOccluders {
    fn incoming(&self, from: &SurfacePoint, _: u8, _: &dyn Deeper, bundle: &mut Bundle) {
        for k in 0..bundle.len() {
            let w = from.frame.to_world(bundle.dir_local[k]);
            let lamp = std::iter::once((&LAMP, Color::ONE));
            for (r, radiance) in lamp.chain(self.0.iter().map(|r| (r, Color::ZERO))) {
                let t = (r.z - from.position.z) / w.z;
                let p = (from.position + t * w).truncate();
                if p.cmpge(r.min).all() && p.cmple(r.max).all() && t < bundle.distance[k] {
                    bundle.distance[k] = t;
                    bundle.radiance[k] = radiance;
                    bundle.normal[k] = Vec3::NEG_Z;
                    bundle.kind[k] = HitKind::Surface;
                }
            }
        }
    }
}

/// The receiver of every test: (0.45, 0.30, 0) facing up.
pub fn receiver() -> SurfacePoint {
    SurfacePoint { position: Vec3::new(0.45, 0.30, 0.0), ..point(false) }
}

/// One black rectangle at z = 1 under the lamp.
pub fn occluder(min: [f32; 2], max: [f32; 2]) -> LampAndOccluders {
    LampAndOccluders(vec![Rectangle { min: Vec2::from(min), max: Vec2::from(max), z: 1.0 }])
}

/// Mean over `runs` seeds of (E, translational gradient by `kind`, rotational gradient), red
/// channel.
fn estimate(
    probe: &dyn RadianceProbe, layout: Layout, kind: TranslationalGradient, runs: u64,
) -> (f64, [f64; 2], [f64; 2]) {
    let mut samples = HemisphereSamples::new(layout, Density::Cosine);
    let (mut e, mut t, mut r) = (0.0, [0.0; 2], [0.0; 2]);
    for seed in 0..runs {
        samples.gather(probe, &receiver(), 0, &NoDeeper, seed);
        let g = samples.translational_gradient(kind);
        let q = samples.rotational_gradient();
        e += f64::from(samples.irradiance().x);
        t = [t[0] + f64::from(g.s.x), t[1] + f64::from(g.t.x)];
        r = [r[0] + f64::from(q.s.x), r[1] + f64::from(q.t.x)];
    }
    let n = runs as f64;
    (e / n, t.map(|x| x / n), r.map(|x| x / n))
}

fn assert_close(got: [f64; 2], expected: [f64; 2], relative: f64, what: &str) {
    let error = ((got[0] - expected[0]).powi(2) + (got[1] - expected[1]).powi(2)).sqrt();
    let scale = (expected[0].powi(2) + expected[1].powi(2)).sqrt();
    assert!(
        error < relative * scale,
        "{what}: {got:?} instead of {expected:?}, off by {:.1} %",
        100.0 * error / scale
    );
}

const POLAR: Layout = Layout::Polar { m: 64, n: 200 };
const T1: (f64, [f64; 2], [f64; 2]) =
    (0.692_236_14, [-0.176_765_88, -0.117_087_09], [0.079_084_58, -0.118_938_80]);
const T2: (f64, [f64; 2]) = (0.333_834_68, [-0.501_796_86, 0.222_261_32]);
const T3: (f64, [f64; 2]) = (0.605_672_02, [-0.160_513_38, -0.100_834_59]);
const T4: (f64, [f64; 2]) = (0.268_665_09, [-0.560_892_2, -0.042_570_0]);

#[test]
fn an_open_lamp_by_every_method() {
    let open = LampAndOccluders::open();
    for (kind, layout, tolerance) in [
        (TranslationalGradient::WardHeckbert, POLAR, 0.01),
        (TranslationalGradient::PerSample, POLAR, 0.01),
        (TranslationalGradient::PerSample, Layout::Concentric { n: 112 }, 0.01),
    ] {
        let (e, t, r) = estimate(&open, layout, kind, 16);
        assert!((e / T1.0 - 1.0).abs() < 2e-3, "{e}");
        assert_close(t, T1.1, tolerance, &format!("{kind:?} {layout:?}"));
        assert_close(r, T1.2, 0.01, "rotational");
    }
}

#[test]
fn occluders_move_the_gradient_and_ward_heckbert_sees_it() {
    for (probe, (e0, g0), name) in [
        (occluder([0.2, -0.5], [1.2, 0.5]), T2, "T2"),
        (occluder([0.25, 0.1], [0.55, 0.4]), T3, "T3"),
        (occluder([0.2, -3.0], [3.0, 3.0]), T4, "T4"),
    ] {
        let (e, t, _) = estimate(&probe, POLAR, TranslationalGradient::WardHeckbert, 16);
        assert!((e / e0 - 1.0).abs() < 3e-3, "{name} {e}");
        assert_close(t, g0, 0.03, name);
    }
}

#[test]
fn the_per_sample_gradient_is_blind_to_silhouettes() {
    let (_, t, _) =
        estimate(&occluder([0.2, -0.5], [1.2, 0.5]), POLAR, TranslationalGradient::PerSample, 16);
    assert_close(t, [-0.185, -0.011], 0.05, "T2 as patches that keep their visibility");
}

#[test]
fn rotating_the_normal_changes_irradiance_as_the_rotational_gradient_says() {
    // Central differences of E over a tilt of the receiver, against (n_i x n) . G with the
    // library's frames; means over 64 seeds.
    let open = LampAndOccluders::open();
    let at = receiver();
    let mut samples = HemisphereSamples::new(POLAR, Density::Cosine);
    let mut irradiance = |n: Vec3| -> f64 {
        let tilted = SurfacePoint { frame: Frame::from_normal(n), ..at };
        let mut total = 0.0;
        for seed in 0..64 {
            samples.gather(&open, &tilted, 0, &NoDeeper, seed);
            total += f64::from(samples.irradiance().x) / 64.0;
        }
        total
    };
    let (_, _, g) = estimate(&open, POLAR, TranslationalGradient::None, 64);
    let gradient =
        Gradient { s: Color::splat(g[0] as f32), t: Color::splat(g[1] as f32) }.to_world(&at.frame);
    for axis in [Vec3::X, Vec3::Y, Vec3::new(0.6, -0.8, 0.0)] {
        let n = (at.frame.n + 0.1 * axis).normalize();
        let difference = irradiance(n) - irradiance((at.frame.n - 0.1 * axis).normalize());
        let predicted = 2.0 * f64::from((gradient * at.frame.n.cross(n)).x);
        // The lamp's irradiance is linear in a small tilt; what is left is sampling noise of about
        // 1e-3.
        assert!((predicted - difference).abs() < 0.002, "{axis}: {predicted} {difference}");
    }
}

#[test]
fn gradients_of_a_uniform_world_vanish() {
    struct Uniform;
    impl RadianceProbe for Uniform {
        fn incoming(&self, from: &SurfacePoint, _: u8, _: &dyn Deeper, bundle: &mut Bundle) {
            for k in 0..bundle.len() {
                bundle.radiance[k] = Color::ONE;
                bundle.distance[k] = 1.0 + (k % 7) as f32;
                bundle.normal[k] = -from.frame.to_world(bundle.dir_local[k]);
                bundle.kind[k] = HitKind::Surface;
            }
        }
    }
    let mut samples = HemisphereSamples::new(Layout::Polar { m: 16, n: 50 }, Density::Cosine);
    samples.gather(&Uniform, &receiver(), 0, &NoDeeper, 9);
    assert!((samples.irradiance().x - std::f32::consts::PI).abs() < 1e-4);
    assert!(samples.sigma() < 1e-5);
    let g = samples.translational_gradient(TranslationalGradient::WardHeckbert);
    assert!(g.s.length() + g.t.length() < 1e-5);
}

#[test]
fn sigma_is_the_spread_of_irradiance_over_seeds() {
    let probe = occluder([0.2, -0.5], [1.2, 0.5]);
    let mut samples = HemisphereSamples::new(Layout::Polar { m: 10, n: 32 }, Density::Cosine);
    let (mut sum, mut squares, mut sigma2) = (0.0, 0.0, 0.0);
    let runs = 400;
    for seed in 0..runs {
        samples.gather(&probe, &receiver(), 0, &NoDeeper, seed);
        let e = f64::from(samples.irradiance().x);
        sum += e;
        squares += e * e;
        sigma2 += f64::from(samples.sigma()).powi(2);
    }
    let n = runs as f64;
    let spread = (squares / n - (sum / n).powi(2)).sqrt();
    let sigma = (sigma2 / n).sqrt();
    // The groups are coarser strata than the whole, so sigma is somewhat above the true spread,
    // never far below it.
    assert!(sigma > 0.8 * spread && sigma < 3.0 * spread, "{sigma} {spread}");
}
