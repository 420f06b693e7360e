//! The primitives under [`published`](super::published), so that a model checker can put its own in
//! their place: `tests/loom` does.

pub use arc_swap::ArcSwap as Swap;
pub use std::sync::{Arc, Mutex};
