//! Glossy lobes in harmonics, tabulated over the outgoing direction: what a record of incident
//! radiance is multiplied with.

mod quadrature;
mod lobe;
mod matrix;
mod settings;
mod store;
mod glossy;

pub use glossy::GlossyTables;
pub use lobe::{Lobe, LobeTable};
pub use matrix::BrdfMatrix;
pub use settings::TableSettings;
pub use store::TableStore;
