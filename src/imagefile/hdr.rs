//! Pictures of linear light for environments: Radiance `.hdr` and OpenEXR.

use super::exr;
use super::guard::guarded;
use super::picture::{Channel, Picture, SampleKind};
use crate::error::{Error, Result};
use crate::fsutil;
use image::ImageDecoder;
use image::codecs::hdr::HdrDecoder;
use std::collections::BTreeSet;
use std::io::Cursor;
use std::path::Path;

/// More pixels than this (16384 x 8192) are refused.
const MAX_PIXELS: u64 = 1 << 27;
/// The most pixels that a byte of a Radiance file can become: generous for its run lengths.
const MAX_PIXELS_PER_BYTE: u64 = 1024;

/// Bytes that any file may take.
const BASE: u64 = 1 << 30;
/// Further bytes for each byte of the file.
const RATIO: u64 = 64;

/// Reads an environment from `path`, whose content decides the format: Radiance HDR, or OpenEXR
/// (its `R`, `G`, `B` or `Y` channels, else those of the first layer that has all three). Negative
/// values, which filters ring into such pictures, become 0.
///
/// Pixels of a Radiance file are divided by the product of its `EXPOSURE` lines and, channel by
/// channel, by that of its `COLORCORR` lines: radiance in the scene's units.
///
/// What is no finite number becomes the mean of the numbers beside it, or 0 without any; the number
/// of such pixels is returned too.
///
/// `most`: bytes that reading may take; `None` is 1 GiB and 64 for each byte of the file.
///
/// # Errors
/// [`Error::Io`]; [`Error::Unsupported`] for other formats; [`Error::Image`] for damaged files.
pub fn read_environment(path: &Path, most: Option<u64>) -> Result<(Picture, usize)> {
    let bytes = fsutil::read(path)?;
    let length = bytes.len() as u64;
    let most = most.unwrap_or(BASE.saturating_add(length.saturating_mul(RATIO)));
    let image = if bytes.starts_with(&[0x76, 0x2f, 0x31, 0x01]) {
        // Its colours are copied after it was read.
        exr::read_bytes_within(&bytes, most / 2).and_then(environment_of)
    } else if bytes.starts_with(b"#?") {
        guarded(|| decode_radiance(&bytes, most))
    } else {
        return Err(Error::unsupported(
            path,
            "",
            "is neither a Radiance .hdr nor an OpenEXR file; convert it to one of them",
        ));
    };
    image.map(sound).map_err(|what| Error::image(path, what))
}

fn decode_radiance(bytes: &[u8], most: u64) -> std::result::Result<Picture, String> {
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
    let header = decoder.metadata();
    let (r, g, b) = header.color_correction.unwrap_or((1.0, 1.0, 1.0));
    let factors = [r, g, b].map(|c| c * header.exposure.unwrap_or(1.0));
    if let Some(bad) = factors.iter().find(|f| !f.is_normal() || **f < 0.0) {
        return Err(format!("its EXPOSURE and COLORCORR lines multiply to {bad}"));
    }
    // Samples, planes and colours.
    if pixels * 36 > most {
        return Err(format!(
            "has {width} x {height} pixels, which take more memory than {most} bytes"
        ));
    }
    let mut samples = vec![0f32; pixels as usize * 3];
    decoder.read_image(bytemuck::cast_slice_mut(&mut samples)).map_err(broken)?;
    let planes =
        [0, 1, 2].map(|c| samples.iter().skip(c).step_by(3).map(|x| x / factors[c]).collect());
    Ok(rgb([width, height], planes))
}

/// The three planes of `picture` that an environment is made of.
fn environment_of(picture: Picture) -> std::result::Result<Picture, String> {
    if picture.crop.is_some() {
        return Err(
            "its data window is not its display window; an environment must be whole".to_owned()
        );
    }
    let triple = |prefix: &str| picture.planes(prefix).ok();
    let gray = || picture.channel("Y").map(|y| [y.samples.as_slice(); 3]);
    let layered =
        || picture.channels.iter().filter_map(|c| c.name.strip_suffix('R')).find_map(triple);
    let planes = triple("")
        .or_else(gray)
        .or_else(layered)
        .ok_or_else(|| format!("has no R, G and B channels, only {}", picture.channel_names()))?;
    Ok(rgb([picture.width, picture.height], planes.map(<[f32]>::to_vec)))
}

fn rgb(size: [u32; 2], planes: [Vec<f32>; 3]) -> Picture {
    let mut picture = Picture::new(size);
    for (name, samples) in ["R", "G", "B"].into_iter().zip(planes) {
        picture.add(name, SampleKind::Float, samples);
    }
    picture
}

/// Clamps negative values to 0 and replaces those that are not finite; the number of pixels with
/// such values.
fn sound(mut picture: Picture) -> (Picture, usize) {
    let (width, height) = (picture.width as usize, picture.height as usize);
    let mut replaced = BTreeSet::new();
    for Channel { samples, .. } in &mut picture.channels {
        let bad: Vec<usize> = (0..samples.len()).filter(|i| !samples[*i].is_finite()).collect();
        let mean = |i: &usize| {
            // The picture goes round.
            let columns = [width - 1, 0, 1].map(|step| (i % width + step) % width);
            let rows = (i / width).saturating_sub(1)..=(i / width + 1).min(height - 1);
            let around = rows.flat_map(|y| columns.map(|x| f64::from(samples[y * width + x])));
            let (sum, count) = around
                .filter(|x| x.is_finite())
                .fold((0.0, 0.0), |(sum, count), x| (sum + x, count + 1.0));
            if count > 0.0 { (sum / count) as f32 } else { 0.0 }
        };
        let means: Vec<f32> = bad.iter().map(mean).collect();
        bad.iter().zip(means).for_each(|(i, mean)| samples[*i] = mean);
        replaced.extend(bad);
    }
    let samples = picture.channels.iter_mut().flat_map(|c| &mut c.samples);
    samples.filter(|x| **x <= 0.0).for_each(|x| *x = 0.0);
    (picture, replaced.len())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::imagefile::Crop;
    use crate::math::Color;

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
        let image = read_environment(&path, None).unwrap().0;
        assert_eq!((image.width, image.height), (2, 1));
        assert_eq!(image.colors("").unwrap(), [Color::new(1.0, 0.5, 0.25), Color::ZERO]);
    }

    #[test]
    fn exposure_and_colour_correction_are_divided_out() {
        let of = |lines: &str| {
            let head = format!("#?RADIANCE\n{lines}FORMAT=32-bit_rle_rgbe\n\n-Y 1 +X 1\n");
            let (_dir, path) = saved("a.hdr", &[head.as_bytes(), &[128, 128, 128, 129]].concat());
            read_environment(&path, None).map(|(image, _)| image.colors("").unwrap()[0])
        };
        assert_eq!(of("").unwrap(), Color::ONE);
        assert_eq!(of("EXPOSURE=2.0\n").unwrap(), Color::splat(0.5));
        assert_eq!(of("EXPOSURE=2\nEXPOSURE=4\n").unwrap(), Color::splat(0.125));
        let lines = "COLORCORR=1 2 4\nEXPOSURE=0.5\nCOLORCORR=1 1 2\n";
        assert_eq!(of(lines).unwrap(), Color::new(2.0, 1.0, 0.25));
        for bad in ["EXPOSURE=0\n", "EXPOSURE=-1\n", "EXPOSURE=inf\n", "COLORCORR=1 0 1\n"] {
            assert!(of(bad).unwrap_err().to_string().contains("EXPOSURE"), "{bad}");
        }
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
            let error = read_environment(&path, None).unwrap_err().to_string();
            assert!(error.contains(what) && error.contains("a.hdr"), "{error}");
        }
        let (_dir, path) = saved("a.hdr", b"\x89PNG\r\n\x1a\n");
        assert!(matches!(read_environment(&path, None), Err(Error::Unsupported { .. })));
    }

    #[test]
    fn layers_become_an_environment() {
        let picture = |names: &[&str], samples: [f32; 2]| {
            let mut picture = Picture::new([2, 1]);
            for &name in names {
                picture.add(name, SampleKind::Float, samples.to_vec());
            }
            picture
        };
        let made = |picture| environment_of(picture).map(|p| sound(p).0);
        for names in [&["R", "G", "B"][..], &["Combined.R", "Combined.G", "Combined.B"], &["Y"]] {
            let colors = made(picture(names, [1.0, -0.5])).unwrap().colors("").unwrap();
            assert_eq!(colors, [Color::ONE, Color::ZERO]);
        }
        assert!(made(picture(&["Z"], [1.0; 2])).unwrap_err().contains("only Z"));
        let crop = Some(Crop { origin: [1, 0], whole: [4, 4] });
        let cropped = Picture { crop, ..picture(&["Y"], [1.0; 2]) };
        assert!(made(cropped).unwrap_err().contains("data window"));
    }

    #[test]
    fn pixels_that_are_no_numbers_are_replaced() {
        let gray = |size: [u32; 2], samples: &[f32]| {
            sound(rgb(size, [samples.to_vec(), samples.to_vec(), vec![1.0; samples.len()]]))
        };
        for bad in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
            let (picture, count) = gray([4, 2], &[1.0, 9.0, 9.0, bad, 2.0, 9.0, 3.0, bad]);
            let red = &picture.channel("R").unwrap().samples;
            assert_eq!((red[3], red[7], count), (3.75, 3.75, 2));
            let (picture, count) = gray([2, 1], &[bad, bad]);
            assert_eq!((picture.colors("").unwrap(), count), (vec![Color::Z; 2], 2));
        }
    }

    #[test]
    fn memory_is_bounded_before_it_is_asked_for() {
        let picture = rgb([64, 64], [vec![1.0; 4096], vec![1.0; 4096], vec![1.0; 4096]]);
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("a.exr");
        exr::write(&path, &picture).unwrap();
        assert!(read_environment(&path, None).is_ok());
        let error = read_environment(&path, Some(100_000)).unwrap_err().to_string();
        assert!(error.contains("64 x 64") && error.contains("memory"), "{error}");
    }
}
