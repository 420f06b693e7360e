//! One frame: the cache is filled, then every pixel is shaded.

use super::settings::{IntegratorKind, Settings};
use crate::cache::{Cache, FillStats, LevelPoints, Order};
use crate::error::{Error, Result};
use crate::film::{Film, Pixel};
use crate::geometry::SurfacePoint;
use crate::integrator::{Bidirectional, CachedIntegrator, CameraSample, Integrator, PathTracer, SceneProbe, Shaded, Splat};
use crate::progress::{Phase, Progress};
use crate::sampling::hash;
use crate::scene::Scene;
use rayon::prelude::*;
use std::sync::Mutex;

use super::clock::Clock;

/// Sides of a tile in pixels.
const TILE: u32 = 16;
/// Samples that each pixel gets in one pass over the image, so that a cancelled picture is complete.
const PASS: u32 = 16;
/// Tiles after which splats are added to the film, in the order of the tiles: few enough to keep them in memory.
const WAVE: u32 = 64;
/// Shading points of the deeper levels, per level.
const DEEPER_POINTS: usize = 16_384;

/// What a frame left behind.
pub struct Frame {
    /// The pixels.
    pub film: Film,
    /// The filled cache, for the caching integrator.
    pub cache: Option<Cache>,
    /// What the fill did on each level.
    pub fill: Vec<FillStats>,
    /// Rays that the fill traced: bundles, shadow rays and paths at their hits.
    pub gathered: [u64; 3],
    /// Thread seconds of rendering spent on cache lookups and on direct light.
    pub shading_seconds: [f64; 2],
    /// The frame was cancelled and holds the samples so far.
    pub cancelled: bool,
}

/// Somebody who wants to see finished tiles: window coordinates x0, y0, x1, y1 and the film so far.
pub type Watcher<'a> = dyn FnMut([u32; 4], &Film) + Send + 'a;

/// Renders one frame of `scene`.
///
/// A cancelled run returns the image so far, marked as such.
///
/// # Errors
/// [`Error::InvalidArgument`] for an empty or outlying window.
pub fn frame(scene: &Scene, settings: &Settings, progress: &Progress, clock: &mut Clock, watcher: &mut Watcher) -> Result<Frame> {
    check(settings)?;
    let tracer = PathTracer { scene, max_bounces: settings.max_bounces };
    let mut frame = Frame {
        film: Film::new(settings.size, settings.window),
        cache: None,
        fill: Vec::new(),
        gathered: [0; 3],
        shading_seconds: [0.0; 2],
        cancelled: false,
    };
    let mut limits = None;
    if settings.integrator == IntegratorKind::Cache {
        clock.start(Phase::Fill);
        let mut cache = Cache::new(settings.scheme.clone(), settings.max_bounces, scene.size());
        match fill(tracer, settings, &mut cache, &mut frame, progress) {
            Ok(births) => limits = (settings.scheme.passes == 1).then_some(births),
            Err(Error::Cancelled) => frame.cancelled = true,
            Err(e) => return Err(e),
        }
        frame.cache = Some(cache);
    }
    if !frame.cancelled && !settings.prepass_only {
        clock.start(Phase::Render);
        let integrator = match (&frame.cache, settings.integrator) {
            (Some(cache), _) => Integrator::Cached(CachedIntegrator::new(tracer, cache)),
            (None, IntegratorKind::Bdpt) => {
                let camera = settings.camera.clone();
                Integrator::Bidirectional(Box::new(Bidirectional::new(tracer, camera, settings.size, settings.window)))
            }
            (None, _) => Integrator::Path(tracer),
        };
        frame.cancelled = render(&integrator, settings, limits.as_deref(), &mut frame.film, progress, watcher);
        frame.shading_seconds = integrator.seconds();
    }
    clock.stop();
    Ok(frame)
}

fn check(settings: &Settings) -> Result<()> {
    let ([w, h], [x0, y0, x1, y1]) = (settings.size, settings.window);
    if w == 0 || h == 0 || u64::from(w) * u64::from(h) > 1 << 28 {
        return Err(Error::InvalidArgument(format!("an image of {w}x{h} pixels cannot be rendered")));
    }
    if x0 >= x1 || y0 >= y1 || x1 > w || y1 > h {
        return Err(Error::InvalidArgument(format!("the crop window {x0},{y0},{x1},{y1} is not inside {w}x{h} pixels")));
    }
    Ok(())
}

/// Fills all levels, deepest first. Returns for each pixel of the window how many records existed when it was visited.
fn fill(tracer: PathTracer, settings: &Settings, cache: &mut Cache, frame: &mut Frame, progress: &Progress) -> Result<Vec<u32>> {
    let probe = SceneProbe::new(tracer);
    let order = pixel_order(settings);
    let mut births = vec![u32::MAX; order.len()];
    if cache.level_count() == 0 {
        // Light without bounces has nothing to cache.
        return Ok(births);
    }
    let visible: Vec<(u32, SurfacePoint)> = order
        .par_iter()
        .filter_map(|&p| {
            let sample = camera_sample(settings, p, 0, u32::MAX);
            let (point, _) = tracer.first_diffuse(&sample.camera, sample.seed)?;
            Some((p, point))
        })
        .collect();
    let (pixels, points): (Vec<u32>, Vec<SurfacePoint>) = visible.into_iter().unzip();
    let width = frame.film.window_size()[0] as usize;
    let round = if settings.scheme.order == Order::Scanline { width } else { 0 };
    let mut levels = vec![LevelPoints { points, round }];
    for level in 1..cache.level_count() {
        let seed = hash(&[settings.seed, 2, u64::from(level)]);
        let points = tracer.next_points(&levels[levels.len() - 1].points, DEEPER_POINTS, seed);
        levels.push(LevelPoints { points, round: 0 });
    }
    progress.start(Phase::Fill, levels.iter().map(|l| l.points.len() as u64).sum());
    for (level, points) in levels.iter().enumerate().rev() {
        let stats = cache.fill(&probe, level as u8, points, settings.seed, progress)?;
        if level == 0 {
            for (&pixel, &birth) in pixels.iter().zip(&stats.births) {
                births[pixel as usize] = birth;
            }
        }
        frame.fill.insert(0, stats);
    }
    frame.gathered = probe.counts().totals();
    Ok(births)
}

/// The pixels of the window in the scheme's order.
fn pixel_order(settings: &Settings) -> Vec<u32> {
    let [x0, y0, x1, y1] = settings.window;
    let width = x1 - x0;
    let mut order: Vec<u32> = (0..width * (y1 - y0)).collect();
    match settings.scheme.order {
        Order::Scanline => {}
        // Grids of every eighth pixel, then every fourth, every second, and the rest.
        Order::CoarseToFine => order.sort_by_key(|p| (3 - ((p % width) | (p / width) | 8).trailing_zeros(), *p)),
        Order::Hashed => order.sort_by_cached_key(|p| (hash(&[settings.seed, 1, u64::from(*p)]), *p)),
    }
    order
}

/// Sample `index` of pixel `p` of the window.
fn camera_sample(settings: &Settings, p: u32, index: u32, limit: u32) -> CameraSample {
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
    progress.start(Phase::Render, u64::from(width) * u64::from(height) * u64::from(settings.spp));
    let shared = Mutex::new((film, watcher));
    let tiles = across * down;
    let wave = if integrator.splats() { WAVE } else { tiles };
    let mut first = 0;
    while first < settings.spp && !progress.is_cancelled() {
        let last = settings.spp.min(first + PASS);
        for start in (0..tiles).step_by(wave as usize) {
            let render_tile = |t: u32| {
                if progress.is_cancelled() {
                    return Vec::new();
                }
                let (x, y) = (t % across * TILE, t / across * TILE);
                let area = [x, y, width.min(x + TILE), height.min(y + TILE)];
                let (pixels, splats) = tile(integrator, settings, limits, width, area, first..last);
                let mut guard = shared.lock().unwrap_or_else(std::sync::PoisonError::into_inner);
                let (film, watcher) = &mut *guard;
                for (row, y) in pixels.chunks((area[2] - area[0]) as usize).zip(area[1]..) {
                    let start = (y * width + area[0]) as usize;
                    for (sum, new) in film.pixels_mut()[start..start + row.len()].iter_mut().zip(row) {
                        sum.merge(new);
                    }
                }
                watcher(area, film);
                progress.advance(pixels.len() as u64 * u64::from(last - first));
                splats
            };
            let splats: Vec<Vec<Splat>> = (start..tiles.min(start + wave)).into_par_iter().map(render_tile).collect();
            let mut guard = shared.lock().unwrap_or_else(std::sync::PoisonError::into_inner);
            splats.iter().flatten().for_each(|splat| guard.0.splat(splat));
        }
        first = last;
    }
    progress.is_cancelled()
}

/// Shades samples `indices` of every pixel of a tile. Returns its pixels, and what the samples bring to any pixel.
fn tile(
    integrator: &Integrator,
    settings: &Settings,
    limits: Option<&[u32]>,
    width: u32,
    area: [u32; 4],
    indices: std::ops::Range<u32>,
) -> (Vec<Pixel>, Vec<Splat>) {
    let mut samples = Vec::new();
    for y in area[1]..area[3] {
        for x in area[0]..area[2] {
            let p = y * width + x;
            let limit = limits.map_or(u32::MAX, |l| l[p as usize]);
            samples.extend(indices.clone().map(|i| camera_sample(settings, p, i, limit)));
        }
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
