//! Names of random streams.
//!
//! A seed serves several purposes. Each purpose hashes the seed with a word of its own,
//! `hash(&[seed, stream::DEEPER_POINTS, level])`, so that no two purposes draw the same numbers.
//! Words have to differ only among the streams of one seed. A changed word changes pictures.

/// Of a job's seed: the order in which points become records, or pixels are shaded.
pub const ORDER: u64 = 1;

/// Of a job's seed: the shading points of a deeper level.
pub const DEEPER_POINTS: u64 = 2;

/// Of a job's seed: the gathers of the radiosity cache.
pub const RADIOSITY: u64 = 0x7261_6469;

/// Of a job's seed: the gathers of radiance records.
pub const RADIANCE_RECORDS: u64 = 3;

/// Of a job's seed: the glossy light at the points of a host's query.
pub const GLOSSY_QUERY: u64 = 3;

/// Of an experiment's seed: the gathers of the reference.
pub const REFERENCE: u64 = 3;

/// Of an experiment's seed: the gathers at points that have no usable record.
pub const NO_RECORD: u64 = 4;

/// Of a gather's seed: what happens behind the hits of its rays.
pub const RAYS: u64 = 1;

/// Of a gather's seed: the second try of a noisy gather.
pub const RETAKE: u64 = 1;

/// Of a gather's seed: the light samples for the axes of a record.
pub const AXES: u64 = 5;

/// Of a bundle's seed: the light paths that are joined with its gather.
pub const LIGHT_PATHS: u64 = 2;

/// Of a bundle's seed: the rays towards small bright surfaces.
pub const TOWARDS_BRIGHT: u64 = 3;

/// Of a job's seed: the light paths that look for small bright surfaces.
pub const BRIGHT: u64 = 0x6272_6967_6874;

/// The camera rays that look for what light paths are aimed at.
pub const FOCUS: u64 = 0x0066_6f63_7573;

/// Of a camera sample's seed: the walk from a light.
pub const LIGHT_WALK: u64 = 0x006c_6967_6874;

/// Of a shading point's seed: the light samples of its appearance.
pub const APPEARANCE: u64 = 1;

/// Of the seed of a host's path: the ray that the host traces.
pub const HOST_RAY: u64 = 0;

/// Of the seed of a host's path: the next vertex.
pub const HOST_VERTEX: u64 = 1;

/// Of the seed of a host's path: Russian roulette.
pub const HOST_ROULETTE: u64 = 2;
