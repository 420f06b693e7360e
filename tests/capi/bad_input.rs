//! Structs of other versions and sizes, counts and numbers that cannot be.

use super::misuse::{TRIANGLE, UNIT, sound};
use super::*;

static NAN: [f32; 9] = [f32::NAN; 9];

fn sized_none() -> lumi_view {
    lumi_view { data: null(), count: 0, stride: 0, format: 0, flags: 0 }
}

#[test]
fn versions_and_sizes_of_structs() {
    let mut d = null_mut();
    for version in [0, 1, LUMI_ABI_VERSION + 1, LUMI_ABI_VERSION + (1 << 16), u32::MAX] {
        fails(unsafe { lumi_device_new(version, null(), &raw mut d) }, LUMI_ERROR_VERSION, "ABI");
        assert!(d.is_null());
    }
    for config in
        ["threads=many", "threads=-1", "threads=99999", "backend=none", "colour=red", "\u{1}"]
    {
        fails(
            unsafe { lumi_device_new(LUMI_ABI_VERSION, text(config).as_ptr(), &raw mut d) },
            LUMI_ERROR_INVALID_ARGUMENT,
            "",
        );
    }
    fails(
        unsafe { lumi_device_new(LUMI_ABI_VERSION, c"\xff".as_ptr(), &raw mut d) },
        LUMI_ERROR_INVALID_ARGUMENT,
        "UTF-8",
    );
    fails(
        unsafe { lumi_device_new(LUMI_ABI_VERSION, null(), null_mut()) },
        LUMI_ERROR_INVALID_ARGUMENT,
        "place",
    );

    let (d, mut x) = (device("threads=1"), sound());
    let (scene, description) = (loaded(&d, "cornell-box"), empty_scene(&d));
    let handle = cache(&scene);
    let (mut info, mut numbers): (lumi_scene_info, lumi_stats) = (sized(), sized());
    // Each function with the address of its struct's size.
    type Sized<'a> = (*mut u32, Box<dyn Fn() -> i32 + 'a>);
    let (p, i, n) = (&raw mut x, &raw mut info, &raw mut numbers);
    let (draft, s, c) = (description.0, scene.0, handle.0);
    let calls: Vec<Sized> = vec![
        (
            unsafe { (&raw mut (*p).mesh).cast() },
            Box::new(move || unsafe {
                lumi_scene_add_mesh(draft, &raw const (*p).mesh, null_mut())
            }),
        ),
        (
            unsafe { (&raw mut (*p).material).cast() },
            Box::new(move || unsafe {
                lumi_scene_add_material(draft, &raw const (*p).material, null_mut())
            }),
        ),
        (
            unsafe { (&raw mut (*p).texture).cast() },
            Box::new(move || unsafe {
                lumi_scene_add_texture(draft, &raw const (*p).texture, null_mut())
            }),
        ),
        (
            unsafe { (&raw mut (*p).light).cast() },
            Box::new(move || unsafe { lumi_scene_add_light(draft, &raw const (*p).light) }),
        ),
        (
            unsafe { (&raw mut (*p).host).cast() },
            Box::new(move || unsafe { lumi_scene_set_host(draft, &raw const (*p).host) }),
        ),
        (
            unsafe { (&raw mut (*p).trace).cast() },
            Box::new(move || unsafe { lumi_scene_trace(s, &raw const (*p).trace) }),
        ),
        (
            unsafe { (&raw mut (*p).query).cast() },
            Box::new(move || unsafe { lumi_cache_query(c, &raw const (*p).query) }),
        ),
        (
            unsafe { (&raw mut (*p).query).cast() },
            Box::new(move || unsafe { lumi_cache_build(c, &raw const (*p).query) }),
        ),
        (
            unsafe { (&raw mut (*p).render).cast() },
            Box::new(move || unsafe { lumi_cache_render(c, &raw const (*p).render, null(), 0) }),
        ),
        (i.cast(), Box::new(move || unsafe { lumi_scene_get_info(s, i) })),
        (n.cast(), Box::new(move || unsafe { lumi_cache_get_stats(c, n) })),
    ];
    for (size, call) in calls {
        let right = unsafe { size.read() };
        for (wrong, code) in [
            (0, LUMI_ERROR_VERSION),
            (1, LUMI_ERROR_VERSION),
            (right - 1, LUMI_ERROR_VERSION),
            (u32::MAX, LUMI_ERROR_INVALID_ARGUMENT),
        ] {
            unsafe { size.write(wrong) };
            fails(call(), code, "struct_size");
        }
        unsafe { size.write(right) };
    }
    // NULL in the place of every struct.
    unsafe {
        fails(lumi_scene_add_mesh(draft, null(), null_mut()), LUMI_ERROR_INVALID_ARGUMENT, "NULL");
        fails(
            lumi_scene_add_material(draft, null(), null_mut()),
            LUMI_ERROR_INVALID_ARGUMENT,
            "NULL",
        );
        fails(
            lumi_scene_add_texture(draft, null(), null_mut()),
            LUMI_ERROR_INVALID_ARGUMENT,
            "NULL",
        );
        fails(lumi_scene_add_light(draft, null()), LUMI_ERROR_INVALID_ARGUMENT, "NULL");
        fails(lumi_scene_set_host(draft, null()), LUMI_ERROR_INVALID_ARGUMENT, "NULL");
        fails(lumi_material_init(null_mut()), LUMI_ERROR_INVALID_ARGUMENT, "NULL");
        fails(lumi_scene_trace(s, null()), LUMI_ERROR_INVALID_ARGUMENT, "NULL");
        fails(lumi_scene_get_info(s, null_mut()), LUMI_ERROR_INVALID_ARGUMENT, "NULL");
        fails(lumi_scene_load_gltf(draft, null()), LUMI_ERROR_INVALID_ARGUMENT, "NULL");
        fails(
            lumi_scene_load_gltf_with(draft, c"a.gltf".as_ptr(), null()),
            LUMI_ERROR_INVALID_ARGUMENT,
            "NULL",
        );
        fails(lumi_scene_new(d.0, null_mut()), LUMI_ERROR_INVALID_ARGUMENT, "place");
        fails(lumi_cache_new(s, null(), null_mut()), LUMI_ERROR_INVALID_ARGUMENT, "place");
        fails(lumi_cache_query(c, null()), LUMI_ERROR_INVALID_ARGUMENT, "NULL");
        fails(lumi_cache_build(c, null()), LUMI_ERROR_INVALID_ARGUMENT, "NULL");
        fails(lumi_cache_render(c, null(), null(), 0), LUMI_ERROR_INVALID_ARGUMENT, "NULL");
        fails(
            lumi_cache_render(c, &raw const x.render, null(), 1),
            LUMI_ERROR_INVALID_ARGUMENT,
            "layers",
        );
        fails(lumi_cache_get_stats(c, null_mut()), LUMI_ERROR_INVALID_ARGUMENT, "NULL");
        fails(
            lumi_cache_get_records(c, 0, 1, null_mut(), null_mut()),
            LUMI_ERROR_INVALID_ARGUMENT,
            "NULL",
        );
        fails(lumi_cache_save(c, null()), LUMI_ERROR_INVALID_ARGUMENT, "NULL");
        fails(lumi_cache_load(c, null(), 0), LUMI_ERROR_INVALID_ARGUMENT, "NULL");
        fails(lumi_cache_load(c, c"".as_ptr(), 0), LUMI_ERROR_INVALID_ARGUMENT, "empty");
        fails(lumi_cache_load(c, c"/a".as_ptr(), 2), LUMI_ERROR_INVALID_ARGUMENT, "flags");
        fails(lumi_cache_merge(c, null_mut(), 0), LUMI_ERROR_INVALID_ARGUMENT, "NULL");
        fails(lumi_cache_set_f32(c, null(), 1.0), LUMI_ERROR_INVALID_ARGUMENT, "NULL");
        fails(lumi_cache_set_i32(c, null(), 1), LUMI_ERROR_INVALID_ARGUMENT, "NULL");
        fails(
            lumi_cache_set_str(c, c"preset".as_ptr(), null()),
            LUMI_ERROR_INVALID_ARGUMENT,
            "NULL",
        );
        fails(lumi_device_get_backend(d.0, null_mut(), 9), LUMI_ERROR_INVALID_ARGUMENT, "room");
        fails(
            lumi_device_get_backend(d.0, [1; 1].as_mut_ptr(), 0),
            LUMI_ERROR_INVALID_ARGUMENT,
            "room",
        );
    }
    // A struct of a later version is taken if what it adds is not used.
    #[repr(C)]
    struct Longer<T>(T, u64);
    let mut longer = Longer(x.light, 0);
    longer.0.struct_size = size_of::<Longer<lumi_light_desc>>() as u32;
    ok(unsafe { lumi_scene_add_light(draft, (&raw const longer).cast()) });
    longer.1 = 1;
    fails(
        unsafe { lumi_scene_add_light(draft, (&raw const longer).cast()) },
        LUMI_ERROR_UNSUPPORTED,
        "does not know",
    );
}

#[test]
fn counts_and_numbers_that_cannot_be() {
    let d = device("threads=1");
    let (s, draft) = (loaded(&d, "cornell-box"), empty_scene(&d));
    let c = cache(&s);
    let x = sound();
    // Nothing at all is fine, whatever the addresses.
    for position in [null(), TRIANGLE.as_ptr().cast()] {
        let none = lumi_query { n: 0, position, normal: position, ..sized() };
        ok(unsafe { lumi_cache_query(c.0, &raw const none) });
        ok(unsafe { lumi_cache_build(c.0, &raw const none) });
    }
    ok(unsafe { lumi_scene_trace(s.0, &sized::<lumi_trace_desc>()) });
    for n in [usize::MAX, usize::MAX / 2, 1 << 40, 1 << 33] {
        let query = lumi_query { n, ..x.query };
        fails(
            unsafe { lumi_cache_query(c.0, &raw const query) },
            LUMI_ERROR_INVALID_ARGUMENT,
            "more than can be",
        );
        fails(
            unsafe { lumi_cache_build(c.0, &raw const query) },
            LUMI_ERROR_INVALID_ARGUMENT,
            "more than can be",
        );
        let trace = lumi_trace_desc { n, ..x.trace };
        fails(
            unsafe { lumi_scene_trace(s.0, &raw const trace) },
            LUMI_ERROR_INVALID_ARGUMENT,
            "more than can be",
        );
    }
    for (position_stride, word) in [
        (1, "apart"),
        (11, "apart"),
        (usize::MAX, "more than can be"),
        (usize::MAX / 2, "more than can be"),
    ] {
        let query = lumi_query { position_stride, ..x.query };
        fails(
            unsafe { lumi_cache_query(c.0, &raw const query) },
            LUMI_ERROR_INVALID_ARGUMENT,
            word,
        );
    }
    let query = lumi_query { position: null(), ..x.query };
    fails(
        unsafe { lumi_cache_query(c.0, &raw const query) },
        LUMI_ERROR_INVALID_ARGUMENT,
        "position is NULL",
    );
    let query = lumi_query { flags: 1 << 20, ..x.query };
    fails(unsafe { lumi_cache_query(c.0, &raw const query) }, LUMI_ERROR_INVALID_ARGUMENT, "flags");

    // Points that are none are told apart, the others answered.
    let points = seen(&s, 100);
    ok(build(c.0, &points));
    let mut spoiled = (points.0[..6].to_vec(), points.1[..6].to_vec());
    (spoiled.0[1][2], spoiled.0[2][0]) = (f32::NAN, f32::INFINITY);
    (spoiled.1[3], spoiled.1[4]) = ([0.0; 3], [f32::NAN, 0.0, 1.0]);
    for flags in [0, LUMI_QUERY_FILL] {
        let a = ask(c.0, &spoiled, flags);
        let rejected: Vec<bool> = a.status.iter().map(|s| *s == LUMI_POINT_REJECTED).collect();
        assert_eq!(rejected, [false, true, true, true, true, false]);
        assert!(
            a.irradiance.iter().flatten().all(|e| e.is_finite()) && a.irradiance[1] == [0.0; 3]
        );
    }
    let footprints = [f32::NAN, -1.0, 0.0, f32::INFINITY, 1e30, 1e-30];
    let query =
        lumi_query { footprint: footprints.as_ptr(), flags: LUMI_QUERY_FILL, ..query_of(&spoiled) };
    ok(unsafe { lumi_cache_query(c.0, &raw const query) });

    type Spoil<'a, T> = &'a [(&'static str, fn(&mut T))];
    fn each<T: Copy>(good: &T, spoil: Spoil<T>, call: impl Fn(&T) -> i32) {
        for (word, spoil) in spoil {
            let mut bad = *good;
            spoil(&mut bad);
            fails(call(&bad), LUMI_ERROR_INVALID_ARGUMENT, word);
        }
    }
    let mesh = |m: &lumi_mesh_desc| unsafe { lumi_scene_add_mesh(draft.0, m, null_mut()) };
    fails(mesh(&x.mesh), LUMI_ERROR_INVALID_ARGUMENT, "material 0");
    ok(unsafe { lumi_scene_add_material(draft.0, &raw const x.material, null_mut()) });
    let spoil: Spoil<lumi_mesh_desc> = &[
        ("positions", |m| m.positions = sized_none()),
        ("positions is NULL", |m| m.positions.data = null()),
        ("indices", |m| m.indices = sized_none()),
        ("format", |m| m.positions.format = LUMI_FORMAT_F32X2),
        ("beyond", |m| m.positions.count = 2),
        ("more than can be", |m| m.indices.count = usize::MAX / 8),
        ("apart", |m| m.indices.stride = 3),
        ("material 5", |m| m.material = 5),
        ("normals", |m| m.normals = lumi_view { count: 2, ..m.positions }),
        ("triangle_materials", |m| {
            m.triangle_materials = lumi_view { count: 2, format: LUMI_FORMAT_U32, ..m.positions }
        }),
        ("no finite", |m| m.positions.data = NAN.as_ptr().cast()),
    ];
    each(&x.mesh, spoil, mesh);
    fails(
        unsafe { lumi_scene_add_instance(draft.0, 0, UNIT.as_ptr()) },
        LUMI_ERROR_INVALID_ARGUMENT,
        "no mesh 0",
    );
    ok(mesh(&x.mesh));
    for matrix in [[0.0_f32; 12], [f32::NAN; 12], [f32::INFINITY; 12]] {
        fails(
            unsafe { lumi_scene_add_instance(draft.0, 0, matrix.as_ptr()) },
            LUMI_ERROR_INVALID_ARGUMENT,
            "to_world",
        );
    }
    // What is shared is looked at by the commit, which can be tried again.
    let shared = empty_scene(&d);
    ok(unsafe { lumi_scene_add_material(shared.0, &raw const x.material, null_mut()) });
    let mut late = x.mesh;
    (late.positions.flags, late.material) = (LUMI_VIEW_SHARED, 9);
    ok(unsafe { lumi_scene_add_mesh(shared.0, &raw const late, null_mut()) });
    fails(unsafe { lumi_scene_commit(shared.0) }, LUMI_ERROR_INVALID_ARGUMENT, "mesh 0");

    let spoil: Spoil<lumi_material_desc> = &[
        ("base_color", |m| m.base_color[1] = 1.5),
        ("base_color", |m| m.base_color[1] = f32::NAN),
        ("emission", |m| m.emission[0] = -1.0),
        ("roughness", |m| m.roughness = f32::NAN),
        ("metallic", |m| m.metallic = 2.0),
        ("ior", |m| m.ior = 0.0),
        ("alpha_mode", |m| m.alpha_mode = 3),
        ("textures", |m| m.base_color_texture = 0),
        ("flags", |m| m.flags = 8),
    ];
    each(&x.material, spoil, |m| unsafe { lumi_scene_add_material(draft.0, m, null_mut()) });
    let spoil: Spoil<lumi_texture_desc> = &[
        ("pixels", |t| t.width = 0),
        ("pixels", |t| t.height = u32::MAX),
        ("wrapping", |t| t.wrap_u = 3),
        ("pixels is NULL", |t| t.pixels = null()),
    ];
    each(&x.texture, spoil, |t| unsafe { lumi_scene_add_texture(draft.0, t, null_mut()) });
    let spoil: Spoil<lumi_light_desc> = &[
        ("kind", |l| l.kind = 3),
        ("intensity", |l| l.intensity[2] = f32::INFINITY),
        ("position", |l| l.position[0] = f32::NAN),
        ("direction", |l| (l.kind, l.direction) = (LUMI_LIGHT_DIRECTIONAL, [0.0; 3])),
        ("cos_inner", |l| (l.kind, l.cos_outer, l.cos_inner) = (LUMI_LIGHT_SPOT, 0.9, 0.5)),
        ("range", |l| l.range = -1.0),
    ];
    each(&x.light, spoil, |l| unsafe { lumi_scene_add_light(draft.0, l) });
    for (w, h) in [(0, 1), (1, 0), (u32::MAX, u32::MAX)] {
        fails(
            unsafe { lumi_scene_set_environment(draft.0, UNIT.as_ptr(), w, h, null()) },
            LUMI_ERROR_INVALID_ARGUMENT,
            "environment",
        );
    }
    fails(
        unsafe { lumi_scene_set_environment(draft.0, UNIT.as_ptr(), 1, 1, [2.0_f32; 9].as_ptr()) },
        LUMI_ERROR_INVALID_ARGUMENT,
        "rotation",
    );
    let hosts = empty_scene(&d);
    let spoil: Spoil<lumi_host_desc> = &[
        ("tracer", |h| h.trace = None),
        ("bounds", |h| h.bounds_max = [0.0; 3]),
        ("bounds", |h| h.bounds_min = [f32::NAN; 3]),
        ("flags", |h| h.flags = 64),
    ];
    each(&x.host, spoil, |h| unsafe { lumi_scene_set_host(hosts.0, h) });
    let spoil: Spoil<lumi_render_desc> = &[
        ("pixels", |r| r.width = 0),
        ("pixels", |r| r.height = u32::MAX),
        ("flags", |r| r.flags = 64),
        ("yfov", |r| r.yfov = 0.0),
        ("yfov", |r| r.yfov = 4.0),
        ("orthographic", |r| (r.flags, r.yfov) = (LUMI_RENDER_ORTHOGRAPHIC, f32::NAN)),
        ("camera", |r| r.camera = [0.0; 12]),
        ("near_plane", |r| r.near_plane = -1.0),
        ("far_plane", |r| (r.near_plane, r.far_plane) = (2.0, 1.0)),
        ("far_plane", |r| r.far_plane = f32::NAN),
    ];
    each(&x.render, spoil, |r| unsafe { lumi_cache_render(c.0, r, null(), 0) });
    let mut room = [0.0_f32; 64];
    for (name, channels, data, word) in [
        (c"beauty", 4, room.as_mut_ptr(), "no layer"),
        (c"", 3, room.as_mut_ptr(), "channels"),
        (c"", 4, null_mut(), "NULL"),
    ] {
        let layer = lumi_layer { name: name.as_ptr(), data, channels, reserved: 0 };
        fails(
            unsafe { lumi_cache_render(c.0, &raw const x.render, &raw const layer, 1) },
            LUMI_ERROR_INVALID_ARGUMENT,
            word,
        );
    }
}
