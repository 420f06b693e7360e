/* lumicache.h - global illumination by caching, for other renderers. C99 and C++17.
   docs/CAPI.md is the manual. cbindgen makes this file from the source: `make header` writes it.

   ERRORS   A function returns LUMI_OK or a LUMI_ERROR_* code; lumi_get_last_error has the text, per
            thread. Failures of functions without a result are found there, too.
   HANDLES  are reference counted. Release what a *_new function gave. The library finds out
            released handles, handles of another kind and NULL; release(NULL) does nothing.
   THREADS  "any": any number of threads at once. "one per X": calls for the same X must not
            overlap; where they do, one of them may fail with LUMI_ERROR_INVALID_OPERATION, but
            nothing breaks.
   MEMORY   Arrays belong to the caller. The library reads or writes them during the call and keeps
            no pointer, but for LUMI_VIEW_SHARED and `user` pointers.
   STRUCTS  begin with their size: set struct_size, and zero what you do not use.
   UNITS    are the host's; light is linear Rec. 709. Directions point away from the surface. */

#ifndef LUMICACHE_H
#define LUMICACHE_H

#include <stddef.h>
#include <stdint.h>

#ifndef LUMI_API
# if defined(__GNUC__)
#  define LUMI_API __attribute__((visibility("default")))
# else
#  define LUMI_API
# endif
#endif

// The version of this header: major << 16 | minor. A minor version only adds functions, or fields
// at the end of structs.
#define LUMI_ABI_VERSION 65536

// Format of a view: two floats per element.
#define LUMI_FORMAT_F32X2 2

// Format of a view: three floats per element.
#define LUMI_FORMAT_F32X3 3

// Format of a view: four floats per element.
#define LUMI_FORMAT_F32X4 4

// Format of a view: one unsigned integer per element.
#define LUMI_FORMAT_U32 17

// Format of a view: three unsigned integers per element.
#define LUMI_FORMAT_U32X3 19

// Flag of a view of a mesh: the buffer stays alive and unchanged until the scene and all its
// caches are released. lumi_scene_commit reads the buffer. Positions and indices of meshes with
// one material stay in the buffer if they are dense and aligned; other arrays are copied. Without
// the flag, everything is copied at once.
#define LUMI_VIEW_SHARED 1

// Flag of a file: what breaks the glTF specification is an error, also where it could be mended.
#define LUMI_LOAD_STRICT 1

// Flag of a file: files outside its folder are read too, where the file names them.
#define LUMI_LOAD_ALLOW_OUTSIDE 2

// Flag of a material: emits from both faces.
#define LUMI_MATERIAL_DOUBLE_SIDED 1

// Alpha mode of a material: alpha is ignored.
#define LUMI_ALPHA_OPAQUE 0

// Alpha mode of a material: the surface is where alpha is at least `alpha_cutoff`.
#define LUMI_ALPHA_MASK 1

// Alpha mode of a material: the surface stops the fraction alpha of the rays.
#define LUMI_ALPHA_BLEND 2

// Wrapping of a texture: it repeats.
#define LUMI_WRAP_REPEAT 0

// Wrapping of a texture: every second repetition is mirrored.
#define LUMI_WRAP_MIRROR 1

// Wrapping of a texture: the border continues.
#define LUMI_WRAP_CLAMP 2

// Type of a light: radiates from a point.
#define LUMI_LIGHT_POINT 0

// Type of a light: a point within a cone.
#define LUMI_LIGHT_SPOT 1

// Type of a light: parallel.
#define LUMI_LIGHT_DIRECTIONAL 2

// Flag of a host: the callback may run on any thread, and on several at once. Without the flag,
// the callback runs only on the thread that called the library.
#define LUMI_HOST_CONCURRENT 1

// Flag of a host: `radiance` has light of all bounces, so the library follows no path further.
#define LUMI_HOST_FULL 2

// Flag of a host: rays that miss bring `radiance`, from an environment that the host leaves out of
// its own direct light. Without the flag, they bring nothing.
#define LUMI_HOST_ENV_IN_MISS 4

// Flag of a query: makes records where no record is valid. Changes the cache.
#define LUMI_QUERY_FILL 1

// Status of a point: interpolated from records.
#define LUMI_POINT_INTERPOLATED 0

// Status of a point: no record was valid there, and this call has made one.
#define LUMI_POINT_COMPUTED 1

// Status of a point: no record is valid there; its results are zero.
#define LUMI_POINT_MISSING 2

// Status of a point: its position or normal is no number, or its normal is zero; its results are
// zero.
#define LUMI_POINT_REJECTED 3

// Flag of load and merge: records made for another scene or under other settings are taken, too.
#define LUMI_REUSE 1

// Flag of a render: path tracing, the reference, instead of the cache.
#define LUMI_RENDER_PATH 1

// Flag of a render: an orthographic camera.
#define LUMI_RENDER_ORTHOGRAPHIC 2

// Flag of a render: Open Image Denoise takes the noise out of what was traced. Light from records
// stays as it is, and so do layers whose names begin with "noisy.". Without Open Image Denoise the
// call fails with LUMI_ERROR_UNKNOWN, and its message says what is missing.
#define LUMI_RENDER_DENOISE 4

// Flag of a render: as LUMI_RENDER_DENOISE where Open Image Denoise is installed. Elsewhere the
// picture is not denoised, and the device's log says so.
#define LUMI_RENDER_DENOISE_AUTO 8

// Severity of a log message: for information.
#define LUMI_LOG_INFO 0

// Severity of a log message: the result may not be what was wanted.
#define LUMI_LOG_WARNING 1

// Severity of a log message: a function has failed.
#define LUMI_LOG_ERROR 2

// Records of indirect light in one scene.
typedef struct lumi_cache_s lumi_cache_s;

// A library in use: its threads, its ray tracer and its log.
typedef struct lumi_device_s lumi_device_s;

// Geometry, materials and lights, or a host that has them.
typedef struct lumi_scene_s lumi_scene_s;

// What a function reports: LUMI_OK or one of the LUMI_ERROR_* codes.
typedef int32_t lumi_error;

// See lumi_device_new.
typedef struct lumi_device_s *lumi_device;

// Takes messages, on the thread whose call is reported. The callback must not call the library for
// that device.
typedef void (*lumi_log_fn)(void *user, int32_t severity, lumi_error code, const char *message);

// See lumi_scene_new.
typedef struct lumi_scene_s *lumi_scene;

// An array in the host's memory. All zero: there is no array.
typedef struct lumi_view {
  // First element.
  const void *data;
  // Number of elements.
  size_t count;
  // Bytes from one element to the next; 0: the elements lie side by side.
  size_t stride;
  // LUMI_FORMAT_*.
  uint32_t format;
  // LUMI_VIEW_*.
  uint32_t flags;
} lumi_view;

// A triangle mesh. The front of a triangle is where its vertices run counter-clockwise.
typedef struct lumi_mesh_desc {
  // sizeof(lumi_mesh_desc).
  uint32_t struct_size;
  // Zero.
  uint32_t flags;
  // LUMI_FORMAT_F32X3, required.
  struct lumi_view positions;
  // LUMI_FORMAT_U32X3, required.
  struct lumi_view indices;
  // LUMI_FORMAT_F32X3 per vertex; without normals the mesh is flat. The library normalises
  // them.
  struct lumi_view normals;
  // LUMI_FORMAT_F32X2 per vertex: texture coordinates, (0, 0) at the first pixel of the first
  // row.
  struct lumi_view uv0;
  // LUMI_FORMAT_F32X4 per vertex: linear RGBA, multiplied into the base colour.
  struct lumi_view colors;
  // LUMI_FORMAT_U32 per triangle: its material. Without the array, all triangles have
  // `material`.
  struct lumi_view triangle_materials;
  // Material of all triangles.
  uint32_t material;
  // Zero.
  uint32_t reserved;
} lumi_mesh_desc;

// A surface in the terms of glTF. Fill it by lumi_material_init, then change what differs.
typedef struct lumi_material_desc {
  // sizeof(lumi_material_desc).
  uint32_t struct_size;
  // LUMI_MATERIAL_*.
  uint32_t flags;
  // Linear Rec. 709, 0 to 1.
  float base_color[3];
  // 0 to 1.
  float alpha;
  // LUMI_ALPHA_*.
  uint32_t alpha_mode;
  // 0 to 1.
  float alpha_cutoff;
  // 0 to 1.
  float metallic;
  // Perceptual, 0 to 1.
  float roughness;
  // Index of refraction, at least 1.
  float ior;
  // Strength of the dielectric reflection, 0 to 1; 0 leaves a purely diffuse surface when
  // metallic is 0.
  float specular;
  // Fraction of the light entering the surface that is transmitted, 0 to 1; thin-walled.
  float transmission;
  // Emitted radiance.
  float emission[3];
  // Texture of base colour (sRGB) and alpha, -1 for none.
  int32_t base_color_texture;
  // Texture of roughness (G) and metallic (B), -1 for none.
  int32_t metallic_roughness_texture;
  // Texture of the emission (sRGB), -1 for none.
  int32_t emission_texture;
  // Tangent-space normal map, -1 for none. Needs uv0.
  int32_t normal_texture;
} lumi_material_desc;

// An image with 8-bit RGBA pixels. The material decides whether the pixels are sRGB or linear.
typedef struct lumi_texture_desc {
  // sizeof(lumi_texture_desc).
  uint32_t struct_size;
  // Columns.
  uint32_t width;
  // Rows.
  uint32_t height;
  // LUMI_WRAP_* of the horizontal coordinate.
  uint32_t wrap_u;
  // LUMI_WRAP_* of the vertical coordinate.
  uint32_t wrap_v;
  // 1: nearest pixel; 0: bilinear.
  uint32_t nearest;
  // 4 * width * height bytes, row by row from the top; copied.
  const uint8_t *pixels;
} lumi_texture_desc;

// A light without extent. A light with extent is a mesh whose material emits.
typedef struct lumi_light_desc {
  // sizeof(lumi_light_desc).
  uint32_t struct_size;
  // LUMI_LIGHT_*.
  uint32_t kind;
  // World position; unused by directional lights.
  float position[3];
  // Direction in which the light travels, any length but zero; unused by point lights.
  float direction[3];
  // Radiant intensity; of a directional light, the irradiance across the light.
  float intensity[3];
  // Distance at which the light is cut off; 0: none.
  float range;
  // Cosine of the half angle at which a spot's fall-off begins.
  float cos_inner;
  // Cosine of the half angle at which the fall-off ends.
  float cos_outer;
} lumi_light_desc;

// Rays that the host traces and shades. The library sets the pointers and `n`; the host fills the
// four arrays that are not const, changes nothing else, and keeps no pointer.
typedef struct lumi_ray_batch {
  // sizeof(lumi_ray_batch).
  uint32_t struct_size;
  // Number of rays.
  uint32_t n;
  // 3 n floats: where the rays start.
  const float *origin;
  // 3 n floats: unit directions.
  const float *dir;
  // n numbers: surfaces that the path has met before this ray, the camera's counted.
  const uint32_t *bounce;
  // n seeds for the host's random choices. Caches are reproducible if the answers depend on
  // nothing but rays and seeds.
  const uint32_t *seed;
  // 3 n floats, zero at first: direct light that the surface at the hit reflects against the
  // ray; with LUMI_HOST_FULL, all light. Light that the surface emits is left out.
  float *radiance;
  // n floats, INFINITY at first: distance of the hit.
  float *distance;
  // 3 n floats, zero at first: unit shading normal at the hit, on either side. Required without
  // LUMI_HOST_FULL; with it, better gradients.
  float *normal;
  // 3 n floats, zero at first: albedo of the diffuse lobe at the hit, 0 to 1. Unused with
  // LUMI_HOST_FULL.
  float *albedo;
} lumi_ray_batch;

// The host's tracer and shader. 0: go on; anything else ends the call of the library with
// LUMI_ERROR_HOST_CALLBACK. The library holds no lock meanwhile. The callback may look up caches.
// It must not build, fill, load, commit or release the cache or scene that the library works on.
typedef int32_t (*lumi_trace_fn)(void *user, struct lumi_ray_batch *batch);

// A host that keeps geometry and shading to itself.
typedef struct lumi_host_desc {
  // sizeof(lumi_host_desc).
  uint32_t struct_size;
  // LUMI_HOST_*.
  uint32_t flags;
  // Rays that a call should have; 0: 65536. A call has fewer when there are no more.
  uint32_t preferred_batch;
  // Most rays of a call; 0: no bound.
  uint32_t max_batch;
  // Lowest corner of the scene.
  float bounds_min[3];
  // Highest corner of the scene.
  float bounds_max[3];
  // A hash that changes when the light in the scene does. Caches are saved with it.
  uint64_t scene_hash;
  // The tracer.
  lumi_trace_fn trace;
  // Passed to the tracer.
  void *user;
} lumi_host_desc;

// Facts about a committed scene.
typedef struct lumi_scene_info {
  // sizeof(lumi_scene_info); set it before the call.
  uint32_t struct_size;
  // Zero.
  uint32_t reserved;
  // Lowest corner of the scene.
  float bounds_min[3];
  // Highest corner of the scene.
  float bounds_max[3];
  // Triangles, counted once for each instance.
  uint64_t triangles;
  // Cameras of the file.
  uint64_t cameras;
  // Hash of geometry, materials and lights, hexadecimal, ends in NUL.
  char hash[72];
  // Name and version of the ray tracer, ends in NUL.
  char backend[64];
} lumi_scene_info;

// Rays into a scene of our own, and what they hit.
typedef struct lumi_trace_desc {
  // sizeof(lumi_trace_desc).
  uint32_t struct_size;
  // Zero.
  uint32_t flags;
  // Number of rays.
  size_t n;
  // 3 n floats.
  const float *origin;
  // 3 n floats, any length but zero.
  const float *dir;
  // n floats: distance of the first hit in lengths of `dir`, INFINITY for a miss. This array
  // and those below may be NULL.
  float *distance;
  // 3 n floats: position of the hit.
  float *position;
  // 3 n floats: unit shading normal against the ray.
  float *normal;
  // 3 n floats: unit geometric normal against the ray.
  float *geo_normal;
  // 3 n floats: albedo of the diffuse lobe.
  float *albedo;
} lumi_trace_desc;

// How a file is read.
typedef struct lumi_load_desc {
  // sizeof(lumi_load_desc).
  uint32_t struct_size;
  // LUMI_LOAD_*.
  uint32_t flags;
  // Bytes that reading may take, beyond which it fails with LUMI_ERROR_OUT_OF_MEMORY; 0: 1 GiB
  // and 64 times the size of the files.
  uint64_t memory_limit;
} lumi_load_desc;

// See lumi_cache_new.
typedef struct lumi_cache_s *lumi_cache;

// Watches a build or a render, on the thread that called it; `fraction` goes from 0 to 1. A result
// that is not zero cancels the work.
typedef int32_t (*lumi_progress_fn)(void *user, double fraction, const char *phase);

// Numbers of a cache.
typedef struct lumi_stats {
  // sizeof(lumi_stats); set it before the call.
  uint32_t struct_size;
  // 1 once the cache is frozen.
  uint32_t frozen;
  // Records on all levels.
  uint64_t records;
  // Bytes of records and indexes.
  uint64_t bytes;
  // Rays of gathers.
  uint64_t rays;
  // Points asked about.
  uint64_t queries;
  // Points that were interpolated from records.
  uint64_t hits;
  // Points at which no record was valid.
  uint64_t misses;
  // Calls of the host's tracer.
  uint64_t host_calls;
  // Rays handed to the host's tracer.
  uint64_t host_rays;
  // Seconds spent on building and filling.
  double build_seconds;
  // Mean radius of validity of the records of the first level.
  double mean_radius;
  // Largest radius of validity of the records of the first level.
  double max_radius;
  // Radiance records for glossy surfaces, which lumi_cache_get_records does not show.
  uint64_t radiance_records;
} lumi_stats;

// One record, for display.
typedef struct lumi_record {
  // Position.
  float position[3];
  // Unit normal.
  float normal[3];
  // Irradiance of indirect light.
  float irradiance[3];
  // Radius of validity.
  float radius;
  // Standard error of the luminance of the irradiance.
  float sigma;
  // Bounces between the camera and the record.
  uint32_t level;
} lumi_record;

// Shading points and what is asked about them. Strides are in bytes; 0: the vectors lie side by
// side.
typedef struct lumi_query {
  // sizeof(lumi_query).
  uint32_t struct_size;
  // LUMI_QUERY_*.
  uint32_t flags;
  // Number of points.
  size_t n;
  // Three floats per point, required: positions.
  const float *position;
  // See `position`.
  size_t position_stride;
  // Three floats per point, required: shading normals on the side of the viewer, any length but
  // zero.
  const float *normal;
  // See `normal`.
  size_t normal_stride;
  // Three floats per point: geometric normals. NULL: the shading normals.
  const float *geo_normal;
  // See `geo_normal`.
  size_t geo_normal_stride;
  // Three floats per point: directions to the viewer. Needed for `radiance`, else NULL.
  const float *wo;
  // See `wo`.
  size_t wo_stride;
  // One float per point: width of a pixel there, world units. Bounds the area of a record from
  // below. NULL: 0.002 times the extent of the
  // first points that the cache was built for.
  const float *footprint;
  // Three floats per point: irradiance of indirect light, and of direct light where "contents"
  // is "direct-and-indirect" and the scene is the library's. A diffuse surface reflects
  // albedo/pi times the irradiance. May be NULL.
  float *irradiance;
  // See `irradiance`.
  size_t irradiance_stride;
  // Three floats per point: indirect light that glossy lobes reflect towards `wo`. The
  // library's own scenes alone have it, at points on their surfaces. May be NULL.
  float *radiance;
  // See `radiance`.
  size_t radiance_stride;
  // One float per point: estimated error as a fraction of the allowed error: 0 at a record, 1
  // at the end of its area. May be NULL.
  float *error;
  // One byte per point: LUMI_POINT_*. May be NULL.
  uint8_t *status;
  // Paths per point for `radiance`; 0: 16.
  uint32_t glossy_samples;
  // Zero.
  uint32_t reserved;
} lumi_query;

// A picture of a scene that the library keeps.
typedef struct lumi_render_desc {
  // sizeof(lumi_render_desc).
  uint32_t struct_size;
  // LUMI_RENDER_*.
  uint32_t flags;
  // Columns.
  uint32_t width;
  // Rows.
  uint32_t height;
  // Samples per pixel, the same for all pixels; 0: 16 times the quality, and up to four times
  // as many where a pixel of the cache is still noisy.
  uint32_t samples;
  // Zero.
  uint32_t reserved;
  // Camera to world: x, y and z axis and position of the camera, three floats each. The camera
  // looks along -z, y is up.
  float camera[12];
  // Vertical field of view in radians; of an orthographic camera, half the height of the
  // picture.
  float yfov;
  // Width of the camera's picture over its height, for orthographic cameras; 0: that of the
  // pixels.
  float aspect;
  // Near plane: the camera sees nothing that is nearer to it along its -z.
  float near_plane;
  // Far plane: the camera sees nothing that is farther away; 0: everything.
  float far_plane;
} lumi_render_desc;

// A layer of a picture: its name in EXR files, "" for the beauty, and where its samples go.
typedef struct lumi_layer {
  // Name of the layer, as the command line has it: "", "diffuse_indirect", "albedo", "N", "Z"
  // ...
  const char *name;
  // channels * width * height floats: pixel by pixel, row by row from the top.
  float *data;
  // Floats per pixel: 4 for "", 1 for "Z" and other single numbers, else 3.
  uint32_t channels;
  // Zero.
  uint32_t reserved;
} lumi_layer;

// All is well.
#define LUMI_OK 0

// Something outside the library failed or is missing: threads, the ray tracer, the denoiser.
#define LUMI_ERROR_UNKNOWN 1

// An argument is outside its range: NULL, a released handle, a handle of another kind, NaN.
#define LUMI_ERROR_INVALID_ARGUMENT 2

// The state of the object does not allow the call.
#define LUMI_ERROR_INVALID_OPERATION 3

// Memory, or room for objects, ran out.
#define LUMI_ERROR_OUT_OF_MEMORY 4

// This version of the library cannot do what was asked.
#define LUMI_ERROR_UNSUPPORTED 5

// The progress callback asked to stop.
#define LUMI_ERROR_CANCELLED 6

// A file cannot be read or written.
#define LUMI_ERROR_IO 7

// A file is damaged or breaks its format.
#define LUMI_ERROR_CORRUPT_FILE 8

// A cache file is sound, but was made for another scene or under other settings.
#define LUMI_ERROR_STALE_CACHE 9

// The versions of header and library do not match, or a struct is shorter than its first version.
#define LUMI_ERROR_VERSION 10

// The host's callback failed or gave an impossible answer.
#define LUMI_ERROR_HOST_CALLBACK 11

// A fault of the library. The objects of the call can only be released.
#define LUMI_ERROR_INTERNAL 12

#ifdef __cplusplus
extern "C" {
#endif // __cplusplus

// The code of the first failed call on this thread since the last call of this function; LUMI_OK
// without a failure. The library forgets the failure then.
//
// `message`: receives a text that says what failed and why, "" without a failure; it lives until
// the thread calls this function again or ends. May be NULL.
//
// Threads: any. Every thread has its own errors.
LUMI_API lumi_error lumi_get_last_error(const char **message);

// The version of the ABI that the library has, as LUMI_ABI_VERSION of its header.
//
// Threads: any.
LUMI_API uint32_t lumi_get_abi_version(void);

// The version of the library, such as "0.1.0"; lives as long as the library.
//
// Threads: any.
LUMI_API const char *lumi_get_version_string(void);

// Makes a device; the caller owns a reference to it.
//
// `abi_version`: pass LUMI_ABI_VERSION. Another major version, or a later minor one than the
// library's, fails with LUMI_ERROR_VERSION. `config`: NULL, or settings separated by commas:
// `threads=N` (0: all processors), `backend=embree` or `backend=bvh` (default: Embree if it
// starts), `tables=FOLDER` (where tabulated glossy lobes are kept between runs, `off` for memory
// alone; default: the folder that the environment variable LUMICACHE_TABLES names, else `off`),
// `denoiser=PATH` (the file of Open Image Denoise, or a folder that has it; default: what the
// environment variable LUMICACHE_OIDN names, else `lumicache/oidn` in the user's data folder, then
// the system's folders).
// `out`: receives the device, NULL on failure.
//
// Threads: any.
LUMI_API lumi_error lumi_device_new(uint32_t abi_version, const char *config, lumi_device *out);

// Adds a reference.
//
// Threads: any.
LUMI_API void lumi_device_retain(lumi_device device);

// Drops a reference. Scenes and caches keep what they need of their device. NULL is ignored.
//
// Threads: any.
LUMI_API void lumi_device_release(lumi_device device);

// Sets the callback that hears of warnings and failures of calls on this device, its scenes and
// its caches; NULL: none.
//
// Threads: any; a message under way may still go to the former callback.
LUMI_API lumi_error lumi_device_set_log(lumi_device device, lumi_log_fn callback, void *user);

// Writes name and version of the ray tracer, such as "Embree 4.3.3", to `buffer`, cut off to
// `size` bytes with its NUL.
//
// Threads: any.
LUMI_API lumi_error lumi_device_get_backend(lumi_device device, char *buffer, size_t size);

// Makes an empty scene; the caller owns a reference to it. Describe the scene or read it from a
// file, then commit it.
//
// Threads: any.
LUMI_API lumi_error lumi_scene_new(lumi_device device, lumi_scene *out);

// Adds a reference.
//
// Threads: any.
LUMI_API void lumi_scene_retain(lumi_scene scene);

// Drops a reference. Caches keep their scene. NULL is ignored.
//
// Threads: any.
LUMI_API void lumi_scene_release(lumi_scene scene);

// Adds a mesh and gives its number, from 0. lumi_scene_add_instance places the mesh.
//
// `id`: receives the number; may be NULL.
//
// Threads: one per scene. Buffers are copied, unless their view says LUMI_VIEW_SHARED.
LUMI_API
lumi_error lumi_scene_add_mesh(lumi_scene scene,
                               const struct lumi_mesh_desc *mesh,
                               uint32_t *id);

// Places a mesh that lumi_scene_add_mesh has numbered.
//
// `to_world`: 12 floats: the x, y and z axis and the origin of the mesh in the world, three each;
// may mirror. NULL: no transform.
//
// Threads: one per scene.
LUMI_API lumi_error lumi_scene_add_instance(lumi_scene scene, uint32_t mesh, const float *to_world);

// Fills `material` with the defaults: diffuse grey of albedo 0.8 under a dielectric of roughness
// 0.5, no textures.
//
// `material`: its struct_size is set too.
//
// Threads: any.
LUMI_API lumi_error lumi_material_init(struct lumi_material_desc *material);

// Adds a material and gives its number, from 0.
//
// `id`: receives the number; may be NULL.
//
// Threads: one per scene.
LUMI_API
lumi_error lumi_scene_add_material(lumi_scene scene,
                                   const struct lumi_material_desc *material,
                                   uint32_t *id);

// Adds a texture and gives its number, from 0. Its pixels are copied.
//
// `id`: receives the number; may be NULL.
//
// Threads: one per scene.
LUMI_API
lumi_error lumi_scene_add_texture(lumi_scene scene,
                                  const struct lumi_texture_desc *texture,
                                  uint32_t *id);

// Adds a point, spot or directional light.
//
// Threads: one per scene.
LUMI_API lumi_error lumi_scene_add_light(lumi_scene scene, const struct lumi_light_desc *light);

// Sets the light from infinity, an equirectangular map. A map of one pixel is a uniform
// environment.
//
// `rgb`: 3 * width * height floats, row by row from the zenith (+y); copied. NaN and negative
// values count as 0. NULL: no environment. `to_map`: 9 floats, the columns of the rotation from
// the world to the map; NULL: none; the middle column of the map lies along +x then, and +z to its
// right.
//
// Threads: one per scene.
LUMI_API
lumi_error lumi_scene_set_environment(lumi_scene scene,
                                      const float *rgb,
                                      uint32_t width,
                                      uint32_t height,
                                      const float *to_map);

// Says that the host keeps geometry and shading. The scene must be empty and stays empty.
//
// Threads: one per scene. `host->user` must stay valid until the last cache of the scene is
// released.
LUMI_API lumi_error lumi_scene_set_host(lumi_scene scene, const struct lumi_host_desc *host);

// Makes the scene ready for rays and caches; it cannot change afterwards. After a failure the
// scene is as before. A scene without any light gets a neutral dome, and the log says so.
//
// Threads: one per scene; the work is done on the device's threads.
LUMI_API lumi_error lumi_scene_commit(lumi_scene scene);

// Facts about a committed scene.
//
// Threads: any.
LUMI_API lumi_error lumi_scene_get_info(lumi_scene scene, struct lumi_scene_info *info);

// Traces rays into a scene that the library keeps, and gives their first hits.
//
// Threads: any; the work is done on the calling thread.
LUMI_API lumi_error lumi_scene_trace(lumi_scene scene, const struct lumi_trace_desc *rays);

// Reads everything of a glTF 2.0 file (.gltf, .glb) into the scene, which must be empty. What
// breaks the specification and does no harm is mended, with a warning when the scene is
// committed. Only files inside the folder of the file are read. Reading takes at most 1 GiB and 64
// times the size of the files.
//
// `file`: the path, UTF-8.
//
// Threads: one per scene.
LUMI_API lumi_error lumi_scene_load_gltf(lumi_scene scene, const char *file);

// As lumi_scene_load_gltf, with what `desc` says.
//
// Threads: one per scene.
LUMI_API
lumi_error lumi_scene_load_gltf_with(lumi_scene scene,
                                     const char *file,
                                     const struct lumi_load_desc *desc);

// Makes an empty cache for a committed scene; the caller owns a reference to it.
//
// `preset`: name of a caching scheme as `lumicache presets` lists them, or a TOML text as
// `lumicache presets NAME` shows it; NULL: "auto".
//
// Threads: any.
LUMI_API lumi_error lumi_cache_new(lumi_scene scene, const char *preset, lumi_cache *out);

// Adds a reference.
//
// Threads: any.
LUMI_API void lumi_cache_retain(lumi_cache cache);

// Drops a reference. NULL is ignored.
//
// Threads: any, except from the cache's own callbacks.
LUMI_API void lumi_cache_release(lumi_cache cache);

// Sets a number of the scheme, such as "validity.error" or "radius.max_radius", or "quality".
// Fails with LUMI_ERROR_UNSUPPORTED for a name that this version does not know, and with
// LUMI_ERROR_INVALID_OPERATION once the cache has records.
//
// Threads: one per cache.
LUMI_API lumi_error lumi_cache_set_f32(lumi_cache cache, const char *name, float value);

// Sets a whole number: "gather.rays", "levels" and other settings of the scheme, "max_bounces"
// (-1: no bound), "seed", "deeper_points" (points of each deeper level). See lumi_cache_set_f32.
//
// Threads: one per cache.
LUMI_API lumi_error lumi_cache_set_i32(lumi_cache cache, const char *name, int32_t value);

// Sets a word: "preset", which resets the whole scheme to a preset or to a TOML text, or any
// setting written as `lumicache presets NAME --all` shows it. See lumi_cache_set_f32.
//
// Threads: one per cache.
LUMI_API lumi_error lumi_cache_set_str(lumi_cache cache, const char *name, const char *value);

// Sets the callback that watches lumi_cache_build and lumi_cache_render; NULL: none.
//
// Threads: any; the callback runs on the thread that builds.
LUMI_API
lumi_error lumi_cache_set_progress(lumi_cache cache,
                                   lumi_progress_fn callback,
                                   void *user);

// Joins the records of all fills into one index, and refuses more records. Lookups are fastest
// then.
//
// Threads: one per cache; lookups may go on meanwhile.
LUMI_API lumi_error lumi_cache_freeze(lumi_cache cache);

// Writes all irradiance records to a file with a checksum and the scene and settings that they
// were made for. Radiance records, and irradiance that is known from them alone, are left to
// lumi_cache_build. The file is complete or not there: it is written elsewhere and renamed.
//
// `file`: the path, UTF-8.
//
// Threads: any.
LUMI_API lumi_error lumi_cache_save(lumi_cache cache, const char *file);

// Replaces the records of the cache by those of a file. LUMI_ERROR_STALE_CACHE: the file was made
// for another scene or under other settings; LUMI_REUSE takes it nevertheless.
// LUMI_ERROR_CORRUPT_FILE: the file is damaged. After a failure the cache is as before.
//
// `file`: the path, UTF-8. `flags`: 0 or LUMI_REUSE.
//
// Threads: one per cache; lookups may go on meanwhile.
LUMI_API lumi_error lumi_cache_load(lumi_cache cache, const char *file, uint32_t flags);

// Adds the records of `src` that lumi_cache_save would write to `dst`, except those that `dst` has
// already. LUMI_ERROR_STALE_CACHE as for lumi_cache_load.
//
// `flags`: 0 or LUMI_REUSE.
//
// Threads: one per cache `dst`; lookups may go on meanwhile.
LUMI_API lumi_error lumi_cache_merge(lumi_cache dst, lumi_cache src, uint32_t flags);

// Drops all records. A frozen cache takes new records afterwards.
//
// Threads: one per cache; lookups may go on meanwhile.
LUMI_API lumi_error lumi_cache_clear(lumi_cache cache);

// Numbers of the cache.
//
// `stats`: set its struct_size first.
//
// Threads: any.
LUMI_API lumi_error lumi_cache_get_stats(lumi_cache cache, struct lumi_stats *stats);

// Writes at most `max` records to `out`, beginning with record number `first`. The records of the
// first level come first.
//
// `n`: receives how many were written; with `out` NULL, how many there are.
//
// Threads: any. The numbers of records stay the same while nothing is added.
LUMI_API
lumi_error lumi_cache_get_records(lumi_cache cache,
                                  size_t first,
                                  size_t max,
                                  struct lumi_record *out,
                                  size_t *n);

// Looks up many shading points. Without LUMI_QUERY_FILL, the call waits for no other thread, and
// the answers depend on the records alone. With LUMI_QUERY_FILL, the call makes records where no
// record is valid; these records depend on what other threads fill at the same time. When a host
// fails, the answers before the fill stay.
//
// Threads: any. Lookups run on the calling thread; fills on the device's threads.
LUMI_API lumi_error lumi_cache_query(lumi_cache cache, const struct lumi_query *query);

// Makes records until every seed point is covered; records of deeper bounces come first. Where
// seeds have `wo`, and scene and preset have a use for them, radiance records are made beside the
// others, for glossy lobes that harmonics represent. Presets that refine records refine them in
// scenes of our own. Records that the cache has already are kept. The same settings, points and
// calls give the same records, bit for bit, on any number of threads. After a failure, and when
// cancelled, the cache is as before.
//
// `seeds`: positions, normals, wo and footprints are read, nothing is written.
//
// Threads: one per cache; lookups may go on meanwhile and see the cache as it was.
LUMI_API lumi_error lumi_cache_build(lumi_cache cache, const struct lumi_query *seeds);

// Renders a picture of a scene that the library keeps, as the command line does. The cache is
// filled where the camera needs records. Indirect light of diffuse surfaces, and of glossy lobes
// that the preset caches, is interpolated from the records; all other light is traced. The records
// are kept, unless the cache is frozen. When cancelled, the layers hold the samples so far.
//
// `layers`: `count` layers with room for their samples.
//
// Threads: one per cache; the work is done on the device's threads.
LUMI_API
lumi_error lumi_cache_render(lumi_cache cache,
                             const struct lumi_render_desc *desc,
                             const struct lumi_layer *layers,
                             size_t count);

#ifdef __cplusplus
}  // extern "C"
#endif  // __cplusplus

#endif  /* LUMICACHE_H */
