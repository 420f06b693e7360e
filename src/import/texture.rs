//! Samplers and textures.

use super::budget::Budget;
use super::buffers::Buffers;
use super::document::Document;
use super::fault::{Fault, Parsed};
use super::image;
use super::value::index;
use super::warnings::Warnings;
use crate::imagefile::{TextureImage, TexturePixels};
use crate::math::Vec2;
use crate::texture::{ColorSpace, Texture, TextureRef, Wrap};
use gltf::json::texture::Info;
use gltf::texture::{MagFilter, Sampler, WrappingMode};
use serde::Deserialize;
use serde_json::Value;
use std::collections::{BTreeMap, BTreeSet, HashMap};
use std::sync::Arc;

/// What makes the pixels of one of the scene's textures.
#[derive(Clone, Copy, PartialEq, Eq, Hash)]
enum Use {
    /// The image as it is.
    Plain,
    /// 1 - factor * alpha in the green channel: glossiness to roughness; the factor by its bits.
    Roughness(u32),
}

/// The textures of a document, and which of them materials use.
pub(super) struct Textures<'a> {
    /// The images that materials show, by their index; `None` for one that cannot be shown.
    images: BTreeMap<usize, Option<Arc<TextureImage>>>,
    /// Sampler and image of each texture.
    textures: Vec<(Sampler<'a>, Option<usize>)>,
    /// The textures in use, in the order of their first use, which is that of the scene's
    /// textures.
    slots: Vec<(usize, Use)>,
    slot_of: HashMap<(usize, Use), u32>,
    budget: &'a mut Budget,
}

impl<'a> Textures<'a> {
    /// Reads the textures, and decodes the images that the materials `shown` refer to.
    pub fn parse(
        document: &'a Document, buffers: &Buffers, shown: &BTreeSet<usize>, budget: &'a mut Budget,
        warnings: &mut Warnings,
    ) -> Parsed<Self> {
        let image_of =
            |texture: gltf::Texture| image_of(&document.json["textures"][texture.index()]);
        let textures: Vec<_> = document
            .gltf
            .textures()
            .map(|texture| (texture.sampler(), image_of(texture)))
            .collect();
        let mut used = BTreeSet::new();
        for material in shown {
            let material = &document.json["materials"][material];
            textures_below(material, &mut |texture| used.extend([texture]));
        }
        let (mut wanted, count) = (BTreeSet::new(), document.root().images.len());
        for (texture, image) in used.iter().filter_map(|i| Some((i, textures[*i].1?))) {
            if image >= count {
                let what = format!("refers to /images/{image}, and images has {count}");
                return Err(Fault::new(format!("/textures/{texture}/source"), what));
            }
            wanted.insert(image);
        }
        let images = image::images(document, buffers, &wanted, budget, warnings)?;
        Ok(Self { images, textures, slots: Vec::new(), slot_of: HashMap::new(), budget })
    }

    /// The place of a texture in the scene, which is given to it on its first use.
    fn slot(&mut self, texture: usize, image: &TextureImage, usage: Use, at: &str) -> Parsed<u32> {
        if let Some(slot) = self.slot_of.get(&(texture, usage)) {
            return Ok(*slot);
        }
        if usage != Use::Plain {
            let (count, size) = image.pixels.size();
            self.budget.spend(count as u64, size as u64, at)?;
        }
        let slot = self.slots.len() as u32;
        self.slots.push((texture, usage));
        self.slot_of.insert((texture, usage), slot);
        Ok(slot)
    }

    /// The texture that `info`, which stands at the JSON path `at`, refers to.
    pub fn reference(
        &mut self, info: &Value, at: &str, color_space: ColorSpace, warnings: &mut Warnings,
    ) -> Parsed<Option<TextureRef>> {
        self.reference_as(info, at, color_space, Use::Plain, warnings)
    }

    /// As [`Textures::reference`], for a texture with glossiness in its alpha channel: the
    /// roughness `1 - factor * glossiness` in green.
    pub fn roughness_from_glossiness(
        &mut self, info: &Value, at: &str, factor: f32, warnings: &mut Warnings,
    ) -> Parsed<Option<TextureRef>> {
        let usage = Use::Roughness(factor.to_bits());
        self.reference_as(info, at, ColorSpace::Linear, usage, warnings)
    }

    fn reference_as(
        &mut self, info: &Value, at: &str, color_space: ColorSpace, usage: Use,
        warnings: &mut Warnings,
    ) -> Parsed<Option<TextureRef>> {
        let info = Info::deserialize(info).map_err(|e| Fault::new(at, e.to_string()))?;
        let transform = info.extensions.and_then(|e| e.texture_transform).unwrap_or_default();
        let uv_set = transform.tex_coord.unwrap_or(info.tex_coord);
        let mut left_out = |why: String| warnings.push(format!("{at} is left out: {why}"));
        if uv_set > 1 {
            left_out(format!(
                "it uses the texture coordinates TEXCOORD_{uv_set}, and only TEXCOORD_0 and TEXCOORD_1 are read"
            ));
            return Ok(None);
        }
        let texture = info.index.value();
        let Some(image) = self.textures[texture].1 else {
            left_out(format!("/textures/{texture} has no image of a kind that we read"));
            return Ok(None);
        };
        // A warning was given where the image was found wanting.
        let Some(image) = self.images.get(&image).cloned().flatten() else { return Ok(None) };
        Ok(Some(TextureRef {
            texture: self.slot(texture, &image, usage, at)?,
            uv_set: uv_set as u8,
            offset: Vec2::from_array(transform.offset.0),
            rotation: transform.rotation.0,
            scale: Vec2::from_array(transform.scale.0),
            color_space,
        }))
    }

    /// The textures in use.
    pub fn build(self) -> Vec<Texture> {
        let texture = |(texture, usage): (usize, Use)| {
            let (sampler, image) = &self.textures[texture];
            // `reference_as` lets only textures in whose images are there.
            let image = self.images.get(&(*image)?)?.as_ref()?;
            let image = match usage {
                Use::Plain => image.clone(),
                Use::Roughness(factor) => Arc::new(roughness(image, f32::from_bits(factor))),
            };
            Some(Texture {
                image,
                wrap_s: wrap(sampler.wrap_s()),
                wrap_t: wrap(sampler.wrap_t()),
                nearest: sampler.mag_filter() == Some(MagFilter::Nearest),
            })
        };
        self.slots.iter().filter_map(|slot| texture(*slot)).collect()
    }
}

/// The image that a texture shows: the WebP one where there is a choice.
fn image_of(texture: &Value) -> Option<usize> {
    let webp = texture.pointer("/extensions/EXT_texture_webp/source");
    webp.or_else(|| texture.get("source")).and_then(index)
}

/// Calls `visit` with the textures that anything below a material refers to, but for those of
/// occlusion and thickness, which we do not read.
fn textures_below(value: &Value, visit: &mut impl FnMut(usize)) {
    for (key, value) in value.as_object().into_iter().flatten() {
        match index(&value["index"]).filter(|_| key.ends_with("Texture")) {
            Some(texture) if !["occlusionTexture", "thicknessTexture"].contains(&key.as_str()) => {
                visit(texture);
            }
            _ => textures_below(value, visit),
        }
    }
}

fn wrap(mode: WrappingMode) -> Wrap {
    match mode {
        WrappingMode::Repeat => Wrap::Repeat,
        WrappingMode::MirroredRepeat => Wrap::Mirror,
        WrappingMode::ClampToEdge => Wrap::Clamp,
    }
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
