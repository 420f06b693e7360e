//! Places on the lights of our own scene that direct light is gathered from, the same ones for a
//! point and its surroundings.

use crate::accel::Ray;
use crate::gather::{Arrival, Bundle, DirectLight, HitKind, LightChoice};
use crate::geometry::SurfacePoint;
use crate::light::{LightSample, LightSource, TriangleLight};
use crate::math::{Color, INV_PI, Vec3};
use crate::scene::{Scene, gap};
use std::sync::atomic::{AtomicU64, Ordering};

/// Beside the point that places were chosen for, light is asked for this share of the way there
/// above the surface: what is flat there may be bent a little.
const LIFT: f32 = 0.01;

/// A place on a light.
enum Place {
    /// On an emissive triangle: where, its unit normal, how far it may be off along that, radiance
    /// over density, and the area that the place stands for, over π.
    Surface { position: Vec3, normal: Vec3, error: f32, strength: Color, area: f32 },
    /// In the environment: direction, and radiance over density.
    Distant { direction: Vec3, strength: Color },
    /// A light without extent, by its index in the scene, with its weight.
    Punctual { index: u32, weight: f32 },
}

/// See [`DirectLight`].
pub(super) struct LightPoints<'a> {
    scene: &'a Scene,
    from: SurfacePoint,
    places: Vec<Place>,
    /// Counts shadow rays.
    rays: &'a AtomicU64,
}

impl<'a> LightPoints<'a> {
    /// Places for the surroundings of `from`, by light samples there. The environment is found by
    /// rays of the gather, too; both kinds are weighed by the balance heuristic.
    pub fn new(
        scene: &'a Scene, from: &SurfacePoint, bundle: &Bundle, choice: LightChoice,
        rays: &'a AtomicU64,
    ) -> Self {
        let lights = scene.lights();
        let mut places: Vec<Place> = Vec::new();
        let samples = choice.samples as f32;
        let escaping = bundle.len() as f32 / choice.every as f32;
        let sky = |direction: Vec3, cosine: f32, light_pdf: f32| {
            let density = samples * light_pdf + escaping * bundle.density.pdf(cosine);
            Place::Distant { direction, strength: lights.environment(direction) / density }
        };
        lights.stratified(
            from.position,
            Some(from.ng),
            choice.samples,
            choice.seed as u32,
            &mut |sample: LightSample| {
                let place = match sample.source {
                    LightSource::Environment => {
                        Some(sky(sample.wi, from.frame.n.dot(sample.wi), sample.pdf))
                    }
                    LightSource::Punctual(index) => {
                        let weight = 1.0 / (sample.pdf * samples);
                        match places.last_mut() {
                            Some(Place::Punctual { index: last, weight: sum })
                                if *last == index =>
                            {
                                *sum += weight;
                                None
                            }
                            _ => Some(Place::Punctual { index, weight }),
                        }
                    }
                    LightSource::Triangle { instance, triangle, .. } => {
                        on_triangle(scene, from, &sample, [instance, triangle], samples)
                    }
                };
                places.extend(place);
            },
        );
        if lights.has_environment() {
            for k in (0..bundle.len()).step_by(choice.every as usize) {
                let local = bundle.dir_local[k];
                let direction = from.frame.to_world(local);
                let free =
                    !choice.seen || bundle.kind[k] == HitKind::Environment || scene.has_panes();
                if free && direction.dot(from.ng) > 0.0 {
                    let light_pdf = lights.pdf_environment(from.position, Some(from.ng), direction);
                    places.push(sky(direction, local.z, light_pdf));
                }
            }
        }
        Self { scene, from: *from, places, rays }
    }
}

/// The place of a light sample on an emissive triangle.
fn on_triangle(
    scene: &Scene, from: &SurfacePoint, sample: &LightSample, [instance, triangle]: [u32; 2],
    samples: f32,
) -> Option<Place> {
    let [a, b, c] = scene.geometry().triangle(instance, triangle);
    let normal = (b - a).cross(c - a).try_normalize()?;
    let normal = if normal.dot(sample.wi) > 0.0 { -normal } else { normal };
    let radiance = scene.sent(sample.source, sample.radiance, sample.wi);
    let (squared, cosine) = (sample.distance * sample.distance, -normal.dot(sample.wi));
    if !(cosine > 0.0 && squared > 0.0) {
        return None;
    }
    // One over the density per area of all samples.
    let stands_for = squared / (cosine * sample.pdf * samples);
    let area = stands_for * INV_PI;
    // With A/π beside the squared distance, and so that at `from` nothing changes.
    let strength = radiance * (stands_for * (squared + area) / squared);
    let position = from.position + sample.distance * sample.wi;
    let error = scene.lights().emitter(instance, triangle).map_or(0.0, TriangleLight::error);
    Some(Place::Surface { position, normal, error, strength, area })
}

impl DirectLight for LightPoints<'_> {
    fn arriving(&self, points: &[Vec3], out: &mut Vec<Arrival>) {
        let first = out.len();
        let (mut rays, mut asked): (Vec<Ray>, Vec<usize>) = (Vec::new(), Vec::new());
        for &position in points {
            let lift = LIFT * (position - self.from.position).length() * self.from.ng;
            let at = SurfacePoint { position: position + lift, ..self.from };
            for place in &self.places {
                let (arrival, distance, gap) = place.arrival(self.scene, at.position);
                if arrival.light != Color::ZERO
                    && arrival.dir.dot(at.ng) > 0.0
                    && arrival.light.is_finite()
                {
                    rays.push(self.scene.segment(&at, arrival.dir, distance, gap));
                    asked.push(out.len());
                    out.push(arrival);
                } else {
                    out.push(Arrival { light: Color::ZERO, ..arrival });
                }
            }
        }
        debug_assert_eq!(out.len() - first, points.len() * self.places.len());
        for (k, visible) in asked.into_iter().zip(self.scene.visibility_many(&rays)) {
            out[k].light *= visible;
        }
        self.rays.fetch_add(rays.len() as u64, Ordering::Relaxed);
    }
}

impl Place {
    /// What it sends to `x` if nothing is in the way, how far it is, and how far before it a ray
    /// ends.
    fn arrival(&self, scene: &Scene, x: Vec3) -> (Arrival, f32, f32) {
        match *self {
            Self::Surface { position, normal, error, strength, area } => {
                let offset = position - x;
                let squared = offset.length_squared();
                let distance = squared.sqrt();
                let dir = offset / distance.max(f32::MIN_POSITIVE);
                let cos = -normal.dot(dir);
                let light = strength * cos.max(0.0) / (squared + area);
                (Arrival { dir, light }, distance, gap(error, cos, distance))
            }
            Self::Distant { direction, strength } => {
                (Arrival { dir: direction, light: strength }, f32::INFINITY, 0.0)
            }
            Self::Punctual { index, weight } => match scene.lights().from_punctual(x, index) {
                Some((dir, distance, irradiance)) => {
                    (Arrival { dir, light: irradiance * weight }, distance, 0.0)
                }
                None => (Arrival::default(), 0.0, 0.0),
            },
        }
    }
}
