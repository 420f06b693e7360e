//! Writing through the `exr` crate.
//!
//! The crate's own image writer keeps attributes in hash maps, and the bytes of its files differ
//! from run to run. The writer also compresses on threads of its own. This module lays the file out
//! by hand (magic, version, attributes, offset table, chunks) from the crate's parts and compresses
//! the chunks on rayon's threads.

use super::prepared::{Packed, Prepared};
use crate::imagefile::picture::Attribute;
use ::exr::block::chunk::Chunk;
use ::exr::block::lines::LineRefMut;
use ::exr::block::{BlockIndex, UncompressedBlock};
use ::exr::error::{Result, UnitResult};
use ::exr::meta::attribute::{
    self, AttributeValue, ChannelDescription, Chromaticities, Compression, IntegerBounds,
    LineOrder, SampleType, Text,
};
use ::exr::meta::header::{Header, LayerAttributes};
use ::exr::meta::{BlockDescription, Requirements, magic_number, sequence_end};
use ::exr::prelude::Vec2;
use rayon::prelude::*;
use std::fs::File;
use std::io::{BufWriter, Seek, SeekFrom, Write};
use std::path::Path;

/// Uncompressed bytes per batch of chunks; bounds memory, has no influence on the file.
const WAVE_BYTES: usize = 64 << 20;

fn text(s: &str) -> Text {
    Text::from_slice_unchecked(s.as_bytes())
}

/// Our attribute as the crate's.
fn value_of(attribute: &Attribute) -> AttributeValue {
    match *attribute {
        Attribute::Text(ref t) => AttributeValue::Text(text(t)),
        Attribute::Int(x) => AttributeValue::I32(x),
        Attribute::Float(x) => AttributeValue::F32(x),
        Attribute::Double(x) => AttributeValue::F64(x),
        Attribute::V2f([x, y]) => AttributeValue::FloatVec2(Vec2(x, y)),
        Attribute::V3f([x, y, z]) => AttributeValue::FloatVec3((x, y, z)),
        Attribute::M44f(m) => AttributeValue::Matrix4x4(m),
        Attribute::Chromaticities([rx, ry, gx, gy, bx, by, wx, wy]) => {
            AttributeValue::Chromaticities(Chromaticities {
                red: Vec2(rx, ry),
                green: Vec2(gx, gy),
                blue: Vec2(bx, by),
                white: Vec2(wx, wy),
            })
        }
    }
}

/// The header without our attributes.
fn header_of(image: &Prepared) -> Header {
    let channels = image.channels.iter().map(|(name, samples)| {
        let kind = match samples {
            Packed::Half(_) => SampleType::F16,
            Packed::Float(_) => SampleType::F32,
            Packed::Uint(_) => SampleType::U32,
        };
        ChannelDescription::new(text(name), kind, false)
    });
    let mut header =
        Header::new(Text::default(), (image.size[0], image.size[1]), channels.collect())
            .with_encoding(Compression::ZIP16, BlockDescription::ScanLines, LineOrder::Increasing)
            .with_display_window(IntegerBounds::from_dimensions((
                image.crop.whole[0] as usize,
                image.crop.whole[1] as usize,
            )))
            .with_attributes(LayerAttributes::default());
    header.own_attributes.layer_position = Vec2(image.crop.origin[0], image.crop.origin[1]);
    header.own_attributes.screen_window_width = 1.0;
    header
}

/// Copies one line of one channel into its place in a block.
fn fill_line(line: LineRefMut, image: &Prepared) -> UnitResult {
    let start = line.location.position.y() * image.size[0] + line.location.position.x();
    let range = start..start + line.location.sample_count;
    match &image.channels[line.location.channel].1 {
        Packed::Half(s) => line.write_samples_from_slice(&s[range]),
        Packed::Float(s) => line.write_samples_from_slice(&s[range]),
        Packed::Uint(s) => line.write_samples_from_slice(&s[range]),
    }
}

fn compress(header: &Header, image: &Prepared, first_row: usize, rows: usize) -> Result<Chunk> {
    let index = BlockIndex {
        layer: 0,
        level: Vec2(0, 0),
        pixel_position: Vec2(0, first_row),
        pixel_size: Vec2(image.size[0], rows),
    };
    let mut result = Ok(());
    let block = UncompressedBlock::from_lines(&header.channels, index, |line| {
        if let Err(e) = fill_line(line, image) {
            result = Err(e);
        }
    });
    result?;
    block.compress_to_chunk(std::slice::from_ref(header))
}

/// Writes `image` to the file `path`.
pub(super) fn write(path: &Path, image: &Prepared) -> UnitResult {
    let header = header_of(image);
    let mut file = BufWriter::new(File::create(path)?);
    magic_number::write(&mut file)?;
    Requirements {
        file_format_version: 2,
        is_single_layer_and_tiled: false,
        has_long_names: image.long_names,
        has_deep_data: false,
        has_multiple_layers: false,
    }
    .write(&mut file)?;
    for (name, value) in header.all_named_attributes() {
        attribute::write(name, &value, &mut file)?;
    }
    for (name, value) in image.attributes {
        attribute::write(name.as_bytes(), &value_of(value), &mut file)?;
    }
    sequence_end::write(&mut file)?;

    let rows = Compression::ZIP16.scan_lines_per_block();
    let table_at = file.stream_position()?;
    let mut offsets: Vec<u64> = Vec::with_capacity(header.chunk_count);
    file.write_all(&vec![0; header.chunk_count * size_of::<u64>()])?;
    let starts: Vec<usize> = (0..image.size[1]).step_by(rows).collect();
    let wave =
        (WAVE_BYTES / header.max_block_byte_size().max(1)).max(2 * rayon::current_num_threads());
    for wave in starts.chunks(wave) {
        let chunks = wave
            .par_iter()
            .map(|&y| compress(&header, image, y, rows.min(image.size[1] - y)))
            .collect::<Result<Vec<_>>>()?;
        for chunk in chunks {
            offsets.push(file.stream_position()?);
            chunk.write(&mut file, 1)?;
        }
    }
    file.seek(SeekFrom::Start(table_at))?;
    for offset in offsets {
        file.write_all(&offset.to_le_bytes())?;
    }
    file.flush()?;
    Ok(())
}
