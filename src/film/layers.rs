//! The layers of a picture: what each of them shows of a pixel.

use super::pixel::{Parts, Pixel};
use crate::imagefile::SampleKind;
use crate::math::{Color, Vec3};

/// A layer of the output file: a name, and one to four channels per pixel.
#[derive(Clone, Copy, Debug)]
pub struct Layer {
    /// What `--aov` calls it, and the first part of its channels' names; empty for the beauty.
    pub name: &'static str,
    /// Names of its channels.
    pub channels: &'static [&'static str],
    /// The precision in the file.
    pub kind: SampleKind,
    /// Part of the default set.
    pub basic: bool,
    /// Shows what was denoised as it was before.
    pub noisy: bool,
    pub(super) values: fn(&Shown) -> [f32; 4],
}

/// A pixel as the layers see it.
pub(super) struct Shown<'a> {
    pub pixel: &'a Pixel,
    /// The parts of its radiance without noise, if the picture was denoised.
    pub denoised: Option<&'a Parts>,
}

impl Shown<'_> {
    /// Radiance.
    pub fn radiance(&self) -> Color {
        self.denoised.map_or_else(|| self.pixel.radiance(), |parts| parts.iter().sum())
    }

    /// Part `k` of the radiance.
    fn part(&self, k: usize) -> Color {
        self.denoised.map_or_else(|| self.pixel.part(k), |parts| parts[k])
    }
}

impl std::ops::Deref for Shown<'_> {
    type Target = Pixel;

    fn deref(&self) -> &Pixel {
        self.pixel
    }
}

const ONE: &[&str] = &[""];
const RGB: &[&str] = &["R", "G", "B"];
const RGBA: &[&str] = &["R", "G", "B", "A"];
const XYZ: &[&str] = &["X", "Y", "Z"];

/// Every layer, in the order of the file.
pub const LAYERS: &[Layer] = &[
    Layer::new("", RGBA, |p| p.radiance().extend(p.covered * p.weight()).to_array()).basic(),
    Layer::new("diffuse_direct", RGB, |p| three(p.part(0))).basic(),
    Layer::new("diffuse_indirect", RGB, |p| three(p.part(1))).basic(),
    Layer::new("glossy_direct", RGB, |p| three(p.part(2))).basic(),
    Layer::new("glossy_indirect", RGB, |p| three(p.part(3))).basic(),
    Layer::new("emission", RGB, |p| three(p.part(4))).basic(),
    Layer::new("albedo", RGB, |p| three(p.albedo())).basic(),
    Layer::new("N", XYZ, |p| three(p.normal())).basic(),
    Layer::new("P", XYZ, |p| three(p.position())).float(),
    Layer::new("Z", ONE, |p| one(p.distance())).basic().float(),
    Layer::new("gi.records", ONE, |p| one(p.records * p.weight())),
    Layer::new("gi.status", ONE, |p| one((p.cached + 2.0 * p.traced) * p.weight())),
    Layer::new("gi.error", ONE, |p| one(p.error * p.weight())),
    Layer::new("gi.a", ONE, |p| one(p.allowed_error())),
    Layer::new("gi.irradiance", RGB, |p| three(p.irradiance * p.weight())),
    Layer::new("variance", RGB, |p| three(p.variance())).float(),
    Layer::new("noisy.diffuse_direct", RGB, |p| three(p.pixel.part(0))).noisy(),
    Layer::new("noisy.diffuse_indirect", RGB, |p| three(p.pixel.part(1))).noisy(),
    Layer::new("noisy.glossy_direct", RGB, |p| three(p.pixel.part(2))).noisy(),
    Layer::new("noisy.glossy_indirect", RGB, |p| three(p.pixel.part(3))).noisy(),
];

fn one(x: f32) -> [f32; 4] {
    [x, 0.0, 0.0, 0.0]
}

fn three(v: Vec3) -> [f32; 4] {
    v.extend(0.0).to_array()
}

impl Layer {
    const fn new(
        name: &'static str, channels: &'static [&'static str], values: fn(&Shown) -> [f32; 4],
    ) -> Self {
        Self { name, channels, kind: SampleKind::Half, basic: false, noisy: false, values }
    }

    const fn basic(self) -> Self {
        Self { basic: true, ..self }
    }

    const fn noisy(self) -> Self {
        Self { noisy: true, ..self }
    }

    const fn float(self) -> Self {
        Self { kind: SampleKind::Float, ..self }
    }

    /// The full name of channel `k`, such as `diffuse_direct.R` or `Z`.
    pub fn channel_name(&self, k: usize) -> String {
        match (self.name, self.channels[k]) {
            ("", channel) => channel.to_owned(),
            (name, "") => name.to_owned(),
            (name, channel) => format!("{name}.{channel}"),
        }
    }
}
