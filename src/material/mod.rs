//! Surface materials: what glTF describes, the BRDFs of the caching papers, and their evaluation,
//! sampling and densities.

mod microfacet;
mod sample;
mod native;
mod description;
mod energy;
mod layered;
mod bsdf;
mod shade;
pub mod tables;

pub use bsdf::Bsdf;
pub use description::{AlphaMode, Material};
pub use native::{LafortuneLobe, NativeBrdf};
pub use sample::{BsdfSample, Lobe, Pane};
