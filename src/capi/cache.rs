//! Caches: settings, building, files, statistics.

use super::abi::{
    LUMI_REUSE, lumi_cache, lumi_cache_s, lumi_progress_fn, lumi_record, lumi_scene, lumi_stats,
    only, path, text, write,
};
use super::handles::{Kind, borrow, clear, publish, release, retain};
use super::scene::{SceneObject, World};
use super::status::{
    Fault, LUMI_ERROR_UNSUPPORTED, Outcome, Touched, ensure, guard, guard_void, lock, lumi_error,
    state,
};
use crate::cache::{Cache, CacheFile, Live, Origin, Preset, Scheme, settings};
use crate::gather::RadianceProbe;
use crate::hosted::{Exchange, Host, HostProbe};
use crate::progress::Progress;
use crate::render::Job;
use crate::transport::{GlossyLobes, PathTracer, SceneProbe};
use arc_swap::ArcSwapOption;
use std::ffi::{c_char, c_void};
use std::path::Path;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, OnceLock, TryLockError};
use std::time::Instant;

/// Points of each deeper level, unless the setting `deeper_points` says otherwise.
const DEEPER_POINTS: u32 = 16_384;
/// Width of a pixel where the host gives none, as a share of the scene's diagonal.
const FOOTPRINT: f32 = 0.002;
/// Footprint of points that the camera does not see, as a share of the scene's diagonal.
const DEEPER_FOOTPRINT: f32 = 0.004;

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
    nanoseconds: AtomicU64,
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
    pub waiting: OnceLock<rayon::ThreadPool>,
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
    pub fn watcher(&self) -> Option<(Watcher, usize)> {
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

    /// Diagonal of the scene.
    pub fn size(&self) -> Outcome<f32> {
        Ok(self.scene.committed()?.size())
    }

    /// Width of a pixel where the host gives none.
    pub fn default_footprint(&self) -> Outcome<f32> {
        Ok(FOOTPRINT * self.size()?)
    }

    /// Puts another cache in the place of this one's records, with the lobes that it answers for.
    pub fn put(&self, cache: Cache, lobes: Option<Arc<GlossyLobes>>) {
        self.live.replace(cache);
        self.lobes.store(lobes);
    }

    fn origin(&self) -> Outcome<Origin> {
        let (settings, committed) = (self.settings(), self.scene.committed()?);
        Ok(Origin::new(
            committed.hashes.clone(),
            &settings.scheme,
            settings.max_bounces,
            committed.size(),
        ))
    }

    /// An empty cache under the settings.
    fn empty(&self) -> Outcome<Cache> {
        let settings = self.settings();
        Ok(Cache::new(settings.scheme.clone(), settings.max_bounces, self.size()?))
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
        &self,
        exchange: &Exchange,
        progress: &Progress,
        f: impl FnOnce(&dyn RadianceProbe) -> R,
    ) -> Outcome<R> {
        let max_bounces = self.settings().max_bounces;
        Ok(match &self.scene.committed()?.world {
            World::Own(scene) => f(&SceneProbe::new(PathTracer { scene, max_bounces })),
            World::Host(host) => f(&self.host_probe(host, exchange, progress)?),
        })
    }

    /// The probe that asks `host`.
    pub fn host_probe<'a>(
        &self,
        host: &'a Host,
        exchange: &'a Exchange,
        progress: &'a Progress,
    ) -> Outcome<HostProbe<'a>> {
        let (max_bounces, footprint) =
            (self.settings().max_bounces, DEEPER_FOOTPRINT * self.size()?);
        Ok(HostProbe { host, exchange, max_bounces, footprint, progress })
    }

    fn save(&self, path: &Path) -> Outcome {
        Ok(CacheFile::new(&self.live.snapshot().compact(), self.origin()?).write(path)?)
    }

    fn load(&self, path: &Path, reuse: bool) -> Outcome {
        let _alone = self.change()?;
        let scheme = self.settings().scheme;
        self.put(CacheFile::read(path)?.into_cache(scheme, &self.origin()?, reuse, path)?, None);
        Ok(())
    }

    fn merge(&self, other: &Self, reuse: bool) -> Outcome {
        let _alone = self.change()?;
        let (scheme, origin, name) =
            (self.settings().scheme, self.origin()?, Path::new("the other cache"));
        let mut file = CacheFile::new(&self.live.snapshot().compact(), origin.clone());
        file.merge(CacheFile::new(&other.live.snapshot().compact(), other.origin()?), reuse, name)?;
        let mut cache = file.into_cache(scheme, &origin, reuse, name)?;
        cache.share_radiance(self.live.snapshot().cache());
        self.live.replace(cache);
        Ok(())
    }

    fn stats(&self) -> Outcome<lumi_stats> {
        let snapshot = self.live.snapshot();
        let rule = snapshot.cache().radius_rule(0);
        let radii = snapshot
            .records()
            .filter(|(level, _)| *level == 0)
            .map(|(_, r)| f64::from(rule.radius(r.length, r.footprint).0));
        let (sum, max, count) =
            radii.fold((0.0, 0.0_f64, 0_u64), |(s, m, n), r| (s + r, m.max(r), n + 1));
        let host = self.scene.committed()?.host().map_or([0; 2], Host::counts);
        let load = |c: &AtomicU64| c.load(Ordering::Relaxed);
        let (queries, hits) = (load(&self.counters.queries), load(&self.counters.hits));
        Ok(lumi_stats {
            struct_size: 0,
            frozen: u32::from(snapshot.is_frozen()),
            records: snapshot.record_count() as u64,
            radiance_records: snapshot.cache().radiance_record_count() as u64,
            bytes: snapshot.bytes() as u64,
            rays: load(&self.counters.rays),
            queries,
            hits,
            misses: queries.saturating_sub(hits),
            host_calls: host[0],
            host_rays: host[1],
            build_seconds: load(&self.counters.nanoseconds) as f64 * 1e-9,
            mean_radius: if count > 0 { sum / count as f64 } else { 0.0 },
            max_radius: max,
        })
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
    scene: lumi_scene,
    preset: *const c_char,
    out: *mut lumi_cache,
) -> lumi_error {
    guard("lumi_cache_new", || {
        clear(out)?;
        let scene = borrow::<SceneObject>(scene)?.arc();
        let preset = if preset.is_null() { "auto" } else { text(preset, "preset")? };
        let scheme = Preset::from_name_or_text(preset)?.scheme();
        let live = Live::new(Cache::new(scheme.clone(), u32::MAX, scene.committed()?.size()));
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
    cache: lumi_cache,
    name: *const c_char,
    value: f32,
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
    cache: lumi_cache,
    name: *const c_char,
    value: i32,
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
    cache: lumi_cache,
    name: *const c_char,
    value: *const c_char,
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
    cache: lumi_cache,
    callback: lumi_progress_fn,
    user: *mut c_void,
) -> lumi_error {
    guard("lumi_cache_set_progress", || {
        let cache = borrow::<CacheObject>(cache)?;
        *lock(&cache.watcher) = (callback, user.expose_provenance());
        Ok(())
    })
}

/// Joins the records of all fills into one index, and refuses more records. Lookups are fastest
/// then.
///
/// Threads: one per cache; lookups may go on meanwhile.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn lumi_cache_freeze(cache: lumi_cache) -> lumi_error {
    guard("lumi_cache_freeze", || {
        let cache = borrow::<CacheObject>(cache)?;
        let _alone = cache.change()?;
        cache.live.freeze();
        Ok(())
    })
}

/// Writes all records to a file with a checksum and the scene and settings that they were made for.
/// The file is complete or not there: it is written elsewhere and renamed.
///
/// `file`: the path, UTF-8.
///
/// Threads: any.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn lumi_cache_save(cache: lumi_cache, file: *const c_char) -> lumi_error {
    guard("lumi_cache_save", || borrow::<CacheObject>(cache)?.save(path(file)?))
}

fn reuse(flags: u32) -> Outcome<bool> {
    only(LUMI_REUSE, flags, "reuse")?;
    Ok(flags == LUMI_REUSE)
}

/// Replaces the records of the cache by those of a file. LUMI_ERROR_STALE_CACHE: the file was made
/// for another scene or under other settings; LUMI_REUSE takes it nevertheless.
/// LUMI_ERROR_CORRUPT_FILE: the file is damaged. After a failure the cache is as before.
///
/// `file`: the path, UTF-8. `flags`: 0 or LUMI_REUSE.
///
/// Threads: one per cache; lookups may go on meanwhile.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn lumi_cache_load(
    cache: lumi_cache,
    file: *const c_char,
    flags: u32,
) -> lumi_error {
    guard("lumi_cache_load", || borrow::<CacheObject>(cache)?.load(path(file)?, reuse(flags)?))
}

/// Adds the records of `src` to `dst`, except those that `dst` has already. LUMI_ERROR_STALE_CACHE
/// as for lumi_cache_load.
///
/// `flags`: 0 or LUMI_REUSE.
///
/// Threads: one per cache `dst`; lookups may go on meanwhile.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn lumi_cache_merge(
    dst: lumi_cache,
    src: lumi_cache,
    flags: u32,
) -> lumi_error {
    guard("lumi_cache_merge", || {
        let (dst, src) = (borrow::<CacheObject>(dst)?, borrow::<CacheObject>(src)?);
        dst.merge(&src, reuse(flags)?)
    })
}

/// Drops all records. A frozen cache takes new records afterwards.
///
/// Threads: one per cache; lookups may go on meanwhile.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn lumi_cache_clear(cache: lumi_cache) -> lumi_error {
    guard("lumi_cache_clear", || {
        let cache = borrow::<CacheObject>(cache)?;
        let _alone = cache.change()?;
        cache.put(cache.empty()?, None);
        Ok(())
    })
}

/// Numbers of the cache.
///
/// `stats`: set its struct_size first.
///
/// Threads: any.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn lumi_cache_get_stats(
    cache: lumi_cache,
    stats: *mut lumi_stats,
) -> lumi_error {
    guard("lumi_cache_get_stats", || {
        write(stats, borrow::<CacheObject>(cache)?.stats()?, "the stats")
    })
}

/// Writes at most `max` records to `out`, beginning with record number `first`. The records of the
/// first level come first.
///
/// `n`: receives how many were written; with `out` NULL, how many there are.
///
/// Threads: any. The numbers of records stay the same while nothing is added.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn lumi_cache_get_records(
    cache: lumi_cache,
    first: usize,
    max: usize,
    out: *mut lumi_record,
    n: *mut usize,
) -> lumi_error {
    guard("lumi_cache_get_records", || {
        let cache = borrow::<CacheObject>(cache)?;
        ensure!(!n.is_null(), "n is NULL");
        let snapshot = cache.live.snapshot();
        let mut count = 0;
        if out.is_null() {
            count = snapshot.record_count();
        } else {
            for (level, r) in snapshot.records().skip(first).take(max) {
                let radius = snapshot.cache().radius_rule(level).radius(r.length, r.footprint).0;
                let record = lumi_record {
                    position: r.position.to_array(),
                    normal: r.normal.to_array(),
                    irradiance: r.payload.irradiance.to_array(),
                    radius,
                    sigma: r.sigma,
                    level: level.into(),
                };
                // SAFETY: the host passes room for `max` records, and count < max.
                unsafe { out.add(count).write_unaligned(record) };
                count += 1;
            }
        }
        // SAFETY: not NULL; the host passes the address of a number.
        unsafe { n.write(count) };
        Ok(())
    })
}
