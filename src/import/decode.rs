//! shim until imagefile::ldr::decode is there
use crate::imagefile::{TextureImage, TexturePixels};
pub(super) fn decode(bytes: &[u8]) -> std::result::Result<TextureImage, String> {
    let image = image::load_from_memory(bytes).map_err(|e| e.to_string())?.to_rgba8();
    let (width, height) = image.dimensions();
    Ok(TextureImage { width, height, pixels: TexturePixels::Rgba8(image.pixels().map(|p| p.0).collect()) })
}
