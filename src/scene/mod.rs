//! The immutable world that rays are traced in.

mod world;

pub use world::Scene;

use crate::camera::Camera;
use crate::geometry::Geometry;
use crate::light::{EnvironmentMap, PunctualLight};
use crate::material::Material;
use crate::texture::Texture;

/// A scene as plain data: what an importer or a host fills in, and [`Scene`] is built from.
#[derive(Clone, Debug, Default)]
pub struct SceneData {
    /// Meshes and instances.
    pub geometry: Geometry,
    /// Materials that meshes refer to; never empty when there is a mesh.
    pub materials: Vec<Material>,
    /// Textures that materials refer to.
    pub textures: Vec<Texture>,
    /// Point, spot and directional lights.
    pub punctual: Vec<PunctualLight>,
    /// Light from infinity.
    pub environment: Option<EnvironmentMap>,
    /// The cameras in the file's order.
    pub cameras: Vec<Camera>,
    /// What the importer wants the user to know, one line each.
    pub warnings: Vec<String>,
}
