//! Writing through OpenEXR's C core.

use super::prepared::{Packed, Prepared};
use crate::ffi::openexr::{Channel, Result, Samples, Window, Writer};
use crate::imagefile::picture::Attribute;
use std::path::Path;

/// zlib's effort. On rendered half layers level 6 takes half as long again for files 2 % smaller,
/// and 9 ten times as long for 3 %; on 32-bit layers the level hardly matters.
const ZIP_LEVEL: u8 = 4;

/// The rectangle of `size` pixels at `origin`, whose bounds [`Prepared`] has checked.
fn window(origin: [i32; 2], size: [usize; 2]) -> Window {
    Window { min: origin, max: [origin[0] + size[0] as i32 - 1, origin[1] + size[1] as i32 - 1] }
}

/// Writes `image` to the file `path`.
pub(super) fn write(path: &Path, image: &Prepared) -> Result<()> {
    let data = window(image.crop.origin, image.size);
    let display = window([0, 0], image.crop.whole.map(|n| n as usize));
    let mut writer = Writer::create(path, data, display, ZIP_LEVEL)?;
    if image.long_names {
        writer.allow_long_names()?;
    }
    for (name, value) in image.attributes {
        match value {
            Attribute::Text(text) => writer.set_text(name, text),
            Attribute::Int(x) => writer.set_int(name, *x),
            Attribute::Float(x) => writer.set_float(name, *x),
            Attribute::Double(x) => writer.set_double(name, *x),
            Attribute::V2f(x) => writer.set_v2f(name, *x),
            Attribute::V3f(x) => writer.set_v3f(name, *x),
            Attribute::M44f(x) => writer.set_m44f(name, *x),
            Attribute::Chromaticities(x) => writer.set_chromaticities(name, *x),
        }?;
    }
    let channels: Vec<_> = image
        .channels
        .iter()
        .map(|(name, samples)| {
            let samples = match samples {
                Packed::Half(s) => Samples::Half(s),
                Packed::Float(s) => Samples::Float(s),
                Packed::Uint(s) => Samples::Uint(s),
            };
            Channel { name, samples }
        })
        .collect();
    writer.write(&channels)
}
