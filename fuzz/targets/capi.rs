//! A sequence of calls of the C library, handles of all ages and kinds among them. No call panics
//! inside.
#![no_main]

use libfuzzer_sys::fuzz_target;
use lumicache::capi::*;
use std::ffi::{CString, c_void};
use std::ptr::{null, null_mut};
use std::sync::OnceLock;

/// Reads the input bit by bit; zeros at its end.
struct Input<'a>(&'a [u8]);

impl Input<'_> {
    fn byte(&mut self) -> u8 {
        let Some((&first, rest)) = self.0.split_first() else { return 0 };
        self.0 = rest;
        first
    }

    /// Mostly a number that makes sense, sometimes one that does not.
    fn number(&mut self) -> f32 {
        match self.byte() {
            255 => f32::NAN,
            254 => f32::INFINITY,
            253 => 3e38,
            252 => -1e-40,
            251 => 0.0,
            b => f32::from(b) / 32.0 - 3.0,
        }
    }

    fn numbers(&mut self, count: usize) -> Vec<f32> {
        (0..count).map(|_| self.number()).collect()
    }

    fn text(&mut self) -> CString {
        const WORDS: [&str; 16] = [
            "auto",
            "ward88",
            "krivanek05",
            "tabellion04",
            "schwarzhaupt12",
            "gather.rays",
            "validity.error",
            "quality",
            "levels",
            "deeper_points",
            "radius.max_radius",
            "contents",
            "direct-and-indirect",
            "diffuse_indirect",
            "N",
            "no such word",
        ];
        CString::new(WORDS[usize::from(self.byte()) % WORDS.len()]).expect("no NUL")
    }
}

fn sized<T>() -> T {
    // SAFETY: the structs of the interface are plain numbers and pointers, and begin with their
    // size.
    unsafe {
        let mut value: T = std::mem::zeroed();
        (&raw mut value).cast::<u32>().write(size_of::<T>() as u32);
        value
    }
}

fn view<T>(data: &[T], elements: usize, format: u32) -> lumi_view {
    lumi_view { data: data.as_ptr().cast(), count: elements, stride: 0, format, flags: 0 }
}

fn device() -> lumi_device {
    static DEVICE: OnceLock<usize> = OnceLock::new();
    *DEVICE.get_or_init(|| {
        let mut device = null_mut();
        // SAFETY: pointers to live values.
        let code = unsafe {
            lumi_device_new(LUMI_ABI_VERSION, c"threads=1,backend=bvh".as_ptr(), &raw mut device)
        };
        assert_eq!(code, LUMI_OK);
        device as usize
    }) as lumi_device
}

/// A floor one unit below every ray that goes down, and sometimes nonsense.
unsafe extern "C" fn floor(_: *mut c_void, batch: *mut lumi_ray_batch) -> i32 {
    // SAFETY: the library hands a batch whose arrays are as long as it says.
    unsafe {
        let batch = &*batch;
        for i in 0..batch.n as usize {
            let down = -*batch.dir.add(3 * i + 2);
            if down > 0.0 {
                *batch.distance.add(i) = 1.0 / down;
                *batch.normal.add(3 * i + 2) = 1.0;
                *batch.radiance.add(3 * i) = *batch.seed.add(i) as f32 / 1e9;
                *batch.albedo.add(3 * i) = 0.5;
            }
        }
    }
    0
}

/// Handles that the sequence has seen, released ones too.
#[derive(Default)]
struct Handles {
    scenes: Vec<lumi_scene>,
    caches: Vec<lumi_cache>,
}

impl Handles {
    fn scene(&self, input: &mut Input) -> lumi_scene {
        let k = usize::from(input.byte());
        // One in many is no scene at all.
        if k > 250 {
            self.caches.first().map_or(null_mut(), |c| c.cast())
        } else {
            self.scenes.get(k % self.scenes.len().max(1)).copied().unwrap_or(null_mut())
        }
    }

    fn cache(&self, input: &mut Input) -> lumi_cache {
        let k = usize::from(input.byte());
        if k > 250 {
            self.scenes.first().map_or(null_mut(), |s| s.cast())
        } else {
            self.caches.get(k % self.caches.len().max(1)).copied().unwrap_or(null_mut())
        }
    }
}

unsafe fn call(input: &mut Input, handles: &mut Handles) -> i32 {
    let file = std::env::temp_dir().join(format!("lumicache-fuzz-{}.lumi", std::process::id()));
    let file = CString::new(file.to_str().expect("a name")).expect("no NUL");
    // SAFETY: handles are the library's to check; all other pointers are to live values of the
    // sizes that are given.
    unsafe {
        match input.byte() % 32 {
            0 => {
                let mut scene = null_mut();
                let code = lumi_scene_new(device(), &raw mut scene);
                handles.scenes.push(scene);
                code
            }
            1 => {
                let scene = handles.scene(input);
                let mut cache = null_mut();
                let code = lumi_cache_new(scene, input.text().as_ptr(), &raw mut cache);
                handles.caches.push(cache);
                code
            }
            2 | 3 => {
                let scene = handles.scene(input);
                let (positions, uv) = (input.numbers(12), input.numbers(8));
                let indices: Vec<u32> = (0..6).map(|_| u32::from(input.byte()) % 5).collect();
                let mesh = lumi_mesh_desc {
                    positions: view(&positions, 4, LUMI_FORMAT_F32X3),
                    indices: view(&indices, 2, LUMI_FORMAT_U32X3),
                    uv0: view(&uv, usize::from(input.byte() % 5), LUMI_FORMAT_F32X2),
                    material: u32::from(input.byte() % 3),
                    ..sized()
                };
                lumi_scene_add_mesh(scene, &raw const mesh, null_mut())
            }
            4 | 5 => {
                let (scene, matrix) = (handles.scene(input), input.numbers(12));
                lumi_scene_add_instance(scene, u32::from(input.byte() % 3), matrix.as_ptr())
            }
            6 => {
                let scene = handles.scene(input);
                let mut material: lumi_material_desc = sized();
                lumi_material_init(&raw mut material);
                material.roughness = input.number();
                material.metallic = input.number();
                material.ior = input.number();
                material.base_color = [input.number(), 0.5, 0.5];
                lumi_scene_add_material(scene, &raw const material, null_mut())
            }
            7 => {
                let scene = handles.scene(input);
                let light = lumi_light_desc {
                    kind: u32::from(input.byte() % 4),
                    position: [input.number(), input.number(), input.number()],
                    direction: [input.number(), input.number(), input.number()],
                    intensity: [input.number(), 1.0, 1.0],
                    cos_inner: input.number(),
                    cos_outer: input.number(),
                    ..sized()
                };
                lumi_scene_add_light(scene, &raw const light)
            }
            8 => {
                let (scene, map) = (handles.scene(input), input.numbers(12));
                lumi_scene_set_environment(scene, map.as_ptr(), 2, 2, null())
            }
            9 | 10 => lumi_scene_commit(handles.scene(input)),
            11 => {
                let (cache, name) = (handles.cache(input), input.text());
                lumi_cache_set_f32(cache, name.as_ptr(), input.number())
            }
            12 => {
                let (cache, name) = (handles.cache(input), input.text());
                lumi_cache_set_i32(cache, name.as_ptr(), i32::from(input.byte()) - 8)
            }
            13..=15 => {
                let cache = handles.cache(input);
                let build = input.byte() % 2 == 0;
                let (position, normal) = (input.numbers(12), input.numbers(12));
                let viewer = input.numbers(12);
                let (mut irradiance, mut radiance, mut status) = ([0.0; 12], [0.0; 12], [0; 4]);
                let query = lumi_query {
                    n: usize::from(input.byte() % 5),
                    flags: u32::from(input.byte() % 2) * LUMI_QUERY_FILL,
                    position: position.as_ptr(),
                    normal: normal.as_ptr(),
                    wo: viewer.as_ptr(),
                    irradiance: irradiance.as_mut_ptr(),
                    radiance: if input.byte() % 2 == 0 {
                        null_mut()
                    } else {
                        radiance.as_mut_ptr()
                    },
                    status: status.as_mut_ptr(),
                    ..sized()
                };
                // Few rays, so that many sequences fit a minute.
                lumi_cache_set_i32(cache, c"gather.rays".as_ptr(), 16);
                lumi_cache_set_i32(cache, c"deeper_points".as_ptr(), 4);
                if build {
                    lumi_cache_build(cache, &raw const query)
                } else {
                    lumi_cache_query(cache, &raw const query)
                }
            }
            16 => lumi_cache_save(handles.cache(input), file.as_ptr()),
            17 => lumi_cache_load(handles.cache(input), file.as_ptr(), u32::from(input.byte() % 2)),
            18 => {
                let (to, from) = (handles.cache(input), handles.cache(input));
                lumi_cache_merge(to, from, 0)
            }
            19 => {
                let (scene, pixels) = (handles.scene(input), [input.byte(); 64]);
                let texture = lumi_texture_desc {
                    width: u32::from(input.byte() % 5),
                    height: u32::from(input.byte() % 5),
                    wrap_u: u32::from(input.byte() % 4),
                    wrap_v: u32::from(input.byte() % 4),
                    pixels: pixels.as_ptr(),
                    ..sized()
                };
                lumi_scene_add_texture(scene, &raw const texture, null_mut())
            }
            20 => {
                let (scene, origin, dir) =
                    (handles.scene(input), input.numbers(12), input.numbers(12));
                let (mut distance, mut normal) = ([0.0; 4], [0.0; 12]);
                let rays = lumi_trace_desc {
                    n: usize::from(input.byte() % 5),
                    origin: origin.as_ptr(),
                    dir: dir.as_ptr(),
                    distance: distance.as_mut_ptr(),
                    normal: normal.as_mut_ptr(),
                    ..sized()
                };
                lumi_scene_trace(scene, &raw const rays)
            }
            21 => {
                let cache = handles.cache(input);
                let mut records = [const { std::mem::MaybeUninit::<lumi_record>::uninit() }; 8];
                let (first, most) = (usize::from(input.byte()), usize::from(input.byte() % 9));
                lumi_cache_get_records(cache, first, most, records.as_mut_ptr().cast(), null_mut())
            }
            22 => {
                let mut stats: lumi_stats = sized();
                lumi_cache_get_stats(handles.cache(input), &raw mut stats)
            }
            23 => match input.byte() % 2 {
                0 => lumi_cache_clear(handles.cache(input)),
                _ => lumi_cache_freeze(handles.cache(input)),
            },
            24 => {
                let (cache, name) = (handles.cache(input), input.text());
                lumi_cache_set_str(cache, name.as_ptr(), input.text().as_ptr())
            }
            25 => {
                let scene = handles.scene(input);
                let host = lumi_host_desc {
                    flags: u32::from(input.byte() % 9),
                    max_batch: u32::from(input.byte()),
                    bounds_min: [input.number(), input.number(), input.number()],
                    bounds_max: [input.number(), input.number(), input.number()],
                    trace: Some(floor),
                    ..sized()
                };
                lumi_scene_set_host(scene, &raw const host)
            }
            26 => {
                let mut info: lumi_scene_info = sized();
                lumi_scene_get_info(handles.scene(input), &raw mut info)
            }
            27 | 28 => {
                let cache = handles.cache(input);
                let name = input.text();
                let mut data = [0.0; 4 * 12];
                let layer = lumi_layer {
                    name: name.as_ptr(),
                    data: data.as_mut_ptr(),
                    channels: u32::from(input.byte() % 5),
                    reserved: 0,
                };
                let mut camera = [0.0; 12];
                camera.copy_from_slice(&input.numbers(12));
                let picture = lumi_render_desc {
                    flags: u32::from(input.byte() % 5),
                    width: u32::from(input.byte() % 5),
                    height: u32::from(input.byte() % 4),
                    samples: 1,
                    camera,
                    yfov: input.number(),
                    aspect: input.number(),
                    near_plane: input.number(),
                    far_plane: input.number(),
                    ..sized()
                };
                lumi_cache_set_i32(cache, c"gather.rays".as_ptr(), 16);
                lumi_cache_set_i32(cache, c"deeper_points".as_ptr(), 4);
                lumi_cache_render(cache, &raw const picture, &raw const layer, 1)
            }
            _ => {
                match input.byte() % 4 {
                    0 => lumi_scene_retain(handles.scene(input)),
                    1 => lumi_scene_release(handles.scene(input)),
                    2 => lumi_cache_retain(handles.cache(input)),
                    _ => lumi_cache_release(handles.cache(input)),
                }
                lumi_get_last_error(null_mut())
            }
        }
    }
}

fuzz_target!(|bytes: &[u8]| {
    let (mut input, mut handles) = (Input(bytes), Handles::default());
    for _ in 0..64 {
        if input.0.is_empty() {
            break;
        }
        // SAFETY: see the function.
        let code = unsafe { call(&mut input, &mut handles) };
        assert_ne!(code, LUMI_ERROR_INTERNAL, "a panic inside");
    }
    // SAFETY: handles that are released already are refused.
    unsafe {
        for _ in 0..4 {
            handles.caches.iter().for_each(|c| lumi_cache_release(*c));
            handles.scenes.iter().for_each(|s| lumi_scene_release(*s));
        }
        lumi_get_last_error(null_mut());
    }
});
