//! render.

pub mod display;
