//! `lumicache render`.

use super::args::{IntegratorName, LightUnitsName, Render};
use super::terminal::{Bar, cancel_on_interrupt};
use super::{Outcome, sequence};
use lumicache::accel::Backend;
use lumicache::cache::{Cache, CacheFile, Origin, Preset, Scheme};
use lumicache::camera::{Camera, Motion};
use lumicache::error::{Error, Result};
use lumicache::film::Film;
use lumicache::fsutil;
use lumicache::geometry::Aabb;
use lumicache::import::{self, ImportOptions, LightUnits};
use lumicache::light::{EnvironmentMap, PunctualLight, Sky};
use lumicache::progress::{Phase, Progress};
use lumicache::render::{
    self, Clock, Facts, Frame, IntegratorKind, Selection, Settings,
    display::{Display, Tile},
};
use lumicache::scene::Scene;
use serde_json::Value;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Samples per pixel at quality 1.
const SPP: f32 = 16.0;
/// Relative standard error at quality 1 above which a pixel gets more samples.
const NOISE: f32 = 0.04;

pub fn run(arguments: &Render) -> Result<Outcome> {
    // Everything that can be known to be wrong is found before the work starts.
    let scheme = scheme(arguments)?;
    let selection = Selection::parse(&arguments.aov)?;
    let options = import_options(arguments);
    let sky = arguments.sky.as_deref().map(Sky::parse).transpose()?;
    let sky = sky
        .map(|s| import::sky(&s, options.light_units, arguments.env_rotate, arguments.env_scale))
        .transpose()?;
    let backend: Backend = arguments.backend.parse()?;
    let output = arguments.output.clone().unwrap_or_else(|| default_output(&arguments.scene));
    let numbered = |path: &PathBuf| match &arguments.frames {
        Some(frames) => sequence::numbered(path, frames.first),
        None => Ok(path.clone()),
    };
    let pictures = [Some(&output), arguments.preview.as_ref()].into_iter().flatten().map(numbered);
    let others = [&arguments.stats, &arguments.cache_save].into_iter().flatten().cloned().map(Ok);
    let outputs: Vec<PathBuf> = pictures.chain(others).collect::<Result<_>>()?;
    outputs.iter().try_for_each(|path| fsutil::check_writable(path))?;
    fsutil::check_distinct(&arguments.scene, &outputs)?;
    if matches!(arguments.integrator, IntegratorName::Path)
        && !(arguments.cache_load.is_empty() && arguments.cache_save.is_none())
    {
        return Err(Error::InvalidArgument(
            "--cache-load and --cache-save need --integrator cache: a path tracer has no records"
                .into(),
        ));
    }
    let pool = threads(arguments.threads)?;

    let progress = Arc::new(Progress::default());
    cancel_on_interrupt(&progress);
    let bar = Bar::new(&progress, arguments.quiet);
    let mut clock = Clock::default();
    let outcome = pool.install(|| {
        let inputs = Inputs { scheme, options, sky, backend };
        job(arguments, inputs, &selection, &output, &progress, &mut clock)
    });
    drop(bar);
    let (frame_cancelled, warnings) = outcome?;
    if !arguments.quiet {
        warnings.iter().for_each(|w| eprintln!("lumicache: warning: {w}"));
    }
    Ok(if frame_cancelled { Outcome::Cancelled } else { Outcome::Done })
}

/// What the arguments say about the scene and how to render it.
struct Inputs {
    scheme: Scheme,
    options: ImportOptions,
    sky: Option<(EnvironmentMap, Option<PunctualLight>)>,
    backend: Backend,
}

/// A run under way: what all its frames have in common.
pub struct Job<'a> {
    pub arguments: &'a Render,
    pub scene: Scene,
    pub settings: Settings,
    /// How the camera moves, if it does.
    pub motion: Option<Motion>,
    pub selection: &'a Selection,
    pub progress: &'a Progress,
    pub warnings: Vec<String>,
    scene_hash: String,
    origin: Origin,
}

/// The run itself; returns whether it was cancelled, and the warnings.
fn job(
    arguments: &Render,
    inputs: Inputs,
    selection: &Selection,
    output: &Path,
    progress: &Progress,
    clock: &mut Clock,
) -> Result<(bool, Vec<String>)> {
    let mut job = load(arguments, inputs, selection, progress, clock)?;
    let before = loaded(arguments, &job.settings.scheme, &job.origin)?;
    let cancelled = match &arguments.frames {
        Some(frames) => sequence::run(&mut job, frames, before, output, clock)?,
        None => single(&mut job, before, output, clock)?,
    };
    Ok((cancelled, job.warnings))
}

/// Reads the scene and builds it.
fn load<'a>(
    arguments: &'a Render,
    inputs: Inputs,
    selection: &'a Selection,
    progress: &'a Progress,
    clock: &mut Clock,
) -> Result<Job<'a>> {
    clock.start(Phase::Load);
    progress.start(Phase::Load, 0);
    let Inputs { scheme, options, sky, backend } = inputs;
    let mut data = import::gltf(&arguments.scene, &options)?;
    if let Some((environment, sun)) = sky {
        data.environment = Some(environment);
        data.punctual.extend(sun);
    }
    if let Some(map) = &arguments.env {
        data.environment =
            Some(import::environment(map, arguments.env_rotate, arguments.env_scale)?);
    }
    for material in &mut data.materials {
        material.multiple_scattering = arguments.multiple_scattering;
    }
    let number = camera_number(&data.cameras, arguments.camera.as_deref(), &arguments.scene)?;
    let motion = number.and_then(|i| data.motions.get_mut(i)?.take());
    let (scene_hash, hashes) = (data.hash(), data.hashes());
    clock.start(Phase::Build);
    progress.start(Phase::Build, 0);
    let (scene, warnings) = Scene::new(data, backend)?;
    let camera =
        camera(scene.cameras(), &scene.bounds(), arguments.camera.as_deref(), &arguments.scene)?;
    let settings = settings(arguments, scheme, camera)?;
    let origin = Origin::new(hashes, &settings.scheme, settings.max_bounces, scene.size());
    Ok(Job {
        arguments,
        scene,
        settings,
        motion,
        selection,
        progress,
        warnings,
        scene_hash,
        origin,
    })
}

/// Renders one picture; true if it was cancelled.
fn single(job: &mut Job, before: Option<Cache>, output: &Path, clock: &mut Clock) -> Result<bool> {
    let arguments = job.arguments;
    let mut viewer = Viewer::connect(arguments, output, job.settings.window)?;
    let (scheme, max_bounces) = (&job.settings.scheme, job.settings.max_bounces);
    let before =
        before.map(|cache| render::Caches::new(&job.scene, scheme, max_bounces, Some(cache)));
    let frame = render::frame_with(
        &job.scene,
        &job.settings,
        before,
        job.progress,
        clock,
        &mut |area, film| {
            viewer.show(area, film);
        },
    )?;
    job.warnings.extend(viewer.lost);
    clock.start(Phase::Write);
    job.progress.start(Phase::Write, 0);
    job.write(&frame, &job.settings, output, arguments.preview.as_deref(), clock)?;
    job.save(frame.cache.as_ref().filter(|_| !frame.cancelled))?;
    clock.stop();
    if let Some(path) = &arguments.stats {
        write_stats(
            path,
            &render::stats(&job.scene, &job.settings, &frame, clock, rayon::current_num_threads()),
        )?;
    }
    Ok(frame.cancelled)
}

pub fn write_stats(path: &Path, stats: &Value) -> Result<()> {
    fsutil::write_atomically(path, format!("{stats:#}\n").as_bytes())
}

impl Job<'_> {
    /// Writes the picture of a frame, and its preview.
    pub fn write(
        &self,
        frame: &Frame,
        settings: &Settings,
        output: &Path,
        preview: Option<&Path>,
        clock: &Clock,
    ) -> Result<()> {
        let arguments = self.arguments;
        if arguments.prepass_only {
            return Ok(());
        }
        let facts = Facts {
            seconds: clock.total_seconds(),
            scene_hash: self.scene_hash.clone(),
            backend: self.scene.accel().version(),
            show_records: arguments.show_records,
        };
        render::write_exr(output, frame, settings, self.selection, &facts)?;
        if let Some(preview) = preview {
            render::write_preview(
                preview,
                frame,
                settings,
                arguments.exposure,
                arguments.show_records,
            )?;
        }
        Ok(())
    }

    /// Saves the records, if the user wants them and there are any.
    pub fn save(&self, cache: Option<&Cache>) -> Result<()> {
        match (&self.arguments.cache_save, cache) {
            (Some(path), Some(cache)) => CacheFile::new(cache, self.origin.clone()).write(path),
            _ => Ok(()),
        }
    }
}

/// Shows finished tiles in a tev viewer, if there is one.
pub struct Viewer {
    display: Option<Display>,
    /// What to tell the user if the viewer went away.
    pub lost: Option<String>,
}

impl Viewer {
    /// Connects to the viewer that the arguments name, if they name one.
    pub fn connect(arguments: &Render, output: &Path, [x0, y0, x1, y1]: [u32; 4]) -> Result<Self> {
        let connect = |address: &String| {
            Display::connect(address, &title(output), x1 - x0, y1 - y0, &["R", "G", "B"])
        };
        Ok(Self {
            display: arguments.display_server.as_ref().map(connect).transpose()?,
            lost: None,
        })
    }

    /// Shows an area of the film.
    pub fn show(&mut self, [x0, y0, x1, y1]: [u32; 4], film: &Film) {
        if let Some(display) = &mut self.display {
            let data: Vec<f32> =
                film.area([x0, y0, x1, y1]).iter().flat_map(|c| c.to_array()).collect();
            let tile = Tile { x: x0, y: y0, width: x1 - x0, height: y1 - y0 };
            self.lost = self.lost.take().or(display.update(tile, &data));
        }
    }
}

/// The cache of the files that the user wants to begin with, if any.
fn loaded(arguments: &Render, scheme: &Scheme, origin: &Origin) -> Result<Option<Cache>> {
    let Some((first, others)) = arguments.cache_load.split_first() else { return Ok(None) };
    let mut all = CacheFile::read(first)?;
    for path in others {
        all.merge(CacheFile::read(path)?, arguments.cache_reuse, path)?;
    }
    all.into_cache(scheme.clone(), origin, arguments.cache_reuse, first).map(Some)
}

pub fn import_options(arguments: &Render) -> ImportOptions {
    let light_units = match arguments.light_units {
        LightUnitsName::Photometric => LightUnits::Photometric,
        LightUnitsName::Radiometric => LightUnits::Radiometric,
    };
    ImportOptions { light_units, ..ImportOptions::default() }
}

fn title(output: &Path) -> String {
    output.file_name().map_or_else(|| "lumicache".to_owned(), |n| n.to_string_lossy().into_owned())
}

fn default_output(scene: &Path) -> PathBuf {
    // Not `with_extension`: `room.v2.gltf` becomes `room.v2.exr`.
    let mut name = scene.file_stem().unwrap_or_default().to_owned();
    name.push(".exr");
    name.into()
}

pub fn threads(count: Option<usize>) -> Result<rayon::ThreadPool> {
    if count == Some(0) || count.is_some_and(|n| n > 4096) {
        return Err(Error::InvalidArgument("--threads must be between 1 and 4096".into()));
    }
    rayon::ThreadPoolBuilder::new()
        .num_threads(count.unwrap_or(0))
        .start_handler(|_| lumicache::ffi::mxcsr::flush_denormals())
        .build()
        .map_err(|e| Error::Device(format!("threads could not be started: {e}")))
}

fn scheme(arguments: &Render) -> Result<Scheme> {
    let mut scheme = preset(&arguments.preset)?.scheme();
    if !(arguments.quality.is_finite() && (0.01..=100.0).contains(&arguments.quality)) {
        return Err(Error::InvalidArgument("--quality must be between 0.01 and 100".into()));
    }
    scheme.scale_quality(arguments.quality);
    let flags = [
        ("gather.rays", arguments.rays.map(|n| n.to_string())),
        ("validity.error", arguments.error.map(|e| e.to_string())),
    ];
    let flags = flags.into_iter().filter_map(|(key, value)| Some((key.to_owned(), value?)));
    let set: Vec<_> = arguments.set.iter().map(|text| pair(text)).collect::<Result<_>>()?;
    scheme.set_all(flags.chain(set))?;
    Ok(scheme)
}

/// The preset with this name, or of this file if it ends in `.toml`.
pub fn preset(name: &str) -> Result<Preset> {
    if name.ends_with(".toml") {
        Preset::from_file(Path::new(name))
    } else {
        Preset::by_name(name).cloned()
    }
}

/// The setting and its value that `--set` gives.
pub fn pair(text: &str) -> Result<(String, String)> {
    let (key, value) = text
        .split_once('=')
        .ok_or_else(|| Error::InvalidArgument(format!("--set {text}: expected KEY=VALUE")))?;
    Ok((key.trim().to_owned(), value.trim().to_owned()))
}

/// The camera called `wanted`, or with that number; the first without one, and one that frames the
/// scene where the file has none.
pub fn camera(
    cameras: &[Camera],
    bounds: &Aabb,
    wanted: Option<&str>,
    file: &Path,
) -> Result<Camera> {
    let number = camera_number(cameras, wanted, file)?;
    Ok(number.map_or_else(|| import::default_camera(bounds), |i| cameras[i].clone()))
}

/// The number of the camera that [`camera`] takes, if the file has it.
fn camera_number(cameras: &[Camera], wanted: Option<&str>, file: &Path) -> Result<Option<usize>> {
    let Some(wanted) = wanted else { return Ok((!cameras.is_empty()).then_some(0)) };
    let by_name = cameras.iter().position(|c| c.name == wanted);
    let by_number = || wanted.parse::<usize>().ok().filter(|i| *i < cameras.len());
    by_name.or_else(by_number).map(Some).ok_or_else(|| {
        let names: Vec<_> =
            cameras.iter().enumerate().map(|(i, c)| format!("{i} `{}`", c.name)).collect();
        let known = if names.is_empty() { "none".to_owned() } else { names.join(", ") };
        Error::InvalidArgument(format!(
            "{}: there is no camera `{wanted}`; the cameras are {known}",
            file.display()
        ))
    })
}

fn settings(arguments: &Render, scheme: Scheme, camera: Camera) -> Result<Settings> {
    let size = match &arguments.size {
        Some(text) => parse_size(text)?,
        None => {
            let aspect = camera.aspect.unwrap_or(16.0 / 9.0).clamp(0.05, 20.0);
            [(720.0 * aspect).round().max(1.0) as u32, 720]
        }
    };
    let window = match &arguments.crop {
        Some(text) => parse_window(text)?,
        None => [0, 0, size[0], size[1]],
    };
    let spp = arguments.spp.unwrap_or_else(|| (SPP * arguments.quality).round().max(1.0) as u32);
    if !(1..=1 << 20).contains(&spp) {
        return Err(Error::InvalidArgument("--spp must be between 1 and 1048576".into()));
    }
    let integrator = match arguments.integrator {
        IntegratorName::Cache => IntegratorKind::Cache,
        IntegratorName::Path => IntegratorKind::Path,
        IntegratorName::Bdpt => IntegratorKind::Bdpt,
    };
    // Who names a number of samples, and who renders a reference, gets the same for every pixel.
    let uniform = arguments.spp.is_some() || integrator != IntegratorKind::Cache;
    Ok(Settings {
        integrator,
        scheme,
        camera,
        size,
        window,
        spp,
        noise: if uniform { 0.0 } else { NOISE / arguments.quality.sqrt() },
        max_bounces: arguments.max_bounces.unwrap_or(u32::MAX),
        seed: arguments.seed,
        prepass_only: arguments.prepass_only,
    })
}

pub fn parse_size(text: &str) -> Result<[u32; 2]> {
    let parse = || {
        let (w, h) = text.split_once(['x', 'X'])?;
        Some([w.parse().ok()?, h.parse().ok()?])
    };
    parse().filter(|s: &[u32; 2]| s.iter().all(|&n| n > 0)).ok_or_else(|| {
        Error::InvalidArgument(format!(
            "--size {text}: expected WIDTHxHEIGHT in pixels, such as 640x480"
        ))
    })
}

fn parse_window(text: &str) -> Result<[u32; 4]> {
    let numbers: Option<Vec<u32>> = text.split(',').map(|n| n.trim().parse().ok()).collect();
    numbers.and_then(|n| n.try_into().ok()).ok_or_else(|| {
        Error::InvalidArgument(format!("--crop {text}: expected x0,y0,x1,y1 in pixels"))
    })
}
