//! The C library, called as C calls it: misuse, agreement with the Rust API, hosts that fail,
//! files, threads.

use lumicache::accel::Backend;
use lumicache::cache::{
    Cache, FillPlan, FillReport, Preset, Scheme, ShadingPoint, VIEWED, scattered,
};
use lumicache::capi::*;
use lumicache::geometry::{SurfacePoint, extent};

use lumicache::math::Vec3;
use lumicache::progress::Progress;
use lumicache::sampling::hash;
use lumicache::scene::Scene;
use lumicache::transport::{PathTracer, SceneWorld};
use std::ffi::{CStr, CString, c_char, c_void};
use std::path::Path;
use std::ptr::{null, null_mut};
use std::sync::atomic::{AtomicU32, Ordering};

mod agreement; // with the Rust API
mod bad_input; // versions, counts, numbers
mod files; // cache files
#[cfg(target_arch = "x86_64")]
mod float_mode; // rounding, traps
mod glossy;
mod header; // the C header and the guard
mod hosted; // the exchange with hosts, without C
mod hosts;
mod installed; // the installed C library and its examples
mod misuse;

use hosts::{honest, host_scene, on_shell, shell};

fn last() -> (i32, String) {
    let mut text = null();
    let code = unsafe { lumi_get_last_error(&raw mut text) };
    (code, unsafe { CStr::from_ptr(text) }.to_str().unwrap().to_owned())
}

/// What must succeed.
#[track_caller]
pub(crate) fn ok(code: i32) {
    assert_eq!(code, LUMI_OK, "{}", last().1);
}

/// What must fail with `wanted` and a message that contains `word`.
#[track_caller]
fn fails(code: i32, wanted: i32, word: &str) {
    let (told, message) = last();
    assert_eq!((code, told), (wanted, wanted), "{message}");
    assert!(
        message.starts_with("lumi_") && message.contains(word),
        "{message} does not say {word}"
    );
}

pub(crate) fn text(s: &str) -> CString {
    CString::new(s).unwrap()
}

fn sized<T>() -> T {
    let mut value: T = unsafe { std::mem::zeroed() };
    unsafe { (&raw mut value).cast::<u32>().write(size_of::<T>() as u32) };
    value
}

/// A device, released at the end.
pub(crate) struct Device(pub lumi_device);
pub(crate) struct SceneHandle(pub lumi_scene);
pub(crate) struct CacheHandle(pub lumi_cache);

impl Drop for Device {
    fn drop(&mut self) {
        unsafe { lumi_device_release(self.0) };
    }
}
impl Drop for SceneHandle {
    fn drop(&mut self) {
        unsafe { lumi_scene_release(self.0) };
    }
}
impl Drop for CacheHandle {
    fn drop(&mut self) {
        unsafe { lumi_cache_release(self.0) };
    }
}

pub(crate) fn device(config: &str) -> Device {
    let mut d = null_mut();
    ok(unsafe { lumi_device_new(LUMI_ABI_VERSION, text(config).as_ptr(), &raw mut d) });
    Device(d)
}

fn empty_scene(device: &Device) -> SceneHandle {
    let mut s = null_mut();
    ok(unsafe { lumi_scene_new(device.0, &raw mut s) });
    SceneHandle(s)
}

fn own(name: &str) -> String {
    Path::new(env!("CARGO_MANIFEST_DIR"))
        .join(format!("scenes/{name}.gltf"))
        .to_str()
        .unwrap()
        .to_owned()
}

pub(crate) fn loaded(device: &Device, name: &str) -> SceneHandle {
    let scene = empty_scene(device);
    ok(unsafe { lumi_scene_load_gltf(scene.0, text(&own(name)).as_ptr()) });
    ok(unsafe { lumi_scene_commit(scene.0) });
    scene
}

/// A cache with few rays.
pub(crate) fn cache(scene: &SceneHandle) -> CacheHandle {
    let mut c = null_mut();
    ok(unsafe { lumi_cache_new(scene.0, null(), &raw mut c) });
    set(c, "gather.rays", 64);
    set(c, "deeper_points", 500);
    CacheHandle(c)
}

fn set(cache: lumi_cache, name: &str, value: i32) {
    ok(unsafe { lumi_cache_set_i32(cache, text(name).as_ptr(), value) });
}

/// Points on surfaces of a scene, seen from its middle.
pub(crate) fn seen(scene: &SceneHandle, count: usize) -> (Vec<[f32; 3]>, Vec<[f32; 3]>) {
    let mut info: lumi_scene_info = sized();
    ok(unsafe { lumi_scene_get_info(scene.0, &raw mut info) });
    let middle: [f32; 3] = std::array::from_fn(|k| 0.5 * (info.bounds_min[k] + info.bounds_max[k]));
    let origins = vec![middle; count];
    let dirs: Vec<[f32; 3]> = (0..count)
        .map(|i| {
            let (z, phi) = (1.0 - 2.0 * (i as f32 + 0.5) / count as f32, 2.399_963 * i as f32);
            let r = (1.0 - z * z).sqrt();
            [r * phi.cos(), r * phi.sin(), z]
        })
        .collect();
    let (mut position, mut normal, mut distance) =
        (vec![[0.0; 3]; count], vec![[0.0; 3]; count], vec![0.0; count]);
    let desc = lumi_trace_desc {
        n: count,
        origin: origins.as_ptr().cast(),
        dir: dirs.as_ptr().cast(),
        distance: distance.as_mut_ptr(),
        position: position.as_mut_ptr().cast(),
        normal: normal.as_mut_ptr().cast(),
        ..sized()
    };
    ok(unsafe { lumi_scene_trace(scene.0, &raw const desc) });
    let hits = distance.iter().zip(position).zip(normal).filter(|((d, _), _)| d.is_finite());
    hits.map(|((_, p), n)| (p, n)).unzip()
}

fn query_of(points: &(Vec<[f32; 3]>, Vec<[f32; 3]>)) -> lumi_query {
    lumi_query {
        n: points.0.len(),
        position: points.0.as_ptr().cast(),
        normal: points.1.as_ptr().cast(),
        ..sized()
    }
}

pub(crate) struct Answers {
    pub irradiance: Vec<[f32; 3]>,
    error: Vec<f32>,
    status: Vec<u8>,
}

pub(crate) fn ask(
    cache: lumi_cache, points: &(Vec<[f32; 3]>, Vec<[f32; 3]>), flags: u32,
) -> Answers {
    let n = points.0.len();
    let mut a =
        Answers { irradiance: vec![[-1.0; 3]; n], error: vec![-1.0; n], status: vec![99; n] };
    let query = lumi_query {
        flags,
        irradiance: a.irradiance.as_mut_ptr().cast(),
        error: a.error.as_mut_ptr(),
        status: a.status.as_mut_ptr(),
        ..query_of(points)
    };
    ok(unsafe { lumi_cache_query(cache, &raw const query) });
    a
}

pub(crate) fn build(cache: lumi_cache, points: &(Vec<[f32; 3]>, Vec<[f32; 3]>)) -> i32 {
    let query = query_of(points);
    unsafe { lumi_cache_build(cache, &raw const query) }
}

pub(crate) fn stats(cache: lumi_cache) -> lumi_stats {
    let mut stats: lumi_stats = sized();
    ok(unsafe { lumi_cache_get_stats(cache, &raw mut stats) });
    stats
}

fn bits(v: &[[f32; 3]]) -> Vec<[u32; 3]> {
    v.iter().map(|c| c.map(f32::to_bits)).collect()
}

unsafe extern "C" fn watch(user: *mut c_void, fraction: f64, phase: *const c_char) -> i32 {
    assert!((0.0..=1.0).contains(&fraction) && !unsafe { CStr::from_ptr(phase) }.is_empty());
    let calls = unsafe { &*user.cast::<AtomicU32>() };
    i32::from(calls.fetch_add(1, Ordering::Relaxed) == 1)
}

unsafe extern "C" fn listen(user: *mut c_void, severity: i32, code: i32, message: *const c_char) {
    let heard = unsafe { &*user.cast::<std::sync::Mutex<Vec<(i32, i32, String)>>>() };
    heard.lock().unwrap().push((
        severity,
        code,
        unsafe { CStr::from_ptr(message) }.to_str().unwrap().to_owned(),
    ));
}

/// The cache that lumi_cache_build makes of the seeds `points`, by the Rust API.
pub fn filled(
    scene: &Scene, scheme: Scheme, points: &[SurfacePoint], deeper_points: usize, seed: u64,
) -> Cache {
    let world = SceneWorld::new(PathTracer { scene, max_bounces: u32::MAX }, None, &scheme);
    let mut cache = Cache::new(scheme, u32::MAX);
    let wanted = |(number, point)| ShadingPoint { number, point, irradiance: true, order: 0 };
    let points: Vec<_> = (0..).zip(scattered(points, seed)).map(wanted).collect();
    let (plan, mut report) = (FillPlan { deeper_points, round: 0, seed }, FillReport::new(&cache));
    let pool = rayon::ThreadPoolBuilder::new()
        .num_threads(2)
        .start_handler(|_| lumicache::ffi::mxcsr::flush_denormals())
        .build()
        .unwrap();
    let mut fill = || {
        cache.fill_levels(&world, &points, &plan, &mut report, &Progress::default()).unwrap();
    };
    pool.install(&mut fill);
    cache
}
