//! What the camera of a frame needs of the caches.

use super::caches::Caches;
use super::settings::{Settings, camera_sample, pixel_order};
use crate::cache::{FillPlan, ShadingPoint};
use crate::camera::Camera;
use crate::error::Result;
use crate::progress::Progress;
use crate::scene::Scene;
use crate::transport::{CachedLobes, PathTracer, SceneWorld, View, pixel_footprint};
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
    caches: &mut Caches, scene: &Scene, settings: &Settings, others: &[Camera], progress: &Progress,
) -> Result<Vec<u32>> {
    let tracer = PathTracer { scene, max_bounces: settings.max_bounces };
    let order = pixel_order(settings);
    let mut births = vec![u32::MAX; order.len()];
    let points = visible(caches, tracer, settings, others, &order);
    let width = (settings.window[2] - settings.window[0]) as usize;
    let appearance = |points: &[ShadingPoint], lobes: Option<CachedLobes>| -> Vec<Option<View>> {
        let samples = points.iter().map(|p| camera_sample(settings, p.number, 0, u32::MAX));
        let rays: Vec<_> = samples.map(|s| (s.camera, s.seed)).collect();
        tracer.views(&rays, lobes)
    };
    let towards = |p| settings.camera.towards(p);
    let lobes = caches.lobes.clone();
    let world = SceneWorld::new(tracer, lobes.as_deref(), &settings.scheme)
        .with_appearance(&appearance)
        .with_viewer(&towards);
    let plan = FillPlan {
        deeper_points: DEEPER_POINTS,
        round: if settings.scheme.schedule.is_by_row() { width } else { 0 },
        seed: settings.seed,
    };
    let made = caches.fill(&world, &points, &plan, progress)?;
    points.iter().zip(made).for_each(|(p, birth)| births[p.number as usize] = birth);
    Ok(births)
}

/// What the pixels see by their first samples. Decides which materials are worth radiance records.
fn visible(
    caches: &mut Caches, tracer: PathTracer, settings: &Settings, others: &[Camera], order: &[u32],
) -> Vec<ShadingPoint> {
    let scheme = &settings.scheme;
    let all = caches.lobes.as_deref().map(|lobes| {
        let mut all = lobes.clone();
        all.admit_all();
        all
    });
    let lobes = all.as_ref().map(|l| l.choice(scheme));
    let mut visible: Vec<(ShadingPoint, bool)> = order
        .par_iter()
        .filter_map(|&number| {
            let sample = camera_sample(settings, number, 0, u32::MAX);
            let (mut point, order, diffuse) =
                tracer.first_cached(&sample.camera, sample.seed, lobes)?;
            for camera in others {
                let footprint = pixel_footprint(camera, settings.size, &point);
                point.footprint = point.footprint.min(footprint.unwrap_or(f32::INFINITY));
            }
            Some((caches.cache.shading_point(0, number, point, order), diffuse))
        })
        .collect();
    if let Some(lobes) = caches.lobes.as_mut().filter(|_| !scheme.whole()) {
        let mut paths = vec![0.0; tracer.scene.materials().len()];
        for (p, _) in visible.iter().filter(|(p, _)| p.order > 0) {
            paths[p.point.material as usize] += settings.spp as f32;
        }
        let lobes = Arc::make_mut(lobes);
        lobes.admit(&paths, scheme);
        for (p, diffuse) in &mut visible {
            p.order *= u8::from(lobes.are_cached(p.point.material));
            p.irradiance = p.order == 0 && *diffuse;
        }
    }
    visible.into_iter().map(|(p, _)| p).filter(|p| p.order > 0 || p.irradiance).collect()
}
