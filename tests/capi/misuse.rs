//! Every function with arguments that are wrong in every way that can be found out.

use super::*;

/// A call with a handle in the place of one kind of object.
type Call<'a> = (&'static str, Box<dyn Fn(*mut c_void) -> Option<i32> + 'a>);

/// What the calls need beside their handle, sound in itself.
pub struct Sound {
    pub mesh: lumi_mesh_desc,
    pub material: lumi_material_desc,
    pub texture: lumi_texture_desc,
    pub light: lumi_light_desc,
    pub host: lumi_host_desc,
    pub query: lumi_query,
    pub trace: lumi_trace_desc,
    pub render: lumi_render_desc,
}

pub static TRIANGLE: [[f32; 3]; 3] = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]];
pub static INDICES: [u32; 3] = [0, 1, 2];
static PIXEL: [u8; 4] = [255; 4];

pub fn sound() -> Sound {
    let mut material: lumi_material_desc = sized();
    ok(unsafe { lumi_material_init(&raw mut material) });
    let view =
        |data: *const c_void, count, format| lumi_view { data, count, stride: 0, format, flags: 0 };
    let floats = TRIANGLE.as_ptr().cast::<f32>();
    Sound {
        mesh: lumi_mesh_desc {
            positions: view(floats.cast(), 3, LUMI_FORMAT_F32X3),
            indices: view(INDICES.as_ptr().cast(), 1, LUMI_FORMAT_U32X3),
            ..sized()
        },
        material,
        texture: lumi_texture_desc { width: 1, height: 1, pixels: PIXEL.as_ptr(), ..sized() },
        light: lumi_light_desc { intensity: [1.0; 3], direction: [0.0, -1.0, 0.0], ..sized() },
        host: lumi_host_desc { bounds_max: [1.0; 3], trace: Some(shell), ..sized() },
        query: lumi_query {
            n: 3,
            position: floats,
            normal: unsafe { floats.add(3) },
            normal_stride: 0,
            ..sized()
        },
        trace: lumi_trace_desc { n: 3, origin: floats, dir: floats, ..sized() },
        render: lumi_render_desc { width: 4, height: 4, yfov: 1.0, camera: UNIT, ..sized() },
    }
}

pub const UNIT: [f32; 12] = [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0];

fn device_calls<'a>() -> Vec<Call<'a>> {
    vec![
        ("lumi_device_retain", Box::new(|h| none(|| unsafe { lumi_device_retain(h.cast()) }))),
        ("lumi_device_release", Box::new(|h| none(|| unsafe { lumi_device_release(h.cast()) }))),
        (
            "lumi_device_set_log",
            Box::new(|h| Some(unsafe { lumi_device_set_log(h.cast(), None, null_mut()) })),
        ),
        (
            "lumi_device_get_backend",
            Box::new(|h| {
                Some(unsafe { lumi_device_get_backend(h.cast(), [0; 64].as_mut_ptr(), 64) })
            }),
        ),
        (
            "lumi_scene_new",
            Box::new(|h| Some(unsafe { lumi_scene_new(h.cast(), &mut null_mut()) })),
        ),
    ]
}

/// A call of a function without a result.
fn none(call: impl FnOnce()) -> Option<i32> {
    call();
    None
}

fn scene_calls(x: &Sound) -> Vec<Call<'_>> {
    vec![
        ("lumi_scene_retain", Box::new(|h| none(|| unsafe { lumi_scene_retain(h.cast()) }))),
        ("lumi_scene_release", Box::new(|h| none(|| unsafe { lumi_scene_release(h.cast()) }))),
        (
            "lumi_scene_load_gltf",
            Box::new(|h| Some(unsafe { lumi_scene_load_gltf(h.cast(), c"a.gltf".as_ptr()) })),
        ),
        (
            "lumi_scene_load_gltf_with",
            Box::new(|h| {
                let (file, desc) = (c"a.gltf".as_ptr(), sized::<lumi_load_desc>());
                Some(unsafe { lumi_scene_load_gltf_with(h.cast(), file, &raw const desc) })
            }),
        ),
        (
            "lumi_scene_add_mesh",
            Box::new(|h| {
                Some(unsafe { lumi_scene_add_mesh(h.cast(), &raw const x.mesh, null_mut()) })
            }),
        ),
        (
            "lumi_scene_add_instance",
            Box::new(|h| Some(unsafe { lumi_scene_add_instance(h.cast(), 0, UNIT.as_ptr()) })),
        ),
        (
            "lumi_scene_add_material",
            Box::new(|h| {
                Some(unsafe {
                    lumi_scene_add_material(h.cast(), &raw const x.material, null_mut())
                })
            }),
        ),
        (
            "lumi_scene_add_texture",
            Box::new(|h| {
                Some(unsafe { lumi_scene_add_texture(h.cast(), &raw const x.texture, null_mut()) })
            }),
        ),
        (
            "lumi_scene_add_light",
            Box::new(|h| Some(unsafe { lumi_scene_add_light(h.cast(), &raw const x.light) })),
        ),
        (
            "lumi_scene_set_environment",
            Box::new(|h| {
                Some(unsafe { lumi_scene_set_environment(h.cast(), UNIT.as_ptr(), 1, 1, null()) })
            }),
        ),
        (
            "lumi_scene_set_host",
            Box::new(|h| Some(unsafe { lumi_scene_set_host(h.cast(), &raw const x.host) })),
        ),
        ("lumi_scene_commit", Box::new(|h| Some(unsafe { lumi_scene_commit(h.cast()) }))),
        (
            "lumi_scene_get_info",
            Box::new(|h| {
                Some(unsafe { lumi_scene_get_info(h.cast(), &mut sized::<lumi_scene_info>()) })
            }),
        ),
        (
            "lumi_scene_trace",
            Box::new(|h| Some(unsafe { lumi_scene_trace(h.cast(), &raw const x.trace) })),
        ),
        (
            "lumi_cache_new",
            Box::new(|h| Some(unsafe { lumi_cache_new(h.cast(), null(), &mut null_mut()) })),
        ),
    ]
}

fn cache_calls(x: &Sound) -> Vec<Call<'_>> {
    vec![
        ("lumi_cache_retain", Box::new(|h| none(|| unsafe { lumi_cache_retain(h.cast()) }))),
        ("lumi_cache_release", Box::new(|h| none(|| unsafe { lumi_cache_release(h.cast()) }))),
        (
            "lumi_cache_set_f32",
            Box::new(|h| {
                Some(unsafe { lumi_cache_set_f32(h.cast(), c"validity.error".as_ptr(), 0.3) })
            }),
        ),
        (
            "lumi_cache_set_i32",
            Box::new(|h| {
                Some(unsafe { lumi_cache_set_i32(h.cast(), c"gather.rays".as_ptr(), 64) })
            }),
        ),
        (
            "lumi_cache_set_str",
            Box::new(|h| {
                Some(unsafe { lumi_cache_set_str(h.cast(), c"preset".as_ptr(), c"auto".as_ptr()) })
            }),
        ),
        (
            "lumi_cache_set_progress",
            Box::new(|h| Some(unsafe { lumi_cache_set_progress(h.cast(), None, null_mut()) })),
        ),
        (
            "lumi_cache_build",
            Box::new(|h| Some(unsafe { lumi_cache_build(h.cast(), &raw const x.query) })),
        ),
        (
            "lumi_cache_query",
            Box::new(|h| Some(unsafe { lumi_cache_query(h.cast(), &raw const x.query) })),
        ),
        ("lumi_cache_freeze", Box::new(|h| Some(unsafe { lumi_cache_freeze(h.cast()) }))),
        (
            "lumi_cache_save",
            Box::new(|h| Some(unsafe { lumi_cache_save(h.cast(), c"/a".as_ptr()) })),
        ),
        (
            "lumi_cache_load",
            Box::new(|h| Some(unsafe { lumi_cache_load(h.cast(), c"/a".as_ptr(), 0) })),
        ),
        (
            "lumi_cache_merge",
            Box::new(|h| Some(unsafe { lumi_cache_merge(h.cast(), h.cast(), 0) })),
        ),
        ("lumi_cache_clear", Box::new(|h| Some(unsafe { lumi_cache_clear(h.cast()) }))),
        (
            "lumi_cache_get_stats",
            Box::new(|h| {
                Some(unsafe { lumi_cache_get_stats(h.cast(), &mut sized::<lumi_stats>()) })
            }),
        ),
        (
            "lumi_cache_get_records",
            Box::new(|h| {
                Some(unsafe { lumi_cache_get_records(h.cast(), 0, 0, null_mut(), &mut 0) })
            }),
        ),
        (
            "lumi_cache_render",
            Box::new(|h| {
                Some(unsafe { lumi_cache_render(h.cast(), &raw const x.render, null(), 0) })
            }),
        ),
    ]
}

/// The functions that take no handle first.
const WITHOUT_HANDLE: &[&str] = &[
    "lumi_get_abi_version",
    "lumi_get_version_string",
    "lumi_get_last_error",
    "lumi_device_new",
    "lumi_material_init",
];

#[test]
fn handles_that_are_none_released_or_of_another_kind() {
    let x = sound();
    let d = device("threads=1");
    let s = loaded(&d, "cornell-box");
    let c = cache(&s);
    let mut gone = Vec::new();
    {
        let d = device("threads=1");
        let s = loaded(&d, "cornell-box");
        let c = cache(&s);
        gone.extend([d.0.cast::<c_void>(), s.0.cast(), c.0.cast()]);
    }
    let wild = [1_usize, 0x10, 0x4c55, usize::MAX, 0xdead_beef_0000_4c55]
        .map(std::ptr::without_provenance_mut::<c_void>);
    let live = [d.0.cast::<c_void>(), s.0.cast(), c.0.cast()];
    let groups =
        [("device", device_calls()), ("scene", scene_calls(&x)), ("cache", cache_calls(&x))];
    let mut names: Vec<&str> = WITHOUT_HANDLE.to_vec();
    for (kind, (what, calls)) in groups.iter().enumerate() {
        for (name, call) in calls {
            names.push(name);
            let null: &[*mut c_void] = &[null_mut()];
            let others: Vec<_> = live
                .iter()
                .copied()
                .enumerate()
                .filter(|(k, _)| *k != kind)
                .map(|(_, h)| h)
                .collect();
            for (handles, word) in [
                (null, "NULL"),
                (&wild[..], "no handle"),
                (&gone[..], "released"),
                (&others[..], "was expected"),
            ] {
                for &handle in handles {
                    let code = call(handle);
                    let (told, message) = last();
                    if name.ends_with("_release") && handle.is_null() {
                        assert_eq!((code, told), (None, LUMI_OK), "{name}(NULL): {message}");
                        continue;
                    }
                    assert_eq!(
                        (code.unwrap_or(told), told),
                        (LUMI_ERROR_INVALID_ARGUMENT, LUMI_ERROR_INVALID_ARGUMENT),
                        "{name}: {message}"
                    );
                    assert!(
                        message.starts_with(&format!("{name}: "))
                            && message.contains(what)
                            && message.contains(word),
                        "{message}"
                    );
                }
            }
        }
    }
    // Nothing was lost: what was alive still is.
    ok(unsafe { lumi_device_get_backend(d.0, [0; 64].as_mut_ptr(), 64) });
    assert_eq!(stats(c.0).records, 0);
    // No function was forgotten.
    let header = std::fs::read_to_string(
        Path::new(env!("CARGO_MANIFEST_DIR")).join("ffi/include/lumicache.h"),
    )
    .unwrap();
    let missing: Vec<_> = crate::capi::header::declared(&header)
        .into_iter()
        .filter(|n| !names.contains(&n.as_str()))
        .collect();
    assert!(missing.is_empty(), "{missing:?}");
}

#[test]
fn references_are_counted() {
    let d = device("threads=1");
    unsafe {
        lumi_device_retain(d.0);
        lumi_device_release(d.0);
    }
    ok(unsafe { lumi_device_get_backend(d.0, [0; 64].as_mut_ptr(), 64) });
    let s = empty_scene(&d);
    let handle = d.0;
    drop(d);
    fails(
        unsafe { lumi_device_get_backend(handle, [0; 64].as_mut_ptr(), 64) },
        LUMI_ERROR_INVALID_ARGUMENT,
        "released",
    );
    // The scene keeps what it needs of its device.
    ok(unsafe { lumi_scene_commit(s.0) });
    let c = cache(&s);
    drop(s);
    assert_eq!(stats(c.0).records, 0);
}

#[test]
fn things_done_in_the_wrong_order() {
    let d = device("threads=1");
    let (x, draft) = (sound(), empty_scene(&d));
    let mut c = null_mut();
    let operation = LUMI_ERROR_INVALID_OPERATION;
    fails(unsafe { lumi_cache_new(draft.0, null(), &raw mut c) }, operation, "not committed");
    fails(
        unsafe { lumi_scene_get_info(draft.0, &mut sized::<lumi_scene_info>()) },
        operation,
        "not committed",
    );
    fails(unsafe { lumi_scene_trace(draft.0, &raw const x.trace) }, operation, "not committed");
    let s = loaded(&d, "cornell-box");
    fails(unsafe { lumi_scene_add_light(s.0, &raw const x.light) }, operation, "committed");
    fails(
        unsafe { lumi_scene_load_gltf(s.0, text(&own("cornell-box")).as_ptr()) },
        operation,
        "committed",
    );
    fails(unsafe { lumi_scene_set_host(s.0, &raw const x.host) }, operation, "committed");
    ok(unsafe { lumi_scene_add_material(draft.0, &raw const x.material, null_mut()) });
    fails(unsafe { lumi_scene_set_host(draft.0, &raw const x.host) }, operation, "not the host's");
    fails(
        unsafe { lumi_scene_load_gltf(draft.0, text(&own("cornell-box")).as_ptr()) },
        operation,
        "not empty",
    );
    let file = empty_scene(&d);
    fails(
        unsafe { lumi_scene_load_gltf(file.0, c"/nothing.gltf".as_ptr()) },
        LUMI_ERROR_IO,
        "nothing.gltf",
    );
    let junk = tempfile::NamedTempFile::new().unwrap();
    std::fs::write(junk.path(), "{").unwrap();
    fails(
        unsafe { lumi_scene_load_gltf(file.0, text(junk.path().to_str().unwrap()).as_ptr()) },
        LUMI_ERROR_CORRUPT_FILE,
        "",
    );
    let (host, points) = (honest(), on_shell(10));
    let kept = host_scene(&d, &host, 0, 0);
    fails(unsafe { lumi_scene_trace(kept.0, &raw const x.trace) }, operation, "host");
    let hosted = cache(&kept);
    fails(
        unsafe { lumi_cache_render(hosted.0, &raw const x.render, null(), 0) },
        operation,
        "host",
    );
    let mut out = [0.0_f32; 30];
    let query = lumi_query {
        radiance: out.as_mut_ptr(),
        wo: points.1.as_ptr().cast(),
        ..query_of(&points)
    };
    fails(
        unsafe { lumi_cache_query(hosted.0, &raw const query) },
        LUMI_ERROR_UNSUPPORTED,
        "glossy",
    );

    let c = cache(&s);
    fails(
        unsafe { lumi_cache_new(s.0, c"none".as_ptr(), &mut null_mut()) },
        LUMI_ERROR_INVALID_ARGUMENT,
        "preset",
    );
    fails(
        unsafe { lumi_cache_set_f32(c.0, c"colour".as_ptr(), 1.0) },
        LUMI_ERROR_UNSUPPORTED,
        "colour",
    );
    for value in [f32::NAN, f32::INFINITY, -1.0] {
        fails(
            unsafe { lumi_cache_set_f32(c.0, c"validity.error".as_ptr(), value) },
            LUMI_ERROR_INVALID_ARGUMENT,
            "error",
        );
        fails(
            unsafe { lumi_cache_set_f32(c.0, c"quality".as_ptr(), value) },
            LUMI_ERROR_INVALID_ARGUMENT,
            "quality",
        );
    }
    fails(
        unsafe { lumi_cache_set_i32(c.0, c"seed".as_ptr(), -1) },
        LUMI_ERROR_INVALID_ARGUMENT,
        "seed",
    );
    fails(
        unsafe { lumi_cache_set_i32(c.0, c"max_bounces".as_ptr(), -2) },
        LUMI_ERROR_INVALID_ARGUMENT,
        "max_bounces",
    );
    fails(
        unsafe { lumi_cache_set_str(c.0, c"preset".as_ptr(), c"none".as_ptr()) },
        LUMI_ERROR_INVALID_ARGUMENT,
        "preset",
    );
    ok(unsafe { lumi_cache_set_str(c.0, c"radius.metric".as_ptr(), c"minimum".as_ptr()) });
    // Light without bounces: nothing to find, and nothing missing.
    set(c.0, "max_bounces", 0);
    let points = seen(&s, 20);
    ok(build(c.0, &points));
    let a = ask(c.0, &points, LUMI_QUERY_FILL);
    assert!(
        a.status.iter().all(|s| *s == LUMI_POINT_INTERPOLATED)
            && a.irradiance.iter().all(|e| *e == [0.0; 3])
    );
}
