//! Noise taken out of a finished frame, by Open Image Denoise.
//!
//! Only what is noisy is filtered: all light of path tracers, and with a cache the light that no
//! record brought. Parts that are noisy everywhere are filtered together, undivided by albedo, and
//! the result is split in the proportion of the parts around a pixel: docs/RESULTS.md has the
//! errors of other ways.

use super::clock::Clock;
use super::frame::Frame;
use super::settings::{IntegratorKind, Settings};
use crate::error::{Error, Result};
use crate::ffi::denoise::{Denoiser, Noisy};
use crate::film::{Film, Parts, Pixel};
use crate::math::{Color, Vec3};
use crate::progress::{Phase, Progress};
use crate::words::words;
use rayon::prelude::*;
use std::ffi::OsString;
use std::path::PathBuf;

/// The places of the parts in [`Parts`]. Emission has no noise of its own.
const DIFFUSE_DIRECT: usize = 0;
const DIFFUSE_INDIRECT: usize = 1;
const GLOSSY_DIRECT: usize = 2;
const GLOSSY_INDIRECT: usize = 3;

/// Pixels on each side of one whose light decides in which proportion that of the pixel is split.
const AROUND: i64 = 3;
/// Squared difference of albedo or normal at which a pixel counts 1/e.
const ALIKE: f32 = 0.02;
/// Paths that stand in for missing records are filtered where they are more than so large a share.
const STRAYS: f32 = 0.002;

words! {
    /// Whether a picture is denoised.
    pub enum Denoise {
        /// Where Open Image Denoise is installed.
        Auto = "auto",
        /// Always: without Open Image Denoise nothing is rendered.
        On = "on",
        /// Never.
        Off = "off",
    }
}

/// Where programs look for Open Image Denoise before the system's folders: the file or folder that
/// the environment variable `LUMICACHE_OIDN` names, else `lumicache/oidn` in the user's data folder
/// (`XDG_DATA_HOME`, `~/.local/share`). `variable` reads the environment.
pub fn denoiser_places(variable: impl Fn(&str) -> Option<OsString>) -> Vec<PathBuf> {
    let path = |name: &str| variable(name).filter(|v| !v.is_empty()).map(PathBuf::from);
    if let Some(named) = path("LUMICACHE_OIDN") {
        return vec![named];
    }
    let data = path("XDG_DATA_HOME").filter(|p| p.is_absolute());
    let data = data.or_else(|| Some(path("HOME")?.join(".local/share")));
    data.into_iter().map(|folder| folder.join("lumicache/oidn")).collect()
}

/// Open Image Denoise from the first of `places` that has it, else from the system's folders.
///
/// # Errors
/// [`Error::Device`] that says what is missing, and how to get it.
pub fn find_denoiser(places: &[PathBuf]) -> Result<Denoiser> {
    Denoiser::load(places).map_err(|what| {
        Error::Device(format!(
            "{what}; `make denoiser` installs it, or LUMICACHE_OIDN names its file or folder"
        ))
    })
}

/// The denoiser of pictures, if they want one and there is one.
pub(super) struct Found {
    denoiser: Option<Denoiser>,
    /// What to tell the user of the search.
    missing: Option<String>,
}

impl Found {
    /// Looks in `places` for what `denoise` asks for.
    ///
    /// # Errors
    /// Those of [`find_denoiser`] if pictures must be denoised.
    pub fn new(denoise: Denoise, places: &[PathBuf]) -> Result<Self> {
        let (denoiser, missing) = match denoise {
            Denoise::Off => (None, None),
            Denoise::On => (Some(find_denoiser(places)?), None),
            Denoise::Auto => match find_denoiser(places) {
                Ok(denoiser) => (Some(denoiser), None),
                Err(error) => (None, Some(format!("not denoised: {error}"))),
            },
        };
        Ok(Self { denoiser, missing })
    }

    /// Takes the noise out of `frame` if it is complete. Returns what to warn of: where the library
    /// fails, the frame stays as it is.
    pub fn denoise(
        &self, frame: &mut Frame, settings: &Settings, clock: &mut Clock, progress: &Progress,
    ) -> Vec<String> {
        let mut warnings: Vec<String> = self.missing.iter().cloned().collect();
        let complete = !frame.cancelled && !settings.prepass_only;
        if let Some(denoiser) = self.denoiser.as_ref().filter(|_| complete) {
            clock.start(Phase::Denoise);
            progress.start(Phase::Denoise, 0);
            let done = denoise(&mut frame.film, settings.integrator, denoiser);
            warnings.extend(done.err().map(|error| error.to_string()));
        }
        warnings
    }
}

/// Takes the noise out of `film`. A picture that cannot be denoised stays as it is; the error is to
/// be told.
///
/// # Errors
/// [`Error::Device`] with the library's message.
fn denoise(film: &mut Film, integrator: IntegratorKind, denoiser: &Denoiser) -> Result<()> {
    let mut parts: Vec<Parts> = film.pixels().par_iter().map(Pixel::parts).collect();
    let guides = Guides::new(film);
    for pass in passes(film.pixels(), integrator) {
        pass.run(film, &guides, denoiser, &mut parts)?;
    }
    film.denoise(parts);
    Ok(())
}

/// What is known of the surfaces of each pixel.
struct Guides {
    albedo: Vec<Color>,
    normal: Vec<Vec3>,
}

impl Guides {
    fn new(film: &Film) -> Self {
        let finite = |v: Vec3| if v.is_finite() { v } else { Vec3::ZERO };
        let pixels = film.pixels().par_iter();
        Self {
            albedo: pixels
                .clone()
                .map(|p| finite(p.albedo()).clamp(Vec3::ZERO, Vec3::ONE))
                .collect(),
            normal: pixels.map(|p| finite(p.normal())).collect(),
        }
    }

    /// How much pixel `j` is like pixel `i`, 0 to 1.
    fn alike(&self, i: usize, j: usize) -> f32 {
        let difference = self.albedo[i].distance_squared(self.albedo[j])
            + self.normal[i].distance_squared(self.normal[j]);
        (-difference / ALIKE).exp()
    }
}

/// Parts that are filtered as one picture.
struct Pass {
    parts: Vec<usize>,
    /// How much of each pixel's light was traced, not brought by records, which stays as it is.
    /// Without it, all.
    traced: Option<Vec<f32>>,
}

/// What is noisy.
fn passes(pixels: &[Pixel], integrator: IntegratorKind) -> Vec<Pass> {
    let all = |parts: &[usize]| Pass { parts: parts.to_vec(), traced: None };
    if integrator != IntegratorKind::Cache {
        return vec![all(&[DIFFUSE_DIRECT, DIFFUSE_INDIRECT, GLOSSY_DIRECT, GLOSSY_INDIRECT])];
    }
    let share = |k: usize| pixels.iter().map(|p| p.traced()[k]).collect::<Vec<f32>>();
    let mean = |shares: &[f32]| shares.iter().sum::<f32>() / shares.len().max(1) as f32;
    let (diffuse, glossy) = (share(0), share(1));
    let mut passes = match mean(&glossy) {
        1.0 => vec![all(&[DIFFUSE_DIRECT, GLOSSY_DIRECT, GLOSSY_INDIRECT])],
        _ => vec![
            all(&[DIFFUSE_DIRECT, GLOSSY_DIRECT]),
            Pass { parts: vec![GLOSSY_INDIRECT], traced: Some(glossy) },
        ],
    };
    if mean(&diffuse) > STRAYS {
        passes.push(Pass { parts: vec![DIFFUSE_INDIRECT], traced: Some(diffuse) });
    }
    passes
}

impl Pass {
    /// Filters the pass's share of `parts`.
    fn run(
        &self, film: &Film, guides: &Guides, denoiser: &Denoiser, parts: &mut [Parts],
    ) -> Result<()> {
        let sum = |p: &Parts| self.parts.iter().map(|&k| p[k]).sum::<Color>();
        let light = |p: &Parts| Some(sum(p)).filter(|c| c.is_finite()).unwrap_or_default();
        let color: Vec<Color> = parts.par_iter().map(light).collect();
        if color.iter().all(|c| *c == Color::ZERO) {
            return Ok(());
        }
        let size = film.window_size();
        let noisy = Noisy { size, color: &color, albedo: &guides.albedo, normal: &guides.normal };
        let clean = denoiser.run(&noisy, rayon::current_num_threads()).map_err(|what| {
            Error::Device(format!("not denoised: Open Image Denoise says: {what}"))
        })?;
        let before = parts.to_vec();
        parts.par_iter_mut().enumerate().for_each(|(i, p)| {
            // The background has no surface, and numbers that are none have no mean.
            let known = guides.normal[i] != Vec3::ZERO && sum(&before[i]).is_finite();
            if !known || !clean[i].is_finite() {
                return;
            }
            let traced = self.traced.as_ref().map_or(1.0, |shares| shares[i]);
            let split = self.split(clean[i].max(Color::ZERO), i, size, &before, guides);
            for (&k, light) in self.parts.iter().zip(split) {
                p[k] += traced * (light - p[k]);
            }
        });
        Ok(())
    }

    /// `light` of pixel `i`, split in the proportion that the pass's parts have in pixels around it
    /// that are like it.
    fn split(
        &self, light: Color, i: usize, [width, height]: [u32; 2], parts: &[Parts], guides: &Guides,
    ) -> Vec<Color> {
        let mut sums = vec![Color::ZERO; self.parts.len()];
        if sums.len() == 1 {
            return vec![light];
        }
        let (x, y) = (i as i64 % i64::from(width), i as i64 / i64::from(width));
        let range = |at: i64, end: u32| (at - AROUND).max(0)..(at + AROUND + 1).min(i64::from(end));
        for row in range(y, height) {
            for column in range(x, width) {
                let j = (row * i64::from(width) + column) as usize;
                let weight = guides.alike(i, j);
                for (sum, &k) in sums.iter_mut().zip(&self.parts) {
                    *sum +=
                        if parts[j][k].is_finite() { weight * parts[j][k] } else { Color::ZERO };
                }
            }
        }
        // The first part takes what rounding leaves, and all where no part has light.
        let all: Color = sums.iter().sum();
        let share = |c: f32, all: f32| if all > 0.0 { c / all } else { 0.0 };
        let mut rest = light;
        let mut split: Vec<Color> = sums[1..]
            .iter()
            .map(|c| {
                let share = Color::new(share(c.x, all.x), share(c.y, all.y), share(c.z, all.z));
                rest -= light * share;
                light * share
            })
            .collect();
        split.insert(0, rest.max(Color::ZERO));
        split
    }
}
