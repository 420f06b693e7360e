//! The film: pixels while they are rendered, and the picture that they become.

mod pixel;
mod layers;

pub use layers::{LAYERS, Layer};
pub use pixel::{Parts, Pixel};

use crate::error::{Error, Result};
use crate::imagefile::{Crop, Picture};
use crate::math::{Color, luminance};
use crate::transport::Splat;
use layers::Shown;

/// The image under way: the pixels of a crop window of it.
#[derive(Clone, Debug)]
pub struct Film {
    /// Full image size.
    pub size: [u32; 2],
    /// Rendered window: x0, y0, x1, y1, ends excluded.
    pub window: [u32; 4],
    pixels: Vec<Pixel>,
    /// The parts of every pixel without noise; empty where nothing was denoised.
    denoised: Vec<Parts>,
}

impl Film {
    /// A black image.
    ///
    /// # Errors
    /// [`Error::OutOfMemory`].
    pub fn new(size: [u32; 2], window: [u32; 4]) -> Result<Self> {
        let count = (window[2] - window[0]) as usize * (window[3] - window[1]) as usize;
        let mut pixels = Vec::new();
        pixels.try_reserve_exact(count).map_err(|_| {
            let bytes = count as u64 * size_of::<Pixel>() as u64;
            Error::memory(format_args!("an image of {}x{} pixels", size[0], size[1]), bytes)
        })?;
        pixels.resize(count, Pixel::default());
        Ok(Self { size, window, pixels, denoised: Vec::new() })
    }

    /// Columns and rows of the window.
    pub fn window_size(&self) -> [u32; 2] {
        [self.window[2] - self.window[0], self.window[3] - self.window[1]]
    }

    /// The pixels of the window, row by row.
    pub fn pixels(&self) -> &[Pixel] {
        &self.pixels
    }

    /// The pixels of the window, row by row.
    pub fn pixels_mut(&mut self) -> &mut [Pixel] {
        &mut self.pixels
    }

    /// Takes `parts` for those of the pixels, which stay as they are for statistics and the layers
    /// `noisy.*`.
    pub fn denoise(&mut self, parts: Vec<Parts>) {
        assert_eq!(parts.len(), self.pixels.len(), "one set of parts for each pixel");
        self.denoised = parts;
    }

    /// True after [`Film::denoise`].
    pub fn is_denoised(&self) -> bool {
        !self.denoised.is_empty()
    }

    /// Pixel `i` as the layers see it.
    fn shown(&self, i: usize) -> Shown<'_> {
        Shown { pixel: &self.pixels[i], denoised: self.denoised.get(i) }
    }

    /// Adds light that came to a pixel by the sample of another one. Splats do not count as
    /// samples, and the variance does not know of them.
    pub fn splat(&mut self, splat: &Splat) {
        self.pixels[splat.pixel as usize].parts[usize::from(splat.part)] += splat.light;
    }

    /// The channels of `layer`, each row by row.
    pub fn channels(&self, layer: &Layer) -> Vec<Vec<f32>> {
        let mut channels = vec![Vec::with_capacity(self.pixels.len()); layer.channels.len()];
        for i in 0..self.pixels.len() {
            let values = (layer.values)(&self.shown(i));
            for (channel, value) in channels.iter_mut().zip(values) {
                channel.push(value);
            }
        }
        channels
    }

    /// The channels of `layers` as a picture, in their order.
    pub fn picture<'a>(&self, layers: impl IntoIterator<Item = &'a Layer>) -> Picture {
        let mut picture = Picture::new(self.window_size());
        for layer in layers {
            for (k, samples) in self.channels(layer).into_iter().enumerate() {
                picture.add(layer.channel_name(k), layer.kind, samples);
            }
        }
        let [x0, y0, _, _] = self.window;
        picture.crop = (self.window_size() != self.size)
            .then_some(Crop { origin: [x0 as i32, y0 as i32], whole: self.size });
        picture
    }

    /// Mean radiance of the pixels of an area of the window (x0, y0, x1, y1, ends excluded), row by
    /// row.
    pub fn area(&self, [x0, y0, x1, y1]: [u32; 4]) -> Vec<Color> {
        let width = self.window_size()[0];
        (y0..y1)
            .flat_map(|y| (x0..x1).map(move |x| self.shown((y * width + x) as usize).radiance()))
            .collect()
    }

    /// Mean radiance of every pixel.
    pub fn radiance(&self) -> Vec<Color> {
        (0..self.pixels.len()).map(|i| self.shown(i).radiance()).collect()
    }

    /// Distance to the first surface in every pixel, infinite where there is none.
    pub fn depth(&self) -> Vec<f32> {
        self.pixels.iter().map(Pixel::distance).collect()
    }

    /// Mean luminance of the image.
    pub fn mean_luminance(&self) -> f32 {
        let sum: f64 = self.radiance().iter().map(|&c| f64::from(luminance(c))).sum();
        (sum / self.pixels.len().max(1) as f64) as f32
    }
}
