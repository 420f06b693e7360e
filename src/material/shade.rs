//! From a material and a point on a surface to what the integrators need: opacity, emission, BSDF.

use super::bsdf::Bsdf;
use super::description::{AlphaMode, Material};
use super::layered::Layered;
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
        let alpha =
            || self.base_alpha * sp.color.w * texture(textures, &self.base_color_texture, &sp.uv).w;
        match self.alpha_mode {
            AlphaMode::Opaque => 1.0,
            AlphaMode::Mask(cutoff) => f32::from(alpha() >= cutoff),
            AlphaMode::Blend => alpha().clamp(0.0, 1.0),
        }
    }

    /// True if [`Material::opacity`] is 1 everywhere.
    #[inline]
    pub fn is_opaque(&self) -> bool {
        self.alpha_mode == AlphaMode::Opaque
    }

    /// True if the surface lights others. An unlit material shows a colour but lights nothing.
    #[inline]
    pub fn is_emissive(&self) -> bool {
        !self.unlit && self.emission.max_element() > 0.0
    }

    /// Radiance emitted towards `sp.wo`, W m⁻² sr⁻¹; zero on back faces unless the material is
    /// double sided.
    ///
    /// An unlit material returns its base colour on both faces. That is for rays from the camera:
    /// it must not light other surfaces.
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

    /// Reads all textures at the point and returns its BSDF in the frame `sp.frame`, which this
    /// call may change: normal maps tilt it, anisotropic BRDFs take the mesh's tangent, and a
    /// normal that points away from the viewer or through the geometric surface is bent back,
    /// so that afterwards `frame.n · ng > 0` and `frame.n · wo > 0`.
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

    /// Turns the shading frame: normal map, anisotropy, and the guarantee that viewer and geometric
    /// normal are above it.
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::material::NativeBrdf;
    use crate::texture::{ColorSpace, TextureImage, TexturePixels, Wrap};
    use std::sync::Arc;

    fn point() -> SurfacePoint {
        SurfacePoint {
            position: Vec3::ZERO,
            ng: Vec3::Z,
            frame: Frame::from_normal(Vec3::Z),
            tangent: Vec4::new(1.0, 0.0, 0.0, 1.0),
            uv: [Vec2::splat(0.5); 2],
            color: Vec4::ONE,
            material: 0,
            instance: 0,
            triangle: 0,
            back_face: false,
            wo: Vec3::new(0.6, 0.0, 0.8),
            footprint: 0.0,
        }
    }

    /// A texture of one colour and a reference to it.
    fn solid(rgba: [u8; 4]) -> (Vec<Texture>, Option<TextureRef>) {
        let image = Arc::new(TextureImage {
            width: 1,
            height: 1,
            pixels: TexturePixels::Rgba8(vec![rgba]),
        });
        let texture = Texture { image, wrap_s: Wrap::Repeat, wrap_t: Wrap::Repeat, nearest: false };
        let reference = TextureRef {
            texture: 0,
            uv_set: 0,
            offset: Vec2::ZERO,
            rotation: 0.0,
            scale: Vec2::ONE,
            color_space: ColorSpace::Linear,
        };
        (vec![texture], Some(reference))
    }

    fn assert_near(a: Vec3, b: Vec3) {
        assert!((a - b).length() < 1e-2, "{a} {b}");
    }

    #[test]
    fn normal_maps_tilt_towards_their_tangents_on_both_faces() {
        // +x by about 45 degrees, +y none.
        let (textures, map) = solid([218, 128, 218, 255]);
        let material = Material { normal_texture: map, ..Material::default() };
        let tilted = |mut sp: SurfacePoint| {
            let _ = material.shade(&textures, &mut sp);
            assert!(sp.frame.n.dot(sp.ng) > 0.0 && sp.frame.n.dot(sp.wo) > 0.0);
            assert!((sp.frame.s.cross(sp.frame.t) - sp.frame.n).length() < 1e-5);
            sp.frame.n
        };
        let r = std::f32::consts::FRAC_1_SQRT_2;
        assert_near(tilted(point()), Vec3::new(r, 0.0, r));
        // From behind, the front's normal (r, 0, -r) with the viewer above: the map's normal of the
        // front, turned around.
        assert_near(tilted(SurfacePoint { back_face: true, ..point() }), Vec3::new(-r, 0.0, r));
        // Tangent along y, mirrored bitangent: the map's x follows the tangent.
        assert_near(
            tilted(SurfacePoint { tangent: Vec4::new(0.0, 1.0, 0.0, -1.0), ..point() }),
            Vec3::new(0.0, r, r),
        );
        assert_eq!(tilted(SurfacePoint { tangent: Vec4::ZERO, ..point() }), Vec3::Z);
        let (textures, map) = solid([128, 218, 218, 255]);
        let up = Material { normal_texture: map, normal_scale: 0.0, ..Material::default() };
        let mut sp = point();
        let _ = up.shade(&textures, &mut sp);
        assert_near(sp.frame.n, Vec3::Z);
        let bitangent = |w: f32| {
            let mut sp = SurfacePoint { tangent: Vec4::new(1.0, 0.0, 0.0, w), ..point() };
            let _ = Material { normal_scale: 1.0, ..up.clone() }.shade(&textures, &mut sp);
            sp.frame.n
        };
        assert_near(bitangent(1.0), Vec3::new(0.0, r, r));
        assert_near(bitangent(-1.0), Vec3::new(0.0, -r, r));
    }

    #[test]
    fn normals_are_bent_to_the_viewer_and_the_surface() {
        let z = 0.05f32;
        for n in [
            Vec3::new(-1.0, 0.0, 0.01),
            Vec3::new(-0.9, 0.1, 0.2),
            Vec3::new(0.9, 0.0, -0.4),
            Vec3::NEG_Z,
            Vec3::NEG_X,
        ] {
            let n = n.normalize();
            let wo = Vec3::new((1.0 - z * z).sqrt(), 0.0, z);
            let mut sp = SurfacePoint { frame: Frame::from_normal(n), wo, ..point() };
            let _ = Material::default().shade(&[], &mut sp);
            assert!(
                sp.frame.n.dot(Vec3::Z) > 5e-4 && sp.frame.n.dot(wo) > 5e-4,
                "{n} -> {}",
                sp.frame.n
            );
            assert!((sp.frame.n.length() - 1.0).abs() < 1e-5);
        }
        let mut sp = point();
        let before = sp.frame;
        let _ = Material::default().shade(&[], &mut sp);
        assert_eq!(sp.frame, before, "a good frame is left alone");
    }

    #[test]
    fn anisotropic_brdfs_take_the_mesh_s_tangent() {
        let ward = |alpha_y| NativeBrdf::WardDuer {
            kd: Color::ZERO,
            ks: Color::ONE,
            alpha_x: 0.1,
            alpha_y,
        };
        let tangent = Vec4::new(0.6, 0.8, 0.0, 1.0);
        let mut sp = SurfacePoint { tangent, ..point() };
        let _ = Material { native: Some(ward(0.4)), ..Material::default() }.shade(&[], &mut sp);
        assert!((sp.frame.s - tangent.truncate()).length() < 1e-6);
        let mut sp = SurfacePoint { tangent, ..point() };
        let _ = Material { native: Some(ward(0.1)), ..Material::default() }.shade(&[], &mut sp);
        assert_eq!(sp.frame, point().frame);
    }

    #[test]
    fn alpha_masks_and_blends() {
        let (textures, base_color_texture) = solid([255, 255, 255, 102]);
        let m = Material { base_color_texture, base_alpha: 0.5, ..Material::default() };
        let opacity = |mode, w| {
            let sp = SurfacePoint { color: Vec4::new(1.0, 1.0, 1.0, w), ..point() };
            Material { alpha_mode: mode, ..m.clone() }.opacity(&textures, &sp)
        };
        assert_eq!(opacity(AlphaMode::Opaque, 1.0), 1.0);
        assert!((opacity(AlphaMode::Blend, 1.0) - 0.2).abs() < 1e-6);
        assert!((opacity(AlphaMode::Blend, 0.5) - 0.1).abs() < 1e-6);
        assert_eq!(
            (opacity(AlphaMode::Mask(0.19), 1.0), opacity(AlphaMode::Mask(0.21), 1.0)),
            (1.0, 0.0)
        );
        assert!(m.is_opaque() && !Material { alpha_mode: AlphaMode::Blend, ..m }.is_opaque());
    }

    #[test]
    fn emission_leaves_the_faces_it_should() {
        let (textures, emission_texture) = solid([51, 255, 0, 255]);
        let m = Material { emission: Color::splat(10.0), emission_texture, ..Material::default() };
        let back = SurfacePoint { back_face: true, ..point() };
        assert!((m.emission_at(&textures, &point()) - Color::new(2.0, 10.0, 0.0)).length() < 1e-5);
        assert_eq!(m.emission_at(&textures, &back), Color::ZERO);
        let both = Material { double_sided: true, ..m.clone() };
        assert_eq!(both.emission_at(&textures, &back), m.emission_at(&textures, &point()));
        assert!(m.is_emissive() && !Material::default().is_emissive());
        let unlit = Material { unlit: true, base_color: Color::new(0.1, 0.2, 0.3), ..m };
        assert_eq!(unlit.emission_at(&textures, &point()), unlit.base_color);
        assert!(!unlit.is_emissive());
        assert_eq!(unlit.shade(&textures, &mut point()), Bsdf::BLACK);
    }

    #[test]
    fn attenuation_gives_its_colour_at_its_distance() {
        let attenuation_color = Color::new(0.5, 1.0, 0.0);
        let m = Material {
            thin: false,
            transmission: 1.0,
            attenuation_color,
            attenuation_distance: 2.0,
            ..Material::default()
        };
        let s = m.attenuation();
        assert!(
            ((-2.0 * s.x).exp() - 0.5).abs() < 1e-6
                && s.y == 0.0
                && s.z.is_finite()
                && (-2.0 * s.z).exp() < 1e-5
        );
        for other in [
            Material { thin: true, ..m.clone() },
            Material { transmission: 0.0, ..m.clone() },
            Material { attenuation_distance: f32::INFINITY, ..m.clone() },
            Material { attenuation_distance: 0.0, ..m },
        ] {
            assert_eq!(other.attenuation(), Color::ZERO);
        }
    }

    #[test]
    fn textures_and_vertex_colours_reach_the_layers() {
        // Specular strength is in A, roughness in G, metallic in B.
        let (textures, reference) = solid([51, 102, 255, 0]);
        let m = Material {
            base_color: Color::new(0.5, 1.0, 1.0),
            base_color_texture: reference,
            specular_texture: reference,
            metallic: 0.0,
            ..Material::default()
        };
        let sp = SurfacePoint { color: Vec4::new(1.0, 0.5, 1.0, 1.0), ..point() };
        let b = m.shade(&textures, &mut sp.clone());
        assert!(
            !b.has_glossy()
                && (b.diffuse_albedo(Vec3::Z) - Color::new(0.1, 0.2, 1.0)).length() < 1e-6
        );
        let m = Material { metallic_roughness_texture: reference, ..Material::default() };
        let b = m.shade(&textures, &mut point());
        assert!(!b.has_diffuse() && (b.roughness() - 0.16).abs() < 1e-6);
    }
}
