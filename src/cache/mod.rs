//! Irradiance caching: records, the schemes that place and use them, their index, and the filling
//! of the levels.
//!
//! The life of a record: the fill finds a shading point that no record covers
//! ([`fill`](Cache::fill)), casts a [gather](crate::gather) there, makes a [`Record`] from it
//! (value, error, gradients, length R_i), shortens R_i to fit its neighbours, and puts it into the
//! [`Index`] that lookups read. Levels are filled from the deepest to the first, so a gather reads
//! only finished caches. A scheme may then have the first level [refined](Cache::converge): records
//! that disagree where they overlap are allowed less error, and more records are made between them.

mod axes;
mod columns;
mod converge;
mod envelope;
mod fence;
mod file;
mod fill;
mod footprint;
mod index;
mod live;
mod locate;
mod metric;
mod outgoing;
mod published;
mod radiance;
mod radiance_payload;
mod radiance_placement;
mod record;
mod scheme;
mod sync;

pub use axes::{Axes, Change, Direct, DirectSamples, Quadratic};
pub use converge::Appearance;
pub use envelope::{Envelope, Nearest};
pub use fence::Fences;
pub use file::{CacheFile, Origin};
pub use fill::{FillStats, LevelPoints};
pub use footprint::{Footprint, SECTORS};
pub use index::{Answer, Index};
pub use live::{Live, Snapshot};
pub use outgoing::Lobes;
pub use radiance::{
    GlossyView, LobeCoefficients, RadianceAnswer, RadianceCache, RadiancePoints, Sources,
};
pub use radiance_placement::Reflector;
pub use record::{Curve, Reach, Record};
pub use scheme::{
    Allowed, Bands, Bounds, Clamping, Contents, Extrapolation, Gather, Glossy, GlossyBasis,
    GlossyMetric, Hits, Kernel, Measure, Metric, Outline, PRESETS, Placement, Preset, Radius,
    Refinement, RefinementRule, Schedule, Scheme, Setting, Storage, Strata, Validity, Weight,
    settings, settings_page,
};

use crate::gather::Deeper;
use crate::geometry::SurfacePoint;
use crate::math::Color;
use std::sync::Arc;

/// The records of one level and their index.
pub struct Level {
    records: Vec<Record>,
    index: Index,
}

impl Level {
    /// The records; their positions in the slice are their ids, in the order in which they were
    /// made.
    pub fn records(&self) -> &[Record] {
        &self.records
    }

    /// The index over them.
    pub fn index(&self) -> &Index {
        &self.index
    }

    /// Bytes that records and index occupy.
    pub fn bytes(&self) -> usize {
        let axes = self.records.iter().filter(|r| r.axes.is_some()).count();
        self.records.len() * size_of::<Record>() + axes * size_of::<Axes>() + self.index.bytes()
    }
}

/// A scheme with the records made under it: level 0 for what the camera sees, level k for points k
/// bounces behind that. Copies share their levels.
#[derive(Clone)]
pub struct Cache {
    scheme: Scheme,
    scene_size: f32,
    /// Light paths have no bound on their length, so that every level holds the same quantity and
    /// any may stand in for another.
    unlimited: bool,
    /// `None` until the level is filled.
    levels: Vec<Option<Arc<Level>>>,
}

impl Cache {
    /// An empty cache for light paths of at most `max_bounces` interactions after the camera hit
    /// (`u32::MAX`: no bound), in a scene whose diagonal is `scene_size`. It has the scheme's
    /// levels, but no more than the paths have bounces.
    pub fn new(scheme: Scheme, max_bounces: u32, scene_size: f32) -> Self {
        let count = u32::from(scheme.levels).min(max_bounces);
        let levels = (0..count).map(|_| None).collect();
        Self { scheme, scene_size, unlimited: max_bounces == u32::MAX, levels }
    }

    /// The scheme.
    pub fn scheme(&self) -> &Scheme {
        &self.scheme
    }

    /// Diagonal of the scene that radii are bounded by.
    pub fn scene_size(&self) -> f32 {
        self.scene_size
    }

    /// How far a record may lie in front of a point beside it.
    fn in_front(&self) -> f32 {
        1e-4 * self.scene_size
    }

    /// Number of levels, filled or not.
    pub fn level_count(&self) -> u8 {
        self.levels.len() as u8
    }

    /// A level, if it exists and is filled.
    pub fn level(&self, level: u8) -> Option<&Level> {
        self.levels.get(usize::from(level))?.as_deref()
    }

    /// True if light paths have no bound on their length.
    pub fn is_unlimited(&self) -> bool {
        self.unlimited
    }

    /// Number of records on all levels.
    pub fn record_count(&self) -> usize {
        self.levels.iter().flatten().map(|l| l.records.len()).sum()
    }

    /// Puts `records` in the place of those of `level`. Their lengths are clamped anew to those of
    /// their neighbours, if the scheme asks for it.
    ///
    /// # Panics
    /// When the cache has no such level.
    pub fn replace(&mut self, level: u8, records: Vec<Record>) {
        self.levels[usize::from(level)] = Some(Arc::new(self.level_of(level, records)));
    }

    /// Takes over `level` of `other` as it is: lookups here find its records by its own reach.
    ///
    /// # Panics
    /// When the cache has no such level.
    pub fn share_level(&mut self, level: u8, other: &Self) {
        self.levels[usize::from(level)] = other.levels.get(usize::from(level)).cloned().flatten();
    }

    /// `records` as a level: clamped to their neighbours and indexed.
    fn level_of(&self, level: u8, mut records: Vec<Record>) -> Level {
        if self.scheme.clamping.neighbours() {
            let envelope =
                Envelope::build(records.iter().map(|r| (r.position, r.length_unclamped)));
            record::clamp_to_neighbours(&mut records, &envelope);
        }
        self.finish(level, records)
    }

    /// Irradiance of indirect light at a point of `level` from the records with ids below `limit`.
    #[inline]
    pub fn lookup(&self, level: u8, at: &SurfacePoint, limit: u32) -> Option<Answer> {
        self.level(level)?.index.lookup(at, limit)
    }
}

impl Deeper for Cache {
    /// With bounded paths records of exactly `level` answer: those of another level hold light of
    /// more or fewer bounces. Without a bound all levels hold the same quantity: the first filled
    /// one that covers the point answers, so the most accurate.
    #[inline]
    fn irradiance(&self, level: u8, at: &SurfacePoint) -> Option<Color> {
        let found = if self.unlimited {
            self.levels.iter().flatten().find_map(|l| l.index.lookup(at, u32::MAX))
        } else {
            self.lookup(level, at, u32::MAX)
        };
        found.map(|a| a.irradiance)
    }
}
