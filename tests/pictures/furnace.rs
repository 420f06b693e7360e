//! Closed boxes and open skies, where the light is known in closed form.
//!
//! In a closed box whose walls all reflect diffusely with albedo ρ and emit L_e, radiance is
//! `L_e (1 + ρ + ρ² + ...) = L_e/(1 - ρ)` everywhere. With at most N interactions after the camera
//! hit the sum ends at ρ^(N+1). A record on level l then holds the indirect light
//! `π L_e (ρ + ... + ρ^(N-l))`.
//!
//! Pixels and records are estimates with fixed seeds. Each bound is at least five standard errors
//! of what it bounds, as measured over the pixels or records themselves: a sound renderer fails one
//! of them with a probability below 1e-5.

use crate::support::pictures::{build, cached, fill, render, seen, settings};
use crate::support::rooms::*;
use lumicache::cache::{Cache, Irradiance, LevelPoints, Metric, PRESETS, RadiusRule, Record};
use lumicache::light::EnvironmentMap;
use lumicache::material::Material;
use lumicache::math::{Color, Frame as Basis, Mat3, PI, Vec2, luminance};
use lumicache::render::{Frame, IntegratorKind, Settings};
use lumicache::scene::{Scene, SceneData};

/// L_e (1 + ρ + ... + ρ^(N+1)).
fn expected(max_bounces: u32) -> Color {
    EMISSION * series(max_bounces.saturating_add(2))
}

/// 1 + ρ + ... with `terms` terms.
fn series(terms: u32) -> Color {
    let power = |x: f32| if terms > 1000 { 0.0 } else { x.powi(terms as i32) };
    (Color::ONE - Color::new(power(ALBEDO.x), power(ALBEDO.y), power(ALBEDO.z)))
        / (Color::ONE - ALBEDO)
}

/// All pixels are `expected` within `each`, their mean within `mean`, relative, channel by channel.
fn assert_uniform(what: &str, frame: &Frame, expected: Color, each: f32, mean: f32) {
    let errors: Vec<Color> =
        frame.film.radiance().iter().map(|c| *c / expected - Color::ONE).collect();
    let worst = errors.iter().fold(0.0_f32, |m, e| m.max(e.abs().max_element()));
    let of_mean = average(errors.iter().copied()).abs().max_element();
    assert!(errors.iter().all(|e| e.is_finite()), "{what}: not a number");
    assert!(worst <= each, "{what}: a pixel is off by {worst} (at most {each})");
    assert!(of_mean <= mean, "{what}: the mean is off by {of_mean} (at most {mean})");
}

fn average(values: impl ExactSizeIterator<Item = Color>) -> Color {
    let count = values.len() as f32;
    values.sum::<Color>() / count
}

#[test]
fn the_path_tracer_sees_the_whole_series() {
    let scene = furnace(diffuse());
    for max_bounces in [0, 1, 2, u32::MAX] {
        let settings = Settings { max_bounces, ..settings(&scene, IntegratorKind::Path, SIZE, 64) };
        let each = if max_bounces == u32::MAX { 0.2 } else { 0.04 };
        assert_uniform(
            &format!("path, {max_bounces} bounces"),
            &render(&scene, &settings),
            expected(max_bounces),
            each,
            0.005,
        );
    }
}

#[test]
fn every_preset_sees_the_whole_series() {
    let scene = furnace(diffuse());
    for preset in PRESETS.iter() {
        for max_bounces in [0, 2, u32::MAX] {
            let mut settings = Settings { max_bounces, ..cached(&scene, &preset.name, SIZE, 16) };
            settings.scheme.gather.rays = settings.scheme.gather.rays.min(256);
            let frame = render(&scene, &settings);
            let what = format!("{}, {max_bounces} bounces", preset.name);
            // Direct light comes from light samples alone here, 16 to a pixel: 3 % at best.
            assert_uniform(&what, &frame, expected(max_bounces), 0.25, 0.01);
            let cache = &frame.caches.as_ref().unwrap().cache;
            assert_eq!(
                u32::from(cache.level_count()),
                u32::from(settings.scheme.levels).min(max_bounces),
                "{what}"
            );
            assert_records(&what, cache, max_bounces);
        }
    }
}

/// Every record holds the indirect light of its level and sees no change of it, but for noise that
/// falls with the root of the number of rays.
fn assert_records(what: &str, cache: &Cache, max_bounces: u32) {
    for k in 0..cache.level_count() {
        let what = format!("{what}, level {k}");
        let records = cache.records(k);
        assert!(!records.is_empty(), "{what} is empty");
        let count = records.len() as f32;
        let all = records.iter().all(|r| r.payload.lit.is_some());
        if all {
            // Records of all light tell the direct light apart.
            let direct = average(
                records
                    .iter()
                    .map(|r| r.payload.lit.unwrap().irradiance / (PI * EMISSION) - Color::ONE),
            );
            assert!(direct.abs().max_element() < 0.01, "{what}: direct light is off by {direct}");
        }
        let held = series((max_bounces - u32::from(k)).saturating_add(1));
        let expected = PI * EMISSION * if all { held } else { held - Color::ONE };
        let root = (cache.scheme().layout(k).rays() as f32).sqrt();

        let errors = records.iter().map(|r| r.payload.irradiance / expected - Color::ONE);
        let spread = (errors.clone().map(|e| e.length_squared() / 3.0).sum::<f32>() / count).sqrt();
        assert!(spread * root < 0.6, "{what}: irradiance is spread by {spread}");
        let off = average(errors).abs().max_element();
        // Records share the errors of the deeper ones that they look up, of which the deepest have
        // 16 rays that end by roulette.
        assert!(
            off < 0.03 + 5.0 * spread / count.sqrt(),
            "{what}: mean irradiance of {count} records is off by {off}"
        );

        // Changes of the luminance along both tangents, per radian, and over the distance to the
        // walls. Metrics that estimate an error have lengths that are distances only after
        // they are scaled by it.
        let scheme = cache.scheme();
        let distances = matches!(
            scheme.radius.metric,
            Metric::Harmonic | Metric::Minimum | Metric::MinimumRestricted
        );
        let scale = if distances { 1.0 } else { scheme.radius_scale(k) };
        let gradients = |matrix: &dyn Fn(&Record<Irradiance>) -> (Mat3, f32)| -> Vec<Vec2> {
            let relative = |r: &Record<Irradiance>| {
                let (frame, (m, length)) = (Basis::from_normal(r.normal), matrix(r));
                Vec2::new(luminance(m * frame.s), luminance(m * frame.t))
                    * (length / luminance(expected))
            };
            records.iter().map(relative).collect()
        };
        for (kind, gradients) in [
            ("rotation", gradients(&|r| (r.payload.rotation, 1.0))),
            ("translation", gradients(&|r| (r.payload.translation, scale * r.length_unclamped))),
        ] {
            // The rotational gradient has no finite variance: a ray close to the horizon counts by
            // the tangent of its angle. Hence the median.
            let mut sizes: Vec<f32> = gradients.iter().map(|g| g.length()).collect();
            sizes.sort_by(f32::total_cmp);
            let median = sizes[sizes.len() / 2];
            assert!(median * root < 3.0, "{what}: the {kind} changes irradiance by {median}");
            let spread = (gradients.iter().map(|g| g.length_squared()).sum::<f32>() / count).sqrt();
            let off = (gradients.iter().sum::<Vec2>() / count).length();
            assert!(
                off <= 0.002 + 5.0 * spread / count.sqrt(),
                "{what}: the {kind} changes irradiance by {off} on average"
            );
        }
    }
}

#[test]
fn gloss_neither_makes_nor_loses_light() {
    let metal =
        |roughness| Material { metallic: 1.0, roughness, multiple_scattering: true, ..diffuse() };
    let glazed = Material {
        specular: 1.0,
        roughness: 0.4,
        clearcoat: 0.5,
        clearcoat_roughness: 0.2,
        ..diffuse()
    };
    // Lower and upper bounds of the mean as shares of L_e/(1 - ρ). Fresnel's law makes a metal
    // brighter towards grazing angles, several bounces between its microfacets make a rough one
    // darker, and a glaze reflects a few percent on top of what the body does.
    for (what, material, low, high) in [
        ("smooth metal", metal(0.15), 0.98, 1.1),
        ("rough metal", metal(0.6), 0.85, 1.0),
        ("glaze", glazed, 1.02, 1.15),
    ] {
        let scene = furnace(material);
        let path = render(&scene, &settings(&scene, IntegratorKind::Path, SIZE, 64));
        let cache = render(&scene, &cached(&scene, "auto", SIZE, 64));
        let [traced, interpolated] = [&path, &cache]
            .map(|frame| average(frame.film.radiance().into_iter()) / expected(u32::MAX));
        assert!(traced.min_element() > low && traced.max_element() < high, "{what}: {traced}");
        let ratio = interpolated / traced;
        assert!((ratio - Color::ONE).abs().max_element() < 0.01, "{what}: cache over path {ratio}");
    }
}

/// A diffuse square alone under a sky that is the same everywhere.
fn open_sky() -> Scene {
    build(SceneData { environment: Some(EnvironmentMap::constant(EMISSION)), ..plane(diffuse()) })
}

#[test]
fn a_uniform_sky_gives_pi_times_its_radiance() {
    let scene = open_sky();
    for integrator in [IntegratorKind::Path, IntegratorKind::Cache] {
        let frame = render(&scene, &settings(&scene, integrator, SIZE, 16));
        // Radiance ρ E/π with E = π L.
        assert_uniform(
            &format!("{} under the sky", integrator.name()),
            &frame,
            ALBEDO * EMISSION,
            0.1,
            0.005,
        );
    }
}

#[test]
fn a_record_that_sees_nothing_reaches_as_far_as_it_may() {
    let scene = open_sky();
    let points = LevelPoints::from(seen(&scene, &scene.cameras()[0], SIZE, 0));
    for preset in PRESETS.iter() {
        let scheme = preset.scheme();
        let (cache, _) = fill(&scene, scheme.clone(), &points);
        let reach = RadiusRule::new(cache.scheme(), 0, cache.extent(), 1.0);
        for r in cache.records(0) {
            assert_eq!(
                (r.payload.irradiance, r.payload.rotation, r.payload.translation),
                (Color::ZERO, Mat3::ZERO, Mat3::ZERO),
                "{}",
                preset.name
            );
            let mut longest = scheme.radius.max_radius * cache.extent();
            if scheme.radius.max_pixels > 0.0 {
                longest = longest.min(scheme.radius.max_pixels * r.footprint);
            }
            assert_eq!(reach.radius(r.length, r.footprint).0, longest, "{}", preset.name);
        }
        for point in &points.points {
            assert_eq!(
                cache.lookup(0, point, u32::MAX).unwrap().irradiance,
                Color::ZERO,
                "{}",
                preset.name
            );
        }
    }
}
