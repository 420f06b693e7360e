//! Samplers and textures.

use super::accessors::Accessors;
use super::budget::Budget;
use super::images::{self, Decoded};
use super::json::{Fault, Json, Parsed};
use crate::imagefile::{TextureImage, TexturePixels};
use crate::math::Vec2;
use crate::texture::{ColorSpace, Texture, TextureRef, Wrap};
use std::collections::HashMap;
use std::path::Path;
use std::sync::Arc;

/// How texture coordinates outside the image and between pixels are treated.
#[derive(Clone, Copy, Default)]
struct Sampler {
    wrap_s: Wrap,
    wrap_t: Wrap,
    nearest: bool,
}

/// What makes the pixels of one of the scene's textures.
#[derive(Clone, Copy, PartialEq, Eq, Hash)]
enum Use {
    /// The image as it is.
    Plain,
    /// 1 - factor * alpha in the green channel: glossiness to roughness; the factor by its bits.
    Roughness(u32),
}

/// The textures of a document, and which of them materials use.
pub(super) struct Textures {
    images: Vec<Decoded>,
    samplers: Vec<Sampler>,
    /// Image and sampler of each texture; a reference to nowhere is an error only where a material
    /// uses the texture.
    textures: Vec<(Parsed<Option<usize>>, Option<usize>)>,
    /// The textures in use, in the order of their first use, which is that of the scene's
    /// textures.
    slots: Vec<(usize, Use)>,
    slot_of: HashMap<(usize, Use), u32>,
    pixels: Budget,
}

impl Textures {
    /// Reads and decodes all images, and the samplers and textures that refer to them.
    pub fn parse(
        root: &Json,
        accessors: &Accessors,
        folder: &Path,
        warnings: &mut Vec<String>,
    ) -> Parsed<Self> {
        let mut pixels = Budget::of_pixels();
        let images = images::images(root, accessors, folder, &mut pixels, warnings)?;
        let samplers =
            root.entities("samplers")?.iter().map(sampler).collect::<Parsed<Vec<_>>>()?;
        let mut textures = Vec::new();
        for json in root.entities("textures")? {
            let image = image_of(&json, images.len());
            if let Err(fault) = &image {
                warnings.push(format!("{}: {}", fault.path, fault.what));
            }
            textures.push((image, json.index("sampler", "samplers", samplers.len())?));
        }
        Ok(Self { images, samplers, textures, slots: Vec::new(), slot_of: HashMap::new(), pixels })
    }

    /// The place of a texture in the scene, which is given to it on its first use.
    fn slot(&mut self, texture: usize, image: &TextureImage, usage: Use, at: &str) -> Parsed<u32> {
        if let Some(slot) = self.slot_of.get(&(texture, usage)) {
            return Ok(*slot);
        }
        if usage != Use::Plain {
            self.pixels.spend(u64::from(image.width) * u64::from(image.height), 4, at)?;
        }
        let slot = self.slots.len() as u32;
        self.slots.push((texture, usage));
        self.slot_of.insert((texture, usage), slot);
        Ok(slot)
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

    /// As [`Textures::reference`], for a texture with glossiness in its alpha channel: the
    /// roughness `1 - factor * glossiness` in green.
    pub fn roughness_from_glossiness(
        &mut self,
        material: &Json,
        key: &str,
        factor: f32,
        warnings: &mut Vec<String>,
    ) -> Parsed<Option<TextureRef>> {
        self.reference_as(
            material,
            key,
            ColorSpace::Linear,
            Use::Roughness(factor.to_bits()),
            warnings,
        )
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
            offset = transform
                .numbers::<2>("offset")?
                .map_or(offset, |v| Vec2::new(v[0] as f32, v[1] as f32));
            rotation = transform.number("rotation")?.unwrap_or(0.0) as f32;
            scale = transform
                .numbers::<2>("scale")?
                .map_or(scale, |v| Vec2::new(v[0] as f32, v[1] as f32));
            uv_set = transform.unsigned("texCoord")?.unwrap_or(uv_set);
        }
        let mut left_out =
            |why: String| warnings.push(format!("{} is left out: {why}", info.path()));
        if uv_set > 1 {
            left_out(format!(
                "it uses the texture coordinates TEXCOORD_{uv_set}, and only TEXCOORD_0 and TEXCOORD_1 are read"
            ));
            return Ok(None);
        }
        let Some(image) = self.textures[texture].0.clone()? else {
            left_out(format!("/textures/{texture} has no image of a kind that we read"));
            return Ok(None);
        };
        let image = match &self.images[image] {
            Ok(image) => image.clone(),
            Err(why) => return Err(Fault::new(format!("/images/{image}"), why.as_str())),
        };
        let texture = self.slot(texture, &image, usage, info.path())?;
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
                Use::Roughness(factor) => Arc::new(roughness(image, f32::from_bits(factor))),
            };
            Some(Texture {
                image,
                wrap_s: sampler.wrap_s,
                wrap_t: sampler.wrap_t,
                nearest: sampler.nearest,
            })
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
            let green =
                |a: u16| (65535.0 - factor * f32::from(a)).round().clamp(0.0, 65535.0) as u16;
            TexturePixels::Rgba16(
                pixels.iter().map(|p| [65535, green(p[3]), 65535, 65535]).collect(),
            )
        }
    };
    TextureImage { width: image.width, height: image.height, pixels }
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
        Some(other) => {
            return Err(json.fault_at("magFilter", format!("{other} is no magnification filter")));
        }
    };
    match json.unsigned("minFilter")? {
        None | Some(9728 | 9729 | 9984..=9987) => {}
        Some(other) => {
            return Err(json.fault_at("minFilter", format!("{other} is no minification filter")));
        }
    }
    Ok(Sampler { wrap_s: wrap("wrapS")?, wrap_t: wrap("wrapT")?, nearest })
}
