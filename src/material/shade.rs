//! From a material and a point on a surface to what the integrators need: opacity, emission, BSDF.

use super::bsdf::Bsdf;
use super::description::{AlphaMode, Material};
use super::layered::Layered;
use super::microfacet::DELTA_ALPHA;
use crate::geometry::SurfacePoint;
use crate::math::{Color, Frame, Vec2, Vec3, Vec4};
use crate::texture::{Texture, TextureRef, lookup};

/// Least cosine of the bent shading normal with the geometric normal and with the direction to the
/// viewer.
const MIN_NORMAL_COS: f32 = 1e-3;
/// Relative indices closer to 1 than this refract less than single precision can sample; light
/// passes straight through.
const STRAIGHT_ETA: f32 = 1e-2;

/// The value of an optional texture, white without one.
#[inline]
fn texture(textures: &[Texture], reference: &Option<TextureRef>, uv: &[Vec2; 2]) -> Vec4 {
    reference.as_ref().map_or(Vec4::ONE, |r| lookup(textures, r, uv))
}

impl Material {
    /// Probability with which the surface stops a ray: 1 opaque, 0 or 1 for a mask, alpha for a
    /// blend.
    #[inline]
    pub fn opacity(&self, textures: &[Texture], sp: &SurfacePoint) -> f32 {
        if self.is_opaque() {
            return 1.0;
        }
        let alpha = texture(textures, &self.base_color_texture, &sp.uv).w;
        self.opacity_of(self.base_alpha * sp.color.w * alpha)
    }

    /// [`Material::opacity`] where alpha, all factors counted, is `alpha`.
    #[inline]
    pub fn opacity_of(&self, alpha: f32) -> f32 {
        match self.alpha_mode {
            AlphaMode::Opaque => 1.0,
            AlphaMode::Mask(cutoff) => f32::from(alpha >= cutoff),
            AlphaMode::Blend => alpha.clamp(0.0, 1.0),
        }
    }

    /// True if [`Material::opacity`] is 1 everywhere.
    #[inline]
    pub fn is_opaque(&self) -> bool {
        self.alpha_mode == AlphaMode::Opaque
    }

    /// False only if [`Bsdf::pane`] is `None` everywhere.
    pub fn may_be_pane(&self) -> bool {
        let smooth = self.roughness.powi(2) < DELTA_ALPHA
            || self.metallic_roughness_texture.is_some()
            || !self.thin && (self.ior - 1.0).abs() < STRAIGHT_ETA;
        self.transmission > 0.0 && smooth && self.native.is_none() && !self.unlit
    }

    /// True if the surface lights others. An unlit material shows a colour but lights nothing.
    #[inline]
    pub fn is_emissive(&self) -> bool {
        !self.unlit && self.emission.max_element() > 0.0
    }

    /// Radiance emitted towards `sp.wo`, W m⁻² sr⁻¹; zero on back faces unless the material is
    /// double sided.
    ///
    /// An unlit material returns its base colour on both faces. The colour is for rays from the
    /// camera and must not light other surfaces.
    pub fn emission_at(&self, textures: &[Texture], sp: &SurfacePoint) -> Color {
        if self.unlit {
            return self.base_color_at(textures, sp);
        }
        if self.emission == Color::ZERO || (sp.back_face && !self.double_sided) {
            return Color::ZERO;
        }
        self.emission * texture(textures, &self.emission_texture, &sp.uv).truncate()
    }

    /// Base colour: factor, texture and vertex colour.
    fn base_color_at(&self, textures: &[Texture], sp: &SurfacePoint) -> Color {
        self.base_color
            * sp.color.truncate()
            * texture(textures, &self.base_color_texture, &sp.uv).truncate()
    }

    /// Extinction coefficient inside the solid, per scene unit: radiance falls by `exp(-attenuation
    /// · distance)` per channel; zero for materials that do not enclose a volume.
    ///
    /// ```text
    /// σ = -ln(attenuation_color) / attenuation_distance        (KHR_materials_volume)
    /// ```
    pub fn attenuation(&self) -> Color {
        if self.thin
            || self.transmission <= 0.0
            || !(self.attenuation_distance > 0.0 && self.attenuation_distance.is_finite())
        {
            return Color::ZERO;
        }
        let color = self.attenuation_color.clamp(Color::splat(1e-6), Color::ONE);
        -Color::new(color.x.ln(), color.y.ln(), color.z.ln()) / self.attenuation_distance
    }

    /// Reads all textures at the point and returns the BSDF in the frame `sp.frame`. This call may
    /// change the frame: normal maps tilt it, anisotropic BRDFs take the mesh's tangent, and a
    /// normal that points away from the viewer or through the geometric surface is bent back.
    /// Afterwards `frame.n · ng > 0` and `frame.n · wo > 0`.
    ///
    /// A normal map needs mesh tangents and is ignored where `sp.tangent` is zero.
    pub fn shade(&self, textures: &[Texture], sp: &mut SurfacePoint) -> Bsdf {
        self.orient(textures, sp);
        if self.unlit {
            return Bsdf::BLACK;
        }
        match self.native {
            Some(brdf) => Bsdf::native(brdf),
            None => Bsdf::layered(self.layers(textures, sp)),
        }
    }

    /// Evaluates glTF's parameters. [glTF20, Appendix B], KHR_materials_ior, _specular,
    /// _transmission, _volume, _clearcoat.
    fn layers(&self, textures: &[Texture], sp: &SurfacePoint) -> Layered {
        let scaled = |factor: f32, reference: &Option<TextureRef>, channel: usize| {
            if factor > 0.0 {
                (factor * texture(textures, reference, &sp.uv)[channel]).clamp(0.0, 1.0)
            } else {
                0.0
            }
        };
        let base = self.base_color_at(textures, sp).clamp(Color::ZERO, Color::ONE);
        let metal_rough = texture(textures, &self.metallic_roughness_texture, &sp.uv);
        let metallic = (self.metallic * metal_rough.z).clamp(0.0, 1.0);
        let alpha = (self.roughness * metal_rough.y).clamp(0.0, 1.0).powi(2);

        let specular = scaled(self.specular, &self.specular_texture, 3);
        let specular_color = (self.specular_color
            * texture(textures, &self.specular_color_texture, &sp.uv).truncate())
        .max(Color::ZERO);
        let normal_reflectance =
            if self.ior > 0.0 { ((self.ior - 1.0) / (self.ior + 1.0)).powi(2) } else { 1.0 };
        let dielectric_f0 = (specular_color * normal_reflectance).min(Color::ONE) * specular;

        let transmission = scaled(self.transmission, &self.transmission_texture, 0);
        let is_solid = !self.thin && self.ior >= 1.0;
        let solid = if is_solid { (1.0 - metallic) * transmission } else { 0.0 };
        let eta = match (is_solid && solid > 0.0, sp.back_face) {
            (false, _) => 0.0,
            (true, _) if self.ior - 1.0 < STRAIGHT_ETA => 1.0,
            (true, false) => self.ior,
            (true, true) => 1.0 / self.ior,
        };

        // The reflector blends metal and dielectric; what is the boundary of a solid reflects on
        // its own.
        let dielectric = 1.0 - metallic - solid;
        let f0 = base * metallic + dielectric_f0 * dielectric;
        let inside = eta > 0.0 && sp.back_face;
        Layered {
            diffuse: base * ((1.0 - metallic) * (1.0 - transmission)),
            f0,
            f90: metallic + specular * dielectric,
            again0: base * base * metallic + dielectric_f0 * dielectric_f0 * dielectric,
            again90: base * metallic + dielectric_f0 * (specular * dielectric),
            alpha,
            cover: Vec2::new(dielectric_f0.max_element(), specular),
            transmit: base * ((1.0 - metallic) * transmission),
            eta,
            solid,
            solid_specular: specular_color.min(Color::ONE) * specular,
            coat: if inside { 0.0 } else { scaled(self.clearcoat, &self.clearcoat_texture, 0) },
            coat_alpha: scaled(self.clearcoat_roughness, &self.clearcoat_roughness_texture, 1)
                .powi(2),
            multiple_scattering: self.multiple_scattering,
        }
    }

    /// Turns the shading frame: normal map, anisotropy, and the guarantee that the viewer and the
    /// geometric normal are above the shaded surface.
    fn orient(&self, textures: &[Texture], sp: &mut SurfacePoint) {
        let mut n = sp.frame.n;
        if let (Some(map), true) = (&self.normal_texture, sp.tangent.truncate() != Vec3::ZERO) {
            let texel = lookup(textures, map, &sp.uv).truncate() * 2.0 - 1.0;
            let tilt = Vec3::new(texel.x * self.normal_scale, texel.y * self.normal_scale, texel.z);
            // The map is defined on the front face; behind it the finished normal is turned around.
            let side = if sp.back_face { -1.0 } else { 1.0 };
            let front = n * side;
            let tangent = (sp.tangent.truncate() - front * front.dot(sp.tangent.truncate()))
                .normalize_or_zero();
            let bitangent = front.cross(tangent) * sp.tangent.w;
            n = (side * (tangent * tilt.x + bitangent * tilt.y + front * tilt.z))
                .try_normalize()
                .unwrap_or(n);
        }
        // Towards the viewer first: that never turns n away from ng, as the viewer is on ng's side.
        for guide in [sp.wo, sp.ng] {
            let cos = n.dot(guide);
            if cos < MIN_NORMAL_COS {
                n = (n + guide * (2.0 * MIN_NORMAL_COS - cos)).normalize_or(sp.ng);
            }
        }
        let anisotropic =
            self.native.is_some_and(|b| b.is_anisotropic()) && sp.tangent.truncate() != Vec3::ZERO;
        if anisotropic {
            sp.frame = Frame::from_normal_tangent(n, sp.tangent.truncate());
        } else if n != sp.frame.n {
            sp.frame = Frame::from_normal(n);
        }
    }
}
