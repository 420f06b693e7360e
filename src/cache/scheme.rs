//! A caching scheme as plain data.

use super::payload::{HitStorage, Storage};
use super::payload::{RadianceMetric, RadiancePlacement};
use crate::basis::BasisKind;
use crate::error::{Error, Result};
use crate::gather::{
    Density, HitChange, Layout, RadianceGradient, TranslationalGradient, TriangleRadiance,
};
use serde::{Deserialize, Serialize};

/// The length R_i from which a record's radius of validity is made.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Metric {
    /// Harmonic mean of the distances [Ward88].
    Harmonic,
    /// Smallest distance.
    Minimum,
    /// Smallest distance over the rays more than 10° above the tangent plane [Tabellion04].
    MinimumRestricted,
    /// From the gradient of irradiance: the error of using a record's value unchanged.
    Gradient,
    /// From the Hessian of irradiance on the triangulated hemisphere, which knows of occlusion: the
    /// error of using a record with its gradient [Schwarzhaupt12].
    Hessian,
    /// From the Hessian by which all that a gather sees stays visible [Jarosz12].
    UnoccludedHessian,
}

impl Metric {
    /// True if R_i is a distance to the surroundings, false if it comes from an estimate of the
    /// error.
    pub fn is_distance(self) -> bool {
        matches!(self, Self::Harmonic | Self::Minimum | Self::MinimumRestricted)
    }
}

/// Which error is bounded by metrics that estimate one; both are relative to the irradiance at the
/// record.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum ErrorMeasure {
    /// The integral over the record's area, as a share of irradiance times the square of the
    /// scene's diagonal [Schwarzhaupt12]. Small areas may err more.
    Total,
    /// The mean over the record's area, as a share of irradiance.
    Average,
}

/// What outline the areas of records have.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum FootprintKind {
    /// Discs.
    Disc,
    /// Ellipses whose aspect is the fourth root of the eigenvalues' ratio [Schwarzhaupt12].
    Ellipse,
    /// Ellipses whose aspect is the square root of it: the largest for a given error.
    OptimalEllipse,
    /// Eight radii, each from the curvature of irradiance in its sector.
    Sectors,
}

/// How a record's irradiance, and its radiance, are continued beyond its position.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Extrapolation {
    /// Not at all; irradiance by the rotation of the normal alone.
    Zero,
    /// By its gradients.
    First,
    /// By its gradients and its Hessian on the triangulated hemisphere, the second-order term being
    /// limited to the first-order one plus a quarter of the value [Zhao, Eq. 3.18].
    Second,
    /// By quadratics along eight axes, for places and for normals, through values that its samples
    /// give as point sources [Ribardiere11, Sec. 5].
    Axes,
}

/// Which light records hold.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Contents {
    /// Indirect light.
    Indirect,
    /// Those of the first level direct light, too, so that no shadow rays are traced where they are
    /// used.
    DirectAndIndirect,
}

/// In which frame radiance records hold spherical harmonics.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum RadianceFrame {
    /// That of the surface: nothing is turned on flat surfaces, elsewhere the lobe for each record.
    Local,
    /// That of the world: the lobe is turned once, and records when they are made.
    World,
}

/// How the error of using a record elsewhere is estimated.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Kernel {
    /// `|x - x_i|/R_i + sqrt(1 - n·n_i)`, valid below `error` [Ward88].
    Ward,
    /// `max(|x - x_i|/(R_i/2), sqrt(1 - n·n_i)/sqrt(1 - cos α))`, valid below `error`, with α the
    /// limit of the normals, published as 10° [Tabellion04, Eq. 3-5].
    Tabellion,
    /// `1 - (1 - t)(1 - ν)`, t being the position as a share of the record's extent and `ν = (1 -
    /// n·n_i)/(1 - cos α)` with α the limit of the normals, published as 0.2 rad, valid below 1
    /// [Schwarzhaupt12].
    Schwarzhaupt,
    /// `1 - (1 - z)(1 - β/α)`, z being the position as a share of the record's extent, β the angle
    /// between the normals and α its limit, published as 20°, valid below 1. The published weight
    /// has `1/z - 1` in the place of `1 - z` [Ribardiere11, Eq. 25], which is infinite at the
    /// record; both are zero where it ends.
    Ribardiere,
}

/// How valid records are weighed, as a function of e, their error as a share of the allowed one.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Weight {
    /// `1/e` [Ward88]: jumps where a record ends.
    Inverse,
    /// `1/e - 1`: continuous where a record ends.
    InverseMinusOne,
    /// `1 - e`: continuous and bounded.
    Hat,
}

impl Weight {
    /// The weight of a record at error `e` as a share of its own allowed error a_i; `inverse_share`
    /// is the level's allowed error over a_i. Ward's weight is one over the error itself,
    /// whatever the record is allowed.
    #[inline]
    pub fn at(self, e: f32, inverse_share: f32) -> f32 {
        match self {
            // The bound keeps a point on a record finite; the record then outweighs all others.
            Self::Inverse => inverse_share / e.max(1e-6),
            Self::InverseMinusOne => inverse_share * (1.0 / e.max(1e-6) - 1.0),
            Self::Hat => 1.0 - e,
        }
    }
}

/// Whether records that disagree where they overlap are made smaller.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Refinement {
    /// All records of a level are allowed the same error.
    None,
    /// Until no edge of a record's area on the first level is visible by the law of Weber, against
    /// the direct light: see [`Cache::converge`](super::Cache::converge) [Krivanek06].
    Weber,
    /// The same, but the record that weighs most at a point is never kept from it. As published,
    /// the rule shrinks a record that alone differs from the others, and that is the nearest one
    /// wherever farther ones reach over its place: good records vanish, bad ones stay.
    WeberNearest,
}

/// Which bands of a glossy lobe its radiance records serve.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum RadianceBands {
    /// As many as lose no more than `radiance_loss` of its energy; if `radiance_order` is not
    /// enough, paths serve it.
    Needed,
    /// All of them, of any lobe, whatever it loses: sharp lobes are blurred.
    All,
}

/// In which order the shading points of the image are visited.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Order {
    /// Row by row.
    Scanline,
    /// A coarse grid of pixels first, then ever finer ones.
    CoarseToFine,
    /// Scattered over the whole image from the start.
    Hashed,
}

/// Which kind of stratification the gather uses.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Strata {
    /// Rings and sectors: see [`Layout::Polar`].
    Polar,
    /// Concentric squares: see [`Layout::Concentric`].
    Concentric,
}

/// Every choice that makes one published caching scheme differ from another. Each field can be set
/// by its name: see [`Scheme::set`].
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Scheme {
    /// Arrangement of the gather's strata.
    pub strata: Strata,
    /// Density of the gather's rays.
    pub density: Density,
    /// Rays per record on the first level.
    pub rays: u32,
    /// Factor on `rays` from one level to the next deeper one.
    pub deeper_rays: f32,
    /// A record of the first level whose relative standard error exceeds this is gathered again
    /// with four times the rays; 0 means never.
    pub noise: f32,
    /// What R_i is.
    pub metric: Metric,
    /// Which error a metric that estimates one bounds.
    pub error_measure: ErrorMeasure,
    /// The outline of the area; other than discs only for the Hessian metrics.
    pub footprint: FootprintKind,
    /// Longest radius of an ellipse or of a sector as a multiple of the record's shortest one.
    pub max_aspect: f32,
    /// The radiance of triangles on the triangulated hemisphere.
    pub triangle_radiance: TriangleRadiance,
    /// Upper bound of R_i: the mean distance of this nearest fraction of the rays, times
    /// `nearest_scale`; 0 switches it off.
    pub nearest_fraction: f32,
    /// See `nearest_fraction`.
    pub nearest_scale: f32,
    /// The error measure.
    pub kernel: Kernel,
    /// The weights of valid records.
    pub weight: Weight,
    /// The angle between the normals at which a record ends, radians, at most π/2: what kernels
    /// other than `ward` call α, `tabellion` multiplying its chord with `error`. With `ward`,
    /// whose a bounds the angle, too, a limit beside that: above a = 1 it is the only one.
    pub normal_limit: f32,
    /// The allowed error: a of [Ward88], 1/κ of [Tabellion04], ε for metrics that estimate an
    /// error.
    pub error: f32,
    /// Factor on `error` from one level to the next deeper one.
    pub deeper_error: f32,
    /// Factor on `error` once a level is filled, so that each point sees several records; 1
    /// changes nothing.
    pub smoothing: f32,
    /// Extrapolate along the normal's rotation.
    pub rotational_gradient: bool,
    /// Extrapolate along the position's translation.
    pub translational_gradient: TranslationalGradient,
    /// Which light records hold.
    pub contents: Contents,
    /// How records are continued.
    pub extrapolation: Extrapolation,
    /// With `extrapolation` `axes`: an axis is shortened until irradiance interpolated along it
    /// errs by at most this share, ρ of [Ribardiere11, Sec. 6]; 0 switches it off.
    pub axis_error: f32,
    /// Light samples for the direct light of a record.
    pub light_rays: u32,
    /// Light samples for each place on its axes where direct light is asked for.
    pub axis_light_rays: u32,
    /// Light paths that are joined with each record of the first level, beside its rays: a
    /// bidirectional gather [Ribardiere11, Fig. 1].
    pub light_paths: u32,
    /// Bound R_i by `E/|∇E|` [Krivanek06, Eq. 2], the radius along an axis v by `E/|∇E·v|`.
    pub gradient_clamp: bool,
    /// Bound R_i by `R_j + |x_i - x_j|` for all records j [Krivanek06, Sec. 5.3].
    pub neighbour_clamp: bool,
    /// How records are refined.
    pub refinement: Refinement,
    /// The smallest allowed error that refinement leaves a record.
    pub error_min: f32,
    /// The smallest relative difference of luminance that refinement takes for visible.
    pub contrast: f32,
    /// Smallest radius of validity in pixels, 0 for none.
    pub min_pixels: f32,
    /// Largest radius of validity in pixels, 0 for none.
    pub max_pixels: f32,
    /// Largest radius of validity as a share of the scene's diagonal.
    pub max_radius: f32,
    /// Reject records that lie in front of the point.
    pub in_front_test: bool,
    /// Do not use records behind surfaces that their own rays found inside their area.
    pub fences: bool,
    /// Levels with a cache of their own: 1 caches what the camera sees, 2 also the points that
    /// light reaches those from, and so on. Light from beyond is path traced.
    pub levels: u8,
    /// 1: each point is shaded by the records that exist when its round ends; 2: the cache is
    /// filled first, then everything is shaded by it.
    pub passes: u8,
    /// Order of the shading points.
    pub order: Order,
    /// Glossy lobes that this many bands of harmonics represent are served by radiance records; 0:
    /// none are, and gloss is followed by paths.
    pub radiance_order: u8,
    /// Levels of bounces that have radiance records, of those that have records at all: with 1 the
    /// glossy surfaces that the camera sees, with 2 also those that light reaches these from, and
    /// so on. Gloss that is met beyond is followed by paths.
    pub radiance_levels: u8,
    /// The basis of radiance records.
    pub radiance_basis: BasisKind,
    /// Largest share of a lobe's energy that its representation may lose [Krivanek05, Sec. 4.1]; a
    /// relative RMS error of e is e².
    pub radiance_loss: f32,
    /// Which bands of a lobe records serve, and so which lobes.
    pub radiance_bands: RadianceBands,
    /// How the translational gradient of radiance records is estimated. `boundary` needs strata
    /// `polar`; `per-sample` takes its place on others.
    pub radiance_gradient: RadianceGradient,
    /// Density of the rays of radiance records.
    pub radiance_density: Density,
    /// Factor on `rays` for radiance records.
    pub radiance_rays: f32,
    /// Factor on `error` for radiance records.
    pub radiance_error: f32,
    /// Glossy lobes beside a diffuse one are served by records where they are at least this share
    /// of the albedo; fainter ones are followed by paths.
    pub radiance_share: f32,
    /// Records serve a material only if they take the place of at least as many paths as this many
    /// of them have rays.
    pub radiance_break_even: f32,
    /// Highest order of lobes that records serve where the surface is curved.
    pub radiance_curved_order: u8,
    /// Radiance records have the order that the point where they were made needs, and count as
    /// zero beyond it [Krivanek05]; otherwise the order that their surface needs at most, and no
    /// record of a lower order than the lobe's is used.
    pub radiance_padding: bool,
    /// The frame of radiance records in spherical harmonics; hemispherical ones are always local.
    pub radiance_frame: RadianceFrame,
    /// How the numbers of radiance records are kept.
    pub radiance_storage: Storage,
    /// Radiance records serve diffuse surfaces, too: all points that the camera sees have records
    /// of the full order.
    pub radiance_diffuse: bool,
    /// From which error the areas of radiance records follow.
    pub radiance_metric: RadianceMetric,
    /// Of what that error is.
    pub radiance_placement: RadiancePlacement,
    /// How gathers for radiance records take into account that glossy hits look different from
    /// beside the record [Zhao, Sec. 3.8].
    pub hit_change: HitChange,
    /// Whether radiance records keep their hits, a reference to compare with.
    pub radiance_hits: HitStorage,
}

impl Scheme {
    /// The layout of a gather on `level`.
    pub fn layout(&self, level: u8) -> Layout {
        let rays =
            (self.rays as f32 * self.deeper_rays.powi(i32::from(level))).round().max(16.0) as u32;
        match self.strata {
            // The 8 x 8 of scotty3d and other small squares are kept as they were published.
            Strata::Polar if rays == 64 => Layout::Polar { m: 8, n: 8 },
            Strata::Polar => Layout::polar(rays),
            Strata::Concentric => Layout::concentric(rays),
        }
    }

    /// The allowed error on `level` while it is being filled.
    pub fn error_at(&self, level: u8) -> f32 {
        self.error * self.deeper_error.powi(i32::from(level))
    }

    /// The power of the allowed error with which radii grow.
    pub fn radius_power(&self) -> f32 {
        match (self.metric, self.error_measure) {
            (Metric::Harmonic | Metric::Minimum | Metric::MinimumRestricted, _)
            | (Metric::Gradient, ErrorMeasure::Average) => 1.0,
            (Metric::Gradient, ErrorMeasure::Total) => 1.0 / 3.0,
            (Metric::Hessian | Metric::UnoccludedHessian, ErrorMeasure::Average) => 0.5,
            (Metric::Hessian | Metric::UnoccludedHessian, ErrorMeasure::Total) => 0.25,
        }
    }

    /// What a record's lengths are multiplied by on `level` while it is being filled, to become
    /// radii.
    pub fn radius_scale(&self, level: u8) -> f32 {
        let (error, power) = (self.error_at(level), self.radius_power());
        if power == 1.0 { error } else { error.powf(power) }
    }

    /// True if some estimate needs the triangulated hemisphere.
    pub fn triangulates(&self) -> bool {
        self.metric == Metric::Hessian
            || self.translational_gradient == TranslationalGradient::Triangulated
            || self.extrapolation == Extrapolation::Second
    }

    /// True if radiance records need the triangulated hemisphere.
    pub(super) fn triangulates_radiance(&self) -> bool {
        self.radiance_order > 0
            && (self.radiance_gradient == RadianceGradient::Triangulated
                || self.radiance_metric != RadianceMetric::Irradiance
                || self.radiance_placement != RadiancePlacement::Incoming
                || self.hit_change != HitChange::None)
    }

    /// How the translational gradient of radiance records is estimated with the strata that there
    /// are.
    fn usable_radiance_gradient(&self) -> RadianceGradient {
        match (self.radiance_gradient, self.strata) {
            (RadianceGradient::Boundary, Strata::Concentric) => RadianceGradient::PerSample,
            (gradient, _) => gradient,
        }
    }

    /// The scheme by which radiance records are placed.
    pub fn for_radiance(&self) -> Self {
        let metric = match self.radiance_metric {
            RadianceMetric::Irradiance => self.metric,
            RadianceMetric::First => Metric::Gradient,
            RadianceMetric::Second => Metric::Hessian,
        };
        Self {
            metric,
            rays: (self.rays as f32 * self.radiance_rays).round().clamp(16.0, 1e6) as u32,
            density: self.radiance_density,
            radiance_gradient: self.usable_radiance_gradient(),
            error: self.error * self.radiance_error,
            levels: self.levels.min(self.radiance_levels),
            // Their gloss needs its own direct light anyway.
            contents: Contents::Indirect,
            // And light paths are no part of its harmonics.
            light_paths: 0,
            ..self.clone()
        }
    }

    /// Spends about `quality` times the work: as many more rays per record and, since the number of
    /// records grows with the inverse square of radii, a smaller error.
    pub fn scale_quality(&mut self, quality: f32) {
        self.rays = (self.rays as f32 * quality.sqrt()).round().clamp(16.0, 1e6) as u32;
        self.error *= quality.powf(-0.25 / self.radius_power());
        // What a quadratic leaves out grows with the third power of its length.
        self.axis_error *= quality.powf(-0.75);
    }

    /// Multiplies the allowed error by `factor`, and with it all else that says how careful the
    /// scheme is, so that one number leads from many records to few. Where records are refined
    /// `factor` is that of what is visible and of the smallest allowed error; that of the
    /// largest one is its root, or the radii would be large beyond reason before anything else
    /// gives way.
    pub fn scale_error(&mut self, factor: f32) {
        if self.refinement == Refinement::None {
            self.error *= factor;
        } else {
            self.error *= factor.sqrt();
            self.error_min *= factor;
            self.contrast *= factor;
        }
        if self.extrapolation == Extrapolation::Axes {
            self.axis_error *= factor;
        }
    }

    /// Sets the field called `key` to `value`, written as in the output of `lumicache presets`.
    ///
    /// # Errors
    /// [`Error::InvalidArgument`] naming the field and what it takes; the scheme is unchanged then.
    pub fn set(&mut self, key: &str, value: &str) -> Result<()> {
        let serde_json::Value::Object(mut fields) =
            serde_json::to_value(&*self).expect("a scheme is plain data")
        else {
            unreachable!("a scheme serialises to an object")
        };
        if !fields.contains_key(key) {
            let names: Vec<_> = fields.keys().map(String::as_str).collect();
            return Err(Error::InvalidArgument(format!(
                "there is no setting `{key}`; the settings are {}",
                names.join(", ")
            )));
        }
        let value = serde_json::from_str(value)
            .unwrap_or_else(|_| serde_json::Value::String(value.to_owned()));
        fields.insert(key.to_owned(), value);
        let changed: Self = serde_json::from_value(serde_json::Value::Object(fields))
            .map_err(|e| Error::InvalidArgument(format!("setting `{key}`: {e}")))?;
        changed.check()?;
        *self = changed;
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cache::Preset;

    #[test]
    fn settings_go_by_name_and_bad_ones_change_nothing() {
        let mut scheme = Preset::by_name("tabellion04").unwrap().scheme();
        scheme.set("error", "0.5").unwrap();
        scheme.set("metric", "harmonic").unwrap();
        scheme.set("neighbour_clamp", "true").unwrap();
        assert_eq!(
            (scheme.error, scheme.metric, scheme.neighbour_clamp),
            (0.5, Metric::Harmonic, true)
        );
        let before = scheme.clone();
        for (key, value) in [
            ("error", "-1"),
            ("error", "much"),
            ("metric", "mean"),
            ("nothing", "1"),
            ("rays", "1"),
            ("rays", "1e99"),
        ] {
            let error = scheme.set(key, value).unwrap_err().to_string();
            assert!(error.contains(key), "{error}");
        }
        assert_eq!(scheme, before);
    }

    #[test]
    fn one_factor_scales_all_that_says_how_careful_a_scheme_is() {
        let scaled = |preset: &str| {
            let (before, mut after) = (
                Preset::by_name(preset).unwrap().scheme(),
                Preset::by_name(preset).unwrap().scheme(),
            );
            after.scale_error(4.0);
            (
                after.error / before.error,
                after.error_min / before.error_min,
                after.contrast / before.contrast,
                after.axis_error / before.axis_error,
            )
        };
        assert_eq!(scaled("schwarzhaupt12"), (4.0, 1.0, 1.0, 1.0));
        assert_eq!(scaled("krivanek06"), (2.0, 4.0, 4.0, 1.0));
        assert_eq!(scaled("aric11"), (4.0, 1.0, 1.0, 4.0));
    }
}
