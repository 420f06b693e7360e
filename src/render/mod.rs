//! From a scene to files: fill, tiles, passes; then layers, preview and statistics.

pub mod viewer;

mod clock;
mod threads;
mod settings;
mod refine;
mod caches;
mod visible;
mod sequence;
mod frame;
mod denoise;
mod selection;
mod overlay;
mod output;
mod stats;
mod rendering;
mod job;
mod animation;

pub use animation::{FrameCost, Frames, Sequence, frame_path};
pub use caches::Caches;
pub use clock::{Clock, peak_memory_bytes};
pub use denoise::{denoiser_places, find_denoiser};
pub use frame::{Frame, Watcher};
pub use job::{Job, camera_number};
pub use output::{Facts, write_exr, write_preview};
pub use rendering::Rendering;
pub use selection::Selection;
pub use sequence::{Growth, fill_sequence};
pub use settings::{Denoise, IntegratorKind, Settings};
pub(crate) use settings::{camera_sample, pixel_order};
pub use stats::stats;
pub use threads::workers;
pub use visible::fill_for_camera;
