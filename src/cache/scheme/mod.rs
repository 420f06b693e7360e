//! A caching scheme as plain data.

mod vocabulary;
mod derived;
mod table;
mod set;
mod check;
mod preset;
mod page;

pub use page::settings_page;
pub use preset::{PRESETS, Preset};
pub use set::settings;
pub use table::{Allowed, Bounds, Setting};
pub use vocabulary::{
    Bands, Clamping, Contents, GlossyBasis, GlossyMetric, Hits, Kernel, Measure, Metric, Outline,
    Placement, RefinementRule, Schedule, Storage, Strata, Weight,
};

use crate::gather::{Density, Layout, RadianceGradient, TranslationalGradient};
use serde::{Deserialize, Serialize};
use table::{Describe, above, group, within};

const INFINITY: f64 = f64::INFINITY;
/// π/2 as it is in single precision.
const RIGHT_ANGLE: f64 = 1.570_796_4;

group! {
    /// How records gather light.
    #[derive(Copy)]
    pub struct Gather {
        /// Arrangement of the gather's strata.
        pub strata: Strata,
        /// Rays per record on the first level.
        pub rays: u32 = within(16.0, 1e6),
        /// Factor on `rays` from one level to the next deeper one.
        pub deeper_rays: f32 = above(0.0, 4.0),
        /// A record of the first level whose relative standard error exceeds this is gathered again
        /// with four times the rays; 0 means never.
        pub noise: f32 = within(0.0, INFINITY),
        /// Rays towards small bright surfaces where those light up a scene, such as an uplight's
        /// spot on the ceiling, as a share of the rays of a gather; 0 for none. Where light is
        /// spread, there are none.
        pub bright: f32 = within(0.0, 4.0),
        /// How the translational gradient of irradiance is estimated.
        pub gradient: TranslationalGradient,
    }
}

group! {
    /// The radius of validity and the area of records.
    #[derive(Copy)]
    pub struct Radius {
        /// What R_i is.
        pub metric: Metric,
        /// The outline of the area. The `hessian` metrics have any, `minimum` and
        /// `minimum-restricted` have `disc` and `sectors`, the others `disc`.
        pub area: Outline,
        /// Longest radius of an ellipse or of a sector as a multiple of the record's shortest one.
        pub max_aspect: f32 = within(1.0, INFINITY),
        /// Upper bound of R_i as a multiple of the mean distance of the nearest 2 % of the rays; 0
        /// means none.
        pub nearest: f32 = within(0.0, INFINITY),
        /// Smallest radius of validity in pixels, 0 for none.
        pub min_pixels: f32 = within(0.0, INFINITY),
        /// Largest radius of validity in pixels, 0 for none.
        pub max_pixels: f32 = within(0.0, INFINITY),
        /// Largest radius of validity as a share of the extent of what is lit: 2.125
        /// times the middle distance between two of its points.
        pub max_radius: f32 = above(0.0, 1.0),
    }
}

group! {
    /// Where records are valid, and how they are weighed.
    #[derive(Copy)]
    pub struct Validity {
        /// The error measure.
        pub kernel: Kernel,
        /// The weights of valid records.
        pub weight: Weight,
        /// The angle between the normals at which a record ends, radians, at most π/2: what kernels
        /// other than `ward` call α, `tabellion` multiplying its chord with `error`. With `ward`,
        /// whose a bounds the angle, too, a limit beside that: above a = 1 it is the only one.
        pub normal_limit: f32 = above(0.0, RIGHT_ANGLE),
        /// The allowed error: a of [Ward88], 1/κ of [Tabellion04], ε for metrics that estimate an
        /// error.
        pub error: f32 = above(0.0, INFINITY),
        /// Factor on `error` from one level to the next deeper one.
        pub deeper_error: f32 = above(0.0, INFINITY),
        /// Factor on `error` once a level is filled, so that each point sees several records; 1
        /// changes nothing.
        pub smoothing: f32 = within(1.0, 10.0),
        /// Do not use records behind surfaces that their own rays found inside their area.
        pub fences: bool,
    }
}

/// How a record's irradiance, and its radiance, are continued beyond its position.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "kebab-case")]
pub enum Extrapolation {
    /// Not at all.
    None,
    /// Irradiance by the rotation of the normal alone.
    Rotation,
    /// By the gradients.
    First,
    /// By the gradients and the Hessian on the triangulated hemisphere, the second-order term being
    /// limited to the first-order one plus a quarter of the value [Zhao, Eq. 3.18].
    Second,
    /// By quadratics along eight axes, for places and for normals, through values that its samples
    /// give as point sources [Ribardiere11, Sec. 5].
    Axes {
        /// An axis is shortened until irradiance interpolated along it errs by at most this share,
        /// ρ of [Ribardiere11, Sec. 6]; 0 switches it off.
        #[serde(default = "Extrapolation::default_error")]
        error: f32,
        /// Light paths that are joined with each record of the first level, beside its rays: a
        /// bidirectional gather [Ribardiere11, Fig. 1].
        #[serde(default)]
        light_paths: u32,
    },
}

impl Extrapolation {
    fn default_error() -> f32 {
        0.05
    }

    /// True if irradiance follows the rotation of the normal by its gradient.
    pub fn rotates(self) -> bool {
        matches!(self, Self::Rotation | Self::First | Self::Second)
    }

    /// True if records are continued from place to place.
    pub fn translates(self) -> bool {
        matches!(self, Self::First | Self::Second | Self::Axes { .. })
    }

    /// True for quadratics along axes.
    pub fn has_axes(self) -> bool {
        matches!(self, Self::Axes { .. })
    }

    /// The share by which irradiance interpolated along an axis may err; 0 for any.
    pub fn axis_error(self) -> f32 {
        if let Self::Axes { error, .. } = self { error } else { 0.0 }
    }

    /// Light paths that are joined with each record of the first level.
    pub fn light_paths(self) -> u32 {
        if let Self::Axes { light_paths, .. } = self { light_paths } else { 0 }
    }
}

group! {
    /// How records that disagree where they overlap are made smaller.
    #[derive(Copy)]
    #[serde(default)]
    pub struct Refinement {
        /// Which of them: see [`Cache::refine`](super::Cache::refine).
        pub rule: RefinementRule,
        /// The smallest allowed error that refinement leaves a record.
        pub error_min: f32 = above(0.0, INFINITY),
        /// The smallest relative difference of luminance that refinement takes for visible.
        pub contrast: f32 = above(0.0, INFINITY),
    }
}

impl Default for Refinement {
    fn default() -> Self {
        Self { rule: RefinementRule::WeberNearest, error_min: 0.05, contrast: 0.02 }
    }
}

group! {
    /// Radiance records, which answer for glossy lobes that few bands of harmonics represent.
    #[derive(Copy)]
    #[serde(default)]
    pub struct Glossy {
        /// Most bands of harmonics. More would cost more than the paths they replace, and tables of
        /// tilts grow with the fifth power.
        pub order: u8 = within(1.0, 20.0),
        /// Levels of bounces that have radiance records, of those that have records at all: with 1
        /// the glossy surfaces that the camera sees, with 2 also those that light reaches these
        /// from, and so on. Paths follow the glossy lobes beyond.
        pub levels: u8 = within(1.0, 16.0),
        /// The basis. The metrics `first` and `second`, and `hits` that change, need `sh` or
        /// `sh-world`.
        pub basis: GlossyBasis,
        /// Largest share of a lobe's energy that its representation may lose [Krivanek05, Sec.
        /// 4.1]; a relative RMS error of e is e².
        pub loss: f32 = above(0.0, 0.999),
        /// Which bands of a lobe records have.
        pub bands: Bands,
        /// How the translational gradient is estimated. `boundary` needs strata `polar`;
        /// `per-sample` takes its place on others.
        pub gradient: RadianceGradient,
        /// Factor on `validity.error`.
        pub error: f32 = above(0.0, 100.0),
        /// Records answer only where that pays: for lobes of a fifth of the albedo or more beside a
        /// diffuse one, on flat surfaces, and for materials where they take the place of at least
        /// as many paths as 64 of them have rays. Paths follow the others.
        pub economy: bool,
        /// From which error areas follow. With `first` and `second` records answer for diffuse
        /// surfaces, too: all points that the camera sees have records of the full order.
        pub metric: GlossyMetric,
        /// What is known of the hits.
        pub hits: Hits,
        /// How numbers are kept.
        pub storage: Storage,
    }
}

impl Default for Glossy {
    fn default() -> Self {
        Self {
            order: 10,
            levels: 1,
            basis: GlossyBasis::Hsh,
            loss: 0.05,
            bands: Bands::Needed,
            gradient: RadianceGradient::Boundary,
            error: 1.0,
            economy: false,
            metric: GlossyMetric::Irradiance,
            hits: Hits::None,
            storage: Storage::F32,
        }
    }
}

impl Glossy {
    /// True if records answer for diffuse surfaces, too.
    pub fn whole(&self) -> bool {
        self.metric != GlossyMetric::Irradiance
    }

    /// Glossy lobes beside a diffuse one are cached where they are at least this share of the
    /// albedo.
    pub fn share(&self) -> f32 {
        if self.economy { 0.2 } else { 0.0 }
    }

    /// A material's lobes are cached if records take the place of at least as many paths as this
    /// many of them have rays.
    pub fn break_even(&self) -> f32 {
        if self.economy { 64.0 } else { 0.0 }
    }

    /// Highest order of lobes that are cached where the surface is curved: on curved walls of rough
    /// metal records have two thirds of the error of paths, for four times their time.
    pub fn curved_order(&self) -> u8 {
        if self.economy { 0 } else { 20 }
    }

    /// Density of the rays. Uniform rays sample the horizon better, which glossy lobes see; meshes
    /// over the hits want cells of equal weight.
    pub fn density(&self) -> Density {
        if self.gradient == RadianceGradient::Triangulated {
            Density::Cosine
        } else {
            Density::Uniform
        }
    }
}

group! {
    /// A cache of all light, direct light included, that surfaces behind the visible ones receive.
    /// Every traced ray ends there. In scenes of our own, and for light paths without a bound on
    /// their length, it takes the place of the deeper levels.
    #[derive(Copy)]
    #[serde(default)]
    pub struct RadiositySettings {
        /// Rays per record.
        pub rays: u32 = within(16.0, 1e6),
        /// Samples of light sources per record.
        pub lights: u32 = within(1.0, 1e6),
        /// Rays of each bounce that look for where records are needed. Surfaces that they do not
        /// meet get none: paths go on there.
        pub points: u32 = within(16.0, 1e7),
        /// The allowed error, a of [Ward88].
        pub error: f32 = above(0.0, 1.0),
        /// Smallest radius of validity as a share of the extent of what is lit.
        pub min_radius: f32 = above(0.0, 1.0),
    }
}

impl Default for RadiositySettings {
    fn default() -> Self {
        Self { rays: 100, lights: 32, points: 16384, error: 0.3, min_radius: 0.02 }
    }
}

group! {
    /// Every choice that makes one published caching scheme differ from another. Each setting can
    /// be given by its name: see [`Scheme::set_all`].
    pub struct Scheme {
        /// How records gather light.
        pub gather: Gather,
        /// The radius of validity and the area of records.
        pub radius: Radius,
        /// Where records are valid, and how they are weighed.
        pub validity: Validity,
        /// How records are continued.
        pub extrapolation: Extrapolation,
        /// How records are refined, if they are.
        #[serde(with = "set::optional")]
        pub refinement: Option<Refinement>,
        /// Radiance records, if there are any; otherwise paths follow all glossy lobes.
        #[serde(with = "set::optional")]
        pub glossy: Option<Glossy>,
        /// A cache of all light behind the visible surfaces, if there is one.
        #[serde(with = "set::optional")]
        pub radiosity: Option<RadiositySettings>,
        /// What bounds R_i beside the metric.
        pub clamping: Clamping,
        /// Which light records hold.
        pub contents: Contents,
        /// Levels with a cache of their own: 1 caches what the camera sees, 2 also the points that
        /// light reaches those from, and so on. Light from beyond is path traced.
        pub levels: u8 = within(1.0, 16.0),
        /// Order of the shading points, and the number of passes.
        pub schedule: Schedule,
    }
}

impl Describe for Extrapolation {
    fn describe(name: &str, _: &str, _: Option<table::Bounds>, table: &mut Vec<Setting>) {
        let kinds = [
            ("none", "Not at all."),
            ("rotation", "Irradiance by the rotation of the normal alone."),
            ("first", "By the gradients."),
            ("second", "By the gradients and the Hessian on the triangulated hemisphere [Zhao]."),
            ("axes", "By quadratics along eight axes [Ribardiere11]."),
        ];
        let words = kinds.map(|(word, doc)| (word.to_owned(), doc.to_owned())).to_vec();
        let number = |whole, bounds| Allowed::Number { whole, bounds };
        for (field, doc, allowed) in [
            ("kind", "How records are continued beyond their position.", Allowed::Words(words)),
            (
                "error",
                "An axis is shortened until irradiance interpolated along it errs by at most this \
                 share [Ribardiere11, Sec. 6]; 0 switches it off. Kind `axes` alone.",
                number(false, within(0.0, INFINITY)),
            ),
            (
                "light_paths",
                "Light paths that are joined with each record of the first level, beside its rays. \
                 Kind `axes` alone.",
                number(true, within(0.0, 1e6)),
            ),
        ] {
            table.push(Setting { name: format!("{name}.{field}"), doc: doc.to_owned(), allowed });
        }
    }
}

impl Scheme {
    /// The layout of a gather on `level`.
    pub fn layout(&self, level: u8) -> Layout {
        let Gather { rays, deeper_rays, strata, .. } = self.gather;
        let rays = (rays as f32 * deeper_rays.powi(i32::from(level))).round().max(16.0) as u32;
        match strata {
            // The 8 x 8 of scotty3d and other small squares are kept as they were published.
            Strata::Polar if rays == 64 => Layout::Polar { m: 8, n: 8 },
            Strata::Polar => Layout::polar(rays),
            Strata::Concentric => Layout::concentric(rays),
        }
    }

    /// The allowed error on `level` while it is being filled.
    pub fn error_at(&self, level: u8) -> f32 {
        self.validity.error * self.validity.deeper_error.powi(i32::from(level))
    }

    /// The smallest allowed error that refinement leaves a record.
    pub fn error_min(&self) -> f32 {
        self.refinement.unwrap_or_default().error_min
    }

    /// The power of the allowed error with which radii grow.
    pub fn radius_power(&self) -> f32 {
        match self.radius.metric {
            Metric::Harmonic
            | Metric::Minimum
            | Metric::MinimumRestricted
            | Metric::Gradient(Measure::Average) => 1.0,
            Metric::Gradient(Measure::Total) => 1.0 / 3.0,
            Metric::Hessian(Measure::Average) | Metric::UnoccludedHessian(Measure::Average) => 0.5,
            Metric::Hessian(Measure::Total) | Metric::UnoccludedHessian(Measure::Total) => 0.25,
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
        matches!(self.radius.metric, Metric::Hessian(_))
            || self.gather.gradient == TranslationalGradient::Triangulated
            || self.extrapolation == Extrapolation::Second
    }

    /// The settings of radiance records; their defaults where the scheme has none.
    pub fn glossy(&self) -> Glossy {
        self.glossy.unwrap_or_default()
    }

    /// True if radiance records answer for diffuse surfaces, too.
    pub fn whole(&self) -> bool {
        self.glossy.is_some_and(|g| g.whole())
    }

    /// Spends about `quality` times the work: as many more rays per record and, since the number of
    /// records grows with the inverse square of radii, a smaller error.
    pub fn scale_quality(&mut self, quality: f32) {
        let rays = &mut self.gather.rays;
        *rays = (*rays as f32 * quality.sqrt()).round().clamp(16.0, 1e6) as u32;
        self.validity.error *= quality.powf(-0.25 / self.radius_power());
        if let Some(radiosity) = &mut self.radiosity {
            let scaled =
                |n: u32, least| (n as f32 * quality.sqrt()).round().clamp(least, 1e6) as u32;
            radiosity.rays = scaled(radiosity.rays, 16.0);
            radiosity.points = scaled(radiosity.points, 1024.0);
        }
        // What a quadratic leaves out grows with the third power of its length.
        if let Extrapolation::Axes { error, .. } = &mut self.extrapolation {
            *error *= quality.powf(-0.75);
        }
    }

    /// Multiplies the allowed error by `factor`, and with it all else that says how careful the
    /// scheme is, so that one number leads from many records to few. Where records are refined
    /// `factor` is that of what is visible and of the smallest allowed error; that of the
    /// largest one is its root, or the radii would be large beyond reason before anything else
    /// gives way.
    pub fn scale_error(&mut self, factor: f32) {
        if let Some(refinement) = &mut self.refinement {
            self.validity.error *= factor.sqrt();
            refinement.error_min *= factor;
            refinement.contrast *= factor;
        } else {
            self.validity.error *= factor;
        }
        if let Extrapolation::Axes { error, .. } = &mut self.extrapolation {
            *error *= factor;
        }
    }
}
