//! Sampling of images as textures, with transforms and colour spaces.

mod sample;
mod summed;

pub use sample::lookup;
pub use summed::{SummedTable, Window, area, integrals, window_of};

pub use crate::imagefile::{TextureImage, TexturePixels};

use crate::math::Vec2;
use std::sync::Arc;

/// How texture coordinates outside [0, 1] are mapped into it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum Wrap {
    /// The image repeats.
    #[default]
    Repeat,
    /// Every second repetition is mirrored.
    Mirror,
    /// The border continues.
    Clamp,
}

/// How the stored numbers become linear ones.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum ColorSpace {
    /// sRGB transfer function on RGB, alpha linear.
    #[default]
    Srgb,
    /// Numbers as they stand.
    Linear,
}

/// An image with its sampler.
#[derive(Clone, Debug)]
pub struct Texture {
    /// The pixels.
    pub image: Arc<TextureImage>,
    /// Horizontal wrapping.
    pub wrap_s: Wrap,
    /// Vertical wrapping.
    pub wrap_t: Wrap,
    /// Nearest pixel instead of bilinear interpolation.
    pub nearest: bool,
}

/// A use of a texture by a material: which one, with which coordinates, read how.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TextureRef {
    /// Index into the scene's textures.
    pub texture: u32,
    /// Texture coordinate set, 0 or 1.
    pub uv_set: u8,
    /// KHR_texture_transform: `uv' = offset + R(rotation) (scale * uv)`.
    pub offset: Vec2,
    /// Counter-clockwise rotation in radians.
    pub rotation: f32,
    /// Scale.
    pub scale: Vec2,
    /// sRGB for colours, linear for data.
    pub color_space: ColorSpace,
}
