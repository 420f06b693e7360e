//! Structs and constants of caches.

use super::common::{Versioned, versioned};
use std::ffi::{c_char, c_void};

/// Flag of a query: makes records where no record is valid. Changes the cache.
pub const LUMI_QUERY_FILL: u32 = 1;

/// Status of a point: interpolated from records.
pub const LUMI_POINT_INTERPOLATED: u8 = 0;
/// Status of a point: no record was valid there, and this call has made one.
pub const LUMI_POINT_COMPUTED: u8 = 1;
/// Status of a point: no record is valid there; its results are zero.
pub const LUMI_POINT_MISSING: u8 = 2;
/// Status of a point: its position or normal is no number, or its normal is zero; its results are
/// zero.
pub const LUMI_POINT_REJECTED: u8 = 3;

/// Shading points and what is asked about them. Strides are in bytes; 0: the vectors lie side by
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
    /// Three floats per point, required: shading normals on the side of the viewer, any length but
    /// zero.
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
    /// below. NULL: 0.002 times the extent of the
    /// first points that the cache was built for.
    pub footprint: *const f32,
    /// Three floats per point: irradiance of indirect light, and of direct light where "contents"
    /// is "direct-and-indirect" and the scene is the library's. A diffuse surface reflects
    /// albedo/pi times the irradiance. May be NULL.
    pub irradiance: *mut f32,
    /// See `irradiance`.
    pub irradiance_stride: usize,
    /// Three floats per point: indirect light that glossy lobes reflect towards `wo`. The
    /// library's own scenes alone have it, at points on their surfaces. May be NULL.
    pub radiance: *mut f32,
    /// See `radiance`.
    pub radiance_stride: usize,
    /// One float per point: estimated error as a fraction of the allowed error: 0 at a record, 1
    /// at the end of its area. May be NULL.
    pub error: *mut f32,
    /// One byte per point: LUMI_POINT_*. May be NULL.
    pub status: *mut u8,
    /// Paths per point for `radiance`; 0: 16.
    pub glossy_samples: u32,
    /// Zero.
    pub reserved: u32,
}

/// Watches a build or a render, on the thread that called it; `fraction` goes from 0 to 1. A result
/// that is not zero cancels the work.
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
    /// Points that were interpolated from records.
    pub hits: u64,
    /// Points at which no record was valid.
    pub misses: u64,
    /// Calls of the host's tracer.
    pub host_calls: u64,
    /// Rays handed to the host's tracer.
    pub host_rays: u64,
    /// Seconds spent on building and filling.
    pub build_seconds: f64,
    /// Mean radius of validity of the records of the first level.
    pub mean_radius: f64,
    /// Largest radius of validity of the records of the first level.
    pub max_radius: f64,
    /// Radiance records for glossy surfaces, which lumi_cache_get_records does not show.
    pub radiance_records: u64,
}

/// One record, for display.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct lumi_record {
    /// Position.
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

/// Flag of load and merge: records made for another scene or under other settings are taken, too.
pub const LUMI_REUSE: u32 = 1;

/// Flag of a render: path tracing, the reference, instead of the cache.
pub const LUMI_RENDER_PATH: u32 = 1;
/// Flag of a render: an orthographic camera.
pub const LUMI_RENDER_ORTHOGRAPHIC: u32 = 2;
/// Flag of a render: Open Image Denoise takes the noise out of what was traced. Light from records
/// stays as it is, and so do layers whose names begin with "noisy.". Without Open Image Denoise the
/// call fails with LUMI_ERROR_UNKNOWN, and its message says what is missing.
pub const LUMI_RENDER_DENOISE: u32 = 4;
/// Flag of a render: as LUMI_RENDER_DENOISE where Open Image Denoise is installed. Elsewhere the
/// picture is not denoised, and the device's log says so.
pub const LUMI_RENDER_DENOISE_AUTO: u32 = 8;

/// A picture of a scene that the library keeps.
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
    /// Samples per pixel, the same for all pixels; 0: 16 times the quality, and up to four times
    /// as many where a pixel of the cache is still noisy.
    pub samples: u32,
    /// Zero.
    pub reserved: u32,
    /// Camera to world: x, y and z axis and position of the camera, three floats each. The camera
    /// looks along -z, y is up.
    pub camera: [f32; 12],
    /// Vertical field of view in radians; of an orthographic camera, half the height of the
    /// picture.
    pub yfov: f32,
    /// Width of the camera's picture over its height, for orthographic cameras; 0: that of the
    /// pixels.
    pub aspect: f32,
    /// Near plane: the camera sees nothing that is nearer to it along its -z.
    pub near_plane: f32,
    /// Far plane: the camera sees nothing that is farther away; 0: everything.
    pub far_plane: f32,
}

/// A layer of a picture: its name in EXR files, "" for the beauty, and where its samples go.
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

versioned!(lumi_query, lumi_stats, lumi_render_desc);
