//! The immutable world that rays are traced in.

mod origin;
mod emitters;
mod world;
mod shadows;

pub use origin::{Part, center, middle};
pub use shadows::{are_parallel, same_direction};
pub use world::{Scene, gap};

use crate::camera::{Camera, Motion};
use crate::geometry::Geometry;
use crate::light::{EnvironmentMap, PunctualLight};
use crate::material::Material;
use crate::texture::{Texture, TexturePixels};
use glam::DVec3;
use std::collections::BTreeMap;

/// One hash of all `hashes`.
fn joined(hashes: &BTreeMap<String, String>) -> String {
    let mut hasher = blake3::Hasher::new();
    hashes.values().for_each(|h| {
        hasher.update(h.as_bytes());
    });
    hasher.finalize().to_hex().to_string()
}

/// A scene as plain data: what an importer or a host fills in, and [`Scene`] is built from.
#[derive(Clone, Debug, Default)]
pub struct SceneData {
    /// Where the zero of all coordinates here lies in the world.
    pub origin: DVec3,
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
    /// How the cameras move, in their order; `None` for one that stands still. Empty if nobody
    /// looked.
    pub motions: Vec<Option<Motion>>,
    /// What the importer wants the user to know, one line each.
    pub warnings: Vec<String>,
}

impl SceneData {
    /// A hash of everything that changes the light in the scene, hexadecimal: geometry, materials,
    /// textures and lights, not the cameras.
    pub fn hash(&self) -> String {
        joined(&self.hashes())
    }

    /// What [`SceneData::hash`] is made of, so that a difference can be named: the hashes of
    /// `geometry`, of `materials` with their textures, and of `lights`, those of emissive
    /// materials left out.
    pub fn hashes(&self) -> BTreeMap<String, String> {
        let parts = [
            ("geometry", self.hash_geometry()),
            ("lights", self.hash_lights()),
            ("materials", self.hash_materials()),
        ];
        parts
            .into_iter()
            .map(|(name, h)| (name.to_owned(), h.finalize().to_hex().to_string()))
            .collect()
    }

    fn hash_geometry(&self) -> blake3::Hasher {
        let mut hasher = blake3::Hasher::new();
        for mesh in &self.geometry.meshes {
            hasher.update(bytemuck::cast_slice(&mesh.positions));
            hasher.update(bytemuck::cast_slice(&mesh.indices));
            hasher.update(bytemuck::cast_slice(mesh.normals.as_deref().unwrap_or_default()));
            hasher.update(bytemuck::cast_slice(mesh.tangents.as_deref().unwrap_or_default()));
            hasher.update(bytemuck::cast_slice(mesh.uv[0].as_deref().unwrap_or_default()));
            hasher.update(bytemuck::cast_slice(mesh.uv[1].as_deref().unwrap_or_default()));
            hasher.update(bytemuck::cast_slice(mesh.colors.as_deref().unwrap_or_default()));
            hasher.update(&mesh.material.to_le_bytes());
        }
        hasher.update(format!("{:?}", self.geometry.instances).as_bytes());
        hasher
    }

    fn hash_materials(&self) -> blake3::Hasher {
        let mut hasher = blake3::Hasher::new();
        for texture in &self.textures {
            match &texture.image.pixels {
                TexturePixels::Rgba8(pixels) => hasher.update(pixels.as_flattened()),
                TexturePixels::Rgba16(pixels) => hasher.update(bytemuck::cast_slice(pixels)),
            };
            hasher.update(
                format!("{:?}{:?}{}", texture.wrap_s, texture.wrap_t, texture.nearest).as_bytes(),
            );
        }
        hasher.update(format!("{:?}", self.materials).as_bytes());
        hasher
    }

    fn hash_lights(&self) -> blake3::Hasher {
        let mut hasher = blake3::Hasher::new();
        if let Some(map) = &self.environment {
            hasher.update(bytemuck::cast_slice(&map.pixels));
            hasher.update(
                format!("{} {} {} {:?}", map.width, map.height, map.scale, map.from_world)
                    .as_bytes(),
            );
        }
        hasher.update(format!("{:?}", self.punctual).as_bytes());
        hasher
    }
}
