//! One frame: the cache is filled, then every pixel is shaded.

use super::caches::{Caches, Gloss};
use super::clock::Clock;
use super::refine::samples_wanted;
use super::settings::{IntegratorKind, Settings};
use super::visible::fill_for_camera;
use crate::cache::{Cache, FillStats, RadianceCache, Schedule};
use crate::error::{Error, Result};
use crate::film::{Film, Pixel};
use crate::progress::{Phase, Progress};
use crate::sampling::hash;
use crate::scene::Scene;
use crate::transport::{
    Bidirectional, CachedIntegrator, CameraSample, Integrator, PathTracer, Shaded, Splat,
};
use rayon::prelude::*;
use std::sync::{Arc, Mutex};

/// Sides of a tile in pixels.
const TILE: u32 = 16;
/// Samples that each pixel gets in one pass over the image, so that a cancelled picture is
/// complete.
const PASS: u32 = 16;
/// Tiles after which splats are added to the film, in the order of the tiles: few enough to keep
/// them in memory.
const WAVE: u32 = 64;

/// What a frame left behind.
pub struct Frame {
    /// The pixels.
    pub film: Film,
    /// The filled cache, for the caching integrator.
    pub cache: Option<Cache>,
    /// What the fill did on each level.
    pub fill: Vec<FillStats>,
    /// The same for glossy surfaces, if the scheme caches radiance.
    pub gloss: Option<Arc<Gloss>>,
    /// Rays that the fill traced: bundles, shadow rays and paths at their hits.
    pub gathered: [u64; 3],
    /// CPU seconds of rendering spent on cache lookups and on direct light.
    pub shading_seconds: [f64; 2],
    /// The frame was cancelled and holds the samples so far.
    pub cancelled: bool,
}

impl Frame {
    /// A frame without samples.
    fn new(settings: &Settings, caches: Option<&Caches>) -> Self {
        Self {
            film: Film::new(settings.size, settings.window),
            cache: caches.map(|c| c.cache.clone()),
            fill: caches.map_or_else(Vec::new, |c| c.fill.clone()),
            gloss: caches.and_then(|c| c.gloss.clone()),
            gathered: caches.map_or([0; 3], |c| c.gathered),
            shading_seconds: [0.0; 2],
            cancelled: false,
        }
    }

    /// All caches that were filled.
    pub(super) fn caches(&self) -> impl Iterator<Item = &Cache> {
        self.cache
            .iter()
            .chain(self.gloss.iter().flat_map(|g| g.levels.iter().map(RadianceCache::placement)))
    }
}

/// Somebody who wants to see finished tiles: window coordinates x0, y0, x1, y1 and the film so far.
pub type Watcher<'a> = dyn FnMut([u32; 4], &Film) + Send + 'a;

/// Renders one frame of `scene`.
///
/// A cancelled run returns the image so far, marked as such.
///
/// # Errors
/// [`Error::InvalidArgument`] for an empty or outlying window.
pub fn frame(
    scene: &Scene,
    settings: &Settings,
    progress: &Progress,
    clock: &mut Clock,
    watcher: &mut Watcher,
) -> Result<Frame> {
    frame_with(scene, settings, None, progress, clock, watcher)
}

/// [`frame`] with the records of caches that were made before under the same scheme; the fill adds
/// what the camera needs beside them.
///
/// # Errors
/// Those of [`frame`].
pub fn frame_with(
    scene: &Scene,
    settings: &Settings,
    before: Option<Caches>,
    progress: &Progress,
    clock: &mut Clock,
    watcher: &mut Watcher,
) -> Result<Frame> {
    check(settings)?;
    if settings.integrator != IntegratorKind::Cache {
        return shade_frame(scene, settings, None, None, progress, clock, watcher);
    }
    clock.start(Phase::Fill);
    let mut caches =
        before.unwrap_or_else(|| Caches::new(scene, &settings.scheme, settings.max_bounces, None));
    match fill_for_camera(&mut caches, scene, settings, &[], progress) {
        Ok(births) => {
            let limits = (settings.scheme.schedule == Schedule::OnePass).then_some(births);
            shade_frame(scene, settings, Some(&caches), limits.as_deref(), progress, clock, watcher)
        }
        Err(Error::Cancelled) => {
            clock.stop();
            Ok(Frame { cancelled: true, ..Frame::new(settings, Some(&caches)) })
        }
        Err(e) => Err(e),
    }
}

/// [`frame`] from caches that were filled before, with no regard to the order in which their
/// records were made.
///
/// # Errors
/// Those of [`frame`].
pub fn frame_from(
    scene: &Scene,
    settings: &Settings,
    caches: Option<&Caches>,
    progress: &Progress,
    clock: &mut Clock,
    watcher: &mut Watcher,
) -> Result<Frame> {
    check(settings)?;
    shade_frame(scene, settings, caches, None, progress, clock, watcher)
}

/// Shades all pixels; `limits` are the numbers of records that may be used in each of them.
fn shade_frame(
    scene: &Scene,
    settings: &Settings,
    caches: Option<&Caches>,
    limits: Option<&[u32]>,
    progress: &Progress,
    clock: &mut Clock,
    watcher: &mut Watcher,
) -> Result<Frame> {
    let mut frame = Frame::new(settings, caches);
    if !settings.prepass_only {
        clock.start(Phase::Render);
        let tracer = PathTracer { scene, max_bounces: settings.max_bounces };
        let integrator = match (&frame.cache, settings.integrator) {
            (Some(cache), _) => {
                let gloss = frame.gloss.as_ref().map(|g| g.shading(&settings.scheme));
                Integrator::Cached(CachedIntegrator::new(tracer, cache, gloss))
            }
            (None, IntegratorKind::Bdpt) => {
                let camera = settings.camera.clone();
                Integrator::Bidirectional(Box::new(Bidirectional::new(
                    tracer,
                    camera,
                    settings.size,
                    settings.window,
                )))
            }
            (None, _) => Integrator::Path(tracer),
        };
        frame.cancelled = render(&integrator, settings, limits, &mut frame.film, progress, watcher);
        frame.shading_seconds = integrator.seconds();
    }
    clock.stop();
    Ok(frame)
}

fn check(settings: &Settings) -> Result<()> {
    let ([w, h], [x0, y0, x1, y1]) = (settings.size, settings.window);
    if w == 0 || h == 0 || u64::from(w) * u64::from(h) > 1 << 28 {
        return Err(Error::InvalidArgument(format!(
            "an image of {w}x{h} pixels cannot be rendered"
        )));
    }
    if x0 >= x1 || y0 >= y1 || x1 > w || y1 > h {
        return Err(Error::InvalidArgument(format!(
            "the crop window {x0},{y0},{x1},{y1} is not inside {w}x{h} pixels"
        )));
    }
    Ok(())
}

/// The pixels of the window in the scheme's order.
pub(crate) fn pixel_order(settings: &Settings) -> Vec<u32> {
    let [x0, y0, x1, y1] = settings.window;
    let width = x1 - x0;
    let mut order: Vec<u32> = (0..width * (y1 - y0)).collect();
    match settings.scheme.schedule {
        Schedule::OnePass | Schedule::Scanline => {}
        // Grids of every eighth pixel, then every fourth, every second, and the rest.
        Schedule::CoarseToFine => {
            order.sort_by_key(|p| (3 - ((p % width) | (p / width) | 8).trailing_zeros(), *p))
        }
        Schedule::Scattered => {
            order.sort_by_cached_key(|p| (hash(&[settings.seed, 1, u64::from(*p)]), *p))
        }
    }
    order
}

/// Sample `index` of pixel `p` of the window.
pub(crate) fn camera_sample(settings: &Settings, p: u32, index: u32, limit: u32) -> CameraSample {
    let [x0, y0, x1, _] = settings.window;
    let width = x1 - x0;
    let (x, y) = (x0 + p % width, y0 + p / width);
    // The seed belongs to the pixel of the full image: a crop shows the same noise.
    let seed = hash(&[settings.seed, u64::from(x), u64::from(y)]);
    CameraSample::new(&settings.camera, [x, y], settings.size, seed, index, limit)
}

/// Shades all pixels, pass after pass; true if it was cancelled on the way.
fn render(
    integrator: &Integrator,
    settings: &Settings,
    limits: Option<&[u32]>,
    film: &mut Film,
    progress: &Progress,
    watcher: &mut Watcher,
) -> bool {
    let [width, height] = film.window_size();
    let [across, down] = [width.div_ceil(TILE), height.div_ceil(TILE)];
    let mut wanted = vec![settings.spp; film.pixels().len()];
    let mut work = u64::from(width) * u64::from(height) * u64::from(settings.spp);
    progress.start(Phase::Render, work);
    let tiles = across * down;
    let wave = if integrator.splats() { WAVE } else { tiles };
    let mut first = 0;
    while first < wanted.iter().copied().max().unwrap_or(0) && !progress.is_cancelled() {
        let last = first + PASS.min(settings.spp - first % settings.spp);
        let shared = Mutex::new((&mut *film, &mut *watcher));
        for start in (0..tiles).step_by(wave as usize) {
            let render_tile = |t: u32| {
                if progress.is_cancelled() {
                    return Vec::new();
                }
                let (x, y) = (t % across * TILE, t / across * TILE);
                let area = [x, y, width.min(x + TILE), height.min(y + TILE)];
                // Each pixel gets whole runs of `spp` samples, so a pass is for it or is not.
                let numbers: Vec<u32> = (area[1]..area[3])
                    .flat_map(|y| y * width + area[0]..y * width + area[2])
                    .filter(|&p| wanted[p as usize] > first)
                    .collect();
                if numbers.is_empty() {
                    return Vec::new();
                }
                let (pixels, splats) = shade(integrator, settings, limits, &numbers, first..last);
                let mut guard = shared.lock().unwrap_or_else(std::sync::PoisonError::into_inner);
                let (film, watcher) = &mut *guard;
                for (&number, new) in numbers.iter().zip(&pixels) {
                    film.pixels_mut()[number as usize].merge(new);
                }
                watcher(area, film);
                progress.advance(pixels.len() as u64 * u64::from(last - first));
                splats
            };
            let splats: Vec<Vec<Splat>> =
                (start..tiles.min(start + wave)).into_par_iter().map(render_tile).collect();
            let mut guard = shared.lock().unwrap_or_else(std::sync::PoisonError::into_inner);
            splats.iter().flatten().for_each(|splat| guard.0.splat(splat));
        }
        first = last;
        // What light paths bring is divided by one number of samples for the whole image.
        if first == settings.spp
            && settings.noise > 0.0
            && !integrator.splats()
            && !progress.is_cancelled()
        {
            wanted = samples_wanted(film, settings.spp, settings.noise);
            let all: u64 = wanted.iter().map(|&n| u64::from(n)).sum();
            progress.extend(all - work);
            work = all;
        }
    }
    progress.is_cancelled()
}

/// Shades samples `indices` of the pixels with these numbers. Returns those pixels, and what the
/// samples bring to any pixel.
fn shade(
    integrator: &Integrator,
    settings: &Settings,
    limits: Option<&[u32]>,
    numbers: &[u32],
    indices: std::ops::Range<u32>,
) -> (Vec<Pixel>, Vec<Splat>) {
    let mut samples = Vec::with_capacity(numbers.len() * indices.len());
    for &p in numbers {
        let limit = limits.map_or(u32::MAX, |l| l[p as usize]);
        samples.extend(indices.clone().map(|i| camera_sample(settings, p, i, limit)));
    }
    let mut shaded: Vec<Shaded> = Vec::with_capacity(samples.len());
    let mut splats = Vec::new();
    integrator.shade(&samples, &mut shaded, &mut splats);
    let pixels = shaded
        .chunks(indices.len())
        .map(|samples| {
            let mut pixel = Pixel::default();
            samples.iter().for_each(|s| pixel.add(s));
            pixel
        })
        .collect();
    (pixels, splats)
}
