//! Radiance coefficients of a gather, their gradients, and the tables of lobes that they are
//! multiplied with.
//!
//! The gradients are compared with exact ones in the scene of the derivative tests: a square lamp
//! of radiance 1 at height 2, and black rectangles at height 1. What the receiver sees of the lamp
//! is the square without the shadows of the rectangles, which are rectangles too, so a coefficient
//! is a sum of smooth integrals over rectangles, and its gradient a difference of those.

use crate::bsdfs::{at, bsdf, lafortune, metal, plastic, point};
use crate::derivative::{LampAndOccluders, occluder, receiver};
use crate::pictures::{beauty, build, cached, difference, own, render};
use lumicache::basis::{Basis, BasisKind, HSH_COSINE, Hsh, Jet, LANES, Lane, Sh, gauss_legendre};
use lumicache::cache::{Bands, Glossy, GlossyBasis, Refinement, RefinementRule, Scheme};
use lumicache::compare::Report;
use lumicache::film::{LAYERS, Pixel};
use lumicache::gather::{
    Bundle, Coefficients, Deeper, Density, HemisphereSamples, Layout, NoDeeper, RadianceGradient,
    RadianceProbe,
};
use lumicache::geometry::SurfacePoint;
use lumicache::imagefile::exr::{Channel, Layers, SampleKind};
use lumicache::material::tables::{GlossyTables, Lobe, LobeTable, TableSettings, TableStore};
use lumicache::material::{Bsdf, LafortuneLobe, Material, NativeBrdf};
use lumicache::math::{Color, DVec3, Vec3};
use lumicache::render::{Frame, Settings};
use lumicache::sampling::Rng;
use lumicache::scene::{Scene, SceneData};
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
    probe: &LampAndOccluders,
    basis: &dyn Basis,
    layout: Layout,
    density: Density,
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

fn settings(basis: BasisKind, order: usize, loss: f32) -> TableSettings {
    TableSettings { basis, order, loss, padding: true, whole: false, forced: false }
}

/// All basis functions at `w`.
fn values(basis: &dyn Basis, w: Vec3) -> Vec<f32> {
    let mut out = vec![Lane::default(); basis.count()];
    basis.values(&[w; LANES], &mut out);
    out.iter().map(|v| v[0]).collect()
}

/// Directions of the hemisphere with their solid angles.
fn hemisphere() -> Vec<(Vec3, f64)> {
    let columns = 160;
    let mut nodes = Vec::new();
    for (z, weight) in gauss_legendre(80, 0.0, 1.0) {
        for k in 0..columns {
            let (s, c) = (TAU * (k as f64 + 0.37) / columns as f64).sin_cos();
            let r = (1.0 - z * z).sqrt();
            nodes.push((
                Vec3::new((r * c) as f32, (r * s) as f32, z as f32),
                weight * TAU / columns as f64,
            ));
        }
    }
    nodes
}

#[test]
fn tables_hold_the_lobes_of_every_model() {
    let native = |brdf| Material { native: Some(brdf), ..Material::default() };
    let (kd, ks) = (Color::splat(0.2), Color::new(0.6, 0.5, 0.3));
    let ward = |alpha_x, alpha_y| native(NativeBrdf::WardDuer { kd, ks, alpha_x, alpha_y });
    let one = |c: [f32; 3], n: f32| {
        [lafortune(c, Color::splat(n)), LafortuneLobe::default(), LafortuneLobe::default()]
    };
    let coated = Material { clearcoat: 0.7, clearcoat_roughness: 0.6, ..metal(ks, 0.7) };
    let materials = [
        metal(ks, 0.5477),
        plastic(ks, 0.8),
        coated,
        native(NativeBrdf::Phong { kd, ks, exponent: 22.0 }),
        native(NativeBrdf::Lafortune { kd, lobes: one([-0.9, -0.9, 0.9], 12.0), count: 1 }),
        ward(0.4, 0.4),
        ward(0.35, 0.6),
    ];
    let nodes = hemisphere();
    for kind in [BasisKind::Hsh, BasisKind::Sh] {
        let tables = GlossyTables::new(&materials, settings(kind, 10, 0.5), &TableStore::default());
        let basis = kind.basis(10);
        let mut c = Vec::new();
        for (number, material) in materials.iter().enumerate() {
            let surface = bsdf(material, false);
            for wo in [at(5.0, 10.0), at(40.0, 130.0), at(62.0, -77.0)] {
                assert!(
                    tables.project(number as u32, &surface, wo, &mut c).is_some(),
                    "{number} {wo}"
                );
                // The coefficients by quadrature; linear interpolation between 48 nodes, or between
                // 32 x 32 for the anisotropic lobe, misses a little.
                let mut expected = vec![0f64; 300];
                for (wi, solid_angle) in &nodes {
                    let f = surface.f_glossy(wo, *wi) * wi.z;
                    for (i, h) in values(basis.as_ref(), *wi).into_iter().enumerate() {
                        (0..3).for_each(|k| {
                            expected[100 * k + i] += f64::from(f[k] * h) * solid_angle
                        });
                    }
                }
                // With so large a loss few bands are in use, and only those are filled in.
                let order = tables.project(number as u32, &surface, wo, &mut c).unwrap();
                let used = |k: &usize| k % 100 < order * order;
                let got: Vec<f64> = (0..300).filter(used).map(|k| f64::from(c[k])).collect();
                let expected: Vec<f64> = (0..300).filter(used).map(|k| expected[k]).collect();
                let error =
                    norm(&got.iter().zip(&expected).map(|(a, b)| a - b).collect::<Vec<_>>())
                        / norm(&expected);
                let tolerance = if number == 6 { 0.03 } else { 0.01 };
                assert!(error < tolerance, "{kind:?} {number} {wo}: off by {error}");
            }
        }
    }
}

#[test]
fn orders_follow_the_energy() {
    // Energy that is lost by a modified Phong lobe times the cosine, exponent 22 seen straight on:
    // 4.5 % with order 6, 0.39 % with 8, 0.02 % with 10; extended by zero in spherical harmonics
    // 22, 6.6, 1.4 %.
    let phong = |exponent| Material {
        native: Some(NativeBrdf::Phong { kd: Color::ZERO, ks: Color::ONE, exponent }),
        ..Material::default()
    };
    let order = |kind, exponent, wo: Vec3, loss| {
        let material = phong(exponent);
        let tables = GlossyTables::new(
            std::slice::from_ref(&material),
            settings(kind, 10, loss),
            &TableStore::default(),
        );
        tables.project(0, &bsdf(&material, false), wo, &mut Vec::new())
    };
    let up = Vec3::Z;
    for (kind, bounds) in [
        (BasisKind::Hsh, [(0.044, 0.046, 6), (0.0037, 0.0041, 8)]),
        (BasisKind::Sh, [(0.21, 0.23, 6), (0.065, 0.067, 8)]),
    ] {
        for (below, above, n) in bounds {
            assert!(order(kind, 22.0, up, below) > Some(n), "{kind:?} {n}");
            assert!(order(kind, 22.0, up, above) <= Some(n), "{kind:?} {n}");
        }
    }
    assert!(order(BasisKind::Hsh, 22.0, up, 1.5e-4).is_none_or(|n| n == 10));
    assert_eq!(order(BasisKind::Sh, 22.0, up, 0.01), None, "1.4 % at order 10: of high frequency");
    // Exponent 7 at 75 degrees: HSH order 4 loses 5.7 %, SH order 6 4.9 %; the next node of the
    // table, nearer to the horizon, a little more.
    let grazing = at(75.0, 20.0);
    assert_eq!(order(BasisKind::Hsh, 7.0, grazing, 0.062), Some(4));
    assert_eq!(order(BasisKind::Hsh, 7.0, grazing, 0.05), Some(5));
    assert_eq!(order(BasisKind::Sh, 7.0, grazing, 0.06), Some(6));
    assert_eq!(order(BasisKind::Hsh, 2000.0, up, 0.05), None);
}

#[test]
fn what_cannot_be_tabulated_is_left_alone() {
    let materials = [
        metal(Color::ONE, 0.1),
        Material { transmission: 0.5, ..plastic(Color::ONE, 0.7) },
        Material {
            native: Some(NativeBrdf::Phong { kd: Color::ONE, ks: Color::ZERO, exponent: 5.0 }),
            ..Material::default()
        },
    ];
    let tables =
        GlossyTables::new(&materials, settings(BasisKind::Hsh, 10, 0.05), &TableStore::default());
    assert!(tables.is_empty());
    for (number, material) in materials.iter().enumerate() {
        assert_eq!(
            tables.project(number as u32, &bsdf(material, false), Vec3::Z, &mut Vec::new()),
            None
        );
        assert_eq!(tables.record_order(&point(false), &bsdf(material, false)), None);
    }
    assert_eq!(tables.project(0, &Bsdf::lambert(Color::ONE), Vec3::Z, &mut Vec::new()), None);
}

#[test]
fn textured_roughness_is_interpolated() {
    // Tables at the roughnesses of the grid serve those between.
    let exact = metal(Color::splat(0.8), 0.61);
    let textured: Vec<Material> =
        (0..30).map(|k| metal(Color::ONE, 0.3 + 0.7 * k as f32 / 29.0)).collect();
    let wanted = settings(BasisKind::Hsh, 8, 0.5);
    let tables = GlossyTables::new(&textured, wanted, &TableStore::default());
    let reference = GlossyTables::new(std::slice::from_ref(&exact), wanted, &TableStore::default());
    let surface = bsdf(&exact, false);
    for wo in [at(10.0, 0.0), at(60.0, 50.0)] {
        let (mut a, mut b) = (Vec::new(), Vec::new());
        let (m, n) = (
            tables.project(0, &surface, wo, &mut a).unwrap(),
            reference.project(0, &surface, wo, &mut b).unwrap(),
        );
        let count = m.min(n).pow(2);
        let (a, b) =
            (a[..count].iter().map(|x| f64::from(*x)), b[..count].iter().map(|x| f64::from(*x)));
        let difference: Vec<f64> = a.zip(b.clone()).map(|(a, b)| a - b).collect();
        assert!(norm(&difference) < 0.01 * norm(&b.collect::<Vec<_>>()), "{}", norm(&difference));
    }
}

#[test]
fn any_function_can_be_tabulated() {
    // A constant f: cos θ alone, two bands, nothing lost.
    let lobe = Lobe { f: &|_, _| [1.0, 0.5, 0.25], parts: 3, isotropic: true };
    let table = LobeTable::build(&lobe, &Hsh::new(4));
    let channels = [Color::X, Color::Y, Color::Z];
    assert_eq!(table.needed_order(at(50.0, 0.0), &channels, 1e-5), Some(2));
    let mut c = vec![0.0; 48];
    table.add(at(50.0, 30.0), 2, &channels, &mut c);
    for (channel, factor) in [1.0, 0.5, 0.25].into_iter().enumerate() {
        assert!(
            (c[16 * channel] - factor * HSH_COSINE[0]).abs() < 1e-5
                && (c[16 * channel + 2] - factor * HSH_COSINE[1]).abs() < 1e-5
        );
    }
}

/// One layer of a frame as a picture.
pub fn layer(frame: &Frame, name: &str) -> Layers {
    let [width, height] = frame.film.window_size();
    let channels = frame.film.channels(LAYERS.iter().find(|l| l.name == name).unwrap());
    let channel = |(samples, name): (Vec<f32>, &str)| Channel {
        name: name.to_owned(),
        kind: SampleKind::Float,
        samples,
    };
    let mut channels: Vec<Channel> =
        channels.into_iter().zip(["R", "G", "B"]).map(channel).collect();
    channels.push(channel((vec![1.0; (width * height) as usize], "A")));
    Layers { width, height, channels, ..Layers::default() }
}

/// Share of the glossy samples that records served.
fn served(frame: &Frame) -> f64 {
    let (all, served) =
        frame.film.pixels().iter().map(Pixel::glossy).fold((0, 0), |(a, b), (c, d)| (a + c, b + d));
    served as f64 / all as f64
}

/// Renders gloss by records and by paths; both read the same irradiance records at the ends of
/// those.
fn compare_gloss(
    scene: &Scene,
    size: [u32; 2],
    change: impl Fn(&mut Scheme),
) -> (Report, Report, f64) {
    let with = |order: u8, spp: u32, seed: u64| {
        let mut settings = Settings { seed, ..cached(scene, "krivanek05", size, spp) };
        change(&mut settings.scheme);
        if order == 0 {
            settings.scheme.glossy = None;
        }
        render(scene, &settings)
    };
    let reference = layer(&with(0, 96, 5), "glossy_indirect");
    let (records, paths) = (with(1, 4, 0), with(0, 4, 0));
    let against = |frame: &Frame| difference(&layer(frame, "glossy_indirect"), &reference);
    (against(&records), against(&paths), served(&records))
}

#[test]
fn records_serve_a_glossy_floor_with_less_noise_than_paths() {
    // GGX, alpha 0.3: seen at 71 to 79 degrees, where order 10 loses up to 15 % of the energy.
    let scene = build(own("cornell-box-glossy"));
    for (gradient, basis) in [
        (RadianceGradient::Boundary, GlossyBasis::Hsh),
        (RadianceGradient::PerSample, GlossyBasis::ShWorld),
    ] {
        let (records, paths, served) = compare_gloss(&scene, [64, 64], |scheme| {
            let old = scheme.glossy();
            scheme.glossy = Some(Glossy { gradient, basis, order: 14, loss: 0.15, ..old });
        });
        eprintln!(
            "{gradient:?} {basis:?}: served {served:.3}, records {:.2e} {:?}, paths {:.2e}",
            records.relmse, records.mean_ratio, paths.relmse
        );
        assert!(served > 0.8, "{gradient:?} {basis:?}: only {served} served");
        assert!(
            (records.mean_ratio.unwrap() - 1.0).abs() < 0.02,
            "{gradient:?} {basis:?}: mean {:?}",
            records.mean_ratio
        );
        assert!(
            records.relmse < 0.5 * paths.relmse,
            "{gradient:?} {basis:?}: {} with records, {} with paths",
            records.relmse,
            paths.relmse
        );
    }
}

#[test]
fn records_serve_curved_surfaces() {
    let mut data = own("curved-spheres");
    for material in &mut data.materials {
        if !material.is_emissive() {
            material.native = Some(NativeBrdf::Phong {
                kd: Color::splat(0.3),
                ks: Color::splat(0.5),
                exponent: 10.0,
            });
        }
    }
    let scene = build(data);
    for (basis, order) in [(GlossyBasis::Hsh, 10), (GlossyBasis::ShWorld, 14)] {
        let (records, paths, served) = compare_gloss(&scene, [45, 30], |scheme| {
            scheme.glossy = Some(Glossy { basis, order, ..scheme.glossy() });
            scheme.gather.rays = 400;
        });
        eprintln!(
            "{basis:?}: served {served:.3}, records {:.2e} {:?}, paths {:.2e}",
            records.relmse, records.mean_ratio, paths.relmse
        );
        assert!(served > 0.8, "{basis:?}: only {served} served");
        assert!(
            (records.mean_ratio.unwrap() - 1.0).abs() < 0.03,
            "{basis:?}: mean {:?}",
            records.mean_ratio
        );
    }
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

/// `ward-floor` at roughness `alpha`, lobes losing the share `loss` of their energy.
fn ward_floor(alpha: f32, loss: f32, change: impl Fn(&mut Scheme)) -> Frame {
    let mut data = own("ward-floor");
    for material in &mut data.materials {
        if let Some(NativeBrdf::WardDuer { alpha_x, alpha_y, .. }) = &mut material.native {
            (*alpha_x, *alpha_y) = (alpha, alpha);
        }
    }
    let scene = build(data);
    let mut settings = cached(&scene, "krivanek06", [80, 60], 1);
    (settings.scheme.gather.rays, settings.scheme.levels) = (400, 1);
    settings.scheme.glossy.as_mut().unwrap().loss = loss;
    change(&mut settings.scheme);
    render(&scene, &settings)
}

#[test]
fn adaptive_records_follow_the_sharpness_of_the_lobe() {
    // About nine bands for each.
    let counts = |refinement: Option<Refinement>| {
        [(0.6, 0.05), (0.3, 0.3), (0.15, 0.6)].map(|(alpha, loss)| {
            let frame = ward_floor(alpha, loss, |scheme| scheme.refinement = refinement);
            let gloss = frame.gloss.as_ref().unwrap();
            let records = gloss.levels[0].records();
            let smallest = gloss.levels[0].placement().scheme().error_min();
            assert!(
                records.iter().all(|r| r.error >= 0.999 * smallest),
                "a record went below the smallest error"
            );
            assert_eq!(gloss.fill[0].reductions > 0, refinement.is_some());
            records.len() as f32
        })
    };
    let growth = |counts: [f32; 3]| [counts[1] / counts[0], counts[2] / counts[0]];
    let (refined, plain) = (counts(Some(Refinement::default())), counts(None));
    // Without refinement the lobe hardly matters.
    let larger = growth(refined)
        .iter()
        .zip(growth(plain))
        .all(|(with, without)| *with > 1.15 * without && *with > 1.3);
    assert!(larger, "{refined:?}, without refinement {plain:?}");
}

#[test]
fn faint_curved_and_small_gloss_is_left_to_paths() {
    let share = |mut data: SceneData, size: [u32; 2], spp: u32, faint: bool, economy: bool| {
        for native in data.materials.iter_mut().filter_map(|m| m.native.as_mut()).filter(|_| faint)
        {
            if let NativeBrdf::Phong { kd, ks, .. } = native {
                (*kd, *ks) = (Color::splat(0.7), Color::splat(0.1));
            }
        }
        let scene = build(data);
        let mut settings = cached(&scene, "auto", size, spp);
        settings.scheme.gather.rays = 64;
        settings.scheme.glossy.as_mut().unwrap().economy = economy;
        served(&render(&scene, &settings))
    };
    let walk = |spp, faint, economy| share(own("glossy-walk"), [40, 40], spp, faint, economy);
    assert!(walk(1, false, false) > 0.9 && walk(64, false, true) > 0.9);
    // Too few pixels to pay for records.
    assert_eq!(walk(1, false, true), 0.0);
    // The wall reflects an eighth of its light by its lobe; the metal floor has no diffuse lobe.
    let floor = walk(64, true, true);
    assert!((0.1..0.9).contains(&floor) && walk(1, true, false) > 0.9, "{floor}");
    let pot = |spp, economy| share(own("phong-pot"), [40, 30], spp, false, economy);
    assert!(pot(64, true) < 0.05 && pot(1, false) > 0.8);
}

#[test]
fn records_below_the_first_bounce_replace_paths_and_change_nothing_else() {
    for (name, preset) in [("glossy-walk", "auto"), ("cornell-box-glossy", "zhao-incoming")] {
        let scene = build(own(name));
        let with = |levels: u8| {
            let mut settings = cached(&scene, preset, [48, 48], 4);
            (settings.scheme.gather.rays, settings.scheme.levels) = (512, 3);
            let glossy = settings.scheme.glossy.as_mut().unwrap();
            (glossy.economy, glossy.levels) = (false, levels);
            render(&scene, &settings)
        };
        let [one, two] = [1, 2].map(with);
        let count = |frame: &Frame| {
            frame
                .gloss
                .as_ref()
                .unwrap()
                .levels
                .iter()
                .map(|l| l.records().len())
                .collect::<Vec<_>>()
        };
        assert_eq!(count(&one).len(), 1);
        assert!(count(&two).len() == 2 && count(&two)[1] > 20, "{name}: {:?}", count(&two));
        let paths = |frame: &Frame| frame.gathered[2] as f32 / frame.gathered[0] as f32;
        let report = difference(&beauty(&two), &beauty(&one));
        println!(
            "{name}: {:.4} paths per ray, {:.4} with records below; {report:?}",
            paths(&one),
            paths(&two)
        );
        assert!(
            paths(&two) < 0.8 * paths(&one),
            "{name}: {} paths per ray, without records {}",
            paths(&two),
            paths(&one)
        );
        assert!(
            (report.mean_ratio.unwrap() - 1.0).abs() < 0.005 && report.relmse < 1e-3,
            "{name}: {report:?}"
        );
    }
}

#[test]
fn refined_curved_surfaces_are_served_everywhere() {
    // Where rays start aside of a point its record must cover it all the same, however small
    // refinement makes it.
    let scene = build(own("phong-pot"));
    let mut settings = cached(&scene, "krivanek06", [160, 120], 1);
    (settings.scheme.gather.rays, settings.scheme.levels, settings.max_bounces) = (200, 1, 1);
    for rule in [RefinementRule::Weber, RefinementRule::WeberNearest] {
        settings.scheme.refinement.as_mut().unwrap().rule = rule;
        let frame = render(&scene, &settings);
        let fill = &frame.gloss.as_ref().unwrap().fill[0];
        assert!(fill.retaken > 5 && fill.reductions > 50, "{rule:?}: {fill:?}");
        assert_eq!(served(&frame), 1.0, "{rule:?}");
    }
}

#[test]
fn all_bands_serve_what_loses_too_much() {
    let scene = build(own("pyramid-metal"));
    let with = |bands: Bands| {
        let mut settings = cached(&scene, "krivanek05", [40, 40], 1);
        (settings.scheme.gather.rays, settings.max_bounces) = (64, 1);
        settings.scheme.glossy.as_mut().unwrap().bands = bands;
        render(&scene, &settings)
    };
    let [needed, all] = [Bands::Padded, Bands::All].map(with);
    // The exponents 88 and 186 need more than ten bands from everywhere.
    assert_eq!((served(&needed), served(&all)), (0.0, 1.0));
    assert!(needed.gloss.is_none_or(|g| g.levels[0].records().is_empty()));
    let gloss = all.gloss.as_ref().unwrap();
    let numbers = 3 * 3 * 100 * size_of::<f32>();
    assert!(gloss.bytes() > gloss.record_count() * numbers, "not all records have ten bands");
}
