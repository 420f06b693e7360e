//! The layers of a picture: what each of them shows of a pixel.

use super::pixel::Pixel;
use crate::imagefile::SampleKind;
use crate::math::Vec3;

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
    pub(super) values: fn(&Pixel) -> [f32; 4],
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
    Layer::new("albedo", RGB, |p| three(p.albedo * p.weight())).basic(),
    Layer::new("N", XYZ, |p| three(p.normal.normalize_or_zero())).basic(),
    Layer::new("P", XYZ, |p| three(p.position())).float(),
    Layer::new("Z", ONE, |p| one(p.distance())).basic().float(),
    Layer::new("gi.records", ONE, |p| one(p.records * p.weight())),
    Layer::new("gi.status", ONE, |p| one((p.cached + 2.0 * p.traced) * p.weight())),
    Layer::new("gi.error", ONE, |p| one(p.error * p.weight())),
    Layer::new("gi.a", ONE, |p| one(p.allowed_error())),
    Layer::new("gi.irradiance", RGB, |p| three(p.irradiance * p.weight())),
    Layer::new("variance", RGB, |p| three(p.variance())).float(),
];

fn one(x: f32) -> [f32; 4] {
    [x, 0.0, 0.0, 0.0]
}

fn three(v: Vec3) -> [f32; 4] {
    v.extend(0.0).to_array()
}

impl Layer {
    const fn new(
        name: &'static str, channels: &'static [&'static str], values: fn(&Pixel) -> [f32; 4],
    ) -> Self {
        Self { name, channels, kind: SampleKind::Half, basic: false, values }
    }

    const fn basic(self) -> Self {
        Self { basic: true, ..self }
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
