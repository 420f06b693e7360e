//! `lumicache cache`.

use super::args::{CacheCommand, CacheMerge, DumpFormat};
use super::terminal::{print, print_line};
use glam::DVec3;
use lumicache::cache::{CacheFile, Irradiance, Record};
use lumicache::error::{Error, Result};
use lumicache::fsutil;
use serde_json::{Value, json};
use std::path::{Path, PathBuf};
use std::slice;

pub fn run(command: &CacheCommand) -> Result<()> {
    match command {
        CacheCommand::Info { file, json } => info(file, *json),
        CacheCommand::Merge(arguments) => merge(arguments),
        CacheCommand::Dump { file, format } => dump(file, *format),
    }
}

fn info(path: &Path, as_json: bool) -> Result<()> {
    let file = CacheFile::read(path)?;
    let counts: Vec<usize> = file.levels.iter().map(Vec::len).collect();
    let origin = &file.origin;
    if as_json {
        let bytes = std::fs::metadata(path).map_err(Error::io(path))?.len();
        return print_line(&format!(
            "{:#}",
            json!({"records": file.record_count(), "levels": counts, "bytes": bytes, "origin": origin})
        ));
    }
    let mut text = format!(
        "{}\n  records      {} (by level: {counts:?})\n",
        path.display(),
        file.record_count()
    );
    for (part, hash) in &origin.scene {
        text += &format!("  {part:<12} {hash}\n");
    }
    text += &format!("  extent       {}\n", file.extent);
    text += &format!(
        "  max bounces  {}\n",
        origin.max_bounces.map_or("unlimited".to_owned(), |n| n.to_string())
    );
    for (field, value) in origin.scheme.as_object().into_iter().flatten() {
        text += &format!(
            "  {field:<24} {}\n",
            value.as_str().map_or_else(|| value.to_string(), str::to_owned)
        );
    }
    print(text.as_bytes())
}

fn merge(arguments: &CacheMerge) -> Result<()> {
    fsutil::remember_what_is_read();
    let inputs: Vec<&Path> = arguments.files.iter().map(PathBuf::as_path).collect();
    fsutil::check_distinct(&inputs, slice::from_ref(&arguments.output))?;
    fsutil::check_writable(&arguments.output)?;
    let (first, others) = arguments.files.split_first().expect("clap demands one file");
    let mut all = CacheFile::read(first)?;
    for path in others {
        all.merge(CacheFile::read(path)?, arguments.reuse, path)?;
    }
    all.write(&arguments.output)
}

/// The record as JSON, its fields in the order of the table.
fn row(level: usize, position: DVec3, r: &Record<Irradiance>) -> Value {
    json!({
        "level": level,
        "position": position.to_array(),
        "normal": r.normal.to_array(),
        "irradiance": r.payload.irradiance.to_array(),
        "length": r.length_unclamped,
        "footprint": r.footprint,
        "sigma": r.sigma,
        "fences": r.fences.planes().len(),
    })
}

fn dump(path: &Path, format: DumpFormat) -> Result<()> {
    let file = CacheFile::read(path)?;
    let records = || {
        file.levels
            .iter()
            .enumerate()
            .flat_map(|(level, records)| records.iter().map(move |r| (level, r)))
    };
    let text = match format {
        DumpFormat::Json => format!(
            "{:#}\n",
            Value::from(
                records().map(|(level, r)| row(level, file.position(r), r)).collect::<Vec<_>>()
            )
        ),
        DumpFormat::Csv => {
            let mut text = "level,x,y,z,nx,ny,nz,r,g,b,length,footprint,sigma,fences\n".to_owned();
            for (level, r) in records() {
                let position = file.position(r).to_array().map(|x| x.to_string());
                let vectors = [r.normal, r.payload.irradiance];
                let vectors = vectors.iter().flat_map(|v| v.to_array()).map(|x| x.to_string());
                let vectors: Vec<String> = position.into_iter().chain(vectors).collect();
                let fences = r.fences.planes().len();
                text += &format!(
                    "{level},{},{},{},{},{fences}\n",
                    vectors.join(","),
                    r.length_unclamped,
                    r.footprint,
                    r.sigma
                );
            }
            text
        }
        DumpFormat::Ply => ply(&file),
    };
    print(text.as_bytes())
}

/// Colours are irradiances over the largest one, through a square root.
fn ply(file: &CacheFile) -> String {
    let (records, count) = (file.levels.iter().flatten(), file.record_count());
    let largest = records.clone().map(|r| r.payload.irradiance.max_element()).fold(1e-30, f32::max);
    let mut text = format!("ply\nformat ascii 1.0\nelement vertex {count}\n");
    for (name, kind) in ["x", "y", "z", "nx", "ny", "nz"]
        .into_iter()
        .zip(["double", "double", "double", "float", "float", "float"])
    {
        text += &format!("property {kind} {name}\n");
    }
    text += "property uchar red\nproperty uchar green\nproperty uchar blue\nproperty float length\nend_header\n";
    for r in records {
        let (p, n) = (file.position(r), r.normal);
        let [red, green, blue] = r
            .payload
            .irradiance
            .to_array()
            .map(|c| (255.0 * (c / largest).max(0.0).sqrt()).round() as u8);
        text += &format!(
            "{} {} {} {} {} {} {red} {green} {blue} {}\n",
            p.x, p.y, p.z, n.x, n.y, n.z, r.length_unclamped
        );
    }
    text
}
