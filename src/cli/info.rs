//! `lumicache info`.

use super::terminal::print;
use lumicache::error::Result;
use lumicache::import::{self, ImportOptions};
use std::path::Path;

pub fn run(path: &Path) -> Result<()> {
    let data = import::gltf(path, &ImportOptions::default())?;
    let bounds = data.geometry.bounds();
    let unique: usize = data.geometry.meshes.iter().map(|m| m.indices.len()).sum();
    let mut text = format!(
        "{}\n  triangles   {} ({} stored, {} meshes, {} instances)\n  materials   {}\n  textures    {}\n  lights      {} punctual\n  bounds      {} to {}\n  hash        {}\n",
        path.display(),
        data.geometry.triangle_count(),
        unique,
        data.geometry.meshes.len(),
        data.geometry.instances.len(),
        data.materials.len(),
        data.textures.len(),
        data.punctual.len(),
        bounds.min,
        bounds.max,
        data.hash(),
    );
    for (i, camera) in data.cameras.iter().enumerate() {
        text += &format!("  camera {i}    `{}` {:?}\n", camera.name, camera.projection);
    }
    for warning in &data.warnings {
        text += &format!("  warning     {warning}\n");
    }
    print(text.as_bytes())
}
