//! Image files in and out: EXR, HDR, PNG, JPEG, WebP. Pixels and attributes, no rendering.

mod guard;
mod picture;
pub mod exposure;
pub mod ldr;
pub mod exr;
pub mod hdr;

pub use exposure::Exposure;
pub use ldr::{TextureImage, TexturePixels};
pub use picture::{Attribute, Channel, Crop, Picture, REC_709, SampleKind, check_extension};
