//! What is written: channels over a window of pixels.

use super::raw;
use half::f16;

/// The samples of one channel, row by row from the top.
#[derive(Clone, Copy, Debug)]
pub enum Samples<'a> {
    /// 16-bit floating point.
    Half(&'a [f16]),
    /// 32-bit floating point.
    Float(&'a [f32]),
    /// 32-bit unsigned integers.
    Uint(&'a [u32]),
}

impl Samples<'_> {
    pub(super) fn len(&self) -> usize {
        match self {
            Self::Half(s) => s.len(),
            Self::Float(s) => s.len(),
            Self::Uint(s) => s.len(),
        }
    }

    pub(super) fn bytes_per_sample(&self) -> usize {
        if matches!(self, Self::Half(_)) { 2 } else { 4 }
    }

    pub(super) fn pixel_type(&self) -> raw::exr_pixel_type_t {
        match self {
            Self::Half(_) => raw::EXR_PIXEL_HALF,
            Self::Float(_) => raw::EXR_PIXEL_FLOAT,
            Self::Uint(_) => raw::EXR_PIXEL_UINT,
        }
    }

    pub(super) fn bytes(&self) -> &[u8] {
        match self {
            Self::Half(s) => {
                bytemuck::cast_slice(half::slice::HalfFloatSliceExt::reinterpret_cast(*s))
            }
            Self::Float(s) => bytemuck::cast_slice(s),
            Self::Uint(s) => bytemuck::cast_slice(s),
        }
    }
}

/// A channel to write.
#[derive(Clone, Copy, Debug)]
pub struct Channel<'a> {
    /// The name in the file.
    pub name: &'a str,
    /// One sample per pixel of the data window.
    pub samples: Samples<'a>,
}

/// A rectangle of pixels, both corners included.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Window {
    /// Left column and top row.
    pub min: [i32; 2],
    /// Right column and bottom row.
    pub max: [i32; 2],
}

impl Window {
    /// Columns and rows.
    pub(super) fn size(&self) -> Option<[usize; 2]> {
        let extent = |a: i32, b: i32| {
            usize::try_from(i64::from(b) - i64::from(a) + 1).ok().filter(|&n| n > 0)
        };
        Some([extent(self.min[0], self.max[0])?, extent(self.min[1], self.max[1])?])
    }

    pub(super) fn to_raw(self) -> raw::exr_attr_box2i_t {
        let corner = |[x, y]: [i32; 2]| {
            // SAFETY: plain integers, for which all-zero bytes are a value.
            let mut v: raw::exr_attr_v2i_t = unsafe { std::mem::zeroed() };
            v.__bindgen_anon_1.arr = [x, y];
            v
        };
        raw::exr_attr_box2i_t { min: corner(self.min), max: corner(self.max) }
    }
}
