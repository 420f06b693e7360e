//! Radiance records on all surfaces, placed by their Hessians: where they lie, what another viewer
//! makes of them, what they hold.

use crate::support::pictures::{build, cached, own, render};
use lumicache::cache::{Extrapolation, Harmonics, Outline, Record, Scheme};
use lumicache::math::{Color, Vec3};
use lumicache::render::{Caches, Frame};
use lumicache::scene::Scene;
use lumicache::transport::{PathTracer, SceneReflector};

/// What makes another scheme of one.
type Change<'a> = &'a dyn Fn(&mut Scheme);

/// A frame of the box by one of the presets: few rays, areas that no pixel limits.
fn boxed(scene: &Scene, preset: &str, change: impl Fn(&mut Scheme)) -> Frame {
    let mut settings = cached(scene, preset, [48, 48], 1);
    settings.max_bounces = 2;
    settings.scheme.gather.rays = 256;
    settings.scheme.gather.noise = 0.0;
    settings.scheme.radius.min_pixels = 0.5;
    settings.scheme.validity.error = 1e-4;
    change(&mut settings.scheme);
    settings.scheme.check().unwrap();
    render(scene, &settings)
}

fn records(frame: &Frame) -> &[Record<Harmonics>] {
    frame.caches.as_ref().unwrap().cache.radiance_records(0)
}

fn on_back_wall(r: &Record<Harmonics>) -> bool {
    r.normal.z < -0.9 && r.position.z > 5.5
}

/// Records on the back wall and elsewhere.
fn counts(frame: &Frame) -> [f64; 2] {
    let back = records(frame).iter().filter(|r| on_back_wall(r)).count();
    [back, records(frame).len() - back].map(|n| n as f64)
}

#[test]
fn incident_radiance_knows_no_surfaces_and_outgoing_radiance_does() {
    let [diffuse, glossy] = ["cornell-box", "cornell-box-phong"].map(|name| build(own(name)));
    let of = |preset: &str, scene: &Scene| counts(&boxed(scene, preset, |_| ()));
    let [incoming, incoming_diffuse] =
        [of("zhao-incoming", &glossy), of("zhao-incoming", &diffuse)];
    let share = |c: [f64; 2]| c[0] / c[1];
    for preset in ["zhao-outgoing", "zhao-view"] {
        let [with, without] = [of(preset, &glossy), of(preset, &diffuse)];
        println!(
            "{preset}: {with:?} with a glossy wall, {without:?} without; zhao-incoming {incoming:?} and {incoming_diffuse:?}"
        );
        // Diffuse surfaces blur: the same error is met with fewer records.
        assert!(with[1] < 0.8 * incoming[1], "{preset}: {with:?} {incoming:?}");
        // A larger share of the records lies on the glossy wall than zhao-incoming puts there, and
        // than there would be were the wall diffuse.
        assert!(
            share(with) > 1.15 * share(incoming) && share(with) > 1.15 * share(without),
            "{preset}: {with:?} {without:?} {incoming:?}"
        );
    }
    assert!(
        (incoming[0] / incoming_diffuse[0] - 1.0).abs() < 0.15,
        "{incoming:?} {incoming_diffuse:?}"
    );
}

#[test]
fn another_viewer_changes_areas_on_glossy_surfaces_alone_and_back() {
    let scene = build(own("cornell-box-phong"));
    let frame = boxed(&scene, "zhao-view", |_| ());
    let before = records(&frame).to_vec();
    let Caches { mut cache, lobes, .. } = frame.caches.unwrap();
    let reflector = SceneReflector {
        tracer: PathTracer { scene: &scene, max_bounces: 2 },
        tables: lobes.as_ref().unwrap().tables(),
    };
    let eye = Vec3::from(scene.cameras()[0].to_world.translation);
    let mut see = |from: Vec3| -> Vec<f32> {
        cache.see_from(&reflector, &|x| (from - x).normalize());
        let ratios = cache
            .radiance_records(0)
            .iter()
            .zip(&before)
            .map(|(r, b)| (r.length_unclamped / b.length_unclamped).ln().abs());
        ratios.collect()
    };
    // The eye that they were made for.
    assert!(see(eye).iter().all(|ratio| *ratio < 1e-2));
    let moved = see(Vec3::new(0.5, 4.5, 1.0));
    let mean = |glossy: bool| {
        let of: Vec<f32> = moved
            .iter()
            .zip(&before)
            .filter(|(_, r)| on_back_wall(r) == glossy)
            .map(|(m, _)| *m)
            .collect();
        of.iter().sum::<f32>() / of.len() as f32
    };
    assert!(
        mean(true) > 0.1 && mean(false) < 1e-2,
        "{} on the glossy wall, {} elsewhere",
        mean(true),
        mean(false)
    );
    assert!(see(eye).iter().all(|ratio| *ratio < 1e-2));
}

#[test]
fn records_are_as_large_as_they_should_be() {
    let scene = build(own("cornell-box-phong"));
    let each = |change: Change| {
        let frame = boxed(&scene, "zhao-incoming", change);
        let level = frame.caches.as_ref().unwrap().cache.level(0).unwrap();
        // What is there besides the coefficients, the irradiance and its index, is left out.
        let rest = level.irradiance().bytes();
        ((level.radiance().unwrap().bytes() - rest) as f64 / records(&frame).len() as f64, frame)
    };
    let (first, single) = each(&|_| ());
    let (second, _) = each(&|s| s.extrapolation = Extrapolation::Second);
    let (half, halved) = each(&|s| s.set("glossy.storage", "f16").unwrap());
    println!("{first:.0}, {second:.0}, {half:.0} bytes");
    assert!(first < 3600.0 + 350.0 && second < 7200.0 + 350.0 && half < 1800.0 + 350.0);
    // Half precision shows nowhere.
    let sum = |f: &Frame| f.film.radiance().iter().copied().sum::<Color>();
    assert!((sum(&single) - sum(&halved)).abs().max_element() < 1e-3 * sum(&single).max_element());
}

#[test]
fn every_choice_makes_a_picture_of_the_same_brightness() {
    let scene = build(own("cornell-box-phong"));
    let brightness = |change: Change| {
        let frame = boxed(&scene, "zhao-incoming", change);
        let pixels = frame.film.radiance();
        assert!(pixels.iter().all(|c| c.is_finite()));
        pixels.iter().map(|c| f64::from(c.element_sum())).sum::<f64>()
    };
    let expected = brightness(&|s| s.validity.error = 1e-5);
    let choices: [(&str, Change); 9] = [
        ("as it is", &|_| ()),
        ("no extrapolation", &|s| s.extrapolation = Extrapolation::Rotation),
        ("second order", &|s| s.extrapolation = Extrapolation::Second),
        ("first-order areas", &|s| {
            s.set_all([("glossy.metric", "first-incoming"), ("validity.error", "1e-4")]).unwrap();
        }),
        ("sectors", &|s| s.radius.area = Outline::Sectors),
        ("discs", &|s| s.radius.area = Outline::Disc),
        ("in the world's frame", &|s| s.set("glossy.basis", "sh-world").unwrap()),
        ("without the change of hits", &|s| s.set("glossy.hits", "none").unwrap()),
        ("from hits", &|s| s.set("glossy.hits", "stored").unwrap()),
    ];
    for (what, change) in choices {
        let got = brightness(change);
        assert!((got / expected - 1.0).abs() < 0.02, "{what}: {got} instead of {expected}");
    }
}
