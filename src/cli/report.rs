//! `lumicache report`.

use super::args::Report;
use super::presets::pair;
use super::tables::tables;
use super::terminal::{in_file, on_threads, parse_size, print, thread_count, warn};
use lumicache::accel::Backend;
use lumicache::bench::experiment::{self, Plan, variant};
use lumicache::bench::report;
use lumicache::error::{Error, Result};
use lumicache::fsutil;
use lumicache::import;
use lumicache::progress::Progress;
use lumicache::render::Job;
use lumicache::scene::Scene;
use std::path::Path;

/// Rows of the picture without `--size`.
const ROWS: u32 = 180;

pub fn run(arguments: &Report) -> Result<()> {
    fsutil::remember_what_is_read();
    let plan = plan(arguments)?;
    let size = arguments.size.as_deref().map(parse_size).transpose()?;
    std::fs::create_dir_all(&arguments.output).map_err(Error::io(&arguments.output))?;
    let outputs = plan.outputs(&arguments.output);
    fsutil::check_distinct(&inputs(arguments, &plan), &outputs)?;
    let threads = thread_count(arguments.threads)?;
    let report =
        on_threads(threads, arguments.quiet, |progress| compare(arguments, &plan, size, progress))?;
    print(report.text().as_bytes())
}

fn compare(
    arguments: &Report, plan: &Plan, size: Option<[u32; 2]>, progress: &Progress,
) -> Result<report::Report> {
    let mut data = import::gltf(&arguments.scene, &arguments.input.options())?;
    if let Some(map) = &arguments.env {
        let limit = arguments.input.memory_limit;
        let (map, warnings) = import::environment(map, 0.0, 1.0, limit)?;
        data.environment = Some(map);
        data.warnings.extend(warnings);
    }
    // Now the files are known that the scene refers to.
    plan.outputs(&arguments.output).iter().try_for_each(|path| fsutil::check_writable(path))?;
    let (scene, warnings) = Scene::new(data, Backend::default())?;
    warnings.iter().filter(|_| !arguments.quiet).for_each(|warning| warn(warning));
    let scene = scene.with_tables(tables());
    let mut job = Job::new(&scene)
        .rows(ROWS)
        .spp(1)
        .max_bounces(arguments.max_bounces.unwrap_or(u32::MAX))
        .seed(arguments.seed)
        .prepass_only(true);
    if let Some(camera) = &arguments.camera {
        job = job.camera_named(camera).map_err(in_file(&arguments.scene))?;
    }
    if let Some([columns, rows]) = size {
        job = job.size(columns, rows);
    }
    let title = arguments.scene.file_stem().unwrap_or_default().to_string_lossy();
    experiment::run(&scene, &job.settings()?, plan, &title, &arguments.output, progress)
}

/// The files that the arguments name as inputs.
fn inputs<'a>(arguments: &'a Report, plan: &'a Plan) -> Vec<&'a Path> {
    let others = [arguments.env.as_deref(), plan.reference.as_deref()];
    others.into_iter().flatten().chain([arguments.scene.as_path()]).collect()
}

fn plan(arguments: &Report) -> Result<Plan> {
    let list = |text: &str| text.split(',').map(|s| s.trim().to_owned()).collect::<Vec<_>>();
    let presets = list(&arguments.presets);
    let settings = arguments.set.iter().map(|text| pair(text)).collect::<Result<Vec<_>>>()?;
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
