//! From a finished film to files: layers with their attributes, and the preview.

use super::records;
use super::settings::Settings;
use super::{Frame, Selection};
use crate::camera::{Camera, Projection};
use crate::error::Result;
use crate::imagefile::exr::{self, Attribute, Channel, Crop, Layers, REC_709, SampleKind};
use crate::imagefile::ldr;
use crate::math::Color;
use glam::Mat4;
use std::path::Path;

/// Writes the layers of `frame` that `selection` names to `path`.
///
/// # Errors
/// Those of writing the file.
pub fn write_exr(
    path: &Path,
    frame: &Frame,
    settings: &Settings,
    selection: &Selection,
    facts: &Facts,
) -> Result<()> {
    exr::write(path, &layers(frame, settings, selection, facts))
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
    /// Draw the records over the image and write them as layers.
    pub show_records: bool,
}

fn layers(frame: &Frame, settings: &Settings, selection: &Selection, facts: &Facts) -> Layers {
    let film = &frame.film;
    let [width, height] = film.window_size();
    let mut channels = Vec::new();
    for layer in selection.layers() {
        let kind = if layer.half { SampleKind::Half } else { SampleKind::Float };
        for (k, samples) in film.channels(layer).into_iter().enumerate() {
            channels.push(Channel { name: layer.channel_name(k), kind, samples });
        }
    }
    if let Some(caches) = frame.caches.as_ref().filter(|_| facts.show_records) {
        let drawn = records::draw(film, &caches.cache, settings);
        for (k, name) in ["R", "G", "B"].iter().enumerate() {
            let samples = drawn.overlay.iter().map(|c| c[k]).collect();
            channels.push(Channel {
                name: format!("gi.overlay.{name}"),
                kind: SampleKind::Half,
                samples,
            });
        }
        channels.push(Channel {
            name: "gi.level".into(),
            kind: SampleKind::Half,
            samples: drawn.level,
        });
    }
    let mut attributes = vec![
        (
            "software".into(),
            Attribute::Text(concat!("lumicache ", env!("CARGO_PKG_VERSION")).into()),
        ),
        ("settings".into(), Attribute::Text(settings.describe())),
        ("seconds".into(), Attribute::Double(facts.seconds)),
        ("samplesPerPixel".into(), Attribute::Int(settings.spp as i32)),
        ("sceneHash".into(), Attribute::Text(facts.scene_hash.clone())),
        ("backend".into(), Attribute::Text(facts.backend.clone())),
        ("chromaticities".into(), REC_709),
        (
            "worldToCamera".into(),
            Attribute::M44f(world_to_camera(&settings.camera).to_cols_array()),
        ),
        (
            "worldToNDC".into(),
            Attribute::M44f(world_to_ndc(&settings.camera, settings.size).to_cols_array()),
        ),
    ];
    if frame.cancelled {
        attributes.push(("cancelled".into(), Attribute::Int(1)));
    }
    let [x0, y0, _, _] = film.window;
    let crop = (film.window_size() != film.size)
        .then_some(Crop { origin: [x0 as i32, y0 as i32], whole: film.size });
    Layers { width, height, channels, attributes, crop }
}

fn world_to_camera(camera: &Camera) -> Mat4 {
    Mat4::from(camera.to_world.inverse())
}

/// World to normalised device coordinates: x and y in [-1, 1] over the image, y up.
pub(super) fn world_to_ndc(camera: &Camera, size: [u32; 2]) -> Mat4 {
    let aspect = size[0] as f32 / size[1] as f32;
    let projection = match camera.projection {
        Projection::Perspective { yfov } => {
            glam::camera::rh::proj::opengl::perspective(yfov, aspect, 0.01, 1e5)
        }
        Projection::Orthographic { xmag, ymag } => {
            glam::camera::rh::proj::opengl::orthographic(-xmag, xmag, -ymag, ymag, 0.01, 1e5)
        }
    };
    projection * world_to_camera(camera)
}

/// Writes the beauty, or the picture with records drawn over it, as an 8-bit sRGB PNG.
///
/// # Errors
/// Those of writing the file.
pub fn write_preview(
    path: &Path,
    frame: &Frame,
    settings: &Settings,
    exposure_ev: f32,
    show_records: bool,
) -> Result<()> {
    let pixels: Vec<Color> = match frame.caches.as_ref().filter(|_| show_records) {
        Some(caches) => records::draw(&frame.film, &caches.cache, settings).overlay,
        None => frame.film.radiance(),
    };
    let [width, height] = frame.film.window_size();
    ldr::write_png(path, width, height, &ldr::to_srgb8(&pixels, exposure_ev))
}
