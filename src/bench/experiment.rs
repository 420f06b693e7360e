//! The caching schemes compared on equal terms: as many records and as many rays for each, the same
//! shading points, and the error of the irradiance there.
//!
//! Only the first level is cached, and gathers trace whole paths. So schemes differ in where they
//! put their records and in how they interpolate. The reference is the same estimate at every
//! shading point, with many more rays.

use super::page;
use super::report::{Report, Row};
use super::search::{Attempt, Stage, TOLERANCE};
use crate::cache::{Contents, Preset, Scheme};
use crate::compare::{self, compare};
use crate::error::{Error, Result};
use crate::fsutil::{check_distinct, write_atomically};
use crate::gather::{Density, HemisphereSamples, Layout, NoDeeper};
use crate::imagefile::{Attribute, Picture, SampleKind, exr, ldr};
use crate::math::{Color, luminance};
use crate::progress::{Phase, Progress};
use crate::render::{Settings, camera_sample};
use crate::sampling::{hash, stream};
use crate::scene::Scene;
use crate::transport::{PathTracer, SceneProbe, View};
use rayon::prelude::*;
use std::path::{Path, PathBuf};

/// Bounds of the areas that all schemes share, unless a plan says otherwise: schemes differ in how
/// they use the room between.
const BOUNDS: [(&str, &str); 3] =
    [("validity.normal_limit", "1"), ("radius.min_pixels", "1"), ("radius.max_radius", "0.3")];
/// The search begins with this share of the rays, but no fewer than `ROUGH_RAYS`: the number of
/// records depends little on them.
const ROUGH: u32 = 8;
const ROUGH_RAYS: u32 = 256;
/// The file of the reference.
const REFERENCE: &str = "reference.exr";
/// What [`run`] writes beside pictures of the rows.
const FILES: [&str; 5] = [REFERENCE, "reference.png", "report.json", "report.csv", "index.html"];
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

impl Plan {
    /// The files that [`run`] writes to `folder` whatever is compared. A reference that stands
    /// there already stays as it is.
    pub fn outputs(&self, folder: &Path) -> Vec<PathBuf> {
        let is_reference = |path: &PathBuf| {
            let reference = self.reference.as_deref().filter(|_| path.ends_with(REFERENCE));
            reference.is_some_and(|r| check_distinct(&[r], std::slice::from_ref(path)).is_err())
        };
        FILES.map(|name| folder.join(name)).into_iter().filter(|p| !is_reference(p)).collect()
    }
}

/// Runs `plan` on what the camera of `settings` sees and leaves `report.json`, `report.csv`,
/// `index.html`, `reference.exr` and pictures in `folder`.
///
/// # Errors
/// [`Error::InvalidArgument`] for an unknown preset, an empty plan or paths without bounces; those
/// of reading the reference and of writing; [`Error::Cancelled`].
pub fn run(
    scene: &Scene, settings: &Settings, plan: &Plan, title: &str, folder: &Path,
    progress: &Progress,
) -> Result<Report> {
    let schemes = plan.presets.iter().map(|text| base(text, plan)).collect::<Result<Vec<_>>>()?;
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
    let rays: Vec<_> = (0..settings.size[0] * settings.size[1])
        .map(|p| camera_sample(settings, p, 0, u32::MAX))
        .map(|s| (s.camera, s.seed))
        .collect();
    let stage = Stage { tracer, settings, seen: tracer.views(&rays, None), progress };
    let reference = stage.reference(plan)?;
    let path = folder.join(REFERENCE);
    if plan.outputs(folder).contains(&path) {
        exr::write(&path, &reference.picture)?;
    }
    stage.picture(&folder.join("reference.png"), &reference.colors, reference.exposure)?;
    let mut report = Report {
        title: title.to_owned(),
        size: settings.size,
        points: stage.seen.iter().flatten().count(),
        rays: plan.rays,
        reference_rays: if plan.reference.is_some() { 0 } else { plan.reference_rays },
        noise: reference.noise,
        noise_rmse: reference.noise_rmse,
        rows: Vec::new(),
    };
    for (preset, base) in plan.presets.iter().zip(schemes) {
        base.check()?;
        let mut scale = 1.0;
        for &wanted in &plan.records {
            let mut rough = base.clone();
            rough.gather.rays = (base.gather.rays / ROUGH).max(ROUGH_RAYS);
            if rough.gather.rays < base.gather.rays {
                stage.search(&rough, wanted, &mut scale)?;
            }
            let attempt = stage.search(&base, wanted, &mut scale)?;
            report.rows.push(stage.row(preset, wanted, &attempt, &reference, folder)?);
        }
    }
    let json = serde_json::to_string_pretty(&report).map_err(|e| Error::Device(e.to_string()))?;
    write_atomically(&folder.join("report.json"), json.as_bytes())?;
    write_atomically(&folder.join("report.csv"), report.csv().as_bytes())?;
    write_atomically(&folder.join("index.html"), page::html(&report, folder)?.as_bytes())?;
    Ok(report)
}

/// The variant `text` with what `plan` wants of all schemes.
fn base(text: &str, plan: &Plan) -> Result<Scheme> {
    let mut scheme = variant(text, &plan.settings)?;
    (scheme.gather.rays, scheme.gather.noise) = (plan.rays, 0.0);
    (scheme.levels, scheme.contents) = (1, Contents::Indirect);
    Ok(scheme)
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

/// What rows are compared with.
struct Reference {
    picture: Picture,
    colors: Vec<Color>,
    /// The exposure of all pictures, in stops.
    exposure: f32,
    /// relMSE and RMSE of the reference itself, where they are known.
    noise: Option<f64>,
    noise_rmse: Option<f64>,
}

impl Stage<'_> {
    /// The reference that `plan` names, or a new one.
    fn reference(&self, plan: &Plan) -> Result<Reference> {
        let picture = match &plan.reference {
            Some(path) => exr::read(path)?,
            None => self.trace_reference(plan.reference_rays)?,
        };
        let [noise, noise_rmse] = NOISE.map(|name| match picture.attribute(name) {
            Some(Attribute::Double(noise)) => Some(*noise),
            _ => None,
        });
        // Black where a channel is missing, which the comparison will complain of.
        let colors = picture.colors("").unwrap_or_default();
        let points = self.seen.iter().flatten().count().max(1) as f32;
        let mean = colors.iter().map(|c| luminance(*c)).sum::<f32>() / points;
        let exposure = (0.3 / mean.max(f32::MIN_POSITIVE)).log2();
        Ok(Reference { picture, colors, exposure, noise, noise_rmse })
    }

    /// Irradiance at each pixel by `rays` rays in two halves, whose difference tells the noise.
    fn trace_reference(&self, rays: u32) -> Result<Picture> {
        let half = |number: u64| {
            self.progress.start(Phase::Fill, self.seen.len() as u64);
            let gather = |samples: &mut HemisphereSamples, (p, seen): (usize, &Option<View>)| {
                self.progress.advance(1);
                let at = &seen.as_ref().filter(|_| !self.progress.is_cancelled())?.0;
                let seed = hash(&[self.settings.seed, stream::REFERENCE, number, p as u64]);
                samples.gather(&SceneProbe::new(self.tracer), at, 0, &NoDeeper, seed);
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

    /// The error of `attempt`, whose pictures go to `folder`.
    fn row(
        &self, preset: &str, wanted: usize, attempt: &Attempt, reference: &Reference, folder: &Path,
    ) -> Result<Row> {
        let (image, uncovered) = self.irradiance(attempt, attempt.cache.scheme().gather.rays);
        let found =
            compare(&self.layers(&image), &reference.picture, &compare::Options::default())?;
        let plain = |c: char| if c.is_ascii_alphanumeric() || ".-".contains(c) { c } else { '_' };
        let file: String = preset.chars().map(plain).collect();
        let (picture, difference) =
            (format!("{file}-{wanted}.png"), format!("{file}-{wanted}-difference.png"));
        let differences: Vec<Color> =
            image.iter().zip(&reference.colors).map(|(x, r)| 4.0 * (*x - *r).abs()).collect();
        self.picture(&folder.join(&picture), &image, reference.exposure)?;
        self.picture(&folder.join(&difference), &differences, reference.exposure)?;
        let own_rmse = |n: f64| (found.rmse * found.rmse - n * n).max(0.0).sqrt();
        let records = attempt.records();
        Ok(Row {
            preset: preset.to_owned(),
            wanted,
            records,
            equal: (records as f64 / wanted as f64 - 1.0).abs() <= TOLERANCE,
            error: attempt.cache.scheme().validity.error,
            passes: attempt.passes,
            seconds: attempt.seconds,
            uncovered,
            rmse: found.rmse,
            relmse: found.relmse,
            own_rmse: reference.noise_rmse.map(own_rmse),
            own_relmse: reference.noise.map(|n| (found.relmse - n).max(0.0)),
            mape: found.mape,
            mean_ratio: found.mean_ratio,
            picture,
            difference,
        })
    }

    /// Irradiance at each pixel by the records, and the number of points that have none: `rays`
    /// are gathered there.
    fn irradiance(&self, attempt: &Attempt, rays: u32) -> (Vec<Color>, usize) {
        let answer = |(p, seen): (usize, &Option<View>)| {
            let Some((at, ..)) = seen else { return (Color::ZERO, 0) };
            if let Some(answer) = attempt.cache.lookup(0, at, attempt.limits[p]) {
                return (answer.irradiance, 0);
            }
            let mut samples = HemisphereSamples::new(Layout::polar(rays), Density::Cosine);
            let seed = hash(&[self.settings.seed, stream::NO_RECORD, p as u64]);
            samples.gather(&SceneProbe::new(self.tracer), at, 0, &NoDeeper, seed);
            (samples.irradiance(), 1)
        };
        let found: Vec<(Color, usize)> = self.seen.par_iter().enumerate().map(answer).collect();
        (found.iter().map(|f| f.0).collect(), found.iter().map(|f| f.1).sum())
    }

    /// Colours as a picture whose alpha says where there is a shading point.
    fn layers(&self, pixels: &[Color]) -> Picture {
        let alpha = self.seen.iter().map(|s| f32::from(u8::from(s.is_some()))).collect();
        let mut picture = Picture::new(self.settings.size);
        picture.add_colors("", SampleKind::Float, pixels);
        picture.add("A", SampleKind::Float, alpha);
        picture
    }

    fn picture(&self, path: &Path, pixels: &[Color], exposure: f32) -> Result<()> {
        let [width, height] = self.settings.size;
        ldr::write(path, width, height, &ldr::to_srgb8(pixels, exposure))
    }
}
