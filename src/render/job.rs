//! A picture from a few choices: all others have the defaults of the command line.

use super::caches::Caches;
use super::clock::Clock;
use super::denoise::Found;
use super::frame::{Frame, Watcher};
use super::rendering::{Output, Rendering, origin};
use super::selection::Selection;
use super::settings::{Denoise, IntegratorKind, Settings};
use super::threads::on_workers;
use super::visible::fill_for_camera;
use crate::cache::{Cache, CacheFile, Preset, Schedule, Scheme};
use crate::camera::{Camera, Motion};
use crate::error::{Error, Result};
use crate::film::Film;
use crate::imagefile::Exposure;
use crate::import::default_camera;
use crate::progress::{Phase, Progress};
use crate::scene::Scene;
use std::ops::RangeInclusive;
use std::path::PathBuf;

/// Samples per pixel at quality 1.
const SPP: f32 = 16.0;
/// Relative standard error at quality 1 above which a pixel gets more samples.
const NOISE: f32 = 0.04;
/// Rows of a picture without a size.
const ROWS: u32 = 720;

/// A picture to be rendered. Without further choices the job does what `lumicache render` does
/// without flags.
///
/// ```
/// use lumicache::{import, render::Job};
///
/// let (scene, warnings) = import::open("scenes/cornell-box.gltf")?;
/// warnings.iter().for_each(|w| eprintln!("{w}"));
/// let picture = Job::new(&scene).quality(0.1).size(16, 16).run()?;
/// # let folder = tempfile::tempdir().unwrap();
/// # std::env::set_current_dir(&folder).unwrap();
/// picture.write_exr("room.exr")?;
/// picture.write_preview("room.png")?;
/// # Ok::<(), lumicache::error::Error>(())
/// ```
pub struct Job<'a> {
    pub(super) scene: &'a Scene,
    scheme: Scheme,
    /// The scheme is a preset, which quality scales.
    scaled: bool,
    quality: f32,
    integrator: IntegratorKind,
    viewpoint: Viewpoint,
    size: Option<[u32; 2]>,
    rows: u32,
    window: Option<[u32; 4]>,
    spp: Option<u32>,
    noise: Option<f32>,
    max_bounces: u32,
    seed: u64,
    prepass_only: bool,
    denoise: Denoise,
    pub(super) denoisers: Vec<PathBuf>,
    before: Before,
    pub(super) progress: Option<&'a Progress>,
    pub(super) watcher: Box<Watcher<'a>>,
    pub(super) clock: Clock,
    pub(super) output: Output,
}

enum Viewpoint {
    /// The first camera of the scene; without one, a camera that frames the scene.
    Default,
    /// A camera of the scene, by its number.
    Number(usize),
    Given(Camera),
}

/// The records that a job begins with.
enum Before {
    Nothing,
    Files { paths: Vec<PathBuf>, reuse: bool },
    Caches(Caches),
}

impl<'a> Job<'a> {
    /// The qualities that a picture can have.
    pub const QUALITY: RangeInclusive<f32> = 0.01..=100.0;
    /// The numbers of samples that a pixel can have.
    pub const SPP: RangeInclusive<u32> = 1..=1 << 20;

    /// The job that `lumicache render` does without flags.
    pub fn new(scene: &'a Scene) -> Self {
        Self {
            scene,
            scheme: Preset::by_name("auto").expect("the default preset").scheme(),
            scaled: true,
            quality: 1.0,
            integrator: IntegratorKind::Cache,
            viewpoint: Viewpoint::Default,
            size: None,
            rows: ROWS,
            window: None,
            spp: None,
            noise: None,
            max_bounces: u32::MAX,
            seed: 0,
            prepass_only: false,
            denoise: Denoise::Off,
            denoisers: Vec::new(),
            before: Before::Nothing,
            progress: None,
            watcher: Box::new(|_, _| ()),
            clock: Clock::default(),
            output: Output::default(),
        }
    }

    /// The job with exactly these settings.
    pub fn with_settings(scene: &'a Scene, settings: Settings) -> Self {
        Self {
            scheme: settings.scheme,
            scaled: false,
            integrator: settings.integrator,
            viewpoint: Viewpoint::Given(settings.camera),
            size: Some(settings.size),
            window: Some(settings.window),
            spp: Some(settings.spp),
            noise: Some(settings.noise),
            max_bounces: settings.max_bounces,
            seed: settings.seed,
            prepass_only: settings.prepass_only,
            denoise: settings.denoise,
            ..Self::new(scene)
        }
    }

    /// One number for everything: 2 costs about twice as much as the default 1, 0.5 half as much.
    /// Quality decides the rays and the allowed error of a preset, and where nobody else does, the
    /// samples per pixel and the noise that a pixel may keep.
    pub fn quality(mut self, quality: f32) -> Self {
        self.quality = quality;
        self
    }

    /// The caching scheme, by the name of a preset; by default `auto`.
    ///
    /// # Errors
    /// [`Error::InvalidArgument`] listing the presets.
    pub fn preset(mut self, name: &str) -> Result<Self> {
        (self.scheme, self.scaled) = (Preset::by_name(name)?.scheme(), true);
        Ok(self)
    }

    /// The caching scheme as it is: quality does not scale it.
    pub fn scheme(mut self, scheme: Scheme) -> Self {
        (self.scheme, self.scaled) = (scheme, false);
        self
    }

    /// The light transport; by default caching.
    pub fn integrator(mut self, integrator: IntegratorKind) -> Self {
        self.integrator = integrator;
        self
    }

    /// The camera. The default is the first camera of the scene, and a camera that frames the scene
    /// where the scene has none.
    pub fn camera(mut self, camera: Camera) -> Self {
        self.viewpoint = Viewpoint::Given(camera);
        self
    }

    /// The camera of the scene with this name or number.
    ///
    /// # Errors
    /// [`Error::InvalidArgument`] listing the cameras.
    pub fn camera_named(mut self, wanted: &str) -> Result<Self> {
        self.viewpoint = Viewpoint::Number(camera_number(self.scene.cameras(), wanted)?);
        Ok(self)
    }

    /// Columns and rows of the image.
    pub fn size(mut self, columns: u32, rows: u32) -> Self {
        self.size = Some([columns, rows]);
        self
    }

    /// Rows of the image; the camera's aspect decides the columns. By default 720.
    pub fn rows(mut self, rows: u32) -> Self {
        (self.size, self.rows) = (None, rows);
        self
    }

    /// Renders only this window of the image: x0, y0, x1, y1 in pixels, ends excluded.
    pub fn crop(mut self, window: [u32; 4]) -> Self {
        self.window = Some(window);
        self
    }

    /// Samples per pixel, the same for all pixels. By default quality decides, and noisy pixels of
    /// the caching integrator get up to four times as many.
    pub fn spp(mut self, spp: u32) -> Self {
        self.spp = Some(spp);
        self
    }

    /// Relative standard error above which a pixel gets more samples: see [`Settings::noise`].
    pub fn noise(mut self, noise: f32) -> Self {
        self.noise = Some(noise);
        self
    }

    /// Most surface interactions after the camera hit; by default there is no bound.
    pub fn max_bounces(mut self, bounces: u32) -> Self {
        self.max_bounces = bounces;
        self
    }

    /// Seed of everything random; by default 0.
    pub fn seed(mut self, seed: u64) -> Self {
        self.seed = seed;
        self
    }

    /// Fills the cache, but renders nothing.
    pub fn prepass_only(mut self, only: bool) -> Self {
        self.prepass_only = only;
        self
    }

    /// Takes the noise out of what was traced; by default off. `places` are files of Open Image
    /// Denoise, or folders that may have it: see [`denoiser_places`](super::denoiser_places).
    pub fn denoise(mut self, denoise: Denoise, places: &[PathBuf]) -> Self {
        (self.denoise, self.denoisers) = (denoise, places.to_vec());
        self
    }

    /// Begins with the records of these cache files; of records at the same place the first is
    /// kept. `reuse` takes files that were made for another scene or under other settings.
    pub fn cache_files(mut self, paths: &[PathBuf], reuse: bool) -> Self {
        self.before = Before::Files { paths: paths.to_vec(), reuse };
        self
    }

    /// Begins with the records of these caches, which have the scheme and the bounces of this job.
    pub fn caches(mut self, caches: Caches) -> Self {
        self.before = Before::Caches(caches);
        self
    }

    /// Tells how far the job is, and can cancel it.
    pub fn progress(mut self, progress: &'a Progress) -> Self {
        self.progress = Some(progress);
        self
    }

    /// Calls `watcher` for each finished tile: window coordinates x0, y0, x1, y1 and the film so
    /// far.
    pub fn watcher(mut self, watcher: impl FnMut([u32; 4], &Film) + Send + 'a) -> Self {
        self.watcher = Box::new(watcher);
        self
    }

    /// The time that loading and building the scene took, for the statistics.
    pub fn clock(mut self, clock: Clock) -> Self {
        self.clock = clock;
        self
    }

    /// The layers of the EXR file; by default `basic`.
    pub fn layers(mut self, layers: Selection) -> Self {
        self.output.layers = layers;
        self
    }

    /// Exposure of the preview: stops as an `f32`; by default [`Exposure::Auto`].
    pub fn exposure(mut self, exposure: impl Into<Exposure>) -> Self {
        self.output.exposure = exposure.into();
        self
    }

    /// Draws the records over the preview and into the layers gi.overlay and gi.level.
    pub fn show_records(mut self, show: bool) -> Self {
        self.output.show_records = show;
        self
    }

    /// Writes all layers as 32-bit floats. By default colours and normals are halves, but for
    /// layers with values above 65504.
    pub fn float(mut self, float: bool) -> Self {
        self.output.float = float;
        self
    }

    /// The settings of the picture, every number decided.
    ///
    /// # Errors
    /// [`Error::InvalidArgument`] for numbers out of range and a window outside the image.
    pub fn settings(&self) -> Result<Settings> {
        let fault = |what: &str| Err(Error::InvalidArgument(what.into()));
        let quality = self.quality;
        if !Self::QUALITY.contains(&quality) {
            return fault("quality must be between 0.01 and 100");
        }
        let mut scheme = self.scheme.clone();
        if self.scaled {
            scheme.scale_quality(quality);
        }
        let camera = match &self.viewpoint {
            Viewpoint::Default => self.scene.cameras().first().cloned(),
            Viewpoint::Number(i) => Some(self.scene.cameras()[*i].clone()),
            Viewpoint::Given(camera) => Some(camera.clone()),
        };
        let camera = camera.unwrap_or_else(|| default_camera(&self.scene.bounds()));
        let size = self.size.unwrap_or_else(|| {
            let aspect = camera.aspect.unwrap_or(16.0 / 9.0).clamp(0.05, 20.0);
            [(self.rows as f32 * aspect).round().max(1.0) as u32, self.rows]
        });
        let spp = self.spp.unwrap_or_else(|| (SPP * quality).round().max(1.0) as u32);
        if !Self::SPP.contains(&spp) {
            return fault("spp must be between 1 and 1048576");
        }
        // Who names a number of samples, and who renders a reference, gets the same for every
        // pixel.
        let uniform = self.spp.is_some() || self.integrator != IntegratorKind::Cache;
        let noise = self.noise.unwrap_or(if uniform { 0.0 } else { NOISE / quality.sqrt() });
        let settings = Settings {
            integrator: self.integrator,
            scheme,
            camera,
            size,
            window: self.window.unwrap_or([0, 0, size[0], size[1]]),
            spp,
            noise,
            max_bounces: self.max_bounces,
            seed: self.seed,
            prepass_only: self.prepass_only,
            denoise: self.denoise,
        };
        settings.check()?;
        Ok(settings)
    }

    /// How the camera moves, if it is a camera of the scene that does.
    pub fn motion(&self) -> Option<&'a Motion> {
        let number = match self.viewpoint {
            Viewpoint::Default => 0,
            Viewpoint::Number(i) => i,
            Viewpoint::Given(_) => return None,
        };
        self.scene.motions().get(number)?.as_ref()
    }

    /// Renders the picture on the thread pool of the calling thread; on
    /// [`workers`](super::workers) of its own where that is no thread of a pool. A cancelled job
    /// returns the picture so far.
    ///
    /// # Errors
    /// Those of [`Job::settings`] and of reading cache files.
    pub fn run(self) -> Result<Rendering<'a>> {
        on_workers(|| self.render())
    }

    fn render(mut self) -> Result<Rendering<'a>> {
        let settings = self.settings()?;
        let found = Found::new(settings.denoise, &self.denoisers)?;
        let mut caches = self.begin(&settings)?;
        let nobody = Progress::default();
        let progress = self.progress.unwrap_or(&nobody);
        let births = caches.as_mut().map(|caches| {
            self.clock.start(Phase::Fill);
            fill_for_camera(caches, self.scene, &settings, &[], progress)
        });
        let mut frame = match births.transpose() {
            Err(Error::Cancelled) => {
                Frame { cancelled: true, ..Frame::empty(&settings, caches.as_ref())? }
            }
            Err(error) => return Err(error),
            Ok(births) => {
                let limits = births.filter(|_| settings.scheme.schedule == Schedule::OnePass);
                self.clock.start(Phase::Render);
                let (caches, limits) = (caches.as_ref(), limits.as_deref());
                Frame::shade(self.scene, &settings, caches, limits, progress, &mut self.watcher)?
            }
        };
        let warnings =
            found.denoise(&mut frame, &settings, &mut self.clock, progress, &mut self.watcher);
        self.clock.stop();
        Ok(Rendering::new(self.scene, frame, settings, self.clock, self.output, warnings))
    }

    /// The caches with the records to begin with; `None` for an integrator without records.
    pub(super) fn begin(&mut self, settings: &Settings) -> Result<Option<Caches>> {
        let cached = settings.integrator == IntegratorKind::Cache;
        let records = match std::mem::replace(&mut self.before, Before::Nothing) {
            Before::Caches(caches) if cached => return Ok(Some(caches)),
            Before::Files { paths, reuse } => read(&paths, reuse, self.scene, settings)?,
            _ => None,
        };
        let (scheme, bounces) = (&settings.scheme, settings.max_bounces);
        Ok(cached.then(|| Caches::new(self.scene, scheme, bounces, records)))
    }
}

/// The records of cache files, if there are any.
fn read(
    paths: &[PathBuf], reuse: bool, scene: &Scene, settings: &Settings,
) -> Result<Option<Cache>> {
    let Some((first, others)) = paths.split_first() else { return Ok(None) };
    let mut all = CacheFile::read(first)?;
    for path in others {
        all.merge(CacheFile::read(path)?, reuse, path)?;
    }
    all.into_cache(settings.scheme.clone(), &origin(scene, settings), reuse, first).map(Some)
}

/// The number of the camera with the name or the number `wanted`.
///
/// # Errors
/// [`Error::InvalidArgument`] listing the cameras.
pub fn camera_number(cameras: &[Camera], wanted: &str) -> Result<usize> {
    let by_name = cameras.iter().position(|c| c.name == wanted);
    let by_number = || wanted.parse::<usize>().ok().filter(|i| *i < cameras.len());
    by_name.or_else(by_number).ok_or_else(|| {
        let names: Vec<_> =
            cameras.iter().enumerate().map(|(i, c)| format!("{i} `{}`", c.name)).collect();
        let known = if names.is_empty() { "none".to_owned() } else { names.join(", ") };
        Error::InvalidArgument(format!("there is no camera `{wanted}`; the cameras are {known}"))
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::accel::Backend;
    use crate::scene::SceneData;

    fn scene() -> Scene {
        Scene::new(SceneData::default(), Backend::Bvh).unwrap().0
    }

    #[test]
    fn quality_decides_samples_noise_and_the_scheme_of_a_preset() {
        let scene = scene();
        let of = |quality: f32| Job::new(&scene).quality(quality).settings().unwrap();
        let (one, four, least) = (of(1.0), of(4.0), of(0.01));
        assert_eq!((one.spp, one.noise), (16, 0.04));
        assert_eq!((four.spp, four.noise), (64, 0.02));
        assert_eq!(least.spp, 1);
        assert_eq!(four.scheme.gather.rays, 2 * one.scheme.gather.rays);
        let given = Job::new(&scene).scheme(one.scheme.clone()).quality(4.0).settings().unwrap();
        assert_eq!((given.spp, &given.scheme), (64, &one.scheme));
        for bad in [0.0, 101.0, f32::NAN] {
            assert!(Job::new(&scene).quality(bad).settings().is_err(), "{bad}");
        }
    }

    #[test]
    fn every_pixel_gets_the_samples_that_somebody_named() {
        let scene = scene();
        let named = Job::new(&scene).spp(8).settings().unwrap();
        assert_eq!((named.spp, named.noise), (8, 0.0));
        let reference = Job::new(&scene).integrator(IntegratorKind::Path).settings().unwrap();
        assert_eq!((reference.spp, reference.noise), (16, 0.0));
        assert_eq!(Job::new(&scene).spp(8).noise(0.1).settings().unwrap().noise, 0.1);
        assert!(Job::new(&scene).spp(0).settings().is_err());
    }

    #[test]
    fn the_size_follows_the_camera_unless_it_is_given() {
        let scene = scene();
        assert_eq!(Job::new(&scene).settings().unwrap().size, [1280, 720]);
        let camera = Camera { aspect: Some(0.5), ..default_camera(&scene.bounds()) };
        let job = Job::new(&scene).camera(camera).rows(100);
        assert_eq!(job.settings().unwrap().size, [50, 100]);
        let job = job.size(40, 30).crop([1, 2, 3, 4]);
        let settings = job.settings().unwrap();
        assert_eq!((settings.size, settings.window), ([40, 30], [1, 2, 3, 4]));
        assert!(job.crop([0, 0, 41, 30]).settings().is_err());
        assert!(Job::new(&scene).camera_named("nobody").is_err());
    }

    #[test]
    fn a_job_with_settings_has_exactly_these() {
        let scene = scene();
        let job = Job::new(&scene).quality(0.3).seed(7).max_bounces(3).prepass_only(true);
        let settings = job.size(9, 8).crop([1, 1, 5, 5]).settings().unwrap();
        let again = Job::with_settings(&scene, settings.clone()).settings().unwrap();
        assert_eq!(format!("{again:?}"), format!("{settings:?}"));
    }
}
