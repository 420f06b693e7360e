//! Records: where each lies, the area in which it is valid, and the rules that the area follows
//! from. What a record holds is its [payload](super::payload).

mod area;
mod envelope;
mod fence;
pub(super) mod metric;
mod one;
mod rule;

pub(super) use area::{AXES, sector};
pub use area::{Area, SECTORS};
pub use envelope::{Envelope, Nearest};
pub use fence::Fences;
pub use one::Record;
pub(super) use one::clamp_to_neighbours;
pub use rule::RadiusRule;
