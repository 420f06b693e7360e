//! Light transport: the path tracer that everything is measured against, the bidirectional one, the
//! probe that gathers in our own scene, and shading from the cache.

mod direct;
mod vertex;
mod bright;
mod lobes;
mod path;
mod bdpt;
mod focus;
mod find_bright;
mod hit_change;
mod outgoing;
mod points;
mod cached;
mod caustics;
mod probe;
mod reflector;
mod stored_hits;
mod transfer;
mod world;

pub use bdpt::{Bidirectional, Splat};
pub use cached::CachedIntegrator;
pub use caustics::glass_bends_light;
pub use lobes::{CachedLobes, GlossyLobes, IndirectLight};
pub use path::{PathTracer, Start};
pub use points::{View, pixel_footprint};
pub use probe::{Counts, SceneProbe};
pub use reflector::SceneReflector;
pub use vertex::{Aim, Origin};
pub use world::{AppearanceOf, SceneWorld};

use crate::accel::Ray;
use crate::camera::{Camera, CameraRay};
use crate::geometry::SurfacePoint;
use crate::material::Bsdf;
use crate::math::{Color, Vec2, Vec3};
use crate::sampling::{Sampler, hash};
use crate::scene::Scene;

/// The light of one camera sample, split as the output layers are; the five sum to the beauty.
/// Albedo is multiplied in.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Radiance {
    /// Light that reached the first surface straight from a source and left by its diffuse lobe.
    pub diffuse_direct: Color,
    /// All other light that left by the diffuse lobe.
    pub diffuse_indirect: Color,
    /// As `diffuse_direct` for every other lobe, transmission too.
    pub glossy_direct: Color,
    /// As `diffuse_indirect` for every other lobe.
    pub glossy_indirect: Color,
    /// Emitted by the first surface, or the background.
    pub emission: Color,
}

impl Radiance {
    /// The beauty.
    pub fn total(&self) -> Color {
        self.diffuse_direct
            + self.diffuse_indirect
            + self.glossy_direct
            + self.glossy_indirect
            + self.emission
    }

    /// The five parts, in the order of the output layers.
    pub fn parts(&self) -> [Color; 5] {
        [
            self.diffuse_direct,
            self.diffuse_indirect,
            self.glossy_direct,
            self.glossy_indirect,
            self.emission,
        ]
    }

    /// True if every number is one.
    pub fn is_finite(&self) -> bool {
        self.parts().iter().all(|c| c.is_finite())
    }
}

/// One sample of one pixel, ready to be traced.
#[derive(Clone, Debug)]
pub struct CameraSample {
    /// The ray with its footprint.
    pub camera: CameraRay,
    /// Seed of the pixel's sample sequence.
    pub seed: u64,
    /// Number in that sequence.
    pub index: u32,
    /// The sample's stream behind the numbers that chose its place in the pixel.
    sampler: Sampler,
    /// Only records with ids below this may be used.
    pub limit: u32,
}

impl CameraSample {
    /// Sample `index` of the pixel with `seed` at the integer position `pixel` of an image of
    /// `size` pixels.
    pub fn new(
        camera: &Camera, pixel: [u32; 2], size: [u32; 2], seed: u64, index: u32, limit: u32,
    ) -> Self {
        let mut sampler = Sampler::new(seed, index);
        let jitter = sampler.next_2d();
        let raster = Vec2::new(pixel[0] as f32, pixel[1] as f32) + jitter;
        Self { camera: camera.ray(raster, size), seed, index, sampler, limit }
    }

    /// The ray.
    fn ray(&self) -> Ray {
        let CameraRay { origin, dir, range: [tmin, tmax], .. } = self.camera;
        Ray { origin, tmin, dir, tmax }
    }

    /// Seed of the decisions at partly transparent surfaces.
    fn alpha_seed(&self) -> u64 {
        hash(&[self.seed, u64::from(self.index)])
    }
}

/// Where the indirect light of a sample's diffuse lobe came from.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Status {
    /// There was none to find.
    #[default]
    None,
    /// Records.
    Cached,
    /// A path, because no record was valid.
    Traced,
}

/// The first surface of a sample, as the layers show it.
#[derive(Clone, Copy, Debug)]
pub struct Surface {
    /// World position.
    pub position: Vec3,
    /// Unit shading normal.
    pub normal: Vec3,
    /// Directional albedo of all lobes.
    pub albedo: Color,
    /// Distance from the camera.
    pub distance: f32,
}

impl Surface {
    fn new(scene: &Scene, point: &SurfacePoint, bsdf: &Bsdf, distance: f32) -> Self {
        let albedo = bsdf.albedo(point.frame.to_local(point.wo));
        let position = scene.to_world(point.position);
        Self { position, normal: point.frame.n, albedo, distance }
    }
}

/// What one camera sample saw.
#[derive(Clone, Copy, Debug, Default)]
pub struct Shaded {
    /// Its light.
    pub radiance: Radiance,
    /// The first surface; `None` for the background.
    pub surface: Option<Surface>,
    /// Source of the indirect light.
    pub status: Status,
    /// Source of the indirect light of the glossy lobes of the first surface that has any, mirrors
    /// apart; `None` too where the path tracer makes the pixels.
    pub glossy: Status,
    /// Error of the cache lookup as a share of the allowed one.
    pub error: f32,
    /// Mean of the errors a_i that its records are allowed.
    pub allowed: f32,
    /// Number of records that took part.
    pub records: u32,
    /// Interpolated irradiance.
    pub irradiance: Color,
    /// Questions put to the cache for what the camera sees, straight or by mirrors.
    pub lookups: u32,
    /// Those that no record answered.
    pub misses: u32,
}

/// How camera samples become light.
pub enum Integrator<'a> {
    /// Path tracing.
    Path(PathTracer<'a>),
    /// Bidirectional path tracing.
    Bidirectional(Box<Bidirectional<'a>>),
    /// Shading from a filled cache.
    Cached(CachedIntegrator<'a>),
}

impl Integrator<'_> {
    /// CPU seconds spent on cache lookups and on direct light; zero where they are not told apart.
    pub fn seconds(&self) -> [f64; 2] {
        match self {
            Self::Path(_) | Self::Bidirectional(_) => [0.0; 2],
            Self::Cached(cached) => cached.seconds(),
        }
    }

    /// True if samples bring light to other pixels than their own.
    pub fn splats(&self) -> bool {
        matches!(self, Self::Bidirectional(_))
    }

    /// Shades `samples` into `out`, in their order, and appends what they bring to other pixels to
    /// `splats`.
    pub fn shade(&self, samples: &[CameraSample], out: &mut Vec<Shaded>, splats: &mut Vec<Splat>) {
        match self {
            Self::Path(tracer) => {
                out.clear();
                out.extend(samples.iter().map(|s| tracer.shade(s)));
            }
            Self::Bidirectional(bidirectional) => bidirectional.shade(samples, out, splats),
            Self::Cached(cached) => cached.shade(samples, out),
        }
    }
}
