//! A frame from scene to files: fill, tiles, passes, threads; then layers, preview and statistics.

mod caches;
mod clock;
mod frame;
mod output;
mod overlay;
mod refine;
mod selection;
mod sequence;
mod settings;
mod stats;
pub mod viewer;
mod visible;

pub use caches::{Caches, Gloss, Job, Spot};
pub use clock::{Clock, peak_memory_bytes};
pub use frame::{Frame, Watcher, frame, frame_from, frame_with};
pub(crate) use frame::{camera_sample, pixel_order};
pub use output::{Facts, write_exr, write_preview};
pub use selection::Selection;
pub use sequence::{Growth, fill_sequence};
pub use settings::{IntegratorKind, Settings};
pub use stats::stats;
pub use visible::fill_for_camera;
