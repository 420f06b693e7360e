//! What is rendered, and how.

use crate::cache::Scheme;
use crate::camera::Camera;

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
    /// Pixels whose relative standard error is above this get up to four times the samples; 0
    /// gives all of them the same.
    pub noise: f32,
    /// Most surface interactions after the camera hit, `u32::MAX` for no bound.
    pub max_bounces: u32,
    /// Seed of everything random.
    pub seed: u64,
    /// Fill the cache, but render nothing.
    pub prepass_only: bool,
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
        if self.integrator == IntegratorKind::Cache {
            text += &format!(
                " scheme={}",
                serde_json::to_string(&self.scheme).expect("a scheme is plain data")
            );
        }
        text
    }
}
