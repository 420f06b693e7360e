//! What the camera of a frame needs of the caches.

use super::caches::{Caches, Job, Spot};
use super::settings::{Settings, camera_sample, pixel_order};
use crate::cache::Order;
use crate::camera::Camera;
use crate::error::Result;
use crate::progress::Progress;
use crate::scene::Scene;
use crate::transport::{PathTracer, Service, View, pixel_footprint};
use rayon::prelude::*;
use std::sync::Arc;

/// Shading points of the deeper levels, per level.
const DEEPER_POINTS: usize = 16_384;

/// Fills `caches` with what the camera of `settings` needs beside the records that there are.
/// Returns for each pixel of the window how many records existed when it was visited.
///
/// `others` are further cameras that will see the records: no record is made larger than the
/// smallest of their pixels allows.
///
/// # Errors
/// [`Error::Cancelled`](crate::error::Error::Cancelled).
pub fn fill_for_camera(
    caches: &mut Caches,
    scene: &Scene,
    settings: &Settings,
    others: &[Camera],
    progress: &Progress,
) -> Result<Vec<u32>> {
    let tracer = PathTracer { scene, max_bounces: settings.max_bounces };
    let order = pixel_order(settings);
    let mut births = vec![u32::MAX; order.len()];
    let spots = visible(caches, tracer, settings, others, &order);
    let width = (settings.window[2] - settings.window[0]) as usize;
    let look = |spots: &[Spot], service: Option<&Service>| -> Vec<Option<View>> {
        let samples = spots.iter().map(|s| camera_sample(settings, s.number, 0, u32::MAX));
        let rays: Vec<_> = samples.map(|s| (s.camera, s.seed)).collect();
        tracer.views(&rays, service)
    };
    let job = Job {
        tracer,
        deeper_points: DEEPER_POINTS,
        round: if settings.scheme.order == Order::Scanline { width } else { 0 },
        seed: settings.seed,
        look: &look,
        towards: Some(&|p| settings.camera.towards(p)),
    };
    let made = caches.fill(&job, &spots, progress)?;
    spots.iter().zip(made).for_each(|(s, birth)| births[s.number as usize] = birth);
    Ok(births)
}

/// What the pixels see by their first samples. Decides which materials are worth radiance records.
fn visible(
    caches: &mut Caches,
    tracer: PathTracer,
    settings: &Settings,
    others: &[Camera],
    order: &[u32],
) -> Vec<Spot> {
    let scheme = &settings.scheme;
    let all = vec![true; tracer.scene.materials().len()];
    let service = caches.gloss.as_ref().map(|g| Service::new(&g.tables, &all, scheme));
    let whole = scheme.radiance_diffuse && caches.gloss.is_some();
    let mut visible: Vec<(Spot, bool)> = order
        .par_iter()
        .filter_map(|&number| {
            let sample = camera_sample(settings, number, 0, u32::MAX);
            let (mut point, order, diffuse) =
                tracer.first_cached(&sample.camera, sample.seed, service.as_ref())?;
            for camera in others {
                let footprint = pixel_footprint(camera, settings.size, &point);
                point.footprint = point.footprint.min(footprint.unwrap_or(f32::INFINITY));
            }
            let order = if whole { scheme.radiance_order } else { order };
            Some((Spot { number, point, irradiance: order == 0, order }, diffuse))
        })
        .collect();
    if let Some(gloss) = caches.gloss.as_mut().filter(|_| !scheme.radiance_diffuse) {
        let mut paths = vec![0.0; all.len()];
        for (spot, _) in visible.iter().filter(|(spot, _)| spot.order > 0) {
            paths[spot.point.material as usize] += settings.spp as f32;
        }
        Arc::make_mut(gloss).serve(&paths, scheme);
        for (spot, diffuse) in &mut visible {
            spot.order *= u8::from(gloss.serves(spot.point.material));
            spot.irradiance = spot.order == 0 && *diffuse;
        }
    }
    visible.into_iter().map(|(spot, _)| spot).filter(|s| s.order > 0 || s.irradiance).collect()
}
