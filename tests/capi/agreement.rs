//! The library answers as the Rust API does: queries, scenes, pictures, records.

use super::*;

#[test]
fn answers_equal_those_of_the_rust_api() {
    let (file, seed) = (own("indirect-room"), 7);
    let mut data = lumicache::import::gltf(Path::new(&file), &Default::default()).unwrap();
    data.cameras.clear();
    let scene = Scene::new(data, Backend::default()).unwrap().0;
    let mut scheme = Preset::by_name("auto").unwrap().scheme();
    scheme.gather.rays = 64;
    let d = device("threads=3");
    let s = loaded(&d, "indirect-room");
    let points = seen(&s, 3000);
    let at = |i: usize| Vec3::from(points.0[i]);
    let footprint = VIEWED * extent(points.0.len(), at).unwrap();
    let surface = |(p, n): (&[f32; 3], &[f32; 3])| {
        let n = Vec3::from(*n).normalize();
        SurfacePoint { footprint, ..SurfacePoint::plain(Vec3::from(*p), n) }
    };
    let surfaces: Vec<SurfacePoint> = points.0.iter().zip(&points.1).map(surface).collect();
    let expected = filled(&scene, scheme, &surfaces, 500, seed);

    for threads in [1, 3] {
        let d = device(&format!("threads={threads}"));
        let s = loaded(&d, "indirect-room");
        let c = cache(&s);
        set(c.0, "seed", seed as i32);
        ok(build(c.0, &points));
        let answers = ask(c.0, &points, 0);
        let wanted: Vec<_> = surfaces.iter().map(|p| expected.lookup(0, p, u32::MAX)).collect();
        assert!(wanted.iter().filter(|a| a.is_some()).count() > 2500);
        let e: Vec<[f32; 3]> =
            wanted.iter().map(|a| a.map_or([0.0; 3], |a| a.irradiance.to_array())).collect();
        assert!(bits(&answers.irradiance) == bits(&e), "{threads} threads");
        let error: Vec<u32> = wanted.iter().map(|a| a.map_or(0.0, |a| a.error).to_bits()).collect();
        assert!(answers.error.iter().map(|x| x.to_bits()).eq(error));
        let status: Vec<u8> = wanted
            .iter()
            .map(|a| if a.is_some() { LUMI_POINT_INTERPOLATED } else { LUMI_POINT_MISSING })
            .collect();
        assert_eq!(answers.status, status);
        assert_eq!(stats(c.0).records, expected.record_count() as u64);
    }
}

#[test]
fn a_fill_from_many_threads_covers_what_was_asked_and_readers_go_on() {
    let d = device("threads=2");
    let s = loaded(&d, "indirect-room");
    let c = cache(&s);
    set(c.0, "levels", 1);
    let points = seen(&s, 2000);
    let half = points.0.len() / 2;
    let parts = [0..half, half..points.0.len()]
        .map(|r| (points.0[r.clone()].to_vec(), points.1[r].to_vec()));
    let handle = c.0.addr();
    std::thread::scope(|scope| {
        for part in &parts {
            scope.spawn(move || {
                let a = ask(std::ptr::without_provenance_mut(handle), part, LUMI_QUERY_FILL);
                let missing = a.status.iter().filter(|s| **s == LUMI_POINT_MISSING).count();
                assert!(
                    missing * 100 < part.0.len(),
                    "{missing} points are missing after the fill"
                );
                assert!(
                    a.status.contains(&LUMI_POINT_COMPUTED)
                        && a.irradiance.iter().flatten().all(|x| x.is_finite() && *x >= 0.0)
                );
            });
        }
        let points = &points;
        scope.spawn(move || {
            for _ in 0..50 {
                ask(std::ptr::without_provenance_mut(handle), points, 0);
            }
        });
    });
    let before = stats(c.0);
    assert!(before.records > 50 && before.rays >= 64 * before.records && before.frozen == 0);
    ok(unsafe { lumi_cache_freeze(c.0) });
    assert_eq!(stats(c.0).records, before.records);
    let far = (vec![[100.0, 0.0, 0.0]], vec![[1.0, 0.0, 0.0]]);
    let query = lumi_query { flags: LUMI_QUERY_FILL, ..query_of(&far) };
    fails(
        unsafe { lumi_cache_query(c.0, &raw const query) },
        LUMI_ERROR_INVALID_ARGUMENT,
        "frozen",
    );
    ok(unsafe { lumi_cache_clear(c.0) });
    assert_eq!((stats(c.0).records, stats(c.0).frozen), (0, 0));
}

#[test]
fn a_described_scene_is_that_of_the_file() {
    // The same box once by arrays with strides and materials per triangle, once mesh by mesh and
    // shared.
    let d = device("");
    let corners: Vec<[f32; 5]> = (0..8)
        .map(|i| [(i & 1) as f32, (i >> 1 & 1) as f32, (i >> 2 & 1) as f32, 9.0, 9.0])
        .collect();
    let sides: [[u32; 6]; 6] = [
        [0, 4, 6, 0, 6, 2],
        [1, 3, 7, 1, 7, 5],
        [0, 1, 5, 0, 5, 4],
        [2, 6, 7, 2, 7, 3],
        [0, 2, 3, 0, 3, 1],
        [4, 5, 7, 4, 7, 6],
    ];
    let view = |data: *const c_void, count, stride, format, flags| lumi_view {
        data,
        count,
        stride,
        format,
        flags,
    };
    let positions = view(corners.as_ptr().cast(), 8, 20, LUMI_FORMAT_F32X3, 0);
    let materials = |scene: &SceneHandle| {
        for (albedo, emission) in [(0.5, 0.0), (0.0, 5.0)] {
            let mut m: lumi_material_desc = sized();
            ok(unsafe { lumi_material_init(&raw mut m) });
            (m.base_color, m.emission, m.specular, m.flags) =
                ([albedo; 3], [emission; 3], 0.0, LUMI_MATERIAL_DOUBLE_SIDED);
            ok(unsafe { lumi_scene_add_material(scene.0, &raw const m, null_mut()) });
        }
    };
    let whole = empty_scene(&d);
    materials(&whole);
    let flat: Vec<u32> = sides.iter().flatten().copied().collect();
    let of: Vec<u32> = (0..12).map(|t| u32::from(t / 2 == 3)).collect();
    let mesh = lumi_mesh_desc {
        positions,
        indices: view(flat.as_ptr().cast(), 12, 0, LUMI_FORMAT_U32X3, 0),
        triangle_materials: view(of.as_ptr().cast(), 12, 0, LUMI_FORMAT_U32, 0),
        ..sized()
    };
    let mut id = 99;
    ok(unsafe { lumi_scene_add_mesh(whole.0, &raw const mesh, &raw mut id) });
    assert_eq!(id, 0);
    ok(unsafe { lumi_scene_add_instance(whole.0, 0, null()) });
    ok(unsafe { lumi_scene_commit(whole.0) });

    let parts = empty_scene(&d);
    materials(&parts);
    let dense: Vec<[f32; 3]> = corners.iter().map(|c| [c[0], c[1], c[2]]).collect();
    let positions = view(dense.as_ptr().cast(), 8, 12, LUMI_FORMAT_F32X3, LUMI_VIEW_SHARED);
    for (k, side) in sides.iter().enumerate() {
        let indices = view(side.as_ptr().cast(), 2, 0, LUMI_FORMAT_U32X3, LUMI_VIEW_SHARED);
        let mesh = lumi_mesh_desc { positions, indices, material: u32::from(k == 3), ..sized() };
        ok(unsafe { lumi_scene_add_mesh(parts.0, &raw const mesh, &raw mut id) });
        // Moved there and back by the placement of a mesh that stands elsewhere: the identity,
        // spelled out.
        let unit = [1.0_f32, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0];
        ok(unsafe { lumi_scene_add_instance(parts.0, id, unit.as_ptr()) });
    }
    ok(unsafe { lumi_scene_commit(parts.0) });

    let mut counts = Vec::new();
    for scene in [&whole, &parts] {
        let mut info: lumi_scene_info = sized();
        ok(unsafe { lumi_scene_get_info(scene.0, &raw mut info) });
        assert_eq!((info.triangles, info.bounds_min, info.bounds_max), (12, [0.0; 3], [1.0; 3]));
        let points = seen(scene, 500);
        assert_eq!(points.0.len(), 500, "the box is closed");
        let c = cache(scene);
        ok(build(c.0, &points));
        let a = ask(c.0, &points, 0);
        counts.push(a.irradiance.iter().map(|e| e[0]).sum::<f32>() / 500.0);
    }
    // Direct irradiance over the box is about 5 pi/6 off the lamp; what bounces is of that order.
    assert!(
        (counts[0] / counts[1] - 1.0).abs() < 0.05 && counts[0] > 0.5 && counts[0] < 5.0,
        "{counts:?}"
    );
}

/// A picture of one of our scenes as its camera sees it.
pub fn picture(name: &str, [width, height]: [u32; 2], samples: u32) -> lumi_render_desc {
    let data = lumicache::import::gltf(Path::new(&own(name)), &Default::default()).unwrap();
    let camera = &data.cameras[0];
    let lumicache::camera::Projection::Perspective { yfov } = camera.projection else {
        panic!("an orthographic camera")
    };
    lumi_render_desc {
        width,
        height,
        samples,
        camera: camera.to_world.to_cols_array(),
        yfov,
        ..sized()
    }
}

#[test]
fn pictures_and_glossy_light() {
    let d = device("");
    let s = loaded(&d, "glossy-still-life");
    let c = cache(&s);
    let (w, h) = (48_usize, 32_usize);
    let mut beauty = vec![-1.0_f32; 4 * w * h];
    let mut parts = vec![vec![-1.0_f32; 3 * w * h]; 5];
    let names =
        ["diffuse_direct", "diffuse_indirect", "glossy_direct", "glossy_indirect", "emission"]
            .map(text);
    let mut layers = vec![lumi_layer {
        name: c"".as_ptr(),
        data: beauty.as_mut_ptr(),
        channels: 4,
        reserved: 0,
    }];
    for (name, data) in names.iter().zip(&mut parts) {
        layers.push(lumi_layer {
            name: name.as_ptr(),
            data: data.as_mut_ptr(),
            channels: 3,
            reserved: 0,
        });
    }
    let desc = picture("glossy-still-life", [w as u32, h as u32], 2);
    ok(unsafe { lumi_cache_render(c.0, &raw const desc, layers.as_ptr(), layers.len()) });
    for p in 0..w * h {
        for k in 0..3 {
            let sum: f32 = parts.iter().map(|l| l[3 * p + k]).sum();
            assert!(
                (beauty[4 * p + k] - sum).abs() <= 1e-4 * sum.max(1.0),
                "pixel {p}: {} is not {sum}",
                beauty[4 * p + k]
            );
        }
    }
    let mean = |v: &[f32]| v.iter().sum::<f32>() / v.len() as f32;
    assert!(mean(&beauty) > 0.05 && mean(&parts[1]) > 0.0 && stats(c.0).records > 20);

    let points = seen(&s, 200);
    let mut radiance = vec![[-1.0_f32; 3]; points.0.len()];
    let query = lumi_query {
        radiance: radiance.as_mut_ptr().cast(),
        wo: points.1.as_ptr().cast(),
        glossy_samples: 8,
        ..query_of(&points)
    };
    ok(unsafe { lumi_cache_query(c.0, &raw const query) });
    assert!(
        radiance.iter().flatten().all(|x| x.is_finite() && *x >= 0.0)
            && radiance.iter().any(|r| r[0] > 0.0)
    );
    let query = lumi_query { wo: null(), ..query };
    fails(unsafe { lumi_cache_query(c.0, &raw const query) }, LUMI_ERROR_INVALID_ARGUMENT, "wo");
}

#[test]
fn records_can_be_listed() {
    let d = device("");
    let s = loaded(&d, "cornell-box");
    let c = cache(&s);
    ok(build(c.0, &seen(&s, 500)));
    let mut n = 0;
    ok(unsafe { lumi_cache_get_records(c.0, 0, 0, null_mut(), &raw mut n) });
    assert_eq!(n as u64, stats(c.0).records);
    let mut all: Vec<lumi_record> = Vec::with_capacity(n);
    let mut first = 0;
    while first < n {
        let mut got = 0;
        ok(unsafe {
            lumi_cache_get_records(c.0, first, 7, all.as_mut_ptr().add(first), &raw mut got)
        });
        assert!((1..=7).contains(&got));
        first += got;
    }
    unsafe { all.set_len(n) };
    assert!(
        all.iter().all(|r| r.radius > 0.0 && r.irradiance.iter().all(|e| *e >= 0.0))
            && all.is_sorted_by_key(|r| r.level)
    );
    assert!(
        all[n - 1].level == 1
            && stats(c.0).max_radius >= stats(c.0).mean_radius
            && stats(c.0).mean_radius > 0.0
    );
}

#[test]
fn a_build_can_be_cancelled() {
    let d = device("");
    let s = loaded(&d, "indirect-room");
    let c = cache(&s);
    set(c.0, "gather.rays", 100_000);
    let calls = AtomicU32::new(0);
    ok(unsafe { lumi_cache_set_progress(c.0, Some(watch), (&raw const calls).cast_mut().cast()) });
    fails(build(c.0, &seen(&s, 2000)), LUMI_ERROR_CANCELLED, "cancelled");
    assert!(calls.load(Ordering::Relaxed) >= 2);
    assert_eq!(stats(c.0).records, 0);
    ok(unsafe { lumi_cache_set_progress(c.0, None, null_mut()) });
}

#[test]
fn the_log_hears_warnings_and_failures() {
    let heard: std::sync::Mutex<Vec<(i32, i32, String)>> = Default::default();
    let d = device("");
    ok(unsafe { lumi_device_set_log(d.0, Some(listen), (&raw const heard).cast_mut().cast()) });
    let s = empty_scene(&d);
    // A scene without any light.
    ok(unsafe { lumi_scene_commit(s.0) });
    fails(unsafe { lumi_scene_commit(s.0) }, LUMI_ERROR_INVALID_OPERATION, "already");
    let heard = heard.lock().unwrap();
    assert!(heard[0].0 == LUMI_LOG_WARNING && heard[0].2.contains("dome"), "{heard:?}");
    assert!(
        (heard[1].0, heard[1].1) == (LUMI_LOG_ERROR, LUMI_ERROR_INVALID_OPERATION)
            && heard.len() == 2,
        "{heard:?}"
    );
}

#[test]
fn pictures_are_denoised_where_there_is_a_denoiser() {
    let size = [40_u32, 30];
    let mut rooms = [vec![0.0_f32; 3600], vec![0.0_f32; 3600]];
    let names = ["diffuse_indirect", "noisy.diffuse_indirect"].map(text);
    let layers: Vec<lumi_layer> = names
        .iter()
        .zip(&mut rooms)
        .map(|(name, room)| lumi_layer {
            name: name.as_ptr(),
            data: room.as_mut_ptr(),
            channels: 3,
            reserved: 0,
        })
        .collect();
    let render = |c: &CacheHandle, flags: u32| {
        let flags = LUMI_RENDER_PATH | flags;
        let desc = lumi_render_desc { flags, ..picture("cornell-box", size, 2) };
        unsafe { lumi_cache_render(c.0, &raw const desc, layers.as_ptr(), layers.len()) }
    };

    let heard: std::sync::Mutex<Vec<(i32, i32, String)>> = Default::default();
    let d = device("denoiser=/nowhere");
    ok(unsafe { lumi_device_set_log(d.0, Some(listen), (&raw const heard).cast_mut().cast()) });
    let s = loaded(&d, "cornell-box");
    let c = cache(&s);
    fails(render(&c, LUMI_RENDER_DENOISE), LUMI_ERROR_UNKNOWN, "/nowhere");
    heard.lock().unwrap().clear();
    ok(render(&c, LUMI_RENDER_DENOISE_AUTO));
    {
        let heard = heard.lock().unwrap();
        let clear = heard[0].0 == LUMI_LOG_WARNING && heard[0].2.contains("make denoiser");
        assert!(clear && heard.len() == 1, "{heard:?}");
    }
    assert!(rooms[0] == rooms[1] && rooms[0].iter().sum::<f32>() > 0.0);

    let places = lumicache::render::denoiser_places(|name| std::env::var_os(name));
    if let Err(error) = lumicache::render::find_denoiser(&places) {
        return crate::support::testdata::skipped(&error.to_string());
    }
    // An empty path is none.
    let d = device("denoiser=");
    let s = loaded(&d, "cornell-box");
    let c = cache(&s);
    ok(render(&c, LUMI_RENDER_DENOISE));
    let changed = rooms[0].iter().zip(&rooms[1]).filter(|(a, b)| a != b).count();
    assert!(changed > 1000, "{changed} of 3600 numbers changed");
}
