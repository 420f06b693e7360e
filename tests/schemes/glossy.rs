//! Glossy pictures by records and by paths.

use crate::support::pictures::{beauty, build, cached, difference, own, render};
use lumicache::cache::{Bands, Glossy, GlossyBasis, Refinement, RefinementRule, Scheme};
use lumicache::compare::Report;
use lumicache::film::{LAYERS, Pixel};
use lumicache::gather::RadianceGradient;
use lumicache::imagefile::{Picture, SampleKind};
use lumicache::material::NativeBrdf;
use lumicache::math::Color;
use lumicache::render::{Frame, Settings};
use lumicache::scene::{Scene, SceneData};

/// One layer of a frame as a picture.
pub fn layer(frame: &Frame, name: &str) -> Picture {
    let mut picture = Picture::new(frame.film.window_size());
    let channels = frame.film.channels(LAYERS.iter().find(|l| l.name == name).unwrap());
    let opaque = vec![1.0; channels[0].len()];
    for (samples, name) in channels.into_iter().chain([opaque]).zip(["R", "G", "B", "A"]) {
        picture.add(name, SampleKind::Float, samples);
    }
    picture
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
    scene: &Scene, size: [u32; 2], change: impl Fn(&mut Scheme),
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
            let caches = frame.caches.as_ref().unwrap();
            let records = caches.cache.radiance_records(0);
            let smallest = caches.cache.scheme().error_min();
            assert!(
                records.iter().all(|r| r.error >= 0.999 * smallest),
                "a record went below the smallest error"
            );
            assert_eq!(caches.report.radiance[0].reductions > 0, refinement.is_some());
            records.len() as f32
        })
    };
    let growth = |counts: [f32; 3]| [counts[1] / counts[0], counts[2] / counts[0]];
    let (refined, plain) = (counts(Some(Refinement::default())), counts(None));
    // Without refinement the lobe hardly matters.
    let larger = growth(refined)
        .iter()
        .zip(growth(plain))
        .all(|(with, without)| *with > 1.1 * without && *with > 1.3);
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
            settings.scheme.radiosity = None;
            let glossy = settings.scheme.glossy.as_mut().unwrap();
            (glossy.economy, glossy.levels) = (false, levels);
            render(&scene, &settings)
        };
        let [one, two] = [1, 2].map(with);
        let count = |frame: &Frame| {
            let cache = &frame.caches.as_ref().unwrap().cache;
            let records = |level| cache.radiance_records(level).len();
            (0..cache.radiance_level_count()).map(records).collect::<Vec<_>>()
        };
        assert_eq!(count(&one).len(), 1);
        assert!(count(&two).len() == 2 && count(&two)[1] > 20, "{name}: {:?}", count(&two));
        let paths = |frame: &Frame| {
            let [bundle, _, paths] = frame.caches.as_ref().unwrap().gathered;
            paths as f32 / bundle as f32
        };
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
        let fill = &frame.caches.as_ref().unwrap().report.radiance[0];
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
    assert_eq!(needed.caches.unwrap().cache.radiance_record_count(), 0);
    let cache = &all.caches.as_ref().unwrap().cache;
    let bytes = cache.level(0).unwrap().radiance().unwrap().bytes();
    let numbers = 3 * 3 * 100 * size_of::<f32>();
    assert!(bytes > cache.radiance_record_count() * numbers, "not all records have ten bands");
}
