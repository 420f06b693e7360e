//! Irradiance: its value and its gradients.

mod value;
mod gradients;

pub use gradients::Gradient;
