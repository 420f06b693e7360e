//! How far a picture is from a reference.

pub mod flip;

use crate::error::{Error, Result};
use crate::imagefile::exposure::{MID_GRAY, luminances};
use crate::imagefile::ldr::{self, encode_srgb};
use crate::imagefile::{Picture, exr};
use crate::math::Color;
use serde::Serialize;
use std::fmt::Write as _;
use std::ops::RangeInclusive;
use std::path::Path;

/// Added to the denominators of relMSE and MAPE, which keeps relative errors of dark pixels finite.
const EPSILON: f64 = 0.01;

/// Median luminances that a display shows as they are: from nearly black to white.
const DISPLAYED: RangeInclusive<f32> = 0.005..=4.0;

/// What to compare.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Options {
    /// Compare `<prefix>.R`, `.G`, `.B` instead of `R`, `G`, `B`.
    pub channel_prefix: Option<String>,
}

/// How far `x`, the image, is from `r`, the reference. Means are over the compared pixels and their
/// three channels.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Report {
    /// Columns.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// Compared pixels: those whose reference alpha is not 0, all if the reference has no alpha.
    pub pixels: u64,
    /// Pixels left out because their reference alpha is 0.
    pub pixels_left_out: u64,
    /// Mean of (x - r)^2 / (r^2 + 0.01).
    pub relmse: f64,
    /// Square root of the mean of (x - r)^2.
    pub rmse: f64,
    /// Mean of |x - r| / (|r| + 0.01).
    pub mape: f64,
    /// Sum of x over sum of r; none where the reference is black.
    pub mean_ratio: Option<f64>,
    /// The same for each of R, G and B.
    pub mean_ratio_rgb: [Option<f64>; 3],
    /// Stops by which both pictures were exposed for PSNR and FLIP: 0 unless the median luminance
    /// of the reference is below 0.005 or above 4, as in photometric units, and then what
    /// takes it to 0.18.
    pub exposure: f32,
    /// Decibels between the pictures as a display shows them (clamped, sRGB), relative to its
    /// white; none if they are equal.
    pub psnr: Option<f64>,
    /// Mean LDR-FLIP, from 0 to 1, of the clamped pictures at 67 pixels per degree [Andersson20,
    /// Section 4].
    pub flip: f64,
}

impl Report {
    /// A table for people.
    pub fn text(&self) -> String {
        let number = |x: Option<f64>| x.map_or_else(|| "-".to_owned(), |x| format!("{x:.6}"));
        let rgb = self.mean_ratio_rgb.map(number);
        let mut text = String::new();
        let mut row = |name: &str, value: String| {
            // Writing to a string cannot fail.
            let _ = writeln!(text, "{name:<12} {value}");
        };
        row("size", format!("{} x {}", self.width, self.height));
        row("pixels", format!("{} compared, {} left out", self.pixels, self.pixels_left_out));
        row("relmse", format!("{:.4e}", self.relmse));
        row("rmse", format!("{:.4e}", self.rmse));
        row("mape", format!("{:.3} %", 100.0 * self.mape));
        row(
            "mean ratio",
            format!("{}  (R {}, G {}, B {})", number(self.mean_ratio), rgb[0], rgb[1], rgb[2]),
        );
        if self.exposure != 0.0 {
            row("exposure", format!("{:+.2} stops for psnr and flip", self.exposure));
        }
        row(
            "psnr",
            self.psnr.map_or_else(|| "equal on a display".to_owned(), |x| format!("{x:.2} dB")),
        );
        row("flip", format!("{:.5}", self.flip));
        text
    }
}

/// A report, and the FLIP difference of each pixel.
#[derive(Clone, Debug, PartialEq)]
pub struct Comparison {
    /// The numbers.
    pub report: Report,
    /// LDR-FLIP of each pixel, row by row from the top, 0 where left out.
    pub flip: Vec<f32>,
}

impl Comparison {
    /// Writes the FLIP differences to the PNG or JPEG file `path`, black for none to pale yellow
    /// for 1.
    ///
    /// # Errors
    /// [`Error::Io`] naming `path`.
    pub fn write_flip_map(&self, path: &Path) -> Result<()> {
        ldr::write(path, self.report.width, self.report.height, &flip::color_map(&self.flip))
    }
}

/// Compares the colours of `image` with those of `reference`.
///
/// # Errors
/// [`Error::InvalidArgument`] when the sizes differ, a channel is missing, no pixel is left, or
/// compared values are NaN or infinite (with their number and the first one's place).
pub fn compare(image: &Picture, reference: &Picture, options: &Options) -> Result<Report> {
    compare_pixels(image, reference, options).map(|c| c.report)
}

/// [`compare`] with the difference of each pixel.
///
/// # Errors
/// As for [`compare`].
pub fn compare_pixels(
    image: &Picture, reference: &Picture, options: &Options,
) -> Result<Comparison> {
    measure(image, reference, options).map_err(|(side, what)| {
        Error::InvalidArgument(format!(
            "{}: {what}",
            if side == Side::Image { "the image" } else { "the reference" }
        ))
    })
}

/// [`compare_pixels`] of two OpenEXR files.
///
/// # Errors
/// As for [`compare`], but as [`Error::Image`] naming the file; and those of [`exr::read`].
pub fn compare_files(image: &Path, reference: &Path, options: &Options) -> Result<Comparison> {
    let (x, r) = (exr::read(image)?, exr::read(reference)?);
    measure(&x, &r, options).map_err(|(side, what)| {
        Error::image(if side == Side::Image { image } else { reference }, what)
    })
}

/// Whose fault an error is.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Side {
    Image,
    Reference,
}

type Measured<T> = std::result::Result<T, (Side, String)>;

/// The colours of the compared pixels, black elsewhere. Fails where one is not finite.
fn colors(planes: [&[f32]; 3], compared: &[bool], width: u32, side: Side) -> Measured<Vec<Color>> {
    let [r, g, b] = planes;
    let colors: Vec<Color> = compared
        .iter()
        .enumerate()
        .map(|(i, &on)| if on { Color::new(r[i], g[i], b[i]) } else { Color::ZERO })
        .collect();
    let mut bad = colors.iter().enumerate().filter(|(_, c)| !c.is_finite()).map(|(i, _)| i);
    match bad.next() {
        None => Ok(colors),
        Some(first) => {
            let (x, y, count) = (first % width as usize, first / width as usize, 1 + bad.count());
            Err((
                side,
                format!(
                    "{count} of the compared pixels are NaN or infinite, the first at column {x}, row {y}"
                ),
            ))
        }
    }
}

fn measure(image: &Picture, reference: &Picture, options: &Options) -> Measured<Comparison> {
    let (width, height) = (reference.width, reference.height);
    if (image.width, image.height) != (width, height) {
        return Err((
            Side::Image,
            format!(
                "is {} x {}, but the reference is {width} x {height}",
                image.width, image.height
            ),
        ));
    }
    if image.crop != reference.crop {
        return Err((
            Side::Image,
            "shows another part of the whole picture than the reference".to_owned(),
        ));
    }
    let prefix = options
        .channel_prefix
        .as_ref()
        .map_or_else(String::new, |p| format!("{}.", p.trim_end_matches('.')));
    let x = image.planes(&prefix).map_err(|what| (Side::Image, what))?;
    let r = reference.planes(&prefix).map_err(|what| (Side::Reference, what))?;
    let alpha = reference.channel(&format!("{prefix}A")).or_else(|| reference.channel("A"));
    let compared: Vec<bool> =
        (0..r[0].len()).map(|i| alpha.is_none_or(|a| a.samples.get(i) != Some(&0.0))).collect();
    let pixels = compared.iter().filter(|&&on| on).count();
    if pixels == 0 {
        return Err((
            Side::Reference,
            "has no pixel to compare: its alpha is 0 everywhere".to_owned(),
        ));
    }
    let x = colors(x, &compared, width, Side::Image)?;
    let r = colors(r, &compared, width, Side::Reference)?;
    let exposure = exposure(&r);
    let [shown_x, shown_r] =
        [&x, &r].map(|p| p.iter().map(|c| *c * exposure.exp2()).collect::<Vec<Color>>());
    let map = flip::flip(&shown_r, &shown_x, width as usize, flip::PIXELS_PER_DEGREE);

    let mut sums = Sums::default();
    for (i, _) in compared.iter().enumerate().filter(|(_, on)| **on) {
        sums.add(x[i], r[i]);
        sums.add_shown(shown_x[i], shown_r[i], map[i]);
    }
    let mean = |sum: f64| sum / pixels as f64;
    let ratio = |x: f64, r: f64| (r != 0.0).then(|| x / r);
    let display = mean(sums.display) / 3.0;
    let report = Report {
        width,
        height,
        pixels: pixels as u64,
        pixels_left_out: (compared.len() - pixels) as u64,
        relmse: mean(sums.relative_square) / 3.0,
        rmse: (mean(sums.square) / 3.0).sqrt(),
        mape: mean(sums.relative) / 3.0,
        mean_ratio: ratio(sums.x.iter().sum(), sums.r.iter().sum()),
        mean_ratio_rgb: [0, 1, 2].map(|c| ratio(sums.x[c], sums.r[c])),
        exposure,
        psnr: (display > 0.0).then(|| -10.0 * display.log10()),
        flip: mean(sums.flip),
    };
    Ok(Comparison { report, flip: map })
}

/// The stops by which the reference must be exposed to show anything on a display.
fn exposure(reference: &[Color]) -> f32 {
    let Some([median]) = luminances(reference, [0.5]) else { return 0.0 };
    if DISPLAYED.contains(&median) { 0.0 } else { (MID_GRAY / median).log2() }
}

/// Sums over pixels.
#[derive(Default)]
struct Sums {
    x: [f64; 3],
    r: [f64; 3],
    square: f64,
    relative_square: f64,
    relative: f64,
    display: f64,
    flip: f64,
}

impl Sums {
    /// Adds a pixel as a display shows it.
    fn add_shown(&mut self, x: Color, r: Color, flip: f32) {
        self.flip += f64::from(flip);
        self.display +=
            (0..3).map(|c| f64::from(encode_srgb(x[c]) - encode_srgb(r[c])).powi(2)).sum::<f64>();
    }

    /// Adds a pixel as it is.
    fn add(&mut self, x: Color, r: Color) {
        for c in 0..3 {
            let (x, r) = (f64::from(x[c]), f64::from(r[c]));
            self.x[c] += x;
            self.r[c] += r;
            self.square += (x - r).powi(2);
            self.relative_square += (x - r).powi(2) / (r * r + EPSILON);
            self.relative += (x - r).abs() / (r.abs() + EPSILON);
        }
    }
}
