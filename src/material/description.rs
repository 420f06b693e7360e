//! What a scene file says of a surface.

use super::native::NativeBrdf;
use crate::math::Color;
use crate::texture::TextureRef;

/// How the alpha of the base colour is used.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum AlphaMode {
    /// Ignored.
    #[default]
    Opaque,
    /// The surface is there where alpha is at least the cutoff.
    Mask(f32),
    /// The surface is there with probability alpha, drawn anew for each ray.
    Blend,
}

/// A material as the scene file describes it: factors and textures of the glTF metallic-roughness
/// model with the extensions we read.
#[derive(Clone, Debug, PartialEq)]
pub struct Material {
    /// Name for messages.
    pub name: String,
    /// Base colour factor, linear.
    pub base_color: Color,
    /// Alpha factor.
    pub base_alpha: f32,
    /// Base colour texture (sRGB), alpha in A.
    pub base_color_texture: Option<TextureRef>,
    /// Metallic factor.
    pub metallic: f32,
    /// Perceptual roughness factor; GGX α is its square.
    pub roughness: f32,
    /// Roughness in G, metallic in B (linear).
    pub metallic_roughness_texture: Option<TextureRef>,
    /// Tangent-space normals (linear).
    pub normal_texture: Option<TextureRef>,
    /// Scale of the normal map's xy.
    pub normal_scale: f32,
    /// Emitted radiance: factor times strength.
    pub emission: Color,
    /// Multiplied into the emission (sRGB).
    pub emission_texture: Option<TextureRef>,
    /// Use of alpha.
    pub alpha_mode: AlphaMode,
    /// Emits from both faces; and other hosts may cull back faces where false, we never do.
    pub double_sided: bool,
    /// Index of refraction of the dielectric, ≥ 1 (0 means an infinite one: F0 = 1).
    pub ior: f32,
    /// Strength of the dielectric's specular reflection.
    pub specular: f32,
    /// Multiplied into `specular`, in A (linear).
    pub specular_texture: Option<TextureRef>,
    /// Tint of the dielectric's F0.
    pub specular_color: Color,
    /// Multiplied into `specular_color` (sRGB).
    pub specular_color_texture: Option<TextureRef>,
    /// Share of the dielectric's body that transmits instead of scattering diffusely.
    pub transmission: f32,
    /// Multiplied into `transmission`, in R (linear).
    pub transmission_texture: Option<TextureRef>,
    /// True for an infinitely thin walled surface: no refraction and no absorption.
    pub thin: bool,
    /// Colour of white light after `attenuation_distance` inside a solid.
    pub attenuation_color: Color,
    /// Distance for `attenuation_color`; infinite for a clear solid.
    pub attenuation_distance: f32,
    /// Strength of the clear coat.
    pub clearcoat: f32,
    /// Multiplied into `clearcoat`, in R (linear).
    pub clearcoat_texture: Option<TextureRef>,
    /// Perceptual roughness of the coat.
    pub clearcoat_roughness: f32,
    /// Multiplied into `clearcoat_roughness`, in G (linear).
    pub clearcoat_roughness_texture: Option<TextureRef>,
    /// KHR_materials_unlit: shows its base colour as emitted radiance, lights nothing and reflects
    /// nothing.
    pub unlit: bool,
    /// A BRDF of the papers in place of the glTF model.
    pub native: Option<NativeBrdf>,
    /// Accounts for light that scatters more than once between microfacets: rough surfaces lose no
    /// energy. Without this light the glTF model is the single-scattering one of older renderers.
    pub multiple_scattering: bool,
}

impl Default for Material {
    /// glTF's default material.
    fn default() -> Self {
        Self {
            name: String::new(),
            base_color: Color::ONE,
            base_alpha: 1.0,
            base_color_texture: None,
            metallic: 1.0,
            roughness: 1.0,
            metallic_roughness_texture: None,
            normal_texture: None,
            normal_scale: 1.0,
            emission: Color::ZERO,
            emission_texture: None,
            alpha_mode: AlphaMode::Opaque,
            double_sided: false,
            ior: 1.5,
            specular: 1.0,
            specular_texture: None,
            specular_color: Color::ONE,
            specular_color_texture: None,
            transmission: 0.0,
            transmission_texture: None,
            thin: true,
            attenuation_color: Color::ONE,
            attenuation_distance: f32::INFINITY,
            clearcoat: 0.0,
            clearcoat_texture: None,
            clearcoat_roughness: 0.0,
            clearcoat_roughness_texture: None,
            unlit: false,
            native: None,
            multiple_scattering: false,
        }
    }
}
