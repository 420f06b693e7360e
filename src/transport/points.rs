//! Where records are needed: the surface points that the camera sees, and those that light reaches
//! them from.

use super::CachedLobes;
use super::path::reflected;
use super::path::{PathTracer, Sampled};
use super::vertex::Vertex;
use crate::accel::Ray;
use crate::cache::Appearance;
use crate::camera::{Camera, CameraRay};
use crate::geometry::SurfacePoint;
use crate::material::{Bsdf, Lobe};
use crate::math::{INV_PI, Vec2, luminance};
use crate::sampling::{LONGEST_PATH, Sampler, hash, square_to_cosine_hemisphere, stream, unit_f32};
use glam::UVec2;
use rayon::prelude::*;

/// A pixel's shadow on a surface seen at a grazing angle is not taken longer than this multiple of
/// its width.
const MAX_STRETCH: f32 = 10.0;
/// Samples of the lights for the [`Appearance`] of a point.
const LIGHT_SAMPLES: u32 = 4;
/// Points whose shadow rays are traced together.
const APPEARANCES: usize = 64;

/// A point that the camera sees, its BSDF, and how it looks.
pub type View = (SurfacePoint, Bsdf, Appearance);

/// Diameter of a pixel of `camera` after a path of length `distance`, on a surface seen under the
/// cosine `cos`.
///
/// The whole path counts, not its last segment: behind a mirror pixels go on growing as before it.
pub(super) fn footprint(camera: &CameraRay, distance: f32, cos: f32) -> f32 {
    (camera.pixel_offset + camera.pixel_angle * distance)
        * (1.0 / cos.max(1.0 / MAX_STRETCH)).sqrt()
}

/// Diameter of a pixel of `camera` on the surface at `point`, if the point lies inside the image of
/// `size` pixels, hidden or not.
pub fn pixel_footprint(camera: &Camera, size: [u32; 2], point: &SurfacePoint) -> Option<f32> {
    let view = camera.view(point.position, size)?;
    let inside =
        view.raster.cmpge(Vec2::ZERO).all() && view.raster.cmplt(UVec2::from(size).as_vec2()).all();
    inside.then(|| {
        footprint(&camera.ray(view.raster, size), view.distance, view.to_camera.dot(point.ng).abs())
    })
}

impl PathTracer<'_> {
    /// The first surface with a diffuse lobe that `camera` sees, straight or by ideal mirrors and
    /// panes, and the number of those.
    pub fn first_diffuse(&self, camera: &CameraRay, seed: u64) -> Option<(SurfacePoint, u32)> {
        let (v, bounces) = self.first_vertex(camera, seed, |_, bsdf| bsdf.has_diffuse())?;
        Some((v.point, bounces))
    }

    /// What cameras see of the points of [`PathTracer::first_cached`], `None` where there is none.
    /// Direct light comes from a few samples of the lights at each point, and from what the surface
    /// emits itself; `pixels` holds the camera rays and their seeds.
    pub fn views(
        &self, pixels: &[(CameraRay, u64)], lobes: Option<CachedLobes>,
    ) -> Vec<Option<View>> {
        let vertex = |(camera, seed): &(CameraRay, u64)| {
            Some((self.first_usable(camera, *seed, lobes)?, *seed))
        };
        pixels
            .par_chunks(APPEARANCES)
            .flat_map_iter(|chunk| self.views_of(chunk.iter().map(vertex)))
            .collect()
    }

    /// As [`PathTracer::views`] for the surfaces that pass through `points`.
    pub fn views_at(&self, points: &[SurfacePoint], seed: u64) -> Vec<Option<View>> {
        let vertex = |at: &SurfacePoint| {
            Some((self.surface_at(at, seed)?, hash(&[seed, position_hash(at)])))
        };
        points
            .par_chunks(APPEARANCES)
            .flat_map_iter(|chunk| self.views_of(chunk.iter().map(vertex)))
            .collect()
    }

    /// The views of vertices, each with a seed.
    fn views_of(
        &self, vertices: impl ExactSizeIterator<Item = Option<(Vertex, u64)>>,
    ) -> Vec<Option<View>> {
        let (mut rays, mut light) = (Vec::new(), Vec::new());
        let mut seen: Vec<Option<View>> = Vec::with_capacity(vertices.len());
        for found in vertices {
            let Some((Vertex { point, bsdf }, seed)) = found else {
                seen.push(None);
                continue;
            };
            let wo = point.frame.to_local(point.wo);
            let diffuse = bsdf.diffuse_albedo(wo);
            let appearance = Appearance {
                reflectance: diffuse * INV_PI,
                direct: luminance(self.scene.emission(&point)),
            };
            let number = seen.len();
            seen.push(Some((point, bsdf, appearance)));
            let v = Vertex { point, bsdf };
            let origin = v.origin();
            let words = hash(&[seed, stream::APPEARANCE]) as u32;
            self.scene.lights().stratified(
                origin.position,
                origin.facing,
                LIGHT_SAMPLES,
                words,
                &mut |sample| {
                    if let Some(lit) =
                        reflected(self.scene, &point, &bsdf, &sample, Sampled::Glossy)
                    {
                        rays.push(self.scene.shadow_ray(&point, &sample));
                        light.push((number, lit.sum()));
                    }
                },
            );
        }
        for ((number, lit), visible) in light.into_iter().zip(self.scene.visibility_many(&rays)) {
            if let Some((.., appearance)) = &mut seen[number] {
                appearance.direct += luminance(visible * lit) / LIGHT_SAMPLES as f32;
            }
        }
        seen
    }

    /// The first surface that `camera` sees, straight or by ideal mirrors and panes, which records
    /// can serve: with the number of bands that the record of its glossy lobes needs, or 0 if it
    /// has a diffuse lobe alone to be served; and whether it has a diffuse lobe.
    pub fn first_cached(
        &self, camera: &CameraRay, seed: u64, lobes: Option<CachedLobes>,
    ) -> Option<(SurfacePoint, u8, bool)> {
        let Vertex { point, bsdf } = self.first_usable(camera, seed, lobes)?;
        Some((point, radiance_order(lobes, &point, &bsdf), bsdf.has_diffuse()))
    }

    /// The surface that passes through `at`, which only tells where that is and from where it is
    /// seen, as [`PathTracer::first_cached`] would find it.
    pub fn cached_at(
        &self, at: &SurfacePoint, seed: u64, lobes: Option<CachedLobes>,
    ) -> Option<(SurfacePoint, u8, bool)> {
        let Vertex { point, bsdf } = self.surface_at(at, seed)?;
        Some((point, radiance_order(lobes, &point, &bsdf), bsdf.has_diffuse()))
    }

    /// The first surface that records of any kind can serve.
    fn first_usable(
        &self, camera: &CameraRay, seed: u64, lobes: Option<CachedLobes>,
    ) -> Option<Vertex> {
        let usable = |point: &SurfacePoint, bsdf: &Bsdf| {
            bsdf.has_diffuse() || radiance_order(lobes, point, bsdf) > 0
        };
        Some(self.first_vertex(camera, seed, usable)?.0)
    }

    /// The first surface that is `wanted`, with its BSDF and the number of ideal mirrors and panes
    /// before it; `None` if the first that is none of those is not wanted.
    fn first_vertex(
        &self, camera: &CameraRay, seed: u64, wanted: impl Fn(&SurfacePoint, &Bsdf) -> bool,
    ) -> Option<(Vertex, u32)> {
        let [tmin, tmax] = camera.range;
        let mut ray = Ray { origin: camera.origin, tmin, dir: camera.dir, tmax };
        let mut sampler = Sampler::new(seed, 0);
        let mut travelled = 0.0;
        for bounces in 0..LONGEST_PATH {
            let (mut point, distance) = self.scene.intersect(&ray, seed)?;
            travelled += distance;
            let bsdf = self.scene.shade(&mut point);
            if wanted(&point, &bsdf) {
                point.footprint = footprint(camera, travelled, point.wo.dot(point.ng));
                return Some((Vertex { point, bsdf }, bounces));
            }
            if !bsdf.is_delta_only() {
                return None;
            }
            let (sample, next) =
                self.scatter(&Vertex { point, bsdf }, &mut sampler, Sampled::Everything)?;
            debug_assert!(sample.lobe == Lobe::Delta);
            ray = next;
        }
        None
    }

    /// The points with a diffuse lobe, or with glossy lobes that are cached, which
    /// cosine-distributed rays from `points` meet: `count` rays, spread evenly over the points.
    /// With each point comes the number of bands of its radiance record, 0 where none is wanted.
    pub fn next_points(
        &self, points: &[SurfacePoint], count: usize, seed: u64, lobes: Option<CachedLobes>,
    ) -> Vec<(SurfacePoint, u8)> {
        if points.is_empty() {
            return Vec::new();
        }
        (0..count)
            .into_par_iter()
            .filter_map(|k| {
                let words = hash(&[seed, k as u64]);
                let from = &points[(k as u64 * points.len() as u64 / count as u64) as usize];
                let u = Vec2::new(unit_f32(words as u32), unit_f32((words >> 32) as u32));
                let dir = from.frame.to_world(square_to_cosine_hemisphere(u));
                if dir.dot(from.ng) <= 0.0 {
                    return None;
                }
                let (mut point, _) = self.scene.intersect(&self.scene.spawn(from, dir), words)?;
                let bsdf = self.scene.shade(&mut point);
                let order = radiance_order(lobes, &point, &bsdf);
                (bsdf.has_diffuse() || order > 0).then_some((point, order))
            })
            .collect()
    }
}

fn radiance_order(lobes: Option<CachedLobes>, point: &SurfacePoint, bsdf: &Bsdf) -> u8 {
    lobes.and_then(|s| s.record_order(point, bsdf)).unwrap_or(0)
}

/// A seed that belongs to the place.
pub(super) fn position_hash(at: &SurfacePoint) -> u64 {
    hash(&at.position.to_array().map(|x| u64::from(x.to_bits())))
}
