//! The words of caching schemes.

use crate::basis::BasisKind;
use crate::gather::HitChange;
use crate::words::words;

words! {
    /// Which kind of strata a gather has.
    pub enum Strata {
        /// Rings and sectors.
        Polar = "polar",
        /// Concentric squares.
        Concentric = "concentric",
    }
}

words! {
    /// The length R_i from which a record's radius of validity is made.
    pub enum Metric {
        /// Harmonic mean of the distances [Ward88].
        Harmonic = "harmonic",
        /// Smallest distance.
        Minimum = "minimum",
        /// Smallest distance over the rays more than 10° above the tangent plane [Tabellion04].
        MinimumRestricted = "minimum-restricted",
        /// From the gradient of irradiance: the error of using a record's value unchanged.
        Gradient(Measure) = "gradient",
        /// From the Hessian of irradiance on the triangulated hemisphere, which knows of occlusion:
        /// the error of using a record with its gradient [Schwarzhaupt12].
        Hessian(Measure) = "hessian",
        /// From the Hessian by which all that a gather sees stays visible [Jarosz12].
        UnoccludedHessian(Measure) = "unoccluded-hessian",
    }
}

impl Metric {
    /// True if R_i is a distance to the surroundings, false if it comes from an estimate of the
    /// error.
    pub fn is_distance(self) -> bool {
        matches!(self, Self::Harmonic | Self::Minimum | Self::MinimumRestricted)
    }

    /// What a metric that estimates an error bounds; the average for those that are distances.
    pub fn measure(self) -> Measure {
        match self {
            Self::Gradient(m) | Self::Hessian(m) | Self::UnoccludedHessian(m) => m,
            Self::Harmonic | Self::Minimum | Self::MinimumRestricted => Measure::Average,
        }
    }
}

words! {
    /// Which error is bounded by metrics that estimate one; both are relative to the irradiance at
    /// the record.
    pub enum Measure {
        /// The integral over the record's area is bounded, as a share of irradiance times the
        /// square of the extent of what is lit [Schwarzhaupt12]. Small areas may err more.
        Total = "total",
        /// The mean over the record's area is bounded, as a share of irradiance.
        Average = "average",
    }
}

words! {
    /// What outline the areas of records have.
    pub enum Outline {
        /// Discs.
        Disc = "disc",
        /// Ellipses whose aspect is the fourth root of the eigenvalues' ratio [Schwarzhaupt12].
        Ellipse = "ellipse",
        /// Ellipses whose aspect is the square root of it: the largest for a given error.
        OptimalEllipse = "optimal-ellipse",
        /// Eight radii, each from the curvature of irradiance in its sector.
        Sectors = "sectors",
    }
}

words! {
    /// How the error of using a record elsewhere is estimated.
    pub enum Kernel {
        /// `|x - x_i|/R_i + sqrt(1 - n·n_i)`, valid below `error` [Ward88].
        Ward = "ward",
        /// `max(|x - x_i|/(R_i/2), sqrt(1 - n·n_i)/sqrt(1 - cos α))`, valid below `error`, with α
        /// the limit of the normals, published as 10° [Tabellion04, Eq. 3-5].
        Tabellion = "tabellion",
        /// `1 - (1 - t)(1 - ν)`, t being the position as a share of the record's extent and
        /// `ν = (1 - n·n_i)/(1 - cos α)` with α the limit of the normals, published as 0.2 rad,
        /// valid below 1 [Schwarzhaupt12].
        Schwarzhaupt = "schwarzhaupt",
        /// `1 - (1 - z)(1 - β/α)`, z being the position as a share of the record's extent, β the
        /// angle between the normals and α its limit, published as 20°, valid below 1. The
        /// published weight has `1/z - 1` in the place of `1 - z` [Ribardiere11, Eq. 25], which is
        /// infinite at the record; both are zero where it ends.
        Ribardiere = "ribardiere",
    }
}

words! {
    /// How valid records are weighed, as a function of e, their error as a share of the allowed
    /// one.
    pub enum Weight {
        /// `1/e` [Ward88]: jumps where a record ends.
        Inverse = "inverse",
        /// `1/e - 1`: continuous where a record ends.
        InverseMinusOne = "inverse-minus-one",
        /// `1 - e`: continuous and bounded.
        Hat = "hat",
    }
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

words! {
    /// What bounds R_i beside the metric.
    pub enum Clamping {
        /// Nothing.
        None = "none",
        /// `E/|∇E|` bounds R_i [Krivanek06, Eq. 2], `E/|∇E·v|` the radius along an axis v.
        Gradient = "gradient",
        /// `R_j + |x_i - x_j|` bounds R_i for all records j [Krivanek06, Sec. 5.3].
        Neighbours = "neighbours",
        /// Both do.
        Both = "both",
    }
}

impl Clamping {
    /// True if the gradient bounds R_i.
    pub fn gradient(self) -> bool {
        matches!(self, Self::Gradient | Self::Both)
    }

    /// True if the neighbours bound R_i.
    pub fn neighbours(self) -> bool {
        matches!(self, Self::Neighbours | Self::Both)
    }
}

words! {
    /// Which records refinement makes smaller until no edge of a record's area on the first level
    /// is visible by the law of Weber, against the direct light [Krivanek06].
    pub enum RefinementRule {
        /// Those that differ from the others, as published. A record that alone differs is the
        /// nearest one wherever farther ones reach over its place: good records shrink, bad ones
        /// stay.
        Weber = "weber",
        /// The same, but the record that weighs most at a point is never kept from it.
        WeberNearest = "weber-nearest",
    }
}

words! {
    /// Which light records hold.
    pub enum Contents {
        /// Indirect light.
        Indirect = "indirect",
        /// Those of the first level hold direct light, too: no shadow rays are traced where they
        /// are used.
        DirectAndIndirect = "direct-and-indirect",
    }
}

words! {
    /// In which order the shading points of the image are visited, and in how many passes.
    pub enum Schedule {
        /// Row by row, in one pass: each point is shaded by the records that exist when its round
        /// ends.
        OnePass = "one-pass",
        /// Row by row. The cache is filled first; then everything is shaded by it.
        Scanline = "scanline",
        /// A coarse grid of pixels first, then ever finer ones.
        CoarseToFine = "coarse-to-fine",
        /// Scattered over the whole image from the start.
        Scattered = "scattered",
    }
}

impl Schedule {
    /// True if points are visited row by row.
    pub fn is_by_row(self) -> bool {
        matches!(self, Self::OnePass | Self::Scanline)
    }
}

words! {
    /// The basis of radiance records.
    pub enum GlossyBasis {
        /// Hemispherical harmonics in local frames: best on flat surfaces.
        Hsh = "hsh",
        /// Spherical harmonics in the frame of the surface: nothing is turned on flat surfaces,
        /// elsewhere the lobe for each record.
        Sh = "sh",
        /// Spherical harmonics in the world's frame: the lobe is turned once, and records when they
        /// are made.
        ShWorld = "sh-world",
    }
}

impl GlossyBasis {
    /// The functions.
    pub fn kind(self) -> BasisKind {
        match self {
            Self::Hsh => BasisKind::Hsh,
            Self::Sh | Self::ShWorld => BasisKind::Sh,
        }
    }
}

words! {
    /// Which bands of a lobe radiance records have, and so which lobes they answer for.
    pub enum Bands {
        /// As many as their surface needs at most, to lose no more than `loss` of any lobe's
        /// energy; where `order` is not enough, paths follow the lobe.
        Needed = "needed",
        /// As many as the point needs where the record was made; further ones count as zero
        /// [Krivanek05].
        Padded = "padded",
        /// All of them, for any lobe, whatever it loses: sharp lobes are blurred.
        All = "all",
    }
}

words! {
    /// From which error the areas of radiance records follow.
    pub enum GlossyMetric {
        /// The areas are those of irradiance records.
        Irradiance = "irradiance",
        /// The error of using coefficients unchanged [Zhao, Eq. 3.26].
        First(Placement) = "first",
        /// The error of using coefficients with their gradients [Zhao, Eq. 3.29].
        Second(Placement) = "second",
    }
}

impl GlossyMetric {
    /// Of what the error is.
    pub fn placement(self) -> Placement {
        match self {
            Self::Irradiance => Placement::Incoming,
            Self::First(placement) | Self::Second(placement) => placement,
        }
    }
}

words! {
    /// Of what [`GlossyMetric`] takes the error.
    pub enum Placement {
        /// It is that of incident radiance.
        Incoming = "incoming",
        /// It is that of outgoing radiance in all directions [Zhao, Sec. 3.7.1].
        Outgoing = "outgoing",
        /// It is that of outgoing radiance towards the viewer [Zhao, Sec. 3.7.2].
        View = "view",
    }
}

words! {
    /// What radiance records know of their hits. A glossy hit looks different from beside the
    /// record [Zhao, Sec. 3.8].
    pub enum Hits {
        /// Nothing: a hit sends the same radiance to all places.
        None = "none",
        /// How their light changes beside the record, by evaluating again the reflection of what
        /// was traced.
        Frozen = "frozen",
        /// The same, by the derivative of the lobe where the hit is a Phong lobe [Zhao, Eq. 3.45].
        Analytic = "analytic",
        /// The same, by the lobes of the hit as harmonics represent them [Zhao, Eq. 3.46-3.47]: as
        /// smooth as the record.
        Harmonics = "harmonics",
        /// All of them, and glossy surfaces reflect the hits in the place of harmonics: a slow
        /// reference. Each hit sends the same radiance to all places.
        Stored = "stored",
        /// The same, but the light that leaves each hit is traced anew [Zhao, Sec. 3.8.1].
        Retraced = "retraced",
    }
}

impl Hits {
    /// How gathers find the change of the light from a hit.
    pub fn change(self) -> HitChange {
        match self {
            Self::None | Self::Stored | Self::Retraced => HitChange::None,
            Self::Frozen => HitChange::Frozen,
            Self::Analytic => HitChange::Analytic,
            Self::Harmonics => HitChange::Harmonics,
        }
    }

    /// True if records keep their hits, for comparison: 40 bytes for each ray, and every lookup
    /// reflects them one by one.
    pub fn are_kept(self) -> bool {
        matches!(self, Self::Stored | Self::Retraced)
    }
}

words! {
    /// How the numbers of radiance records are kept.
    pub enum Storage {
        /// 32 bits each.
        F32 = "f32",
        /// 16 bits each, with a scale for each vector: an error of 0.05 % of each number, or of
        /// 6e-8 of the largest of its vector.
        F16 = "f16",
    }
}
