//! Both tracers on the kinds of rays that caching casts: how long a build takes, how much memory it
//! holds, how many rays it traces per second.

use crate::accel::{Accel, Backend, Coherence, Hit, Ray};
use crate::error::Result;
use crate::ffi::mxcsr::FlushDenormals;
use crate::geometry::{Geometry, SurfacePoint};
use crate::math::{Frame, PI, Vec3};
use serde::Serialize;
use std::fmt::Write;
use std::time::Instant;

/// How much to measure.
#[derive(Clone, Copy, Debug)]
pub struct Options {
    /// Rays of each kind.
    pub rays: usize,
    /// Times that each batch of rays is traced and each hierarchy built; the fastest counts.
    pub repetitions: usize,
}

impl Default for Options {
    fn default() -> Self {
        Self { rays: 1 << 20, repetitions: 5 }
    }
}

/// What [`run`] measured. Rays are traced by one thread.
#[derive(Clone, Debug, Serialize)]
pub struct AccelReport {
    /// Triangles as seen by rays.
    pub triangles: usize,
    /// Rays of each kind; bundles and bounces start where camera rays hit, so there are fewer of
    /// them if many miss.
    pub rays: RayCounts,
    /// One entry for each back end that this build has, Embree first.
    pub backends: Vec<BackendReport>,
    /// Bundle throughput of [`Accel::intersect_many`] relative to a bare loop over packets that
    /// were laid out before; `None` without Embree.
    pub relative_to_bare_embree: Option<f64>,
}

/// Number of rays of each kind.
#[derive(Clone, Copy, Debug, Default, Serialize)]
pub struct RayCounts {
    /// Neighbouring pixels.
    pub camera: usize,
    /// 256 cosine-distributed directions from each of many surface points: what a record's gather
    /// casts.
    pub bundle: usize,
    /// One random direction from each surface point, traced one by one.
    pub bounce: usize,
    /// Surface points of neighbouring pixels to random points of the upper half of the scene.
    pub occlusion: usize,
}

/// The measurements of one back end.
#[derive(Clone, Debug, Serialize)]
pub struct BackendReport {
    /// `embree` or `bvh`.
    pub backend: &'static str,
    /// Name and version of the tracer.
    pub version: String,
    /// Seconds to build.
    pub build_seconds: f64,
    /// Bytes of the hierarchy and its triangles.
    pub memory_bytes: usize,
    /// Millions of rays per second.
    pub mrays_per_second: Throughput,
}

/// Millions of rays per second of each kind, see [`RayCounts`].
#[derive(Clone, Copy, Debug, Default, Serialize)]
pub struct Throughput {
    /// Closest hits of camera rays.
    pub camera: f64,
    /// Closest hits of bundles.
    pub bundle: f64,
    /// Closest hits of single incoherent rays.
    pub bounce: f64,
    /// Occlusion.
    pub occlusion: f64,
}

/// Directions from one point in [`Workload::bundle`].
const BUNDLE: usize = 256;

/// The rays of each kind.
struct Workload {
    camera: Vec<Ray>,
    bundle: Vec<Ray>,
    bounce: Vec<Ray>,
    occlusion: Vec<Ray>,
}

/// Point number `i` of a sequence that fills the unit square evenly, Roberts' R2.
fn point(i: usize) -> (f32, f32) {
    let at = |step: f64| (0.5 + i as f64 * step).fract() as f32;
    (at(0.754_877_666_246_692_8), at(0.569_840_290_998_053_3))
}

/// The direction that a point of the unit square maps to, with density cos / π around `n`.
fn cosine_direction(n: Vec3, (x, y): (f32, f32)) -> Vec3 {
    let (radius, phi) = (x.sqrt(), 2.0 * PI * y);
    Frame::from_normal(n).to_world(Vec3::new(
        radius * phi.cos(),
        radius * phi.sin(),
        (1.0 - x).max(0.0).sqrt(),
    ))
}

/// Point `i` of a 16 x 16 stratification, in blocks of 4 x 4 so that 16 consecutive points lie
/// close together.
fn stratum(i: usize) -> (f32, f32) {
    let (block, inner) = (i / 16, i % 16);
    let (x, y) = (block / 4 * 4 + inner / 4, block % 4 * 4 + inner % 4);
    ((x as f32 + 0.5) / 16.0, (y as f32 + 0.5) / 16.0)
}

impl Workload {
    fn new(geometry: &Geometry, tracer: &Accel, camera: Vec<Ray>, rays: usize) -> Self {
        let mut hits = vec![Hit::MISS; camera.len()];
        tracer.intersect_many(&camera, Coherence::Camera, &mut hits);
        let starts: Vec<(Vec3, Vec3)> = camera
            .iter()
            .zip(&hits)
            .filter(|(_, hit)| hit.is_hit())
            .map(|(ray, hit)| {
                let [a, b, c] = geometry.triangle(hit.instance, hit.triangle);
                let n = (b - a).cross(c - a).normalize_or(Vec3::Z);
                let n = if n.dot(ray.dir) > 0.0 { -n } else { n };
                (SurfacePoint::plain(ray.at(hit.t), n).leave(n), n)
            })
            .collect();
        let bundles = (rays / BUNDLE).min(starts.len());
        let bundle = (0..bundles)
            .flat_map(|i| {
                let (origin, n) = starts[i * starts.len() / bundles];
                (0..BUNDLE).map(move |k| Ray::new(origin, cosine_direction(n, stratum(k))))
            })
            .collect();
        // A stride that shares no factor with the count visits every start once, in an order
        // without coherence.
        let count = starts.len();
        let stride = (count * 618 / 1000..).find(|&s| gcd(s, count) == 1).unwrap_or(1);
        let bounce = (0..count)
            .map(|i| starts[i * stride % count])
            .enumerate()
            .map(|(i, (o, n))| Ray::new(o, cosine_direction(n, point(i))))
            .collect();
        let bounds = geometry.bounds();
        let occlusion = starts
            .iter()
            .enumerate()
            .map(|(i, &(origin, _))| {
                let ((x, z), (y, _)) = (point(i), point(i + 1));
                let target =
                    bounds.min + (bounds.max - bounds.min) * Vec3::new(x, 0.5 + 0.5 * y, z);
                Ray { tmax: 0.999, ..Ray::new(origin, target - origin) }
            })
            .collect();
        Self { camera, bundle, bounce, occlusion }
    }
}

fn gcd(a: usize, b: usize) -> usize {
    if b == 0 { a } else { gcd(b, a % b) }
}

/// Rays that are timed together. The fastest of several repetitions counts for each batch, so that
/// a disturbance costs one repetition of one batch.
const BATCH: usize = 1 << 16;

/// The kinds of rays, in the order of [`Throughput`]'s fields.
#[derive(Clone, Copy, PartialEq)]
enum Kind {
    Camera,
    Bundle,
    Bounce,
    Occlusion,
}

/// Seconds that `tracer` takes for one batch.
fn seconds(
    tracer: &Accel, kind: Kind, rays: &[Ray], hits: &mut [Hit], blocked: &mut [bool],
) -> f64 {
    let start = Instant::now();
    match kind {
        Kind::Camera => tracer.intersect_many(rays, Coherence::Camera, &mut hits[..rays.len()]),
        Kind::Bundle => tracer.intersect_many(rays, Coherence::Bundle, &mut hits[..rays.len()]),
        Kind::Bounce => rays.iter().zip(hits).for_each(|(ray, hit)| *hit = tracer.intersect(ray)),
        Kind::Occlusion => tracer.occluded_many(rays, &mut blocked[..rays.len()]),
    }
    start.elapsed().as_secs_f64()
}

/// Measures every back end of this build on `geometry`. `camera_rays` gives about as many rays as
/// it is asked for, in the order of a renderer's tiles.
///
/// The back ends take turns on each batch, so that a change of the machine's load meets all of
/// them.
///
/// # Errors
/// What [`Accel::build`] returns.
pub fn run(
    geometry: &Geometry, camera_rays: &mut dyn FnMut(usize) -> Vec<Ray>, options: Options,
) -> Result<AccelReport> {
    let _guard = FlushDenormals::new();
    let backends: Vec<Backend> = Backend::ALL
        .into_iter()
        .filter(|&b| b == Backend::Bvh || Backend::default() == Backend::Embree)
        .collect();
    let mut tracers =
        backends.iter().map(|&b| Accel::build(geometry, b)).collect::<Result<Vec<_>>>()?;
    let workload = Workload::new(geometry, &tracers[0], camera_rays(options.rays), options.rays);

    let mut build: Vec<f64> = tracers.iter().map(Accel::build_seconds).collect();
    for _ in 1..options.repetitions {
        for (i, tracer) in tracers.iter_mut().enumerate() {
            *tracer = Accel::build(geometry, backends[i])?;
            build[i] = build[i].min(tracer.build_seconds());
        }
    }

    let mut trace = vec![[0.0; 4]; tracers.len()];
    let mut bare = None;
    let (mut hits, mut blocked) = (vec![Hit::MISS; BATCH], vec![false; BATCH]);
    let kinds = [
        (Kind::Camera, &workload.camera),
        (Kind::Bundle, &workload.bundle),
        (Kind::Bounce, &workload.bounce),
        (Kind::Occlusion, &workload.occlusion),
    ];
    for (k, (kind, rays)) in kinds.into_iter().enumerate() {
        for batch in rays.chunks(BATCH) {
            let mut best = vec![f64::INFINITY; tracers.len()];
            let mut best_bare = None;
            for _ in 0..options.repetitions.max(1) {
                for (best, tracer) in best.iter_mut().zip(&tracers) {
                    *best = best.min(seconds(tracer, kind, batch, &mut hits, &mut blocked));
                    if let Some(time) =
                        (kind == Kind::Bundle).then(|| tracer.bare_seconds(batch)).flatten()
                    {
                        best_bare = Some(time.min(best_bare.unwrap_or(f64::INFINITY)));
                    }
                }
            }
            trace.iter_mut().zip(best).for_each(|(sum, best)| sum[k] += best);
            bare = best_bare.map_or(bare, |time| Some(bare.unwrap_or(0.0) + time));
        }
    }

    let rays = RayCounts {
        camera: workload.camera.len(),
        bundle: workload.bundle.len(),
        bounce: workload.bounce.len(),
        occlusion: workload.occlusion.len(),
    };
    let rate =
        |count: usize, seconds: f64| if count == 0 { 0.0 } else { 1e-6 * count as f64 / seconds };
    let backends = tracers
        .iter()
        .zip(build.iter().zip(&trace))
        .map(|(tracer, (&build_seconds, times))| BackendReport {
            backend: tracer.backend().name(),
            version: tracer.version(),
            build_seconds,
            memory_bytes: tracer.memory_bytes(),
            mrays_per_second: Throughput {
                camera: rate(rays.camera, times[0]),
                bundle: rate(rays.bundle, times[1]),
                bounce: rate(rays.bounce, times[2]),
                occlusion: rate(rays.occlusion, times[3]),
            },
        })
        .collect();
    Ok(AccelReport {
        triangles: geometry.triangle_count(),
        rays,
        backends,
        relative_to_bare_embree: bare.map(|bare| bare / trace[0][1]),
    })
}

impl AccelReport {
    /// The report as a text table: one column for each back end and, if there are two, the first
    /// divided by the second.
    pub fn table(&self) -> String {
        type Row = (&'static str, fn(&BackendReport) -> f64);
        let rows: [Row; 6] = [
            ("build, seconds", |b| b.build_seconds),
            ("memory, MB", |b| 1e-6 * b.memory_bytes as f64),
            ("camera, Mrays/s", |b| b.mrays_per_second.camera),
            ("bundle, Mrays/s", |b| b.mrays_per_second.bundle),
            ("bounce, Mrays/s", |b| b.mrays_per_second.bounce),
            ("occlusion, Mrays/s", |b| b.mrays_per_second.occlusion),
        ];
        let mut text = format!("{:<20}", format!("{} triangles", self.triangles));
        for backend in &self.backends {
            let _ = write!(text, "{:>18}", backend.version);
        }
        if let [first, second] = &self.backends[..] {
            let _ = write!(text, "{:>14}", format!("{}/{}", first.backend, second.backend));
        }
        text.push('\n');
        for (name, value) in rows {
            let _ = write!(text, "{name:<20}");
            for backend in &self.backends {
                let _ = write!(text, "{:>18.3}", value(backend));
            }
            if let [first, second] = &self.backends[..] {
                let _ = write!(text, "{:>14.2}", value(first) / value(second));
            }
            text.push('\n');
        }
        if let Some(relative) = self.relative_to_bare_embree {
            let _ = writeln!(
                text,
                "bundles through this interface run at {:.0} % of a bare Embree loop",
                100.0 * relative
            );
        }
        text
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::{Instance, TriangleMesh};
    use crate::math::Affine3A;
    use std::sync::Arc;

    /// A hall: a bumpy shell of 2 n² triangles on each of six sides, seen from inside, with `blobs`
    /// bumpy spheres that share their triangles, or are copies of their own.
    fn hall(n: u32, blobs: u32, shared: bool) -> Geometry {
        let grid = |shape: &dyn Fn(f32, f32) -> Vec3| {
            let at = |i: u32| i as f32 / n as f32 * 2.0 - 1.0;
            let positions = (0..=n)
                .flat_map(|j| (0..=n).map(move |i| (i, j)))
                .map(|(i, j)| shape(at(i), at(j)))
                .collect();
            let indices = (0..n)
                .flat_map(|j| (0..n).map(move |i| j * (n + 1) + i))
                .flat_map(|a| [[a, a + 1, a + n + 2], [a, a + n + 2, a + n + 1]])
                .collect();
            TriangleMesh { positions, indices, ..Default::default() }
        };
        let bump = |p: Vec3, size: f32| {
            p * (1.0 + size * (17.0 * p.x).sin() * (13.0 * p.y).sin() * (19.0 * p.z).sin())
        };
        let sides: [fn(f32, f32) -> Vec3; 6] = [
            |u, v| Vec3::new(u, v, 1.0),
            |u, v| Vec3::new(u, v, -1.0),
            |u, v| Vec3::new(u, 1.0, v),
            |u, v| Vec3::new(u, -1.0, v),
            |u, v| Vec3::new(1.0, u, v),
            |u, v| Vec3::new(-1.0, u, v),
        ];
        let mut geometry = Geometry::default();
        for side in sides {
            geometry.meshes.push(Arc::new(grid(&|u, v| bump(side(u, v), 0.04))));
            geometry.instances.push(Instance {
                mesh: geometry.meshes.len() as u32 - 1,
                to_world: Affine3A::IDENTITY,
            });
        }
        let blob = Arc::new(grid(&|u, v| {
            let (theta, phi) = ((v + 1.0) * 0.5 * PI, u * PI);
            bump(Vec3::new(theta.sin() * phi.cos(), theta.cos(), theta.sin() * phi.sin()), 0.3)
        }));
        for i in 0..blobs {
            if i == 0 || !shared {
                geometry.meshes.push(blob.clone());
            }
            let ((x, z), (y, size)) = (point(i as usize), point(i as usize + 77));
            let to_world =
                Affine3A::from_translation(1.4 * Vec3::new(x - 0.5, 0.5 * y - 0.5, z - 0.5))
                    * Affine3A::from_scale(Vec3::splat(0.08 + 0.1 * size))
                    * Affine3A::from_rotation_y(i as f32);
            geometry.instances.push(Instance { mesh: geometry.meshes.len() as u32 - 1, to_world });
        }
        geometry
    }

    /// Rays from a pinhole in a corner of the hall, in tiles of 16 x 16 pixels.
    fn camera(count: usize) -> Vec<Ray> {
        let eye = Vec3::new(0.7, 0.3, 0.75);
        let (forward, right) = (-eye.normalize(), Vec3::Y.cross(-eye).normalize());
        let up = right.cross(forward);
        let tiles = ((count as f32).sqrt() / 16.0).ceil() as usize;
        let at = |i: usize| (i as f32 + 0.5) / (16 * tiles) as f32 * 2.0 - 1.0;
        (0..tiles * tiles * 256)
            .map(|i| {
                // 4 x 4 pixels in a packet, 4 x 4 packets in a tile.
                let (tile, packet, pixel) = (i / 256, i % 256 / 16, i % 16);
                let x = tile % tiles * 16 + packet % 4 * 4 + pixel % 4;
                let y = tile / tiles * 16 + packet / 4 * 4 + pixel / 4;
                Ray::new(eye, (forward + 0.8 * at(x) * right - 0.8 * at(y) * up).normalize())
            })
            .collect()
    }

    #[test]
    fn the_report_has_every_number() {
        let report =
            run(&hall(8, 3, true), &mut camera, Options { rays: 4096, repetitions: 1 }).unwrap();
        assert_eq!(
            (report.triangles, report.rays.camera, report.rays.bounce),
            (9 * 128, 4096, 4096)
        );
        assert_eq!(report.rays.bundle, 4096);
        for backend in &report.backends {
            let rates = backend.mrays_per_second;
            assert!(
                [rates.camera, rates.bundle, rates.bounce, rates.occlusion]
                    .iter()
                    .all(|&r| r > 0.0 && r.is_finite())
            );
            assert!(
                backend.build_seconds > 0.0 && backend.memory_bytes > 9 * 128 * 40,
                "{backend:?}"
            );
        }
        let table = report.table();
        assert_eq!(
            table.lines().count(),
            7 + usize::from(report.relative_to_bare_embree.is_some())
        );
        assert!(serde_json::to_string(&report).unwrap().contains("\"bundle\":4096"));
        if report.backends.len() == 2 {
            assert!(table.lines().next().unwrap().ends_with("embree/bvh"), "{table}");
        }
    }

    #[test]
    fn a_scene_without_hits_is_measured_too() {
        let report =
            run(&Geometry::default(), &mut camera, Options { rays: 256, repetitions: 1 }).unwrap();
        assert_eq!(report.rays.bundle, 0);
        assert!(report.table().contains("0.000"));
    }

    #[test]
    #[ignore = "a measurement of 20 s: run it alone with --nocapture"]
    fn measure_300_thousand_triangles() {
        for (name, geometry) in
            [("one level", hall(128, 4, false)), ("instances", hall(128, 300, true))]
        {
            println!(
                "{name}\n{}",
                run(&geometry, &mut camera, Options::default()).unwrap().table()
            );
        }
    }
}
