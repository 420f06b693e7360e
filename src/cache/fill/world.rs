//! What a fill asks of the world that it is in.

use super::points::{Appearances, ShadingPoint};
use crate::cache::payload::Reflector;
use crate::cache::store::Radiosity;
use crate::gather::RadianceProbe;
use crate::geometry::SurfacePoint;
use crate::math::{Color, Vec3};

/// The direction to the viewer from a position.
pub type Towards<'a> = dyn Fn(Vec3) -> Vec3 + Sync + 'a;

/// Where the light of a cache comes from: our own scene, the scene of a host, an analytic field.
pub trait World: Sync {
    /// What gathers trace.
    fn probe(&self) -> &dyn RadianceProbe;

    /// `points` are those on the first level that a fill is about to serve.
    fn prepare(&self, points: &[SurfacePoint], seed: u64) {
        let _ = (points, seed);
    }

    /// The surface points of `level` that `count` rays from `before` meet, with the order that
    /// their glossy lobes ask of a radiance record: 0 for none. `radiance` says whether the level
    /// has a radiance cache. Their footprint is for the caller to set.
    fn next_points(
        &self, before: &[SurfacePoint], level: u8, radiance: bool, count: usize, seed: u64,
    ) -> Vec<(SurfacePoint, u8)>;

    /// How points of the first level look, with their glossy lobes if `radiance` is asked for.
    /// `None` where the world cannot tell: its records are not refined.
    fn appearances(&self, points: &[ShadingPoint], radiance: bool) -> Option<Appearances<'_>>;

    /// What fills the radiosity cache; `None` where the world cannot.
    fn transfer(&self) -> Option<Box<dyn Transfer + '_>> {
        None
    }

    /// How surfaces reflect, for schemes that place records by outgoing radiance.
    fn reflector(&self) -> Option<&dyn Reflector> {
        None
    }

    /// The direction to the viewer, if there is one viewer.
    fn towards_viewer(&self) -> Option<&Towards<'_>> {
        None
    }
}

/// How a fill is done.
#[derive(Clone, Copy, Debug)]
pub struct FillPlan {
    /// Rays that look for the points of each deeper level.
    pub deeper_points: usize,
    /// Points per round on the first level, see [`LevelPoints::round`].
    pub round: usize,
    /// Seed of everything random.
    pub seed: u64,
}

/// How rays of the radiosity cache are cast.
#[derive(Clone, Copy, Debug)]
pub struct Casting {
    /// Rays per record, spread over the hemisphere.
    pub rays: u32,
    /// Rays beside them towards small bright surfaces.
    pub aimed: u32,
    /// Samples of light sources per record.
    pub lights: u32,
    /// Seed of the record.
    pub seed: u64,
}

/// What one ray of a record found: its part of the record's irradiance.
#[derive(Clone, Debug, Default)]
pub struct Found {
    /// Straight from light sources.
    pub direct: Color,
    /// From where no record is valid, and by lobes that records do not answer for.
    pub known: Color,
    /// From the irradiance of records, by their numbers.
    pub shares: Vec<Share>,
}

/// A share of a record's irradiance.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Share {
    /// The record.
    pub record: u32,
    /// Direct light counts, too; else it was sampled.
    pub all: bool,
    /// The irradiance that each unit of the record's brings.
    pub factor: Color,
}

/// Tells which records the rays of others end in.
pub trait Transfer: Sync {
    /// A probe that tells distances and normals alone.
    fn distances(&self) -> &dyn RadianceProbe;

    /// Points that light sources light up.
    fn lit(&self) -> Vec<SurfacePoint>;

    /// Irradiance straight from light sources at `from`, as light samples find it. What the rays of
    /// the record find of light sources is weighed against them.
    fn direct(&self, from: &SurfacePoint, casting: Casting) -> Color;

    /// What the rays with these numbers find, which end in `records`.
    fn cast(
        &self, from: &SurfacePoint, casting: Casting, numbers: &[u32], records: &Radiosity,
    ) -> Vec<Found>;
}
