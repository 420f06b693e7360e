//! Caches: what they are made by, and work on the device's threads.

use super::abi::{Input, lumi_cache, lumi_cache_s, lumi_progress_fn, lumi_scene, text};
use super::handles::{Kind, borrow, clear, publish, release, retain};
use super::pool::Pool;
use super::scene::{SceneKind, SceneObject};
use super::status::{
    Fault, LUMI_ERROR_UNSUPPORTED, Outcome, Touched, guard, guard_void, lock, lumi_error, state,
};
use crate::cache::{Cache, Live, Preset, Scheme, VIEWED, settings};
use crate::ffi::mxcsr::as_caller;
use crate::gather::RadianceProbe;
use crate::geometry;
use crate::hosted::{self, Exchange, Host, HostProbe};
use crate::progress::Progress;
use crate::render::Job;
use crate::transport::{GlossyLobes, PathTracer, SceneProbe};
use arc_swap::ArcSwapOption;
use std::ffi::{CString, c_char, c_void};
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, OnceLock, TryLockError};
use std::time::Instant;

/// Points of each deeper level, unless the setting `deeper_points` says otherwise.
const DEEPER_POINTS: u32 = 16_384;

/// What a cache is made by.
#[derive(Clone)]
pub(super) struct Settings {
    pub scheme: Scheme,
    /// What `scheme` was scaled by.
    pub quality: f32,
    pub max_bounces: u32,
    pub seed: u64,
    pub deeper_points: u32,
}

type Watcher = unsafe extern "C" fn(*mut c_void, f64, *const c_char) -> i32;

/// Counters over the life of a cache.
#[derive(Default)]
pub(super) struct Counters {
    pub rays: AtomicU64,
    pub queries: AtomicU64,
    pub hits: AtomicU64,
    pub nanoseconds: AtomicU64,
}

impl Counters {
    pub fn spent(&self, since: Instant) {
        self.nanoseconds.fetch_add(since.elapsed().as_nanos() as u64, Ordering::Relaxed);
    }
}

/// A cache.
pub(super) struct CacheObject {
    pub touched: Touched,
    pub scene: Arc<SceneObject>,
    settings: Mutex<Settings>,
    pub live: Live,
    /// The glossy lobes that radiance records answer for, once a build or a picture has made such
    /// records.
    pub lobes: ArcSwapOption<GlossyLobes>,
    /// Held by who changes the cache as a whole.
    changing: Mutex<()>,
    watcher: Mutex<(lumi_progress_fn, usize)>,
    /// Threads for gathers that wait for the host.
    waiting: OnceLock<Pool>,
    pub counters: Counters,
}

impl Kind for CacheObject {
    type Opaque = lumi_cache_s;
    const NAME: &'static str = "cache";
    fn touched(&self) -> &Touched {
        &self.touched
    }
}

impl CacheObject {
    /// A copy of the settings: nothing stays locked.
    pub fn settings(&self) -> Settings {
        lock(&self.settings).clone()
    }

    /// The host's progress callback.
    fn watcher(&self) -> Option<(Watcher, usize)> {
        let (callback, user) = *lock(&self.watcher);
        callback.map(|c| (c, user))
    }

    /// Lets nobody else change the cache as a whole meanwhile.
    pub fn change(&self) -> Outcome<MutexGuard<'_, ()>> {
        match self.changing.try_lock() {
            Ok(guard) => Ok(guard),
            Err(TryLockError::Poisoned(poisoned)) => Ok(poisoned.into_inner()),
            Err(TryLockError::WouldBlock) => {
                Err(Fault::operation("another call is changing this cache"))
            }
        }
    }

    /// Width of a pixel at the points of a query, of which one has `positions`, where the host
    /// gives none.
    pub fn default_footprint(&self, positions: &Input<f32, 3>) -> Outcome<f32> {
        let mut extent = self.live.read(|s| s.cache().extent());
        if extent == 0.0 {
            let whole = self.scene.committed()?.size();
            let seen = geometry::extent(positions.len(), |i| positions.vector(i));
            extent = seen.unwrap_or(whole);
        }
        Ok(VIEWED * extent)
    }

    /// Puts another cache in the place of this one's records, with the lobes that it answers for.
    pub fn put(&self, cache: Cache, lobes: Option<Arc<GlossyLobes>>) {
        self.live.replace(cache);
        self.lobes.store(lobes);
    }

    /// An empty cache under the settings.
    pub fn empty(&self) -> Outcome<Cache> {
        let settings = self.settings();
        Ok(Cache::new(settings.scheme, settings.max_bounces))
    }

    fn set(&self, name: &str, value: &str) -> Outcome {
        let _alone = self.change()?;
        let empty = self.live.read(|s| s.record_count() == 0);
        state(empty, "the cache has records: clear it before its settings change")?;
        lock(&self.settings).set(name, value)?;
        self.put(self.empty()?, None);
        Ok(())
    }

    /// Calls `f` with the probe of the scene.
    pub fn with_probe<R>(
        &self, exchange: &Exchange, progress: &Progress, f: impl FnOnce(&dyn RadianceProbe) -> R,
    ) -> Outcome<R> {
        let max_bounces = self.settings().max_bounces;
        Ok(match &self.scene.committed()?.kind {
            SceneKind::Own(scene) => f(&SceneProbe::new(PathTracer { scene, max_bounces })),
            SceneKind::Host(host) => f(&self.host_probe(host, exchange, progress)?),
        })
    }

    /// The probe that asks `host`.
    pub fn host_probe<'a>(
        &self, host: &'a Host, exchange: &'a Exchange, progress: &'a Progress,
    ) -> Outcome<HostProbe<'a>> {
        Ok(HostProbe { host, exchange, max_bounces: self.settings().max_bounces, progress })
    }

    /// Runs `work` on other threads. Meanwhile this thread calls the host's tracer, if the host
    /// wants it so, and tells of `progress` where it is watched.
    pub fn run<R: Send>(
        &self, progress: &Progress, watched: bool, work: impl FnOnce(&Exchange) -> R + Send,
    ) -> Outcome<R> {
        let own = &self.scene.device.pool;
        let host = self.scene.committed()?.host();
        let threads = host.map_or(Ok(own), |host| self.host_pool(host))?;
        let watch = || {
            if watched {
                self.report(progress);
            }
        };
        Ok(hosted::run(threads, host, own.current_num_threads(), watch, work)?)
    }

    /// Threads for gathers that wait for the host; made once.
    fn host_pool(&self, host: &Host) -> Outcome<&Pool> {
        if let Some(pool) = self.waiting.get() {
            return Ok(pool);
        }
        let rays = self.settings().scheme.gather.rays as usize;
        let threads = host.gathering_threads(rays, self.scene.device.pool.current_num_threads());
        let made = Pool::new(threads, "lumicache-gather")?;
        Ok(self.waiting.get_or_init(|| made))
    }

    /// Tells the host how far the work is; stops it if the host says so.
    fn report(&self, progress: &Progress) {
        let Some((callback, user)) = self.watcher() else { return };
        let snapshot = progress.snapshot();
        let fraction = (snapshot.done as f64 / snapshot.total.max(1) as f64).min(1.0);
        let phase = CString::new(snapshot.phase.name()).unwrap_or_default();
        // SAFETY: the host has given a function of this type and a pointer for it; the text lives
        // during the call. No lock is held.
        let stop = as_caller(|| unsafe {
            callback(std::ptr::with_exposed_provenance_mut(user), fraction, phase.as_ptr())
        });
        if stop != 0 {
            progress.cancel();
        }
    }
}

impl Settings {
    fn set(&mut self, name: &str, value: &str) -> Outcome {
        let wrong =
            |what: String| Fault::argument(format!("setting `{name}` is {value}, expected {what}"));
        let number = |low: i64, high: i64| {
            let parsed = value.parse::<i64>().ok().filter(|n| (low..=high).contains(n));
            parsed.ok_or_else(|| wrong(format!("a whole number from {low} to {high}")))
        };
        match name {
            "preset" => {
                (self.scheme, self.quality) = (Preset::from_name_or_text(value)?.scheme(), 1.0);
            }
            "quality" => {
                let quality = value.parse().ok().filter(|q| Job::QUALITY.contains(q));
                let quality: f32 = quality.ok_or_else(|| wrong("0.01 to 100".into()))?;
                self.scheme.scale_quality(quality / self.quality);
                self.quality = quality;
            }
            "max_bounces" => {
                self.max_bounces = u32::try_from(number(-1, 1 << 16)?).unwrap_or(u32::MAX)
            }
            "seed" => self.seed = number(0, i64::MAX)? as u64,
            "deeper_points" => self.deeper_points = number(0, 1 << 24)? as u32,
            _ => {
                let groups = ["refinement", "glossy"];
                if !groups.contains(&name) && settings().iter().all(|s| s.name != name) {
                    let text = format!("there is no setting `{name}`");
                    return Err(Fault::new(LUMI_ERROR_UNSUPPORTED, text));
                }
                self.scheme.set(name, value)?;
            }
        }
        Ok(())
    }
}

/// Makes an empty cache for a committed scene; the caller owns a reference to it.
///
/// `preset`: name of a caching scheme as `lumicache presets` lists them, or a TOML text as
/// `lumicache presets NAME` shows it; NULL: "auto".
///
/// Threads: any.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn lumi_cache_new(
    scene: lumi_scene, preset: *const c_char, out: *mut lumi_cache,
) -> lumi_error {
    guard("lumi_cache_new", || {
        clear(out)?;
        let scene = borrow::<SceneObject>(scene)?.arc();
        let preset = if preset.is_null() { "auto" } else { text(preset, "preset")? };
        let scheme = Preset::from_name_or_text(preset)?.scheme();
        scene.committed()?;
        let live = Live::new(Cache::new(scheme.clone(), u32::MAX));
        let (max_bounces, deeper_points) = (u32::MAX, DEEPER_POINTS);
        let settings = Settings { scheme, quality: 1.0, max_bounces, seed: 0, deeper_points };
        let object = CacheObject {
            touched: scene.touched.child(),
            scene,
            settings: Mutex::new(settings),
            live,
            lobes: ArcSwapOption::empty(),
            changing: Mutex::new(()),
            watcher: Mutex::new((None, 0)),
            waiting: OnceLock::new(),
            counters: Counters::default(),
        };
        publish(object, out)
    })
}

/// Adds a reference.
///
/// Threads: any.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn lumi_cache_retain(cache: lumi_cache) {
    guard_void("lumi_cache_retain", || retain::<CacheObject>(cache));
}

/// Drops a reference. NULL is ignored.
///
/// Threads: any, except from the cache's own callbacks.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn lumi_cache_release(cache: lumi_cache) {
    guard_void("lumi_cache_release", || release::<CacheObject>(cache));
}

/// Sets a number of the scheme, such as "validity.error" or "radius.max_radius", or "quality".
/// Fails with LUMI_ERROR_UNSUPPORTED for a name that this version does not know, and with
/// LUMI_ERROR_INVALID_OPERATION once the cache has records.
///
/// Threads: one per cache.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn lumi_cache_set_f32(
    cache: lumi_cache, name: *const c_char, value: f32,
) -> lumi_error {
    guard("lumi_cache_set_f32", || {
        borrow::<CacheObject>(cache)?.set(text(name, "name")?, &value.to_string())
    })
}

/// Sets a whole number: "gather.rays", "levels" and other settings of the scheme, "max_bounces"
/// (-1: no bound), "seed", "deeper_points" (points of each deeper level). See lumi_cache_set_f32.
///
/// Threads: one per cache.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn lumi_cache_set_i32(
    cache: lumi_cache, name: *const c_char, value: i32,
) -> lumi_error {
    guard("lumi_cache_set_i32", || {
        borrow::<CacheObject>(cache)?.set(text(name, "name")?, &value.to_string())
    })
}

/// Sets a word: "preset", which resets the whole scheme to a preset or to a TOML text, or any
/// setting written as `lumicache presets NAME --all` shows it. See lumi_cache_set_f32.
///
/// Threads: one per cache.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn lumi_cache_set_str(
    cache: lumi_cache, name: *const c_char, value: *const c_char,
) -> lumi_error {
    guard("lumi_cache_set_str", || {
        borrow::<CacheObject>(cache)?.set(text(name, "name")?, text(value, "value")?)
    })
}

/// Sets the callback that watches lumi_cache_build and lumi_cache_render; NULL: none.
///
/// Threads: any; the callback runs on the thread that builds.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn lumi_cache_set_progress(
    cache: lumi_cache, callback: lumi_progress_fn, user: *mut c_void,
) -> lumi_error {
    guard("lumi_cache_set_progress", || {
        let cache = borrow::<CacheObject>(cache)?;
        *lock(&cache.watcher) = (callback, user.expose_provenance());
        Ok(())
    })
}
