//! A rendered picture, and the files that it can be written to.

use super::caches::Caches;
use super::clock::Clock;
use super::frame::Frame;
use super::output::{Facts, write_exr, write_preview};
use super::selection::Selection;
use super::settings::Settings;
use super::stats::stats;
use crate::cache::{CacheFile, Origin};
use crate::error::Result;
use crate::imagefile::Exposure;
use crate::scene::Scene;
use serde_json::Value;
use std::path::Path;

/// What the files show.
#[derive(Clone)]
pub(super) struct Output {
    pub layers: Selection,
    pub exposure: Exposure,
    pub show_records: bool,
    pub float: bool,
}

impl Default for Output {
    fn default() -> Self {
        let layers = Selection::parse("basic").expect("the default layers");
        Self { layers, exposure: Exposure::Auto, show_records: false, float: false }
    }
}

/// A rendered picture.
pub struct Rendering<'a> {
    /// The pixels and the caches.
    pub frame: Frame,
    /// What was rendered.
    pub settings: Settings,
    /// The time that it took.
    pub clock: Clock,
    /// What to tell the user, such as that the denoiser is missing.
    pub warnings: Vec<String>,
    scene: &'a Scene,
    pub(super) output: Output,
    threads: usize,
}

impl<'a> Rendering<'a> {
    pub(super) fn new(
        scene: &'a Scene, frame: Frame, settings: Settings, clock: Clock, output: Output,
        warnings: Vec<String>,
    ) -> Self {
        let exposure = output.exposure.decided(|| frame.film.radiance());
        let output = Output { exposure, ..output };
        let threads = rayon::current_num_threads();
        Self { frame, settings, clock, warnings, scene, output, threads }
    }

    /// Stops by which the preview is exposed: those that [`Job::exposure`](super::Job::exposure)
    /// was given, or what was found to suit the picture.
    pub fn exposure(&self) -> f32 {
        self.output.exposure.stops()
    }

    /// Writes the layers of the picture.
    ///
    /// # Errors
    /// Those of writing the file.
    pub fn write_exr(&self, path: impl AsRef<Path>) -> Result<()> {
        let facts = Facts {
            seconds: self.clock.total_seconds(),
            scene_hash: self.scene.hash(),
            backend: self.scene.accel().version(),
            origin: self.scene.origin(),
            exposure: self.exposure(),
            show_records: self.output.show_records,
            float: self.output.float,
        };
        write_exr(path.as_ref(), &self.frame, &self.settings, &self.output.layers, &facts)
    }

    /// Writes the picture as an 8-bit sRGB PNG or JPEG.
    ///
    /// # Errors
    /// Those of writing the file.
    pub fn write_preview(&self, path: impl AsRef<Path>) -> Result<()> {
        let (exposure, show_records) = (self.exposure(), self.output.show_records);
        write_preview(path.as_ref(), &self.frame, &self.settings, exposure, show_records)
    }

    /// Writes the records to a cache file. Nothing is written where the integrator uses no cache.
    ///
    /// # Errors
    /// Those of writing the file.
    pub fn write_cache(&self, path: impl AsRef<Path>) -> Result<()> {
        let Some(Caches { cache, .. }) = &self.frame.caches else { return Ok(()) };
        CacheFile::new(cache, origin(self.scene, &self.settings)).write(path.as_ref())
    }

    /// Seconds, rays, records, lookups, exposure and settings, as the flag `--stats` writes them.
    pub fn stats(&self) -> Value {
        let mut stats = stats(self.scene, &self.settings, &self.frame, &self.clock, self.threads);
        stats["exposure"] = self.exposure().into();
        stats
    }
}

/// What records of `scene` are made for under `settings`.
pub(super) fn origin(scene: &Scene, settings: &Settings) -> Origin {
    let hashes = scene.hashes().clone();
    Origin::new(hashes, &settings.scheme, settings.max_bounces, scene.origin())
}
