//! The allowed error that gives a scheme a wanted number of records, and the cache that has them.

use crate::cache::{Appearance, Cache, LevelPoints, Order, Refinement, Scheme};
use crate::error::{Error, Result};
use crate::geometry::SurfacePoint;
use crate::progress::{Phase, Progress};
use crate::render::{Caches, Gloss, Job, Settings, Spot, pixel_order};
use crate::transport::{PathTracer, SceneProbe};
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
    pub seen: Vec<Option<(SurfacePoint, Appearance)>>,
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
        self.cache.level(0).map_or(0, |l| l.records().len())
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

    fn attempt(&self, base: &Scheme, scale: f32) -> Result<Attempt> {
        let mut scheme = base.clone();
        scheme.scale_error(scale);
        let (one_pass, refined) = (scheme.passes == 1, scheme.refinement != Refinement::None);
        let round =
            if scheme.order == Order::Scanline { self.settings.size[0] as usize } else { 0 };
        let mut pixels = pixel_order(&Settings { scheme: scheme.clone(), ..self.settings.clone() });
        pixels.retain(|&p| self.seen[p as usize].is_some());
        let (points, appearance): (Vec<_>, Vec<_>) =
            pixels.iter().filter_map(|&p| self.seen[p as usize]).unzip();
        let points = LevelPoints { points, round };
        self.progress.start(Phase::Fill, points.points.len() as u64);
        let start = Instant::now();
        let probe = SceneProbe::new(self.tracer);
        let mut cache = Cache::new(scheme, self.settings.max_bounces, self.tracer.scene.size());
        if cache.scheme().radiance_diffuse {
            return self.attempt_whole(cache, &points, start);
        }
        let mut stats = cache.fill(&probe, 0, &points, self.settings.seed, self.progress)?;
        if refined {
            stats.add(&cache.converge(
                &probe,
                0,
                &points.points,
                &appearance,
                self.settings.seed,
                self.progress,
            )?);
        }
        let mut limits = vec![u32::MAX; self.seen.len()];
        if one_pass {
            pixels.iter().zip(&stats.births).for_each(|(&p, &birth)| limits[p as usize] = birth);
        }
        Ok(Attempt { cache, limits, passes: stats.passes, seconds: start.elapsed().as_secs_f64() })
    }

    /// The same where radiance records serve all surfaces: their irradiance is what is compared.
    fn attempt_whole(&self, cache: Cache, points: &LevelPoints, start: Instant) -> Result<Attempt> {
        let gloss = Gloss::new(self.tracer.scene, cache.scheme(), self.settings.max_bounces);
        let order = cache.scheme().radiance_order;
        let mut caches = Caches::of(cache, gloss.map(Arc::new));
        let spot = |(number, point): (u32, &SurfacePoint)| Spot {
            number,
            point: *point,
            irradiance: false,
            order,
        };
        let spots: Vec<Spot> = (0..).zip(&points.points).map(spot).collect();
        let job = Job {
            tracer: self.tracer,
            deeper_points: 0,
            round: points.round,
            seed: self.settings.seed,
            // Such schemes do not refine.
            look: &|spots, _| vec![None; spots.len()],
            towards: Some(&|p| self.settings.camera.towards(p)),
        };
        caches.fill(&job, &spots, self.progress)?;
        let limits = vec![u32::MAX; self.seen.len()];
        Ok(Attempt {
            cache: caches.cache,
            limits,
            passes: 0,
            seconds: start.elapsed().as_secs_f64(),
        })
    }
}
