//! Scenes: described piece by piece, read from a file, or kept by the host; then committed.

use super::abi::{
    Input, LUMI_VIEW_SHARED, Output, copy_text, lumi_device, lumi_host_desc, lumi_light_desc,
    lumi_material_desc, lumi_mesh_desc, lumi_scene, lumi_scene_info, lumi_scene_s,
    lumi_texture_desc, lumi_trace_desc, read, write,
};
use super::describe;
use super::device::DeviceObject;
use super::handles::{Kind, borrow, clear, publish, release, retain};
use super::host::host_of;
use super::status::{Fault, Outcome, Touched, ensure, guard, guard_void, lock, lumi_error, state};
use crate::accel::Ray;
use crate::geometry::{Aabb, Instance, TriangleMesh};
use crate::hosted::Host;
use crate::math::{Affine3A, Vec3};
use crate::scene::{Scene, SceneData};
use glam::DVec3;
use std::collections::BTreeMap;
use std::ffi::c_char;
use std::sync::{Arc, Mutex, MutexGuard, OnceLock};

/// Who keeps a committed scene.
pub(super) enum SceneKind {
    Own(Box<Scene>),
    Host(Host),
}

/// A committed scene.
pub(super) struct Committed {
    pub kind: SceneKind,
    /// Hashes of its parts, for cache files.
    pub hashes: BTreeMap<String, String>,
    /// All of them in one, hexadecimal.
    pub hash: String,
    pub bounds: Aabb,
}

impl Committed {
    /// Length of the diagonal.
    pub fn size(&self) -> f32 {
        match &self.kind {
            SceneKind::Own(scene) => scene.size(),
            SceneKind::Host(host) => host.bounds.diagonal(),
        }
    }

    /// Where the zero of the scene's coordinates lies in the world.
    pub fn origin(&self) -> DVec3 {
        match &self.kind {
            SceneKind::Own(scene) => scene.origin(),
            SceneKind::Host(_) => DVec3::ZERO,
        }
    }

    /// A position of the scene in the world.
    pub fn to_world(&self, position: Vec3) -> Vec3 {
        (position.as_dvec3() + self.origin()).as_vec3()
    }

    /// The host, if it keeps the scene.
    pub fn host(&self) -> Option<&Host> {
        match &self.kind {
            SceneKind::Own(_) => None,
            SceneKind::Host(host) => Some(host),
        }
    }
}

/// A mesh as it was described.
enum Described {
    Ready(Vec<TriangleMesh>),
    /// Its buffers are read by the commit, and some of them from then on.
    Shared(lumi_mesh_desc),
}

// SAFETY: the pointers of a shared mesh are only read; the host keeps the buffers unchanged.
unsafe impl Send for Described {}

/// A scene while it is described.
#[derive(Default)]
pub(super) struct Draft {
    /// What a file brought, and materials, textures and lights.
    pub data: SceneData,
    meshes: Vec<Described>,
    /// Mesh and placement.
    instances: Vec<(u32, Affine3A)>,
    host: Option<Host>,
}

impl Draft {
    /// True without meshes, materials and textures.
    pub fn is_bare(&self) -> bool {
        self.meshes.is_empty()
            && self.data.geometry.meshes.is_empty()
            && self.data.materials.is_empty()
            && self.data.textures.is_empty()
    }
}

/// A scene.
pub(super) struct SceneObject {
    pub touched: Touched,
    pub device: Arc<DeviceObject>,
    draft: Mutex<Draft>,
    committed: OnceLock<Committed>,
}

impl Kind for SceneObject {
    type Opaque = lumi_scene_s;
    const NAME: &'static str = "scene";
    fn touched(&self) -> &Touched {
        &self.touched
    }
}

impl SceneObject {
    /// The committed scene.
    pub fn committed(&self) -> Outcome<&Committed> {
        self.committed.get().ok_or_else(|| Fault::operation("the scene is not committed"))
    }

    /// The scene, if it is our own.
    pub fn own(&self) -> Outcome<&Scene> {
        match &self.committed()?.kind {
            SceneKind::Own(scene) => Ok(scene),
            SceneKind::Host(_) => Err(Fault::operation(
                "the host keeps this scene: the library cannot trace it by itself",
            )),
        }
    }

    /// The draft of a scene of our own.
    pub fn draft(&self) -> Outcome<MutexGuard<'_, Draft>> {
        let draft = lock(&self.draft);
        let open = self.committed.get().is_none();
        state(open, "the scene is committed: it cannot change any more")?;
        let ours = draft.host.is_none();
        state(ours, "the host keeps this scene: nothing can be added to it")?;
        Ok(draft)
    }

    fn commit(&self) -> Outcome {
        let mut draft = lock(&self.draft);
        state(self.committed.get().is_none(), "the scene is committed already")?;
        let committed = match draft.host.take() {
            Some(host) => {
                let hash = format!("{:016x}", host.scene_hash);
                let hashes = BTreeMap::from([("scene of the host".to_owned(), hash.clone())]);
                Committed { bounds: host.bounds, kind: SceneKind::Host(host), hashes, hash }
            }
            None => {
                let draft: &mut Draft = &mut draft;
                self.device.pool.install(|| build(draft, &self.device))?
            }
        };
        // The draft's lock makes this thread the only one here.
        let _ = self.committed.set(committed);
        *draft = Draft::default();
        Ok(())
    }
}

/// The committed scene of a draft; the draft stays usable if that fails.
fn build(draft: &mut Draft, device: &DeviceObject) -> Outcome<Committed> {
    let mut data = draft.data.clone();
    // Meshes of a file come first and are placed already.
    let mut numbers = Vec::with_capacity(draft.meshes.len());
    for (id, mesh) in draft.meshes.iter().enumerate() {
        let parts = match mesh {
            Described::Ready(parts) => parts.clone(),
            Described::Shared(desc) => describe::meshes(desc, data.materials.len())
                .map_err(|f| Fault::new(f.code, format!("mesh {id}: {}", f.message)))?,
        };
        let first = data.geometry.meshes.len() as u32;
        numbers.push(first..first + parts.len() as u32);
        data.geometry.meshes.extend(parts.into_iter().map(Arc::new));
    }
    let of_file = !data.geometry.instances.is_empty();
    for (mesh, to_world) in &draft.instances {
        let mut to_world = *to_world;
        to_world.translation = (to_world.translation.as_dvec3() - data.origin).as_vec3a();
        data.geometry
            .instances
            .extend(numbers[*mesh as usize].clone().map(|mesh| Instance { mesh, to_world }));
    }
    if !of_file {
        data.recenter();
    }
    let (scene, warnings) = Scene::new(data, device.backend)?;
    let (hashes, hash) = (scene.hashes().clone(), scene.hash());
    warnings.iter().for_each(|w| device.warn(w));
    let scene = scene.with_tables(device.tables.clone());
    Ok(Committed { bounds: scene.bounds(), kind: SceneKind::Own(Box::new(scene)), hashes, hash })
}

/// Makes an empty scene; the caller owns a reference to it. Describe the scene or read it from a
/// file, then commit it.
///
/// Threads: any.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn lumi_scene_new(device: lumi_device, out: *mut lumi_scene) -> lumi_error {
    guard("lumi_scene_new", || {
        clear(out)?;
        let device = borrow::<DeviceObject>(device)?.arc();
        let (touched, draft, committed) = (device.touched.child(), <_>::default(), <_>::default());
        publish(SceneObject { touched, device, draft, committed }, out)
    })
}

/// Adds a reference.
///
/// Threads: any.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn lumi_scene_retain(scene: lumi_scene) {
    guard_void("lumi_scene_retain", || retain::<SceneObject>(scene));
}

/// Drops a reference. Caches keep their scene. NULL is ignored.
///
/// Threads: any.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn lumi_scene_release(scene: lumi_scene) {
    guard_void("lumi_scene_release", || release::<SceneObject>(scene));
}

/// Changes the draft of a scene that is not committed.
fn change(scene: lumi_scene, f: impl FnOnce(&mut Draft) -> Outcome) -> Outcome {
    f(&mut *borrow::<SceneObject>(scene)?.draft()?)
}

/// Adds `item` to `items` and gives the host its number.
fn add<T>(items: &mut Vec<T>, item: T, id: *mut u32) -> Outcome {
    items.push(item);
    if !id.is_null() {
        // SAFETY: the caller passes NULL or the address of a number.
        unsafe { id.write(items.len() as u32 - 1) };
    }
    Ok(())
}

/// Adds a mesh and gives its number, from 0. lumi_scene_add_instance places the mesh.
///
/// `id`: receives the number; may be NULL.
///
/// Threads: one per scene. Buffers are copied, unless their view says LUMI_VIEW_SHARED.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn lumi_scene_add_mesh(
    scene: lumi_scene, mesh: *const lumi_mesh_desc, id: *mut u32,
) -> lumi_error {
    guard("lumi_scene_add_mesh", || {
        change(scene, |draft| {
            let desc = read(mesh, "the mesh")?;
            let mesh = if describe::views(&desc).iter().any(|v| v.flags & LUMI_VIEW_SHARED != 0) {
                Described::Shared(desc)
            } else {
                Described::Ready(describe::meshes(&desc, draft.data.materials.len())?)
            };
            add(&mut draft.meshes, mesh, id)
        })
    })
}

/// Places a mesh that lumi_scene_add_mesh has numbered.
///
/// `to_world`: 12 floats: the x, y and z axis and the origin of the mesh in the world, three each;
/// may mirror. NULL: no transform.
///
/// Threads: one per scene.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn lumi_scene_add_instance(
    scene: lumi_scene, mesh: u32, to_world: *const f32,
) -> lumi_error {
    guard("lumi_scene_add_instance", || {
        change(scene, |draft| {
            let count = draft.meshes.len();
            ensure!((mesh as usize) < count, "there is no mesh {mesh}: there are {count}");
            let to_world = match Input::<f32, 12>::new(to_world, 1, 0, "to_world")? {
                Some(floats) => describe::transform(&floats.get(0), "to_world")?,
                None => Affine3A::IDENTITY,
            };
            draft.instances.push((mesh, to_world));
            Ok(())
        })
    })
}

/// Fills `material` with the defaults: diffuse grey of albedo 0.8 under a dielectric of roughness
/// 0.5, no textures.
///
/// `material`: its struct_size is set too.
///
/// Threads: any.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn lumi_material_init(material: *mut lumi_material_desc) -> lumi_error {
    guard("lumi_material_init", || {
        ensure!(!material.is_null(), "the material is NULL");
        // SAFETY: not NULL; the caller passes room for the first version of the struct, which is
        // what is written.
        unsafe { material.write_unaligned(describe::default_material()) };
        Ok(())
    })
}

/// Adds a material and gives its number, from 0.
///
/// `id`: receives the number; may be NULL.
///
/// Threads: one per scene.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn lumi_scene_add_material(
    scene: lumi_scene, material: *const lumi_material_desc, id: *mut u32,
) -> lumi_error {
    guard("lumi_scene_add_material", || {
        change(scene, |draft| {
            let textures = draft.data.textures.len();
            let material = describe::material(&read(material, "the material")?, textures)?;
            add(&mut draft.data.materials, material, id)
        })
    })
}

/// Adds a texture and gives its number, from 0. Its pixels are copied.
///
/// `id`: receives the number; may be NULL.
///
/// Threads: one per scene.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn lumi_scene_add_texture(
    scene: lumi_scene, texture: *const lumi_texture_desc, id: *mut u32,
) -> lumi_error {
    guard("lumi_scene_add_texture", || {
        change(scene, |draft| {
            let texture = describe::texture(&read(texture, "the texture")?)?;
            add(&mut draft.data.textures, texture, id)
        })
    })
}

/// Adds a point, spot or directional light.
///
/// Threads: one per scene.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn lumi_scene_add_light(
    scene: lumi_scene, light: *const lumi_light_desc,
) -> lumi_error {
    guard("lumi_scene_add_light", || {
        change(scene, |draft| {
            let mut light = describe::light(&read(light, "the light")?)?;
            light.shift(-draft.data.origin);
            draft.data.punctual.push(light);
            Ok(())
        })
    })
}

/// Sets the light from infinity, an equirectangular map. A map of one pixel is a uniform
/// environment.
///
/// `rgb`: 3 * width * height floats, row by row from the zenith (+y); copied. NaN and negative
/// values count as 0. NULL: no environment. `to_map`: 9 floats, the columns of the rotation from
/// the world to the map; NULL: none; the middle column of the map lies along +x then, and +z to its
/// right.
///
/// Threads: one per scene.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn lumi_scene_set_environment(
    scene: lumi_scene, rgb: *const f32, width: u32, height: u32, to_map: *const f32,
) -> lumi_error {
    guard("lumi_scene_set_environment", || {
        change(scene, |draft| {
            draft.data.environment = describe::environment(rgb, width, height, to_map)?;
            Ok(())
        })
    })
}

/// Says that the host keeps geometry and shading. The scene must be empty and stays empty.
///
/// Threads: one per scene. `host->user` must stay valid until the last cache of the scene is
/// released.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn lumi_scene_set_host(
    scene: lumi_scene, host: *const lumi_host_desc,
) -> lumi_error {
    guard("lumi_scene_set_host", || {
        change(scene, |draft| {
            let dark = draft.data.punctual.is_empty() && draft.data.environment.is_none();
            let empty = dark && draft.is_bare();
            state(empty, "the scene has geometry, materials or lights: it is not the host's")?;
            draft.host = Some(host_of(&read(host, "the host")?)?);
            Ok(())
        })
    })
}

/// Makes the scene ready for rays and caches; it cannot change afterwards. After a failure the
/// scene is as before. A scene without any light gets a neutral dome, and the log says so.
///
/// Threads: one per scene; the work is done on the device's threads.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn lumi_scene_commit(scene: lumi_scene) -> lumi_error {
    guard("lumi_scene_commit", || borrow::<SceneObject>(scene)?.commit())
}

fn c_text<const N: usize>(text: &str) -> [c_char; N] {
    let mut out = [0; N];
    copy_text(text, &mut out[..N - 1]);
    out
}

/// Facts about a committed scene.
///
/// Threads: any.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn lumi_scene_get_info(
    scene: lumi_scene, info: *mut lumi_scene_info,
) -> lumi_error {
    guard("lumi_scene_get_info", || {
        let scene = borrow::<SceneObject>(scene)?;
        let committed = scene.committed()?;
        let (triangles, cameras, backend) = match &committed.kind {
            SceneKind::Own(s) => {
                (s.geometry().triangle_count(), s.cameras().len(), s.accel().version())
            }
            SceneKind::Host(_) => (0, 0, "host".to_owned()),
        };
        let value = lumi_scene_info {
            struct_size: 0,
            reserved: 0,
            bounds_min: committed.to_world(committed.bounds.min).to_array(),
            bounds_max: committed.to_world(committed.bounds.max).to_array(),
            triangles: triangles as u64,
            cameras: cameras as u64,
            hash: c_text(&committed.hash),
            backend: c_text(&backend),
        };
        write(info, value, "the info")
    })
}

/// Traces rays into a scene that the library keeps, and gives their first hits.
///
/// Threads: any; the work is done on the calling thread.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn lumi_scene_trace(
    scene: lumi_scene, rays: *const lumi_trace_desc,
) -> lumi_error {
    guard("lumi_scene_trace", || {
        let object = borrow::<SceneObject>(scene)?;
        let (desc, scene) = (read(rays, "the rays")?, object.own()?);
        let n = desc.n;
        let origins = Input::<f32, 3>::required(desc.origin, n, 0, "origin")?;
        let dirs = Input::<f32, 3>::required(desc.dir, n, 0, "dir")?;
        let mut distance = Output::<f32, 1>::new(desc.distance, n, 0, "distance")?;
        let mut position = Output::<f32, 3>::new(desc.position, n, 0, "position")?;
        let mut normal = Output::<f32, 3>::new(desc.normal, n, 0, "normal")?;
        let mut geo_normal = Output::<f32, 3>::new(desc.geo_normal, n, 0, "geo_normal")?;
        let mut albedo = Output::<f32, 3>::new(desc.albedo, n, 0, "albedo")?;
        for i in 0..n {
            let dir = dirs.vector(i);
            let length = dir.length();
            let ray = Ray::new(scene.from_world(origins.vector(i)), dir / length);
            let mut hit = (f32::INFINITY, [Vec3::ZERO; 4]);
            if let Some((mut point, t)) = scene.intersect(&ray, 0) {
                let bsdf = scene.shade(&mut point);
                let color = bsdf.diffuse_albedo(point.frame.to_local(point.wo));
                hit =
                    (t / length, [scene.to_world(point.position), point.frame.n, point.ng, color]);
            }
            let (t, [at, n, ng, color]) = hit;
            distance.set(i, [t]);
            position.set(i, at);
            normal.set(i, n);
            geo_normal.set(i, ng);
            albedo.set(i, color);
        }
        Ok(())
    })
}
