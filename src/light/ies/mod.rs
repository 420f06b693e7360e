//! Light distributions measured on luminaires: IES files, evaluated and sampled.

mod parse;

pub use parse::{IesFault, Photometry};

use crate::math::{Vec2, Vec3};
use crate::sampling::sample_linear;
use parse::Content;
use std::f64::consts::PI;

/// The luminous intensity of a luminaire over direction, as an IES file (ANSI/IES LM-63 [LM63]) has
/// it.
///
/// In the profile's frame the light's zero, where both angles of the file are 0, is -Z, the
/// horizontal photometric plane of type C is XY and the vertical one of every type is XZ, as the
/// glTF extension EXT_lights_ies says. With V the vertical and H the horizontal angle,
///
/// ```text
/// type C   d = ( sin V cos H,  sin V sin H, -cos V)           H counter-clockwise as seen from +Z
/// type B   d = ( cos H sin V, -sin H,       -cos H cos V)     the polar axis is Y
/// type A   d = ( sin V,       -cos V sin H, -cos V cos H)     the polar axis is X
/// ```
///
/// Between the angles of the file the intensity is bilinear in them; outside their range it is
/// zero. Files that give part of a symmetric distribution are extended: type C with one plane in
/// all directions, from 0 to 90 in every quadrant, from 0 to 180 and from 90 to 270 about the plane
/// of these two; types A and B about the plane of the angle 0 where an angle begins at 0.
#[derive(Clone, Debug, PartialEq)]
pub struct IesProfile {
    photometry: Photometry,
    /// Directions of azimuth 0, azimuth 90 degrees and of the polar axis.
    axes: [Vec3; 3],
    /// Azimuth of each plane in radians, ascending, over at most a full turn.
    azimuth: Vec<f64>,
    /// Angle with the polar axis in radians, ascending.
    polar: Vec<f64>,
    /// Candela, plane by plane.
    candela: Vec<f32>,
    /// For each polar angle, the integral over azimuth.
    rows: Vec<f64>,
    /// Lumens between the first polar angle and each.
    sums: Vec<f64>,
    peak: f32,
    /// Angles in degrees and factors.
    tilt: Vec<(f64, f64)>,
}

impl IesProfile {
    /// Reads the bytes of an IES file of the editions 1986, 1991, 1995, 2002 and 2019. Candela are
    /// absolute: the values of the file times its multiplier, ballast factor and, up to 1995,
    /// ballast-lamp photometric factor. `tilt_file` gets the bytes of the file that a line
    /// TILT=NAME names, or says why it cannot.
    ///
    /// # Errors
    /// What is wrong and in which line.
    pub fn parse(
        bytes: &[u8], tilt_file: &dyn Fn(&str) -> Result<Vec<u8>, String>,
    ) -> Result<Self, IesFault> {
        parse::parse(bytes, tilt_file).map(Self::new)
    }

    fn new(content: Content) -> Self {
        let Content { photometry, vertical, horizontal, candela, tilt } = content;
        let rows = vertical.len();
        let read = |v: usize, h: usize| candela[h * rows + v];
        // Which angle turns about the polar axis, and from which end of the other one counts.
        let (axes, turning, leaning) = match photometry {
            Photometry::C => {
                ([Vec3::X, Vec3::Y, Vec3::NEG_Z], turned(&horizontal), ascending(&vertical))
            }
            Photometry::B => (
                [Vec3::NEG_Z, Vec3::X, Vec3::NEG_Y],
                mirrored(&vertical),
                descending(&mirrored(&horizontal)),
            ),
            Photometry::A => (
                [Vec3::NEG_Z, Vec3::NEG_Y, Vec3::X],
                mirrored(&horizontal),
                descending(&mirrored(&vertical)),
            ),
        };
        let value = |turn: usize, lean: usize| match photometry {
            Photometry::B => read(turn, lean),
            Photometry::A | Photometry::C => read(lean, turn),
        };
        let grid = turning
            .iter()
            .flat_map(|(_, t)| leaning.iter().map(|(_, l)| value(*t, *l) as f32))
            .collect();
        let radians = |knots: &[(f64, usize)]| {
            knots.iter().map(|(degrees, _)| degrees.to_radians()).collect()
        };
        let mut profile = Self {
            photometry,
            axes,
            azimuth: radians(&turning),
            polar: radians(&leaning),
            candela: grid,
            rows: Vec::new(),
            sums: vec![0.0],
            peak: candela.iter().fold(0.0, |m, &c| c.max(m)) as f32,
            tilt,
        };
        profile.integrate();
        profile
    }

    /// The sums for sampling: exact integrals of the bilinear intensity over solid angle.
    fn integrate(&mut self) {
        let cells = self.azimuth.len() - 1;
        let at = |i: usize, j: usize| f64::from(self.candela[i * self.polar.len() + j]);
        let row = |j| {
            (0..cells)
                .map(|i| 0.5 * (at(i, j) + at(i + 1, j)) * (self.azimuth[i + 1] - self.azimuth[i]))
                .sum()
        };
        self.rows = (0..self.polar.len()).map(row).collect();
        for band in 0..self.polar.len() - 1 {
            let total = self.sums[band] + self.band(band, self.polar[band + 1]).max(0.0);
            self.sums.push(total);
        }
    }

    /// The integral over a band between two polar angles, up to the angle `theta`: that of M(θ)
    /// sinθ, M linear from row to row.
    fn band(&self, band: usize, theta: f64) -> f64 {
        let (start, end) = (self.polar[band], self.polar[band + 1]);
        let slope = (self.rows[band + 1] - self.rows[band]) / (end - start);
        let value = self.rows[band] + slope * (theta - start);
        self.rows[band] * start.cos() - value * theta.cos() + slope * (theta.sin() - start.sin())
    }

    /// The type of photometry of the file.
    pub fn photometry(&self) -> Photometry {
        self.photometry
    }

    /// Luminous flux in lumens: the integral of the intensity over all directions.
    pub fn flux(&self) -> f32 {
        self.total() as f32
    }

    fn total(&self) -> f64 {
        self.sums[self.sums.len() - 1]
    }

    /// The largest intensity in candela.
    pub fn peak(&self) -> f32 {
        self.peak
    }

    /// The largest angle with the zero direction -Z, in radians, at which there may be light.
    pub fn reach(&self) -> f32 {
        match self.photometry {
            Photometry::C => {
                let dark = |j: &usize| self.rows[*j] <= 0.0;
                let last = self.rows.len() - (0..self.rows.len()).rev().take_while(dark).count();
                self.polar[last.min(self.polar.len() - 1)] as f32
            }
            Photometry::A | Photometry::B => std::f32::consts::FRAC_PI_2,
        }
    }

    /// The factor on the light of a luminaire whose zero direction is tilted from straight down by
    /// `radians`: 1 unless the file has a TILT section.
    pub fn tilt_factor(&self, radians: f32) -> f32 {
        let angle = f64::from(radians).to_degrees();
        let next = self.tilt.partition_point(|(a, _)| *a <= angle);
        let factor = match (next.checked_sub(1).map(|i| self.tilt[i]), self.tilt.get(next)) {
            (Some(a), Some(b)) => a.1 + (b.1 - a.1) * (angle - a.0) / (b.0 - a.0),
            (Some(end), None) => end.1,
            (None, Some(end)) => end.1,
            (None, None) => 1.0,
        };
        factor as f32
    }

    /// The cell that holds a unit direction, and where in it: plane and row below, and the
    /// fractions towards the next.
    fn locate(&self, direction: Vec3) -> Option<([usize; 2], [f64; 2])> {
        let [x, y, z] = self.axes.map(|axis| f64::from(direction.dot(axis)));
        let theta = x.hypot(y).atan2(z);
        let first = self.azimuth[0];
        let azimuth = first + (y.atan2(x) - first).rem_euclid(2.0 * PI);
        let find = |knots: &[f64], angle: f64, slack: f64| {
            let last = knots.len() - 1;
            (angle >= knots[0] - slack && angle <= knots[last] + slack).then(|| {
                let i = knots.partition_point(|k| *k <= angle).clamp(1, last) - 1;
                (i, ((angle - knots[i]) / (knots[i + 1] - knots[i])).clamp(0.0, 1.0))
            })
        };
        let (i, fi) = find(&self.azimuth, azimuth, 1e-9)?;
        // Single precision directions round by about 1e-7, and the last angle belongs to the light.
        let (j, fj) = find(&self.polar, theta, 1e-6)?;
        Some(([i, j], [fi, fj]))
    }

    fn interpolate(&self, [i, j]: [usize; 2], [fi, fj]: [f64; 2]) -> f64 {
        let at = |i: usize, j: usize| f64::from(self.candela[i * self.polar.len() + j]);
        let lerp = |a: f64, b: f64, t: f64| a + (b - a) * t;
        lerp(lerp(at(i, j), at(i, j + 1), fj), lerp(at(i + 1, j), at(i + 1, j + 1), fj), fi)
    }

    /// Luminous intensity in candela along a unit direction of the profile's frame.
    pub fn intensity(&self, direction: Vec3) -> f32 {
        self.locate(direction).map_or(0.0, |(cell, place)| self.interpolate(cell, place) as f32)
    }

    /// Density per steradian with which [`IesProfile::sample`] draws a unit direction: exactly the
    /// intensity over the flux.
    pub fn pdf(&self, direction: Vec3) -> f32 {
        if self.total() > 0.0 { self.intensity(direction) / self.flux() } else { 0.0 }
    }

    /// A direction of the profile's frame drawn in proportion to the intensity; `u` in [0, 1)².
    /// `None` for a profile without light.
    pub fn sample(&self, u: Vec2) -> Option<Vec3> {
        if self.total() <= 0.0 {
            return None;
        }
        // The polar angle by its marginal density: find the band, then solve within it.
        let target = f64::from(u.y) * self.total();
        let band = self.sums.partition_point(|s| *s <= target).clamp(1, self.sums.len() - 1) - 1;
        let theta = self.solve(band, target - self.sums[band]);
        // The azimuth by the interpolated row: the density is linear from plane to plane.
        let t = (theta - self.polar[band]) / (self.polar[band + 1] - self.polar[band]);
        let value = |i: usize| {
            self.interpolate(
                [i.min(self.azimuth.len() - 2), band],
                [if i + 1 == self.azimuth.len() { 1.0 } else { 0.0 }, t],
            )
        };
        let row = self.rows[band] + (self.rows[band + 1] - self.rows[band]) * t;
        let mut left = f64::from(u.x) * row;
        let last = self.azimuth.len() - 2;
        let (mut i, mut a) = (0, value(0));
        loop {
            let (b, width) = (value(i + 1), self.azimuth[i + 1] - self.azimuth[i]);
            let mass = 0.5 * (a + b) * width;
            if (left < mass && mass > 0.0) || i == last {
                let f = f64::from(sample_linear((left / mass) as f32, a as f32, b as f32));
                return Some(self.direction(self.azimuth[i] + f * width, theta));
            }
            (left, a, i) = (left - mass, b, i + 1);
        }
    }

    /// The polar angle up to which a band holds `target` lumens, by Newton's method between bounds.
    fn solve(&self, band: usize, target: f64) -> f64 {
        let (mut low, mut high) = (self.polar[band], self.polar[band + 1]);
        let slope = (self.rows[band + 1] - self.rows[band]) / (high - low);
        let (start, first) = (low, self.rows[band]);
        let mut theta = 0.5 * (low + high);
        for _ in 0..48 {
            let error = self.band(band, theta) - target;
            if error > 0.0 {
                high = theta
            } else {
                low = theta
            }
            let newton = theta - error / ((first + slope * (theta - start)) * theta.sin());
            let next = if newton > low && newton < high { newton } else { 0.5 * (low + high) };
            if (next - theta).abs() < 1e-12 {
                return next;
            }
            theta = next;
        }
        theta
    }

    fn direction(&self, azimuth: f64, theta: f64) -> Vec3 {
        let ((sin_a, cos_a), (sin_t, cos_t)) = (azimuth.sin_cos(), theta.sin_cos());
        let [x, y, z] = [sin_t * cos_a, sin_t * sin_a, cos_t].map(|c| c as f32);
        self.axes[0] * x + self.axes[1] * y + self.axes[2] * z
    }
}

/// Angles with the places of their values in the file.
type Knots = Vec<(f64, usize)>;

fn ascending(angles: &[f64]) -> Knots {
    angles.iter().copied().zip(0..).collect()
}

/// 90 degrees minus each angle: the distance from the pole on the side of positive angles.
fn descending(knots: &Knots) -> Knots {
    knots.iter().rev().map(|(angle, i)| (90.0 - angle, *i)).collect()
}

/// Angles from 0 on are those of both sides.
fn mirrored(angles: &[f64]) -> Knots {
    let side = ascending(angles);
    if angles[0] != 0.0 {
        return side;
    }
    side.iter().skip(1).rev().map(|(angle, i)| (-angle, *i)).chain(side.iter().copied()).collect()
}

/// The planes of type C all around.
fn turned(angles: &[f64]) -> Knots {
    let (first, last) = (angles[0], angles[angles.len() - 1]);
    let mut knots = ascending(angles);
    if knots.len() == 1 {
        return vec![(0.0, 0), (360.0, 0)];
    }
    // Each mirror plane stands at the end of what there is so far.
    let reflect = |knots: &mut Knots| {
        let end = knots[knots.len() - 1].0;
        let image: Vec<_> =
            knots.iter().rev().skip(1).map(|(angle, i)| (2.0 * end - angle, *i)).collect();
        knots.extend(image);
    };
    if last == 90.0 {
        reflect(&mut knots);
    }
    if last <= 180.0 || first == 90.0 {
        reflect(&mut knots);
    } else if last < 360.0 {
        knots.push((360.0, 0));
    }
    knots
}
