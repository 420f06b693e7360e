//! `lumicache report`.

use super::Outcome;
use super::args::Report;
use super::render::{camera, parse_size, threads};
use super::show::print;
use super::tables::tables;
use super::terminal::{Bar, cancel_on_interrupt};
use lumicache::accel::Backend;
use lumicache::bench::experiment::{self, Plan, variant};
use lumicache::bench::report;
use lumicache::cache::Preset;
use lumicache::error::{Error, Result};
use lumicache::import::{self, ImportOptions};
use lumicache::progress::Progress;
use lumicache::render::{IntegratorKind, Settings};
use lumicache::scene::Scene;
use std::sync::Arc;

/// Rows of the picture without `--size`.
const ROWS: f32 = 180.0;

pub fn run(arguments: &Report) -> Result<Outcome> {
    let plan = plan(arguments)?;
    std::fs::create_dir_all(&arguments.output).map_err(Error::io(&arguments.output))?;
    let pool = threads(arguments.threads)?;
    let progress = Arc::new(Progress::default());
    cancel_on_interrupt(&progress);
    let bar = Bar::new(&progress, arguments.quiet);
    let outcome = pool.install(|| job(arguments, &plan, &progress));
    drop(bar);
    match outcome {
        Err(Error::Cancelled) => Ok(Outcome::Cancelled),
        Err(error) => Err(error),
        Ok(report) => {
            print(report.text().as_bytes())?;
            Ok(Outcome::Done)
        }
    }
}

fn job(arguments: &Report, plan: &Plan, progress: &Progress) -> Result<report::Report> {
    let mut data = import::gltf(&arguments.scene, &ImportOptions::default())?;
    if let Some(map) = &arguments.env {
        data.environment = Some(import::environment(map, 0.0, 1.0)?);
    }
    let (scene, _) = Scene::new(data, Backend::default())?;
    let scene = scene.with_tables(tables());
    let camera =
        camera(scene.cameras(), &scene.bounds(), arguments.camera.as_deref(), &arguments.scene)?;
    let size = match &arguments.size {
        Some(text) => parse_size(text)?,
        None => [
            (ROWS * camera.aspect.unwrap_or(16.0 / 9.0).clamp(0.05, 20.0)).round().max(1.0) as u32,
            ROWS as u32,
        ],
    };
    let settings = Settings {
        integrator: IntegratorKind::Cache,
        scheme: Preset::by_name("auto")?.scheme(),
        camera,
        size,
        window: [0, 0, size[0], size[1]],
        spp: 1,
        noise: 0.0,
        max_bounces: arguments.max_bounces.unwrap_or(u32::MAX),
        seed: arguments.seed,
        prepass_only: true,
    };
    let title = arguments.scene.file_stem().unwrap_or_default().to_string_lossy();
    experiment::run(&scene, &settings, plan, &title, &arguments.output, progress)
}

fn plan(arguments: &Report) -> Result<Plan> {
    let list = |text: &str| text.split(',').map(|s| s.trim().to_owned()).collect::<Vec<_>>();
    let presets = list(&arguments.presets);
    let pair = |text: &String| match text.split_once('=') {
        Some((key, value)) => Ok((key.trim().to_owned(), value.trim().to_owned())),
        None => Err(Error::InvalidArgument(format!("--set {text}: expected KEY=VALUE"))),
    };
    let settings = arguments.set.iter().map(pair).collect::<Result<Vec<_>>>()?;
    presets.iter().try_for_each(|text| variant(text, &settings).map(|_| ()))?;
    let records: Option<Vec<usize>> =
        list(&arguments.records).iter().map(|n| n.parse().ok().filter(|n| *n > 0)).collect();
    let records = records.ok_or_else(|| {
        Error::InvalidArgument(format!(
            "--records {}: expected numbers above 0, such as 500,1000,2000",
            arguments.records
        ))
    })?;
    Ok(Plan {
        presets,
        settings,
        records,
        rays: arguments.rays,
        reference_rays: arguments.reference_rays,
        reference: (arguments.reference != "auto").then(|| arguments.reference.clone().into()),
    })
}
