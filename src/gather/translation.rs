//! The choice among the estimators of the translational gradient.

use super::irradiance::Gradient;
use super::mesh::TriangleRadiance;
use super::samples::HemisphereSamples;
use serde::{Deserialize, Serialize};

/// The published estimators of the translational gradient.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum TranslationalGradient {
    /// None: records are extrapolated by their value.
    None,
    /// Moving cell boundaries [WardHeckbert92]; sees silhouettes. Polar layout only.
    WardHeckbert,
    /// Each sample a patch that keeps its radiance [Krivanek05, Eq. 10-11]; any layout and density,
    /// but blind to occlusion changes.
    PerSample,
    /// A mesh over the hits, [`HemisphereSamples::triangulated`]; sees silhouettes. Concentric
    /// layout only, any density.
    Triangulated,
}

impl HemisphereSamples {
    /// The translational gradient by the method `kind`.
    ///
    /// # Panics
    /// For [`TranslationalGradient::WardHeckbert`] on another layout than the polar one, for
    /// [`TranslationalGradient::Triangulated`] on another than the concentric one; schemes are
    /// checked for it when they are made.
    pub fn translational_gradient(&self, kind: TranslationalGradient) -> Gradient {
        match kind {
            TranslationalGradient::None => Gradient::default(),
            TranslationalGradient::WardHeckbert => self.ward_heckbert(),
            TranslationalGradient::PerSample => self.per_sample(),
            TranslationalGradient::Triangulated => {
                self.triangulated(TriangleRadiance::Hybrid).gradient
            }
        }
    }
}
