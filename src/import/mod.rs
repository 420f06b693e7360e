//! Scene import: glTF 2.0 (.gltf and .glb) and environment maps.
//!
//! # What is read
//!
//! Everything of the core specification that a still picture shows, and the extensions
//! KHR_lights_punctual, EXT_lights_ies, KHR_materials_clearcoat (without its normal map),
//! _emissive_strength, _ior, _pbrSpecularGlossiness, _specular, _transmission, _unlit and _volume,
//! KHR_mesh_quantization, KHR_texture_transform, EXT_mesh_gpu_instancing, EXT_meshopt_compression
//! (and KHR_meshopt_compression) and EXT_texture_webp. A file that requires any other extension is
//! refused; where it only uses one, the specification promises a sensible scene without.
//!
//! Skinned meshes stand in their rest pose, morph targets have their default weights; of animations
//! only those that move cameras are read. Points and lines are left out with a warning, and so
//! are triangles without area and instances whose transform leaves a line or a point of them.
//! Meshes that several nodes show are stored once, flattened ones once for each node.
//!
//! # How strict it is
//!
//! The whole document is checked, also what no scene shows: references, ranges, buffer views,
//! accessors and their numbers. What leaves the meaning open or is not safe is an error with its
//! JSON path. What does no harm is mended with a warning, and is an error too where
//! [`ImportOptions::strict`] says so; docs/guide/gltf.md has the table. Images that no shown
//! material reads are not opened.
//!
//! Memory is bounded by the size of the files or by [`ImportOptions::memory_limit`], before it is
//! allocated. Files outside the scene's folder are not read unless [`ImportOptions::allow_outside`]
//! says so.
//!
//! # Native materials
//!
//! The BRDFs of the caching papers take the place of the glTF model where the `extras` of a
//! material say so:
//!
//! ```json
//! {"name": "floor", "extras": {"lumicache": {
//!     "brdf": "phong", "kd": [0.2, 0.2, 0.3], "ks": 0.5, "exponent": 50}}}
//! {"name": "brass", "extras": {"lumicache": {
//!     "brdf": "ward", "kd": 0.1, "ks": 0.4, "alpha_x": 0.05, "alpha_y": 0.2}}}
//! {"name": "paint", "extras": {"lumicache": {"brdf": "lafortune", "kd": 0.3, "lobes": [
//!     {"cx": -0.9, "cy": -0.9, "cz": [0.9, 0.8, 0.7], "exponent": 20}]}}}
//! ```
//!
//! | property | of | meaning | range | default |
//! |---|---|---|---|---|
//! | `kd` | all | diffuse albedo | 0 to 1 | 0 |
//! | `ks` | phong, ward | specular albedo | 0 to 1, `kd + ks` at most 1 | 0 |
//! | `exponent` | phong | exponent of the lobe | at least 0 | required |
//! | `alpha_x`, `alpha_y` | ward | roughness along the tangents | above 0, to 1 | required, `alpha_x` |
//! | `lobes` | lafortune | one to three lobes | | required |
//! | `cx`, `cy`, `cz` | a lobe | coefficients of the three axes | | required, `cx`, required |
//! | `exponent` | a lobe | exponent | at least 0 | required |
//!
//! Albedos, coefficients and a lobe's exponent are one number for all channels or three, linear
//! Rec. 709. The first tangent is that of the mesh, along its first texture coordinate. Unknown
//! properties are errors. [`crate::material::NativeBrdf`] has the formulas.
//!
//! # Luminaires
//!
//! An IES file is a light where EXT_lights_ies says so, and for exporters that do not write it,
//! where the `extras` of a node or of a light of KHR_lights_punctual name one:
//!
//! ```json
//! {"name": "lamp on a node", "extras": {"lumicache": {
//!     "ies": "downlight.ies", "multiplier": 1, "color": [1, 0.9, 0.8]}}}
//! {"type": "point", "color": [1, 0.9, 0.8], "extras": {"lumicache": {
//!     "ies": "downlight.ies", "multiplier": 1, "relative": false}}}
//! ```
//!
//! The file stands beside the scene; the light shines along the node's -Z. Its candela are those of
//! the file times `multiplier` and `color`; the light's `intensity` counts only where `relative` is
//! true, and is then the intensity in the brightest direction. A TILT section takes effect by
//! the node's inclination, straight down being -Y.

mod environment;
mod fault;
mod warnings;
mod schema;
mod tangents;
mod topology;
mod flat;
mod value;
mod budget;
mod check;
mod container;
mod native;
mod parse;
mod uri;
mod meshopt;
mod extensions;
mod document;
mod buffers;
mod camera;
mod accessor;
mod ies;
mod image;
mod accessor_check;
mod light;
mod mesh;
mod node;
mod animation;
mod texture;
mod material;
mod skin;
mod assembly;

pub use camera::default_camera;
pub use environment::{environment, sky};
pub use ies::ies;

use crate::accel::Backend;
use crate::error::{Error, Result};
use crate::fsutil;
use crate::light::LUMINOUS_EFFICACY;
use crate::scene::{Scene, SceneData};
use accessor::Accessors;
use assembly::{Assembly, Parts};
use budget::Budget;
use buffers::Buffers;
use document::Document;
use fault::Parsed;
use ies::Profiles;
use node::Graph;
use std::io::Read;
use std::path::Path;
use texture::Textures;
use warnings::Warnings;

/// How the intensities of punctual lights are to be understood.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum LightUnits {
    /// As the file has them.
    #[default]
    Photometric,
    /// Divided by 683 lm/W, with which Blender's exporter multiplies watts; IES files and skies,
    /// which are photometric, too.
    Radiometric,
}

impl LightUnits {
    /// Lumens per unit of radiant power, which candela, lux and cd/m² are divided by.
    pub fn efficacy(self) -> f32 {
        match self {
            Self::Photometric => 1.0,
            Self::Radiometric => LUMINOUS_EFFICACY,
        }
    }
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
    /// What breaks the specification and could be mended is an error too.
    pub strict: bool,
    /// Files outside the scene's folder may be read too.
    pub allow_outside: bool,
    /// Bytes that reading may take; `None` is 1 GiB and 64 for each byte of the files.
    pub memory_limit: Option<u64>,
    /// Cameras see what is nearer than their near plane and farther than their far plane too.
    pub no_clip: bool,
}

/// Reads the glTF 2.0 file at `path` and builds its scene. The returned lines tell the user what
/// [`gltf`] and [`Scene::new`] noticed.
///
/// # Errors
/// Those of [`gltf`] and [`Scene::new`].
pub fn open(path: impl AsRef<Path>) -> Result<(Scene, Vec<String>)> {
    Scene::new(gltf(path.as_ref(), &ImportOptions::default())?, Backend::default())
}

/// Reads the glTF 2.0 file at `path`.
///
/// Skinned meshes stand in their rest pose, morph targets have their default weights; animations
/// move cameras alone.
///
/// # Errors
/// [`Error::Io`] if the file cannot be read, [`Error::Scene`] with the JSON path of the place where
/// it, or a file that it refers to, is broken, and [`Error::Unsupported`] if it requires an
/// extension that is not read.
pub fn gltf(path: &Path, options: &ImportOptions) -> Result<SceneData> {
    let metadata = std::fs::metadata(path).map_err(Error::io(path))?;
    if !metadata.is_file() {
        return Err(Error::scene(path, "", "it is not a regular file"));
    }
    let mut file = fsutil::open(path)?;
    let mut head = Vec::new();
    file.by_ref().take(container::HEAD).read_to_end(&mut head).map_err(Error::io(path))?;
    if let Some(what) = container::foreign(&head, path) {
        return Err(Error::unsupported(path, "", what));
    }
    if metadata.len() > u64::from(u32::MAX) {
        let what = "it is larger than 4 GiB, which no GLB can be and no document should";
        return Err(Error::scene(path, "", what));
    }
    let mut budget = Budget::new(options.memory_limit);
    budget.read(metadata.len(), "").map_err(|fault| fault.into_error(path))?;
    let mut bytes = head;
    file.read_to_end(&mut bytes).map_err(Error::io(path))?;
    read(&bytes, path, options, &mut budget).map_err(|fault| fault.into_error(path))
}

fn read(
    bytes: &[u8], path: &Path, options: &ImportOptions, budget: &mut Budget,
) -> Parsed<SceneData> {
    let mut scene = SceneData::default();
    let warnings = &mut Warnings::new(options.strict);
    let document = Document::read(bytes, path, options.allow_outside, budget, warnings)?;
    let buffers = Buffers::parse(&document, budget, warnings)?;
    let accessors = Accessors::parse(&document, buffers)?;
    let highest = accessor_check::check(&accessors, &mut budget.of_work(), warnings)?;
    let meshes = mesh::meshes(&document, &accessors, &highest, warnings)?;
    let graph = Graph::parse(&document, budget, warnings)?;
    graph.check_meshes(&meshes, warnings)?;
    let roots = node::scene_roots(&document, &graph, options.scene.as_ref(), warnings)?;
    let nodes = graph.reachable(&roots);
    let shown = nodes.iter().filter_map(|i| Some(&meshes[graph.nodes[i].mesh?]));
    let shown = shown.flat_map(|mesh| &mesh.primitives).filter_map(|p| p.recipe.material).collect();
    let mut textures = Textures::parse(&document, accessors.buffers(), &shown, budget, warnings)?;
    scene.materials = material::materials(&document, &shown, &mut textures, warnings)?;
    scene.textures = textures.build();
    let cameras = camera::cameras(&document, options, warnings)?;
    let mut profiles = Profiles::parse(&document, accessors.buffers(), budget)?;
    let lights = light::lights(&document, options, &mut profiles, warnings)?;
    let luminaires = profiles.nodes(&document, options)?;
    let skins = skin::skins(&document, &accessors)?;
    let motions = animation::motions(&document, &accessors, &graph, budget, warnings)?;

    let parts = Parts {
        document: &document,
        accessors: &accessors,
        graph: &graph,
        meshes: &meshes,
        skins: &skins,
        cameras: &cameras,
        motions: &motions,
        lights: &lights,
        luminaires: &luminaires,
    };
    let mut scene = Assembly::new(parts, scene, budget, warnings).build(&nodes)?;
    scene.warnings = std::mem::take(warnings).lines();
    Ok(scene)
}
