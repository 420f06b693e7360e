//! Frames of a camera that moves through a scene that does not: the same records serve all of them.

use super::caches::Caches;
use super::settings::{IntegratorKind, Settings};
use super::visible::fill_for_camera;
use crate::camera::Camera;
use crate::error::Result;
use crate::progress::Progress;
use crate::scene::Scene;
use std::time::Instant;

/// Cameras whose pixels are asked how small a record must be.
const WITNESSES: usize = 8;
/// Most times that all frames are visited. The second visit finds the few points that later frames
/// have uncovered, by clamping records or by refining them.
const VISITS: usize = 4;

/// What one frame added to the records of those before.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Growth {
    /// Irradiance records, level by level.
    pub levels: Vec<usize>,
    /// Radiance records.
    pub radiance: usize,
    /// Wall seconds of the fill.
    pub seconds: f64,
}

impl Growth {
    /// Records of all kinds.
    pub fn records(&self) -> usize {
        self.levels.iter().sum::<usize>() + self.radiance
    }

    fn add(&mut self, other: &Self) {
        self.levels.resize(self.levels.len().max(other.levels.len()), 0);
        self.levels.iter_mut().zip(&other.levels).for_each(|(sum, n)| *sum += n);
        self.radiance += other.radiance;
        self.seconds += other.seconds;
    }
}

/// Fills `caches` for all `cameras`, one after the other, until none needs another record. No frame
/// has been rendered by then, so none shows light that the next one, with more records, would show
/// differently. Returns what each camera added; nothing where the integrator uses no cache.
///
/// # Errors
/// Those of [`fill_for_camera`].
pub fn fill_sequence(
    scene: &Scene, settings: &Settings, cameras: &[Camera], caches: &mut Caches,
    progress: &Progress,
) -> Result<Vec<Growth>> {
    let mut growth = vec![Growth::default(); cameras.len()];
    if settings.integrator != IntegratorKind::Cache {
        return Ok(growth);
    }
    let count = cameras.len().min(WITNESSES);
    let witnesses: Vec<Camera> =
        (0..count).map(|k| cameras[k * (cameras.len() - 1) / (count - 1).max(1)].clone()).collect();
    for _ in 0..VISITS {
        let mut changed = false;
        for (camera, growth) in cameras.iter().zip(&mut growth) {
            let start = Instant::now();
            let (records, reductions) = (counts(caches), caches.report.reductions());
            // What is worth a record is worth it for all frames together.
            let spp = settings.spp.saturating_mul(cameras.len() as u32);
            let settings = Settings { camera: camera.clone(), spp, ..settings.clone() };
            fill_for_camera(caches, scene, &settings, &witnesses, progress)?;
            let now = counts(caches);
            let added = Growth {
                levels: now.0.iter().zip(&records.0).map(|(now, before)| now - before).collect(),
                radiance: now.1 - records.1,
                seconds: start.elapsed().as_secs_f64(),
            };
            changed |= added.records() > 0 || caches.report.reductions() > reductions;
            growth.add(&added);
        }
        if !changed {
            break;
        }
    }
    Ok(growth)
}

/// Number of irradiance records on each level, and of radiance records.
fn counts(caches: &Caches) -> (Vec<usize>, usize) {
    let cache = &caches.cache;
    let levels = (0..cache.level_count()).map(|k| cache.records(k).len()).collect();
    (levels, cache.radiance_record_count())
}
