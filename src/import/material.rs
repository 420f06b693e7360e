//! Materials: the metallic-roughness model and its extensions.

use super::document::Document;
use super::fault::{Fault, Parsed, label};
use super::native;
use super::texture::Textures;
use super::value::float;
use super::warnings::Warnings;
use crate::material::{AlphaMode, Material};
use crate::math::Color;
use crate::texture::{ColorSpace, TextureRef};
use gltf::material::AlphaMode as Mode;
use serde_json::Value;
use std::collections::BTreeSet;

/// Extensions of materials that show, and that we do not read.
const LEFT_OUT: [(&str, &str); 6] = [
    ("KHR_materials_sheen", "sheen"),
    ("KHR_materials_iridescence", "iridescence"),
    ("KHR_materials_anisotropy", "anisotropy"),
    ("KHR_materials_dispersion", "dispersion"),
    ("KHR_materials_diffuse_transmission", "diffuse transmission"),
    ("KHR_materials_subsurface", "subsurface scattering"),
];

/// All materials of the document; those that are not `shown` have no textures.
pub(super) fn materials(
    document: &Document, shown: &BTreeSet<usize>, textures: &mut Textures, warnings: &mut Warnings,
) -> Parsed<Vec<Material>> {
    let materials = document.gltf.materials();
    for (name, what) in LEFT_OUT {
        let count = materials.clone().filter(|m| m.extension_value(name).is_some()).count();
        if count > 0 {
            warnings.push(format!("the {what} of {count} materials ({name}) is left out"));
        }
    }
    let read = |(i, gltf)| {
        let (path, json) = (format!("/materials/{i}"), &document.json["materials"][i]);
        let (shown, textures, warnings) = (shown.contains(&i), &mut *textures, &mut *warnings);
        Reader { gltf, json, path, shown, textures, warnings }.material()
    };
    materials.enumerate().map(read).collect()
}

struct Reader<'r, 'a> {
    gltf: gltf::Material<'r>,
    /// The same as the document has it.
    json: &'r Value,
    path: String,
    shown: bool,
    textures: &'r mut Textures<'a>,
    warnings: &'r mut Warnings,
}

impl Reader<'_, '_> {
    /// The texture at `place` below the material.
    fn texture(&mut self, place: &str, space: ColorSpace) -> Parsed<Option<TextureRef>> {
        let Some(info) = self.json.pointer(place).filter(|_| self.shown) else { return Ok(None) };
        self.textures.reference(info, &format!("{}{place}", self.path), space, self.warnings)
    }

    fn material(mut self) -> Parsed<Material> {
        let pbr = self.gltf.pbr_metallic_roughness();
        let [r, g, b, alpha] = pbr.base_color_factor();
        let mut material = Material {
            name: self.gltf.name().unwrap_or("").to_owned(),
            base_color: Color::new(r, g, b),
            base_alpha: alpha,
            base_color_texture: self
                .texture("/pbrMetallicRoughness/baseColorTexture", ColorSpace::Srgb)?,
            metallic: pbr.metallic_factor(),
            roughness: pbr.roughness_factor(),
            metallic_roughness_texture: self
                .texture("/pbrMetallicRoughness/metallicRoughnessTexture", ColorSpace::Linear)?,
            ..Material::default()
        };
        self.surface(&mut material)?;
        self.specular_glossiness(&mut material)?;
        self.dielectric(&mut material)?;
        self.clearcoat(&mut material)?;
        if let Some(strength) = self.gltf.emissive_strength() {
            material.emission *= strength;
        }
        material.unlit = self.gltf.unlit();
        if let Some(native) = self.json.pointer("/extras/lumicache") {
            material.native =
                Some(native::brdf(native, &format!("{}/extras/lumicache", self.path))?);
        }
        Ok(material)
    }

    /// What the material itself says: normals, emission, alpha, sides.
    fn surface(&mut self, material: &mut Material) -> Parsed<()> {
        material.normal_scale = float(&self.json["normalTexture"]["scale"], 1.0);
        material.normal_texture = self.texture("/normalTexture", ColorSpace::Linear)?;
        material.emission = Color::from_array(self.gltf.emissive_factor());
        if material.emission.max_element() > 1.0 {
            let at = format!("{}/emissiveFactor", self.path);
            self.warnings.mend(&at, "it exceeds 1, and is taken as it stands")?;
        }
        material.emission_texture = self.texture("/emissiveTexture", ColorSpace::Srgb)?;
        material.alpha_mode = match self.gltf.alpha_mode() {
            Mode::Opaque => AlphaMode::Opaque,
            Mode::Mask => AlphaMode::Mask(self.gltf.alpha_cutoff().unwrap_or(0.5)),
            Mode::Blend => AlphaMode::Blend,
        };
        material.double_sided = self.gltf.double_sided();
        Ok(())
    }

    /// KHR_materials_ior, _specular, _transmission and _volume.
    fn dielectric(&mut self, material: &mut Material) -> Parsed<()> {
        if let Some(n) = self.gltf.ior() {
            let at = format!("{}/extensions/KHR_materials_ior/ior", self.path);
            if n < 0.0 {
                return Err(Fault::new(at, format!("{n} is neither 0 nor at least 1")));
            }
            if n != 0.0 && n < 1.0 {
                self.warnings
                    .mend(&at, format!("{n} is neither 0 nor at least 1; read as given"))?;
            }
            material.ior = n;
        }
        if let Some(specular) = self.gltf.specular() {
            material.specular = specular.specular_factor();
            material.specular_color = Color::from_array(specular.specular_color_factor());
            let at = "/extensions/KHR_materials_specular";
            material.specular_texture =
                self.texture(&format!("{at}/specularTexture"), ColorSpace::Linear)?;
            material.specular_color_texture =
                self.texture(&format!("{at}/specularColorTexture"), ColorSpace::Srgb)?;
        }
        if let Some(transmission) = self.gltf.transmission() {
            material.transmission = transmission.transmission_factor();
            let at = "/extensions/KHR_materials_transmission/transmissionTexture";
            material.transmission_texture = self.texture(at, ColorSpace::Linear)?;
        }
        if let Some(volume) = self.gltf.volume() {
            // Rays find the thickness of a solid themselves: only whether there is one counts.
            material.thin = volume.thickness_factor() == 0.0;
            material.attenuation_color = Color::from_array(volume.attenuation_color());
            if volume.attenuation_distance().is_finite() {
                material.attenuation_distance = volume.attenuation_distance();
            }
        }
        Ok(())
    }

    /// KHR_materials_clearcoat, which the crate lacks.
    fn clearcoat(&mut self, material: &mut Material) -> Parsed<()> {
        let at = "/extensions/KHR_materials_clearcoat";
        let Some(coat) = self.json.pointer(at) else { return Ok(()) };
        material.clearcoat = float(&coat["clearcoatFactor"], 0.0);
        material.clearcoat_texture =
            self.texture(&format!("{at}/clearcoatTexture"), ColorSpace::Linear)?;
        material.clearcoat_roughness = float(&coat["clearcoatRoughnessFactor"], 0.0);
        material.clearcoat_roughness_texture =
            self.texture(&format!("{at}/clearcoatRoughnessTexture"), ColorSpace::Linear)?;
        if coat.get("clearcoatNormalTexture").is_some() && material.clearcoat > 0.0 {
            self.warnings.push(format!(
                "{}: the normal map of its clear coat is left out",
                label(&self.path, self.json)
            ));
        }
        Ok(())
    }

    /// KHR_materials_pbrSpecularGlossiness, said in our terms: a dielectric whose F0 is the
    /// specular colour alone (index of refraction 0).
    fn specular_glossiness(&mut self, material: &mut Material) -> Parsed<()> {
        let Some(old) = self.gltf.pbr_specular_glossiness() else { return Ok(()) };
        let at = "/extensions/KHR_materials_pbrSpecularGlossiness";
        let [r, g, b, a] = old.diffuse_factor();
        (material.base_color, material.base_alpha) = (Color::new(r, g, b), a);
        material.base_color_texture =
            self.texture(&format!("{at}/diffuseTexture"), ColorSpace::Srgb)?;
        material.metallic = 0.0;
        material.ior = 0.0;
        material.specular_color = Color::from_array(old.specular_factor());
        let (place, glossiness) =
            (format!("{at}/specularGlossinessTexture"), old.glossiness_factor());
        material.specular_color_texture = self.texture(&place, ColorSpace::Srgb)?;
        material.metallic_roughness_texture = match self.json.pointer(&place).filter(|_| self.shown)
        {
            Some(info) => self.textures.roughness_from_glossiness(
                info,
                &format!("{}{place}", self.path),
                glossiness,
                self.warnings,
            )?,
            None => None,
        };
        material.roughness =
            if material.metallic_roughness_texture.is_some() { 1.0 } else { 1.0 - glossiness };
        Ok(())
    }
}
