//! Pixels while they are rendered: sums of samples, and the layers they become.

use crate::math::{Color, Vec3, luminance};
use crate::transport::{Shaded, Splat, Status};

/// Sums over the samples of one pixel.
#[derive(Clone, Copy, Debug, Default)]
pub struct Pixel {
    /// The five parts of the radiance, in the order of [`crate::transport::Radiance::parts`].
    parts: [Color; 5],
    albedo: Color,
    normal: Vec3,
    position: Vec3,
    distance: f32,
    irradiance: Color,
    records: f32,
    error: f32,
    allowed: f32,
    traced: f32,
    cached: f32,
    /// Samples that saw a surface.
    covered: f32,
    squares: Color,
    samples: u32,
    lookups: u32,
    misses: u32,
    /// Samples that saw gloss, and those of them that records served.
    glossy: [u32; 2],
}

impl Pixel {
    /// Adds one sample. A sample that is not a number counts as black, so that it cannot spoil the
    /// pixel.
    pub fn add(&mut self, s: &Shaded) {
        self.samples += 1;
        self.lookups += s.lookups;
        self.misses += s.misses;
        if s.radiance.is_finite() {
            for (sum, part) in self.parts.iter_mut().zip(s.radiance.parts()) {
                *sum += part;
            }
            let total = s.radiance.total();
            self.squares += total * total;
        }
        if let Some(surface) = &s.surface {
            self.covered += 1.0;
            self.albedo += surface.albedo;
            self.normal += surface.normal;
            self.position += surface.position;
            self.distance += surface.distance;
        }
        match s.status {
            Status::None => {}
            Status::Cached => self.cached += 1.0,
            Status::Traced => self.traced += 1.0,
        }
        self.glossy[0] += u32::from(s.gloss != Status::None);
        self.glossy[1] += u32::from(s.gloss == Status::Cached);
        self.irradiance += s.irradiance;
        self.records += s.records as f32;
        self.error += s.error;
        self.allowed += s.allowed;
    }

    /// Adds the samples of `other`.
    pub fn merge(&mut self, other: &Self) {
        for (sum, part) in self.parts.iter_mut().zip(other.parts) {
            *sum += part;
        }
        self.albedo += other.albedo;
        self.normal += other.normal;
        self.position += other.position;
        self.distance += other.distance;
        self.irradiance += other.irradiance;
        self.records += other.records;
        self.error += other.error;
        self.allowed += other.allowed;
        self.traced += other.traced;
        self.cached += other.cached;
        self.covered += other.covered;
        self.squares += other.squares;
        self.samples += other.samples;
        self.lookups += other.lookups;
        self.misses += other.misses;
        self.glossy[0] += other.glossy[0];
        self.glossy[1] += other.glossy[1];
    }

    /// Number of samples.
    pub fn samples(&self) -> u32 {
        self.samples
    }

    /// Questions put to the cache, and those without an answer.
    pub fn lookups(&self) -> (u64, u64) {
        (u64::from(self.lookups), u64::from(self.misses))
    }

    /// Samples that saw a glossy surface, and those of them whose gloss came from records.
    pub fn glossy(&self) -> (u64, u64) {
        (u64::from(self.glossy[0]), u64::from(self.glossy[1]))
    }

    /// Mean radiance.
    pub fn radiance(&self) -> Color {
        self.parts.iter().sum::<Color>() * self.weight()
    }

    /// Variance of the luminance of the pixel's mean, estimated from its samples taken as
    /// independent, as if the channels rose and fell together.
    pub fn luminance_variance(&self) -> f32 {
        let v = self.variance();
        luminance(Color::new(v.x.sqrt(), v.y.sqrt(), v.z.sqrt())).powi(2)
    }

    fn weight(&self) -> f32 {
        if self.samples > 0 { 1.0 / self.samples as f32 } else { 0.0 }
    }

    /// Variance of the pixel's mean, estimated from its samples taken as independent; 0 below two
    /// samples.
    fn variance(&self) -> Color {
        if self.samples < 2 {
            return Color::ZERO;
        }
        let mean = self.radiance();
        (self.squares * self.weight() - mean * mean).max(Color::ZERO) / (self.samples - 1) as f32
    }
}

/// A layer of the output file: a name, and one to four channels per pixel.
#[derive(Clone, Copy, Debug)]
pub struct Layer {
    /// What `--aov` calls it, and the first part of its channels' names; empty for the beauty.
    pub name: &'static str,
    /// Names of its channels.
    pub channels: &'static [&'static str],
    /// Half precision is enough.
    pub half: bool,
    /// Part of the default set.
    pub basic: bool,
    values: fn(&Pixel) -> [f32; 4],
}

fn rgb(c: Vec3) -> [f32; 4] {
    [c.x, c.y, c.z, 0.0]
}

const RGB: &[&str] = &["R", "G", "B"];
const XYZ: &[&str] = &["X", "Y", "Z"];

/// Means over the samples that saw a surface.
fn over_surface(p: &Pixel, sum: Vec3) -> Vec3 {
    if p.covered > 0.0 { sum / p.covered } else { Vec3::ZERO }
}

/// Every layer, in the order of the file.
pub const LAYERS: &[Layer] = &[
    Layer {
        name: "",
        channels: &["R", "G", "B", "A"],
        half: true,
        basic: true,
        values: |p| {
            let c = p.radiance();
            [c.x, c.y, c.z, p.covered * p.weight()]
        },
    },
    Layer {
        name: "diffuse_direct",
        channels: RGB,
        half: true,
        basic: true,
        values: |p| rgb(p.parts[0] * p.weight()),
    },
    Layer {
        name: "diffuse_indirect",
        channels: RGB,
        half: true,
        basic: true,
        values: |p| rgb(p.parts[1] * p.weight()),
    },
    Layer {
        name: "glossy_direct",
        channels: RGB,
        half: true,
        basic: true,
        values: |p| rgb(p.parts[2] * p.weight()),
    },
    Layer {
        name: "glossy_indirect",
        channels: RGB,
        half: true,
        basic: true,
        values: |p| rgb(p.parts[3] * p.weight()),
    },
    Layer {
        name: "emission",
        channels: RGB,
        half: true,
        basic: true,
        values: |p| rgb(p.parts[4] * p.weight()),
    },
    Layer {
        name: "albedo",
        channels: RGB,
        half: true,
        basic: true,
        values: |p| rgb(p.albedo * p.weight()),
    },
    Layer {
        name: "N",
        channels: XYZ,
        half: true,
        basic: true,
        values: |p| rgb(p.normal.normalize_or_zero()),
    },
    Layer {
        name: "P",
        channels: XYZ,
        half: false,
        basic: false,
        values: |p| rgb(over_surface(p, p.position)),
    },
    Layer {
        name: "Z",
        channels: &[""],
        half: false,
        basic: true,
        values: |p| {
            [if p.covered > 0.0 { p.distance / p.covered } else { f32::INFINITY }, 0.0, 0.0, 0.0]
        },
    },
    Layer {
        name: "gi.records",
        channels: &[""],
        half: true,
        basic: false,
        values: |p| [p.records * p.weight(), 0.0, 0.0, 0.0],
    },
    Layer {
        name: "gi.status",
        channels: &[""],
        half: true,
        basic: false,
        values: |p| [(p.cached + 2.0 * p.traced) * p.weight(), 0.0, 0.0, 0.0],
    },
    Layer {
        name: "gi.error",
        channels: &[""],
        half: true,
        basic: false,
        values: |p| [p.error * p.weight(), 0.0, 0.0, 0.0],
    },
    Layer {
        name: "gi.a",
        channels: &[""],
        half: true,
        basic: false,
        // Not diluted by samples that no record answered: the map shows how finely records were
        // made.
        values: |p| [if p.cached > 0.0 { p.allowed / p.cached } else { 0.0 }, 0.0, 0.0, 0.0],
    },
    Layer {
        name: "gi.irradiance",
        channels: RGB,
        half: true,
        basic: false,
        values: |p| rgb(p.irradiance * p.weight()),
    },
    Layer {
        name: "variance",
        channels: RGB,
        half: false,
        basic: false,
        values: |p| rgb(p.variance()),
    },
];

impl Layer {
    /// The full name of channel `k`, such as `diffuse_direct.R` or `Z`.
    pub fn channel_name(&self, k: usize) -> String {
        match (self.name, self.channels[k]) {
            ("", channel) => channel.to_owned(),
            (name, "") => name.to_owned(),
            (name, channel) => format!("{name}.{channel}"),
        }
    }
}

/// The image under way: the pixels of a crop window of it.
#[derive(Clone, Debug)]
pub struct Film {
    /// Full image size.
    pub size: [u32; 2],
    /// Rendered window: x0, y0, x1, y1, ends excluded.
    pub window: [u32; 4],
    pixels: Vec<Pixel>,
}

impl Film {
    /// A black image.
    pub fn new(size: [u32; 2], window: [u32; 4]) -> Self {
        let count = (window[2] - window[0]) as usize * (window[3] - window[1]) as usize;
        Self { size, window, pixels: vec![Pixel::default(); count] }
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

    /// Adds light that came to a pixel by the sample of another one. Splats do not count as
    /// samples, and the variance does not know of them.
    pub fn splat(&mut self, splat: &Splat) {
        self.pixels[splat.pixel as usize].parts[usize::from(splat.part)] += splat.light;
    }

    /// The channels of `layer`, each row by row.
    pub fn channels(&self, layer: &Layer) -> Vec<Vec<f32>> {
        let mut channels = vec![Vec::with_capacity(self.pixels.len()); layer.channels.len()];
        for p in &self.pixels {
            let values = (layer.values)(p);
            for (channel, value) in channels.iter_mut().zip(values) {
                channel.push(value);
            }
        }
        channels
    }

    /// Mean radiance of the pixels of an area of the window (x0, y0, x1, y1, ends excluded), row by
    /// row.
    pub fn area(&self, [x0, y0, x1, y1]: [u32; 4]) -> Vec<Color> {
        let width = self.window_size()[0];
        (y0..y1)
            .flat_map(|y| (x0..x1).map(move |x| self.pixels[(y * width + x) as usize].radiance()))
            .collect()
    }

    /// Mean radiance of every pixel.
    pub fn radiance(&self) -> Vec<Color> {
        self.pixels.iter().map(Pixel::radiance).collect()
    }

    /// Distance to the first surface in every pixel, infinite where there is none.
    pub fn depth(&self) -> Vec<f32> {
        self.pixels
            .iter()
            .map(|p| if p.covered > 0.0 { p.distance / p.covered } else { f32::INFINITY })
            .collect()
    }

    /// Mean luminance of the image.
    pub fn mean_luminance(&self) -> f32 {
        let sum: f64 = self.pixels.iter().map(|p| f64::from(luminance(p.radiance()))).sum();
        (sum / self.pixels.len().max(1) as f64) as f32
    }
}
