//! The shading points of a level, and what the fill did for them.

use crate::cache::payload::{Appearance, Lobes};
use crate::geometry::{SurfacePoint, extent, median_length};
use crate::sampling::{hash, stream};

/// The shading points of one level, in the order in which they are visited.
#[derive(Default)]
pub struct LevelPoints {
    /// The points.
    pub points: Vec<SurfacePoint>,
    /// The number of bands that each point asks for; empty for irradiance.
    pub orders: Vec<u8>,
    /// Points per round: a number, or 0 for rounds that start small and grow fourfold.
    pub round: usize,
}

impl From<Vec<SurfacePoint>> for LevelPoints {
    /// Points that ask for irradiance, in growing rounds.
    fn from(points: Vec<SurfacePoint>) -> Self {
        Self { points, ..Self::default() }
    }
}

/// How shading points look.
#[derive(Default)]
pub struct Appearances<'a> {
    /// Each point's appearance.
    pub of_points: Vec<Appearance>,
    /// The glossy lobes of the points, where a radiance cache answers for glossy lobes.
    pub lobes: Option<Box<Lobes<'a>>>,
}

/// A surface point that records are wanted for.
#[derive(Clone, Copy, Debug)]
pub struct ShadingPoint {
    /// Whose point it is: a number for the caller.
    pub number: u32,
    /// Where it is.
    pub point: SurfacePoint,
    /// An irradiance record is wanted.
    pub irradiance: bool,
    /// The number of bands of the radiance record, 0 if none is wanted.
    pub order: u8,
}

/// `points` in an order that scatters them, whatever their order was. The new order depends on
/// their number and `seed` alone.
pub fn scattered(points: &[SurfacePoint], seed: u64) -> Vec<SurfacePoint> {
    let mut order: Vec<u32> = (0..points.len() as u32).collect();
    order.sort_by_cached_key(|i| (hash(&[seed, stream::ORDER, u64::from(*i)]), *i));
    order.into_iter().map(|i| points[i as usize]).collect()
}

/// The extent of what `points` show. Those that coincide tell of it by their footprint.
pub(in crate::cache) fn extent_of(points: &[SurfacePoint]) -> f32 {
    let by_footprint = || Some(median_length(points.iter().map(|p| p.footprint))? / VIEWED);
    extent(points.len(), |i| points[i].position).or_else(by_footprint).unwrap_or(1.0)
}

/// Width of a pixel as a share of the extent, where points tell of nothing else.
pub const VIEWED: f32 = 0.002;

/// What the filling of one level did.
#[derive(Clone, Debug, Default)]
pub struct FillStats {
    /// Rays of all gathers, without what the probe traced behind them.
    pub gather_rays: u64,
    /// Questions put to the index.
    pub lookups: u64,
    /// Those that found a record.
    pub hits: u64,
    /// Records made anew away from an edge because they had missed what two neighbours saw.
    pub retaken: u64,
    /// Records gathered again with more rays because they were noisy.
    pub noisy: u64,
    /// Passes of refinement, 0 where none was asked for.
    pub passes: u32,
    /// How often refinement lowered the allowed error of a record.
    pub reductions: u64,
    /// For each point, the number of records that existed when its round ended.
    pub births: Vec<u32>,
}

impl FillStats {
    /// Adds what was done to the level afterwards.
    pub fn add(&mut self, later: &Self) {
        self.gather_rays += later.gather_rays;
        self.lookups += later.lookups;
        self.hits += later.hits;
        self.retaken += later.retaken;
        self.noisy += later.noisy;
        self.passes += later.passes;
        self.reductions += later.reductions;
    }
}
