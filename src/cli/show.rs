//! The subcommands that print.

use super::args::{BenchAccel, Compare};
use super::render::{camera, preset};
use lumicache::accel::Ray;
use lumicache::bench::accel as bench;
use lumicache::cache::{PRESETS, Preset};
use lumicache::compare::{self, Options};
use lumicache::error::{Error, Result};
use lumicache::import::{self, ImportOptions};
use lumicache::math::Vec2;
use serde_json::{Value, json};
use std::io::Write;
use std::path::Path;

/// Prints `text`; a reader that stops listening early is no failure.
pub fn print(text: &[u8]) -> Result<()> {
    match std::io::stdout().lock().write_all(text) {
        Err(e) if e.kind() != std::io::ErrorKind::BrokenPipe => {
            Err(Error::io(Path::new("standard output"))(e))
        }
        _ => Ok(()),
    }
}

pub fn print_line(text: &str) -> Result<()> {
    print(format!("{text}\n").as_bytes())
}

/// `lumicache presets`: all of them, or the one called `name`.
pub fn presets(name: Option<&str>, all: bool, as_json: bool) -> Result<()> {
    if let Some(name) = name {
        let preset = preset(name)?;
        return print(if all { preset.to_toml() } else { preset.text }.as_bytes());
    }
    if as_json {
        let row = |p: &Preset| {
            json!({
                "name": p.name, "source": p.source, "summary": p.summary, "scheme": p.scheme().settings(),
            })
        };
        let table: Vec<Value> = PRESETS.iter().map(row).collect();
        return print_line(&format!("{:#}", Value::from(table)));
    }
    let row = |p: &Preset| format!("{:<17}{:<28}{}\n", p.name, p.source, p.summary);
    print(PRESETS.iter().map(row).collect::<String>().as_bytes())
}

pub fn compare(arguments: &Compare) -> Result<()> {
    let options = Options { channel_prefix: arguments.channel_prefix.clone() };
    let comparison = compare::compare_files(&arguments.image, &arguments.reference, &options)?;
    if let Some(path) = &arguments.flip {
        comparison.write_flip_map(path)?;
    }
    if arguments.json {
        return print_line(
            &serde_json::to_string_pretty(&comparison.report)
                .map_err(|e| Error::Device(e.to_string()))?,
        );
    }
    print_line(comparison.report.text().trim_end())
}

pub fn info(path: &Path) -> Result<()> {
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

pub fn bench_accel(arguments: &BenchAccel) -> Result<()> {
    let data = import::gltf(&arguments.scene, &ImportOptions::default())?;
    let camera = camera(
        &data.cameras,
        &data.geometry.bounds(),
        arguments.camera.as_deref(),
        &arguments.scene,
    )?;
    let mut camera_rays = |count: usize| {
        let side = (count as f64).sqrt() as u32;
        let pixels =
            (0..side * side).map(|k| Vec2::new((k % side) as f32 + 0.5, (k / side) as f32 + 0.5));
        pixels
            .map(|raster| {
                let ray = camera.ray(raster, [side, side]);
                Ray { origin: ray.origin, tmin: 0.0, dir: ray.dir, tmax: f32::INFINITY }
            })
            .collect()
    };
    let report = bench::run(&data.geometry, &mut camera_rays, bench::Options::default())?;
    if arguments.json {
        return print_line(
            &serde_json::to_string_pretty(&report).map_err(|e| Error::Device(e.to_string()))?,
        );
    }
    print(report.table().as_bytes())
}
