//! The allowed error that gives a scheme a wanted number of records, and the cache that has them.

use crate::cache::{Cache, FillPlan, Schedule, Scheme, ShadingPoint};
use crate::error::{Error, Result};
use crate::progress::Progress;
use crate::render::{Caches, Settings, pixel_order};
use crate::transport::{CachedLobes, GlossyLobes, PathTracer, SceneWorld, View};
use std::sync::Arc;
use std::time::Instant;

/// Numbers of records within this share of the wanted one are as good as equal.
pub const TOLERANCE: f64 = 0.05;
/// Most errors that are tried for one number of records.
const ATTEMPTS: usize = 16;

/// What all schemes have in common.
pub struct Stage<'a> {
    pub tracer: PathTracer<'a>,
    pub settings: &'a Settings,
    /// The shading point of each pixel.
    pub seen: Vec<Option<View>>,
    pub progress: &'a Progress,
}

/// A filled cache.
pub struct Attempt {
    pub cache: Cache,
    /// The number of records that each pixel may use.
    pub limits: Vec<u32>,
    /// Passes of refinement.
    pub passes: u32,
    /// Wall seconds of the fill.
    pub seconds: f64,
}

/// Logarithms of a scale and of the number of records that the scale gives.
type Sample = Option<(f64, f64)>;

impl Attempt {
    /// The number of records.
    pub fn records(&self) -> usize {
        self.cache.records(0).len()
    }
}

impl Stage<'_> {
    /// A cache with `wanted` records or as near to that as could be found, from `scale` times the
    /// errors of `base` on; leaves the factor that was found.
    pub fn search(&self, base: &Scheme, wanted: usize, scale: &mut f32) -> Result<Attempt> {
        let target = (wanted as f64).ln();
        let mut x = f64::from(*scale).ln();
        // The latest samples on both sides of the target.
        let (mut many, mut few): (Sample, Sample) = (None, None);
        let mut best: Option<(f64, Attempt)> = None;
        for _ in 0..ATTEMPTS {
            let attempt = self.attempt(base, x.exp() as f32)?;
            let y = (attempt.records().max(1) as f64).ln();
            let distance = (attempt.records() as f64 / wanted as f64 - 1.0).abs();
            if best.as_ref().is_none_or(|(d, _)| distance < *d) {
                *scale = x.exp() as f32;
                best = Some((distance, attempt));
            }
            if distance <= TOLERANCE {
                break;
            }
            *(if y > target { &mut many } else { &mut few }) = Some((x, y));
            x = match (many, few) {
                (Some((x0, y0)), Some((x1, y1))) => {
                    x0 + (x1 - x0) * ((y0 - target) / (y0 - y1)).clamp(0.1, 0.9)
                }
                // The number goes with the inverse square of the radii, those with a power of the
                // error.
                _ => x + ((y - target).clamp(-3.0, 3.0) / (2.0 * f64::from(base.radius_power()))),
            };
        }
        best.map(|(_, attempt)| attempt)
            .ok_or_else(|| Error::InvalidArgument("nothing was tried".into()))
    }

    /// A cache by `scale` times the errors of `base`. Where the scheme has radiance records on all
    /// surfaces, their irradiance is what is compared.
    fn attempt(&self, base: &Scheme, scale: f32) -> Result<Attempt> {
        let mut scheme = base.clone();
        scheme.scale_error(scale);
        let (tracer, settings) = (self.tracer, self.settings);
        let mut pixels = pixel_order(&Settings { scheme: scheme.clone(), ..settings.clone() });
        pixels.retain(|&p| self.seen[p as usize].is_some());
        let start = Instant::now();
        let scene = tracer.scene;
        let lobes = if scheme.whole() {
            GlossyLobes::new(scene, &scheme, settings.max_bounces).map(Arc::new)
        } else {
            None
        };
        let cache = Cache::new(scheme.clone(), settings.max_bounces);
        let mut caches = Caches::with(cache, lobes.clone());
        let points: Vec<ShadingPoint> = pixels
            .iter()
            .filter_map(|&p| self.seen[p as usize].map(|(point, ..)| (p, point)))
            .map(|(p, point)| caches.cache.shading_point(0, p, point, 0))
            .collect();
        let appearance = |points: &[ShadingPoint], _: Option<CachedLobes>| -> Vec<Option<View>> {
            points.iter().map(|p| self.seen[p.number as usize]).collect()
        };
        let towards = |p| settings.camera.towards(p);
        let world = SceneWorld::new(tracer, lobes.as_deref(), &scheme)
            .with_appearance(&appearance)
            .with_viewer(&towards);
        let scanline = scheme.schedule.is_by_row();
        let round = if scanline { settings.size[0] as usize } else { 0 };
        let plan = FillPlan { deeper_points: 0, round, seed: settings.seed };
        let births = caches.fill(&world, &points, &plan, self.progress)?;
        let mut limits = vec![u32::MAX; self.seen.len()];
        if scheme.schedule == Schedule::OnePass {
            points.iter().zip(births).for_each(|(p, birth)| limits[p.number as usize] = birth);
        }
        let passes = caches.report.irradiance.iter().map(|f| f.passes).sum();
        let seconds = start.elapsed().as_secs_f64();
        Ok(Attempt { cache: caches.cache, limits, passes, seconds })
    }
}
