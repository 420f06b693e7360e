//! Scenes: filled by a builder, then committed.

use super::device::Device;
use super::raw;
use crate::error::{Error, Result};
use std::sync::Arc;

/// A scene that is being filled; [`SceneBuilder::commit`] makes it traceable.
pub struct SceneBuilder(Scene);

/// A committed scene.
pub struct Scene {
    pub(super) handle: raw::RTCScene,
    /// Rays in a packet of this CPU: 16 with AVX-512, else 8.
    pub(super) width: usize,
    /// Scenes that instances in this one refer to.
    instanced: Vec<Arc<Scene>>,
    device: Arc<Device>,
}

// SAFETY: after its commit a scene is only read, which Embree allows from any number of threads;
// before, it is owned by one builder.
unsafe impl Send for Scene {}
// SAFETY: as above.
unsafe impl Sync for Scene {}

impl Drop for Scene {
    fn drop(&mut self) {
        // SAFETY: the handle is valid and this is its only release; the device lives until the
        // fields are dropped, after this.
        unsafe { rtc!(rtcReleaseScene; self.handle) };
    }
}

impl Scene {
    /// The device that the scene belongs to.
    pub fn device(&self) -> &Device {
        &self.device
    }
}

/// A geometry between its creation and the moment when its scene holds it.
struct GeometryHandle(raw::RTCGeometry);

impl Drop for GeometryHandle {
    fn drop(&mut self) {
        // SAFETY: the handle is valid and this releases the reference that rtcNewGeometry gave.
        unsafe { rtc!(rtcReleaseGeometry; self.0) };
    }
}

impl SceneBuilder {
    /// An empty scene with watertight intersection (Embree's robust mode). The build quality is
    /// medium: in robust mode, high makes the same hierarchy.
    ///
    /// # Errors
    /// `Error::OutOfMemory`.
    pub fn new(device: &Arc<Device>) -> Result<Self> {
        // SAFETY: the device is valid.
        let handle = unsafe { rtc!(rtcNewScene; device.handle) };
        if handle.is_null() {
            device.check("making a scene")?;
            return Err(Error::Device("Embree made no scene".into()));
        }
        // SAFETY: the scene is valid and not yet committed.
        unsafe {
            rtc!(rtcSetSceneFlags; handle, raw::RTC_SCENE_FLAG_ROBUST);
            rtc!(rtcSetSceneBuildQuality; handle, raw::RTC_BUILD_QUALITY_MEDIUM);
        }
        let width = if device.property(raw::RTC_DEVICE_PROPERTY_NATIVE_RAY16_SUPPORTED) == 1 {
            16
        } else {
            8
        };
        Ok(Self(Scene { handle, width, instanced: Vec::new(), device: device.clone() }))
    }

    fn new_geometry(&self, kind: raw::RTCGeometryType) -> Result<GeometryHandle> {
        // SAFETY: the device is valid.
        let handle = unsafe { rtc!(rtcNewGeometry; self.0.device.handle, kind) };
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
            rtc!(rtcCommitGeometry; geometry.0);
            rtc!(rtcAttachGeometryByID; self.0.handle, geometry.0, id);
        }
        self.0.device.check("adding a geometry")
    }

    /// A new buffer of `count` items of type `T` inside Embree, filled from `items`.
    fn fill<T: Copy>(
        &self, geometry: &GeometryHandle, kind: raw::RTCBufferType, format: raw::RTCFormat,
        items: impl ExactSizeIterator<Item = T>,
    ) -> Result<()> {
        let count = items.len();
        // SAFETY: the geometry is valid; Embree allocates `count` items of T's size, padded as it
        // needs.
        let buffer = unsafe {
            rtc!(rtcSetNewGeometryBuffer; geometry.0, kind, 0, format, size_of::<T>(), count)
        }
        .cast::<T>();
        self.0.device.check("allocating a buffer")?;
        if buffer.is_null() {
            return Err(Error::Device("Embree gave no buffer".into()));
        }
        for (i, item) in items.take(count).enumerate() {
            // SAFETY: i < count, and Embree aligns buffers to 16 bytes or more, enough for three
            // floats or integers.
            unsafe { buffer.add(i).write(item) };
        }
        Ok(())
    }

    /// Adds triangles under the number `id`, which hits give back as their instance.
    ///
    /// # Errors
    /// `Error::InvalidArgument` if an index is beyond the positions; `Error::OutOfMemory`;
    /// `Error::Device` when `id` is taken.
    pub fn add_triangles(
        &mut self, id: u32, positions: impl ExactSizeIterator<Item = [f32; 3]>,
        indices: &[[u32; 3]],
    ) -> Result<()> {
        let vertices = positions.len();
        if indices.iter().flatten().any(|&i| i as usize >= vertices) {
            return Err(Error::InvalidArgument(format!(
                "instance {id}: a vertex index is beyond its {vertices} vertices"
            )));
        }
        let geometry = self.new_geometry(raw::RTC_GEOMETRY_TYPE_TRIANGLE)?;
        self.fill(&geometry, raw::RTC_BUFFER_TYPE_VERTEX, raw::RTC_FORMAT_FLOAT3, positions)?;
        self.fill(
            &geometry,
            raw::RTC_BUFFER_TYPE_INDEX,
            raw::RTC_FORMAT_UINT3,
            indices.iter().copied(),
        )?;
        self.attach(&geometry, id)
    }

    /// Adds a placement of `scene` under the number `id`, which hits give back as their instance.
    ///
    /// `to_world` holds the columns x, y, z and translation.
    ///
    /// # Errors
    /// `Error::OutOfMemory`; `Error::Device` when `id` is taken.
    pub fn add_instance(
        &mut self, id: u32, scene: &Arc<Scene>, to_world: &[f32; 12],
    ) -> Result<()> {
        let geometry = self.new_geometry(raw::RTC_GEOMETRY_TYPE_INSTANCE)?;
        // SAFETY: geometry and scene are valid, the matrix has the 12 floats that the format
        // promises and is copied; the instanced scene is kept alive by `instanced`.
        unsafe {
            rtc!(rtcSetGeometryInstancedScene; geometry.0, scene.handle);
            rtc!(rtcSetGeometryTransform; geometry.0, 0, raw::RTC_FORMAT_FLOAT3X4_COLUMN_MAJOR, to_world.as_ptr().cast());
        }
        self.0.instanced.push(scene.clone());
        self.attach(&geometry, id)
    }

    /// Builds the hierarchy, with TBB's threads.
    ///
    /// # Errors
    /// `Error::OutOfMemory`.
    pub fn commit(self) -> Result<Scene> {
        // SAFETY: the scene is valid and only this thread has it.
        unsafe { rtc!(rtcCommitScene; self.0.handle) };
        self.0.device.check("building the hierarchy")?;
        Ok(self.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ffi::ray::{Hit, Ray};
    use crate::math::Vec3;

    /// A scene of one square of `n` x `n` pairs of triangles in the plane z = 0.
    fn square(device: &Arc<Device>, n: u32) -> Result<Scene> {
        let mut scene = SceneBuilder::new(device)?;
        let at = |i: u32| i as f32 / n as f32;
        let positions = (0..(n + 1) * (n + 1)).map(|i| [at(i % (n + 1)), at(i / (n + 1)), 0.0]);
        let corners = (0..n * n).map(|i| i / n * (n + 1) + i % n);
        let indices: Vec<_> =
            corners.flat_map(|a| [[a, a + 1, a + n + 2], [a, a + n + 2, a + n + 1]]).collect();
        scene.add_triangles(7, positions.collect::<Vec<_>>().into_iter(), &indices)?;
        scene.commit()
    }

    fn downwards(x: f32, y: f32) -> Ray {
        Ray::new(Vec3::new(x, y, 2.0), Vec3::NEG_Z)
    }

    #[test]
    fn running_out_of_memory_is_an_error() {
        let device = Device::new("").unwrap();
        device.limit_memory(1 << 20);
        let error = square(&device, 300).err().unwrap();
        assert!(matches!(error, Error::OutOfMemory(_)), "{error}");
        // The device works again when there is memory, and has given back what the failed scene
        // held.
        assert!(device.memory_bytes() < 1 << 16, "{}", device.memory_bytes());
        device.limit_memory(1 << 30);
        assert!(square(&device, 300).unwrap().intersect(&downwards(0.3, 0.6)).is_hit());
    }

    #[test]
    fn memory_is_counted_and_given_back() {
        let device = Device::new("").unwrap();
        let scene = square(&device, 100).unwrap();
        assert!(device.memory_bytes() > 20_000 * 40, "{}", device.memory_bytes());
        drop(scene);
        assert!(device.memory_bytes() < 1 << 16, "{}", device.memory_bytes());
    }

    #[test]
    fn a_scene_outlives_the_caller_s_device_and_its_parts() {
        let instance_scene = {
            let device = Device::new("").unwrap();
            let part = Arc::new(square(&device, 4).unwrap());
            let mut scene = SceneBuilder::new(&device).unwrap();
            scene
                .add_instance(
                    3,
                    &part,
                    &[1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 1.0],
                )
                .unwrap();
            scene.commit().unwrap()
        };
        let hit = instance_scene.intersect(&downwards(0.3, 0.6));
        assert_eq!((hit.t, hit.instance), (1.0, 3));
    }

    #[test]
    fn packets_of_every_cpu_generation_hit_the_same() {
        let rays: Vec<_> = (0..5_003)
            .map(|i| downwards(i as f32 * 2.3e-4 - 0.05, (i as f32 * 0.618).fract()))
            .collect();
        let mut results = Vec::new();
        // A CPU without one of these refuses the device.
        for options in ["isa=sse2", "isa=sse4.2", "isa=avx", "isa=avx2", "isa=avx512"] {
            let Ok(device) = Device::new(options) else { continue };
            let scene = square(&device, 20).unwrap();
            let mut hits = vec![Hit::MISS; rays.len()];
            let mut blocked = vec![false; rays.len()];
            scene.intersect_packets(&rays, false, &mut hits);
            scene.occluded_packets(&rays, &mut blocked);
            assert!(
                hits.iter().zip(&blocked).all(|(hit, &blocked)| hit.is_hit() == blocked),
                "{options}"
            );
            results.push((options, hits));
        }
        // With and without fused multiplication the last bits differ.
        for (options, hits) in &results {
            let same = |a: &Hit, b: &Hit| {
                a.is_hit() == b.is_hit() && (!a.is_hit() || (a.t - b.t).abs() < 1e-5)
            };
            assert!(
                hits.iter().zip(&results[0].1).all(|(a, b)| same(a, b)),
                "{options} differs from {}",
                results[0].0
            );
            assert!(hits.iter().filter(|hit| hit.is_hit()).count() > 4_000, "{options}");
        }
    }

    #[test]
    fn errors_of_embree_become_ours() {
        let device = Device::new("").unwrap();
        let part = Arc::new(square(&device, 2).unwrap());
        let mut scene = SceneBuilder::new(&device).unwrap();
        let unit = [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0];
        scene.add_instance(5, &part, &unit).unwrap();
        let text = scene.add_instance(5, &part, &unit).err().unwrap().to_string();
        assert!(text.starts_with("Embree, adding a geometry: "), "{text}");
        assert!(
            scene
                .add_triangles(6, [[0.0; 3]; 2].into_iter(), &[[0, 1, 2]])
                .unwrap_err()
                .to_string()
                .contains("beyond its 2 vertices")
        );
        assert!(scene.commit().is_ok(), "an error is told once");
    }
}
