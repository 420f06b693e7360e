//! Energy, reciprocity and consistency of the BSDFs, against quadrature over the sphere.

use crate::support::bsdfs::{
    Chart, at, axis_of, bsdf, cells, glass, integrate, matte, metal, plastic, sheet, views, zoo,
};
use crate::support::statistics::Rng;
use lumicache::material::{Bsdf, Lobe, Material, NativeBrdf};
use lumicache::math::{Color, PI, Vec3};

/// `∫ f |cosθ_i| dω_i` and `∫ pdf dω_i` over the sphere, by adaptive quadrature with relative error
/// below 1e-3.
fn quadrature(b: &Bsdf, wo: Vec3) -> (Color, f64) {
    let chart = Chart::about(axis_of(b, wo));
    let g = |wi: Vec3| {
        let (f, pdf) = b.f_pdf(wo, wi);
        let f = (f * wi.z.abs()).as_dvec3();
        [f64::from(pdf), f.x, f.y, f.z]
    };
    let sum = cells(16, 16).fold([0.0; 4], |a, c| {
        let v = integrate(&chart, c, 1.5e-5, 6, &g);
        std::array::from_fn(|k| a[k] + v[k])
    });
    (Color::new(sum[1] as f32, sum[2] as f32, sum[3] as f32), sum[0])
}

/// Mean weight of `n` stratified draws: the finite lobes, the delta lobes, and the standard error
/// of the finite ones (of independent draws, an upper bound). Refracted weights count `eta²`-fold
/// if `undo_compression`.
fn monte_carlo(b: &Bsdf, wo: Vec3, n: usize, undo_compression: bool) -> (Color, Color, Color) {
    let mut rng = Rng(n as u64);
    let (mut finite, mut squares, mut delta) = (Color::ZERO, Color::ZERO, Color::ZERO);
    for k in 0..n {
        let x = (k as f32 + rng.next()) / n as f32;
        let Some(s) = b.sample(wo, x.min(0.999_999_9), rng.vec2()) else { continue };
        let weight = s.weight * if undo_compression { s.eta * s.eta } else { 1.0 };
        if s.lobe == Lobe::Delta {
            delta += weight;
        } else {
            finite += weight;
            squares += weight * weight;
        }
    }
    let n = n as f32;
    let mean = finite / n;
    let variance = (squares / n - mean * mean).max(Color::ZERO) / n;
    (mean, delta / n, Color::new(variance.x.sqrt(), variance.y.sqrt(), variance.z.sqrt()))
}

/// Roughness factors from near-mirror to one.
const ROUGHNESS: [f32; 8] = [0.1, 0.2, 0.3, 0.45, 0.5477, 0.7, 0.85, 1.0];

#[test]
fn white_metal_reflects_all_and_single_scattering_no_more() {
    for roughness in ROUGHNESS {
        let full = bsdf(&metal(Color::ONE, roughness), false);
        let single =
            bsdf(&Material { multiple_scattering: false, ..metal(Color::ONE, roughness) }, false);
        for degrees in [0.0, 30.0, 60.0, 75.0, 85.0, 89.0] {
            let wo = at(degrees, 50.0);
            let (albedo, _) = quadrature(&full, wo);
            assert!(
                (albedo - Color::ONE).abs().max_element() < 0.01,
                "roughness {roughness}, {degrees} degrees: {albedo}"
            );
            let (albedo, _) = quadrature(&single, wo);
            assert!(
                albedo.max_element() <= 1.0 + 1e-3,
                "single scattering, roughness {roughness}, {degrees} degrees: {albedo}"
            );
        }
    }
}

#[test]
fn layers_over_white_reflect_at_most_all() {
    let white = Color::ONE;
    let stacks = |r: f32| {
        [
            (plastic(white, r), true),
            (Material { metallic: 0.5, ..plastic(white, r) }, true),
            (Material { ior: 2.2, specular: 0.6, ..plastic(white, r) }, true),
            (Material { specular_color: Color::new(3.0, 0.5, 0.1), ..plastic(white, r) }, false),
            (Material { clearcoat: 1.0, clearcoat_roughness: 0.3, ..plastic(white, r) }, false),
            (Material { clearcoat: 0.5, clearcoat_roughness: r, ..metal(white, r) }, false),
            (sheet(white, r), true),
            (
                Material {
                    transmission: 0.4,
                    clearcoat: 0.7,
                    clearcoat_roughness: 0.0,
                    ..sheet(white, r)
                },
                true,
            ),
        ]
    };
    for roughness in [0.0, 0.25, 0.5, 1.0] {
        for (index, (material, closed)) in stacks(roughness).into_iter().enumerate() {
            let b = bsdf(&material, false);
            for wo in views() {
                let (finite, _) = quadrature(&b, wo);
                let (_, delta, _) = monte_carlo(&b, wo, 4096, false);
                let total = finite + delta;
                let place = format!("stack {index}, roughness {roughness}, wo {wo}: {total}");
                assert!(total.max_element() <= 1.012, "{place}");
                // Nothing is absorbed in a stack of achromatic, uncoated or smoothly coated white
                // layers.
                assert!(!closed || total.min_element() >= 0.985, "{place}");
                assert!(
                    (b.albedo(wo) - total).abs().max_element() < 0.012,
                    "{place}, albedo() says {}",
                    b.albedo(wo)
                );
            }
        }
    }
}

#[test]
fn clear_glass_reflects_or_transmits_all() {
    for ior in [1.0, 1.1, 1.33, 1.5, 2.4] {
        for roughness in [0.0, 0.1, 0.3, 0.6, 1.0] {
            for back_face in [false, true] {
                let b = bsdf(&glass(ior, roughness), back_face);
                for degrees in [0.0, 30.0, 55.0, 80.0] {
                    let (finite, delta, error) = monte_carlo(&b, at(degrees, 10.0), 20_000, true);
                    let total = (finite + delta).x;
                    let slack = if roughness == 0.0 { 1e-4 } else { 0.02 + 4.0 * error.x };
                    let place = format!(
                        "ior {ior}, roughness {roughness}, inside {back_face}, {degrees} degrees: {total}"
                    );
                    assert!((total - 1.0).abs() < slack, "{place}");
                }
            }
        }
    }
}

#[test]
fn refracted_radiance_is_compressed_and_sharp_where_it_must_be() {
    let b = bsdf(&glass(1.5, 0.0), false);
    assert!(b.is_delta_only() && b.transmits() && b.roughness() == 0.0 && !b.has_diffuse());
    let wo = at(40.0, 0.0);
    let s = b.sample(wo, 0.9, Color::ZERO.truncate()).unwrap();
    assert!(s.transmitted && s.eta == 1.5 && s.pdf == f32::INFINITY && s.lobe == Lobe::Delta);
    assert!((s.wi.x - -wo.x / 1.5).abs() < 1e-6 && s.wi.z < 0.0);
    assert!((s.weight.x * 1.5 * 1.5 - 1.0).abs() < 1e-5);
    // Total reflection from inside beyond 41.8 degrees, whatever the random numbers.
    let inside = bsdf(&glass(1.5, 0.0), true);
    for k in 0..16 {
        let s = inside.sample(at(45.0, 0.0), k as f32 / 16.0, Color::ZERO.truncate()).unwrap();
        assert!(!s.transmitted && (s.weight - Color::ONE).abs().max_element() < 1e-6);
    }
    // The same boundary from below as from its other side.
    let (from_below, other) = (b.f_pdf(-wo, wo), inside.f_pdf(wo, -wo));
    assert_eq!(from_below, other);
    // A thin sheet does not bend.
    let s = bsdf(&sheet(Color::ONE, 0.0), false).sample(wo, 0.9, Color::ZERO.truncate()).unwrap();
    assert!(s.transmitted && s.eta == 1.0 && s.wi == -wo);
}

#[test]
fn sample_means_match_quadrature() {
    let mut failures = Vec::new();
    for (name, b, _) in zoo() {
        for wo in views() {
            let (exact, pdf) = quadrature(&b, wo);
            assert!(pdf <= 1.0 + 2e-3, "{name}, wo {wo}: density integrates to {pdf}");
            let (mean, _, error) = monte_carlo(&b, wo, 20_000, false);
            // Five standard errors on 300 numbers: a false alarm in about 6000 seeds.
            let slack = 5.0 * error + Color::splat(2e-3);
            if !(mean - exact).abs().cmple(slack).all() {
                failures.push(format!(
                    "{name}, wo {wo}: mean {mean}, quadrature {exact}, error {error}"
                ));
            }
        }
    }
    assert!(failures.is_empty(), "\n{}", failures.join("\n"));
}

#[test]
fn weights_are_f_cos_over_pdf_and_lobes_say_what_they_are() {
    for (name, b, _) in zoo() {
        let mut rng = Rng(7);
        for wo in views() {
            for k in 0..400 {
                let glossy = k % 2 == 1;
                let (x, u) = (rng.next(), rng.vec2());
                let Some(s) = (if glossy { b.sample_glossy(wo, x, u) } else { b.sample(wo, x, u) })
                else {
                    continue;
                };
                assert!((s.wi.length() - 1.0).abs() < 1e-4, "{name}");
                assert_eq!(s.transmitted, s.wi.z < 0.0, "{name}");
                assert!(!(glossy && s.lobe == Lobe::Diffuse), "{name}");
                if s.lobe == Lobe::Delta {
                    assert!(s.pdf == f32::INFINITY && s.weight.is_finite(), "{name}");
                    continue;
                }
                let (f, pdf) = if glossy {
                    (b.f_glossy(wo, s.wi), b.pdf_glossy(wo, s.wi))
                } else {
                    (b.f(wo, s.wi), b.pdf(wo, s.wi))
                };
                assert!((pdf - s.pdf).abs() <= 1e-4 * pdf, "{name}: {pdf} {}", s.pdf);
                let expected = f * s.wi.z.abs() / pdf;
                assert!(
                    (expected - s.weight).abs().max_element() <= 1e-3 * expected.max_element(),
                    "{name}"
                );
            }
        }
    }
}

#[test]
fn the_diffuse_lobe_factorises() {
    for (name, b, _) in zoo() {
        let mut rng = Rng(11);
        for wo in views() {
            let albedo = b.diffuse_albedo(wo);
            assert!(albedo.min_element() >= 0.0 && albedo.max_element() <= 1.0, "{name}");
            assert_eq!(b.has_diffuse(), albedo != Color::ZERO, "{name}");
            for _ in 0..100 {
                let wi = rng.direction();
                let diffuse = if wi.z > 0.0 { albedo / PI } else { Color::ZERO };
                let (f, glossy) = (b.f(wo, wi), b.f_glossy(wo, wi));
                assert!(
                    (f - glossy - diffuse).abs().max_element() <= 1e-5 * (1.0 + f.max_element()),
                    "{name}: {f} {glossy} {diffuse}"
                );
            }
        }
    }
}

#[test]
fn reciprocal_where_the_model_is() {
    let single = |m: Material| Material { multiple_scattering: false, ..m };
    let red = Color::new(0.8, 0.3, 0.1);
    let mut surfaces: Vec<(&str, Bsdf)> = zoo()
        .into_iter()
        .filter(|(name, ..)| {
            ["lambert", "phong", "lafortune", "ward"].iter().any(|p| name.starts_with(p))
        })
        .map(|(name, b, _)| (name, b))
        .collect();
    surfaces.push(("metal", bsdf(&single(metal(red, 0.5)), false)));
    surfaces.push((
        "smooth dielectric's reflection",
        bsdf(&single(Material { base_color: Color::ZERO, ..plastic(red, 0.3) }), false),
    ));
    let mut rng = Rng(3);
    for (name, b) in &surfaces {
        for _ in 0..500 {
            let (mut a, mut c) = (rng.direction(), rng.direction());
            (a.z, c.z) = (a.z.abs(), c.z.abs());
            let (ab, ba) = (b.f(a, c), b.f(c, a));
            assert!(
                (ab - ba).abs().max_element() <= 1e-3 * (ab.max_element() + 1e-3),
                "{name}: {ab} {ba}"
            );
        }
    }
    // Refraction: η² f(wo, wi) = f(wi, wo), η the index on wi's side over that on wo's [Veach97].
    let boundary = bsdf(&single(glass(1.5, 0.6)), false);
    let mut compared = 0;
    for _ in 0..4000 {
        let (mut a, mut c) = (rng.direction(), rng.direction());
        (a.z, c.z) = (a.z.abs(), -c.z.abs());
        let (down, up) = (boundary.f(a, c).x * 2.25, boundary.f(c, a).x);
        compared += usize::from(down > 1e-4);
        assert!((down - up).abs() <= 2e-3 * (down + 1e-3), "{a} {c}: {down} {up}");
    }
    assert!(compared > 300, "{compared}");
}

#[test]
fn specular_zero_is_lambert_and_nothing_else() {
    let albedo = Color::new(0.725, 0.71, 0.68);
    let b = bsdf(&matte(albedo), false);
    assert_eq!(b, Bsdf::lambert(albedo));
    assert!(b.has_diffuse() && !b.has_glossy() && !b.is_delta_only() && b.roughness() == 1.0);
    let (wo, wi) = (at(80.0, 0.0), at(30.0, 70.0));
    assert_eq!((b.f_glossy(wo, wi), b.diffuse_albedo(wo)), (Color::ZERO, albedo));
    assert!((b.f(wo, wi) * PI - albedo).abs().max_element() < 1e-6);
    assert!(b.sample_glossy(wo, 0.5, Color::ZERO.truncate()).is_none());
    assert_eq!(bsdf(&matte(Color::ZERO), false), Bsdf::BLACK);
    // A default dielectric is not.
    assert!(bsdf(&plastic(albedo, 1.0), false).has_glossy());
}

#[test]
fn phong_and_ward_have_their_closed_forms() {
    // The Phong lobe seen from the normal reflects exactly ks: (s+2)/(2π) ∫ cos^(s+1) = 1.
    for exponent in [0.0, 1.0, 20.0, 500.0] {
        let b =
            Bsdf::native(NativeBrdf::Phong { kd: Color::ZERO, ks: Color::splat(0.6), exponent });
        let (albedo, _) = quadrature(&b, Vec3::Z);
        assert!((albedo.x - 0.6).abs() < 2e-3, "exponent {exponent}: {albedo}");
    }
    // At the peak, h = n: f = ks / (4π αx αy cos²θ).
    let b = Bsdf::native(NativeBrdf::WardDuer {
        kd: Color::ZERO,
        ks: Color::splat(0.5),
        alpha_x: 0.2,
        alpha_y: 0.3,
    });
    let (wo, wi) = (at(50.0, 0.0), at(50.0, 180.0));
    let expected = 0.5 / (4.0 * PI * 0.2 * 0.3 * wo.z * wo.z);
    assert!((b.f(wo, wi).x / expected - 1.0).abs() < 1e-4);
    // It stays bounded by ks at every angle, unlike Ward's and Duer's own forms.
    for degrees in [0.0, 45.0, 80.0, 88.0, 89.9] {
        assert!(quadrature(&b, at(degrees, 30.0)).0.x <= 0.5 + 1e-3, "{degrees}");
    }
}

#[test]
fn every_finite_input_gives_finite_numbers() {
    let mut rng = Rng(99);
    let extremes = [0.0, 1.0, 1e-8, 1e-3, 0.0316, 0.0317, 0.5, -1.0, 7.0, 1e9];
    let pick = |rng: &mut Rng| {
        if rng.next() < 0.5 {
            rng.next()
        } else {
            extremes[(rng.next() * extremes.len() as f32) as usize]
        }
    };
    for round in 0..4000 {
        let color = |rng: &mut Rng| Color::new(pick(rng), pick(rng), pick(rng));
        let colors: [Color; 7] = std::array::from_fn(|_| color(&mut rng));
        let mut value = || pick(&mut rng);
        let material = Material {
            base_color: colors[0],
            metallic: value(),
            roughness: value(),
            ior: [0.0, 1.0, 1.005, 1.02, 1.5, 3.0, 1e9, value()][round % 8],
            specular: value(),
            specular_color: colors[1],
            transmission: value(),
            thin: round % 3 == 0,
            clearcoat: value(),
            clearcoat_roughness: value(),
            multiple_scattering: round % 5 != 0,
            native: match round % 12 {
                0 => Some(NativeBrdf::Phong { kd: colors[0], ks: colors[1], exponent: value() }),
                1 => Some(NativeBrdf::WardDuer {
                    kd: colors[0],
                    ks: colors[1],
                    alpha_x: value(),
                    alpha_y: value(),
                }),
                2 => Some(NativeBrdf::Lafortune {
                    kd: colors[0],
                    lobes: [lumicache::material::LafortuneLobe {
                        cx: colors[1],
                        cy: colors[2],
                        cz: colors[3],
                        exponent: colors[4],
                    }; 3],
                    count: 5,
                }),
                _ => None,
            },
            ..Material::default()
        };
        let b = bsdf(&material, round % 2 == 0);
        for k in 0..12 {
            let mut wo = rng.direction();
            let mut wi = rng.direction();
            match k % 6 {
                0 => wo = Vec3::X,
                1 => (wo, wi) = (Vec3::new(1.0, 0.0, 1e-30), Vec3::new(-1.0, 0.0, 1e-30)),
                2 => (wo, wi) = (Vec3::new(1.0, 0.0, 1e-7), Vec3::NEG_X),
                3 => wi = -wo,
                4 => wi = Vec3::new(-wo.x, -wo.y, wo.z),
                _ => {}
            }
            let finite = |c: Color| c.is_finite() && c.min_element() >= 0.0;
            for (f, pdf) in [b.f_pdf(wo, wi), b.f_pdf_glossy(wo, wi)] {
                assert!(
                    finite(f) && pdf >= 0.0 && pdf.is_finite(),
                    "{material:?}\n{wo} {wi}: {f} {pdf}"
                );
            }
            assert!(finite(b.diffuse_albedo(wo)) && finite(b.albedo(wo)), "{material:?}\n{wo}");
            for u in [rng.vec2(), Color::ZERO.truncate(), Color::splat(0.999_999_94).truncate()] {
                for x in [0.0, rng.next(), 0.999_999_94] {
                    for s in [b.sample(wo, x, u), b.sample_glossy(wo, x, u)].into_iter().flatten() {
                        let sane =
                            finite(s.weight) && s.wi.is_finite() && s.pdf > 0.0 && s.eta > 0.0;
                        assert!(
                            sane && (s.wi.length() - 1.0).abs() < 1e-3,
                            "{material:?}\n{wo}: {s:?}"
                        );
                    }
                }
            }
        }
    }
}
