//! Questions to a cache, many points at a time.

use super::abi::{
    Input, LUMI_POINT_COMPUTED, LUMI_POINT_INTERPOLATED, LUMI_POINT_MISSING, LUMI_POINT_REJECTED,
    LUMI_QUERY_FILL, Output, lumi_cache, lumi_query, only, read,
};
use super::cache::CacheObject;
use super::handles::borrow;
use super::status::{Fault, LUMI_ERROR_UNSUPPORTED, Outcome, ensure, guard, lumi_error};
use crate::cache::{Answer, Snapshot, scattered};
use crate::geometry::SurfacePoint;
use crate::hosted::surface_point;
use crate::math::{Color, Vec3};
use crate::progress::Progress;
use crate::sampling::{hash, stream};
use crate::transport::PathTracer;
use glam::DVec3;
use rayon::prelude::*;
use std::sync::atomic::Ordering;
use std::time::Instant;

/// Paths per point for glossy light where the host gives no number.
const GLOSSY_SAMPLES: u32 = 16;
/// Points that are looked up in one snapshot.
const CHUNK: usize = 4096;

/// The points of a query in the host's memory.
pub(super) struct Points {
    position: Input<f32, 3>,
    normal: Input<f32, 3>,
    geo_normal: Option<Input<f32, 3>>,
    wo: Option<Input<f32, 3>>,
    footprint: Option<Input<f32, 1>>,
    default_footprint: f32,
    /// Where the zero of the scene's coordinates lies in the world.
    zero: DVec3,
}

impl Points {
    pub fn new(q: &lumi_query, cache: &CacheObject) -> Outcome<Self> {
        let position = Input::required(q.position, q.n, q.position_stride, "position")?;
        Ok(Self {
            default_footprint: cache.default_footprint(&position)?,
            position,
            normal: Input::required(q.normal, q.n, q.normal_stride, "normal")?,
            geo_normal: Input::new(q.geo_normal, q.n, q.geo_normal_stride, "geo_normal")?,
            wo: Input::new(q.wo, q.n, q.wo_stride, "wo")?,
            footprint: Input::new(q.footprint, q.n, 0, "footprint")?,
            zero: cache.scene.committed()?.origin(),
        })
    }

    fn len(&self) -> usize {
        self.position.len()
    }

    /// Point `i`; `None` if it is none.
    #[inline]
    fn get(&self, i: usize) -> Option<SurfacePoint> {
        let (position, normal) = (self.position.vector(i), self.normal.vector(i));
        let n = normal.try_normalize()?;
        if !position.is_finite() || !n.is_finite() {
            return None;
        }
        let unit = |input: &Option<Input<f32, 3>>| {
            input.as_ref().and_then(|v| v.vector(i).try_normalize()).filter(|v| v.is_finite())
        };
        let footprint = self.footprint.as_ref().map_or(self.default_footprint, |f| f.get(i)[0]);
        let footprint = if footprint.is_finite() && footprint > 0.0 {
            footprint
        } else {
            self.default_footprint
        };
        Some(surface_point(
            (position.as_dvec3() - self.zero).as_vec3(),
            n,
            unit(&self.geo_normal).unwrap_or(n),
            unit(&self.wo).unwrap_or(n),
            footprint,
        ))
    }

    /// True if the host gives directions to the viewer.
    pub fn have_wo(&self) -> bool {
        self.wo.is_some()
    }

    /// Those that are points.
    pub fn valid(&self) -> Vec<SurfacePoint> {
        (0..self.len()).filter_map(|i| self.get(i)).collect()
    }
}

/// Where the answers go.
struct Answers {
    irradiance: Output<f32, 3>,
    radiance: Output<f32, 3>,
    error: Output<f32, 1>,
    status: Output<u8, 1>,
}

impl Answers {
    fn new(q: &lumi_query) -> Outcome<Self> {
        Ok(Self {
            irradiance: Output::new(q.irradiance, q.n, q.irradiance_stride, "irradiance")?,
            radiance: Output::new(q.radiance, q.n, q.radiance_stride, "radiance")?,
            error: Output::new(q.error, q.n, 0, "error")?,
            status: Output::new(q.status, q.n, 0, "status")?,
        })
    }

    #[inline]
    fn set(&mut self, i: usize, irradiance: Color, error: f32, status: u8) {
        self.irradiance.set(i, irradiance);
        self.error.set(i, [error]);
        self.status.set(i, [status]);
    }
}

/// What the records say at `at`: nothing is missing where light has no bounces.
#[inline]
fn look_up(snapshot: &Snapshot, at: &SurfacePoint) -> Option<Answer> {
    if snapshot.cache().level_count() == 0 {
        return Some(Answer {
            glossy: Color::ZERO,
            irradiance: Color::ZERO,
            direct: None,
            error: 0.0,
            allowed: 0.0,
            records: 0,
            weight: 1.0,
        });
    }
    snapshot.lookup(at)
}

/// All light that the records of an answer hold.
fn arriving(answer: &Answer) -> Color {
    answer.irradiance + answer.direct.unwrap_or_default()
}

impl CacheObject {
    fn query(&self, q: &lumi_query) -> Outcome {
        only(LUMI_QUERY_FILL, q.flags, "query")?;
        let (points, mut answers) = (Points::new(q, self)?, Answers::new(q)?);
        let mut missed = Vec::new();
        let mut hits = 0;
        for begin in (0..q.n).step_by(CHUNK) {
            self.live.read(|snapshot| {
                for i in begin..q.n.min(begin + CHUNK) {
                    let Some(at) = points.get(i) else {
                        answers.set(i, Color::ZERO, 0.0, LUMI_POINT_REJECTED);
                        continue;
                    };
                    match look_up(snapshot, &at) {
                        Some(a) => {
                            hits += 1;
                            answers.set(i, arriving(&a), a.error, LUMI_POINT_INTERPOLATED);
                        }
                        None => {
                            missed.push(i);
                            answers.set(i, Color::ZERO, 0.0, LUMI_POINT_MISSING);
                        }
                    }
                }
            });
        }
        self.counters.queries.fetch_add(q.n as u64, Ordering::Relaxed);
        self.counters.hits.fetch_add(hits, Ordering::Relaxed);
        if q.flags & LUMI_QUERY_FILL != 0 && !missed.is_empty() {
            self.fill(missed.iter().filter_map(|&i| points.get(i)).collect())?;
            self.live.read(|snapshot| {
                for &i in &missed {
                    if let Some(a) = points.get(i).and_then(|at| look_up(snapshot, &at)) {
                        answers.set(i, arriving(&a), a.error, LUMI_POINT_COMPUTED);
                    }
                }
            });
        }
        if answers.radiance.is_wanted() {
            self.glossy(q, &points, &mut answers.radiance)?;
        }
        Ok(())
    }

    /// Makes late records that cover `points`.
    fn fill(&self, points: Vec<SurfacePoint>) -> Outcome {
        let started = Instant::now();
        let (seed, progress) = (self.settings().seed, Progress::default());
        let points = scattered(&points, seed);
        let stats = self.run(&progress, false, |exchange| {
            self.with_probe(exchange, &progress, |probe| {
                self.live.fill(probe, points, seed, &progress)
            })
        })???;
        self.counters.rays.fetch_add(stats.gather_rays, Ordering::Relaxed);
        self.counters.spent(started);
        Ok(())
    }

    /// Indirect light that the glossy lobes of our own surfaces reflect: from radiance records
    /// where lobes are cached, else by paths.
    fn glossy(&self, q: &lumi_query, points: &Points, radiance: &mut Output<f32, 3>) -> Outcome {
        let scene = self.scene.own().map_err(|f| {
            Fault::new(LUMI_ERROR_UNSUPPORTED, format!("glossy radiance: {}", f.message))
        })?;
        ensure!(points.wo.is_some(), "glossy radiance needs wo");
        let settings = self.settings();
        let tracer = PathTracer { scene, max_bounces: settings.max_bounces };
        let samples = if q.glossy_samples == 0 { GLOSSY_SAMPLES } else { q.glossy_samples };
        let (snapshot, lobes, n) = (self.live.snapshot(), self.lobes.load_full(), q.n);
        let lobes = lobes.as_ref().map(|l| l.choice(&settings.scheme));
        let found: Vec<Color> = self.scene.device.pool.install(|| {
            let one = |i: usize| {
                let at = points.get(i)?;
                let seed = hash(&[settings.seed, stream::GLOSSY_QUERY, i as u64]);
                tracer.glossy_indirect(&at, samples, seed, snapshot.cache(), lobes)
            };
            (0..n).into_par_iter().map(|i| one(i).unwrap_or(Vec3::ZERO)).collect()
        });
        found.iter().enumerate().for_each(|(i, c)| radiance.set(i, *c));
        Ok(())
    }
}

/// Looks up many shading points. Without LUMI_QUERY_FILL, the call waits for no other thread, and
/// the answers depend on the records alone. With LUMI_QUERY_FILL, the call makes records where no
/// record is valid; these records depend on what other threads fill at the same time. When a host
/// fails, the answers before the fill stay.
///
/// Threads: any. Lookups run on the calling thread; fills on the device's threads.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn lumi_cache_query(
    cache: lumi_cache, query: *const lumi_query,
) -> lumi_error {
    guard("lumi_cache_query", || {
        let cache = borrow::<CacheObject>(cache)?;
        cache.query(&read(query, "the query")?)
    })
}
