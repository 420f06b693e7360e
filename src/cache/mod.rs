//! Irradiance and radiance caching: schemes, records, what records hold, where they are kept, and
//! how they are made.
//!
//! The life of a record: the fill finds a shading point that no record covers, casts a
//! [gather](crate::gather) there and makes a [`Record`] from it: payload, error, lengths R_i. The
//! fill shortens R_i to fit the neighbours and puts the record into the [`Index`] that lookups
//! read. Levels are filled from the deepest to the first, so a gather reads only finished caches. A
//! scheme may then have the first level [refined](Cache::refine): records that disagree where they
//! overlap are allowed less error, and more records are made between them.

mod scheme;
mod record;
mod payload;
mod store;
mod fill;

pub use fill::{
    Appearances, Casting, FillPlan, FillReport, FillStats, Found, LevelPoints, ShadingPoint, Share,
    Towards, Transfer, VIEWED, World, scattered,
};
pub use payload::{
    Appearance, Axes, Change, Curve, Direct, DirectSamples, Harmonics, Irradiance, Lit, Lobes,
    Payload, Projector, Quadratic, Reflector,
};
pub use record::{Area, Envelope, Fences, Nearest, RadiusRule, Record, SECTORS};
pub use scheme::{
    Allowed, Bands, Bounds, Clamping, Contents, Extrapolation, Gather, Glossy, GlossyBasis,
    GlossyMetric, Hits, Kernel, Measure, Metric, Outline, PRESETS, Placement, Preset,
    RadiositySettings, Radius, Refinement, RefinementRule, Schedule, Scheme, Setting, Storage,
    Strata, Validity, Weight, settings, settings_page,
};
pub use store::{
    Answer, Behind, Cache, CacheFile, Index, Level, Live, Origin, Radiosity, Snapshot, Store,
};
