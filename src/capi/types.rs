//! The structs and constants of the header, and the safe way to read the former.

use super::status::{Fault, LUMI_ERROR_UNSUPPORTED, LUMI_ERROR_VERSION, Outcome};
use std::ffi::{c_char, c_void};

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

/// Flag of a view of a mesh: the buffer stays alive and unchanged until the scene and all caches of
/// it are released. lumi_scene_commit reads it; dense and aligned positions and indices of meshes
/// with one material are not copied, other arrays are. Without the flag everything is copied at
/// once.
pub const LUMI_VIEW_SHARED: u32 = 1;

/// An array in the host's memory. All zero: not there.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct lumi_view {
    /// First element.
    pub data: *const c_void,
    /// Number of elements.
    pub count: usize,
    /// Bytes from one element to the next; 0: they lie side by side.
    pub stride: usize,
    /// LUMI_FORMAT_*.
    pub format: u32,
    /// LUMI_VIEW_*.
    pub flags: u32,
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
    /// LUMI_FORMAT_F32X3 per vertex; without them the mesh is flat. They are normalised.
    pub normals: lumi_view,
    /// LUMI_FORMAT_F32X2 per vertex: texture coordinates, (0, 0) at the first pixel of the first
    /// row.
    pub uv0: lumi_view,
    /// LUMI_FORMAT_F32X4 per vertex: linear RGBA, multiplied into the base colour.
    pub colors: lumi_view,
    /// LUMI_FORMAT_U32 per triangle: its material. Without it all have `material`.
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
/// Alpha mode of a material: the surface stops a share alpha of the rays.
pub const LUMI_ALPHA_BLEND: u32 = 2;

/// A surface in the terms of glTF: fill it by lumi_material_init, then change what differs.
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
    /// Share of the body that transmits, 0 to 1; thin-walled.
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

/// An image with 8-bit RGBA pixels. Whether they are sRGB or linear is decided by the material's
/// use of it.
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

/// A light without extent. Lights with one are meshes whose material emits.
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
    /// Cosine of the half angle at which it ends.
    pub cos_outer: f32,
}

/// Flag of a host: the callback may run on any thread, on several at once. Without it it runs only
/// on the thread that called the library.
pub const LUMI_HOST_CONCURRENT: u32 = 1;
/// Flag of a host: `radiance` has light of all bounces, so the library follows no path further.
pub const LUMI_HOST_FULL: u32 = 2;
/// Flag of a host: rays that miss bring their `radiance`, from an environment that the host leaves
/// out of its own direct light. Without it they bring nothing.
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
    /// n seeds for the host's random choices. Answers that depend on them and the rays alone make
    /// caches reproducible.
    pub seed: *const u32,
    /// 3 n floats, zero at first: light that the surface at the hit reflects against the ray,
    /// having come to it straight from sources (from everywhere with LUMI_HOST_FULL). What the
    /// surface emits itself is left out.
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
/// LUMI_ERROR_HOST_CALLBACK. No lock is held meanwhile. It may look up caches, but must not build,
/// fill, load, commit or release the cache or scene that is being worked on.
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
    /// Rays that a call should have, to be worth its while; 0: 65536. Fewer come when there are no
    /// more.
    pub preferred_batch: u32,
    /// Most rays of a call; 0: no bound.
    pub max_batch: u32,
    /// Lowest corner of the scene.
    pub bounds_min: [f32; 3],
    /// Highest corner of the scene.
    pub bounds_max: [f32; 3],
    /// Changes when the light in the scene does: caches are saved with it.
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
    /// Triangles as rays see them, instances counted each time.
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
    /// n floats: distance of the first hit in lengths of `dir`, INFINITY for a miss. May be NULL,
    /// as all below.
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

/// Flag of a query: makes records where none answers. Changes the cache.
pub const LUMI_QUERY_FILL: u32 = 1;

/// Status of a point: records answered.
pub const LUMI_POINT_INTERPOLATED: u8 = 0;
/// Status of a point: no record had answered, one was made by this call.
pub const LUMI_POINT_COMPUTED: u8 = 1;
/// Status of a point: no record answers; its results are zero.
pub const LUMI_POINT_MISSING: u8 = 2;
/// Status of a point: its position or normal is no number, or its normal is zero; its results are
/// zero.
pub const LUMI_POINT_REJECTED: u8 = 3;

/// Points and what is asked about them. Strides are in bytes; 0 means that the vectors lie side by
/// side.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct lumi_query {
    /// sizeof(lumi_query).
    pub struct_size: u32,
    /// LUMI_QUERY_*.
    pub flags: u32,
    /// Number of points.
    pub n: usize,
    /// Three floats per point, required: positions.
    pub position: *const f32,
    /// See `position`.
    pub position_stride: usize,
    /// Three floats per point, required: shading normals on the side that is looked at, any length
    /// but zero.
    pub normal: *const f32,
    /// See `normal`.
    pub normal_stride: usize,
    /// Three floats per point: geometric normals. NULL: the shading normals.
    pub geo_normal: *const f32,
    /// See `geo_normal`.
    pub geo_normal_stride: usize,
    /// Three floats per point: directions to the viewer. Needed for `radiance`, else NULL.
    pub wo: *const f32,
    /// See `wo`.
    pub wo_stride: usize,
    /// One float per point: width of a pixel there, world units. Bounds the area of a record from
    /// below. NULL: 0.002 times the scene's diagonal.
    pub footprint: *const f32,
    /// Three floats per point: irradiance of indirect light, and of direct light where "contents"
    /// is "direct-and-indirect" and the scene is the library's; what a diffuse surface reflects is
    /// albedo/pi times that. May be NULL.
    pub irradiance: *mut f32,
    /// See `irradiance`.
    pub irradiance_stride: usize,
    /// Three floats per point: indirect light that glossy lobes reflect towards `wo`. For scenes
    /// of our own whose surfaces pass through the points. May be NULL.
    pub radiance: *mut f32,
    /// See `radiance`.
    pub radiance_stride: usize,
    /// One float per point: estimated error as a share of the allowed one, 0 at a record, 1 at the
    /// end of its reach. May be NULL.
    pub error: *mut f32,
    /// One byte per point: LUMI_POINT_*. May be NULL.
    pub status: *mut u8,
    /// Paths per point for `radiance`; 0: 16.
    pub glossy_samples: u32,
    /// Zero.
    pub reserved: u32,
}

/// Watches a build, on the thread that called it: `fraction` goes from 0 to 1. Nonzero cancels; the
/// cache is then as before.
pub type lumi_progress_fn =
    Option<unsafe extern "C" fn(user: *mut c_void, fraction: f64, phase: *const c_char) -> i32>;

/// Numbers of a cache.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct lumi_stats {
    /// sizeof(lumi_stats); set it before the call.
    pub struct_size: u32,
    /// 1 once the cache is frozen.
    pub frozen: u32,
    /// Records on all levels.
    pub records: u64,
    /// Bytes of records and indexes.
    pub bytes: u64,
    /// Rays of gathers.
    pub rays: u64,
    /// Points asked about.
    pub queries: u64,
    /// Points that records answered.
    pub hits: u64,
    /// Points that none answered.
    pub misses: u64,
    /// Calls of the host's tracer.
    pub host_calls: u64,
    /// Rays handed to the host's tracer.
    pub host_rays: u64,
    /// Seconds spent on building and filling.
    pub build_seconds: f64,
    /// Mean radius of the records of the first level.
    pub mean_radius: f64,
    /// Largest radius of the records of the first level.
    pub max_radius: f64,
    /// Radiance records for glossy surfaces, which lumi_cache_get_records does not show.
    pub radiance_records: u64,
}

/// One record, for display.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct lumi_record {
    /// Where it lies.
    pub position: [f32; 3],
    /// Unit normal.
    pub normal: [f32; 3],
    /// Irradiance of indirect light.
    pub irradiance: [f32; 3],
    /// Radius of validity.
    pub radius: f32,
    /// Standard error of the luminance of the irradiance.
    pub sigma: f32,
    /// Bounces between the camera and the record.
    pub level: u32,
}

/// Flag of load and merge: records made for another scene or under other settings are taken too.
pub const LUMI_REUSE: u32 = 1;

/// Flag of a render: path tracing, the reference, instead of the cache.
pub const LUMI_RENDER_PATH: u32 = 1;
/// Flag of a render: an orthographic camera.
pub const LUMI_RENDER_ORTHOGRAPHIC: u32 = 2;

/// A picture to be rendered of a scene of our own.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct lumi_render_desc {
    /// sizeof(lumi_render_desc).
    pub struct_size: u32,
    /// LUMI_RENDER_*.
    pub flags: u32,
    /// Columns.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// Samples per pixel, the same for all pixels; 0: 16 times the quality, and up to four times as
    /// many where a pixel of the cache is still noisy.
    pub samples: u32,
    /// Zero.
    pub reserved: u32,
    /// Camera to world: its x, y and z axis and its place, three floats each. The camera looks
    /// along -z, y is up.
    pub camera: [f32; 12],
    /// Vertical field of view in radians; of an orthographic camera, half the height of the
    /// picture.
    pub yfov: f32,
    /// Width of the picture over its height as the camera has it; only orthographic cameras use
    /// it. 0: that of the pixels.
    pub aspect: f32,
}

/// A layer of a picture: a name of the EXR layers, "" for the beauty, and where its samples go.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct lumi_layer {
    /// Name of the layer, as the command line has it: "", "diffuse_indirect", "albedo", "N", "Z"
    /// ...
    pub name: *const c_char,
    /// channels * width * height floats: pixel by pixel, row by row from the top.
    pub data: *mut f32,
    /// Floats per pixel: 4 for "", 1 for "Z" and other single numbers, else 3.
    pub channels: u32,
    /// Zero.
    pub reserved: u32,
}

/// Largest struct_size that is believed.
const MAX_STRUCT: usize = 4096;

/// A struct that begins with its own size.
///
/// # Safety
/// The type is `repr(C)`, begins with a `u32`, and all zero bytes are a value of it.
pub(super) unsafe trait Versioned: Copy {}

macro_rules! versioned {
    ($($name:ident),*) => {
        $(
            // SAFETY: see the type's definition above: numbers, pointers and optional functions, of which zero is a value.
            unsafe impl Versioned for $name {}
        )*
    };
}

versioned!(
    lumi_mesh_desc,
    lumi_material_desc,
    lumi_texture_desc,
    lumi_light_desc,
    lumi_host_desc,
    lumi_scene_info,
    lumi_trace_desc,
    lumi_query,
    lumi_stats,
    lumi_render_desc
);

/// The size that the caller's struct has.
fn size_at<T: Versioned>(at: *const T, what: &str) -> Outcome<usize> {
    if at.is_null() {
        return Err(Fault::argument(format!("{what} is NULL")));
    }
    // SAFETY: the caller passes a struct that begins with its size; reading it does not ask for
    // alignment.
    let size = unsafe { at.cast::<u32>().read_unaligned() } as usize;
    if size < size_of::<T>() {
        let known = size_of::<T>();
        return Err(Fault::new(
            LUMI_ERROR_VERSION,
            format!("{what}: struct_size is {size}, the first version has {known} bytes"),
        ));
    }
    if size > MAX_STRUCT {
        return Err(Fault::argument(format!(
            "{what}: struct_size is {size}, which no version has"
        )));
    }
    Ok(size)
}

/// The caller's struct. A longer one of a later version is taken if its extra bytes are zero.
pub(super) fn read<T: Versioned>(at: *const T, what: &str) -> Outcome<T> {
    let size = size_at(at, what)?;
    // SAFETY: the struct has at least `size` bytes, as the caller says in its first field.
    let bytes = unsafe { std::slice::from_raw_parts(at.cast::<u8>(), size) };
    if bytes[size_of::<T>()..].iter().any(|b| *b != 0) {
        let text =
            format!("{what}: a field is set that version {:#x} does not know", LUMI_ABI_VERSION);
        return Err(Fault::new(LUMI_ERROR_UNSUPPORTED, text));
    }
    // SAFETY: the bytes are those of a T, alignment aside.
    Ok(unsafe { at.read_unaligned() })
}

/// Writes to the caller's struct, which is at least as long; its size stays.
pub(super) fn write<T: Versioned>(to: *mut T, value: T, what: &str) -> Outcome {
    let size = size_at(to, what)? as u32;
    // SAFETY: the struct has at least the size of a T, as the caller says in its first field.
    unsafe {
        to.write_unaligned(value);
        to.cast::<u32>().write_unaligned(size);
    }
    Ok(())
}
