//! Materials: the metallic-roughness model and its extensions.

use super::json::{Json, Parsed, quote};
use super::native;
use super::textures::Textures;
use crate::material::{AlphaMode, Material};
use crate::math::Color;
use crate::texture::ColorSpace;

const ANY: f64 = f64::INFINITY;

/// Extensions of materials that show, and that we do not read.
const LEFT_OUT: [(&str, &str); 6] = [
    ("KHR_materials_sheen", "sheen"),
    ("KHR_materials_iridescence", "iridescence"),
    ("KHR_materials_anisotropy", "anisotropy"),
    ("KHR_materials_dispersion", "dispersion"),
    ("KHR_materials_diffuse_transmission", "diffuse transmission"),
    ("KHR_materials_subsurface", "subsurface scattering"),
];

/// All materials of the document.
pub(super) fn materials(
    root: &Json,
    textures: &mut Textures,
    warnings: &mut Vec<String>,
) -> Parsed<Vec<Material>> {
    let entities = root.entities("materials")?;
    for (name, what) in LEFT_OUT {
        let mut count = 0;
        for json in &entities {
            count += usize::from(json.extension(name)?.is_some());
        }
        if count > 0 {
            warnings.push(format!("the {what} of {count} materials ({name}) is left out"));
        }
    }
    entities.iter().map(|json| Reader { json, textures, warnings }.material()).collect()
}

struct Reader<'r, 'a> {
    json: &'r Json<'a>,
    textures: &'r mut Textures,
    warnings: &'r mut Vec<String>,
}

fn color(rgb: [f32; 3]) -> Color {
    Color::from_array(rgb)
}

impl Reader<'_, '_> {
    fn texture(
        &mut self,
        object: &Json,
        key: &str,
        space: ColorSpace,
    ) -> Parsed<Option<crate::texture::TextureRef>> {
        self.textures.reference(object, key, space, self.warnings)
    }

    fn material(mut self) -> Parsed<Material> {
        let json = self.json;
        let mut material =
            Material { name: json.string("name")?.unwrap_or("").to_owned(), ..Material::default() };
        self.core(&mut material)?;
        self.surface(&mut material)?;
        self.specular_glossiness(&mut material)?;
        self.dielectric(&mut material)?;
        self.clearcoat(&mut material)?;
        if let Some(strength) = json.extension("KHR_materials_emissive_strength")? {
            material.emission *= strength.number_in("emissiveStrength", 1.0, 0.0, ANY)?;
        }
        material.unlit = json.extension("KHR_materials_unlit")?.is_some();
        if let Some(extras) = json.get("extras")?.filter(Json::is_object) {
            material.native =
                extras.get("lumicache")?.map(|native| native::brdf(&native)).transpose()?;
        }
        Ok(material)
    }

    /// pbrMetallicRoughness.
    fn core(&mut self, material: &mut Material) -> Parsed<()> {
        let Some(pbr) = self.json.object_at("pbrMetallicRoughness")? else { return Ok(()) };
        let [r, g, b, a] = pbr.numbers_in::<4>("baseColorFactor", 1.0, 0.0, 1.0)?;
        (material.base_color, material.base_alpha) = (color([r, g, b]), a);
        material.base_color_texture = self.texture(&pbr, "baseColorTexture", ColorSpace::Srgb)?;
        material.metallic = pbr.number_in("metallicFactor", 1.0, 0.0, 1.0)?;
        material.roughness = pbr.number_in("roughnessFactor", 1.0, 0.0, 1.0)?;
        material.metallic_roughness_texture =
            self.texture(&pbr, "metallicRoughnessTexture", ColorSpace::Linear)?;
        Ok(())
    }

    /// What the material itself says: normals, emission, alpha, sides.
    fn surface(&mut self, material: &mut Material) -> Parsed<()> {
        let json = self.json;
        if let Some(info) = json.object_at("normalTexture")? {
            material.normal_scale = info.number("scale")?.unwrap_or(1.0) as f32;
            material.normal_texture = self.texture(json, "normalTexture", ColorSpace::Linear)?;
        }
        if let Some(occlusion) = json.object_at("occlusionTexture")? {
            // Occlusion is what this program computes, so the texture is checked and not used.
            occlusion.number_in("strength", 1.0, 0.0, 1.0)?;
            occlusion.unsigned("index")?.ok_or_else(|| occlusion.missing("index"))?;
        }
        // The specification ends at 1 and leaves more to KHR_materials_emissive_strength; exporters
        // do not.
        material.emission = color(json.numbers_in::<3>("emissiveFactor", 0.0, 0.0, ANY)?);
        if material.emission.max_element() > 1.0 {
            self.warnings.push(format!(
                "{}: emissiveFactor exceeds 1; it is taken as it stands",
                json.label()
            ));
        }
        material.emission_texture = self.texture(json, "emissiveTexture", ColorSpace::Srgb)?;
        let cutoff = json.number_in("alphaCutoff", 0.5, 0.0, ANY)?;
        material.alpha_mode = match json.string("alphaMode")? {
            None | Some("OPAQUE") => AlphaMode::Opaque,
            Some("MASK") => AlphaMode::Mask(cutoff),
            Some("BLEND") => AlphaMode::Blend,
            Some(other) => {
                self.warnings.push(format!(
                    "{}: alphaMode {} is unknown; taken as OPAQUE",
                    json.label(),
                    quote(other)
                ));
                AlphaMode::Opaque
            }
        };
        material.double_sided = json.boolean("doubleSided", false)?;
        Ok(())
    }

    /// KHR_materials_ior, _specular, _transmission and _volume.
    fn dielectric(&mut self, material: &mut Material) -> Parsed<()> {
        let json = self.json;
        if let Some(ior) = json.extension("KHR_materials_ior")? {
            let n = ior.number("ior")?.unwrap_or(1.5);
            if n != 0.0 && n < 1.0 {
                return Err(ior.fault_at("ior", format!("{n} is neither 0 nor at least 1")));
            }
            material.ior = n as f32;
        }
        if let Some(specular) = json.extension("KHR_materials_specular")? {
            material.specular = specular.number_in("specularFactor", 1.0, 0.0, 1.0)?;
            material.specular_texture =
                self.texture(&specular, "specularTexture", ColorSpace::Linear)?;
            material.specular_color =
                color(specular.numbers_in::<3>("specularColorFactor", 1.0, 0.0, ANY)?);
            material.specular_color_texture =
                self.texture(&specular, "specularColorTexture", ColorSpace::Srgb)?;
        }
        if let Some(transmission) = json.extension("KHR_materials_transmission")? {
            material.transmission = transmission.number_in("transmissionFactor", 0.0, 0.0, 1.0)?;
            material.transmission_texture =
                self.texture(&transmission, "transmissionTexture", ColorSpace::Linear)?;
        }
        if let Some(volume) = json.extension("KHR_materials_volume")? {
            // Rays find the thickness of a solid themselves: only whether there is one counts.
            material.thin = volume.number_in("thicknessFactor", 0.0, 0.0, ANY)? == 0.0;
            material.attenuation_color =
                color(volume.numbers_in::<3>("attenuationColor", 1.0, 0.0, 1.0)?);
            if let Some(distance) = volume.number("attenuationDistance")? {
                if distance <= 0.0 {
                    return Err(volume.fault_at(
                        "attenuationDistance",
                        format!("{distance} is not greater than 0"),
                    ));
                }
                material.attenuation_distance = distance as f32;
            }
        }
        Ok(())
    }

    /// KHR_materials_clearcoat.
    fn clearcoat(&mut self, material: &mut Material) -> Parsed<()> {
        let Some(coat) = self.json.extension("KHR_materials_clearcoat")? else { return Ok(()) };
        material.clearcoat = coat.number_in("clearcoatFactor", 0.0, 0.0, 1.0)?;
        material.clearcoat_texture = self.texture(&coat, "clearcoatTexture", ColorSpace::Linear)?;
        material.clearcoat_roughness = coat.number_in("clearcoatRoughnessFactor", 0.0, 0.0, 1.0)?;
        material.clearcoat_roughness_texture =
            self.texture(&coat, "clearcoatRoughnessTexture", ColorSpace::Linear)?;
        if coat.object_at("clearcoatNormalTexture")?.is_some() && material.clearcoat > 0.0 {
            self.warnings.push(format!(
                "{}: the normal map of its clear coat is left out",
                self.json.label()
            ));
        }
        Ok(())
    }

    /// KHR_materials_pbrSpecularGlossiness, said in our terms: a dielectric whose F0 is the
    /// specular colour alone (index of refraction 0).
    fn specular_glossiness(&mut self, material: &mut Material) -> Parsed<()> {
        let Some(old) = self.json.extension("KHR_materials_pbrSpecularGlossiness")? else {
            return Ok(());
        };
        let [r, g, b, a] = old.numbers_in::<4>("diffuseFactor", 1.0, 0.0, 1.0)?;
        (material.base_color, material.base_alpha) = (color([r, g, b]), a);
        material.base_color_texture = self.texture(&old, "diffuseTexture", ColorSpace::Srgb)?;
        material.metallic = 0.0;
        material.ior = 0.0;
        material.specular_color = color(old.numbers_in::<3>("specularFactor", 1.0, 0.0, 1.0)?);
        material.specular_color_texture =
            self.texture(&old, "specularGlossinessTexture", ColorSpace::Srgb)?;
        let glossiness = old.number_in("glossinessFactor", 1.0, 0.0, 1.0)?;
        material.metallic_roughness_texture = self.textures.roughness_from_glossiness(
            &old,
            "specularGlossinessTexture",
            glossiness,
            self.warnings,
        )?;
        material.roughness =
            if material.metallic_roughness_texture.is_some() { 1.0 } else { 1.0 - glossiness };
        Ok(())
    }
}
