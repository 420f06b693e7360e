//! Noise taken out of a finished frame, by Open Image Denoise.
//!
//! Only what is noisy is filtered: all light of path tracers, and with a cache the light that no
//! record brought. Direct and indirect light are two pictures, not divided by albedo:
//! docs/RESULTS.md has the errors of other ways. The result is split into diffuse and glossy light
//! in the proportion that they have around a pixel.

use super::clock::Clock;
use super::frame::{Frame, Watcher};
use super::settings::{Denoise, IntegratorKind, Settings};
use crate::error::{Error, Result};
use crate::ffi::denoise::{Denoiser, GoOn, NAME, Noisy};
use crate::film::{Film, Parts, Pixel};
use crate::math::{Color, Vec3};
use crate::progress::{Phase, Progress};
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
/// The share of light up to which paths in place of missing records are not worth a filter.
const STRAYS: f64 = 0.002;
/// Units of progress of one pass.
const WORK: u64 = 1000;

/// Where programs look for Open Image Denoise: in the file or folder that the environment variable
/// `LUMICACHE_OIDN` names and nowhere else, or without it in `lumicache/oidn` of the user's data
/// folder (`XDG_DATA_HOME`, `~/.local/share`), then in the system's folders. `variable` reads the
/// environment.
pub fn denoiser_places(variable: impl Fn(&str) -> Option<OsString>) -> Vec<PathBuf> {
    let path = |name: &str| variable(name).filter(|v| !v.is_empty()).map(PathBuf::from);
    if let Some(named) = path("LUMICACHE_OIDN") {
        return vec![named];
    }
    let data = path("XDG_DATA_HOME").filter(|p| p.is_absolute());
    let data = data.or_else(|| Some(path("HOME")?.join(".local/share")));
    let ours = data.map(|folder| folder.join("lumicache/oidn"));
    ours.into_iter().chain([PathBuf::from(NAME)]).collect()
}

/// Open Image Denoise from the first of `places` that has it: see [`denoiser_places`].
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

    /// Takes the noise out of `frame` if it is complete, and shows it to `watcher`. Returns what to
    /// warn of: where the library fails, the frame stays as it is.
    pub fn denoise(
        &self, frame: &mut Frame, settings: &Settings, clock: &mut Clock, progress: &Progress,
        watcher: &mut Watcher,
    ) -> Vec<String> {
        let mut warnings: Vec<String> = self.missing.iter().cloned().collect();
        let complete = !frame.cancelled && !settings.prepass_only;
        if let Some(denoiser) = self.denoiser.as_ref().filter(|_| complete) {
            clock.start(Phase::Denoise);
            match denoise(&mut frame.film, settings.integrator, denoiser, progress) {
                Ok(()) => {
                    frame.denoiser = Some(denoiser.version());
                    let [width, height] = frame.film.window_size();
                    watcher([0, 0, width, height], &frame.film);
                }
                Err(_) if progress.is_cancelled() => frame.cancelled = true,
                Err(error) => warnings.push(error.to_string()),
            }
        }
        warnings
    }
}

/// Takes the noise out of `film`. A picture that cannot be denoised stays as it is; the error is to
/// be told.
///
/// # Errors
/// [`Error::Device`] with the library's message; also when `progress` was cancelled.
fn denoise(
    film: &mut Film, integrator: IntegratorKind, denoiser: &Denoiser, progress: &Progress,
) -> Result<()> {
    let mut parts: Vec<Parts> = film.pixels().par_iter().map(Pixel::parts).collect();
    let guides = Guides::new(film);
    let passes = passes(film.pixels(), integrator);
    progress.start(Phase::Denoise, passes.len() as u64 * WORK);
    for (pass, before) in passes.iter().zip((0..).step_by(WORK as usize)) {
        let go_on = |done: f64| {
            progress.reach(before + (done * WORK as f64) as u64);
            !progress.is_cancelled()
        };
        pass.run(film, &guides, denoiser, &mut parts, &go_on)?;
        progress.reach(before + WORK);
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
    parts: &'static [usize],
    /// How much of each pixel's light was traced, not brought by records, which stays as it is.
    /// Without it, all.
    traced: Option<Vec<f32>>,
}

/// What is noisy.
fn passes(pixels: &[Pixel], integrator: IntegratorKind) -> Vec<Pass> {
    let direct = Pass { parts: &[DIFFUSE_DIRECT, GLOSSY_DIRECT], traced: None };
    if integrator != IntegratorKind::Cache {
        return vec![direct, Pass { parts: &[DIFFUSE_INDIRECT, GLOSSY_INDIRECT], traced: None }];
    }
    let beside_records = |lobe: usize, parts: &'static [usize]| {
        let traced: Vec<f32> = pixels.iter().map(|p| p.traced()[lobe]).collect();
        let light = pixels.iter().map(|p| p.parts()[parts[0]].element_sum());
        let (mut of_paths, mut all) = (0.0, 0.0);
        for (light, share) in light.zip(&traced).filter(|(light, _)| light.is_finite()) {
            all += f64::from(light);
            of_paths += f64::from(light * share);
        }
        (of_paths > STRAYS * all).then_some(Pass { parts, traced: Some(traced) })
    };
    let indirect = [beside_records(0, &[DIFFUSE_INDIRECT]), beside_records(1, &[GLOSSY_INDIRECT])];
    std::iter::once(direct).chain(indirect.into_iter().flatten()).collect()
}

impl Pass {
    /// Filters the pass's share of `parts`.
    fn run(
        &self, film: &Film, guides: &Guides, denoiser: &Denoiser, parts: &mut [Parts], go_on: &GoOn,
    ) -> Result<()> {
        let sum = |p: &Parts| self.parts.iter().map(|&k| p[k]).sum::<Color>();
        let light = |p: &Parts| Some(sum(p)).filter(|c| c.is_finite()).unwrap_or_default();
        let color: Vec<Color> = parts.par_iter().map(light).collect();
        if color.iter().all(|c| *c == Color::ZERO) {
            return Ok(());
        }
        let size = film.window_size();
        let noisy = Noisy { size, color: &color, albedo: &guides.albedo, normal: &guides.normal };
        let clean = denoiser.run(&noisy, rayon::current_num_threads(), go_on).map_err(|what| {
            Error::Device(format!("not denoised: Open Image Denoise says: {what}"))
        })?;
        drop(color);
        let shares: Vec<[Color; 2]> = (0..parts.len())
            .into_par_iter()
            .map(|i| self.split(clean[i].max(Color::ZERO), i, size, parts, guides))
            .collect();
        parts.par_iter_mut().enumerate().for_each(|(i, p)| {
            // The background has no surface, and numbers that are none have no mean.
            let known = guides.normal[i] != Vec3::ZERO && sum(p).is_finite();
            if !known || !clean[i].is_finite() {
                return;
            }
            let traced = self.traced.as_ref().map_or(1.0, |shares| shares[i]);
            for (&k, light) in self.parts.iter().zip(shares[i]) {
                p[k] += traced * (light - p[k]);
            }
        });
        Ok(())
    }

    /// `light` of pixel `i`, split in the proportion that the pass's parts have in pixels around it
    /// that are like it. The light of a pass with one part is that part's.
    fn split(
        &self, light: Color, i: usize, [width, height]: [u32; 2], parts: &[Parts], guides: &Guides,
    ) -> [Color; 2] {
        if self.parts.len() == 1 {
            return [light, Color::ZERO];
        }
        let mut sums = [Color::ZERO; 2];
        let (x, y) = (i as i64 % i64::from(width), i as i64 / i64::from(width));
        let range = |at: i64, end: u32| (at - AROUND).max(0)..(at + AROUND + 1).min(i64::from(end));
        for row in range(y, height) {
            for column in range(x, width) {
                let j = (row * i64::from(width) + column) as usize;
                let weight = guides.alike(i, j);
                for (sum, &k) in sums.iter_mut().zip(self.parts) {
                    *sum +=
                        if parts[j][k].is_finite() { weight * parts[j][k] } else { Color::ZERO };
                }
            }
        }
        // The first part takes what rounding leaves, and all where no part has light.
        let share = |c: f32, all: f32| if all > 0.0 { c / all } else { 0.0 };
        let (c, all) = (sums[1], sums[0] + sums[1]);
        let other = light * Color::new(share(c.x, all.x), share(c.y, all.y), share(c.z, all.z));
        [(light - other).max(Color::ZERO), other]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::transport::{Radiance, Shaded, Surface};

    /// A film of which every pixel has one sample: a wall of albedo 0.5 in light of both lobes.
    fn film() -> Film {
        let mut film = Film::new([8, 6], [0, 0, 8, 6]).unwrap();
        for (i, pixel) in film.pixels_mut().iter_mut().enumerate() {
            let light = Color::splat(1.0 + (i % 3) as f32);
            let radiance = Radiance {
                diffuse_direct: light,
                diffuse_indirect: light,
                glossy_direct: 0.5 * light,
                glossy_indirect: light,
                emission: Color::ZERO,
            };
            let surface = Surface {
                position: Vec3::ZERO,
                normal: Vec3::Z,
                albedo: Color::splat(0.5),
                distance: 1.0,
            };
            pixel.add(&Shaded { radiance, surface: Some(surface), ..Default::default() });
        }
        film
    }

    #[test]
    fn light_is_split_as_around_the_pixel_and_none_is_lost() {
        let film = film();
        let parts: Vec<Parts> = film.pixels().iter().map(Pixel::parts).collect();
        let guides = Guides::new(&film);
        let pass = &passes(film.pixels(), IntegratorKind::Path)[0];
        let split = pass.split(Color::new(3.0, 6.0, 0.0), 20, [8, 6], &parts, &guides);
        let right = [Color::new(2.0, 4.0, 0.0), Color::new(1.0, 2.0, 0.0)];
        assert!(split.iter().zip(right).all(|(s, r)| s.abs_diff_eq(r, 1e-5)), "{split:?}");
        let dark = vec![Parts::default(); 48];
        let split = pass.split(Color::ONE, 20, [8, 6], &dark, &guides);
        assert_eq!(split, [Color::ONE, Color::ZERO]);
    }

    #[test]
    fn light_from_records_is_not_filtered() {
        let film = film();
        let of = |kind| passes(film.pixels(), kind).iter().map(|p| p.parts).collect::<Vec<_>>();
        assert_eq!(of(IntegratorKind::Bdpt), [[0, 2], [1, 3]]);
        // No sample says that a record answered.
        assert_eq!(of(IntegratorKind::Cache), [&[0, 2][..], &[1], &[3]]);
        let mut cached = film.clone();
        for pixel in cached.pixels_mut() {
            let status = crate::transport::Status::Cached;
            pixel.add(&Shaded { status, glossy: status, ..Default::default() });
        }
        assert_eq!(passes(cached.pixels(), IntegratorKind::Cache).len(), 1);
    }

    #[test]
    fn numbers_that_are_none_do_no_harm() {
        let places = denoiser_places(|name| std::env::var_os(name));
        let Ok(denoiser) = find_denoiser(&places) else {
            eprintln!("SKIPPED: there is no Open Image Denoise");
            return;
        };
        let mut film = film();
        for (i, bad) in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY].into_iter().enumerate() {
            let pixel = &mut film.pixels_mut()[9 * i];
            let surface = Surface {
                position: Vec3::ZERO,
                normal: Vec3::splat(bad),
                albedo: Color::splat(bad),
                distance: 1.0,
            };
            pixel.add(&Shaded { surface: Some(surface), ..Default::default() });
            film.splat(&crate::transport::Splat { pixel: 30, part: 0, light: Color::splat(bad) });
        }
        let progress = Progress::default();
        denoise(&mut film, IntegratorKind::Path, &denoiser, &progress).unwrap();
        let shown = film.radiance();
        let broken: Vec<usize> = (0..48).filter(|&i| !shown[i].is_finite()).collect();
        assert_eq!(broken, [30], "one pixel had no number, and it spoils no other");
        assert!(shown[20].max_element() > 1.0);
        let told = progress.snapshot();
        assert_eq!([told.done, told.total], [2 * WORK; 2]);
        // Cancelled work leaves the film as it is.
        let mut film = self::film();
        progress.cancel();
        assert!(denoise(&mut film, IntegratorKind::Path, &denoiser, &progress).is_err());
        assert!(!film.is_denoised());
    }

    #[test]
    fn the_environment_says_where_to_look() {
        let of = |set: &[(&str, &str)]| {
            let value = |name: &str| set.iter().find(|(n, _)| *n == name).map(|(_, v)| v.into());
            denoiser_places(value)
        };
        let system = PathBuf::from(NAME);
        assert_eq!(
            of(&[("LUMICACHE_OIDN", "/a/b.so"), ("HOME", "/h")]),
            [PathBuf::from("/a/b.so")]
        );
        let home = PathBuf::from("/h/.local/share/lumicache/oidn");
        assert_eq!(of(&[("LUMICACHE_OIDN", ""), ("HOME", "/h")]), [home, system.clone()]);
        let data = PathBuf::from("/d/lumicache/oidn");
        assert_eq!(of(&[("XDG_DATA_HOME", "/d"), ("HOME", "/h")]), [data, system.clone()]);
        assert_eq!(of(&[]), [system]);
    }
}
