//! Versions, handles, views, and the safe way to read and write structs of the host.

use crate::capi::status::{Fault, LUMI_ERROR_UNSUPPORTED, LUMI_ERROR_VERSION, Outcome, ensure};
use std::ffi::{CStr, c_char, c_void};
use std::path::Path;

/// The version of this header: major << 16 | minor. A minor version only adds functions, or fields
/// at the end of structs.
pub const LUMI_ABI_VERSION: u32 = 0x0001_0000;

/// A library in use: its threads, its ray tracer and its log.
pub struct lumi_device_s;
/// See lumi_device_new.
pub type lumi_device = *mut lumi_device_s;
/// Geometry, materials and lights, or a host that has them.
pub struct lumi_scene_s;
/// See lumi_scene_new.
pub type lumi_scene = *mut lumi_scene_s;
/// Records of indirect light in one scene.
pub struct lumi_cache_s;
/// See lumi_cache_new.
pub type lumi_cache = *mut lumi_cache_s;

/// Format of a view: two floats per element.
pub const LUMI_FORMAT_F32X2: u32 = 2;
/// Format of a view: three floats per element.
pub const LUMI_FORMAT_F32X3: u32 = 3;
/// Format of a view: four floats per element.
pub const LUMI_FORMAT_F32X4: u32 = 4;
/// Format of a view: one unsigned integer per element.
pub const LUMI_FORMAT_U32: u32 = 17;
/// Format of a view: three unsigned integers per element.
pub const LUMI_FORMAT_U32X3: u32 = 19;

/// Flag of a view of a mesh: the buffer stays alive and unchanged until the scene and all its
/// caches are released. lumi_scene_commit reads the buffer. Positions and indices of meshes with
/// one material stay in the buffer if they are dense and aligned; other arrays are copied. Without
/// the flag, everything is copied at once.
pub const LUMI_VIEW_SHARED: u32 = 1;

/// An array in the host's memory. All zero: there is no array.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct lumi_view {
    /// First element.
    pub data: *const c_void,
    /// Number of elements.
    pub count: usize,
    /// Bytes from one element to the next; 0: the elements lie side by side.
    pub stride: usize,
    /// LUMI_FORMAT_*.
    pub format: u32,
    /// LUMI_VIEW_*.
    pub flags: u32,
}

/// Largest struct_size that is believed.
const MAX_STRUCT: usize = 4096;

/// A struct that begins with its own size.
///
/// # Safety
/// The type is `repr(C)`, begins with a `u32`, and all zero bytes are a value of it.
pub(in crate::capi) unsafe trait Versioned: Copy {}

macro_rules! versioned {
    ($($name:ident),*) => {
        $(
            // SAFETY: see the type's definition above: numbers, pointers and optional functions, of
            // which zero is a value.
            unsafe impl Versioned for $name {}
        )*
    };
}
pub(super) use versioned;

/// The size that the caller's struct has.
fn size_at<T: Versioned>(at: *const T, what: &str) -> Outcome<usize> {
    ensure!(!at.is_null(), "{what} is NULL");
    // SAFETY: the caller passes a struct that begins with its size; reading it does not ask for
    // alignment.
    let size = unsafe { at.cast::<u32>().read_unaligned() } as usize;
    if size < size_of::<T>() {
        let first = size_of::<T>();
        let text = format!("{what}: struct_size is {size}, the first version has {first} bytes");
        return Err(Fault::new(LUMI_ERROR_VERSION, text));
    }
    ensure!(size <= MAX_STRUCT, "{what}: struct_size is {size}, which no version has");
    Ok(size)
}

/// The caller's struct. A longer one of a later version is taken if its extra bytes are zero.
pub(in crate::capi) fn read<T: Versioned>(at: *const T, what: &str) -> Outcome<T> {
    let size = size_at(at, what)?;
    // SAFETY: the struct has at least `size` bytes, as the caller says in its first field.
    let bytes = unsafe { std::slice::from_raw_parts(at.cast::<u8>(), size) };
    if bytes[size_of::<T>()..].iter().any(|b| *b != 0) {
        let text =
            format!("{what}: a field is set that version {LUMI_ABI_VERSION:#x} does not know");
        return Err(Fault::new(LUMI_ERROR_UNSUPPORTED, text));
    }
    // SAFETY: the bytes are those of a T, alignment aside.
    Ok(unsafe { at.read_unaligned() })
}

/// Writes to the caller's struct, which is at least as long; its size stays.
pub(in crate::capi) fn write<T: Versioned>(to: *mut T, value: T, what: &str) -> Outcome {
    let size = size_at(to, what)? as u32;
    // SAFETY: the struct has at least the size of a T, as the caller says in its first field.
    unsafe {
        to.write_unaligned(value);
        to.cast::<u32>().write_unaligned(size);
    }
    Ok(())
}

/// Refuses `flags` that are not `known`.
pub(in crate::capi) fn only(known: u32, flags: u32, what: &str) -> Outcome {
    let unknown = flags & !known;
    ensure!(unknown == 0, "{what}: unknown flags {unknown:#x}");
    Ok(())
}

/// The text at `at`.
pub(in crate::capi) fn text<'a>(at: *const c_char, what: &str) -> Outcome<&'a str> {
    ensure!(!at.is_null(), "{what} is NULL");
    // SAFETY: the host passes a string that ends in NUL and stays unchanged during the call, beyond
    // which it is not kept.
    unsafe { CStr::from_ptr(at) }
        .to_str()
        .map_err(|_| Fault::argument(format!("{what} is not UTF-8")))
}

/// The path at `at`.
pub(in crate::capi) fn path<'a>(at: *const c_char) -> Outcome<&'a Path> {
    let text = text(at, "path")?;
    ensure!(!text.is_empty(), "the path is empty");
    Ok(Path::new(text))
}

/// Writes `text` to `to`, which is zero; the rest is cut off. The caller keeps back a byte for NUL.
pub(in crate::capi) fn copy_text(text: &str, to: &mut [c_char]) {
    for (to, from) in to.iter_mut().zip(text.bytes()) {
        *to = from as c_char;
    }
}
