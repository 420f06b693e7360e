//! Scene import: glTF 2.0 (.gltf and .glb) and environment maps.

mod accessor_data;
mod accessors;
mod assembly;
mod asset;
mod budget;
mod buffers;
mod cameras;
mod container;
mod decode;
mod extensions;
mod json;
mod layout;
mod lights;
mod materials;
mod meshopt;
mod native;
mod nodes;
mod primitives;
mod shading;
mod skins;
mod textures;
mod topology;
mod uri;

pub use cameras::default_camera;

use crate::error::{Error, Result};
use crate::scene::SceneData;
use accessors::Accessors;
use assembly::{Assembly, Parts};
use budget::Budget;
use buffers::Buffers;
use container::Container;
use json::{Json, Parsed};
use nodes::{Counts, Graph};
use std::path::Path;
use textures::Textures;

/// How the intensities of punctual lights are to be understood.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum LightUnits {
    /// As the file has them.
    #[default]
    Photometric,
    /// Divided by 683 lm/W, with which Blender's exporter multiplies watts.
    Radiometric,
}

/// One of a file's scenes.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum SceneChoice {
    /// By its place in the file.
    Index(usize),
    /// By its name.
    Name(String),
}

/// What the caller decides about an import.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct ImportOptions {
    /// The scene to show; `None` is the file's default scene, else its first, else all its nodes.
    pub scene: Option<SceneChoice>,
    /// Units of point, spot and directional lights.
    pub light_units: LightUnits,
}

/// Reads the glTF 2.0 file at `path`.
///
/// Skinned meshes stand in their rest pose, morph targets have their default weights; animations are not read.
///
/// # Errors
/// [`Error::Io`] if the file cannot be read, [`Error::Scene`] with the JSON path of the place where it, or a file that it refers to, is broken, and
/// [`Error::Unsupported`] if it requires an extension that is not read.
pub fn gltf(path: &Path, options: &ImportOptions) -> Result<SceneData> {
    let metadata = std::fs::metadata(path).map_err(Error::io(path))?;
    if !metadata.is_file() {
        return Err(Error::scene(path, "", "it is not a regular file"));
    }
    let bytes = std::fs::read(path).map_err(Error::io(path))?;
    read(bytes, path, options).map_err(|fault| fault.into_error(path))
}

fn read(bytes: Vec<u8>, path: &Path, options: &ImportOptions) -> Parsed<SceneData> {
    let mut scene = SceneData::default();
    let warnings = &mut scene.warnings;
    let mut budget = Budget::new();
    budget.feed(bytes.len() as u64);
    let container = Container::parse(bytes, path, warnings)?;
    let document = json::parse(container.json())?;
    let root = Json::root(&document);
    asset::check(&root, warnings)?;
    extensions::check(&root)?;

    let folder = path.parent().unwrap_or(Path::new(""));
    let buffers = Buffers::parse(&root, &container, folder, &mut budget, warnings)?;
    let accessors = Accessors::parse(&root, buffers, warnings)?;
    accessor_data::check(&accessors, warnings)?;
    let mut textures = Textures::parse(&root, &accessors, folder, warnings)?;
    scene.materials = materials::materials(&root, &mut textures, warnings)?;
    let meshes = primitives::meshes(&root, &accessors, scene.materials.len(), warnings)?;
    let cameras = cameras::cameras(&root, warnings)?;
    let lights = lights::lights(&root, options, warnings)?;
    let skins = skins::skins(&root, &accessors, root.array("nodes")?.len())?;
    let counts = Counts {
        accessors: accessors.list.len(),
        meshes: meshes.len(),
        skins: skins.len(),
        cameras: cameras.len(),
        lights: lights.len(),
    };
    let graph = Graph::parse(&root, &counts, warnings)?;
    let roots = nodes::scene_roots(&root, &graph, options.scene.as_ref(), warnings)?;

    scene.textures = textures.build();
    let parts = Parts {
        accessors: &accessors,
        graph: &graph,
        meshes: &meshes,
        skins: &skins,
        cameras: &cameras,
        lights: &lights,
    };
    Assembly::new(parts, scene, &mut budget).build(&roots)
}

/// TEMP
pub fn environment(_: &Path, _: f32, _: f32) -> Result<crate::light::EnvironmentMap> { Err(crate::error::Error::Cancelled) }
