//! Texels: their places, wraps, colour spaces and transforms.

use lumicache::math::{Vec2, Vec4};
use lumicache::texture::*;
use std::sync::Arc;

/// 2 x 2 texels: red ramp 0, 1 / 2, 3 in steps of 51/255.
fn ramp(wrap: Wrap, nearest: bool) -> Texture {
    let pixels = TexturePixels::Rgba8((0..4).map(|i| [51 * i, 255, 0, 128]).collect());
    Texture {
        image: Arc::new(TextureImage { width: 2, height: 2, pixels }),
        wrap_s: wrap,
        wrap_t: wrap,
        nearest,
    }
}

fn red(t: &Texture, u: f32, v: f32) -> f32 {
    t.sample(Vec2::new(u, v), ColorSpace::Linear).x * 5.0
}

#[test]
fn texel_centres_and_the_row_order_are_gltf_s() {
    for nearest in [false, true] {
        let t = ramp(Wrap::Repeat, nearest);
        for (i, (u, v)) in
            [(0.25, 0.25), (0.75, 0.25), (0.25, 0.75), (0.75, 0.75)].into_iter().enumerate()
        {
            assert!((red(&t, u, v) - i as f32).abs() < 1e-5);
        }
    }
    assert!((red(&ramp(Wrap::Clamp, false), 0.5, 0.25) - 0.5).abs() < 1e-5);
    assert!((red(&ramp(Wrap::Clamp, false), 0.5, 0.5) - 1.5).abs() < 1e-5);
}

#[test]
fn wraps_outside_the_unit_square() {
    let expect = |wrap, u, v, value: f32| {
        for nearest in [false, true] {
            let got = red(&ramp(wrap, nearest), u, v);
            assert!(
                (got - value).abs() < 1e-4,
                "{wrap:?} nearest {nearest} at ({u}, {v}): {got}, not {value}"
            );
        }
    };
    expect(Wrap::Repeat, 1.25, 0.25, 0.0);
    expect(Wrap::Repeat, -0.25, -0.75, 1.0);
    expect(Wrap::Mirror, 1.25, 0.25, 1.0);
    expect(Wrap::Mirror, -0.25, 0.25, 0.0);
    expect(Wrap::Mirror, 0.25, 1.75, 0.0);
    expect(Wrap::Mirror, -1.25, 2.25, 1.0);
    expect(Wrap::Clamp, 7.0, -3.0, 1.0);
    expect(Wrap::Clamp, -7.0, 3.0, 2.0);
    // Interpolation across the seam.
    assert!((red(&ramp(Wrap::Repeat, false), 1.0, 0.25) - 0.5).abs() < 1e-5);
    assert!((red(&ramp(Wrap::Mirror, false), 1.0, 0.25) - 1.0).abs() < 1e-5);
    assert!((red(&ramp(Wrap::Mirror, false), 2.0, 0.25) - 0.0).abs() < 1e-5);
}

#[test]
fn every_coordinate_gives_a_texel() {
    for wrap in [Wrap::Repeat, Wrap::Mirror, Wrap::Clamp] {
        for nearest in [false, true] {
            for u in [
                f32::NAN,
                f32::INFINITY,
                f32::NEG_INFINITY,
                1e30,
                -1e30,
                -1e-9,
                1.0,
                2.0,
                -2.0,
                0.999_999_94,
                16_777_217.0,
            ] {
                assert!(
                    ramp(wrap, nearest).sample(Vec2::new(u, 0.5), ColorSpace::Srgb).is_finite()
                );
                assert!(
                    ramp(wrap, nearest).sample(Vec2::new(0.5, u), ColorSpace::Srgb).is_finite()
                );
            }
        }
    }
}

#[test]
fn srgb_is_decoded_before_filtering_and_alpha_is_not() {
    let t = ramp(Wrap::Clamp, false);
    let v = t.sample(Vec2::new(0.5, 0.25), ColorSpace::Srgb);
    assert!((v.x - 0.5 * 0.033_104_77).abs() < 1e-6);
    assert!((v.y - 1.0).abs() < 1e-6 && (v.w - 128.0 / 255.0).abs() < 1e-6);
    let wide = Texture {
        image: Arc::new(TextureImage {
            width: 1,
            height: 1,
            pixels: TexturePixels::Rgba16(vec![[188 * 257, 65535, 0, 32768]]),
        }),
        ..t
    };
    let v = wide.sample(Vec2::ZERO, ColorSpace::Srgb);
    // sRGB 188 is linear 0.50288653.
    assert!(
        (v.x - 0.502_886_5).abs() < 1e-6 && v.y == 1.0 && (v.w - 32768.0 / 65535.0).abs() < 1e-6
    );
}

#[test]
fn the_specification_s_transform_example_reads_the_lower_left_quadrant() {
    let r = TextureRef {
        texture: 0,
        uv_set: 1,
        offset: Vec2::new(0.0, 1.0),
        rotation: std::f32::consts::FRAC_PI_2,
        scale: Vec2::splat(0.5),
        color_space: ColorSpace::Linear,
    };
    for (uv, expected) in [
        ((0.0, 0.0), (0.0, 1.0)),
        ((1.0, 0.0), (0.0, 0.5)),
        ((0.0, 1.0), (0.5, 1.0)),
        ((1.0, 1.0), (0.5, 0.5)),
    ] {
        let got = r.apply(&[Vec2::splat(9.0), uv.into()]);
        assert!((got - Vec2::from(expected)).length() < 1e-6, "{uv:?} -> {got}");
    }
    assert_eq!(lookup(&[], &r, &[Vec2::ZERO; 2]), Vec4::ONE);
}
