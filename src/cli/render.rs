//! `lumicache render`.

use super::args::{DenoiseName, IntegratorName, LightUnitsName, Render};
use super::denoiser::places;
use super::info::BENT_LIGHT;
use super::presets::{is_file, pair, preset};
use super::tables::tables;
use super::terminal::{in_file, on_threads, parse_size, print, thread_count, warn};
use lumicache::accel::Backend;
use lumicache::cache::Scheme;
use lumicache::error::{Error, Result};
use lumicache::film::Film;
use lumicache::fsutil;
use lumicache::imagefile::{Exposure, check_extension, exr, ldr};
use lumicache::import::{self, ImportOptions, LightUnits};
use lumicache::light::{EnvironmentMap, PunctualLight, Sky};
use lumicache::progress::{Phase, Progress};
use lumicache::render::viewer::{Display, Tile};
use lumicache::render::{
    Clock, Denoise, FrameCost, IntegratorKind, Job, Rendering, Selection, find_denoiser, frame_path,
};
use lumicache::scene::Scene;
use lumicache::transport::glass_bends_light;
use serde_json::Value;
use std::io::{self, ErrorKind};
use std::path::{Path, PathBuf};

pub fn run(arguments: &Render) -> Result<()> {
    fsutil::remember_what_is_read();
    // Everything that can be known to be wrong is found before the work starts.
    let request = Request::new(arguments)?;
    let threads = thread_count(arguments.threads)?;
    let end = on_threads(threads, arguments.quiet, |progress| request.render(progress))?;
    if !arguments.quiet {
        print(end.summary.as_bytes())?;
        end.warnings.iter().for_each(|w| warn(w));
    }
    if end.cancelled { Err(Error::Cancelled) } else { Ok(()) }
}

/// What the arguments ask for.
struct Request<'a> {
    arguments: &'a Render,
    scheme: Scheme,
    denoise: Denoise,
    layers: Selection,
    options: ImportOptions,
    sky: Option<(EnvironmentMap, Option<PunctualLight>)>,
    backend: Backend,
    output: PathBuf,
    /// Everything that will be written; of a sequence the first frame.
    outputs: Vec<PathBuf>,
    size: Option<[u32; 2]>,
    window: Option<[u32; 4]>,
}

/// How a render ended, and what to tell the user.
#[derive(Default)]
struct End {
    cancelled: bool,
    warnings: Vec<String>,
    /// For standard output.
    summary: String,
}

impl<'a> Request<'a> {
    fn new(arguments: &'a Render) -> Result<Self> {
        let scheme = scheme(arguments)?;
        let layers = Selection::parse(&arguments.aov)?;
        let light_units = match arguments.light_units {
            LightUnitsName::Photometric => LightUnits::Photometric,
            LightUnitsName::Radiometric => LightUnits::Radiometric,
        };
        let sky = arguments.sky.as_deref().map(Sky::parse).transpose()?;
        let sky = sky
            .map(|s| import::sky(&s, light_units, arguments.env_rotate, arguments.env_scale))
            .transpose()?;
        let backend: Backend = arguments.backend.parse()?;
        let output = arguments.output.clone().unwrap_or_else(|| default_output(&arguments.scene));
        check_extension(&output, &exr::EXTENSIONS)?;
        if let Some(preview) = &arguments.preview {
            check_extension(preview, &ldr::EXTENSIONS)?;
        }
        let outputs = outputs(arguments, &output)?;
        outputs.iter().try_for_each(|path| fsutil::check_writable(path))?;
        fsutil::check_distinct(&inputs(arguments), &outputs)?;
        if matches!(arguments.integrator, IntegratorName::Path)
            && !(arguments.cache_load.is_empty() && arguments.cache_save.is_none())
        {
            return Err(Error::InvalidArgument(
                "--cache-load and --cache-save need --integrator cache: a path tracer has no records"
                    .into(),
            ));
        }
        if arguments.spp.is_some_and(|n| !Job::SPP.contains(&n)) {
            return Err(Error::InvalidArgument("--spp must be between 1 and 1048576".into()));
        }
        let denoise = match arguments.denoise {
            DenoiseName::Auto => Denoise::Auto,
            DenoiseName::On => Denoise::On,
            DenoiseName::Off => Denoise::Off,
        };
        if denoise == Denoise::On {
            find_denoiser(&places())?;
        }
        Ok(Self {
            arguments,
            scheme,
            denoise,
            layers,
            options: ImportOptions { light_units, ..arguments.input.options() },
            sky,
            backend,
            output,
            outputs,
            size: arguments.size.as_deref().map(parse_size).transpose()?,
            window: arguments.crop.as_deref().map(parse_window).transpose()?,
        })
    }

    /// Reads the scene, renders, and writes.
    fn render(self, progress: &Progress) -> Result<End> {
        let mut clock = Clock::default();
        let (scene, mut warnings) = self.scene(&mut clock, progress)?;
        // Now the files are known that the scene refers to.
        self.outputs.iter().try_for_each(|path| fsutil::check_writable(path))?;
        let arguments = self.arguments;
        let mut viewer = Viewer::default();
        if !matches!(arguments.integrator, IntegratorName::Bdpt) && glass_bends_light(&scene) {
            warnings.push(BENT_LIGHT.to_owned());
        }
        let job = self.job(&scene)?.progress(progress).clock(clock);
        viewer.connect(arguments, &self.output, job.settings()?.window)?;
        let (cancelled, summary) = match &arguments.frames {
            None => {
                let job = job.watcher(|area, film| viewer.show(area, film));
                let picture = self.picture(job, progress)?;
                warnings.extend(self.kept(&picture));
                warnings.extend(picture.warnings.iter().cloned());
                (picture.frame.cancelled, self.exposed(&picture))
            }
            Some(frames) => {
                let cameras =
                    job.cameras(*frames, arguments.fps).map_err(in_file(&arguments.scene))?;
                let job = job.watcher(|area, film| viewer.show(area, film));
                let mut written = Ok(());
                let write = |number: u32, picture: &Rendering| {
                    let preview = arguments.preview.as_ref().map(|p| frame_path(p, number));
                    let output = frame_path(&self.output, number)?;
                    written = self.write(picture, &output, preview.transpose()?.as_deref());
                    if written.is_err() {
                        // The records are saved nevertheless.
                        progress.cancel();
                    }
                    Ok(())
                };
                let sequence = job.run_sequence(&cameras, write)?;
                let saved = self.save(&sequence.last);
                let told = self.write_stats(|| sequence.stats());
                written.and(saved).and(told)?;
                warnings.extend(self.kept(&sequence.last));
                warnings.extend(sequence.last.warnings.iter().cloned());
                let summary = table(&sequence.costs) + &self.exposed(&sequence.last);
                (sequence.last.frame.cancelled, summary)
            }
        };
        warnings.extend(viewer.lost);
        Ok(End { cancelled, warnings, summary })
    }

    fn scene(&self, clock: &mut Clock, progress: &Progress) -> Result<(Scene, Vec<String>)> {
        clock.start(Phase::Load);
        progress.start(Phase::Load, 0);
        let arguments = self.arguments;
        let mut data = import::gltf(&arguments.scene, &self.options)?;
        if let Some((environment, sun)) = &self.sky {
            data.environment = Some(environment.clone());
            data.punctual.extend(sun.clone());
        }
        if let Some(map) = &arguments.env {
            let (rotate, scale) = (arguments.env_rotate, arguments.env_scale);
            let limit = arguments.input.memory_limit;
            let (map, warnings) = import::environment(map, rotate, scale, limit)?;
            data.environment = Some(map);
            data.warnings.extend(warnings);
        }
        for material in &mut data.materials {
            material.multiple_scattering = arguments.multiple_scattering;
        }
        clock.start(Phase::Build);
        progress.start(Phase::Build, 0);
        let (scene, warnings) = Scene::new(data, self.backend)?;
        let scene = (scene.with_tables(tables()), warnings);
        clock.stop();
        Ok(scene)
    }

    fn job<'s>(&self, scene: &'s Scene) -> Result<Job<'s>> {
        let arguments = self.arguments;
        let integrator = match arguments.integrator {
            IntegratorName::Cache => IntegratorKind::Cache,
            IntegratorName::Path => IntegratorKind::Path,
            IntegratorName::Bdpt => IntegratorKind::Bdpt,
        };
        let mut job = Job::new(scene)
            .scheme(self.scheme.clone())
            .quality(arguments.quality)
            .integrator(integrator)
            .max_bounces(arguments.max_bounces.unwrap_or(u32::MAX))
            .seed(arguments.seed)
            .prepass_only(arguments.prepass_only)
            .denoise(self.denoise, &places())
            .cache_files(&arguments.cache_load, arguments.cache_reuse)
            .layers(self.layers.clone())
            .exposure(arguments.exposure)
            .show_records(arguments.show_records)
            .float(arguments.float);
        if let Some(camera) = &arguments.camera {
            job = job.camera_named(camera).map_err(in_file(&arguments.scene))?;
        }
        if let Some([columns, rows]) = self.size {
            job = job.size(columns, rows);
        }
        if let Some(window) = self.window {
            job = job.crop(window);
        }
        if let Some(spp) = arguments.spp {
            job = job.spp(spp);
        }
        Ok(job)
    }

    /// Renders one picture and writes it.
    fn picture<'s>(&self, job: Job<'s>, progress: &Progress) -> Result<Rendering<'s>> {
        let mut picture = job.run()?;
        picture.clock.start(Phase::Write);
        progress.start(Phase::Write, 0);
        // An output that fails does not take the others with it.
        let written = self.write(&picture, &self.output, self.arguments.preview.as_deref());
        let saved = self.save(&picture);
        picture.clock.stop();
        let told = self.write_stats(|| picture.stats());
        written.and(saved).and(told).map(|()| picture)
    }

    /// What to tell the user if the work was cancelled before there was anything to show.
    fn kept(&self, picture: &Rendering) -> Option<String> {
        let nothing = picture.frame.cancelled && picture.frame.is_empty();
        nothing.then(|| {
            format!("cancelled before the first pixel: {} is as it was", self.output.display())
        })
    }

    /// A line that tells by how much the preview is exposed, if nobody has said that.
    fn exposed(&self, picture: &Rendering) -> String {
        let automatic = self.arguments.exposure == Exposure::Auto && self.is_shown(picture);
        let preview = self.arguments.preview.as_ref().filter(|_| automatic);
        preview.map_or_else(String::new, |preview| {
            format!("{}: exposed by {:+.2} stops\n", preview.display(), picture.exposure())
        })
    }

    /// A picture of nothing must not take the place of another.
    fn is_shown(&self, picture: &Rendering) -> bool {
        !self.arguments.prepass_only && !picture.frame.is_empty()
    }

    fn write(&self, picture: &Rendering, output: &Path, preview: Option<&Path>) -> Result<()> {
        if !self.is_shown(picture) {
            return Ok(());
        }
        let written = rescued(output, |path| picture.write_exr(path));
        let preview = preview.map(|preview| rescued(preview, |path| picture.write_preview(path)));
        written.and(preview.unwrap_or(Ok(())))
    }

    /// Saves the records, if the user wants them; of cancelled work those that there are.
    fn save(&self, picture: &Rendering) -> Result<()> {
        let records = picture.frame.caches.as_ref().map_or(0, |c| c.cache.record_count());
        let none = picture.frame.cancelled && records == 0;
        let path = self.arguments.cache_save.as_ref().filter(|_| !none);
        path.map_or(Ok(()), |path| rescued(path, |path| picture.write_cache(path)))
    }

    fn write_stats(&self, stats: impl Fn() -> Value) -> Result<()> {
        let write =
            |path: &PathBuf| fsutil::write_atomically(path, format!("{:#}\n", stats()).as_bytes());
        self.arguments.stats.as_ref().map_or(Ok(()), write)
    }
}

/// Writes an output to `path`. Where the disk there is full by now, the work is not lost: the
/// output goes to the folder of temporary files, and the error says so.
fn rescued(path: &Path, write: impl Fn(&Path) -> Result<()>) -> Result<()> {
    let full = |e: &Error| match e {
        Error::Image { .. } => true,
        Error::Io { source, .. } => {
            matches!(source.kind(), ErrorKind::StorageFull | ErrorKind::QuotaExceeded)
        }
        _ => false,
    };
    let Err(error) = write(path) else { return Ok(()) };
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    let other = std::env::temp_dir().join(format!("lumicache-{}-{name}", std::process::id()));
    if !full(&error) || write(&other).is_err() {
        return Err(error);
    }
    let kept = format!("; the output is kept as {}", other.display());
    Err(match error {
        Error::Image { file, what } => Error::image(&file, what + &kept),
        Error::Io { file, source } => {
            Error::io(&file)(io::Error::new(source.kind(), format!("{source}{kept}")))
        }
        other => other,
    })
}

/// Shows finished tiles in a tev viewer, if there is one.
#[derive(Default)]
struct Viewer {
    display: Option<Display>,
    /// What to tell the user if the viewer went away.
    lost: Option<String>,
}

impl Viewer {
    /// Connects to the viewer that the arguments name, if they name one.
    fn connect(
        &mut self, arguments: &Render, output: &Path, [x0, y0, x1, y1]: [u32; 4],
    ) -> Result<()> {
        if let Some(address) = &arguments.display_server {
            let title = output.file_name().unwrap_or("lumicache".as_ref()).to_string_lossy();
            let display = Display::connect(address, &title, x1 - x0, y1 - y0, &["R", "G", "B"])?;
            self.display = Some(display);
        }
        Ok(())
    }

    /// Shows an area of the film.
    fn show(&mut self, [x0, y0, x1, y1]: [u32; 4], film: &Film) {
        if let Some(display) = &self.display {
            let data: Vec<f32> =
                film.area([x0, y0, x1, y1]).iter().flat_map(|c| c.to_array()).collect();
            let tile = Tile { x: x0, y: y0, width: x1 - x0, height: y1 - y0 };
            self.lost = self.lost.take().or(display.update(tile, &data));
        }
    }
}

/// The frames of a sequence as a table.
fn table(costs: &[FrameCost]) -> String {
    let head = format!(
        "{:>7}{:>13}{:>12}{:>10}{:>10}\n",
        "frame", "new records", "radiance", "fill s", "render s"
    );
    let row = |cost: &FrameCost| {
        let (growth, [render, _]) = (&cost.growth, cost.render_seconds);
        let records = growth.levels.iter().sum::<usize>();
        format!(
            "{:>7}{records:>13}{:>12}{:>10.3}{render:>10.3}\n",
            cost.number, growth.radiance, growth.seconds
        )
    };
    head + &costs.iter().map(row).collect::<String>()
}

/// The files that the arguments name as inputs.
fn inputs(arguments: &Render) -> Vec<&Path> {
    let preset = Some(Path::new(&arguments.preset)).filter(|_| is_file(&arguments.preset));
    let named = [Some(arguments.scene.as_path()), arguments.env.as_deref(), preset];
    named.into_iter().flatten().chain(arguments.cache_load.iter().map(PathBuf::as_path)).collect()
}

/// The files that will be written; of a sequence the first frame.
fn outputs(arguments: &Render, output: &Path) -> Result<Vec<PathBuf>> {
    let numbered = |path: &Path| match &arguments.frames {
        Some(frames) => frame_path(path, frames.first),
        None => Ok(path.to_owned()),
    };
    let pictures = [Some(output), arguments.preview.as_deref()].into_iter().flatten();
    let others = [&arguments.stats, &arguments.cache_save].into_iter().flatten().cloned();
    pictures.map(numbered).chain(others.map(Ok)).collect()
}

fn default_output(scene: &Path) -> PathBuf {
    // Not `with_extension`: `room.v2.gltf` becomes `room.v2.exr`.
    let mut name = scene.file_stem().unwrap_or_default().to_owned();
    name.push(".exr");
    name.into()
}

fn scheme(arguments: &Render) -> Result<Scheme> {
    let mut scheme = preset(&arguments.preset)?.scheme();
    if !Job::QUALITY.contains(&arguments.quality) {
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

fn parse_window(text: &str) -> Result<[u32; 4]> {
    let numbers: Option<Vec<u32>> = text.split(',').map(|n| n.trim().parse().ok()).collect();
    numbers.and_then(|n| n.try_into().ok()).ok_or_else(|| {
        Error::InvalidArgument(format!("--crop {text}: expected x0,y0,x1,y1 in pixels"))
    })
}
