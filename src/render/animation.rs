//! Pictures of a camera that moves: which frames, from where, and into which files.

use super::clock::Clock;
use super::denoise::Found;
use super::frame::Frame;
use super::job::Job;
use super::rendering::Rendering;
use super::sequence::{Growth, fill_sequence};
use super::settings::Settings;
use super::threads::on_workers;
use crate::camera::Camera;
use crate::error::{Error, Result};
use crate::progress::{Phase, Progress};
use serde_json::{Value, json};
use std::path::{Path, PathBuf};
use std::str::FromStr;

/// Most frames of one run.
const MOST: u32 = 100_000;

/// Frames of an animation, both ends included.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Frames {
    /// The first.
    pub first: u32,
    /// The last.
    pub last: u32,
}

impl FromStr for Frames {
    type Err = String;

    fn from_str(text: &str) -> std::result::Result<Self, String> {
        let numbers = text.split_once("..").unwrap_or((text, text));
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

/// The name of a file of frame `number`. `%04d` in the name of `path` stands for the number, with
/// so many digits at least; without `%` the number goes before the extension, with four digits.
///
/// # Errors
/// [`Error::InvalidArgument`] for any other use of `%`.
pub fn frame_path(path: &Path, number: u32) -> Result<PathBuf> {
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

/// What one frame of a sequence took.
#[derive(Clone, Debug)]
pub struct FrameCost {
    /// The number of the frame.
    pub number: u32,
    /// The records that the frame added.
    pub growth: Growth,
    /// Wall and CPU seconds of rendering.
    pub render_seconds: [f64; 2],
}

/// A rendered sequence.
pub struct Sequence<'a> {
    /// The last picture that was rendered, with the time and the warnings of the whole sequence.
    pub last: Rendering<'a>,
    /// The cost of each frame.
    pub costs: Vec<FrameCost>,
}

impl Sequence<'_> {
    /// [`Rendering::stats`] of the last picture, with the times of all pictures and a list of them.
    pub fn stats(&self) -> Value {
        let mut stats = self.last.stats();
        let row = |cost: &FrameCost| {
            let Growth { levels, radiance, seconds } = &cost.growth;
            json!({
                "frame": cost.number,
                "new_records": levels.iter().sum::<usize>(),
                "new_records_by_level": levels,
                "new_radiance_records": radiance,
                "fill_seconds": seconds,
                "render_seconds": cost.render_seconds[0],
                "render_cpu_seconds": cost.render_seconds[1],
            })
        };
        stats["frames"] = self.costs.iter().map(row).collect();
        stats
    }
}

impl<'a> Job<'a> {
    /// The job's camera at each of `frames`; frame K shows second K/`fps` of the animation.
    ///
    /// # Errors
    /// [`Error::InvalidArgument`] if the camera does not move, or has no direction at some time.
    pub fn cameras(&self, frames: Frames, fps: f64) -> Result<Vec<(u32, Camera)>> {
        let still = self.settings()?.camera;
        let motion = self.motion().ok_or_else(|| {
            Error::InvalidArgument(format!(
                "the camera `{}` does not move: frames need an animation of its node or of one above it",
                still.name
            ))
        })?;
        let camera = |number: u32| match motion.at(f64::from(number) / fps) {
            Some(to_world) => Ok((number, Camera { to_world, ..still.clone() })),
            None => Err(Error::InvalidArgument(format!(
                "at frame {number} the camera `{}` has no direction to look in",
                still.name
            ))),
        };
        (frames.first..=frames.last).map(camera).collect()
    }

    /// Renders a picture for each of `cameras`, which have numbers; all pictures read the same
    /// records. An automatic exposure is that of the first picture which is not black. `finished`
    /// is called with each picture. A cancelled sequence ends with the picture so far, which is
    /// [empty](Frame::is_empty) if none was begun.
    ///
    /// # Errors
    /// Those of [`Job::run`] and of `finished`.
    pub fn run_sequence(
        self, cameras: &[(u32, Camera)], finished: impl FnMut(u32, &Rendering) -> Result<()> + Send,
    ) -> Result<Sequence<'a>> {
        on_workers(|| self.render_sequence(cameras, finished))
    }

    fn render_sequence(
        mut self, cameras: &[(u32, Camera)],
        mut finished: impl FnMut(u32, &Rendering) -> Result<()>,
    ) -> Result<Sequence<'a>> {
        let settings = self.settings()?;
        let found = Found::new(settings.denoise, &self.denoisers)?;
        let mut caches = self.begin(&settings)?;
        let nobody = Progress::default();
        let progress = self.progress.unwrap_or(&nobody);
        let mut growth = vec![Growth::default(); cameras.len()];
        if let Some(caches) = &mut caches {
            self.clock.start(Phase::Fill);
            let cameras: Vec<Camera> = cameras.iter().map(|(_, camera)| camera.clone()).collect();
            let filled = fill_sequence(self.scene, &settings, &cameras, caches, progress);
            self.clock.stop();
            growth = match filled {
                Err(Error::Cancelled) => {
                    let frame = Frame { cancelled: true, ..Frame::empty(&settings, Some(caches))? };
                    let (clock, output) = (self.clock, self.output);
                    let last =
                        Rendering::new(self.scene, frame, settings, clock, output, Vec::new());
                    return Ok(Sequence { last, costs: Vec::new() });
                }
                filled => filled?,
            };
        }
        let (mut costs, mut last, mut told) = (Vec::new(), None, Vec::<String>::new());
        for ((number, camera), growth) in cameras.iter().zip(growth) {
            let settings = Settings { camera: camera.clone(), ..settings.clone() };
            let mut clock = Clock::default();
            clock.start(Phase::Render);
            let (caches, watcher) = (caches.as_ref(), &mut self.watcher);
            let mut frame = Frame::shade(self.scene, &settings, caches, None, progress, watcher)?;
            let warnings =
                found.denoise(&mut frame, &settings, &mut clock, progress, &mut self.watcher);
            told.extend(warnings.iter().filter(|w| !told.contains(w)).cloned().collect::<Vec<_>>());
            clock.start(Phase::Write);
            progress.start(Phase::Write, 0);
            let mut picture =
                Rendering::new(self.scene, frame, settings, clock, self.output.clone(), warnings);
            // The first frame with any light decides for all: the preview must not flicker.
            self.output.exposure = picture.output.exposure;
            finished(*number, &picture)?;
            picture.clock.stop();
            self.clock.add(&picture.clock);
            let render_seconds = picture.clock.seconds(Phase::Render);
            costs.push(FrameCost { number: *number, growth, render_seconds });
            let cancelled = picture.frame.cancelled;
            last = Some(picture);
            if cancelled {
                break;
            }
        }
        let mut last =
            last.ok_or_else(|| Error::InvalidArgument("a sequence without frames".into()))?;
        (last.clock, last.warnings) = (self.clock, told);
        Ok(Sequence { last, costs })
    }
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
            assert_eq!(frame_path(Path::new(pattern), 7).unwrap(), Path::new(name));
        }
        assert_eq!(frame_path(Path::new("a.exr"), 12345).unwrap(), Path::new("a.12345.exr"));
        for bad in ["a%s.exr", "a%4d.exr", "a%04d.%04d.exr", "100%.exr", "a%00000d.exr"] {
            assert!(frame_path(Path::new(bad), 7).is_err(), "{bad}");
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
