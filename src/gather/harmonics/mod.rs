//! Incident radiance in harmonics: the coefficients and their derivatives.

mod coefficients;
mod triangulated;
mod gradients;

pub use coefficients::Coefficients;
pub use gradients::RadianceGradient;
pub use triangulated::RadianceDerivatives;
