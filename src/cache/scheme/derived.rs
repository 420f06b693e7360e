//! The schemes that follow from one: by which radiance records and records of all light are placed.

use super::{
    Clamping, Contents, Extrapolation, Gather, GlossyMetric, Kernel, Metric, Outline, Radius,
    Schedule, Scheme, Strata, Validity, Weight,
};
use crate::gather::{RadianceGradient, TranslationalGradient};

/// Rays that tell how far a record of all light reaches.
const PLACING_RAYS: u32 = 64;

impl Scheme {
    /// The scheme by which radiance records are placed.
    pub(in crate::cache) fn for_radiance(&self) -> Self {
        let (mut scheme, mut glossy) = (self.clone(), self.glossy());
        let measure = self.radius.metric.measure();
        scheme.radius.metric = match glossy.metric {
            GlossyMetric::Irradiance => self.radius.metric,
            GlossyMetric::First(_) => Metric::Gradient(measure),
            GlossyMetric::Second(_) => Metric::Hessian(measure),
        };
        if glossy.gradient == RadianceGradient::Boundary && self.gather.strata != Strata::Polar {
            glossy.gradient = RadianceGradient::PerSample;
        }
        scheme.glossy = Some(glossy);
        scheme.validity.error *= glossy.error;
        scheme.levels = self.levels.min(glossy.levels);
        // Their glossy lobes need its own direct light anyway.
        scheme.contents = Contents::Indirect;
        // And light paths are no part of its harmonics.
        if let Extrapolation::Axes { light_paths, .. } = &mut scheme.extrapolation {
            *light_paths = 0;
        }
        scheme
    }

    /// The scheme by which records of all light are placed.
    pub(in crate::cache) fn for_radiosity(&self) -> Self {
        let (mut placed, settings) = (self.clone(), self.radiosity.unwrap_or_default());
        (placed.radiosity, placed.glossy, placed.refinement) = (None, None, None);
        (placed.levels, placed.schedule) = (1, Schedule::Scattered);
        placed.contents = Contents::Indirect;
        placed.extrapolation = Extrapolation::None;
        // Far-reaching records must not spread light into corners that they see nothing of.
        placed.clamping = Clamping::Neighbours;
        placed.gather = Gather {
            strata: Strata::Concentric,
            rays: PLACING_RAYS,
            noise: 0.0,
            bright: 0.0,
            gradient: TranslationalGradient::None,
            ..placed.gather
        };
        placed.radius = Radius {
            metric: Metric::Harmonic,
            area: Outline::Disc,
            nearest: 4.0,
            min_pixels: 1.0,
            max_pixels: 0.0,
            max_radius: 0.1,
            ..placed.radius
        };
        placed.validity = Validity {
            kernel: Kernel::Ward,
            weight: Weight::Hat,
            error: settings.error,
            smoothing: 1.4,
            fences: true,
            ..placed.validity
        };
        placed
    }
}
