//! One frame's settings, every number decided, and the samples that follow from them.

use crate::cache::{Schedule, Scheme, ShadingPoint};
use crate::camera::Camera;
use crate::error::{Error, Result, check_room};
use crate::ffi::denoise::MEMORY;
use crate::film::{Parts, Pixel};
use crate::math::Color;
use crate::sampling::{hash, stream};
use crate::transport::CameraSample;
use crate::words::{Words, words};

/// Bytes per pixel of the default layers of the output.
const LAYERS: usize = 26 * 4;

/// Bytes per pixel of denoising: the parts, their two shares, filtered light, albedo and normal.
const DENOISED: usize = size_of::<Parts>() + 5 * size_of::<Color>() + 8;
/// Bytes per pixel of the filter itself, up to its limit.
const FILTER: u64 = 700;

/// Which light transport makes the pixels.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum IntegratorKind {
    /// Caching.
    Cache,
    /// Path tracing, the reference.
    Path,
    /// Bidirectional path tracing.
    Bdpt,
}

impl IntegratorKind {
    /// The name on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Self::Cache => "cache",
            Self::Path => "path",
            Self::Bdpt => "bdpt",
        }
    }
}

words! {
    /// Whether a picture is denoised.
    pub enum Denoise {
        /// Where Open Image Denoise is installed.
        Auto = "auto",
        /// Always: without Open Image Denoise nothing is rendered.
        On = "on",
        /// Never.
        Off = "off",
    }
}

/// One frame's settings.
#[derive(Clone, Debug)]
pub struct Settings {
    /// Light transport.
    pub integrator: IntegratorKind,
    /// The caching scheme; unused by the path tracers.
    pub scheme: Scheme,
    /// The camera.
    pub camera: Camera,
    /// Columns and rows of the image.
    pub size: [u32; 2],
    /// Rendered window of it: x0, y0, x1, y1, ends excluded.
    pub window: [u32; 4],
    /// Samples per pixel.
    pub spp: u32,
    /// Pixels whose relative standard error is above this number get up to four times the samples;
    /// with 0 all pixels get the same.
    pub noise: f32,
    /// Most surface interactions after the camera hit, `u32::MAX` for no bound.
    pub max_bounces: u32,
    /// Seed of everything random.
    pub seed: u64,
    /// Fill the cache, but render nothing.
    pub prepass_only: bool,
    /// Take the noise out of what was traced.
    pub denoise: Denoise,
}

impl Settings {
    /// The settings as one line, for the output file.
    pub fn describe(&self) -> String {
        let mut text = format!(
            "integrator={} size={}x{} spp={} noise={} max_bounces={} seed={} camera={}",
            self.integrator.name(),
            self.size[0],
            self.size[1],
            self.spp,
            self.noise,
            if self.max_bounces == u32::MAX {
                "unlimited".to_owned()
            } else {
                self.max_bounces.to_string()
            },
            self.seed,
            self.camera.name,
        );
        if self.denoise != Denoise::Off {
            text += &format!(" denoise={}", self.denoise.word());
        }
        if self.integrator == IntegratorKind::Cache {
            text += &format!(
                " scheme={}",
                serde_json::to_string(&self.scheme).expect("a scheme is plain data")
            );
        }
        text
    }

    pub(super) fn check(&self) -> Result<()> {
        let ([w, h], [x0, y0, x1, y1]) = (self.size, self.window);
        if w == 0 || h == 0 || u64::from(w) * u64::from(h) > 1 << 28 {
            return Err(Error::InvalidArgument(format!(
                "an image of {w}x{h} pixels cannot be rendered"
            )));
        }
        if x0 >= x1 || y0 >= y1 || x1 > w || y1 > h {
            return Err(Error::InvalidArgument(format!(
                "the crop window {x0},{y0},{x1},{y1} is not inside {w}x{h} pixels"
            )));
        }
        // Nothing is lost later for want of memory that is known to be wanted now.
        let pixels = u64::from(x1 - x0) * u64::from(y1 - y0);
        let each = size_of::<Pixel>() + 2 * size_of::<ShadingPoint>().max(LAYERS);
        let mut bytes = pixels * each as u64;
        if self.denoise != Denoise::Off {
            let filter = (pixels * FILTER).min(u64::from(MEMORY) << 20);
            bytes += pixels * DENOISED as u64 + filter;
        }
        check_room(format_args!("an image of {} x {} pixels", x1 - x0, y1 - y0), bytes)
    }
}

/// The pixels of the window in the scheme's order.
pub(crate) fn pixel_order(settings: &Settings) -> Vec<u32> {
    let [x0, y0, x1, y1] = settings.window;
    let width = x1 - x0;
    let mut order: Vec<u32> = (0..width * (y1 - y0)).collect();
    match settings.scheme.schedule {
        Schedule::OnePass | Schedule::Scanline => {}
        // Grids of every eighth pixel, then every fourth, every second, and the rest.
        Schedule::CoarseToFine => {
            order.sort_by_key(|p| (3 - ((p % width) | (p / width) | 8).trailing_zeros(), *p))
        }
        Schedule::Scattered => {
            order.sort_by_cached_key(|p| (hash(&[settings.seed, stream::ORDER, u64::from(*p)]), *p))
        }
    }
    order
}

/// Sample `index` of pixel `p` of the window, which may use the first `limit` records.
pub(crate) fn camera_sample(settings: &Settings, p: u32, index: u32, limit: u32) -> CameraSample {
    let [x0, y0, x1, _] = settings.window;
    let width = x1 - x0;
    let (x, y) = (x0 + p % width, y0 + p / width);
    // The seed belongs to the pixel of the full image: a crop shows the same noise.
    let seed = hash(&[settings.seed, u64::from(x), u64::from(y)]);
    CameraSample::new(&settings.camera, [x, y], settings.size, seed, index, limit)
}
