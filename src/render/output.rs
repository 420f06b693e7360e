//! Files of a finished frame: its layers with attributes, and the preview.

use super::frame::Frame;
use super::overlay;
use super::selection::Selection;
use super::settings::Settings;
use crate::error::Result;
use crate::imagefile::{Attribute, Picture, REC_709, SampleKind, exr, ldr};
use crate::math::Color;
use glam::{DVec3, Mat4};
use std::path::Path;

/// Writes the layers of `frame` that `selection` names to `path`.
///
/// # Errors
/// Those of writing the file.
pub fn write_exr(
    path: &Path, frame: &Frame, settings: &Settings, selection: &Selection, facts: &Facts,
) -> Result<()> {
    exr::write(path, &picture(frame, settings, selection, facts))
}

/// What the file says of the run beside the pixels.
#[derive(Clone, Debug, Default)]
pub struct Facts {
    /// Wall seconds of fill and render.
    pub seconds: f64,
    /// Hash of the scene, hexadecimal.
    pub scene_hash: String,
    /// Name and version of the ray tracer.
    pub backend: String,
    /// Where the zero of the scene's coordinates lies in the world.
    pub origin: DVec3,
    /// Stops by which the preview is exposed; the layers are not.
    pub exposure: f32,
    /// Draw the records over the image and write them as layers.
    pub show_records: bool,
    /// Write 32-bit floats everywhere.
    pub float: bool,
}

fn picture(frame: &Frame, settings: &Settings, selection: &Selection, facts: &Facts) -> Picture {
    let film = &frame.film;
    let mut picture = film.picture(selection.of(film.is_denoised()));
    if let Some(caches) = frame.caches.as_ref().filter(|_| facts.show_records) {
        let drawn = overlay::draw(film, &caches.cache, settings);
        picture.add_colors("gi.overlay.", SampleKind::Half, &drawn.overlay);
        picture.add("gi.level", SampleKind::Half, drawn.level);
    }
    if facts.float {
        picture.channels.iter_mut().for_each(|c| c.kind = SampleKind::Float);
    }
    let text = |text: &str| Attribute::Text(text.to_owned());
    let matrix = |matrix: Mat4| Attribute::M44f(matrix.to_cols_array());
    let camera = settings.camera.clone().shifted(facts.origin);
    let attributes = [
        ("software", text(concat!("lumicache ", env!("CARGO_PKG_VERSION")))),
        ("settings", text(&settings.describe())),
        ("seconds", Attribute::Double(facts.seconds)),
        ("samplesPerPixel", Attribute::Int(settings.spp as i32)),
        ("previewExposure", Attribute::Float(facts.exposure)),
        ("sceneHash", text(&facts.scene_hash)),
        ("backend", text(&facts.backend)),
        ("chromaticities", REC_709),
        ("worldToCamera", matrix(camera.world_to_camera())),
        ("worldToNDC", matrix(camera.world_to_ndc(settings.size))),
    ];
    let cancelled = frame.cancelled.then_some(("cancelled", Attribute::Int(1)));
    let denoiser = frame.denoiser.as_ref();
    let denoiser = denoiser.map(|v| ("denoiser", text(&format!("Open Image Denoise {v}"))));
    let attributes = attributes.into_iter().chain(cancelled).chain(denoiser);
    picture.attributes = attributes.map(|(name, value)| (name.to_owned(), value)).collect();
    picture
}

/// Writes the beauty, or the picture with records drawn over it, as an 8-bit sRGB PNG or JPEG.
///
/// # Errors
/// Those of writing the file.
pub fn write_preview(
    path: &Path, frame: &Frame, settings: &Settings, exposure_ev: f32, show_records: bool,
) -> Result<()> {
    let pixels: Vec<Color> = match frame.caches.as_ref().filter(|_| show_records) {
        Some(caches) => overlay::draw(&frame.film, &caches.cache, settings).overlay,
        None => frame.film.radiance(),
    };
    let [width, height] = frame.film.window_size();
    ldr::write(path, width, height, &ldr::to_srgb8(&pixels, exposure_ev))
}
