//! Which settings go together.

use super::{Contents, Extrapolation, Kernel, Metric, Outline, Scheme, Strata, set};
use crate::error::{Error, Result};
use crate::gather::{HitChange, RadianceGradient, TranslationalGradient};

impl Scheme {
    /// Checks that the settings are in their ranges and go together.
    ///
    /// # Errors
    /// [`Error::InvalidArgument`] naming the first that does not.
    pub fn check(&self) -> Result<()> {
        set::check_ranges(self)
            .and_then(|()| self.check_combinations().map_err(str::to_owned))
            .map_err(Error::InvalidArgument)
    }

    /// True if radiance records need the triangulated hemisphere.
    pub(crate) fn triangulates_radiance(&self) -> bool {
        self.glossy.is_some_and(|g| {
            g.gradient == RadianceGradient::Triangulated
                || g.whole()
                || g.hits.change() != HitChange::None
        })
    }

    pub(super) fn check_combinations(&self) -> std::result::Result<(), &'static str> {
        let (radius, concentric) = (&self.radius, self.gather.strata == Strata::Concentric);
        let one_pass = self.schedule == super::Schedule::OnePass;
        let axes = self.extrapolation.has_axes();
        let outlined = match radius.metric {
            Metric::Hessian(_) | Metric::UnoccludedHessian(_) => true,
            Metric::Minimum | Metric::MinimumRestricted => radius.area == Outline::Sectors,
            Metric::Harmonic | Metric::Gradient(_) => false,
        };
        let simple = self.validity.kernel != Kernel::Schwarzhaupt
            && radius.area == Outline::Disc
            && self.extrapolation != Extrapolation::Second;
        let meshes = self.glossy.is_none_or(|g| {
            g.gradient == RadianceGradient::Triangulated
                && g.basis != super::GlossyBasis::Hsh
                && concentric
        });
        for (wrong, rule) in [
            (
                radius.max_pixels > 0.0 && radius.max_pixels < radius.min_pixels,
                "setting `radius.max_pixels` must not be below `radius.min_pixels`",
            ),
            (
                one_pass && self.refinement.is_some(),
                "setting `refinement` needs a `schedule` other than one-pass: records shrink after \
                 they are made",
            ),
            (
                one_pass && self.gather.noise > 0.0,
                "setting `gather.noise` needs a `schedule` other than one-pass: noisy records are \
                 gathered again when all are made",
            ),
            (
                self.gather.bright > 0.0 && self.extrapolation.light_paths() > 0,
                "of `gather.bright` and `extrapolation.light_paths` one must be 0",
            ),
            (
                self.refinement.is_some() && !simple,
                "setting `refinement` needs `validity.kernel` ward or tabellion, `radius.area` \
                 disc and no `extrapolation.kind` second",
            ),
            (
                self.gather.gradient == TranslationalGradient::WardHeckbert && concentric,
                "`gather.gradient` ward-heckbert needs `gather.strata` polar",
            ),
            (
                self.triangulates() && !concentric,
                "`radius.metric` hessian, `gather.gradient` triangulated and `extrapolation.kind` \
                 second need `gather.strata` concentric",
            ),
            (
                self.triangulates_radiance() && !meshes,
                "`glossy.metric` first and second, and `glossy.hits` frozen, analytic and \
                 harmonics, need `glossy.gradient` triangulated; that needs `glossy.basis` sh or \
                 sh-world and `gather.strata` concentric",
            ),
            (
                radius.area != Outline::Disc && !outlined,
                "`radius.metric` hessian and unoccluded-hessian have any `radius.area`, minimum \
                 and minimum-restricted disc and sectors, the others disc",
            ),
            (
                self.radiosity.is_some() && self.glossy().levels > 1,
                "setting `glossy.levels` above 1 needs `radiosity` none",
            ),
            (
                axes && !matches!(radius.area, Outline::Disc | Outline::Sectors),
                "`extrapolation.kind` axes needs `radius.area` disc or sectors",
            ),
            (
                self.contents != Contents::Indirect && !axes,
                "`contents` direct-and-indirect needs `extrapolation.kind` axes",
            ),
        ] {
            if wrong {
                return Err(rule);
            }
        }
        Ok(())
    }
}
