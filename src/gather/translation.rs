//! The choice among the estimators of the translational gradient.

use super::irradiance::Gradient;
use super::mesh::TriangleRadiance;
use super::samples::HemisphereSamples;
use crate::words::words;

words! {
    /// The published estimators of the translational gradient.
    pub enum TranslationalGradient {
        /// Not at all.
        None = "none",
        /// By moving cell boundaries [WardHeckbert92]; sees silhouettes. Strata `polar` only.
        WardHeckbert = "ward-heckbert",
        /// By patches, one for each sample, that keep their radiance [Krivanek05, Eq. 10-11]; any
        /// strata, but blind to occlusion.
        PerSample = "per-sample",
        /// By a mesh over the hits; sees silhouettes. Strata `concentric` only.
        Triangulated = "triangulated",
    }
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
