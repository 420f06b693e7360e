//! Statistics of a run as JSON.

use super::clock::{Clock, peak_memory_bytes};
use super::frame::Frame;
use super::settings::Settings;
use crate::cache::{FillStats, Store};
use crate::film::Pixel;
use crate::scene::Scene;
use serde_json::{Value, json};

/// Seconds per phase, rays by kind, records and bytes per level, lookups and hits, back end,
/// threads, peak memory and settings.
pub fn stats(
    scene: &Scene, settings: &Settings, frame: &Frame, clock: &Clock, threads: usize,
) -> Value {
    let (lookups, misses) = frame
        .film
        .pixels()
        .iter()
        .map(Pixel::lookups)
        .fold((0, 0), |(a, b), (c, d)| (a + c, b + d));
    let samples: u64 = frame.film.pixels().iter().map(|p| u64::from(p.samples())).sum();
    let caches = frame.caches.as_ref();
    let [bundle, shadow, paths] = caches.map_or([0; 3], |c| c.gathered);
    let levels: Vec<Value> = caches.map_or_else(Vec::new, |c| {
        (0..c.cache.level_count())
            .filter_map(|k| {
                let level = c.cache.level(k)?.irradiance();
                let fill = c.report.irradiance.get(usize::from(k))?;
                Some(json!({
                    "level": k,
                    "records": level.len(),
                    "bytes": level.bytes(),
                    "gather_rays": fill.gather_rays,
                    "fill_lookups": fill.lookups,
                    "fill_hits": fill.hits,
                    "retaken": fill.retaken,
                    "noisy": fill.noisy,
                    "passes": fill.passes,
                    "reductions": fill.reductions,
                }))
            })
            .collect()
    });
    let (glossy, cached) =
        frame.film.pixels().iter().map(Pixel::glossy).fold((0, 0), |(a, b), (c, d)| (a + c, b + d));
    let radiance = caches.filter(|c| c.lobes.is_some()).map(|c| {
        let mut fill = FillStats::default();
        c.report.radiance.iter().for_each(|f| fill.add(f));
        let levels =
            (0..c.cache.radiance_level_count()).filter_map(|k| c.cache.level(k)?.radiance());
        json!({
            "records": c.cache.radiance_record_count(),
            "levels": levels.clone().map(Store::len).collect::<Vec<_>>(),
            "bytes": levels.map(Store::bytes).sum::<usize>(),
            "gather_rays": fill.gather_rays,
            "fill_lookups": fill.lookups,
            "fill_hits": fill.hits,
            "retaken": fill.retaken,
            "passes": fill.passes,
            "reductions": fill.reductions,
        })
    });
    // Parts of rendering that run on all threads at once: their seconds over all threads, and the
    // mean of these over the threads, about the wall seconds.
    let mut phases = clock.to_json();
    for (name, seconds) in ["interpolate", "direct"].into_iter().zip(frame.shading_seconds) {
        phases[name] = json!({"seconds": seconds / threads as f64, "cpu_seconds": seconds});
    }
    json!({
        "phases": phases,
        "seconds": clock.total_seconds(),
        "rays": {"camera": samples, "gather": bundle, "gather_shadow": shadow, "gather_paths": paths},
        "records": levels.iter().filter_map(|l| l["records"].as_u64()).sum::<u64>(),
        "levels": levels,
        "radiance": radiance,
        "glossy": {"samples": glossy, "cached": cached, "fraction": if glossy > 0 { cached as f64 / glossy as f64 } else { 0.0 }},
        "lookups": lookups,
        "hits": lookups - misses,
        "samples": samples,
        "backend": {"name": scene.accel().backend().name(), "version": scene.accel().version(), "bytes": scene.accel().memory_bytes()},
        "triangles": scene.geometry().triangle_count(),
        "threads": threads,
        "peak_memory_bytes": peak_memory_bytes(),
        "cancelled": frame.cancelled,
        "denoiser": frame.denoiser,
        "settings": settings.describe(),
    })
}
