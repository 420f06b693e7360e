//! Glossy answers: from radiance records where seeds have said from where they are looked at, else
//! by paths.

use super::agreement::picture;
use super::*;

/// Points, their normals, and the directions from which they are looked at.
struct Looked {
    points: (Vec<[f32; 3]>, Vec<[f32; 3]>),
    wo: Vec<[f32; 3]>,
}

/// What the middle of a scene sees.
fn looked(scene: &SceneHandle, count: usize) -> Looked {
    let mut info: lumi_scene_info = sized();
    ok(unsafe { lumi_scene_get_info(scene.0, &raw mut info) });
    let middle = 0.5 * (Vec3::from(info.bounds_min) + Vec3::from(info.bounds_max));
    let points = seen(scene, count);
    let wo = points.0.iter().map(|p| (middle - Vec3::from(*p)).normalize().to_array()).collect();
    Looked { points, wo }
}

/// A cache of `preset` for `looked`, whose seeds say from where they are looked at, or not.
fn built(scene: &SceneHandle, preset: &str, looked: &Looked, with_wo: bool) -> CacheHandle {
    let mut c = null_mut();
    ok(unsafe { lumi_cache_new(scene.0, text(preset).as_ptr(), &raw mut c) });
    set(c, "gather.rays", 1024);
    set(c, "levels", 2);
    let wo = if with_wo { looked.wo.as_ptr().cast() } else { null() };
    let seeds = lumi_query { wo, ..query_of(&looked.points) };
    ok(unsafe { lumi_cache_build(c, &raw const seeds) });
    CacheHandle(c)
}

/// Glossy radiance, from `samples` paths where paths find it, and irradiance.
fn reflected(cache: &CacheHandle, looked: &Looked, samples: u32) -> [Vec<[f32; 3]>; 2] {
    let mut answers = [(); 2].map(|()| vec![[-1.0_f32; 3]; looked.wo.len()]);
    let [radiance, irradiance] = &mut answers;
    let query = lumi_query {
        wo: looked.wo.as_ptr().cast(),
        radiance: radiance.as_mut_ptr().cast(),
        irradiance: irradiance.as_mut_ptr().cast(),
        glossy_samples: samples,
        ..query_of(&looked.points)
    };
    ok(unsafe { lumi_cache_query(cache.0, &raw const query) });
    answers
}

fn mean(values: &[[f32; 3]]) -> f32 {
    values.iter().map(|v| v[0] + v[1] + v[2]).sum::<f32>() / values.len() as f32
}

#[test]
fn radiance_records_answer_without_paths_and_agree_with_them() {
    let d = device("threads=2");
    let s = loaded(&d, "cornell-box-glossy");
    let looked = looked(&s, 6000);
    let (recorded, traced) = (built(&s, "auto", &looked, true), built(&s, "auto", &looked, false));
    assert!(stats(recorded.0).radiance_records > 20 && stats(traced.0).radiance_records == 0);
    assert!(
        stats(recorded.0).bytes > stats(traced.0).bytes
            && stats(recorded.0).rays > stats(traced.0).rays
    );
    let [[one, irradiance], [many, _], [paths, same]] = [
        reflected(&recorded, &looked, 1),
        reflected(&recorded, &looked, 256),
        reflected(&traced, &looked, 256),
    ];
    assert!(
        (mean(&irradiance) / mean(&same) - 1.0).abs() < 0.01,
        "{} {}",
        mean(&irradiance),
        mean(&same)
    );
    // Where records answer, the number of paths does not matter.
    let served: Vec<usize> =
        (0..one.len()).filter(|&i| one[i] == many[i] && one[i][0] > 0.0).collect();
    assert!(served.len() > 300, "{} points are served", served.len());
    let [by_records, by_paths] =
        [&many, &paths].map(|from| mean(&served.iter().map(|&i| from[i]).collect::<Vec<_>>()));
    println!("{} points by records {by_records:.4}, by paths {by_paths:.4}", served.len());
    assert!((by_records / by_paths - 1.0).abs() < 0.02, "{by_records} {by_paths}");
    // Cleared, the cache knows nothing of them.
    ok(unsafe { lumi_cache_clear(recorded.0) });
    assert_eq!(stats(recorded.0).radiance_records, 0);
}

#[test]
fn presets_are_whole_here_too() {
    let d = device("threads=2");
    let s = loaded(&d, "cornell-box-glossy");
    let looked = looked(&s, 3000);
    let plain = built(&s, "auto", &looked, true);
    let [_, expected] = reflected(&plain, &looked, 1);
    // Radiance on all surfaces: the irradiance is that of the same records.
    let zhao = built(&s, "zhao-incoming", &looked, false);
    assert!(stats(zhao.0).radiance_records > 100);
    let [_, irradiance] = reflected(&zhao, &looked, 1);
    let known = irradiance.iter().filter(|e| e[0] > 0.0).count();
    assert!(known * 100 > 99 * irradiance.len(), "{known} of {}", irradiance.len());
    assert!(
        (mean(&irradiance) / mean(&expected) - 1.0).abs() < 0.03,
        "{} {}",
        mean(&irradiance),
        mean(&expected)
    );
    // Refinement makes more records.
    let refined = built(&s, "krivanek06", &looked, false);
    let mut c = null_mut();
    ok(unsafe { lumi_cache_new(s.0, text("krivanek06").as_ptr(), &raw mut c) });
    let plain = CacheHandle(c);
    set(c, "gather.rays", 1024);
    set(c, "levels", 2);
    ok(unsafe { lumi_cache_set_str(c, text("refinement").as_ptr(), text("none").as_ptr()) });
    ok(build(c, &looked.points));
    assert!(stats(refined.0).records > stats(plain.0).records);
}

#[test]
fn pictures_leave_their_records_for_questions() {
    let d = device("threads=2");
    let s = loaded(&d, "cornell-box-glossy");
    let c = cache(&s);
    let desc = picture("cornell-box-glossy", [96, 96], 16);
    ok(unsafe { lumi_cache_render(c.0, &raw const desc, null(), 0) });
    let after = stats(c.0);
    assert!(after.radiance_records > 0, "{} irradiance records alone", after.records);
    ok(unsafe { lumi_cache_render(c.0, &raw const desc, null(), 0) });
    assert_eq!(
        stats(c.0).radiance_records,
        after.radiance_records,
        "the same picture needs no more"
    );
}
