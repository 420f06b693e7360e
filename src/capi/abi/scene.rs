//! Structs and constants of scenes.

use super::common::{Versioned, lumi_view, versioned};
use std::ffi::{c_char, c_void};

/// Flag of a file: what breaks the glTF specification is an error, also where it could be mended.
pub const LUMI_LOAD_STRICT: u32 = 1;
/// Flag of a file: files outside its folder are read too, where the file names them.
pub const LUMI_LOAD_ALLOW_OUTSIDE: u32 = 2;

/// How a file is read.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct lumi_load_desc {
    /// sizeof(lumi_load_desc).
    pub struct_size: u32,
    /// LUMI_LOAD_*.
    pub flags: u32,
    /// Bytes that reading may take, beyond which it fails with LUMI_ERROR_OUT_OF_MEMORY; 0: 1 GiB
    /// and 64 times the size of the files.
    pub memory_limit: u64,
}

/// A triangle mesh. The front of a triangle is where its vertices run counter-clockwise.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct lumi_mesh_desc {
    /// sizeof(lumi_mesh_desc).
    pub struct_size: u32,
    /// Zero.
    pub flags: u32,
    /// LUMI_FORMAT_F32X3, required.
    pub positions: lumi_view,
    /// LUMI_FORMAT_U32X3, required.
    pub indices: lumi_view,
    /// LUMI_FORMAT_F32X3 per vertex; without normals the mesh is flat. The library normalises
    /// them.
    pub normals: lumi_view,
    /// LUMI_FORMAT_F32X2 per vertex: texture coordinates, (0, 0) at the first pixel of the first
    /// row.
    pub uv0: lumi_view,
    /// LUMI_FORMAT_F32X4 per vertex: linear RGBA, multiplied into the base colour.
    pub colors: lumi_view,
    /// LUMI_FORMAT_U32 per triangle: its material. Without the array, all triangles have
    /// `material`.
    pub triangle_materials: lumi_view,
    /// Material of all triangles.
    pub material: u32,
    /// Zero.
    pub reserved: u32,
}

/// Flag of a material: emits from both faces.
pub const LUMI_MATERIAL_DOUBLE_SIDED: u32 = 1;
/// Alpha mode of a material: alpha is ignored.
pub const LUMI_ALPHA_OPAQUE: u32 = 0;
/// Alpha mode of a material: the surface is where alpha is at least `alpha_cutoff`.
pub const LUMI_ALPHA_MASK: u32 = 1;
/// Alpha mode of a material: the surface stops the fraction alpha of the rays.
pub const LUMI_ALPHA_BLEND: u32 = 2;

/// A surface in the terms of glTF. Fill it by lumi_material_init, then change what differs.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct lumi_material_desc {
    /// sizeof(lumi_material_desc).
    pub struct_size: u32,
    /// LUMI_MATERIAL_*.
    pub flags: u32,
    /// Linear Rec. 709, 0 to 1.
    pub base_color: [f32; 3],
    /// 0 to 1.
    pub alpha: f32,
    /// LUMI_ALPHA_*.
    pub alpha_mode: u32,
    /// 0 to 1.
    pub alpha_cutoff: f32,
    /// 0 to 1.
    pub metallic: f32,
    /// Perceptual, 0 to 1.
    pub roughness: f32,
    /// Index of refraction, at least 1.
    pub ior: f32,
    /// Strength of the dielectric reflection, 0 to 1; 0 leaves a purely diffuse surface when
    /// metallic is 0.
    pub specular: f32,
    /// Fraction of the light entering the surface that is transmitted, 0 to 1; thin-walled.
    pub transmission: f32,
    /// Emitted radiance.
    pub emission: [f32; 3],
    /// Texture of base colour (sRGB) and alpha, -1 for none.
    pub base_color_texture: i32,
    /// Texture of roughness (G) and metallic (B), -1 for none.
    pub metallic_roughness_texture: i32,
    /// Texture of the emission (sRGB), -1 for none.
    pub emission_texture: i32,
    /// Tangent-space normal map, -1 for none. Needs uv0.
    pub normal_texture: i32,
}

/// Wrapping of a texture: it repeats.
pub const LUMI_WRAP_REPEAT: u32 = 0;
/// Wrapping of a texture: every second repetition is mirrored.
pub const LUMI_WRAP_MIRROR: u32 = 1;
/// Wrapping of a texture: the border continues.
pub const LUMI_WRAP_CLAMP: u32 = 2;

/// An image with 8-bit RGBA pixels. The material decides whether the pixels are sRGB or linear.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct lumi_texture_desc {
    /// sizeof(lumi_texture_desc).
    pub struct_size: u32,
    /// Columns.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// LUMI_WRAP_* of the horizontal coordinate.
    pub wrap_u: u32,
    /// LUMI_WRAP_* of the vertical coordinate.
    pub wrap_v: u32,
    /// 1: nearest pixel; 0: bilinear.
    pub nearest: u32,
    /// 4 * width * height bytes, row by row from the top; copied.
    pub pixels: *const u8,
}

/// Type of a light: radiates from a point.
pub const LUMI_LIGHT_POINT: u32 = 0;
/// Type of a light: a point within a cone.
pub const LUMI_LIGHT_SPOT: u32 = 1;
/// Type of a light: parallel.
pub const LUMI_LIGHT_DIRECTIONAL: u32 = 2;

/// A light without extent. A light with extent is a mesh whose material emits.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct lumi_light_desc {
    /// sizeof(lumi_light_desc).
    pub struct_size: u32,
    /// LUMI_LIGHT_*.
    pub kind: u32,
    /// World position; unused by directional lights.
    pub position: [f32; 3],
    /// Direction in which the light travels, any length but zero; unused by point lights.
    pub direction: [f32; 3],
    /// Radiant intensity; of a directional light, the irradiance across the light.
    pub intensity: [f32; 3],
    /// Distance at which the light is cut off; 0: none.
    pub range: f32,
    /// Cosine of the half angle at which a spot's fall-off begins.
    pub cos_inner: f32,
    /// Cosine of the half angle at which the fall-off ends.
    pub cos_outer: f32,
}

/// Flag of a host: the callback may run on any thread, and on several at once. Without the flag,
/// the callback runs only on the thread that called the library.
pub const LUMI_HOST_CONCURRENT: u32 = 1;
/// Flag of a host: `radiance` has light of all bounces, so the library follows no path further.
pub const LUMI_HOST_FULL: u32 = 2;
/// Flag of a host: rays that miss bring `radiance`, from an environment that the host leaves out of
/// its own direct light. Without the flag, they bring nothing.
pub const LUMI_HOST_ENV_IN_MISS: u32 = 4;

/// Rays that the host traces and shades. The library sets the pointers and `n`; the host fills the
/// four arrays that are not const, changes nothing else, and keeps no pointer.
#[repr(C)]
pub struct lumi_ray_batch {
    /// sizeof(lumi_ray_batch).
    pub struct_size: u32,
    /// Number of rays.
    pub n: u32,
    /// 3 n floats: where the rays start.
    pub origin: *const f32,
    /// 3 n floats: unit directions.
    pub dir: *const f32,
    /// n numbers: surfaces that the path has met before this ray, the camera's counted.
    pub bounce: *const u32,
    /// n seeds for the host's random choices. Caches are reproducible if the answers depend on
    /// nothing but rays and seeds.
    pub seed: *const u32,
    /// 3 n floats, zero at first: direct light that the surface at the hit reflects against the
    /// ray; with LUMI_HOST_FULL, all light. Light that the surface emits is left out.
    pub radiance: *mut f32,
    /// n floats, INFINITY at first: distance of the hit.
    pub distance: *mut f32,
    /// 3 n floats, zero at first: unit shading normal at the hit, on either side. Required without
    /// LUMI_HOST_FULL; with it, better gradients.
    pub normal: *mut f32,
    /// 3 n floats, zero at first: albedo of the diffuse lobe at the hit, 0 to 1. Unused with
    /// LUMI_HOST_FULL.
    pub albedo: *mut f32,
}

/// The host's tracer and shader. 0: go on; anything else ends the call of the library with
/// LUMI_ERROR_HOST_CALLBACK. The library holds no lock meanwhile. The callback may look up caches.
/// It must not build, fill, load, commit or release the cache or scene that the library works on.
pub type lumi_trace_fn =
    Option<unsafe extern "C" fn(user: *mut c_void, batch: *mut lumi_ray_batch) -> i32>;

/// A host that keeps geometry and shading to itself.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct lumi_host_desc {
    /// sizeof(lumi_host_desc).
    pub struct_size: u32,
    /// LUMI_HOST_*.
    pub flags: u32,
    /// Rays that a call should have; 0: 65536. A call has fewer when there are no more.
    pub preferred_batch: u32,
    /// Most rays of a call; 0: no bound.
    pub max_batch: u32,
    /// Lowest corner of the scene.
    pub bounds_min: [f32; 3],
    /// Highest corner of the scene.
    pub bounds_max: [f32; 3],
    /// A hash that changes when the light in the scene does. Caches are saved with it.
    pub scene_hash: u64,
    /// The tracer.
    pub trace: lumi_trace_fn,
    /// Passed to the tracer.
    pub user: *mut c_void,
}

/// Facts about a committed scene.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct lumi_scene_info {
    /// sizeof(lumi_scene_info); set it before the call.
    pub struct_size: u32,
    /// Zero.
    pub reserved: u32,
    /// Lowest corner of the scene.
    pub bounds_min: [f32; 3],
    /// Highest corner of the scene.
    pub bounds_max: [f32; 3],
    /// Triangles, counted once for each instance.
    pub triangles: u64,
    /// Cameras of the file.
    pub cameras: u64,
    /// Hash of geometry, materials and lights, hexadecimal, ends in NUL.
    pub hash: [c_char; 72],
    /// Name and version of the ray tracer, ends in NUL.
    pub backend: [c_char; 64],
}

/// Rays into a scene of our own, and what they hit.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct lumi_trace_desc {
    /// sizeof(lumi_trace_desc).
    pub struct_size: u32,
    /// Zero.
    pub flags: u32,
    /// Number of rays.
    pub n: usize,
    /// 3 n floats.
    pub origin: *const f32,
    /// 3 n floats, any length but zero.
    pub dir: *const f32,
    /// n floats: distance of the first hit in lengths of `dir`, INFINITY for a miss. This array
    /// and those below may be NULL.
    pub distance: *mut f32,
    /// 3 n floats: position of the hit.
    pub position: *mut f32,
    /// 3 n floats: unit shading normal against the ray.
    pub normal: *mut f32,
    /// 3 n floats: unit geometric normal against the ray.
    pub geo_normal: *mut f32,
    /// 3 n floats: albedo of the diffuse lobe.
    pub albedo: *mut f32,
}

versioned!(
    lumi_load_desc,
    lumi_mesh_desc,
    lumi_material_desc,
    lumi_texture_desc,
    lumi_light_desc,
    lumi_host_desc,
    lumi_scene_info,
    lumi_trace_desc
);
