//! Image files in and out: EXR, HDR, PNG, JPEG, WebP. Pixels and attributes, no rendering.

pub mod exr;
pub mod hdr;
pub mod ldr;

/// Decoded pixels, shared by all textures that show them.
#[derive(Clone, Debug, PartialEq)]
pub struct TextureImage {
    /// Columns.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// RGBA of each pixel, row by row from the top; `width * height` entries.
    pub pixels: TexturePixels,
}

/// The stored precision of a [`TextureImage`].
#[derive(Clone, Debug, PartialEq)]
pub enum TexturePixels {
    /// 8 bits per channel.
    Rgba8(Vec<[u8; 4]>),
    /// 16 bits per channel.
    Rgba16(Vec<[u16; 4]>),
}
