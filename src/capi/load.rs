//! Scenes from files.

use super::abi::{
    LUMI_LOAD_ALLOW_OUTSIDE, LUMI_LOAD_STRICT, lumi_load_desc, lumi_scene, only, path, read,
};
use super::handles::borrow;
use super::scene::SceneObject;
use super::status::{Outcome, guard, lumi_error, state};
use crate::import::{self, ImportOptions};
use std::ffi::c_char;

fn load(scene: lumi_scene, file: *const c_char, options: &ImportOptions) -> Outcome {
    let (scene, file) = (borrow::<SceneObject>(scene)?, path(file)?);
    let mut draft = scene.draft()?;
    state(draft.is_bare(), "the scene is not empty: read the file before anything else")?;
    let mut data = scene.device.pool.install(|| import::gltf(file, options))?;
    draft.data.punctual.iter_mut().for_each(|light| light.shift(-data.origin));
    data.punctual.append(&mut draft.data.punctual);
    data.environment = draft.data.environment.take().or(data.environment);
    draft.data = data;
    Ok(())
}

/// Reads everything of a glTF 2.0 file (.gltf, .glb) into the scene, which must be empty. What
/// breaks the specification and does no harm is mended, with a warning when the scene is
/// committed. Only files inside the folder of the file are read. Reading takes at most 1 GiB and 64
/// times the size of the files.
///
/// `file`: the path, UTF-8.
///
/// Threads: one per scene.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn lumi_scene_load_gltf(
    scene: lumi_scene, file: *const c_char,
) -> lumi_error {
    guard("lumi_scene_load_gltf", || load(scene, file, &ImportOptions::default()))
}

/// As lumi_scene_load_gltf, with what `desc` says.
///
/// Threads: one per scene.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn lumi_scene_load_gltf_with(
    scene: lumi_scene, file: *const c_char, desc: *const lumi_load_desc,
) -> lumi_error {
    guard("lumi_scene_load_gltf_with", || {
        let desc = read(desc, "the description of the file")?;
        only(LUMI_LOAD_STRICT | LUMI_LOAD_ALLOW_OUTSIDE, desc.flags, "load")?;
        let options = ImportOptions {
            strict: desc.flags & LUMI_LOAD_STRICT != 0,
            allow_outside: desc.flags & LUMI_LOAD_ALLOW_OUTSIDE != 0,
            memory_limit: (desc.memory_limit > 0).then_some(desc.memory_limit),
            ..ImportOptions::default()
        };
        load(scene, file, &options)
    })
}
