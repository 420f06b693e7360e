//! Reading, through the `exr` crate.

use crate::error::{Error, Result};
use crate::fsutil;
use crate::imagefile::guard::guarded;
use crate::imagefile::picture::{Attribute, Channel, Crop, Picture, SampleKind};
use ::exr::image::{AnyChannels, FlatImage, FlatSamples, Layer};
use ::exr::meta::MetaData;
use ::exr::meta::attribute::{AttributeValue, Chromaticities, Compression};
use ::exr::meta::header::{Header, standard_names};
use ::exr::prelude::{ReadChannels, ReadLayers, Vec2};
use std::borrow::Cow;
use std::collections::HashSet;
use std::io::Cursor;
use std::path::Path;

/// Bytes of decoded samples beyond which a file is refused.
const MAX_BYTES: u64 = 1 << 34;
/// The most that a byte of a file can become: deflate reaches 1032, the other lossless methods
/// less.
const MAX_RATIO: u64 = 2048;
/// As [`MAX_RATIO`] for DWA, which deflates run lengths.
const MAX_RATIO_DWA: u64 = 1 << 16;

/// Reads the file `path`: all parts, their largest level, any compression that the `exr` crate
/// knows.
///
/// Several parts become one picture. Channels of the first part keep their names; channels of a
/// later part get the part's name and a dot as a prefix unless they have it already. The picture
/// has the attributes of the first part, sorted by name, without types that [`Attribute`] has no
/// variant for.
///
/// # Errors
/// [`Error::Io`], and [`Error::Image`] naming the file and what is wrong with it: damaged, deep or
/// subsampled data, parts of different windows, or a size that the file's length cannot hold.
pub fn read(path: &Path) -> Result<Picture> {
    let bytes = fsutil::read(path)?;
    read_bytes(&bytes).map_err(|what| Error::image(path, what))
}

/// [`read`] from memory.
///
/// # Errors
/// What is wrong with the file, without its name.
pub fn read_bytes(bytes: &[u8]) -> std::result::Result<Picture, String> {
    read_bytes_within(bytes, MAX_BYTES)
}

/// [`read_bytes`] of a file that takes at most `most` bytes of memory.
pub(in crate::imagefile) fn read_bytes_within(
    bytes: &[u8], most: u64,
) -> std::result::Result<Picture, String> {
    guarded(|| decode(bytes, most))
}

fn decode(bytes: &[u8], most: u64) -> std::result::Result<Picture, String> {
    let meta =
        MetaData::read_from_buffered(Cursor::new(bytes), false).map_err(|e| not_readable(&e))?;
    check(&meta.headers, bytes.len() as u64, most)?;
    let image: FlatImage = ::exr::prelude::read()
        .no_deep_data()
        .largest_resolution_level()
        .all_channels()
        .all_layers()
        .all_attributes()
        // A panic on threads of the crate's own would hang or end the process.
        .non_parallel()
        .from_buffered(Cursor::new(bytes))
        .map_err(|e| not_readable(&e))?;
    let first = meta.headers.first().ok_or("has no parts")?;
    let size = first.layer_size;
    let mut channels = Vec::new();
    for (index, layer) in image.layer_data.into_iter().enumerate() {
        channels.extend(channels_of(layer, index > 0));
    }
    let mut names = HashSet::new();
    if let Some(twice) = channels.iter().find(|c| !names.insert(c.name.as_str())) {
        return Err(format!("has two channels called '{}'", twice.name));
    }
    let extent = |n: usize| u32::try_from(n).map_err(|_| "is too large".to_owned());
    Ok(Picture {
        width: extent(size.0)?,
        height: extent(size.1)?,
        channels,
        attributes: attributes_of(first),
        crop: crop_of(first)?,
    })
}

fn not_readable(error: &::exr::error::Error) -> String {
    format!("not a readable OpenEXR file: {error}")
}

/// Refuses, before any pixel memory is asked for, what cannot be read or cannot be true.
fn check(headers: &[Header], file_bytes: u64, most: u64) -> std::result::Result<(), String> {
    let first = headers.first().ok_or("has no parts")?;
    let mut total = 0u64;
    for header in headers {
        let Vec2(width, height) = header.layer_size;
        if width == 0 || height == 0 || header.channels.list.is_empty() {
            return Err(format!(
                "has no pixels ({width} x {height}, {} channels)",
                header.channels.list.len()
            ));
        }
        if header.deep {
            return Err("holds deep data, which cannot be read".to_owned());
        }
        if header.data_window() != first.data_window() {
            return Err("has parts of different data windows, which cannot be read as one picture"
                .to_owned());
        }
        if let Some(c) = header.channels.list.iter().find(|c| c.sampling != Vec2(1, 1)) {
            return Err(format!(
                "has the subsampled channel '{}', which cannot be read",
                text_of(c.name.as_slice())
            ));
        }
        let bytes = (width as u64)
            .saturating_mul(height as u64)
            .saturating_mul(header.channels.bytes_per_pixel as u64);
        let ratio = if matches!(header.compression, Compression::DWAA(_) | Compression::DWAB(_)) {
            MAX_RATIO_DWA
        } else {
            MAX_RATIO
        };
        // Samples become floats too.
        let floats = 4 * header.channels.list.len() as u64;
        let pixels = (width as u64).saturating_mul(height as u64);
        total = total.saturating_add(bytes).saturating_add(pixels.saturating_mul(floats));
        if total > most && bytes <= file_bytes.saturating_mul(ratio) {
            return Err(format!(
                "has {width} x {height} pixels of {} channels, which take more memory than {most} bytes",
                header.channels.list.len()
            ));
        }
        if bytes > file_bytes.saturating_mul(ratio) {
            return Err(format!(
                "claims {width} x {height} pixels of {} channels, which {} bytes cannot hold",
                header.channels.list.len(),
                file_bytes
            ));
        }
    }
    Ok(())
}

fn channels_of(
    layer: Layer<AnyChannels<FlatSamples>>, prefix: bool,
) -> impl Iterator<Item = Channel> {
    let part = layer
        .attributes
        .layer_name
        .filter(|_| prefix)
        .map(|n| format!("{}.", text_of(n.as_slice())));
    layer.channel_data.list.into_iter().map(move |channel| {
        let mut name = text_of(channel.name.as_slice()).into_owned();
        if let Some(part) = part.as_ref().filter(|p| !name.starts_with(p.as_str())) {
            name.insert_str(0, part);
        }
        let (kind, samples) = match channel.sample_data {
            FlatSamples::F16(s) => (SampleKind::Half, s.into_iter().map(|x| x.to_f32()).collect()),
            FlatSamples::F32(s) => (SampleKind::Float, s),
            FlatSamples::U32(s) => (SampleKind::Uint, s.into_iter().map(|x| x as f32).collect()),
        };
        Channel { name, kind, samples }
    })
}

/// The header's attributes that [`Attribute`] can hold, without those of the layout, sorted by
/// name.
fn attributes_of(header: &Header) -> Vec<(String, Attribute)> {
    let layout = [
        standard_names::NAME,
        standard_names::BLOCK_TYPE,
        standard_names::CHUNKS,
        standard_names::PIXEL_ASPECT,
        standard_names::WINDOW_CENTER,
        standard_names::WINDOW_WIDTH,
        standard_names::MAX_SAMPLES,
        standard_names::DEEP_DATA_VERSION,
    ];
    let mut attributes: Vec<_> = header
        .all_named_attributes()
        .filter(|(name, _)| !layout.contains(name))
        .filter_map(|(name, value)| Some((text_of(name).into_owned(), attribute_of(value)?)))
        .collect();
    attributes.sort_by(|a, b| a.0.cmp(&b.0));
    attributes
}

fn attribute_of(value: AttributeValue) -> Option<Attribute> {
    Some(match value {
        AttributeValue::Text(t) => Attribute::Text(text_of(t.as_slice()).into_owned()),
        AttributeValue::I32(x) => Attribute::Int(x),
        AttributeValue::F32(x) => Attribute::Float(x),
        AttributeValue::F64(x) => Attribute::Double(x),
        AttributeValue::FloatVec2(Vec2(x, y)) => Attribute::V2f([x, y]),
        AttributeValue::FloatVec3((x, y, z)) => Attribute::V3f([x, y, z]),
        AttributeValue::Matrix4x4(m) => Attribute::M44f(m),
        AttributeValue::Chromaticities(Chromaticities { red, green, blue, white }) => {
            Attribute::Chromaticities([
                red.0, red.1, green.0, green.1, blue.0, blue.1, white.0, white.1,
            ])
        }
        _ => return None,
    })
}

/// The crop, when the data window is not the whole display window. Positions count from the display
/// window's corner.
fn crop_of(header: &Header) -> std::result::Result<Option<Crop>, String> {
    let (data, display) = (header.data_window(), header.shared_attributes.display_window);
    if data == display {
        return Ok(None);
    }
    let out_of_range = |_| "has windows out of range".to_owned();
    let offset = |a: i32, b: i32| i32::try_from(i64::from(a) - i64::from(b)).map_err(out_of_range);
    let extent = |n: usize| u32::try_from(n).map_err(out_of_range);
    Ok(Some(Crop {
        origin: [
            offset(data.position.0, display.position.0)?,
            offset(data.position.1, display.position.1)?,
        ],
        whole: [extent(display.size.0)?, extent(display.size.1)?],
    }))
}

/// The bytes of a file's text; other programs write Latin-1 or UTF-8.
fn text_of(bytes: &[u8]) -> Cow<'_, str> {
    match std::str::from_utf8(bytes) {
        Ok(text) => Cow::Borrowed(text),
        Err(_) => Cow::Owned(bytes.iter().map(|&b| char::from(b)).collect()),
    }
}
