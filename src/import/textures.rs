//! Images, samplers and textures.

use super::accessors::Accessors;
use super::budget::Budget;
use super::json::{Fault, Json, Parsed, quote};
use super::uri::{self, Target};
use crate::imagefile::{TextureImage, TexturePixels, ldr};
use crate::math::Vec2;
use crate::texture::{ColorSpace, Texture, TextureRef, Wrap};
use rayon::prelude::*;
use std::borrow::Cow;
use std::path::Path;
use std::sync::Arc;

/// The longest image file that is read.
const LONGEST_IMAGE: u64 = 1 << 30;

/// The stored bytes of an image.
enum Encoded<'a> {
    /// The bytes, and the file they come from where it is not the scene file.
    Here(Cow<'a, [u8]>, Option<String>),
    /// Not to be had or of no format that we read; an error only if a material shows the image.
    Unusable(String),
}

/// A decoded image, or why there is none.
type Decoded = std::result::Result<Arc<TextureImage>, String>;

/// How texture coordinates outside the image and between pixels are treated.
#[derive(Clone, Copy, Default)]
struct Sampler {
    wrap_s: Wrap,
    wrap_t: Wrap,
    nearest: bool,
}

/// What makes the pixels of one of the scene's textures.
#[derive(Clone, Copy, PartialEq)]
enum Use {
    /// The image as it is.
    Plain,
    /// 1 - factor * alpha in the green channel: glossiness to roughness.
    Roughness(f32),
}

/// The textures of a document, and which of them materials use.
pub(super) struct Textures {
    images: Vec<Decoded>,
    samplers: Vec<Sampler>,
    /// Image and sampler of each texture; a reference to nowhere is an error only where a material uses the texture.
    textures: Vec<(Parsed<Option<usize>>, Option<usize>)>,
    /// The textures in use, in the order of their first use: indices into the scene's textures.
    slots: Vec<(usize, Use)>,
}

impl Textures {
    /// Reads and decodes all images, and the samplers and textures that refer to them.
    pub fn parse(root: &Json, accessors: &Accessors, folder: &Path, warnings: &mut Vec<String>) -> Parsed<Self> {
        let encoded = root
            .entities("images")?
            .iter()
            .map(|json| Ok((json.path().to_owned(), encoded(json, accessors, folder, warnings)?)))
            .collect::<Parsed<Vec<_>>>()?;
        check_sizes(&encoded)?;
        let images: Vec<Parsed<Decoded>> = encoded.into_par_iter().map(|(path, encoded)| decode_image(&path, encoded)).collect();
        let images = images.into_iter().collect::<Parsed<Vec<_>>>()?;
        let samplers = root.entities("samplers")?.iter().map(sampler).collect::<Parsed<Vec<_>>>()?;
        let mut textures = Vec::new();
        for json in root.entities("textures")? {
            let image = image_of(&json, images.len());
            if let Err(fault) = &image {
                warnings.push(format!("{}: {}", fault.path, fault.what));
            }
            textures.push((image, json.index("sampler", "samplers", samplers.len())?));
        }
        Ok(Self { images, samplers, textures, slots: Vec::new() })
    }

    fn slot(&mut self, texture: usize, usage: Use) -> u32 {
        let slot = self.slots.iter().position(|s| *s == (texture, usage)).unwrap_or_else(|| {
            self.slots.push((texture, usage));
            self.slots.len() - 1
        });
        slot as u32
    }

    /// The texture that the property `key` of a material refers to.
    pub fn reference(
        &mut self,
        material: &Json,
        key: &str,
        color_space: ColorSpace,
        warnings: &mut Vec<String>,
    ) -> Parsed<Option<TextureRef>> {
        self.reference_as(material, key, color_space, Use::Plain, warnings)
    }

    /// As [`Textures::reference`], for a texture with glossiness in its alpha channel: the roughness `1 - factor * glossiness` in green.
    pub fn roughness_from_glossiness(
        &mut self,
        material: &Json,
        key: &str,
        factor: f32,
        warnings: &mut Vec<String>,
    ) -> Parsed<Option<TextureRef>> {
        self.reference_as(material, key, ColorSpace::Linear, Use::Roughness(factor), warnings)
    }

    fn reference_as(
        &mut self,
        material: &Json,
        key: &str,
        color_space: ColorSpace,
        usage: Use,
        warnings: &mut Vec<String>,
    ) -> Parsed<Option<TextureRef>> {
        let Some(info) = material.object_at(key)? else { return Ok(None) };
        let texture = info.need_index("index", "textures", self.textures.len())?;
        let mut uv_set = info.unsigned("texCoord")?.unwrap_or(0);
        let (mut offset, mut rotation, mut scale) = (Vec2::ZERO, 0.0, Vec2::ONE);
        if let Some(transform) = info.extension("KHR_texture_transform")? {
            offset = transform.numbers::<2>("offset")?.map_or(offset, |v| Vec2::new(v[0] as f32, v[1] as f32));
            rotation = transform.number("rotation")?.unwrap_or(0.0) as f32;
            scale = transform.numbers::<2>("scale")?.map_or(scale, |v| Vec2::new(v[0] as f32, v[1] as f32));
            uv_set = transform.unsigned("texCoord")?.unwrap_or(uv_set);
        }
        let mut left_out = |why: String| warnings.push(format!("{} is left out: {why}", info.path()));
        if uv_set > 1 {
            left_out(format!("it uses the texture coordinates TEXCOORD_{uv_set}, and only TEXCOORD_0 and TEXCOORD_1 are read"));
            return Ok(None);
        }
        let Some(image) = self.textures[texture].0.clone()? else {
            left_out(format!("/textures/{texture} has no image of a kind that we read"));
            return Ok(None);
        };
        if let Err(why) = &self.images[image] {
            return Err(Fault::new(format!("/images/{image}"), why.as_str()));
        }
        let texture = self.slot(texture, usage);
        Ok(Some(TextureRef { texture, uv_set: uv_set as u8, offset, rotation, scale, color_space }))
    }

    /// The textures in use.
    pub fn build(self) -> Vec<Texture> {
        let texture = |(texture, usage): (usize, Use)| {
            let (image, sampler) = &self.textures[texture];
            let sampler = sampler.map_or(Sampler::default(), |s| self.samplers[s]);
            // `reference_as` lets only textures in whose images are there.
            let image = self.images[image.clone().ok()??].as_ref().ok()?;
            let image = match usage {
                Use::Plain => image.clone(),
                Use::Roughness(factor) => Arc::new(roughness(image, factor)),
            };
            Some(Texture { image, wrap_s: sampler.wrap_s, wrap_t: sampler.wrap_t, nearest: sampler.nearest })
        };
        self.slots.iter().filter_map(|slot| texture(*slot)).collect()
    }
}

/// The image that a texture shows: the WebP one where there is a choice.
fn image_of(texture: &Json, images: usize) -> Parsed<Option<usize>> {
    let plain = texture.index("source", "images", images)?;
    let webp = match texture.extension("EXT_texture_webp")? {
        Some(webp) => webp.index("source", "images", images)?,
        None => None,
    };
    Ok(webp.or(plain))
}

/// The image of `1 - factor * alpha` in green, and 1 elsewhere.
fn roughness(image: &TextureImage, factor: f32) -> TextureImage {
    let pixels = match &image.pixels {
        TexturePixels::Rgba8(pixels) => {
            let green = |a: u8| (255.0 - factor * f32::from(a)).round().clamp(0.0, 255.0) as u8;
            TexturePixels::Rgba8(pixels.iter().map(|p| [255, green(p[3]), 255, 255]).collect())
        }
        TexturePixels::Rgba16(pixels) => {
            let green = |a: u16| (65535.0 - factor * f32::from(a)).round().clamp(0.0, 65535.0) as u16;
            TexturePixels::Rgba16(pixels.iter().map(|p| [65535, green(p[3]), 65535, 65535]).collect())
        }
    };
    TextureImage { width: image.width, height: image.height, pixels }
}

/// The media type of an image by its first bytes.
fn recognize(bytes: &[u8]) -> Option<&'static str> {
    if bytes.starts_with(b"\x89PNG\r\n\x1a\n") {
        Some("image/png")
    } else if bytes.starts_with(b"\xff\xd8\xff") {
        Some("image/jpeg")
    } else if bytes.starts_with(b"RIFF") && bytes.get(8..12) == Some(b"WEBP") {
        Some("image/webp")
    } else {
        None
    }
}

fn encoded<'a>(json: &Json, accessors: &'a Accessors, folder: &Path, warnings: &mut Vec<String>) -> Parsed<Encoded<'a>> {
    let view = json.index("bufferView", "bufferViews", accessors.buffers().views.len())?;
    let mut declared = json.string("mimeType")?.map(str::to_owned);
    let (bytes, file) = match (json.string("uri")?, view) {
        (Some(_), Some(_)) | (None, None) => {
            return Err(json.fault("must have either a uri or a bufferView, and not both"));
        }
        (None, Some(view)) => {
            if declared.is_none() {
                return Err(json.missing("mimeType"));
            }
            if accessors.buffers().views[view].stride.is_some() {
                return Err(json.fault_at("bufferView", "a view of image data must not have a byteStride"));
            }
            match accessors.buffers().bytes(view) {
                Ok(bytes) => (Cow::Borrowed(bytes), None),
                Err(why) => return Ok(Encoded::Unusable(why)),
            }
        }
        (Some(uri), None) => {
            let at = json.path_of("uri");
            match uri::resolve(uri, &at, folder)? {
                Target::Data { media_type, bytes } => {
                    if !media_type.is_empty() && !media_type.starts_with("image/") && media_type != "application/octet-stream" {
                        return Err(Fault::new(at, format!("the data URI's type {} is no image's", quote(&media_type))));
                    }
                    if declared.is_none() && media_type.starts_with("image/") {
                        declared = Some(media_type);
                    }
                    (Cow::Owned(bytes), None)
                }
                Target::File(file) => (Cow::Owned(uri::read(&file, &at, LONGEST_IMAGE)?), Some(file.display().to_string())),
                Target::Absolute => {
                    let why = format!("its uri {} is not relative to the scene file, and only such files are read", quote(uri));
                    warnings.push(format!("{} is not read: {why}", json.path()));
                    return Ok(Encoded::Unusable(why));
                }
            }
        }
    };
    match (recognize(&bytes), declared) {
        (Some(actual), Some(declared)) if declared != actual => {
            Err(json.fault(format!("declared as {}, and is {actual}", quote(&declared))))
        }
        (Some(_), _) => Ok(Encoded::Here(bytes, file)),
        (None, Some(declared)) if ["image/png", "image/jpeg", "image/webp"].contains(&declared.as_str()) => {
            Err(json.fault(format!("declared as {declared}, and is not")))
        }
        (None, _) => {
            let name = file.map_or(String::new(), |f| format!("{f} "));
            let why = format!("{name}is no PNG, JPEG or WebP image");
            warnings.push(format!("{}: {why}", json.path()));
            Ok(Encoded::Unusable(why))
        }
    }
}

/// Refuses images whose pixels would fill the memory, before they are decoded.
fn check_sizes(images: &[(String, Encoded)]) -> Parsed<()> {
    let mut budget = Budget::of_pixels();
    for (path, image) in images {
        let Encoded::Here(bytes, _) = image else { continue };
        let reader = image::ImageReader::new(std::io::Cursor::new(bytes.as_ref())).with_guessed_format();
        // What cannot be read at all is told with its reason where it is decoded.
        let Some((width, height)) = reader.ok().and_then(|r| r.into_dimensions().ok()) else { continue };
        budget.feed(bytes.len() as u64);
        budget.spend(u64::from(width) * u64::from(height), 4, path)?;
    }
    Ok(())
}

fn decode_image(path: &str, encoded: Encoded) -> Parsed<Decoded> {
    match encoded {
        Encoded::Unusable(why) => Ok(Err(why)),
        Encoded::Here(bytes, file) => match ldr::decode(&bytes) {
            Ok(image) => Ok(Ok(Arc::new(image))),
            Err(why) => {
                let name = file.map_or(String::new(), |f| format!("{f}: "));
                Err(Fault::new(path, format!("{name}{}", why.trim().replace('\n', " "))))
            }
        },
    }
}

fn sampler(json: &Json) -> Parsed<Sampler> {
    let wrap = |key: &str| match json.unsigned(key)? {
        None | Some(10497) => Ok(Wrap::Repeat),
        Some(33648) => Ok(Wrap::Mirror),
        Some(33071) => Ok(Wrap::Clamp),
        Some(other) => Err(json.fault_at(key, format!("{other} is no wrapping mode"))),
    };
    let nearest = match json.unsigned("magFilter")? {
        None | Some(9729) => false,
        Some(9728) => true,
        Some(other) => return Err(json.fault_at("magFilter", format!("{other} is no magnification filter"))),
    };
    match json.unsigned("minFilter")? {
        None | Some(9728 | 9729 | 9984..=9987) => {}
        Some(other) => return Err(json.fault_at("minFilter", format!("{other} is no minification filter"))),
    }
    Ok(Sampler { wrap_s: wrap("wrapS")?, wrap_t: wrap("wrapT")?, nearest })
}
