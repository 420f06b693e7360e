//! Pictures of linear light for environments: Radiance `.hdr` and OpenEXR.

use super::exr::{self, Layers};
use crate::error::{Error, Result};
use crate::math::Color;
use image::ImageDecoder;
use image::codecs::hdr::HdrDecoder;
use std::io::Cursor;
use std::path::Path;

/// Linear colours.
#[derive(Clone, Debug, PartialEq)]
pub struct RgbImage {
    /// Columns.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// Row by row from the top; `width * height` entries, finite and not negative.
    pub pixels: Vec<Color>,
}

/// More pixels than this (16384 x 8192) are refused.
const MAX_PIXELS: u64 = 1 << 27;
/// The most pixels that a byte of a Radiance file can become: generous for its run lengths.
const MAX_PIXELS_PER_BYTE: u64 = 1024;

/// Reads an environment from `path`, whose content decides the format: Radiance HDR, or OpenEXR
/// (its `R`, `G`, `B` or `Y` channels, else those of the first layer that has all three). Negative
/// values, which filters ring into such pictures, become 0.
///
/// A Radiance file's `EXPOSURE` is not applied, as in most renderers.
///
/// # Errors
/// [`Error::Io`]; [`Error::Unsupported`] for other formats; [`Error::Image`] for damaged files and
/// for NaN or infinite values, naming the pixel.
pub fn read_environment(path: &Path) -> Result<RgbImage> {
    let bytes = std::fs::read(path).map_err(Error::io(path))?;
    let image = if bytes.starts_with(&[0x76, 0x2f, 0x31, 0x01]) {
        exr::read_bytes(&bytes).and_then(from_layers)
    } else if bytes.starts_with(b"#?") {
        decode_radiance(&bytes)
    } else {
        return Err(Error::unsupported(
            path,
            "",
            "is neither a Radiance .hdr nor an OpenEXR file; convert it to one of them",
        ));
    };
    image.and_then(sound).map_err(|what| Error::image(path, what))
}

/// Reads the Radiance file `path`, as [`read_environment`] does.
///
/// # Errors
/// [`Error::Io`] and [`Error::Image`], both naming the file.
pub fn read_hdr(path: &Path) -> Result<RgbImage> {
    let bytes = std::fs::read(path).map_err(Error::io(path))?;
    decode_radiance(&bytes).and_then(sound).map_err(|what| Error::image(path, what))
}

fn decode_radiance(bytes: &[u8]) -> std::result::Result<RgbImage, String> {
    let broken = |e: image::ImageError| format!("not a readable Radiance file: {e}");
    let decoder = HdrDecoder::new_nonstrict(Cursor::new(bytes)).map_err(broken)?;
    let (width, height) = decoder.dimensions();
    let pixels = u64::from(width) * u64::from(height);
    if pixels == 0 {
        return Err(format!("has no pixels ({width} x {height})"));
    }
    if pixels > MAX_PIXELS || pixels > (bytes.len() as u64).saturating_mul(MAX_PIXELS_PER_BYTE) {
        return Err(format!(
            "claims {width} x {height} pixels, which {} bytes cannot hold or memory should not",
            bytes.len()
        ));
    }
    let mut samples = vec![0f32; pixels as usize * 3];
    decoder.read_image(bytemuck::cast_slice_mut(&mut samples)).map_err(broken)?;
    let pixels = samples.chunks_exact(3).map(|c| Color::new(c[0], c[1], c[2])).collect();
    Ok(RgbImage { width, height, pixels })
}

fn from_layers(layers: Layers) -> std::result::Result<RgbImage, String> {
    if layers.crop.is_some() {
        return Err(
            "its data window is not its display window; an environment must be whole".to_owned()
        );
    }
    let plane = |name: &str| layers.channel(name).map(|c| c.samples.as_slice());
    let triple = |prefix: &str| {
        Some([
            plane(&format!("{prefix}R"))?,
            plane(&format!("{prefix}G"))?,
            plane(&format!("{prefix}B"))?,
        ])
    };
    let gray = || plane("Y").map(|y| [y; 3]);
    let layered =
        || layers.channels.iter().filter_map(|c| c.name.strip_suffix('R')).find_map(triple);
    let [r, g, b] = triple("").or_else(gray).or_else(layered).ok_or_else(|| {
        let names: Vec<_> = layers.channels.iter().take(16).map(|c| c.name.as_str()).collect();
        format!("has no R, G and B channels, only {}", names.join(", "))
    })?;
    let pixels = r.iter().zip(g).zip(b).map(|((&r, &g), &b)| Color::new(r, g, b)).collect();
    Ok(RgbImage { width: layers.width, height: layers.height, pixels })
}

/// Clamps negative values to 0 and refuses what is not finite.
fn sound(mut image: RgbImage) -> std::result::Result<RgbImage, String> {
    if let Some(bad) = image.pixels.iter().position(|p| !p.is_finite()) {
        let (x, y) = (bad % image.width as usize, bad / image.width as usize);
        return Err(format!("pixel at column {x}, row {y} is not finite: {}", image.pixels[bad]));
    }
    for pixel in &mut image.pixels {
        *pixel = pixel.max(Color::ZERO);
    }
    Ok(image)
}

#[cfg(test)]
mod tests {
    use super::super::exr::{Channel, Crop, SampleKind};
    use super::*;

    fn channel(name: &str, samples: &[f32]) -> Channel {
        Channel { name: name.to_owned(), kind: SampleKind::Float, samples: samples.to_vec() }
    }

    fn saved(name: &str, bytes: &[u8]) -> (tempfile::TempDir, std::path::PathBuf) {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join(name);
        std::fs::write(&path, bytes).unwrap();
        (dir, path)
    }

    #[test]
    fn radiance_pixels_are_mantissa_times_power_of_two() {
        // Flat pixels: 128 * 2^(129 - 136) = 1, and so on; exponent 0 is black.
        let mut bytes = b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 1 +X 2\n".to_vec();
        bytes.extend([128, 64, 32, 129, 200, 200, 200, 0]);
        let (_dir, path) = saved("a.hdr", &bytes);
        let image = read_hdr(&path).unwrap();
        assert_eq!((image.width, image.height), (2, 1));
        assert_eq!(image.pixels, [Color::new(1.0, 0.5, 0.25), Color::ZERO]);
        assert_eq!(read_environment(&path).unwrap(), image);
    }

    #[test]
    fn hostile_radiance_headers_are_refused_before_memory_is_asked_for() {
        for (size, what) in [
            ("-Y 1000000 +X 1000000", "cannot hold"),
            ("-Y 0 +X 5", "no pixels"),
            ("-Y 9 +X 9", "not a readable"),
            ("", "not a"),
        ] {
            let (_dir, path) =
                saved("a.hdr", format!("#?RGBE\nFORMAT=32-bit_rle_rgbe\n\n{size}\n").as_bytes());
            let error = read_environment(&path).unwrap_err().to_string();
            assert!(error.contains(what) && error.contains("a.hdr"), "{error}");
        }
        let (_dir, path) = saved("a.hdr", b"\x89PNG\r\n\x1a\n");
        assert!(matches!(read_environment(&path), Err(Error::Unsupported { .. })));
    }

    #[test]
    fn layers_become_an_environment() {
        let rgb = |prefix: &str| {
            ["R", "G", "B"].map(|c| channel(&format!("{prefix}{c}"), &[1.0, -0.5])).to_vec()
        };
        let layers = |channels| Layers { width: 2, height: 1, channels, ..Layers::default() };
        let expected = [Color::ONE, Color::ZERO];
        for channels in [rgb(""), rgb("Combined."), vec![channel("Y", &[1.0, -0.5])]] {
            assert_eq!(from_layers(layers(channels)).and_then(sound).unwrap().pixels, expected);
        }
        assert!(
            from_layers(layers(vec![channel("Z", &[1.0, 1.0])])).unwrap_err().contains("only Z")
        );
        let cropped =
            Layers { crop: Some(Crop { origin: [1, 0], whole: [4, 4] }), ..layers(rgb("")) };
        assert!(from_layers(cropped).unwrap_err().contains("data window"));
        for bad in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
            let error =
                from_layers(layers(vec![channel("Y", &[0.0, bad])])).and_then(sound).unwrap_err();
            assert!(error.contains("column 1, row 0"), "{error}");
        }
    }
}
