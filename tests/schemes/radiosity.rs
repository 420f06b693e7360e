//! The cache of all light behind the visible surfaces.

use crate::support::pictures::{
    beauty, build, cached, difference, own, render, scheme, seen, with,
};
use lumicache::cache::{Cache, FillPlan, FillReport, Radiosity, Scheme, ShadingPoint};
use lumicache::geometry::SurfacePoint;
use lumicache::progress::Progress;
use lumicache::render::{IntegratorKind, Settings};
use lumicache::scene::Scene;
use lumicache::transport::{PathTracer, SceneWorld};

/// Few rays, which suffice where the mean is not looked at.
fn coarse() -> Scheme {
    with(scheme("auto"), |s| {
        s.gather.rays = 64;
        s.radiosity.as_mut().unwrap().points = 1024;
    })
}

fn fill(cache: &mut Cache, scene: &Scene, points: &[SurfacePoint], bounces: u32) -> [u64; 3] {
    let scheme = cache.scheme().clone();
    let world = SceneWorld::new(PathTracer { scene, max_bounces: bounces }, None, &scheme);
    let wanted = |(number, at): (u32, &SurfacePoint)| ShadingPoint {
        number,
        point: *at,
        irradiance: true,
        order: 0,
    };
    let points: Vec<ShadingPoint> = (0..).zip(points).map(wanted).collect();
    let plan = FillPlan { deeper_points: 1024, round: 0, seed: 0 };
    let mut report = FillReport::new(cache);
    cache.fill_levels(&world, &points, &plan, &mut report, &Progress::default()).unwrap();
    world.rays()
}

fn visible(scene: &Scene, columns: u32) -> Vec<SurfacePoint> {
    seen(scene, &scene.cameras()[0], [columns, columns], 0)
}

#[test]
fn gathers_end_in_it_without_paths_but_near_by() {
    let scene = build(own("cornell-box"));
    let mut cache = Cache::new(coarse(), u32::MAX);
    let [rays, shadows, paths] = fill(&mut cache, &scene, &visible(&scene, 32), u32::MAX);
    let levels = with(coarse(), |s| s.radiosity = None);
    let mut without = Cache::new(levels, u32::MAX);
    fill(&mut without, &scene, &visible(&scene, 32), u32::MAX);
    assert!(cache.radiosity().is_some() && without.radiosity().is_none());
    // A shadow ray is needed at edges of shadows alone, and a path behind hits that are near.
    assert!(2 * shadows < rays && 5 * paths < rays, "{rays} {shadows} {paths}");
}

#[test]
fn paths_with_a_bound_fill_level_after_level() {
    let scene = build(own("cornell-box"));
    let mut cache = Cache::new(coarse(), 3);
    fill(&mut cache, &scene, &visible(&scene, 16), 3);
    assert!(cache.radiosity().is_none());
    assert!(
        !cache.records(1).is_empty() && cache.records(1).iter().all(|r| r.payload.lit.is_none())
    );
}

#[test]
fn direct_light_is_left_out_for_rays_that_are_short() {
    let scene = build(own("cornell-box"));
    let mut cache = Cache::new(coarse(), u32::MAX);
    fill(&mut cache, &scene, &visible(&scene, 32), u32::MAX);
    let radiosity: &Radiosity = cache.radiosity().unwrap();
    let record = &radiosity.records()[0];
    let at = SurfacePoint::plain(record.position, record.normal);
    let far = radiosity.lookup(&at, f32::INFINITY).unwrap();
    assert!(far.irradiance.min_element() >= 0.0);
    // Near by, direct light is left to light samples.
    let near = radiosity.lookup(&at, 0.0).unwrap();
    assert!(!near.all && (near.irradiance - far.irradiance).max_element() <= 0.0);
    let behind = SurfacePoint::plain(record.position, -record.normal);
    assert!(radiosity.lookup(&behind, f32::INFINITY).is_none());
}

#[test]
fn another_view_adds_records_and_leaves_those_that_are_there() {
    let scene = build(own("cornell-box"));
    let mut cache = Cache::new(coarse(), u32::MAX);
    let points = visible(&scene, 32);
    let (few, others) = points.split_at(16);
    fill(&mut cache, &scene, few, u32::MAX);
    let before: Vec<_> = cache.records(1).to_vec();
    fill(&mut cache, &scene, others, u32::MAX);
    let after = cache.records(1);
    assert!(after.len() >= before.len());
    for (a, b) in before.iter().zip(after) {
        assert_eq!(a.payload.irradiance, b.payload.irradiance);
        assert_eq!(a.position, b.position);
    }
}

#[test]
fn pictures_have_the_light_of_path_traced_ones() {
    for name in ["cornell-box", "indirect-room"] {
        let scene = build(own(name));
        let size = [64, 48];
        let reference =
            Settings { integrator: IntegratorKind::Path, ..cached(&scene, "auto", size, 1024) };
        let reference = beauty(&render(&scene, &reference));
        // One seed says little: records share the noise of the few that all light passes by.
        let mean = |seed| {
            let settings = Settings { seed, ..cached(&scene, "auto", size, 16) };
            difference(&beauty(&render(&scene, &settings)), &reference).mean_ratio.unwrap()
        };
        let seeds = 4;
        let ratio = (0..seeds).map(mean).sum::<f64>() / seeds as f64;
        assert!((ratio - 1.0).abs() < 0.01, "{name}: {ratio}");
    }
}
