//! What a gather asks of a scene: the bundle of rays, and who answers it.

use super::lobe::LobeCoefficients;
use super::strata::Density;
use crate::geometry::SurfacePoint;
use crate::math::{Color, Vec3};
use serde::{Deserialize, Serialize};

/// What a gather ray met.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum HitKind {
    /// Nothing: the ray left the scene, or points below the geometric surface it started from.
    #[default]
    None,
    /// A surface that reflects or absorbs.
    Surface,
    /// A surface that emits.
    Emitter,
    /// The environment.
    Environment,
}

/// How a probe finds the change of the radiance that arrives from a hit when the receiver moves. It
/// is seen from another direction then, which matters where the hit is glossy [Zhao, Sec. 3.8].
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum HitChange {
    /// Not at all: what a hit sends out is the same in all directions.
    #[default]
    None,
    /// The reflection of what was traced from the hit is evaluated again towards receivers a little
    /// aside.
    Frozen,
    /// The same by the derivative of the lobe where the hit is a Phong lobe [Zhao, Eq. 3.45].
    Analytic,
    /// The same by the lobes of the hit as harmonics represent them, so far as these are tabulated
    /// [Zhao, Eq. 3.46-3.47]: as smooth as the record.
    Harmonics,
}

/// The rays of one gather, as a structure of arrays in stratum order. The gather fills `dir_local`,
/// `pdf` and `seed`, the probe the rest.
#[derive(Clone, Debug, Default)]
pub struct Bundle {
    /// Unit directions in the local frame, z > 0.
    pub dir_local: Vec<Vec3>,
    /// Density of each direction per steradian.
    pub pdf: Vec<f32>,
    /// The density of all directions.
    pub density: Density,
    /// Radiance arriving from each direction.
    pub radiance: Vec<Color>,
    /// Distance to what each ray hit, infinite where it hit nothing.
    pub distance: Vec<f32>,
    /// Unit normal at the hit, world space, facing the point of the gather; zero where there is no
    /// surface.
    pub normal: Vec<Vec3>,
    /// What each ray met.
    pub kind: Vec<HitKind>,
    /// Seed of every random choice of the probe.
    pub seed: u64,
    /// How the probe is to fill in `change`.
    pub hit_change: HitChange,
    /// The change of `radiance` per unit that the receiver moves along each tangent of its frame,
    /// what lights the hits staying as it is. Empty if the probe was not asked for it or cannot
    /// tell.
    pub change: [Vec<Color>; 2],
    /// Light paths that the probe is asked to join with the point of the gather; 0 for none.
    pub light_paths: u32,
    /// What they bring.
    pub joints: Vec<Joint>,
    /// Rays towards small bright surfaces that the probe may [add](Bundle::add); 0 for none.
    pub towards_bright: u32,
    /// The part of `radiance` that added rays brought; empty if there were none.
    pub found: Vec<Color>,
    /// Variance of the luminance of the irradiance that they brought.
    pub found_variance: f32,
}

/// A place on a light path, joined with the point of a gather: a source of indirect light beside
/// the hits of its rays. The probe weighs it against the rays that could have hit the same place,
/// and those against it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Joint {
    /// From the point of the gather, world space.
    pub offset: Vec3,
    /// Unit normal there, world space, facing the point of the gather.
    pub normal: Vec3,
    /// Irradiance at the point of the gather.
    pub irradiance: Color,
    /// The area that the place stands for.
    pub area: f32,
}

impl Bundle {
    /// Number of rays.
    pub fn len(&self) -> usize {
        self.dir_local.len()
    }

    /// True without rays.
    pub fn is_empty(&self) -> bool {
        self.dir_local.is_empty()
    }

    /// Adds a ray beside those of the strata, in the local direction `w`, z > 0. Its `radiance` is
    /// to be what the ray brings times its weight against all other rays, as if it were one of the
    /// rays of the strata. When all rays are answered, the gather adds it to that of the stratum
    /// which it lies in.
    pub fn add(&mut self, w: Vec3) {
        self.dir_local.push(w);
        self.pdf.push(self.density.pdf(w.z));
        self.radiance.push(Color::ZERO);
        self.distance.push(f32::INFINITY);
        self.normal.push(Vec3::ZERO);
        self.kind.push(HitKind::None);
    }

    /// Forgets all rays but the first `n`.
    pub(super) fn truncate(&mut self, n: usize) {
        self.dir_local.truncate(n);
        self.pdf.truncate(n);
        self.radiance.truncate(n);
        self.distance.truncate(n);
        self.normal.truncate(n);
        self.kind.truncate(n);
        self.change.iter_mut().for_each(|c| c.truncate(n));
    }

    /// Radiance from the direction of stratum `k`, without what added rays brought.
    pub(super) fn of_ray(&self, k: usize) -> Color {
        self.radiance[k] - self.found.get(k).copied().unwrap_or(Color::ZERO)
    }

    /// Makes room for `n` answers, all of them "nothing".
    pub(super) fn reset(&mut self, n: usize) {
        self.dir_local.clear();
        self.pdf.clear();
        self.radiance.clear();
        self.radiance.resize(n, Color::ZERO);
        self.distance.clear();
        self.distance.resize(n, f32::INFINITY);
        self.normal.clear();
        self.normal.resize(n, Vec3::ZERO);
        self.kind.clear();
        self.kind.resize(n, HitKind::None);
        self.change.iter_mut().for_each(Vec::clear);
        self.joints.clear();
        self.found.clear();
        self.found_variance = 0.0;
    }
}

/// Whatever can tell the light arriving at a surface point: our own tracer, a host renderer's
/// callback, an analytic field in a test.
pub trait RadianceProbe: Sync {
    /// Fills `radiance`, `distance`, `normal` and `kind` of every ray of `bundle`, which starts at
    /// `from`, and `joints` if it knows how to and is asked to.
    ///
    /// `level` is the number of bounces between the camera path and `from`: 0 for points seen by
    /// the camera. Indirect light at the hits may be taken from `deeper`, whose caches are
    /// finished.
    fn incoming(&self, from: &SurfacePoint, level: u8, deeper: &dyn Deeper, bundle: &mut Bundle);

    /// Places on the light sources that direct light reaches `from` and its surroundings from;
    /// `bundle` are the answered rays of the gather there. `None` for a probe that knows of
    /// indirect light alone.
    fn lights<'a>(
        &'a self, _from: &SurfacePoint, _bundle: &Bundle, _choice: LightChoice,
    ) -> Option<Box<dyn DirectLight + 'a>> {
        None
    }
}

/// All light at a point, as a radiosity cache knows it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Arriving {
    /// Irradiance.
    pub irradiance: Color,
    /// Direct light is part of it. Else it has to be sampled.
    pub all: bool,
}

/// Indirect light at hit points, from the finished caches of deeper bounces.
pub trait Deeper: Sync {
    /// Irradiance of indirect light at a point that lies `level` bounces behind the camera path;
    /// `None` where no record is valid.
    fn irradiance(&self, level: u8, at: &SurfacePoint) -> Option<Color>;

    /// All light at a point behind the first surface; indirect light alone from records with a
    /// radius above `longest`. `None` where no record is valid.
    fn radiosity(&self, _at: &SurfacePoint, _longest: f32) -> Option<Arriving> {
        None
    }

    /// True if [`Deeper::radiosity`] may know something.
    fn has_radiosity(&self) -> bool {
        false
    }

    /// True if [`Deeper::radiance`] may know something.
    fn has_radiance(&self) -> bool {
        false
    }

    /// Irradiance of indirect light at such a point, and the radiance that leaves towards `at.wo`
    /// by the glossy lobe `lobe`; `None` where no record is valid.
    fn radiance(
        &self, _level: u8, _at: &SurfacePoint, _lobe: &mut LobeCoefficients,
    ) -> Option<(Color, Color)> {
        None
    }
}

/// No deeper cache.
pub struct NoDeeper;

impl Deeper for NoDeeper {
    fn irradiance(&self, _: u8, _: &SurfacePoint) -> Option<Color> {
        None
    }
}

/// Light that arrives at a point straight from one place of a light source.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Arrival {
    /// Unit world direction from the point to the source.
    pub dir: Vec3,
    /// Irradiance on a surface across `dir`; zero where something is in the way.
    pub light: Color,
}

/// Places on the light sources, chosen once for the surroundings of a point. The same places are
/// asked about everywhere: what differs from one point to the next is light, not noise.
pub trait DirectLight {
    /// Appends what arrives at each of `points` from each place, point by point. The irradiance at
    /// a point is the sum of its arrivals times the cosine.
    fn arriving(&self, points: &[Vec3], out: &mut Vec<Arrival>);
}

/// How [`RadianceProbe::lights`] chooses places.
#[derive(Clone, Copy, Debug)]
pub struct LightChoice {
    /// Number of light samples.
    pub samples: u32,
    /// Of the directions of the gather's rays every so many stand for the environment.
    pub every: u32,
    /// Only those in which its rays met the environment: enough for the point itself, but beside
    /// it others are free.
    pub seen: bool,
    /// Seed of all choices.
    pub seed: u64,
}

/// The irradiance of `arrivals` on a surface with the unit normal `n`.
pub fn irradiance_of(arrivals: &[Arrival], n: Vec3) -> Color {
    arrivals.iter().map(|a| a.light * n.dot(a.dir).max(0.0)).sum()
}
