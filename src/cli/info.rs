//! `lumicache info`.

use super::args::Input;
use super::terminal::print;
use lumicache::accel::Backend;
use lumicache::error::{Result, one_line};
use lumicache::import;
use lumicache::material::Material;
use lumicache::scene::Scene;
use lumicache::transport::glass_bends_light;
use std::path::Path;

/// What the user must know of glass that [`glass_bends_light`].
pub const BENT_LIGHT: &str = "curved glass bends the light of lamps (caustics): only \
                              `--integrator bdpt` finds that light";

pub fn run(path: &Path, input: &Input) -> Result<()> {
    let data = import::gltf(path, &input.options())?;
    let bounds = data.geometry.bounds();
    let unique: usize = data.geometry.meshes.iter().map(|m| m.indices.len()).sum();
    let mut text = format!(
        "{}\n  triangles   {} ({} stored, {} meshes, {} instances)\n  materials   {}\n  textures    {}\n  lights      {} punctual\n  bounds      {} to {}\n  hash        {}\n",
        one_line(&path.to_string_lossy()),
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
        let name = one_line(&camera.name);
        text += &format!("  camera {i}    `{name}` {:?}\n", camera.projection);
    }
    for warning in &data.warnings {
        text += &format!("  warning     {warning}\n");
    }
    // Few scenes need the ray tracer for an answer.
    if !data.punctual.is_empty() && data.materials.iter().any(Material::may_be_pane) {
        let (scene, _) = Scene::new(data, Backend::default())?;
        if glass_bends_light(&scene) {
            text += &format!("  note        {BENT_LIGHT}\n");
        }
    }
    print(text.as_bytes())
}
