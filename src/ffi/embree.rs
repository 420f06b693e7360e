//! Embree 3 or 4: devices, scenes, and rays against them. Every call of an `rtc*` function is in this file.
//!
//! The two major versions differ, for us, in how options reach the ray functions ([`query`] hides it) and in the size of the hit
//! structures (bindgen reads it from the header that the build found).

use crate::error::{Error, Result};
use crate::ffi::ray::{Hit, Ray};
use std::ffi::{CStr, CString, c_char, c_void};
use std::sync::atomic::{AtomicIsize, Ordering};
use std::sync::{Arc, Mutex, PoisonError};

#[allow(
    non_camel_case_types,
    non_snake_case,
    non_upper_case_globals,
    missing_docs,
    dead_code,
    clippy::all,
    reason = "written by bindgen in Embree's own names"
)]
mod raw {
    include!(concat!(env!("OUT_DIR"), "/embree.rs"));
}

/// `RTC_INVALID_GEOMETRY_ID`, a cast that bindgen skips.
const INVALID_ID: u32 = u32::MAX;

/// Rays in one packet.
pub const PACKET: usize = 16;

/// How much time a build may take for faster rays.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum BuildQuality {
    /// Binned surface area heuristic.
    Medium,
    /// The same with spatial splits.
    High,
}

/// An Embree device: the owner of error and memory reports, shared by its scenes.
pub struct Device {
    handle: raw::RTCDevice,
    /// Boxed because Embree holds its address.
    report: Box<Report>,
}

/// What Embree's callbacks write into.
#[derive(Default)]
struct Report {
    first_error: Mutex<Option<(raw::RTCError, String)>>,
    bytes: AtomicIsize,
    /// Bytes beyond which an allocation fails; 0 is no limit.
    limit: AtomicIsize,
}

// SAFETY: Embree's device functions may be called from any thread, and `Report` is made of a mutex and atomics.
unsafe impl Send for Device {}
// SAFETY: as above.
unsafe impl Sync for Device {}

unsafe extern "C" fn on_error(report: *mut c_void, code: raw::RTCError, text: *const c_char) {
    // SAFETY: `report` is the address of the device's boxed `Report`, which outlives the device.
    let report = unsafe { &*report.cast::<Report>() };
    let text = if text.is_null() {
        String::new()
    } else {
        // SAFETY: Embree passes a string that ends in NUL and lives during the call.
        unsafe { CStr::from_ptr(text) }.to_string_lossy().into_owned()
    };
    report.first_error.lock().unwrap_or_else(PoisonError::into_inner).get_or_insert((code, text));
}

unsafe extern "C" fn on_memory(report: *mut c_void, bytes: isize, _post: bool) -> bool {
    // SAFETY: `report` is the address of the device's boxed `Report`, which outlives the device.
    let report = unsafe { &*report.cast::<Report>() };
    let total = report.bytes.fetch_add(bytes, Ordering::Relaxed) + bytes;
    let limit = report.limit.load(Ordering::Relaxed);
    bytes <= 0 || limit == 0 || total <= limit
}

fn describe(code: raw::RTCError) -> &'static str {
    match code {
        raw::RTC_ERROR_INVALID_ARGUMENT => "invalid argument",
        raw::RTC_ERROR_INVALID_OPERATION => "invalid operation",
        raw::RTC_ERROR_OUT_OF_MEMORY => "out of memory",
        raw::RTC_ERROR_UNSUPPORTED_CPU => "this CPU is not supported",
        raw::RTC_ERROR_CANCELLED => "cancelled",
        _ => "unknown error",
    }
}

/// The version of the headers this program was compiled with, as major and minor.
pub const HEADER_VERSION: (u32, u32) = (raw::RTC_VERSION_MAJOR, raw::RTC_VERSION_MINOR);

/// Whether a library of version `library` (major, minor) may serve a program compiled for the headers `header`: within a major version Embree keeps old
/// structures and functions, and adds new ones in minor versions.
///
/// # Errors
/// `Error::Device` that names both versions and what to do.
pub fn check_version(header: (u32, u32), library: (u32, u32)) -> Result<()> {
    if library.0 == header.0 && library.1 >= header.1 {
        return Ok(());
    }
    Err(Error::Device(format!(
        "lumicache was compiled for Embree {}.{}, but the library found at run time is Embree {}.{}: install Embree {}.{} or a later {0}.x \
         (Debian package libembree-dev), or compile lumicache again for this one, or choose the backend \"bvh\"",
        header.0, header.1, library.0, library.1, header.0, header.1
    )))
}

impl Device {
    /// Opens a device and checks the library's version. `options` is Embree's configuration string.
    ///
    /// # Errors
    /// `Error::Device` if the CPU lacks what Embree needs, or the library is of another version than the headers.
    pub fn new(options: &str) -> Result<Arc<Self>> {
        let options = CString::new(options).map_err(|_| Error::InvalidArgument("Embree options contain NUL".into()))?;
        // SAFETY: the string ends in NUL and lives during the call.
        let handle = unsafe { raw::rtcNewDevice(options.as_ptr()) };
        if handle.is_null() {
            // SAFETY: a null device is Embree's way to ask why the last rtcNewDevice of this thread failed.
            let code = unsafe { raw::rtcGetDeviceError(std::ptr::null_mut()) };
            return Err(Error::Device(format!("Embree cannot start: {}; choose the backend \"bvh\"", describe(code))));
        }
        let device = Self { handle, report: Box::default() };
        check_version(HEADER_VERSION, device.version_numbers())?;
        let report = (&raw const *device.report).cast_mut().cast();
        // SAFETY: the handle is valid; `report` points to a box that `device` owns and frees after the device is released.
        unsafe {
            raw::rtcSetDeviceErrorFunction(handle, Some(on_error), report);
            raw::rtcSetDeviceMemoryMonitorFunction(handle, Some(on_memory), report);
        }
        Ok(Arc::new(device))
    }

    fn property(&self, property: raw::RTCDeviceProperty) -> u32 {
        // SAFETY: the handle is valid while self lives.
        let value = unsafe { raw::rtcGetDeviceProperty(self.handle, property) };
        u32::try_from(value).unwrap_or(0)
    }

    fn version_numbers(&self) -> (u32, u32) {
        (self.property(raw::RTC_DEVICE_PROPERTY_VERSION_MAJOR), self.property(raw::RTC_DEVICE_PROPERTY_VERSION_MINOR))
    }

    /// The library's version, such as `Embree 3.13.5`.
    pub fn version(&self) -> String {
        let (major, minor) = self.version_numbers();
        format!("Embree {major}.{minor}.{}", self.property(raw::RTC_DEVICE_PROPERTY_VERSION_PATCH))
    }

    /// Bytes that Embree holds for this device now.
    pub fn memory_bytes(&self) -> usize {
        usize::try_from(self.report.bytes.load(Ordering::Relaxed)).unwrap_or(0)
    }

    /// Lets every allocation fail that would bring the device's memory beyond `bytes`.
    pub fn limit_memory(&self, bytes: usize) {
        self.report.limit.store(isize::try_from(bytes).unwrap_or(isize::MAX), Ordering::Relaxed);
    }

    /// The first error since the last call, if there was one, as `Error::Device` that begins with `what`.
    fn check(&self, what: &str) -> Result<()> {
        // SAFETY: the handle is valid while self lives. The call clears the thread's error code.
        let code = unsafe { raw::rtcGetDeviceError(self.handle) };
        let reported = self.report.first_error.lock().unwrap_or_else(PoisonError::into_inner).take();
        match reported.or((code != raw::RTC_ERROR_NONE).then(|| (code, String::new()))) {
            None => Ok(()),
            Some((code, text)) if text.is_empty() => Err(Error::Device(format!("Embree, {what}: {}", describe(code)))),
            Some((code, text)) => Err(Error::Device(format!("Embree, {what}: {} ({text})", describe(code)))),
        }
    }
}

impl Drop for Device {
    fn drop(&mut self) {
        // SAFETY: the handle is valid and this is its only release; every scene holds an Arc of the device, so none is left.
        unsafe { raw::rtcReleaseDevice(self.handle) };
    }
}

/// A scene that is being filled; [`SceneBuilder::commit`] makes it traceable.
pub struct SceneBuilder(Scene);

/// A committed scene.
pub struct Scene {
    handle: raw::RTCScene,
    /// Scenes that instances in this one refer to.
    instanced: Vec<Arc<Scene>>,
    device: Arc<Device>,
}

// SAFETY: after its commit a scene is only read, which Embree allows from any number of threads; before, it is owned by one builder.
unsafe impl Send for Scene {}
// SAFETY: as above.
unsafe impl Sync for Scene {}

impl Drop for Scene {
    fn drop(&mut self) {
        // SAFETY: the handle is valid and this is its only release; the device lives until the fields are dropped, after this.
        unsafe { raw::rtcReleaseScene(self.handle) };
    }
}

/// A geometry between its creation and the moment when its scene holds it.
struct GeometryHandle(raw::RTCGeometry);

impl Drop for GeometryHandle {
    fn drop(&mut self) {
        // SAFETY: the handle is valid and this releases the reference that rtcNewGeometry gave.
        unsafe { raw::rtcReleaseGeometry(self.0) };
    }
}

impl SceneBuilder {
    /// An empty scene with watertight intersection.
    ///
    /// # Errors
    /// `Error::Device`, when memory runs out.
    pub fn new(device: &Arc<Device>, quality: BuildQuality) -> Result<Self> {
        // SAFETY: the device is valid.
        let handle = unsafe { raw::rtcNewScene(device.handle) };
        if handle.is_null() {
            device.check("making a scene")?;
            return Err(Error::Device("Embree made no scene".into()));
        }
        let quality = match quality {
            BuildQuality::Medium => raw::RTC_BUILD_QUALITY_MEDIUM,
            BuildQuality::High => raw::RTC_BUILD_QUALITY_HIGH,
        };
        // SAFETY: the scene is valid and not yet committed.
        unsafe {
            raw::rtcSetSceneFlags(handle, raw::RTC_SCENE_FLAG_ROBUST);
            raw::rtcSetSceneBuildQuality(handle, quality);
        }
        Ok(Self(Scene { handle, instanced: Vec::new(), device: device.clone() }))
    }

    fn new_geometry(&self, kind: raw::RTCGeometryType) -> Result<GeometryHandle> {
        // SAFETY: the device is valid.
        let handle = unsafe { raw::rtcNewGeometry(self.0.device.handle, kind) };
        if handle.is_null() {
            self.0.device.check("making a geometry")?;
            return Err(Error::Device("Embree made no geometry".into()));
        }
        Ok(GeometryHandle(handle))
    }

    /// Commits `geometry` and hands it to the scene under the number `id`.
    fn attach(&self, geometry: &GeometryHandle, id: u32) -> Result<()> {
        // SAFETY: both handles are valid; the scene takes a reference of its own to the geometry.
        unsafe {
            raw::rtcCommitGeometry(geometry.0);
            raw::rtcAttachGeometryByID(self.0.handle, geometry.0, id);
        }
        self.0.device.check("adding a geometry")
    }

    /// A new buffer of `count` items of type `T` inside Embree, filled from `items`.
    fn fill<T: Copy>(
        &self,
        geometry: &GeometryHandle,
        kind: raw::RTCBufferType,
        format: raw::RTCFormat,
        items: impl ExactSizeIterator<Item = T>,
    ) -> Result<()> {
        let count = items.len();
        // SAFETY: the geometry is valid; Embree allocates `count` items of T's size, padded as it needs.
        let buffer = unsafe { raw::rtcSetNewGeometryBuffer(geometry.0, kind, 0, format, size_of::<T>(), count) }.cast::<T>();
        self.0.device.check("allocating a buffer")?;
        if buffer.is_null() {
            return Err(Error::Device("Embree gave no buffer".into()));
        }
        for (i, item) in items.take(count).enumerate() {
            // SAFETY: i < count, and Embree aligns buffers to 16 bytes or more, enough for three floats or integers.
            unsafe { buffer.add(i).write(item) };
        }
        Ok(())
    }

    /// Adds triangles under the number `id`, which hits give back as their instance.
    ///
    /// # Errors
    /// `Error::InvalidArgument` if an index is beyond the positions; `Error::Device` when memory runs out or `id` is taken.
    pub fn add_triangles(
        &mut self,
        id: u32,
        positions: impl ExactSizeIterator<Item = [f32; 3]>,
        indices: &[[u32; 3]],
    ) -> Result<()> {
        let vertices = positions.len();
        if indices.iter().flatten().any(|&i| i as usize >= vertices) {
            return Err(Error::InvalidArgument(format!("instance {id}: a vertex index is beyond its {vertices} vertices")));
        }
        let geometry = self.new_geometry(raw::RTC_GEOMETRY_TYPE_TRIANGLE)?;
        self.fill(&geometry, raw::RTC_BUFFER_TYPE_VERTEX, raw::RTC_FORMAT_FLOAT3, positions)?;
        self.fill(&geometry, raw::RTC_BUFFER_TYPE_INDEX, raw::RTC_FORMAT_UINT3, indices.iter().copied())?;
        self.attach(&geometry, id)
    }

    /// Adds a placement of `scene` under the number `id`, which hits give back as their instance.
    ///
    /// `to_world` holds the columns x, y, z and translation.
    ///
    /// # Errors
    /// `Error::Device` when memory runs out or `id` is taken.
    pub fn add_instance(&mut self, id: u32, scene: &Arc<Scene>, to_world: &[f32; 12]) -> Result<()> {
        let geometry = self.new_geometry(raw::RTC_GEOMETRY_TYPE_INSTANCE)?;
        // SAFETY: geometry and scene are valid, the matrix has the 12 floats that the format promises and is copied; the instanced scene is kept alive
        // by `instanced`.
        unsafe {
            raw::rtcSetGeometryInstancedScene(geometry.0, scene.handle);
            raw::rtcSetGeometryTransform(geometry.0, 0, raw::RTC_FORMAT_FLOAT3X4_COLUMN_MAJOR, to_world.as_ptr().cast());
        }
        self.0.instanced.push(scene.clone());
        self.attach(&geometry, id)
    }

    /// Builds the hierarchy.
    ///
    /// # Errors
    /// `Error::Device` when memory runs out.
    pub fn commit(self) -> Result<Scene> {
        // SAFETY: the scene is valid and only this thread has it.
        unsafe { raw::rtcCommitScene(self.0.handle) };
        self.0.device.check("building the hierarchy")?;
        Ok(self.0)
    }
}

/// How options reach the ray functions: the one place where Embree 3 and 4 differ.
mod query {
    use super::raw;

    #[cfg(not(embree4))]
    mod version {
        use super::super::INVALID_ID;
        use super::raw;

        /// Embree 3 passes options in a context, which it also writes to: one per call.
        fn context(coherent: bool) -> raw::RTCIntersectContext {
            raw::RTCIntersectContext {
                flags: if coherent {
                    raw::RTC_INTERSECT_CONTEXT_FLAG_COHERENT
                } else {
                    raw::RTC_INTERSECT_CONTEXT_FLAG_INCOHERENT
                },
                filter: None,
                instID: [INVALID_ID],
            }
        }

        pub unsafe fn intersect1(scene: raw::RTCScene, ray: &mut raw::RTCRayHit) {
            // SAFETY: the caller passes a committed scene and an initialised ray.
            unsafe { raw::rtcIntersect1(scene, &mut context(false), ray) }
        }

        pub unsafe fn occluded1(scene: raw::RTCScene, ray: &mut raw::RTCRay) {
            // SAFETY: the caller passes a committed scene and an initialised ray.
            unsafe { raw::rtcOccluded1(scene, &mut context(false), ray) }
        }

        pub unsafe fn intersect16(valid: &super::Valid, scene: raw::RTCScene, rays: &mut raw::RTCRayHit16, coherent: bool) {
            // SAFETY: the caller passes a committed scene and rays initialised where `valid`, which is aligned to 64 bytes.
            unsafe { raw::rtcIntersect16(valid.0.as_ptr(), scene, &mut context(coherent), rays) }
        }

        pub unsafe fn occluded16(valid: &super::Valid, scene: raw::RTCScene, rays: &mut raw::RTCRay16) {
            // SAFETY: the caller passes a committed scene and rays initialised where `valid`, which is aligned to 64 bytes.
            unsafe { raw::rtcOccluded16(valid.0.as_ptr(), scene, &mut context(false), rays) }
        }
    }

    #[cfg(embree4)]
    mod version {
        use super::raw;

        /// The only kinds of geometry in our scenes.
        const FEATURES: raw::RTCFeatureFlags = raw::RTC_FEATURE_FLAG_TRIANGLE | raw::RTC_FEATURE_FLAG_INSTANCE;

        fn intersect_arguments(coherent: bool) -> raw::RTCIntersectArguments {
            raw::RTCIntersectArguments {
                flags: if coherent { raw::RTC_RAY_QUERY_FLAG_COHERENT } else { raw::RTC_RAY_QUERY_FLAG_INCOHERENT },
                feature_mask: FEATURES,
                context: std::ptr::null_mut(),
                filter: None,
                intersect: None,
            }
        }

        fn occluded_arguments() -> raw::RTCOccludedArguments {
            raw::RTCOccludedArguments {
                flags: raw::RTC_RAY_QUERY_FLAG_INCOHERENT,
                feature_mask: FEATURES,
                context: std::ptr::null_mut(),
                filter: None,
                occluded: None,
            }
        }

        pub unsafe fn intersect1(scene: raw::RTCScene, ray: &mut raw::RTCRayHit) {
            // SAFETY: the caller passes a committed scene and an initialised ray.
            unsafe { raw::rtcIntersect1(scene, ray, &mut intersect_arguments(false)) }
        }

        pub unsafe fn occluded1(scene: raw::RTCScene, ray: &mut raw::RTCRay) {
            // SAFETY: the caller passes a committed scene and an initialised ray.
            unsafe { raw::rtcOccluded1(scene, ray, &mut occluded_arguments()) }
        }

        pub unsafe fn intersect16(valid: &super::Valid, scene: raw::RTCScene, rays: &mut raw::RTCRayHit16, coherent: bool) {
            // SAFETY: the caller passes a committed scene and rays initialised where `valid`, which is aligned to 64 bytes.
            unsafe { raw::rtcIntersect16(valid.0.as_ptr(), scene, rays, &mut intersect_arguments(coherent)) }
        }

        pub unsafe fn occluded16(valid: &super::Valid, scene: raw::RTCScene, rays: &mut raw::RTCRay16) {
            // SAFETY: the caller passes a committed scene and rays initialised where `valid`, which is aligned to 64 bytes.
            unsafe { raw::rtcOccluded16(valid.0.as_ptr(), scene, rays, &mut occluded_arguments()) }
        }
    }

    pub use version::{intersect1, intersect16, occluded1, occluded16};

    /// The rays of a packet that take part: -1 or 0 each.
    #[repr(align(64))]
    pub struct Valid(pub [i32; super::PACKET]);
}

/// The ray in Embree's single form.
fn single(ray: &Ray) -> raw::RTCRay {
    raw::RTCRay {
        org_x: ray.origin.x,
        org_y: ray.origin.y,
        org_z: ray.origin.z,
        tnear: ray.tmin,
        dir_x: ray.dir.x,
        dir_y: ray.dir.y,
        dir_z: ray.dir.z,
        time: 0.0,
        tfar: ray.tmax,
        mask: u32::MAX,
        id: 0,
        flags: 0,
    }
}

/// Writes `rays`, at most [`PACKET`] of them, to the lanes of a packet and returns which lanes take part: the valid ones. Debian compiles Embree with its
/// assertions, and one of them would end the process at a ray that is not a number.
fn gather(rays: &[Ray], packet: &mut raw::RTCRay16) -> query::Valid {
    let mut valid = query::Valid([0; PACKET]);
    for (i, ray) in rays.iter().enumerate() {
        valid.0[i] = -i32::from(ray.is_valid());
        packet.org_x[i] = ray.origin.x;
        packet.org_y[i] = ray.origin.y;
        packet.org_z[i] = ray.origin.z;
        packet.tnear[i] = ray.tmin;
        packet.dir_x[i] = ray.dir.x;
        packet.dir_y[i] = ray.dir.y;
        packet.dir_z[i] = ray.dir.z;
        packet.tfar[i] = ray.tmax;
    }
    valid
}

/// Our numbers of a hit: an instance geometry has its own number, a world-space geometry is numbered by its instance.
#[inline]
fn hit(t: f32, u: f32, v: f32, triangle: u32, geometry: u32, instance: u32) -> Hit {
    if geometry == INVALID_ID {
        return Hit::MISS;
    }
    Hit { t, u, v, instance: if instance == INVALID_ID { geometry } else { instance }, triangle }
}

impl Scene {
    /// The device that the scene belongs to.
    pub fn device(&self) -> &Device {
        &self.device
    }

    /// The closest hit of one ray.
    #[inline]
    pub fn intersect(&self, ray: &Ray) -> Hit {
        if !ray.is_valid() {
            return Hit::MISS;
        }
        let mut query = raw::RTCRayHit { ray: single(ray), ..Default::default() };
        query.hit.geomID = INVALID_ID;
        query.hit.instID = [INVALID_ID];
        // SAFETY: the scene is committed, the ray initialised.
        unsafe { query::intersect1(self.handle, &mut query) };
        hit(query.ray.tfar, query.hit.u, query.hit.v, query.hit.primID, query.hit.geomID, query.hit.instID[0])
    }

    /// Whether anything is on one ray.
    #[inline]
    pub fn occluded(&self, ray: &Ray) -> bool {
        if !ray.is_valid() {
            return false;
        }
        let mut query = single(ray);
        // SAFETY: the scene is committed, the ray initialised.
        unsafe { query::occluded1(self.handle, &mut query) };
        query.tfar == f32::NEG_INFINITY
    }

    /// The closest hits of many rays, in packets of [`PACKET`] consecutive ones. `coherent` promises that neighbours are nearly parallel.
    pub fn intersect_packets(&self, rays: &[Ray], coherent: bool, hits: &mut [Hit]) {
        let mut packet = raw::RTCRayHit16::default();
        packet.ray.mask = [u32::MAX; PACKET];
        for (rays, hits) in rays.chunks(PACKET).zip(hits.chunks_mut(PACKET)) {
            let valid = gather(rays, &mut packet.ray);
            packet.hit.geomID = [INVALID_ID; PACKET];
            packet.hit.instID = [[INVALID_ID; PACKET]];
            // SAFETY: the scene is committed, the rays that `valid` names initialised.
            unsafe { query::intersect16(&valid, self.handle, &mut packet, coherent) };
            let (ray, found) = (&packet.ray, &packet.hit);
            for (i, out) in hits.iter_mut().enumerate() {
                *out = hit(ray.tfar[i], found.u[i], found.v[i], found.primID[i], found.geomID[i], found.instID[0][i]);
            }
        }
    }

    /// Whether anything is on each of many rays, in packets of [`PACKET`] consecutive ones.
    pub fn occluded_packets(&self, rays: &[Ray], blocked: &mut [bool]) {
        let mut packet = raw::RTCRay16 { mask: [u32::MAX; PACKET], ..Default::default() };
        for (rays, blocked) in rays.chunks(PACKET).zip(blocked.chunks_mut(PACKET)) {
            let valid = gather(rays, &mut packet);
            // SAFETY: the scene is committed, the rays that `valid` names initialised.
            unsafe { query::occluded16(&valid, self.handle, &mut packet) };
            for (out, tfar) in blocked.iter_mut().zip(packet.tfar) {
                *out = tfar == f32::NEG_INFINITY;
            }
        }
    }
}

/// Rays that are laid out for [`Scene::trace_packets`].
pub struct Packets(Vec<raw::RTCRayHit16>);

impl Packets {
    /// Lays out whole packets of `rays`; rays beyond the last whole packet, and packets with an invalid ray, are left out.
    pub fn new(rays: &[Ray]) -> Self {
        let lay_out = |rays: &[Ray]| {
            let mut packet = raw::RTCRayHit16::default();
            packet.ray.mask = [u32::MAX; PACKET];
            packet.hit.geomID = [INVALID_ID; PACKET];
            packet.hit.instID = [[INVALID_ID; PACKET]];
            gather(rays, &mut packet.ray).0.iter().all(|&v| v != 0).then_some(packet)
        };
        Self(rays.chunks_exact(PACKET).filter_map(lay_out).collect())
    }
}

impl Scene {
    /// Traces packets where they lie, with nothing between the calls of Embree: the measure of what [`Scene::intersect_packets`] adds.
    pub fn trace_packets(&self, packets: &mut Packets) {
        let valid = query::Valid([-1; PACKET]);
        for packet in &mut packets.0 {
            // SAFETY: the scene is committed, all rays of the packet are initialised and valid.
            unsafe { query::intersect16(&valid, self.handle, packet, false) };
        }
    }
}
