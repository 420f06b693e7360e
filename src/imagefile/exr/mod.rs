//! OpenEXR files: pictures of many named channels.
//!
//! [`write()`] makes one part of scan lines with ZIP compression, through OpenEXR itself with the
//! cargo feature `openexr` and through the `exr` crate without it. [`read`] always goes through the
//! `exr` crate and accepts whatever that can decode.

mod read;
mod write_exrs;
#[cfg(feature = "openexr")]
mod write_openexr;

pub use read::{read, read_bytes};

use crate::error::{Error, Result};
use crate::fsutil::write_atomically_with;
use half::f16;
use rayon::prelude::*;
use std::borrow::Cow;
use std::collections::HashSet;
use std::path::Path;

/// How the samples of a channel are stored.
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
    /// ties to even, finite values beyond the largest half clamped to that.
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
    /// `m44f`, in the order of the file: row by row for row vectors (`v M`), so a translation is in
    /// the last four values. That is [`glam::Mat4::to_cols_array`] of a matrix for column
    /// vectors.
    M44f([f32; 16]),
    /// `chromaticities`: x and y of red, green, blue and white.
    Chromaticities([f32; 8]),
}

/// The chromaticities of linear Rec. 709 with white D65 [BT709, Section 1].
pub const REC_709: Attribute =
    Attribute::Chromaticities([0.64, 0.33, 0.30, 0.60, 0.15, 0.06, 0.3127, 0.3290]);

/// Where the pixels of a [`Layers`] lie in a larger picture.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Crop {
    /// Column and row of the top left pixel in the whole picture; negative for overscan.
    pub origin: [i32; 2],
    /// Columns and rows of the whole picture.
    pub whole: [u32; 2],
}

/// A picture: channels of one size, and attributes.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Layers {
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

impl Layers {
    /// The channel called `name`.
    pub fn channel(&self, name: &str) -> Option<&Channel> {
        self.channels.iter().find(|c| c.name == name)
    }

    /// The attribute called `name`.
    pub fn attribute(&self, name: &str) -> Option<&Attribute> {
        self.attributes.iter().find(|(n, _)| n == name).map(|(_, value)| value)
    }
}

/// The programs that can write a file. Their files hold the same pixels and attributes in different
/// bytes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Encoder {
    /// OpenEXR's C core.
    #[cfg(feature = "openexr")]
    OpenExr,
    /// The `exr` crate.
    Exrs,
}

impl Default for Encoder {
    fn default() -> Self {
        #[cfg(feature = "openexr")]
        return Self::OpenExr;
        #[cfg(not(feature = "openexr"))]
        return Self::Exrs;
    }
}

/// Writes `layers` to `path` through a temporary file and a rename. The bytes depend on `layers`
/// alone.
///
/// # Errors
/// [`Error::Image`] naming `path` for sizes that do not fit, missing channels, empty, too long or
/// duplicate names, attributes that every file has anyway, and `Uint` samples that are no whole
/// numbers up to 2^24; [`Error::Io`] when the file cannot be written.
pub fn write(path: &Path, layers: &Layers) -> Result<()> {
    write_with(path, layers, Encoder::default())
}

/// [`write()`] with a chosen encoder.
///
/// # Errors
/// As for [`write()`].
pub fn write_with(path: &Path, layers: &Layers, encoder: Encoder) -> Result<()> {
    let image = Prepared::new(layers).map_err(|what| Error::image(path, what))?;
    write_atomically_with(path, |temporary| match encoder {
        #[cfg(feature = "openexr")]
        Encoder::OpenExr => write_openexr::write(temporary, &image)
            .map_err(|what| Error::image(path, format!("OpenEXR: {what}"))),
        Encoder::Exrs => write_exrs::write(temporary, &image).map_err(|e| match e {
            ::exr::error::Error::Io(source) => Error::Io { file: path.to_owned(), source },
            other => Error::image(path, other.to_string()),
        }),
    })
}

/// Samples in the precision of the file.
enum Packed<'a> {
    Half(Vec<f16>),
    Float(&'a [f32]),
    Uint(Vec<u32>),
}

/// A checked picture with its samples converted and its channels sorted by name, as the file wants
/// them.
struct Prepared<'a> {
    size: [usize; 2],
    crop: Crop,
    channels: Vec<(&'a str, Packed<'a>)>,
    attributes: &'a [(String, Attribute)],
    long_names: bool,
}

/// The longest name that every reader of the format accepts.
const SHORT_NAME: usize = 31;
/// The longest name that the format allows.
const LONG_NAME: usize = 255;
/// Coordinates beyond this are not portable between readers.
const MAX_COORDINATE: i64 = (1 << 30) - 1;

/// Attributes that describe the layout of a file and are the writer's business.
const RESERVED: [&str; 13] = [
    "channels",
    "chunkCount",
    "compression",
    "dataWindow",
    "displayWindow",
    "lineOrder",
    "maxSamplesPerPixel",
    "name",
    "pixelAspectRatio",
    "screenWindowCenter",
    "screenWindowWidth",
    "tiles",
    "type",
];

fn check_names<'a>(
    what: &str,
    names: impl Iterator<Item = &'a str>,
) -> std::result::Result<bool, String> {
    let (mut seen, mut long) = (HashSet::new(), false);
    for name in names {
        let shown = name.escape_debug();
        if name.is_empty() || name.len() > LONG_NAME || name.contains('\0') {
            return Err(format!(
                "{what} name '{shown}': must be 1 to {LONG_NAME} bytes without NUL"
            ));
        }
        if !seen.insert(name) {
            return Err(format!("two {what}s are called '{shown}'"));
        }
        long |= name.len() > SHORT_NAME;
    }
    Ok(long)
}

impl<'a> Prepared<'a> {
    fn new(layers: &'a Layers) -> std::result::Result<Self, String> {
        let Layers { width, height, .. } = *layers;
        let crop = layers.crop.unwrap_or(Crop { origin: [0, 0], whole: [width, height] });
        for (origin, extent, whole) in
            [(crop.origin[0], width, crop.whole[0]), (crop.origin[1], height, crop.whole[1])]
        {
            let end = i64::from(origin) + i64::from(extent);
            if extent == 0
                || whole == 0
                || i64::from(origin) < -MAX_COORDINATE
                || end.max(i64::from(whole)) > MAX_COORDINATE
            {
                return Err(format!(
                    "cannot write {width} x {height} pixels at {:?} of {:?}",
                    crop.origin, crop.whole
                ));
            }
        }
        if layers.channels.is_empty() {
            return Err("a picture without channels cannot be written".to_owned());
        }
        let long_channels =
            check_names("channel", layers.channels.iter().map(|c| c.name.as_str()))?;
        let long_attributes =
            check_names("attribute", layers.attributes.iter().map(|(n, _)| n.as_str()))?;
        for (name, value) in &layers.attributes {
            if RESERVED.contains(&name.as_str()) {
                return Err(format!("the attribute '{name}' is set by the writer"));
            }
            if matches!(value, Attribute::Text(t) if t.contains('\0')) {
                return Err(format!("the attribute '{name}' contains a NUL character"));
            }
        }
        let size = [width as usize, height as usize];
        let mut channels = layers
            .channels
            .par_iter()
            .map(|c| Ok((c.name.as_str(), pack(c, size)?)))
            .collect::<std::result::Result<Vec<_>, String>>()?;
        channels.sort_by(|a, b| a.0.as_bytes().cmp(b.0.as_bytes()));
        Ok(Self {
            size,
            crop,
            channels,
            attributes: &layers.attributes,
            long_names: long_channels || long_attributes,
        })
    }
}

/// The largest finite half.
const HALF_MAX: f32 = 65504.0;

/// To the nearest half, ties to even; finite values stay finite.
fn to_half(x: f32) -> f16 {
    f16::from_f32(if x.is_finite() { x.clamp(-HALF_MAX, HALF_MAX) } else { x })
}

/// Every whole number up to this one is a `f32`.
const EXACT_UINT: f32 = (1 << 24) as f32;

fn pack(channel: &Channel, [width, height]: [usize; 2]) -> std::result::Result<Packed<'_>, String> {
    let Channel { name, kind, samples } = channel;
    if samples.len() != width * height {
        return Err(format!(
            "channel '{name}': {} samples for {width} x {height} pixels",
            samples.len()
        ));
    }
    Ok(match kind {
        SampleKind::Half => Packed::Half(samples.iter().map(|&x| to_half(x)).collect()),
        SampleKind::Float => Packed::Float(samples),
        SampleKind::Uint => {
            if let Some(bad) =
                samples.iter().find(|x| !(0.0..=EXACT_UINT).contains(*x) || x.fract() != 0.0)
            {
                return Err(format!(
                    "channel '{name}': {bad} is not a whole number from 0 to 2^24"
                ));
            }
            Packed::Uint(samples.iter().map(|&x| x as u32).collect())
        }
    })
}

/// The bytes of a file's text; other programs write Latin-1 or UTF-8.
fn text_of(bytes: &[u8]) -> Cow<'_, str> {
    match std::str::from_utf8(bytes) {
        Ok(text) => Cow::Borrowed(text),
        Err(_) => Cow::Owned(bytes.iter().map(|&b| char::from(b)).collect()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn halves_are_rounded_to_nearest_even_and_stay_finite() {
        // 2049 lies between the halves 2048 and 2050, 2051 between 2050 and 2052: both ties go to
        // the even mantissa.
        for (x, half) in [
            (2049.0, 2048.0),
            (2051.0, 2052.0),
            (65519.0, 65504.0),
            (65520.0, 65504.0),
            (1e30, 65504.0),
            (-1e30, -65504.0),
        ] {
            assert_eq!(to_half(x).to_f32(), half, "{x}");
        }
        assert_eq!(to_half(f32::INFINITY), f16::INFINITY);
        assert!(to_half(f32::NAN).is_nan());
        assert_eq!(to_half(5.96e-8).to_f32(), 2.0_f32.powi(-24));
        assert_eq!(to_half(2.0_f32.powi(-26)).to_f32(), 0.0);
        assert!(to_half(-0.0).is_sign_negative());
    }

    #[test]
    fn what_cannot_be_written_is_refused_by_name() {
        let channel = |name: &str, kind, samples: &[f32]| Channel {
            name: name.to_owned(),
            kind,
            samples: samples.to_vec(),
        };
        let good = Layers {
            width: 2,
            height: 1,
            channels: vec![channel("R", SampleKind::Half, &[0.0, 1.0])],
            ..Layers::default()
        };
        assert!(Prepared::new(&good).is_ok());
        let refused = |change: &dyn Fn(&mut Layers)| {
            let mut bad = good.clone();
            change(&mut bad);
            Prepared::new(&bad).err().expect("refused")
        };
        assert!(refused(&|l| l.channels.clear()).contains("without channels"));
        assert!(refused(&|l| l.width = 0).contains("0 x 1"));
        assert!(refused(&|l| l.width = 3).contains("'R': 2 samples for 3 x 1"));
        assert!(refused(&|l| l.channels.push(l.channels[0].clone())).contains("called 'R'"));
        assert!(refused(&|l| l.channels[0].name = "a\0".to_owned()).contains("NUL"));
        assert!(
            refused(&|l| l.channels[0] = channel("id", SampleKind::Uint, &[0.5, 1.0]))
                .contains("0.5 is not a whole number")
        );
        assert!(
            refused(&|l| l.channels[0] = channel("id", SampleKind::Uint, &[f32::NAN, 1.0]))
                .contains("NaN")
        );
        assert!(
            refused(&|l| l.attributes.push(("dataWindow".to_owned(), Attribute::Int(1))))
                .contains("dataWindow")
        );
        assert!(
            refused(&|l| l.attributes.push(("a".to_owned(), Attribute::Text("\0".to_owned()))))
                .contains("NUL")
        );
        assert!(
            refused(&|l| l.crop = Some(Crop { origin: [i32::MAX, 0], whole: [4, 4] }))
                .contains("2147483647")
        );
    }
}
