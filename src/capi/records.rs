//! The records of a cache: files, statistics, and the list of them.

use super::abi::{LUMI_REUSE, lumi_cache, lumi_record, lumi_stats, only, path, write};
use super::cache::CacheObject;
use super::handles::borrow;
use super::status::{Outcome, ensure, guard, lumi_error};
use crate::cache::{CacheFile, Origin};
use crate::hosted::Host;
use std::ffi::c_char;
use std::path::Path;
use std::sync::atomic::{AtomicU64, Ordering};

impl CacheObject {
    fn origin(&self) -> Outcome<Origin> {
        let (settings, committed) = (self.settings(), self.scene.committed()?);
        let (hashes, zero) = (committed.hashes.clone(), committed.origin());
        Ok(Origin::new(hashes, &settings.scheme, settings.max_bounces, zero))
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

/// Writes all irradiance records to a file with a checksum and the scene and settings that they
/// were made for. Radiance records, and irradiance that is known from them alone, are left to
/// lumi_cache_build. The file is complete or not there: it is written elsewhere and renamed.
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
    cache: lumi_cache, file: *const c_char, flags: u32,
) -> lumi_error {
    guard("lumi_cache_load", || borrow::<CacheObject>(cache)?.load(path(file)?, reuse(flags)?))
}

/// Adds the records of `src` that lumi_cache_save would write to `dst`, except those that `dst` has
/// already. LUMI_ERROR_STALE_CACHE as for lumi_cache_load.
///
/// `flags`: 0 or LUMI_REUSE.
///
/// Threads: one per cache `dst`; lookups may go on meanwhile.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn lumi_cache_merge(
    dst: lumi_cache, src: lumi_cache, flags: u32,
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
    cache: lumi_cache, stats: *mut lumi_stats,
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
    cache: lumi_cache, first: usize, max: usize, out: *mut lumi_record, n: *mut usize,
) -> lumi_error {
    guard("lumi_cache_get_records", || {
        let cache = borrow::<CacheObject>(cache)?;
        ensure!(!n.is_null(), "n is NULL");
        let (snapshot, committed) = (cache.live.snapshot(), cache.scene.committed()?);
        let mut count = 0;
        if out.is_null() {
            count = snapshot.record_count();
        } else {
            for (level, r) in snapshot.records().skip(first).take(max) {
                let radius = snapshot.cache().radius_rule(level).radius(r.length, r.footprint).0;
                let record = lumi_record {
                    position: committed.to_world(r.position).to_array(),
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
