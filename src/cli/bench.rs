//! `lumicache bench`.

use super::args::{Bench, BenchAccel};
use super::terminal::{in_file, print, print_line};
use lumicache::accel::Ray;
use lumicache::bench::accel as bench;
use lumicache::error::{Error, Result};
use lumicache::import;
use lumicache::math::Vec2;
use lumicache::render::camera_number;

pub fn run(command: &Bench) -> Result<()> {
    match command {
        Bench::Accel(arguments) => accel(arguments),
    }
}

fn accel(arguments: &BenchAccel) -> Result<()> {
    let data = import::gltf(&arguments.scene, &arguments.input.options())?;
    let number = match &arguments.camera {
        Some(name) => camera_number(&data.cameras, name).map_err(in_file(&arguments.scene))?,
        None => 0,
    };
    let framing = || import::default_camera(&data.geometry.bounds());
    let camera = data.cameras.get(number).cloned().unwrap_or_else(framing);
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
