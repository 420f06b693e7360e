//! One frame: the cache is filled, then every pixel is shaded.

use super::refine::samples_wanted;
use super::settings::{IntegratorKind, Settings};
use crate::cache::{Appearance, Cache, FillStats, LevelPoints, Order, RadianceCache, RadiancePoints, Refinement};
use crate::error::{Error, Result};
use crate::film::{Film, Pixel};
use crate::geometry::SurfacePoint;
use crate::integrator::{
    self, Bidirectional, CachedIntegrator, CameraSample, Integrator, PathTracer, SceneProbe, SceneReflector, Shaded, Splat,
};
use crate::material::tables::{GlossyTables, TableSettings, TableStore};
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

/// What served the glossy lobes of low frequency.
pub struct Gloss {
    /// Those lobes in harmonics.
    pub tables: GlossyTables,
    /// Records of the light that reaches them.
    pub records: RadianceCache,
    /// What their fill did.
    pub fill: FillStats,
}

/// What a frame left behind.
pub struct Frame {
    /// The pixels.
    pub film: Film,
    /// The filled cache, for the caching integrator.
    pub cache: Option<Cache>,
    /// What the fill did on each level.
    pub fill: Vec<FillStats>,
    /// The same for glossy surfaces, if the scheme caches radiance.
    pub gloss: Option<Gloss>,
    /// Rays that the fill traced: bundles, shadow rays and paths at their hits.
    pub gathered: [u64; 3],
    /// Thread seconds of rendering spent on cache lookups and on direct light.
    pub shading_seconds: [f64; 2],
    /// The frame was cancelled and holds the samples so far.
    pub cancelled: bool,
}

impl Frame {
    /// All caches that were filled.
    pub(super) fn caches(&self) -> impl Iterator<Item = &Cache> {
        self.cache.iter().chain(self.gloss.iter().map(|g| g.records.placement()))
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
pub fn frame(scene: &Scene, settings: &Settings, progress: &Progress, clock: &mut Clock, watcher: &mut Watcher) -> Result<Frame> {
    frame_with(scene, settings, None, progress, clock, watcher)
}

/// [`frame`] with the records of a cache that was made before under the same scheme; the fill adds what the camera needs beside them.
///
/// # Errors
/// Those of [`frame`].
pub fn frame_with(
    scene: &Scene,
    settings: &Settings,
    before: Option<Cache>,
    progress: &Progress,
    clock: &mut Clock,
    watcher: &mut Watcher,
) -> Result<Frame> {
    check(settings)?;
    let tracer = PathTracer { scene, max_bounces: settings.max_bounces };
    let mut frame = Frame {
        film: Film::new(settings.size, settings.window),
        cache: None,
        fill: Vec::new(),
        gloss: None,
        gathered: [0; 3],
        shading_seconds: [0.0; 2],
        cancelled: false,
    };
    let mut limits = None;
    if settings.integrator == IntegratorKind::Cache {
        clock.start(Phase::Fill);
        let mut cache = before.unwrap_or_else(|| Cache::new(settings.scheme.clone(), settings.max_bounces, scene.size()));
        frame.gloss = gloss(scene, settings);
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
            (Some(cache), _) => {
                let gloss = frame.gloss.as_ref().map(|g| integrator::Gloss { tables: &g.tables, records: &g.records });
                Integrator::Cached(CachedIntegrator::new(tracer, cache, gloss))
            }
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

/// What will serve glossy lobes, still without records; `None` where the scheme or the scene has nothing for it.
fn gloss(scene: &Scene, settings: &Settings) -> Option<Gloss> {
    let scheme = &settings.scheme;
    if scheme.radiance_order == 0 || settings.max_bounces == 0 {
        return None;
    }
    let wanted = TableSettings {
        basis: scheme.radiance_basis,
        order: usize::from(scheme.radiance_order),
        loss: scheme.radiance_loss,
        padding: scheme.radiance_padding,
        whole: scheme.radiance_diffuse,
    };
    let tables = GlossyTables::new(scene.materials(), wanted, &TableStore::from_environment());
    let records = RadianceCache::new(scheme, settings.max_bounces, scene.size());
    (scheme.radiance_diffuse || !tables.is_empty()).then(|| Gloss { tables, records, fill: FillStats::default() })
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
    let tables = frame.gloss.as_ref().map(|g| &g.tables);
    let visible: Vec<(u32, SurfacePoint, u8)> = order
        .par_iter()
        .filter_map(|&p| {
            let sample = camera_sample(settings, p, 0, u32::MAX);
            let (point, order) = tracer.first_cached(&sample.camera, sample.seed, tables)?;
            Some((p, point, if settings.scheme.radiance_diffuse { settings.scheme.radiance_order } else { order }))
        })
        .collect();
    let everything: Vec<SurfacePoint> = visible.iter().map(|v| v.1).collect();
    let (glossy, diffuse): (Vec<_>, Vec<_>) = visible.into_iter().partition(|v| v.2 > 0);
    let split = |points: Vec<(u32, SurfacePoint, u8)>| -> (Vec<u32>, Vec<SurfacePoint>, Vec<u8>) {
        (points.iter().map(|p| p.0).collect(), points.iter().map(|p| p.1).collect(), points.iter().map(|p| p.2).collect())
    };
    let ((pixels, points, _), (glossy_pixels, glossy_points, orders)) = (split(diffuse), split(glossy));
    let appearances: Vec<Appearance> = if settings.scheme.refinement == Refinement::None {
        vec![Appearance::default(); points.len()]
    } else {
        let rays: Vec<_> = pixels.iter().map(|&p| camera_sample(settings, p, 0, u32::MAX)).map(|s| (s.camera, s.seed)).collect();
        tracer.appearances(&rays).into_iter().map(|seen| seen.map_or_else(Appearance::default, |(_, a)| a)).collect()
    };
    let width = frame.film.window_size()[0] as usize;
    let round = if settings.scheme.order == Order::Scanline { width } else { 0 };
    let mut levels = vec![LevelPoints { points, round }];
    for level in 1..cache.level_count() {
        let seed = hash(&[settings.seed, 2, u64::from(level)]);
        let before = if level == 1 { &everything } else { &levels[levels.len() - 1].points };
        let points = tracer.next_points(before, DEEPER_POINTS, seed);
        levels.push(LevelPoints { points, round: 0 });
    }
    let count: usize = levels.iter().map(|l| l.points.len()).sum();
    progress.start(Phase::Fill, (count + glossy_points.len()) as u64);
    for (level, points) in levels.iter().enumerate().rev() {
        let mut stats = cache.fill(&probe, level as u8, points, settings.seed, progress)?;
        if level == 0 {
            for (&pixel, &birth) in pixels.iter().zip(&stats.births) {
                births[pixel as usize] = birth;
            }
            if settings.scheme.refinement != Refinement::None {
                stats.add(&cache.converge(&probe, 0, &points.points, &appearances, settings.seed, progress)?);
            }
        }
        frame.fill.insert(0, stats);
    }
    let mut gathered = probe.counts().totals();
    if let Some(Gloss { tables, records, fill }) = &mut frame.gloss {
        let points = RadiancePoints { points: LevelPoints { points: glossy_points, round }, orders };
        let probe = SceneProbe::new(tracer).with_tables(Some(tables));
        let reflector = SceneReflector { tracer, tables };
        *fill = records.fill(&probe, &points, cache, Some(&reflector), settings.seed, progress)?;
        if settings.scheme.radiance_diffuse {
            cache.share_level(0, records.placement());
        }
        for (&pixel, &birth) in glossy_pixels.iter().zip(&fill.births) {
            births[pixel as usize] = birth;
        }
        gathered.iter_mut().zip(probe.counts().totals()).for_each(|(sum, n)| *sum += n);
    }
    frame.gathered = gathered;
    Ok(births)
}

/// The pixels of the window in the scheme's order.
pub(crate) fn pixel_order(settings: &Settings) -> Vec<u32> {
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
            let splats: Vec<Vec<Splat>> = (start..tiles.min(start + wave)).into_par_iter().map(render_tile).collect();
            let mut guard = shared.lock().unwrap_or_else(std::sync::PoisonError::into_inner);
            splats.iter().flatten().for_each(|splat| guard.0.splat(splat));
        }
        first = last;
        // What light paths bring is divided by one number of samples for the whole image.
        if first == settings.spp && settings.noise > 0.0 && !integrator.splats() && !progress.is_cancelled() {
            wanted = samples_wanted(film, settings.spp, settings.noise);
            let all: u64 = wanted.iter().map(|&n| u64::from(n)).sum();
            progress.extend(all - work);
            work = all;
        }
    }
    progress.is_cancelled()
}

/// Shades samples `indices` of the pixels with these numbers. Returns those pixels, and what the samples bring to any pixel.
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
