//! Bidirectional path tracing [Veach97, Ch. 10]: every path is made in all ways of joining a walk
//! from a light with a walk from the camera.
//!
//! With s vertices from the light and t from the camera, s = 0 is a camera path that hits a lamp, s
//! = 1 light sampling, t = 1 a light path that the camera sees, which may fall on any pixel
//! of the image: a splat. One light path belongs to each camera sample. What a path contributes and
//! to which layer does not depend on the way it was made.

mod vertex;
mod light_walk;
mod joints;
mod first_hits;
mod weight;
mod walk;
mod connect;
#[cfg(test)]
mod tests;

use super::{CameraSample, PathTracer, Shaded};
use crate::camera::Camera;
use crate::light::EmissionSampler;
use crate::math::Color;
pub(super) use first_hits::FirstHits;
pub(super) use joints::LightPaths;
use walk::{CameraPath, LightPath};
use weight::Density;

/// Light that a light path brings to a pixel.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Splat {
    /// Pixel of the window, counted row by row.
    pub pixel: u32,
    /// Which part of [`super::Radiance::parts`].
    pub part: u8,
    /// What it adds to the sum of the pixel's samples.
    pub light: Color,
}

/// The bidirectional path tracer for one picture.
pub struct Bidirectional<'a> {
    tracer: PathTracer<'a>,
    camera: Camera,
    /// Of the full image.
    size: [u32; 2],
    /// x0, y0, x1, y1, ends excluded.
    window: [u32; 4],
    emission: EmissionSampler<'a>,
}

/// Memory that is used again from sample to sample.
#[derive(Default)]
pub(super) struct Workspace {
    seen: CameraPath,
    lit: LightPath,
    densities: Vec<Density>,
}

impl<'a> Bidirectional<'a> {
    /// For the scene of `tracer`, with its bound on paths, and the pixels of `window` (x0, y0, x1,
    /// y1, ends excluded) of an image of `size` pixels.
    pub fn new(tracer: PathTracer<'a>, camera: Camera, size: [u32; 2], window: [u32; 4]) -> Self {
        let focus = tracer.focus_of(&camera, size, window);
        let emission = tracer.scene.emission_sampler(focus);
        Self { tracer, camera, size, window, emission }
    }

    /// Pixels of the window, which is also the number of light paths for each sample of a pixel.
    fn pixels(&self) -> f64 {
        let [x0, y0, x1, y1] = self.window;
        f64::from(x1 - x0) * f64::from(y1 - y0)
    }

    /// Shades `samples` into `out`, in their order, and appends what their light paths bring to
    /// other pixels to `splats`. The sum of a pixel's samples and splats over the number of its
    /// samples estimates its radiance once every pixel of the window has got the same number of
    /// samples.
    pub fn shade(&self, samples: &[CameraSample], out: &mut Vec<Shaded>, splats: &mut Vec<Splat>) {
        let mut work = Workspace::default();
        out.clear();
        out.extend(samples.iter().map(|sample| self.shade_one(sample, &mut work, splats)));
    }

    fn shade_one(
        &self, sample: &CameraSample, work: &mut Workspace, splats: &mut Vec<Splat>,
    ) -> Shaded {
        let mut out = Shaded::default();
        self.walk_from_camera(sample, &mut work.seen, &mut out);
        self.walk_from_light(sample, &mut work.lit);
        self.connect(sample, work, &mut out.radiance, splats);
        out
    }
}
