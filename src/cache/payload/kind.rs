//! What the fill, the refinement and the index ask of a payload.

use super::axes::Axes;
use super::irradiance::Irradiance;
use crate::cache::record::{RadiusRule, Record};
use crate::gather::{HemisphereSamples, LobeCoefficients};
use crate::geometry::SurfacePoint;
use crate::math::{Color, luminance};

/// What decides how visible the indirect light is at a shading point.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Appearance {
    /// Radiance towards the viewer per irradiance of indirect light, by the diffuse lobe: ρ/π.
    pub reflectance: Color,
    /// Luminance of all other light that leaves the point towards the viewer, as far as it is
    /// known.
    pub direct: f32,
}

/// Writes the glossy lobe of shading point number `p` towards its viewer; false if the point has
/// none that a radiance cache answers for.
pub type Lobes<'a> = dyn Fn(usize, &mut LobeCoefficients) -> bool + Sync + 'a;

/// A shading point as refinement sees it.
pub struct Seen<'a> {
    /// Its number.
    pub number: usize,
    /// Where it is.
    pub at: &'a SurfacePoint,
    /// What it looks like.
    pub appearance: &'a Appearance,
    /// The lobes of all points.
    pub lobes: Option<&'a Lobes<'a>>,
}

/// What a record holds. The fill, the refinement, the index and the lookup are the same for all
/// payloads.
pub trait Payload: Clone + Send + Sync {
    /// What estimates and comparisons need besides the scheme.
    type Context<'a>: Copy + Send + Sync;

    /// True if the payload holds incident radiance. Then gathers ask how the light of hits changes,
    /// and [`Payload::luminance`] costs much more than finding out whether a record is valid:
    /// refinement does not repeat it when a record's area shrinks.
    const HOLDS_RADIANCE: bool;

    /// The record of the gather `samples` at `at`, of which `irradiance` is the part that every
    /// record has. `order` is the number of bands that the point asks for.
    fn estimate(
        context: Self::Context<'_>, samples: &HemisphereSamples, at: &SurfacePoint, order: u8,
        irradiance: Record<Irradiance>, rule: &RadiusRule,
    ) -> Record<Self>;

    /// The irradiance.
    fn irradiance(&self) -> &Irradiance;

    /// Bytes that the payload occupies on the heap.
    fn heap_bytes(&self) -> usize;

    /// Luminance of the radiance that leaves `seen` if `record` alone is asked, and its standard
    /// error. `None` if the record cannot answer for the lobe of the point.
    ///
    /// Published is the error of irradiance for all light [Krivanek06, Sec. 4.3]. A lobe sees few
    /// of the rays: what it sees is several times as uncertain, and refinement would follow noise.
    fn luminance(
        context: Self::Context<'_>, record: &Record<Self>, seen: &Seen, rule: &RadiusRule,
        scratch: &mut LobeCoefficients,
    ) -> Option<(f32, f32)>;
}

/// Irradiance that leaves `seen` by the diffuse lobe, if `record` alone is asked: luminance and
/// standard error; then the irradiance itself and the factor on gradients.
pub(super) fn diffuse<P: Payload>(
    record: &Record<P>, seen: &Seen, rule: &RadiusRule,
) -> ((f32, f32), Color, f32) {
    let (_, slope) = rule.radius(record.length, record.footprint);
    let offset = seen.at.position - record.position;
    let irradiance = record.payload.irradiance().at(record.normal, seen.at.frame.n, offset, slope);
    let reflectance = seen.appearance.reflectance;
    let leaving = (luminance(reflectance * irradiance), luminance(reflectance) * record.sigma);
    (leaving, irradiance, slope)
}

impl Payload for Irradiance {
    type Context<'a> = ();
    const HOLDS_RADIANCE: bool = false;

    fn estimate(
        (): (), _: &HemisphereSamples, _: &SurfacePoint, _: u8, irradiance: Record<Irradiance>,
        _: &RadiusRule,
    ) -> Record<Self> {
        irradiance
    }

    fn irradiance(&self) -> &Irradiance {
        self
    }

    fn heap_bytes(&self) -> usize {
        if self.axes.is_some() { size_of::<Axes>() } else { 0 }
    }

    fn luminance(
        (): (), record: &Record<Self>, seen: &Seen, rule: &RadiusRule, _: &mut LobeCoefficients,
    ) -> Option<(f32, f32)> {
        Some(diffuse(record, seen, rule).0)
    }
}
