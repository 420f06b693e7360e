//! Statistics of a run as JSON.

use super::clock::{Clock, peak_memory_bytes};
use super::frame::Frame;
use super::settings::Settings;
use crate::cache::FillStats;
use crate::film::Pixel;
use crate::scene::Scene;
use serde_json::{Value, json};

/// Seconds per phase, rays by kind, records and bytes per level, lookups and hits, back end,
/// threads, peak memory and settings.
pub fn stats(
    scene: &Scene,
    settings: &Settings,
    frame: &Frame,
    clock: &Clock,
    threads: usize,
) -> Value {
    let (lookups, misses) = frame
        .film
        .pixels()
        .iter()
        .map(Pixel::lookups)
        .fold((0, 0), |(a, b), (c, d)| (a + c, b + d));
    let samples: u64 = frame.film.pixels().iter().map(|p| u64::from(p.samples())).sum();
    let [bundle, shadow, paths] = frame.gathered;
    let levels: Vec<Value> = frame.cache.as_ref().map_or_else(Vec::new, |cache| {
        (0..cache.level_count())
            .filter_map(|k| {
                let (level, fill) = (cache.level(k)?, frame.fill.get(usize::from(k))?);
                Some(json!({
                    "level": k,
                    "records": level.records().len(),
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
    let (glossy, served) =
        frame.film.pixels().iter().map(Pixel::glossy).fold((0, 0), |(a, b), (c, d)| (a + c, b + d));
    let radiance = frame.gloss.as_ref().map(|gloss| {
        let mut fill = FillStats::default();
        gloss.fill.iter().for_each(|f| fill.add(f));
        json!({
            "records": gloss.record_count(),
            "levels": gloss.levels.iter().map(|l| l.records().len()).collect::<Vec<_>>(),
            "bytes": gloss.bytes(),
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
        "glossy": {"samples": glossy, "served": served, "fraction": if glossy > 0 { served as f64 / glossy as f64 } else { 0.0 }},
        "lookups": lookups,
        "hits": lookups - misses,
        "samples": samples,
        "backend": {"name": scene.accel().backend().name(), "version": scene.accel().version(), "bytes": scene.accel().memory_bytes()},
        "triangles": scene.geometry().triangle_count(),
        "threads": threads,
        "peak_memory_bytes": peak_memory_bytes(),
        "cancelled": frame.cancelled,
        "settings": settings.describe(),
    })
}
