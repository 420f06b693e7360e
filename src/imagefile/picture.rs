//! The picture: named channels of one size, and attributes.
//!
//! The film becomes a picture, OpenEXR files hold one, and comparisons and environments read one.

use crate::error::{Error, Result};
use crate::math::Color;
use std::path::Path;

/// How the samples of a channel are stored in a file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SampleKind {
    /// 16-bit floating point: 11 bits of precision, at most 65504.
    Half,
    /// 32-bit floating point.
    Float,
    /// 32-bit unsigned integer; exact here up to 2^24.
    Uint,
}

/// One named plane of samples.
#[derive(Clone, Debug, PartialEq)]
pub struct Channel {
    /// The name in the file. A dot separates layer and component: `diffuse_indirect.R`.
    pub name: String,
    /// The precision in the file. Samples are rounded to it when they are written: to the nearest,
    /// ties to even. A layer with a finite value beyond the largest half is written as `Float`.
    pub kind: SampleKind,
    /// One sample per pixel, row by row from the top.
    pub samples: Vec<f32>,
}

/// The value of a header attribute.
#[derive(Clone, Debug, PartialEq)]
pub enum Attribute {
    /// `string`.
    Text(String),
    /// `int`.
    Int(i32),
    /// `float`.
    Float(f32),
    /// `double`.
    Double(f64),
    /// `v2f`.
    V2f([f32; 2]),
    /// `v3f`.
    V3f([f32; 3]),
    /// `m44f` in the order of the file: row by row for row vectors (`v M`). A translation is in
    /// the last four values. [`glam::Mat4::to_cols_array`] of a matrix for column vectors gives
    /// this order.
    M44f([f32; 16]),
    /// `chromaticities`: x and y of red, green, blue and white.
    Chromaticities([f32; 8]),
}

/// The chromaticities of linear Rec. 709 with white D65 [BT709, Section 1].
pub const REC_709: Attribute =
    Attribute::Chromaticities([0.64, 0.33, 0.30, 0.60, 0.15, 0.06, 0.3127, 0.3290]);

/// Where the pixels of a [`Picture`] lie in a larger one.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Crop {
    /// Column and row of the top left pixel in the whole picture; negative for overscan.
    pub origin: [i32; 2],
    /// Columns and rows of the whole picture.
    pub whole: [u32; 2],
}

/// Channels of one size, and attributes.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Picture {
    /// Columns.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// The planes, in any order; files keep them sorted by name.
    pub channels: Vec<Channel>,
    /// Names and values, beside those that every file has (windows, compression and so on).
    pub attributes: Vec<(String, Attribute)>,
    /// Set when the pixels are only a part of the picture.
    pub crop: Option<Crop>,
}

impl Picture {
    /// A picture without channels and attributes.
    pub fn new([width, height]: [u32; 2]) -> Self {
        Self { width, height, ..Self::default() }
    }

    /// Adds a channel.
    pub fn add(&mut self, name: impl Into<String>, kind: SampleKind, samples: Vec<f32>) {
        self.channels.push(Channel { name: name.into(), kind, samples });
    }

    /// Adds the channels `<prefix>R`, `<prefix>G` and `<prefix>B`.
    pub fn add_colors(&mut self, prefix: &str, kind: SampleKind, colors: &[Color]) {
        for (k, component) in ["R", "G", "B"].into_iter().enumerate() {
            let samples = colors.iter().map(|c| c[k]).collect();
            self.add(format!("{prefix}{component}"), kind, samples);
        }
    }

    /// The channel called `name`.
    pub fn channel(&self, name: &str) -> Option<&Channel> {
        self.channels.iter().find(|c| c.name == name)
    }

    /// The attribute called `name`.
    pub fn attribute(&self, name: &str) -> Option<&Attribute> {
        self.attributes.iter().find(|(n, _)| n == name).map(|(_, value)| value)
    }

    /// The samples of the channels `<prefix>R`, `<prefix>G` and `<prefix>B`.
    ///
    /// # Errors
    /// The first of them that is missing, or that has too few or too many samples.
    pub fn planes(&self, prefix: &str) -> std::result::Result<[&[f32]; 3], String> {
        let size = self.width as usize * self.height as usize;
        let plane = |component: &str| {
            let name = format!("{prefix}{component}");
            let channel = self
                .channel(&name)
                .ok_or_else(|| format!("has no channel '{name}', only {}", self.channel_names()))?;
            match channel.samples.len() {
                count if count == size => Ok(channel.samples.as_slice()),
                count => Err(format!("channel '{name}' has {count} samples for {size} pixels")),
            }
        };
        Ok([plane("R")?, plane("G")?, plane("B")?])
    }

    /// The colours of the channels `<prefix>R`, `<prefix>G` and `<prefix>B`.
    ///
    /// # Errors
    /// As for [`Picture::planes`].
    pub fn colors(&self, prefix: &str) -> std::result::Result<Vec<Color>, String> {
        let [r, g, b] = self.planes(prefix)?;
        Ok(r.iter().zip(g).zip(b).map(|((&r, &g), &b)| Color::new(r, g, b)).collect())
    }

    /// The names of the first channels, for messages.
    pub(super) fn channel_names(&self) -> String {
        let names: Vec<_> = self.channels.iter().take(24).map(|c| c.name.as_str()).collect();
        names.join(", ")
    }
}

/// The extension of an output's name in lower case, empty without one.
///
/// # Errors
/// [`Error::Unsupported`] naming `path` and what may be written if it is none of `known`.
pub fn check_extension(path: &Path, known: &[&str]) -> Result<String> {
    let extension = path.extension().unwrap_or_default().to_string_lossy().to_lowercase();
    if known.contains(&extension.as_str()) {
        return Ok(extension);
    }
    let names: Vec<_> = known.iter().filter(|e| !e.is_empty()).map(|e| format!(".{e}")).collect();
    let what = format!(
        "files called .{extension} cannot be written here; give it a name that ends in {}",
        names.join(" or ")
    );
    Err(Error::unsupported(path, "", what))
}
