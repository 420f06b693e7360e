//! The caching schemes compared on equal terms: as many records, as many rays for each, the same
//! shading points, and the error of what they say there.
//!
//! Only the first level is cached, and gathers trace whole paths: what differs is where a scheme
//! puts its records and how it interpolates. The reference is the same estimate at every
//! shading point, with many more rays.

use super::page;
use crate::cache::{Appearance, Cache, Contents, LevelPoints, Preset, Schedule, Scheme};
use crate::compare::{self, compare};
use crate::error::{Error, Result};
use crate::fsutil::write_atomically;
use crate::gather::{Density, HemisphereSamples, Layout, NoDeeper};
use crate::geometry::SurfacePoint;
use crate::imagefile::exr::{self, Attribute, Channel, Layers, SampleKind};
use crate::imagefile::ldr;
use crate::math::{Color, luminance};
use crate::progress::{Phase, Progress};
use crate::render::{Caches, Gloss, Job, Settings, Spot, camera_sample, pixel_order};
use crate::sampling::hash;
use crate::scene::Scene;
use crate::transport::{PathTracer, SceneProbe};
use rayon::prelude::*;
use serde::Serialize;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Instant;

/// Numbers of records within this share of the wanted one are as good as equal.
const TOLERANCE: f64 = 0.05;
/// Most errors that are tried for one number of records.
const ATTEMPTS: usize = 16;
/// Bounds of the areas that all schemes share, unless a plan says otherwise: what differs is how
/// they use the room between.
const BOUNDS: [(&str, &str); 3] =
    [("validity.normal_limit", "1"), ("radius.min_pixels", "1"), ("radius.max_radius", "0.3")];
/// The search begins with this share of the rays, but no fewer than `ROUGH_RAYS`: the number of
/// records depends little on them.
const ROUGH: u32 = 8;
const ROUGH_RAYS: u32 = 256;
/// Attributes of a reference file: its own relMSE and RMSE.
const NOISE: [&str; 2] = ["noise", "noise_rmse"];

/// What to compare.
#[derive(Clone, Debug)]
pub struct Plan {
    /// What [`variant`] understands.
    pub presets: Vec<String>,
    /// Settings of all of them, keys and values; those of a variant come later.
    pub settings: Vec<(String, String)>,
    /// Numbers of records.
    pub records: Vec<usize>,
    /// Rays per record, the same for all.
    pub rays: u32,
    /// Rays per pixel of the reference.
    pub reference_rays: u32,
    /// A reference of an earlier run with the same picture; `None` to make one.
    pub reference: Option<PathBuf>,
}

/// One scheme with one number of records.
#[derive(Clone, Debug, Serialize)]
pub struct Row {
    /// The preset, as the plan names it.
    pub preset: String,
    /// Wanted number of records.
    pub wanted: usize,
    /// The nearest one that was found.
    pub records: usize,
    /// It is within 5 %.
    pub equal: bool,
    /// The allowed error that gives this number, all else being scaled with it as
    /// [`Scheme::scale_error`] does.
    pub error: f32,
    /// Passes of refinement.
    pub passes: u32,
    /// Wall seconds of the fill.
    pub seconds: f64,
    /// Shading points at which no record was valid; light is gathered there.
    pub uncovered: usize,
    /// Root of the mean squared error of the irradiance.
    pub rmse: f64,
    /// Mean of (x - r)²/(r² + 0.01).
    pub relmse: f64,
    /// `rmse` less the noise of the reference, which is in it squared; `None` where that is not
    /// known.
    pub own_rmse: Option<f64>,
    /// `relmse` less that of the reference itself.
    pub own_relmse: Option<f64>,
    /// Mean of |x - r|/(|r| + 0.01).
    pub mape: f64,
    /// Sum of the irradiance over that of the reference.
    pub mean_ratio: Option<f64>,
    /// The picture of its irradiance, in the folder of the report.
    pub picture: String,
    /// Its difference to the reference, fourfold.
    pub difference: String,
}

/// The outcome.
#[derive(Clone, Debug, Serialize)]
pub struct Report {
    /// The scene.
    pub title: String,
    /// Columns and rows.
    pub size: [u32; 2],
    /// Shading points.
    pub points: usize,
    /// Rays per record.
    pub rays: u32,
    /// Rays per pixel of the reference, 0 where it was read.
    pub reference_rays: u32,
    /// relMSE of the reference itself; every row's contains it. `None` where it is not known.
    pub noise: Option<f64>,
    /// RMSE of the reference itself.
    pub noise_rmse: Option<f64>,
    /// Scheme by scheme.
    pub rows: Vec<Row>,
}

/// What all schemes have in common.
struct Experiment<'a> {
    tracer: PathTracer<'a>,
    settings: &'a Settings,
    /// Shading point of each pixel.
    seen: Vec<Option<(SurfacePoint, Appearance)>>,
    progress: &'a Progress,
}

/// Logarithms of a scale and of the number of records that it gives.
type Sample = Option<(f64, f64)>;

/// A filled cache, and for each pixel the number of records that it may use.
struct Attempt {
    cache: Cache,
    limits: Vec<u32>,
    passes: u32,
    seconds: f64,
}

/// Runs `plan` on what the camera of `settings` sees and leaves `report.json`, `report.csv`,
/// `index.html`, `reference.exr` and pictures in `folder`.
///
/// # Errors
/// [`Error::InvalidArgument`] for an unknown preset, an empty plan or paths without bounces; those
/// of reading the reference and of writing; [`Error::Cancelled`].
pub fn run(
    scene: &Scene,
    settings: &Settings,
    plan: &Plan,
    title: &str,
    folder: &Path,
    progress: &Progress,
) -> Result<Report> {
    let schemes = plan
        .presets
        .iter()
        .map(|text| variant(text, &plan.settings))
        .collect::<Result<Vec<_>>>()?;
    if schemes.is_empty()
        || plan.records.is_empty()
        || plan.records.contains(&0)
        || settings.max_bounces == 0
    {
        return Err(Error::InvalidArgument(
            "a report needs presets, numbers of records above 0, and bounces".into(),
        ));
    }
    let tracer = PathTracer { scene, max_bounces: settings.max_bounces };
    let pixels: Vec<u32> = (0..settings.size[0] * settings.size[1]).collect();
    let rays: Vec<_> = pixels
        .iter()
        .map(|&p| camera_sample(settings, p, 0, u32::MAX))
        .map(|s| (s.camera, s.seed))
        .collect();
    let experiment = Experiment { tracer, settings, seen: tracer.appearances(&rays), progress };
    let points = experiment.seen.iter().flatten().count();
    let reference = match &plan.reference {
        Some(path) => exr::read(path)?,
        None => experiment.reference(plan.reference_rays)?,
    };
    exr::write(&folder.join("reference.exr"), &reference)?;
    let [noise, noise_rmse] = NOISE.map(|name| match reference.attribute(name) {
        Some(Attribute::Double(noise)) => Some(*noise),
        _ => None,
    });
    let mut report = Report {
        title: title.to_owned(),
        size: settings.size,
        points,
        rays: plan.rays,
        reference_rays: if plan.reference.is_some() { 0 } else { plan.reference_rays },
        noise,
        noise_rmse,
        rows: Vec::new(),
    };
    let brightness = colors(&reference);
    let mean = brightness.iter().map(|c| luminance(*c)).sum::<f32>() / points.max(1) as f32;
    let exposure = (0.3 / mean.max(f32::MIN_POSITIVE)).log2();
    experiment.picture(&folder.join("reference.png"), &brightness, exposure)?;
    for (preset, scheme) in plan.presets.iter().zip(schemes) {
        let mut base = scheme;
        (base.gather.rays, base.gather.noise) = (plan.rays, 0.0);
        (base.levels, base.contents) = (1, Contents::Indirect);
        base.check()?;
        let file: String = preset
            .chars()
            .map(|c| if c.is_ascii_alphanumeric() || ".-".contains(c) { c } else { '_' })
            .collect();
        let mut scale = 1.0;
        for &wanted in &plan.records {
            let mut rough = base.clone();
            rough.gather.rays = (base.gather.rays / ROUGH).max(ROUGH_RAYS);
            if rough.gather.rays < base.gather.rays {
                experiment.search(&rough, wanted, &mut scale)?;
            }
            let attempt = experiment.search(&base, wanted, &mut scale)?;
            let (image, uncovered) = experiment.irradiance(&attempt, plan.rays);
            let found =
                compare(&experiment.layers(&image), &reference, &compare::Options::default())?;
            let records = attempt.records();
            let name = |kind: &str| format!("{file}-{wanted}{kind}.png");
            let (picture, difference) = (name(""), name("-difference"));
            let differences: Vec<Color> =
                image.iter().zip(&brightness).map(|(x, r)| 4.0 * (*x - *r).abs()).collect();
            experiment.picture(&folder.join(&picture), &image, exposure)?;
            experiment.picture(&folder.join(&difference), &differences, exposure)?;
            report.rows.push(Row {
                preset: preset.clone(),
                wanted,
                records,
                equal: (records as f64 / wanted as f64 - 1.0).abs() <= TOLERANCE,
                error: attempt.cache.scheme().validity.error,
                passes: attempt.passes,
                seconds: attempt.seconds,
                uncovered,
                rmse: found.rmse,
                relmse: found.relmse,
                own_rmse: noise_rmse.map(|n| (found.rmse * found.rmse - n * n).max(0.0).sqrt()),
                own_relmse: noise.map(|n| (found.relmse - n).max(0.0)),
                mape: found.mape,
                mean_ratio: found.mean_ratio,
                picture,
                difference,
            });
        }
    }
    let json = serde_json::to_string_pretty(&report).map_err(|e| Error::Device(e.to_string()))?;
    write_atomically(&folder.join("report.json"), json.as_bytes())?;
    write_atomically(&folder.join("report.csv"), report.csv().as_bytes())?;
    write_atomically(&folder.join("index.html"), page::html(&report, folder)?.as_bytes())?;
    Ok(report)
}

/// The scheme that `text` names: a preset, and settings behind colons, as in
/// `ward-heckbert92:clamping=none:radius.min_pixels=0`. Before those it gets the bounds that all
/// have in common, normals up to 1 radian apart and radii from 1 pixel to 0.3 of the scene's
/// diagonal, and then `settings`.
///
/// # Errors
/// [`Error::InvalidArgument`] naming what there is none of, or what a setting takes.
pub fn variant(text: &str, settings: &[(String, String)]) -> Result<Scheme> {
    let mut parts = text.split(':');
    let mut scheme = Preset::by_name(parts.next().unwrap_or_default())?.scheme();
    let own: Result<Vec<_>> = parts
        .map(|part| {
            part.split_once('=').ok_or_else(|| {
                Error::InvalidArgument(format!("preset `{text}`: expected KEY=VALUE, not `{part}`"))
            })
        })
        .collect();
    let all = settings.iter().map(|(key, value)| (key.as_str(), value.as_str()));
    scheme.set_all(BOUNDS.into_iter().chain(all).chain(own?))?;
    Ok(scheme)
}

impl Attempt {
    fn records(&self) -> usize {
        self.cache.level(0).map_or(0, |l| l.records().len())
    }
}

impl Experiment<'_> {
    /// Irradiance at each pixel by `rays` rays in two halves, whose difference tells the noise.
    fn reference(&self, rays: u32) -> Result<Layers> {
        let half = |number: u64| {
            self.progress.start(Phase::Fill, self.seen.len() as u64);
            let gather =
                |samples: &mut HemisphereSamples,
                 (p, seen): (usize, &Option<(SurfacePoint, Appearance)>)| {
                    self.progress.advance(1);
                    let at = &seen.as_ref().filter(|_| !self.progress.is_cancelled())?.0;
                    samples.gather(
                        &SceneProbe::new(self.tracer),
                        at,
                        0,
                        &NoDeeper,
                        hash(&[self.settings.seed, 3, number, p as u64]),
                    );
                    Some(samples.irradiance())
                };
            let samples =
                || HemisphereSamples::new(Layout::polar((rays / 2).max(16)), Density::Cosine);
            self.seen
                .par_iter()
                .enumerate()
                .map_init(samples, gather)
                .map(Option::unwrap_or_default)
                .collect::<Vec<Color>>()
        };
        let (a, b) = (half(0), half(1));
        if self.progress.is_cancelled() {
            return Err(Error::Cancelled);
        }
        let mean: Vec<Color> = a.iter().zip(&b).map(|(a, b)| 0.5 * (*a + *b)).collect();
        let mut reference = self.layers(&mean);
        // The halves differ by twice the variance of each, the mean has half of that variance.
        let halves = compare(&self.layers(&a), &self.layers(&b), &compare::Options::default())?;
        for (name, value) in NOISE.into_iter().zip([0.25 * halves.relmse, 0.5 * halves.rmse]) {
            reference.attributes.push((name.into(), Attribute::Double(value)));
        }
        Ok(reference)
    }

    /// A cache with `wanted` records or as near to that as could be found, from `scale` times the
    /// errors of `base` on; leaves the factor that was found.
    fn search(&self, base: &Scheme, wanted: usize, scale: &mut f32) -> Result<Attempt> {
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
        let (one_pass, refined) =
            (scheme.schedule == Schedule::OnePass, scheme.refinement.is_some());
        let round = if scheme.schedule.is_by_row() { self.settings.size[0] as usize } else { 0 };
        let mut pixels = pixel_order(&Settings { scheme: scheme.clone(), ..self.settings.clone() });
        pixels.retain(|&p| self.seen[p as usize].is_some());
        let (points, appearance): (Vec<_>, Vec<_>) =
            pixels.iter().filter_map(|&p| self.seen[p as usize]).unzip();
        let points = LevelPoints { points, round };
        self.progress.start(Phase::Fill, points.points.len() as u64);
        let start = Instant::now();
        let probe = SceneProbe::new(self.tracer);
        let mut cache = Cache::new(scheme, self.settings.max_bounces, self.tracer.scene.size());
        if cache.scheme().whole() {
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
        let order = cache.scheme().glossy().order;
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

    /// Irradiance at each pixel by the records, and the number of points that have none.
    fn irradiance(&self, attempt: &Attempt, rays: u32) -> (Vec<Color>, usize) {
        let look = |(p, seen): (usize, &Option<(SurfacePoint, Appearance)>)| {
            let Some((at, _)) = seen else { return (Color::ZERO, 0) };
            if let Some(answer) = attempt.cache.lookup(0, at, attempt.limits[p]) {
                return (answer.irradiance, 0);
            }
            let mut samples = HemisphereSamples::new(Layout::polar(rays), Density::Cosine);
            samples.gather(
                &SceneProbe::new(self.tracer),
                at,
                0,
                &NoDeeper,
                hash(&[self.settings.seed, 4, p as u64]),
            );
            (samples.irradiance(), 1)
        };
        let found: Vec<(Color, usize)> = self.seen.par_iter().enumerate().map(look).collect();
        (found.iter().map(|f| f.0).collect(), found.iter().map(|f| f.1).sum())
    }

    /// Colours as a picture whose alpha says where there is a shading point.
    fn layers(&self, pixels: &[Color]) -> Layers {
        let channel =
            |name: &str, samples| Channel { name: name.into(), kind: SampleKind::Float, samples };
        let color = |k: usize| pixels.iter().map(|c| c[k]).collect();
        let alpha = self.seen.iter().map(|s| f32::from(u8::from(s.is_some()))).collect();
        let channels = vec![
            channel("R", color(0)),
            channel("G", color(1)),
            channel("B", color(2)),
            channel("A", alpha),
        ];
        Layers {
            width: self.settings.size[0],
            height: self.settings.size[1],
            channels,
            ..Layers::default()
        }
    }

    fn picture(&self, path: &Path, pixels: &[Color], exposure: f32) -> Result<()> {
        ldr::write_png(
            path,
            self.settings.size[0],
            self.settings.size[1],
            &ldr::to_srgb8(pixels, exposure),
        )
    }
}

/// The colours of a reference; black where a channel is missing, which comparing will complain of.
fn colors(layers: &Layers) -> Vec<Color> {
    let plane = |name: &str| layers.channel(name).map(|c| c.samples.as_slice()).unwrap_or_default();
    let [r, g, b] = ["R", "G", "B"].map(plane);
    r.iter().zip(g).zip(b).map(|((r, g), b)| Color::new(*r, *g, *b)).collect()
}

impl Report {
    /// The rows as comma-separated values with a header.
    pub fn csv(&self) -> String {
        let mut text =
            "preset,wanted,records,equal,error,passes,seconds,uncovered,rmse,relmse,own_rmse,own_relmse,mape,mean_ratio\n"
                .to_owned();
        let optional = |x: Option<f64>| x.map_or_else(String::new, |x| format!("{x:.6e}"));
        for r in &self.rows {
            let mean = r.mean_ratio.map_or_else(String::new, |m| format!("{m:.6}"));
            text += &format!(
                "{},{},{},{},{},{},{:.3},{},{:.6e},{:.6e},{},{},{:.6e},{mean}\n",
                r.preset,
                r.wanted,
                r.records,
                r.equal,
                r.error,
                r.passes,
                r.seconds,
                r.uncovered,
                r.rmse,
                r.relmse,
                optional(r.own_rmse),
                optional(r.own_relmse),
                r.mape
            );
        }
        text
    }

    /// The rows as a table for people.
    pub fn text(&self) -> String {
        let width = self.rows.iter().map(|r| r.preset.len()).max().unwrap_or(0).max(16) + 2;
        let mut text = format!(
            "{:<width$}{:>8}{:>9}{:>10}{:>12}{:>12}{:>12}{:>12}{:>9}\n",
            "preset",
            "wanted",
            "records",
            "error",
            "rmse",
            "relmse",
            "own rmse",
            "own relmse",
            "mean"
        );
        let optional = |x: Option<f64>| x.map_or_else(|| "-".to_owned(), |x| format!("{x:.4e}"));
        for r in &self.rows {
            let mean = r.mean_ratio.map_or_else(|| "-".to_owned(), |m| format!("{m:.4}"));
            let mark = if r.equal { ' ' } else { '*' };
            text += &format!(
                "{:<width$}{:>8}{:>8}{mark}{:>10.3e}{:>12.4e}{:>12.4e}{:>12}{:>12}{mean:>9}\n",
                r.preset,
                r.wanted,
                r.records,
                r.error,
                r.rmse,
                r.relmse,
                optional(r.own_rmse),
                optional(r.own_relmse)
            );
        }
        if let Some(noise) = self.noise {
            text += &format!(
                "relMSE of the reference itself: {noise:.2e}; own errors are without the reference's\n"
            );
        }
        if self.rows.iter().any(|r| !r.equal) {
            text += "* more than 5 % from the wanted number: no error that was tried gives it\n";
        }
        text
    }
}
