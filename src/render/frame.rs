//! One frame: every pixel is shaded, tile after tile and pass after pass.

use super::caches::Caches;
use super::refine::samples_wanted;
use super::settings::{IntegratorKind, Settings, camera_sample};
use crate::error::Result;
use crate::film::{Film, Pixel};
use crate::progress::{Phase, Progress};
use crate::scene::Scene;
use crate::transport::{Bidirectional, CachedIntegrator, Integrator, PathTracer, Shaded, Splat};
use rayon::prelude::*;
use std::ops::Range;
use std::sync::{Mutex, PoisonError};

/// Sides of a tile in pixels.
const TILE: u32 = 16;
/// Samples that each pixel gets in one pass over the image, so that a cancelled picture is
/// complete.
const PASS: u32 = 16;
/// Tiles after which splats are added to the film, in the order of the tiles: few enough to keep
/// their splats in memory.
const WAVE: u32 = 64;

/// What a frame left behind.
pub struct Frame {
    /// The pixels.
    pub film: Film,
    /// The filled caches, for the caching integrator.
    pub caches: Option<Caches>,
    /// CPU seconds of rendering spent on cache lookups and on direct light.
    pub shading_seconds: [f64; 2],
    /// The version of the Open Image Denoise that took the noise out of the film, if one did.
    pub denoiser: Option<String>,
    /// The frame was cancelled and holds the samples so far.
    pub cancelled: bool,
}

/// Who wants to see finished tiles: window coordinates x0, y0, x1, y1 and the film so far.
pub type Watcher<'a> = dyn FnMut([u32; 4], &Film) + Send + 'a;

impl Frame {
    /// True before the first sample.
    pub fn is_empty(&self) -> bool {
        self.film.pixels().iter().all(|p| p.samples() == 0)
    }

    /// A frame without samples.
    ///
    /// # Errors
    /// [`Error::OutOfMemory`](crate::error::Error::OutOfMemory).
    pub(super) fn empty(settings: &Settings, caches: Option<&Caches>) -> Result<Self> {
        Ok(Self {
            film: Film::new(settings.size, settings.window)?,
            caches: caches.cloned(),
            shading_seconds: [0.0; 2],
            denoiser: None,
            cancelled: false,
        })
    }

    /// Shades all pixels by `caches`, or by paths alone. `limits` are the numbers of records that
    /// each pixel may use.
    ///
    /// # Errors
    /// Those of [`Frame::empty`].
    pub(super) fn shade(
        scene: &Scene, settings: &Settings, caches: Option<&Caches>, limits: Option<&[u32]>,
        progress: &Progress, watcher: &mut Watcher,
    ) -> Result<Self> {
        let mut frame = Self::empty(settings, caches)?;
        if settings.prepass_only {
            return Ok(frame);
        }
        let tracer = PathTracer { scene, max_bounces: settings.max_bounces };
        let integrator = match (&frame.caches, settings.integrator) {
            (Some(caches), _) => {
                let lobes = caches.choice();
                Integrator::Cached(CachedIntegrator::new(tracer, &caches.cache, lobes))
            }
            (None, IntegratorKind::Bdpt) => {
                let (camera, size, window) =
                    (settings.camera.clone(), settings.size, settings.window);
                let bidirectional = Bidirectional::new(tracer, camera, size, window);
                Integrator::Bidirectional(Box::new(bidirectional))
            }
            (None, _) => Integrator::Path(tracer),
        };
        let shading = Shading { integrator: &integrator, settings, limits, progress };
        frame.cancelled = shading.run(&mut frame.film, watcher);
        frame.shading_seconds = integrator.seconds();
        Ok(frame)
    }
}

/// What all samples of a frame are shaded by.
struct Shading<'a> {
    integrator: &'a Integrator<'a>,
    settings: &'a Settings,
    limits: Option<&'a [u32]>,
    progress: &'a Progress,
}

impl Shading<'_> {
    /// Shades all pixels, pass after pass; true if the work was cancelled on the way.
    fn run(&self, film: &mut Film, watcher: &mut Watcher) -> bool {
        let (spp, noise, progress) = (self.settings.spp, self.settings.noise, self.progress);
        let splats = self.integrator.splats();
        let mut wanted = vec![spp; film.pixels().len()];
        let mut work = film.pixels().len() as u64 * u64::from(spp);
        progress.start(Phase::Render, work);
        let mut first = 0;
        while first < wanted.iter().copied().max().unwrap_or(0) && !progress.is_cancelled() {
            let last = first + PASS.min(spp - first % spp);
            self.pass(&wanted, first..last, film, watcher);
            first = last;
            // What light paths bring is divided by one number of samples for the whole image.
            if first == spp && noise > 0.0 && !splats && !progress.is_cancelled() {
                wanted = samples_wanted(film, spp, noise);
                let all: u64 = wanted.iter().map(|&n| u64::from(n)).sum();
                progress.extend(all - work);
                work = all;
            }
        }
        progress.is_cancelled()
    }

    /// Shades samples `indices` of the pixels that want more samples than the first of these.
    fn pass(&self, wanted: &[u32], indices: Range<u32>, film: &mut Film, watcher: &mut Watcher) {
        let [width, height] = film.window_size();
        let [across, down] = [width.div_ceil(TILE), height.div_ceil(TILE)];
        let tiles = across * down;
        let wave = if self.integrator.splats() { WAVE } else { tiles };
        let shared = Mutex::new((film, watcher));
        let shade_tile = |t: u32| {
            let (x, y) = (t % across * TILE, t / across * TILE);
            let area = [x, y, width.min(x + TILE), height.min(y + TILE)];
            // Each pixel gets whole runs of `spp` samples, so a pass is for it or is not.
            let numbers: Vec<u32> = (area[1]..area[3])
                .flat_map(|y| y * width + area[0]..y * width + area[2])
                .filter(|&p| wanted[p as usize] > indices.start)
                .collect();
            if numbers.is_empty() || self.progress.is_cancelled() {
                return Vec::new();
            }
            let (pixels, splats) = self.shade(&numbers, indices.clone());
            let mut guard = shared.lock().unwrap_or_else(PoisonError::into_inner);
            let (film, watcher) = &mut *guard;
            for (&number, new) in numbers.iter().zip(&pixels) {
                film.pixels_mut()[number as usize].merge(new);
            }
            watcher(area, film);
            self.progress.advance(pixels.len() as u64 * indices.len() as u64);
            splats
        };
        for start in (0..tiles).step_by(wave as usize) {
            let splats: Vec<Vec<Splat>> =
                (start..tiles.min(start + wave)).into_par_iter().map(shade_tile).collect();
            let mut guard = shared.lock().unwrap_or_else(PoisonError::into_inner);
            splats.iter().flatten().for_each(|splat| guard.0.splat(splat));
        }
    }

    /// Shades samples `indices` of the pixels with these numbers. Returns those pixels, and what
    /// the samples bring to any pixel.
    fn shade(&self, numbers: &[u32], indices: Range<u32>) -> (Vec<Pixel>, Vec<Splat>) {
        let mut samples = Vec::with_capacity(numbers.len() * indices.len());
        for &p in numbers {
            let limit = self.limits.map_or(u32::MAX, |l| l[p as usize]);
            samples.extend(indices.clone().map(|i| camera_sample(self.settings, p, i, limit)));
        }
        let mut shaded: Vec<Shaded> = Vec::with_capacity(samples.len());
        let mut splats = Vec::new();
        self.integrator.shade(&samples, &mut shaded, &mut splats);
        let pixel = |samples: &[Shaded]| {
            let mut pixel = Pixel::default();
            samples.iter().for_each(|s| pixel.add(s));
            pixel
        };
        (shaded.chunks(indices.len()).map(pixel).collect(), splats)
    }
}
