//! Which extensions a file may require.

use super::fault::{Fault, Parsed, quote};
use serde_json::Value;

/// The names of the extension for compressed buffers.
pub(super) const MESHOPT: [&str; 2] = ["EXT_meshopt_compression", "KHR_meshopt_compression"];

/// Extensions that we read, or that change nothing in a still picture.
const KNOWN: [&str; 19] = [
    "EXT_lights_ies",
    "EXT_mesh_gpu_instancing",
    "EXT_texture_webp",
    "KHR_animation_pointer",
    "KHR_lights_punctual",
    "KHR_materials_clearcoat",
    "KHR_materials_emissive_strength",
    "KHR_materials_ior",
    "KHR_materials_pbrSpecularGlossiness",
    "KHR_materials_specular",
    "KHR_materials_transmission",
    "KHR_materials_unlit",
    "KHR_materials_variants",
    "KHR_materials_volume",
    "KHR_mesh_quantization",
    "KHR_texture_transform",
    "KHR_xmp",
    "KHR_xmp_json_ld",
    "FB_ngon_encoding",
];

/// What to do about a required extension that we lack.
fn advice(name: &str) -> &'static str {
    match name {
        "KHR_draco_mesh_compression" => {
            "Draco compression is not read: decompress the file first, for example with \"gltf-transform copy IN OUT\", \
             or export it without compression or with EXT_meshopt_compression"
        }
        "KHR_texture_basisu" | "MSFT_texture_dds" => {
            "GPU texture formats are not read: convert the textures to PNG, JPEG or WebP first, for example with \"gltf-transform\""
        }
        "EXT_texture_avif" => "AVIF textures are not read: convert them to PNG, JPEG or WebP first",
        "KHR_technique_webgl" | "KHR_techniques_webgl" => {
            "materials made of shaders are not read: export the file with metallic-roughness materials"
        }
        _ => "export the file without it, or without requiring it",
    }
}

/// Refuses a document that requires what we lack.
pub(super) fn check(root: &Value) -> Parsed<()> {
    let required = root["extensionsRequired"].as_array();
    for (i, name) in required.into_iter().flatten().enumerate() {
        // What is no string is refused by the check of the document.
        let Some(name) = name.as_str() else { continue };
        if !KNOWN.contains(&name) && !MESHOPT.contains(&name) {
            let what = format!(
                "the file requires the extension {}, which this program lacks: {}",
                quote(name),
                advice(name)
            );
            return Err(Fault::unsupported(format!("/extensionsRequired/{i}"), what));
        }
    }
    Ok(())
}
