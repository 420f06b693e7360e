//! Whole pictures of our own scenes, for hosts that have no renderer of their own.

use super::abi::{
    LUMI_RENDER_DENOISE, LUMI_RENDER_DENOISE_AUTO, LUMI_RENDER_ORTHOGRAPHIC, LUMI_RENDER_PATH,
    Output, lumi_cache, lumi_layer, lumi_render_desc, only, read, text,
};
use super::cache::CacheObject;
use super::describe::{self, in_range};
use super::handles::borrow;
use super::status::{Fault, Outcome, ensure, guard, lumi_error};
use crate::camera::{Camera, Projection};
use crate::error::Error;
use crate::film::{LAYERS, Layer};
use crate::progress::Progress;
use crate::render::{Caches, Denoise, IntegratorKind, Job};

/// Most layers of one picture.
const MOST_LAYERS: usize = 256;

fn camera(desc: &lumi_render_desc) -> Outcome<Camera> {
    let positive = desc.yfov.is_finite() && desc.yfov > 0.0;
    let projection = if desc.flags & LUMI_RENDER_ORTHOGRAPHIC != 0 {
        let aspect =
            if desc.aspect == 0.0 { desc.width as f32 / desc.height as f32 } else { desc.aspect };
        let sound = positive && aspect.is_finite() && aspect > 0.0;
        ensure!(sound, "render: the size of the orthographic camera is not positive");
        Projection::Orthographic { xmag: desc.yfov * aspect, ymag: desc.yfov }
    } else {
        let (yfov, sound) = (desc.yfov, positive && desc.yfov < std::f32::consts::PI);
        ensure!(sound, "render: yfov is {yfov}, expected a positive angle below pi");
        Projection::Perspective { yfov }
    };
    let to_world = describe::transform(&desc.camera, "render: camera")?;
    let near = in_range(desc.near_plane, 0.0, f32::MAX, "render: near_plane")?;
    let far = if desc.far_plane == 0.0 { f32::INFINITY } else { desc.far_plane };
    ensure!(far > near, "render: far_plane is {far}, and near_plane is {near}");
    Ok(Camera { name: "host".into(), projection, aspect: None, to_world, clip: [near, far] })
}

/// The layers that the host wants, and their room.
fn wanted(
    layers: *const lumi_layer, count: usize, samples: usize,
) -> Outcome<Vec<(&'static Layer, Output<f32, 1>)>> {
    let possible = count <= MOST_LAYERS && (!layers.is_null() || count == 0);
    ensure!(possible, "render: {count} layers at {layers:?}");
    let one = |i: usize| {
        // SAFETY: the host passes `count` layers, and i is below that.
        let wanted = unsafe { layers.add(i).read_unaligned() };
        let name = text(wanted.name, "the name of a layer")?;
        let layer = LAYERS
            .iter()
            .find(|l| l.name == name)
            .ok_or_else(|| Fault::argument(format!("render: there is no layer `{name}`")))?;
        let (channels, given) = (layer.channels.len(), wanted.channels);
        ensure!(
            channels == given as usize,
            "render: the layer `{name}` has {channels} channels, not {given}"
        );
        let room = Output::new(wanted.data, samples * channels, 0, "the room of a layer")?;
        ensure!(room.is_wanted(), "render: the room of the layer `{name}` is NULL");
        Ok((layer, room))
    };
    (0..count).map(one).collect()
}

impl CacheObject {
    fn render(&self, desc: &lumi_render_desc, layers: *const lumi_layer, count: usize) -> Outcome {
        let known = LUMI_RENDER_PATH
            | LUMI_RENDER_ORTHOGRAPHIC
            | LUMI_RENDER_DENOISE
            | LUMI_RENDER_DENOISE_AUTO;
        only(known, desc.flags, "render")?;
        let (width, height) = (desc.width, desc.height);
        let possible = [width, height].iter().all(|n| (1..=1 << 16).contains(n));
        ensure!(possible, "render: {width} x {height} pixels are not possible");
        let mut layers = wanted(layers, count, width as usize * height as usize)?;
        let (scene, made_by) = (self.scene.own()?, self.settings());
        let _alone = self.change()?;
        let integrator = if desc.flags & LUMI_RENDER_PATH != 0 {
            IntegratorKind::Path
        } else {
            IntegratorKind::Cache
        };
        let denoise = match desc.flags & (LUMI_RENDER_DENOISE | LUMI_RENDER_DENOISE_AUTO) {
            0 => Denoise::Off,
            LUMI_RENDER_DENOISE_AUTO => Denoise::Auto,
            _ => Denoise::On,
        };
        let device = &self.scene.device;
        let snapshot = self.live.snapshot();
        let (before, progress) = (snapshot.compact(), Progress::default());
        let before = match self.lobes.load_full() {
            Some(lobes) => Caches::with(before, Some(lobes)),
            None => Caches::new(scene, &made_by.scheme, made_by.max_bounces, Some(before)),
        };
        let mut job = Job::new(scene)
            .scheme(made_by.scheme)
            .quality(made_by.quality)
            .integrator(integrator)
            .camera(camera(desc)?.shifted(-scene.origin()))
            .size(desc.width, desc.height)
            .max_bounces(made_by.max_bounces)
            .seed(made_by.seed)
            .denoise(denoise, &device.denoisers)
            .caches(before)
            .progress(&progress);
        if desc.samples > 0 {
            job = job.spp(desc.samples);
        }
        let picture = self.run(&progress, true, |_| job.run())??;
        picture.warnings.iter().for_each(|warning| device.warn(warning));
        let frame = picture.frame;
        for (layer, room) in &mut layers {
            let channels = frame.film.channels(layer);
            for (c, samples) in channels.iter().enumerate() {
                for (i, x) in samples.iter().enumerate() {
                    room.set(i * channels.len() + c, [*x]);
                }
            }
        }
        if frame.cancelled {
            return Err(Error::Cancelled.into());
        }
        if let Some(caches) = frame.caches.filter(|_| !snapshot.is_frozen()) {
            self.put(caches.cache, caches.lobes);
        }
        Ok(())
    }
}

/// Renders a picture of a scene that the library keeps, as the command line does. The cache is
/// filled where the camera needs records. Indirect light of diffuse surfaces, and of glossy lobes
/// that the preset caches, is interpolated from the records; all other light is traced. The records
/// are kept, unless the cache is frozen. When cancelled, the layers hold the samples so far.
///
/// `layers`: `count` layers with room for their samples.
///
/// Threads: one per cache; the work is done on the device's threads.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn lumi_cache_render(
    cache: lumi_cache, desc: *const lumi_render_desc, layers: *const lumi_layer, count: usize,
) -> lumi_error {
    guard("lumi_cache_render", || {
        let cache = borrow::<CacheObject>(cache)?;
        cache.render(&read(desc, "the picture")?, layers, count)
    })
}
