//! Pictures of 8 and 16 bits: textures in, previews out.

use super::guard::guarded;
use super::picture::check_extension;
use crate::error::{Error, Result};
use crate::fsutil::write_atomically;
use crate::math::Color;
use image::codecs::jpeg::JpegEncoder;
use image::codecs::png::PngEncoder;
use image::{
    ColorType, DynamicImage, ExtendedColorType, ImageDecoder, ImageEncoder, ImageFormat,
    ImageReader, Limits,
};
use std::borrow::Cow;
use std::io::Cursor;
use std::path::Path;

/// Decoded pixels in the precision of the file, shared by all textures that show them.
#[derive(Clone, Debug, PartialEq)]
pub struct TextureImage {
    /// Columns.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// RGBA of each pixel, row by row from the top; `width * height` entries.
    pub pixels: TexturePixels,
}

/// The stored precision of a [`TextureImage`].
#[derive(Clone, Debug, PartialEq)]
pub enum TexturePixels {
    /// 8 bits per channel.
    Rgba8(Vec<[u8; 4]>),
    /// 16 bits per channel.
    Rgba16(Vec<[u16; 4]>),
}

impl TexturePixels {
    /// Their number, and the bytes of one.
    pub fn size(&self) -> (usize, usize) {
        match self {
            Self::Rgba8(pixels) => (pixels.len(), 4),
            Self::Rgba16(pixels) => (pixels.len(), 8),
        }
    }
}

/// The most columns and rows of a texture.
pub const MAX_SIZE: u32 = 16384;
/// The most bytes of one decoded texture: the largest size in four channels of 16 bits.
const MAX_BYTES: u64 = 8 * (MAX_SIZE as u64) * (MAX_SIZE as u64);
/// The most pixels that a byte can become: 8 of one bit, deflated 1032-fold.
const MAX_PIXELS_PER_BYTE_PNG: u64 = 8 * 1032;
/// The most pixels that a byte can become: blocks of 64 pixels in at least one bit.
const MAX_PIXELS_PER_BYTE_JPEG: u64 = 8 * 64;

/// Decodes a PNG, JPEG or WebP file; the content tells which. 16-bit files keep their precision,
/// all others become 8 bits. Gray is repeated into R, G and B; missing alpha is opaque. The values
/// stay as in the file: no profile, gamma or orientation is applied, as glTF asks [glTF20, 3.8.3].
///
/// # Errors
/// What is wrong, without the file's name: another format, damage, no pixels, more than
/// [`MAX_SIZE`] columns or rows.
pub fn decode(bytes: &[u8]) -> std::result::Result<TextureImage, String> {
    guarded(|| decode_pixels(bytes))
}

fn decode_pixels(bytes: &[u8]) -> std::result::Result<TextureImage, String> {
    let bytes = essential(bytes);
    let (decoder, format) = open(&bytes)?;
    let (width, height) = decoder.dimensions();
    let image = DynamicImage::from_decoder(decoder).map_err(|e| broken(format, &e))?;
    let pixels = if is_deep(image.color()) {
        TexturePixels::Rgba16(bytemuck::allocation::cast_vec(exact(image.into_rgba16().into_raw())))
    } else {
        TexturePixels::Rgba8(bytemuck::allocation::cast_vec(exact(image.into_rgba8().into_raw())))
    };
    Ok(TextureImage { width, height, pixels })
}

/// Bytes that [`decode`] takes, at its peak and beside the file's; 0 for a file that it refuses.
pub fn memory(bytes: &[u8]) -> u64 {
    let needed = || {
        let bytes = essential(bytes);
        let (decoder, _) = open(&bytes)?;
        let (width, height) = decoder.dimensions();
        let pixel = if is_deep(decoder.color_type()) { 8 } else { 4 };
        Ok(decoder.total_bytes() + u64::from(width) * u64::from(height) * pixel)
    };
    guarded(needed).unwrap_or(0)
}

fn is_deep(color: ColorType) -> bool {
    color.bytes_per_pixel() > color.channel_count()
}

/// A vector whose room is its length, as another element type demands.
fn exact<T>(mut values: Vec<T>) -> Vec<T> {
    values.shrink_to_fit();
    values
}

fn broken(format: ImageFormat, error: &image::ImageError) -> String {
    format!("not a readable {} image: {error}", format.extensions_str()[0])
}

/// A decoder for a file that can be true, before its pixels are asked for.
fn open(bytes: &[u8]) -> std::result::Result<(impl ImageDecoder + '_, ImageFormat), String> {
    let format = match image::guess_format(bytes) {
        Ok(format @ (ImageFormat::Png | ImageFormat::Jpeg | ImageFormat::WebP)) => format,
        Ok(other) => {
            return Err(format!(
                "is a {} image; only PNG, JPEG and WebP can be read",
                other.extensions_str()[0]
            ));
        }
        Err(_) => return Err("is not a PNG, JPEG or WebP image".to_owned()),
    };
    let mut limits = Limits::no_limits();
    limits.max_image_width = Some(MAX_SIZE);
    limits.max_image_height = Some(MAX_SIZE);
    limits.max_alloc = Some(MAX_BYTES);
    let mut reader = ImageReader::with_format(Cursor::new(bytes), format);
    reader.limits(limits);
    let decoder = reader.into_decoder().map_err(|e| broken(format, &e))?;
    let (width, height) = decoder.dimensions();
    let pixels = u64::from(width) * u64::from(height);
    if pixels == 0 {
        return Err(format!("has no pixels ({width} x {height})"));
    }
    let per_byte = match format {
        ImageFormat::Png => MAX_PIXELS_PER_BYTE_PNG,
        ImageFormat::Jpeg => MAX_PIXELS_PER_BYTE_JPEG,
        _ => u64::MAX, // A lossless WebP of one colour takes no bits per pixel.
    };
    if pixels > (bytes.len() as u64).saturating_mul(per_byte) {
        return Err(format!(
            "claims {width} x {height} pixels, which {} bytes cannot hold",
            bytes.len()
        ));
    }
    Ok((decoder, format))
}

/// A PNG file without the chunks that pixels do not need: profiles and texts are compressed too,
/// and a few kilobytes of them may become gigabytes. What is no PNG file stays as it is.
fn essential(bytes: &[u8]) -> Cow<'_, [u8]> {
    const SIGNATURE: &[u8] = b"\x89PNG\r\n\x1a\n";
    let Some(mut rest) = bytes.strip_prefix(SIGNATURE) else { return Cow::Borrowed(bytes) };
    let mut kept = SIGNATURE.to_vec();
    while let Some((length, _)) = rest.split_first_chunk() {
        // Length, kind, data, checksum; the decoder tells of a chunk that is cut.
        let end = (u32::from_be_bytes(*length) as usize).saturating_add(12).min(rest.len());
        let (chunk, after) = rest.split_at(end);
        if matches!(chunk.get(4..8), Some(b"IHDR" | b"PLTE" | b"tRNS" | b"IDAT" | b"IEND")) {
            kept.extend(chunk);
        }
        rest = after;
    }
    Cow::Owned(kept)
}

/// The names that [`write`] takes; a name without an extension is that of a PNG.
pub const EXTENSIONS: [&str; 4] = ["png", "jpg", "jpeg", ""];
/// Of a JPEG, in percent.
const QUALITY: u8 = 95;

/// Writes `rgb8`, three bytes per pixel row by row from the top, through a temporary file and a
/// rename. The file is a JPEG where the name says so, else a PNG.
///
/// # Errors
/// [`Error::Image`] when the length of `rgb8` does not fit or a JPEG cannot be that large,
/// [`Error::Unsupported`] for other names than [`EXTENSIONS`], [`Error::Io`] when the file cannot
/// be written; all name it.
pub fn write(path: &Path, width: u32, height: u32, rgb8: &[u8]) -> Result<()> {
    let needed = u64::from(width) * u64::from(height) * 3;
    if needed == 0 || needed != rgb8.len() as u64 {
        return Err(Error::image(
            path,
            format!("{} bytes for {width} x {height} pixels", rgb8.len()),
        ));
    }
    let extension = check_extension(path, &EXTENSIONS)?;
    let (mut bytes, kind) = (Vec::new(), ExtendedColorType::Rgb8);
    if extension.starts_with('j') {
        JpegEncoder::new_with_quality(&mut bytes, QUALITY).write_image(rgb8, width, height, kind)
    } else {
        PngEncoder::new(&mut bytes).write_image(rgb8, width, height, kind)
    }
    .map_err(|e| Error::image(path, e.to_string()))?;
    write_atomically(path, &bytes)
}

/// Linear colours as sRGB bytes: scaled by 2 to the power `exposure_ev`, clamped to the unit
/// interval, encoded [IEC61966, Section 5], rounded. NaN becomes 0.
pub fn to_srgb8(linear: &[Color], exposure_ev: f32) -> Vec<u8> {
    // The factor of a picture near the largest number is none of 32 bits.
    let scale = f64::from(exposure_ev).exp2();
    let exposed = |x: f32| (f64::from(x) * scale) as f32;
    let values = linear.iter().flat_map(|c| c.to_array());
    values.map(|x| to_byte(encode_srgb(exposed(x)))).collect()
}

/// A value of the unit interval as a byte; clamps, and NaN becomes 0.
fn to_byte(x: f32) -> u8 {
    (x * 255.0 + 0.5) as u8
}

/// The sRGB encoding of a linear value: 12.92 x up to 0.0031308, then 1.055 x^(1/2.4) - 0.055
/// [IEC61966, Section 5]; clamps to the unit interval, keeps NaN.
pub fn encode_srgb(linear: f32) -> f32 {
    let x = linear.clamp(0.0, 1.0);
    if x <= 0.003_130_8 { 12.92 * x } else { 1.055 * x.powf(1.0 / 2.4) - 0.055 }
}

/// The linear value of an sRGB encoding in the unit interval, the inverse of [`encode_srgb`].
pub fn decode_srgb(encoded: f32) -> f32 {
    if encoded <= 0.040_45 { encoded / 12.92 } else { ((encoded + 0.055) / 1.055).powf(2.4) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use image::{ColorType, ImageBuffer};

    fn encoded(image: &DynamicImage, format: ImageFormat) -> Vec<u8> {
        let mut bytes = Cursor::new(Vec::new());
        image.write_to(&mut bytes, format).unwrap();
        bytes.into_inner()
    }

    #[test]
    fn every_depth_of_png_decodes_to_what_it_holds() {
        let gray16 =
            DynamicImage::ImageLuma16(ImageBuffer::from_raw(2, 1, vec![0x1234, 0xffff]).unwrap());
        assert_eq!(
            decode(&encoded(&gray16, ImageFormat::Png)).unwrap().pixels,
            TexturePixels::Rgba16(vec![[0x1234, 0x1234, 0x1234, 0xffff], [0xffff; 4]])
        );
        let rgba16 =
            DynamicImage::ImageRgba16(ImageBuffer::from_raw(1, 1, vec![1, 2, 3, 4]).unwrap());
        assert_eq!(
            decode(&encoded(&rgba16, ImageFormat::Png)).unwrap().pixels,
            TexturePixels::Rgba16(vec![[1, 2, 3, 4]])
        );
        let gray_alpha =
            DynamicImage::ImageLumaA8(ImageBuffer::from_raw(1, 2, vec![9, 8, 7, 6]).unwrap());
        let decoded = decode(&encoded(&gray_alpha, ImageFormat::Png)).unwrap();
        assert_eq!((decoded.width, decoded.height), (1, 2));
        assert_eq!(decoded.pixels, TexturePixels::Rgba8(vec![[9, 9, 9, 8], [7, 7, 7, 6]]));
        let rgb = DynamicImage::ImageRgb8(ImageBuffer::from_raw(1, 1, vec![1, 2, 3]).unwrap());
        for format in [ImageFormat::Png, ImageFormat::WebP] {
            assert_eq!(
                decode(&encoded(&rgb, format)).unwrap().pixels,
                TexturePixels::Rgba8(vec![[1, 2, 3, 255]])
            );
        }
    }

    /// A PNG of one chunk each, for the kinds that the encoder does not make.
    fn png(size: [u32; 2], depth: u8, color: u8, chunks: &[(&[u8; 4], &[u8])]) -> Vec<u8> {
        let crc = |bytes: &[u8]| {
            !bytes.iter().fold(!0u32, |crc, &b| {
                (0..8).fold(crc ^ u32::from(b), |c, _| {
                    if c & 1 == 1 { (c >> 1) ^ 0xedb8_8320 } else { c >> 1 }
                })
            })
        };
        let mut header = [size[0].to_be_bytes(), size[1].to_be_bytes()].concat();
        header.extend([depth, color, 0, 0, 0]);
        let mut file = b"\x89PNG\r\n\x1a\n".to_vec();
        for (kind, data) in [(b"IHDR", header.as_slice())]
            .into_iter()
            .chain(chunks.iter().map(|&(k, d)| (k, d)))
            .chain([(b"IEND", [].as_slice())])
        {
            let body = [kind.as_slice(), data].concat();
            file.extend((data.len() as u32).to_be_bytes());
            file.extend(&body);
            file.extend(crc(&body).to_be_bytes());
        }
        file
    }

    /// One stored (uncompressed) zlib block.
    fn stored(data: &[u8]) -> Vec<u8> {
        let (a, b) = data.iter().fold((1u32, 0u32), |(a, b), &x| {
            ((a + u32::from(x)) % 65521, (b + a + u32::from(x)) % 65521)
        });
        let n = data.len() as u16;
        [
            &[0x78, 1, 1][..],
            &n.to_le_bytes(),
            &(!n).to_le_bytes(),
            data,
            &(b << 16 | a).to_be_bytes(),
        ]
        .concat()
    }

    #[test]
    fn palettes_and_packed_bits_are_expanded() {
        let palette: &[u8] = &[10, 20, 30, 40, 50, 60];
        // Two bits per pixel: indices 1, 0, 1, 1; index 0 half transparent.
        let file = png(
            [4, 1],
            2,
            3,
            &[(b"PLTE", palette), (b"tRNS", &[128]), (b"IDAT", &stored(&[0, 0b0100_0101]))],
        );
        let (one, zero) = ([40, 50, 60, 255], [10, 20, 30, 128]);
        assert_eq!(decode(&file).unwrap().pixels, TexturePixels::Rgba8(vec![one, zero, one, one]));
        let file = png([3, 1], 1, 0, &[(b"IDAT", &stored(&[0, 0b1010_0000]))]);
        let (white, black) = ([255; 4], [0, 0, 0, 255]);
        assert_eq!(decode(&file).unwrap().pixels, TexturePixels::Rgba8(vec![white, black, white]));
    }

    #[test]
    fn hostile_files_are_refused() {
        let data = stored(&[0; 16]);
        let refused = |size| decode(&png(size, 8, 2, &[(b"IDAT", &data)])).unwrap_err();
        assert!(refused([16384, 16384]).contains("cannot hold"), "{}", refused([16384, 16384]));
        for size in [[0, 0], [0, 1], [100_000, 2], [u32::MAX, u32::MAX]] {
            assert!(!refused(size).is_empty());
        }
        assert!(decode(b"").unwrap_err().contains("not a PNG"));
        assert!(decode(b"GIF89a..........").unwrap_err().contains("gif"));
        let good = encoded(&DynamicImage::new(40, 30, ColorType::Rgb8), ImageFormat::Jpeg);
        for file in [
            &good,
            &png([2, 2], 8, 2, &[(b"IDAT", &data)]),
            &encoded(&DynamicImage::new(40, 30, ColorType::Rgb8), ImageFormat::WebP),
        ] {
            for length in 0..file.len() / 2 {
                assert!(decode(&file[..length]).is_err(), "{length} bytes of {}", file.len());
            }
        }
    }

    #[test]
    fn srgb_follows_its_definition() {
        assert_eq!(to_srgb8(&[Color::new(0.0, 1.0, 0.214_041_14)], 0.0), [0, 255, 128]);
        assert_eq!(to_srgb8(&[Color::new(f32::NAN, f32::INFINITY, -3.0)], 0.0), [0, 255, 0]);
        assert_eq!(to_srgb8(&[Color::splat(0.25)], 2.0), [255; 3]);
        assert_eq!(to_srgb8(&[Color::splat(2.0)], -1.0), [255; 3]);
        for byte in 0..=255u8 {
            let linear = decode_srgb(f32::from(byte) / 255.0);
            assert_eq!(to_srgb8(&[Color::splat(linear)], 0.0), [byte; 3]);
        }
    }

    #[test]
    fn the_name_says_png_or_jpeg() {
        let dir = tempfile::tempdir().unwrap();
        let gray = [90; 3 * 16 * 16];
        for (name, format) in [
            ("a.jpg", ImageFormat::Jpeg),
            ("a.JPEG", ImageFormat::Jpeg),
            ("a.PNG", ImageFormat::Png),
            ("a", ImageFormat::Png),
        ] {
            let path = dir.path().join(name);
            write(&path, 16, 16, &gray).unwrap();
            let bytes = std::fs::read(&path).unwrap();
            assert_eq!(image::guess_format(&bytes).unwrap(), format, "{name}");
            let TexturePixels::Rgba8(pixels) = decode(&bytes).unwrap().pixels else {
                panic!("{name} has 16 bits")
            };
            assert!(pixels.iter().all(|p| p[..3].iter().all(|b| b.abs_diff(90) <= 1)), "{name}");
        }
        let error = write(&dir.path().join("a.tif"), 16, 16, &gray).unwrap_err().to_string();
        assert!(error.contains("a.tif") && error.contains(".jpg"), "{error}");
        assert!(write(&dir.path().join("a.jpg"), 65536, 1, &[0; 3 * 65536]).is_err());
    }

    #[test]
    fn a_png_reads_back() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("a.png");
        write(&path, 2, 1, &[1, 2, 3, 4, 5, 6]).unwrap();
        assert_eq!(
            decode(&std::fs::read(&path).unwrap()).unwrap().pixels,
            TexturePixels::Rgba8(vec![[1, 2, 3, 255], [4, 5, 6, 255]])
        );
        assert!(write(&path, 2, 2, &[0; 6]).unwrap_err().to_string().contains("a.png"));
    }
}
