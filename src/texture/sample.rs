//! Reading a texture at a point: transform, wrap, decode, interpolate.

use super::{ColorSpace, Texture, TexturePixels, TextureRef, Wrap};
use crate::math::{Vec2, Vec4};
use std::sync::LazyLock;

/// The linear value of each 8-bit sRGB code.
static SRGB8: LazyLock<[f32; 256]> =
    LazyLock::new(|| std::array::from_fn(|i| srgb_to_linear(i as f32 / 255.0)));

/// The sRGB transfer function, code value in [0, 1] to linear [IEC61966].
fn srgb_to_linear(v: f32) -> f32 {
    if v <= 0.04045 { v / 12.92 } else { ((v + 0.055) / 1.055).powf(2.4) }
}

impl Texture {
    /// The linear RGBA value at texture coordinates `uv`.
    ///
    /// glTF's convention: (0, 0) is the upper left corner of the image, v points down, and the
    /// centre of texel `(i, j)` is at `((i + ½)/width, (j + ½)/height)`. Texels are made linear
    /// before they are interpolated. Coordinates that are not finite count as 0.
    #[must_use]
    pub fn sample(&self, uv: Vec2, color_space: ColorSpace) -> Vec4 {
        let (width, height) = (self.image.width as i32, self.image.height as i32);
        let x = position(uv.x, width, self.wrap_s);
        let y = position(uv.y, height, self.wrap_t);
        if self.nearest {
            let (i, j) = (
                wrap(x.floor() as i32, width, self.wrap_s),
                wrap(y.floor() as i32, height, self.wrap_t),
            );
            return self.texel(i, j, color_space);
        }
        let (fx, fy) = ((x - 0.5).floor(), (y - 0.5).floor());
        let (wx, wy) = (x - 0.5 - fx, y - 0.5 - fy);
        let columns =
            [wrap(fx as i32, width, self.wrap_s), wrap(fx as i32 + 1, width, self.wrap_s)];
        let rows = [wrap(fy as i32, height, self.wrap_t), wrap(fy as i32 + 1, height, self.wrap_t)];
        let row = |j| {
            self.texel(columns[0], j, color_space) * (1.0 - wx)
                + self.texel(columns[1], j, color_space) * wx
        };
        row(rows[0]) * (1.0 - wy) + row(rows[1]) * wy
    }

    /// The linear value of one texel, indices inside the image.
    #[inline]
    fn texel(&self, i: usize, j: usize, color_space: ColorSpace) -> Vec4 {
        let index = j * self.image.width as usize + i;
        match (&self.image.pixels, color_space) {
            (TexturePixels::Rgba8(p), ColorSpace::Srgb) => {
                let [r, g, b, a] = p[index];
                let table = &*SRGB8;
                Vec4::new(
                    table[r as usize],
                    table[g as usize],
                    table[b as usize],
                    f32::from(a) * (1.0 / 255.0),
                )
            }
            (TexturePixels::Rgba8(p), ColorSpace::Linear) => {
                Vec4::from_array(p[index].map(f32::from)) * (1.0 / 255.0)
            }
            (TexturePixels::Rgba16(p), space) => {
                let v = Vec4::from_array(p[index].map(f32::from)) * (1.0 / 65535.0);
                match space {
                    ColorSpace::Srgb => Vec4::new(
                        srgb_to_linear(v.x),
                        srgb_to_linear(v.y),
                        srgb_to_linear(v.z),
                        v.w,
                    ),
                    ColorSpace::Linear => v,
                }
            }
        }
    }
}

/// The place of coordinate `t` in texels, within one period of the texture's repetition so that no
/// index overflows.
#[inline]
fn position(t: f32, size: i32, mode: Wrap) -> f32 {
    let t = if t.is_finite() { t } else { 0.0 };
    let t = match mode {
        Wrap::Repeat => t - t.floor(),
        Wrap::Mirror => t - 2.0 * (0.5 * t).floor(),
        Wrap::Clamp => t.clamp(0.0, 1.0),
    };
    t * size as f32
}

/// The texel that index `i` of the endless plane shows. `i` is at most one texel outside the period
/// that [`position`] returns.
#[inline]
fn wrap(i: i32, size: i32, mode: Wrap) -> usize {
    let i = match mode {
        Wrap::Repeat if i < 0 => i + size,
        Wrap::Repeat if i >= size => i - size,
        Wrap::Mirror if i < 0 => -1 - i,
        Wrap::Mirror if i >= 2 * size => i - 2 * size,
        Wrap::Mirror if i >= size => 2 * size - 1 - i,
        _ => i,
    };
    i.clamp(0, size - 1) as usize
}

impl TextureRef {
    /// The coordinates at which the texture is read: those of the named set, through
    /// KHR_texture_transform.
    ///
    /// ```text
    /// u' = offset_u + cos r · s_u u + sin r · s_v v
    /// v' = offset_v - sin r · s_u u + cos r · s_v v
    /// ```
    ///
    /// With v pointing down this turns the coordinates counter-clockwise, as the extension's text
    /// and its example (a quadrant at the lower left with offset (0, 1) and a quarter turn)
    /// demand; the GLSL matrix printed there turns them the other way.
    #[inline]
    #[must_use]
    pub fn apply(&self, uv: &[Vec2; 2]) -> Vec2 {
        let p = self.scale * uv[usize::from(self.uv_set & 1)];
        if self.rotation == 0.0 {
            return self.offset + p;
        }
        let (sin, cos) = self.rotation.sin_cos();
        self.offset + Vec2::new(cos * p.x + sin * p.y, cos * p.y - sin * p.x)
    }
}

/// The linear RGBA value of a texture reference at a point with the coordinate sets `uv`; white if
/// the scene has no such texture.
#[inline]
#[must_use]
pub fn lookup(textures: &[Texture], reference: &TextureRef, uv: &[Vec2; 2]) -> Vec4 {
    match textures.get(reference.texture as usize) {
        Some(texture) => texture.sample(reference.apply(uv), reference.color_space),
        None => Vec4::ONE,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::texture::TextureImage;
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
        assert!((v.x - 0.5 * srgb_to_linear(0.2)).abs() < 1e-6);
        assert!((v.y - 1.0).abs() < 1e-6 && (v.w - 128.0 / 255.0).abs() < 1e-6);
        // Published pair: sRGB 188 is linear 0.5029.
        assert!((SRGB8[188] - 0.5029).abs() < 1e-4);
        let wide = Texture {
            image: Arc::new(TextureImage {
                width: 1,
                height: 1,
                pixels: TexturePixels::Rgba16(vec![[188 * 257, 65535, 0, 32768]]),
            }),
            ..t
        };
        let v = wide.sample(Vec2::ZERO, ColorSpace::Srgb);
        assert!(
            (v.x - SRGB8[188]).abs() < 1e-6 && v.y == 1.0 && (v.w - 32768.0 / 65535.0).abs() < 1e-6
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
}
