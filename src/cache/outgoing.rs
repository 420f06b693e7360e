//! What single records say of the light that leaves a shading point: the quantity that adaptive
//! caching compares.

use super::converge::Appearance;
use super::radiance::{LobeCoefficients, Maker, Radiance};
use super::{Reach, Record};
use crate::geometry::SurfacePoint;
use crate::math::luminance;

/// The glossy lobe of shading point number `p` towards its viewer, if it has one that records
/// serve.
pub type Lobes<'a> = dyn Fn(usize, &mut LobeCoefficients) -> bool + Sync + 'a;

/// The light that leaves shading points by their records.
#[derive(Clone, Copy)]
pub(super) enum Outgoing<'a> {
    /// By the diffuse lobe, from irradiance.
    Diffuse,
    /// By all lobes, from radiance records.
    Glossy {
        /// The lobes of the points.
        lobes: &'a Lobes<'a>,
        /// What made the records.
        maker: &'a Maker,
        /// See [`super::Bands::Padded`].
        padding: bool,
    },
}

impl Outgoing<'_> {
    /// Luminance of the radiance that leaves point `p`, which is `at`, if `record` alone is asked,
    /// whose radiance is `radiance`, and its standard error. `None` if it has too few bands for the
    /// point's lobe.
    ///
    /// Published is the error of irradiance for all light [Krivanek06, Sec. 4.3]. A lobe sees few
    /// of the rays: what it sees is several times as uncertain, and refinement would follow noise.
    pub fn luminance(
        &self,
        (p, at): (usize, &SurfacePoint),
        appearance: &Appearance,
        reach: &Reach,
        (record, radiance): (&Record, Option<&Radiance>),
        scratch: &mut LobeCoefficients,
    ) -> Option<(f32, f32)> {
        let irradiance = record.irradiance_at(reach, at);
        let diffuse = (
            luminance(appearance.reflectance * irradiance),
            luminance(appearance.reflectance) * record.sigma,
        );
        let (Self::Glossy { lobes, maker, padding }, Some(radiance)) = (self, radiance) else {
            return Some(diffuse);
        };
        if !lobes(p, scratch) {
            return Some(diffuse);
        }
        if radiance.order() < scratch.order && !padding {
            return None;
        }
        let (_, slope) = reach.radius(record.length, record.footprint);
        maker.prepare(at, scratch);
        let offset = slope * (at.position - record.position);
        let (glossy, sigma) = maker.leaving_with_error(radiance, at, offset, irradiance, scratch);
        // Both come of the same rays.
        Some((diffuse.0 + luminance(glossy), diffuse.1 + sigma))
    }

    /// True if the luminance costs much more than finding out whether a record is valid. Then it is
    /// not worked out anew when a record's area shrinks.
    pub fn is_costly(&self) -> bool {
        matches!(self, Self::Glossy { .. })
    }
}
