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
