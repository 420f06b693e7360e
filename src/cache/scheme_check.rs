//! Which schemes there can be.

use super::{
    Contents, Extrapolation, FootprintKind, Kernel, Metric, RadianceBands, Refinement, Scheme,
    Strata,
};
use crate::basis::BasisKind;
use crate::error::{Error, Result};
use crate::gather::{RadianceGradient, TranslationalGradient};
use std::f32::consts::FRAC_PI_2;

/// Bands of radiance records: more cost more than the paths they replace, and tables of tilts grow
/// with the fifth power.
const MAX_RADIANCE_ORDER: u8 = 20;

impl Scheme {
    /// Checks that the fields are in their ranges and go together.
    ///
    /// # Errors
    /// [`Error::InvalidArgument`] naming the first that is not.
    pub fn check(&self) -> Result<()> {
        let fail = |what: &str| Err(Error::InvalidArgument(what.to_owned()));
        let positive = |x: f32| x.is_finite() && x > 0.0;
        let not_negative = |x: f32| x.is_finite() && x >= 0.0;
        if !(16..=1_000_000).contains(&self.rays) {
            return fail("setting `rays` must be between 16 and 1000000");
        }
        if !(positive(self.deeper_rays) && self.deeper_rays <= 4.0) {
            return fail("setting `deeper_rays` must be above 0 and at most 4");
        }
        for (name, value) in [
            ("error", self.error),
            ("error_min", self.error_min),
            ("contrast", self.contrast),
            ("deeper_error", self.deeper_error),
            ("nearest_scale", self.nearest_scale),
            ("max_aspect", self.max_aspect),
        ] {
            if !positive(value) {
                return fail(&format!("setting `{name}` must be above 0"));
            }
        }
        if !(positive(self.normal_limit) && self.normal_limit <= FRAC_PI_2) {
            return fail("setting `normal_limit` must be above 0 and at most π/2");
        }
        if !(self.smoothing >= 1.0 && self.smoothing <= 10.0) {
            return fail("setting `smoothing` must be between 1 and 10");
        }
        for (name, value) in [
            ("noise", self.noise),
            ("min_pixels", self.min_pixels),
            ("max_pixels", self.max_pixels),
            ("nearest_fraction", self.nearest_fraction),
            ("axis_error", self.axis_error),
        ] {
            if !not_negative(value) {
                return fail(&format!("setting `{name}` must not be negative"));
            }
        }
        if self.nearest_fraction > 1.0 {
            return fail("setting `nearest_fraction` must be at most 1");
        }
        if !(positive(self.max_radius) && self.max_radius <= 1.0) {
            return fail("setting `max_radius` must be above 0 and at most 1");
        }
        if self.max_pixels > 0.0 && self.max_pixels < self.min_pixels {
            return fail("setting `max_pixels` must not be below `min_pixels`");
        }
        if !(1..=16).contains(&self.levels) {
            return fail("setting `levels` must be between 1 and 16");
        }
        if !(1..=2).contains(&self.passes) {
            return fail("setting `passes` must be 1 or 2");
        }
        if self.refinement != Refinement::None && self.passes != 2 {
            return fail(
                "setting `refinement` needs `passes` 2: records shrink after they are made",
            );
        }
        if self.noise > 0.0 && self.passes != 2 {
            return fail(
                "setting `noise` needs `passes` 2: noisy records are gathered again when all are made",
            );
        }
        let simple = self.kernel != Kernel::Schwarzhaupt
            && self.footprint == FootprintKind::Disc
            && self.extrapolation != Extrapolation::Second;
        if self.refinement != Refinement::None && !simple {
            return fail(
                "setting `refinement` needs kernel `ward` or `tabellion`, footprint `disc` and no extrapolation to second order",
            );
        }
        if self.translational_gradient == TranslationalGradient::WardHeckbert
            && self.strata != Strata::Polar
        {
            return fail("the translational gradient `ward-heckbert` needs strata `polar`");
        }
        if self.radiance_order > MAX_RADIANCE_ORDER {
            return fail(&format!("setting `radiance_order` must be at most {MAX_RADIANCE_ORDER}"));
        }
        if !(1..=16).contains(&self.radiance_levels) {
            return fail("setting `radiance_levels` must be between 1 and 16");
        }
        if !(self.radiance_loss > 0.0 && self.radiance_loss < 1.0) {
            return fail("setting `radiance_loss` must be between 0 and 1");
        }
        if self.radiance_bands == RadianceBands::All && self.radiance_order == 0 {
            return fail("setting `radiance_bands` `all` needs a `radiance_order` above 0");
        }
        for (name, value) in
            [("radiance_rays", self.radiance_rays), ("radiance_error", self.radiance_error)]
        {
            if !(positive(value) && value <= 100.0) {
                return fail(&format!("setting `{name}` must be above 0 and at most 100"));
            }
        }
        if !not_negative(self.radiance_break_even) {
            return fail("setting `radiance_break_even` must not be negative");
        }
        if !(0.0..=1.0).contains(&self.radiance_share) {
            return fail("setting `radiance_share` must be from 0 to 1");
        }
        if self.triangulates_radiance() {
            let whole = self.radiance_gradient == RadianceGradient::Triangulated
                && self.radiance_basis == BasisKind::Sh;
            if !(whole && self.strata == Strata::Concentric) {
                return fail(
                    "the settings `radiance_metric`, `radiance_placement` and `hit_change` need radiance gradient `triangulated`, and that needs radiance basis `sh` and strata `concentric`",
                );
            }
        }
        if self.triangulates() && self.strata != Strata::Concentric {
            return fail(
                "the metric `hessian`, the translational gradient `triangulated` and the extrapolation `second` need strata `concentric`",
            );
        }
        if self.max_aspect < 1.0 {
            return fail("setting `max_aspect` must be at least 1");
        }
        let outlined = match self.metric {
            Metric::Hessian | Metric::UnoccludedHessian => true,
            Metric::Minimum | Metric::MinimumRestricted => self.footprint == FootprintKind::Sectors,
            Metric::Harmonic | Metric::Gradient => false,
        };
        if self.footprint != FootprintKind::Disc && !outlined {
            return fail(
                "the metrics `hessian` and `unoccluded-hessian` have any footprint, `minimum` and `minimum-restricted` `disc` and `sectors`, the others `disc`",
            );
        }
        let axes = self.extrapolation == Extrapolation::Axes;
        if axes && !matches!(self.footprint, FootprintKind::Disc | FootprintKind::Sectors) {
            return fail("the extrapolation `axes` needs footprint `disc` or `sectors`");
        }
        if self.contents != Contents::Indirect && !axes {
            return fail("the contents `direct-and-indirect` need extrapolation `axes`");
        }
        if self.light_paths > 0 && !axes {
            return fail(
                "setting `light_paths` needs extrapolation `axes`: gradients know of rays alone",
            );
        }
        if self.light_paths > 1_000_000 {
            return fail("setting `light_paths` must be at most 1000000");
        }
        for (name, value) in
            [("light_rays", self.light_rays), ("axis_light_rays", self.axis_light_rays)]
        {
            if !(1..=65_536).contains(&value) {
                return fail(&format!("setting `{name}` must be between 1 and 65536"));
            }
        }
        Ok(())
    }
}
