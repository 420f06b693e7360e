//! What material and textures make of a surface point.

use lumicache::geometry::SurfacePoint;
use lumicache::material::*;
use lumicache::math::{Color, Frame, Vec2, Vec3, Vec4};
use lumicache::texture::{ColorSpace, Texture, TextureImage, TexturePixels, TextureRef, Wrap};
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
        error: 0.0,
        footprint: 0.0,
    }
}

/// A texture of one colour and a reference to it.
fn solid(rgba: [u8; 4]) -> (Vec<Texture>, Option<TextureRef>) {
    let image =
        Arc::new(TextureImage { width: 1, height: 1, pixels: TexturePixels::Rgba8(vec![rgba]) });
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
    let ward =
        |alpha_y| NativeBrdf::WardDuer { kd: Color::ZERO, ks: Color::ONE, alpha_x: 0.1, alpha_y };
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
        !b.has_glossy() && (b.diffuse_albedo(Vec3::Z) - Color::new(0.1, 0.2, 1.0)).length() < 1e-6
    );
    let m = Material { metallic_roughness_texture: reference, ..Material::default() };
    let b = m.shade(&textures, &mut point());
    assert!(!b.has_diffuse() && (b.roughness() - 0.16).abs() < 1e-6);
}
