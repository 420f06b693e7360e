//! `lumicache render --frames`: pictures of a camera that moves.

use super::render::{Job, Viewer, write_stats};
use super::show;
use lumicache::cache::Cache;
use lumicache::camera::Camera;
use lumicache::error::{Error, Result};
use lumicache::progress::Phase;
use lumicache::render::{self, Caches, Clock, Growth, IntegratorKind, Settings};
use serde_json::{Value, json};
use std::path::{Path, PathBuf};
use std::str::FromStr;

/// Frames of an animation, both ends included.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Frames {
    /// The first.
    pub first: u32,
    /// The last.
    pub last: u32,
}

/// Most frames of one run.
const MOST: u32 = 100_000;

impl FromStr for Frames {
    type Err = String;

    fn from_str(text: &str) -> std::result::Result<Self, String> {
        let numbers = text.split_once("..").map_or((text, text), |(a, b)| (a, b));
        let parse = |n: &str| n.trim().parse::<u32>().ok();
        match (parse(numbers.0), parse(numbers.1)) {
            (Some(first), Some(last)) if first <= last && last - first < MOST => {
                Ok(Self { first, last })
            }
            (Some(first), Some(last)) if first <= last => {
                Err(format!("{first}..{last} are more than {MOST} frames"))
            }
            _ => Err("expected A..B, the first and the last frame, such as 1..30".into()),
        }
    }
}

/// The name of a file of frame `number`: `%04d` in the name of `path` stands for it, with so many
/// digits at least; without that it goes before the extension, with four.
pub fn numbered(path: &Path, number: u32) -> Result<PathBuf> {
    let name = path.file_name().map_or_else(String::new, |n| n.to_string_lossy().into_owned());
    let fault = |what: &str| Err(Error::InvalidArgument(format!("{}: {what}", path.display())));
    let Some((before, after)) = name.split_once('%') else {
        let extension =
            path.extension().map_or_else(String::new, |e| format!(".{}", e.to_string_lossy()));
        let stem = path.file_stem().map_or_else(String::new, |s| s.to_string_lossy().into_owned());
        return Ok(path.with_file_name(format!("{stem}.{number:04}{extension}")));
    };
    let Some((width, after)) =
        after.split_once('d').filter(|(w, rest)| w.len() <= 2 && !rest.contains('%'))
    else {
        return fault("`%` in the name of a sequence must be one frame number, such as %04d");
    };
    let padded = width
        .strip_prefix('0')
        .is_some_and(|n| n.len() == 1 && n.starts_with(|c: char| c.is_ascii_digit()));
    if !(width.is_empty() || padded) {
        return fault("a frame number is written %d, or %04d with a digit of your choice");
    }
    let width = width.parse::<usize>().unwrap_or(0);
    Ok(path.with_file_name(format!("{before}{number:0width$}{after}")))
}

/// Renders the frames; true if that was cancelled. What was finished by then stays.
pub fn run(
    job: &mut Job,
    frames: &Frames,
    before: Option<Cache>,
    output: &Path,
    clock: &mut Clock,
) -> Result<bool> {
    let arguments = job.arguments;
    let numbers: Vec<u32> = (frames.first..=frames.last).collect();
    let cameras = cameras(job, &numbers)?;
    let cached = job.settings.integrator == IntegratorKind::Cache;
    let mut caches = cached
        .then(|| Caches::new(&job.scene, &job.settings.scheme, job.settings.max_bounces, before));

    let mut growth = vec![Growth::default(); numbers.len()];
    if let Some(caches) = &mut caches {
        clock.start(Phase::Fill);
        growth = match render::fill_sequence(
            &job.scene,
            &job.settings,
            &cameras,
            caches,
            job.progress,
        ) {
            Err(Error::Cancelled) => return Ok(true),
            growth => growth?,
        };
        clock.stop();
    }

    let mut viewer = Viewer::connect(arguments, output, job.settings.window)?;
    let (mut rows, mut last) = (Vec::new(), None);
    for ((&number, camera), growth) in numbers.iter().zip(cameras).zip(&growth) {
        let settings = Settings { camera, ..job.settings.clone() };
        let mut time = Clock::default();
        let frame = render::frame_from(
            &job.scene,
            &settings,
            caches.as_ref(),
            job.progress,
            &mut time,
            &mut |area, film| {
                viewer.show(area, film);
            },
        )?;
        time.start(Phase::Write);
        job.progress.start(Phase::Write, 0);
        let preview = arguments.preview.as_ref().map(|p| numbered(p, number)).transpose()?;
        job.write(&frame, &settings, &numbered(output, number)?, preview.as_deref(), &time)?;
        time.stop();
        clock.add(&time);
        rows.push(row(number, growth, &time));
        let cancelled = frame.cancelled;
        last = Some((frame, settings));
        if cancelled {
            break;
        }
    }
    job.warnings.extend(viewer.lost);

    let Some((frame, settings)) = last else { return Ok(false) };
    job.save(frame.caches.as_ref().filter(|_| !frame.cancelled).map(|c| &c.cache))?;
    if let Some(path) = &arguments.stats {
        let mut stats =
            render::stats(&job.scene, &settings, &frame, clock, rayon::current_num_threads());
        stats["frames"] = rows.iter().map(|r| r.json.clone()).collect();
        write_stats(path, &stats)?;
    }
    if !arguments.quiet {
        show::print(table(&rows).as_bytes())?;
    }
    Ok(frame.cancelled)
}

/// The camera at each frame.
fn cameras(job: &Job, numbers: &[u32]) -> Result<Vec<Camera>> {
    let (arguments, still) = (job.arguments, &job.settings.camera);
    let fault =
        |what: String| Error::InvalidArgument(format!("{}: {what}", arguments.scene.display()));
    let Some(motion) = &job.motion else {
        let what = format!(
            "the camera `{}` does not move: --frames needs an animation of its node or of one above it",
            still.name
        );
        return Err(fault(what));
    };
    let camera = |&number: &u32| match motion.at(f64::from(number) / arguments.fps) {
        Some(to_world) => Ok(Camera { to_world, ..still.clone() }),
        None => Err(fault(format!(
            "at frame {number} the camera `{}` has no direction to look in",
            still.name
        ))),
    };
    numbers.iter().map(camera).collect()
}

/// What is told of one frame.
struct Row {
    json: Value,
    text: String,
}

fn row(number: u32, growth: &Growth, time: &Clock) -> Row {
    let [render, cpu] = time.seconds(Phase::Render);
    let levels = &growth.levels;
    let json = json!({
        "frame": number,
        "new_records": levels.iter().sum::<usize>(),
        "new_records_by_level": levels,
        "new_radiance_records": growth.radiance,
        "fill_seconds": growth.seconds,
        "render_seconds": render,
        "render_cpu_seconds": cpu,
    });
    let records = levels.iter().sum::<usize>();
    let text = format!(
        "{number:>7}{records:>13}{:>12}{:>10.3}{render:>10.3}\n",
        growth.radiance, growth.seconds
    );
    Row { json, text }
}

fn table(rows: &[Row]) -> String {
    let head = format!(
        "{:>7}{:>13}{:>12}{:>10}{:>10}\n",
        "frame", "new records", "radiance", "fill s", "render s"
    );
    head + &rows.iter().map(|r| r.text.as_str()).collect::<String>()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_of_frames() {
        for (pattern, name) in [
            ("out.exr", "out.0007.exr"),
            ("dir/room.v2.exr", "dir/room.v2.0007.exr"),
            ("out", "out.0007"),
            ("out.%04d.exr", "out.0007.exr"),
            ("%d.exr", "7.exr"),
            ("50%dir/%02d_a.exr", "50%dir/07_a.exr"),
        ] {
            assert_eq!(numbered(Path::new(pattern), 7).unwrap(), Path::new(name));
        }
        assert_eq!(numbered(Path::new("a.exr"), 12345).unwrap(), Path::new("a.12345.exr"));
        for bad in ["a%s.exr", "a%4d.exr", "a%04d.%04d.exr", "100%.exr", "a%00000d.exr"] {
            assert!(numbered(Path::new(bad), 7).is_err(), "{bad}");
        }
    }

    #[test]
    fn ranges_of_frames() {
        assert_eq!("1..30".parse(), Ok(Frames { first: 1, last: 30 }));
        assert_eq!("5".parse(), Ok(Frames { first: 5, last: 5 }));
        for bad in ["", "3..1", "1-5", "a..b", "..", "-1..3", "0..4000000000"] {
            assert!(bad.parse::<Frames>().is_err(), "{bad}");
        }
    }
}
