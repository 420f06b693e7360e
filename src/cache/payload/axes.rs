//! Irradiance along the eight axes of a record: quadratics through values that the record's own
//! samples give beside it, and the lengths up to which those are true [Ribardiere11].

use crate::cache::record::{AXES, Area, RadiusRule, SECTORS, sector};
use crate::cache::scheme::Scheme;
use crate::gather::{
    Arrival, DirectLight, HemisphereSamples, LightChoice, PointSources, RadianceProbe,
    irradiance_of,
};
use crate::geometry::SurfacePoint;
use crate::math::{Color, Vec2, Vec3, luminance};
use crate::sampling::{hash, stream};

/// The tilt of the normal up to which records are used, 20° [Ribardiere11, Sec. 5.3].
pub const MAX_TILT: f32 = 0.349_066;
/// An axis that errs too much is shortened to this share of its length.
const SHORTER: f32 = 0.75;
/// An axis is no longer than this multiple of the longer one beside it. What it covered beyond
/// would be a thorn: next to no area, but a line in the picture.
const SPIKE: f32 = 2.5;
/// Errors are relative to the irradiance and this share of the largest along the axis.
const DARK: f32 = 0.01;
/// Light samples for the direct light of a record.
const LIGHT_RAYS: u32 = 256;
/// Light samples for each place on its axes where direct light is asked for.
const AXIS_LIGHT_RAYS: u32 = 32;

/// The change of irradiance along something: `linear t + square t²`.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Quadratic {
    /// At first order.
    pub linear: Color,
    /// At second order.
    pub square: Color,
}

/// How the irradiance of one kind of light changes around a record.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Change {
    /// Along each axis; t is the distance over the length of the axis.
    pub travel: [Quadratic; SECTORS],
    /// With the normal tilted towards each axis; t is the angle over 20°.
    pub turn: [Quadratic; SECTORS],
}

/// Direct light at a record.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Direct {
    /// Its irradiance.
    pub irradiance: Color,
    /// How that changes.
    pub change: Change,
}

/// How irradiance goes on around a record, axis by axis.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Axes {
    /// Unit tangent of axis 0; axis k lies 45° k from it, counter-clockwise about the normal.
    pub axis: Vec3,
    /// Length of each axis, scene units.
    pub lengths: [f32; SECTORS],
    /// Indirect light.
    pub indirect: Change,
    /// Direct light, where records hold it.
    pub direct: Option<Direct>,
}

impl Quadratic {
    /// That has the values `half` at t = ½ and `full` at t = 1.
    fn through(half: Color, full: Color) -> Self {
        Self { linear: 4.0 * half - full, square: 2.0 * full - 4.0 * half }
    }

    #[inline]
    fn at(&self, t: f32) -> Color {
        t * (self.linear + t * self.square)
    }
}

/// Two neighbouring axes and the share of the second one; how far along them.
#[derive(Clone, Copy)]
struct Place {
    k: usize,
    share: f32,
    t: f32,
}

impl Place {
    #[inline]
    fn read(&self, of: &[Quadratic; SECTORS]) -> Color {
        let (a, b) = (of[self.k].at(self.t), of[(self.k + 1) % SECTORS].at(self.t));
        a + self.share * (b - a)
    }
}

impl Axes {
    /// The change of indirect irradiance from the record, whose normal is `normal`, to the place at
    /// `offset` with the normal `n`; and the irradiance of direct light there, if the record holds
    /// it.
    ///
    /// Changes are linear between neighbouring axes, by the share of the chord for places and by
    /// the angle for normals [Ribardiere11, Eq. 18-23]. The published sum of the translational and
    /// the rotational term contains the record's own irradiance twice.
    #[inline]
    pub fn at(&self, normal: Vec3, offset: Vec3, n: Vec3) -> (Color, Option<Color>) {
        let across = normal.cross(self.axis);
        let flat = Vec2::new(offset.dot(self.axis), offset.dot(across));
        let (k, share) = sector(&self.lengths, flat);
        let boundary =
            self.lengths[k] + share * (self.lengths[(k + 1) % SECTORS] - self.lengths[k]);
        let moved = Place { k, share, t: flat.length() / boundary };
        let lean = Vec2::new(n.dot(self.axis), n.dot(across));
        let sin = lean.length();
        // Below that rounding decides; flat surfaces are spared the work.
        let tilted = (sin > 1e-4).then(|| {
            let (k, share) = sector(&[1.0; SECTORS], lean);
            Place { k, share, t: sin.atan2(n.dot(normal)) / MAX_TILT }
        });
        let change = |c: &Change| {
            moved.read(&c.travel) + tilted.map_or(Color::ZERO, |place| place.read(&c.turn))
        };
        (
            change(&self.indirect),
            self.direct.as_ref().map(|d| (d.irradiance + change(&d.change)).max(Color::ZERO)),
        )
    }
}

/// What direct light sends to the surroundings of a gather.
pub struct DirectSamples<'a> {
    /// At the point of the gather, from many places.
    center: Vec<Arrival>,
    /// Fewer places, for other points.
    beside: Box<dyn DirectLight + 'a>,
}

impl<'a> DirectSamples<'a> {
    /// Light that `probe` knows of around `at`, where `samples` have been gathered.
    pub fn new(
        probe: &'a dyn RadianceProbe, at: &SurfacePoint, samples: &HemisphereSamples, seed: u64,
    ) -> Option<Self> {
        let bundle = samples.bundle();
        let choice = |samples: u32, number: u64| {
            let every = if number == 0 { 1 } else { (bundle.len() as u32 / samples).max(1) };
            let seed = hash(&[seed, stream::AXES, number]);
            LightChoice { samples, every, seen: number == 0, seed }
        };
        let mut center = Vec::new();
        probe.lights(at, bundle, choice(LIGHT_RAYS, 0))?.arriving(&[at.position], &mut center);
        Some(Self { center, beside: probe.lights(at, bundle, choice(AXIS_LIGHT_RAYS, 1))? })
    }
}

/// Fits the axes of one record.
struct Fit<'a> {
    at: &'a SurfacePoint,
    sources: PointSources<'a>,
    indirect: Color,
    direct: Option<&'a DirectSamples<'a>>,
    /// Direct irradiance at the record from the places that serve the axes.
    beside: Color,
}

/// Irradiance by indirect and by direct light.
#[derive(Clone, Copy, Default)]
struct Both([Color; 2]);

impl Both {
    fn luminance(&self) -> f32 {
        luminance(self.0[0] + self.0[1])
    }
}

impl Fit<'_> {
    /// Irradiance at the shares ¼, ½, ¾ and 1 of `length` along axis `k`; `end` if the last is
    /// known.
    fn along(&self, k: usize, length: f32, end: Option<Both>) -> [Both; 4] {
        let places = [0.25, 0.5, 0.75, 1.0].map(|share| share * length * AXES[k]);
        let new = &places[..if end.is_some() { 3 } else { 4 }];
        let mut out = [end.unwrap_or_default(); 4];
        for (out, d) in out.iter_mut().zip(new) {
            out.0 = [self.sources.irradiance_at(*d), Color::ZERO];
        }
        if let Some(direct) = self.direct {
            let frame = &self.at.frame;
            let points: Vec<Vec3> =
                new.iter().map(|d| self.at.position + d.x * frame.s + d.y * frame.t).collect();
            let mut arrivals = Vec::new();
            direct.beside.arriving(&points, &mut arrivals);
            for (out, arrivals) in out
                .iter_mut()
                .zip(arrivals.chunks((arrivals.len() / points.len()).max(1)).take(points.len()))
            {
                out.0[1] = irradiance_of(arrivals, frame.n);
            }
        }
        out
    }

    /// The quadratics through the values at ½ and 1, and the largest error of their sum at ¼ and ¾,
    /// relative to the irradiance there.
    fn quadratics(&self, values: &[Both; 4]) -> ([Quadratic; 2], f32) {
        let start = [self.indirect, self.beside];
        let fit: [Quadratic; 2] = std::array::from_fn(|i| {
            Quadratic::through(values[1].0[i] - start[i], values[3].0[i] - start[i])
        });
        let most =
            values.iter().map(Both::luminance).fold(luminance(start[0] + start[1]), f32::max);
        let error = |t: f32, value: &Both| {
            let guess = Both(std::array::from_fn(|i| start[i] + fit[i].at(t)));
            let scale = value.luminance() + DARK * most;
            if scale > 0.0 { (guess.luminance() - value.luminance()).abs() / scale } else { 0.0 }
        };
        (fit, error(0.25, &values[0]).max(error(0.75, &values[2])))
    }

    fn turns(&self) -> [[Quadratic; SECTORS]; 2] {
        let mut out = [[Quadratic::default(); SECTORS]; 2];
        let center = self.direct.map_or(&[][..], |d| &d.center);
        let frame = &self.at.frame;
        let upright = irradiance_of(center, frame.n);
        for (k, towards) in AXES[..SECTORS].iter().enumerate() {
            let [half, full] = [0.5 * MAX_TILT, MAX_TILT].map(|angle| {
                let normal = frame.to_world((angle.sin() * *towards).extend(angle.cos()));
                let indirect = self.sources.irradiance_tilted(*towards, angle) - self.indirect;
                [indirect, irradiance_of(center, normal) - upright]
            });
            (0..2).for_each(|i| out[i][k] = Quadratic::through(half[i], full[i]));
        }
        out
    }
}

/// The axes of the record of `samples` at `at`, whose lengths R_i are `shape`: each starts at the
/// radius that `rule` makes of its length and is shortened until its quadratic errs by no more
/// than the scheme's `axis_error`, or is as short as radii get. Returns the lengths R_i that this
/// leaves, too.
///
/// Published is to try a quarter and three quarters of an axis first and to go on with the values
/// that are there; after two steps the points tested are those that the quadratic goes through,
/// where it cannot err. Here the points tested are always new. A disc keeps its shape: it gets the
/// shortest of its axes.
pub(super) fn fit(
    scheme: &Scheme, rule: &RadiusRule, at: &SurfacePoint, samples: &HemisphereSamples,
    irradiance: Color, shape: Area, direct: Option<&DirectSamples>,
) -> (Axes, Area) {
    let mut beside = Vec::new();
    if let Some(direct) = direct {
        direct.beside.arriving(&[at.position], &mut beside);
    }
    let beside = irradiance_of(&beside, at.frame.n);
    let fit = Fit { at, sources: samples.point_sources(), indirect: irradiance, direct, beside };
    let shortest = rule.radius_filling(0.0, at.footprint);
    let mut change = [Change::default(); 2];
    let whole: [f32; SECTORS] = std::array::from_fn(|k| match shape {
        Area::Sectors { r, .. } => r[k],
        Area::Disc { r } | Area::Ellipse { r: [r, _], .. } => r,
    });
    let (mut lengths, mut left) = ([0.0; SECTORS], whole);
    for k in 0..SECTORS {
        lengths[k] = rule.radius_filling(whole[k], at.footprint);
        let mut end = None;
        let quadratics = loop {
            let values = fit.along(k, lengths[k], end);
            let (quadratics, error) = fit.quadratics(&values);
            if scheme.extrapolation.axis_error() <= 0.0
                || error <= scheme.extrapolation.axis_error()
            {
                break quadratics;
            }
            if lengths[k] <= shortest {
                // The end may lie behind a wall, in another light: better no change than a wrong
                // one.
                break [Quadratic::default(); 2];
            }
            // The new end was a point of the test.
            end = (SHORTER * lengths[k] > shortest).then_some(values[2]);
            lengths[k] = (SHORTER * lengths[k]).max(shortest);
            left[k] = rule.length_of(lengths[k]);
        };
        (0..2).for_each(|i| change[i].travel[k] = quadratics[i]);
    }
    let found = lengths;
    for k in 0..SECTORS {
        let most = SPIKE * found[(k + 1) % SECTORS].max(found[(k + SECTORS - 1) % SECTORS]);
        if found[k] > most {
            lengths[k] = most;
            left[k] = rule.length_of(most);
            let (quadratics, _) = fit.quadratics(&fit.along(k, most, None));
            (0..2).for_each(|i| change[i].travel[k] = quadratics[i]);
        }
    }
    let turns = fit.turns();
    (0..2).for_each(|i| change[i].turn = turns[i]);
    let shape = match shape {
        Area::Sectors { axis, .. } => Area::Sectors { axis, r: left },
        other => other.map(|r| left.into_iter().fold(r, f32::min)),
    };
    let center = direct.map(|d| irradiance_of(&d.center, at.frame.n));
    let [indirect, of_direct] = change;
    let direct = center.map(|irradiance| Direct { irradiance, change: of_direct });
    (Axes { axis: at.frame.s, lengths, indirect, direct }, shape)
}
