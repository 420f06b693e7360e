//! The area in which a record may be used: a disc, an ellipse, or eight sectors of their own
//! radius.

use crate::math::{Vec2, Vec3};
use std::f32::consts::{FRAC_1_SQRT_2, FRAC_PI_4};

/// Axes of [`Area::Sectors`].
pub const SECTORS: usize = 8;

/// Unit vectors at the azimuths 45° k; the ninth is the first again.
pub(in crate::cache) const AXES: [Vec2; SECTORS + 1] = [
    Vec2::X,
    Vec2::splat(FRAC_1_SQRT_2),
    Vec2::Y,
    Vec2::new(-FRAC_1_SQRT_2, FRAC_1_SQRT_2),
    Vec2::NEG_X,
    Vec2::splat(-FRAC_1_SQRT_2),
    Vec2::NEG_Y,
    Vec2::new(FRAC_1_SQRT_2, -FRAC_1_SQRT_2),
    Vec2::X,
];

/// The shape of a record's area around its normal, and its size along each axis.
///
/// The same type holds what a gather says of it, the lengths R_i before any limit
/// ([`Record::shape`](super::Record)), and the radii that follow from those
/// ([`RadiusRule::area`](super::RadiusRule::area)). World space, scene units.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Area {
    /// The same in all directions.
    Disc {
        /// Radius.
        r: f32,
    },
    /// Two axes at right angles.
    Ellipse {
        /// Unit tangent along the shorter axis; the other one is `normal × axis`.
        axis: Vec3,
        /// Semi-axes, the shorter one first.
        r: [f32; 2],
    },
    /// Eight axes; between two neighbouring ones the boundary runs as in [`Area::boundary`].
    Sectors {
        /// Unit tangent of axis 0; axis k lies 45° k from it, counter-clockwise about the normal.
        axis: Vec3,
        /// Radius along each axis.
        r: [f32; SECTORS],
    },
}

impl Area {
    /// The radii along its axes.
    pub fn radii(&self) -> &[f32] {
        match self {
            Self::Disc { r } => std::slice::from_ref(r),
            Self::Ellipse { r, .. } => r,
            Self::Sectors { r, .. } => r,
        }
    }

    /// The smallest radius.
    pub fn shortest(&self) -> f32 {
        self.radii().iter().copied().fold(f32::INFINITY, f32::min)
    }

    /// The largest radius: no point of the area is further away.
    pub fn longest(&self) -> f32 {
        self.radii().iter().copied().fold(0.0, f32::max)
    }

    /// The mean radius.
    pub fn mean(&self) -> f32 {
        self.radii().iter().sum::<f32>() / self.radii().len() as f32
    }

    /// The same shape with each radius `r` replaced by `f(r)`, which must not decrease with r.
    #[must_use]
    pub fn map(mut self, f: impl Fn(f32) -> f32) -> Self {
        match &mut self {
            Self::Disc { r } => *r = f(*r),
            Self::Ellipse { r, .. } => *r = r.map(f),
            Self::Sectors { r, .. } => *r = r.map(f),
        }
        self
    }

    /// Bounds each radius by `bound(Some(u))`, u being the unit tangent along its axis; a disc,
    /// which has no axes, by `bound(None)`.
    #[must_use]
    pub fn bounded(mut self, normal: Vec3, bound: impl Fn(Option<Vec3>) -> f32) -> Self {
        match &mut self {
            Self::Disc { r } => *r = r.min(bound(None)),
            Self::Ellipse { axis, r } => {
                r[0] = r[0].min(bound(Some(*axis)));
                r[1] = r[1].min(bound(Some(normal.cross(*axis))));
                if r[1] < r[0] {
                    (*axis, *r) = (normal.cross(*axis), [r[1], r[0]]);
                }
            }
            Self::Sectors { axis, r } => {
                let t = normal.cross(*axis);
                for (r, a) in r.iter_mut().zip(&AXES) {
                    *r = r.min(bound(Some(a.x * *axis + a.y * t)));
                }
            }
        }
        self
    }

    /// The distance of a point at `offset` from the record, as a share of the area's extent in its
    /// direction: below 1 inside.
    ///
    /// An ellipse measures `sqrt((d·v_1/r_1)² + (d·v_2/r_2)² + (d·n/r_1)²)` with r_1 the shorter
    /// semi-axis [Schwarzhaupt12]; sectors put the boundary radius in the place of
    /// the first two terms and the smallest radius in that of the third.
    #[inline]
    pub fn share(&self, normal: Vec3, offset: Vec3) -> f32 {
        match self {
            Self::Disc { r } => offset.length() / r,
            Self::Ellipse { axis, r } => {
                let (x, y, z) =
                    (offset.dot(*axis), offset.dot(normal.cross(*axis)), offset.dot(normal));
                ((x * x + z * z) / (r[0] * r[0]) + y * y / (r[1] * r[1])).sqrt()
            }
            Self::Sectors { axis, .. } => {
                let flat = Vec2::new(offset.dot(*axis), offset.dot(normal.cross(*axis)));
                let height = offset.dot(normal) / self.shortest();
                (flat.length_squared() / self.boundary(flat).powi(2) + height * height).sqrt()
            }
        }
    }

    /// The radius in the direction `v`, any length, in the plane of `axis` and `normal × axis`.
    ///
    /// Sectors: between the axes k and k + 1 the boundary is `(1-t) r_k + t r_{k+1}`, t being where
    /// the ray meets the chord between their ends [Ribardiere11, Eq. 10].
    #[inline]
    pub fn boundary(&self, v: Vec2) -> f32 {
        match self {
            Self::Disc { r } => *r,
            Self::Ellipse { r, .. } => {
                let length = v.length();
                if length > 0.0 { length / (v / Vec2::from(*r)).length() } else { r[0] }
            }
            Self::Sectors { r, .. } => {
                let (k, t) = sector(r, v);
                let (near, far) = (r[k], r[(k + 1) % SECTORS]);
                near + t * (far - near)
            }
        }
    }

    /// False only if no point within `radius` of the point at `offset` lies inside the area.
    pub fn may_reach(&self, normal: Vec3, offset: Vec3, radius: f32) -> bool {
        let Self::Sectors { axis, r } = self else {
            return offset.length() - radius <= self.longest();
        };
        let flat = Vec2::new(offset.dot(*axis), offset.dot(normal.cross(*axis)));
        let distance = flat.length();
        if offset.dot(normal).abs() - radius > self.shortest() {
            return false;
        }
        if distance <= radius {
            return true;
        }
        // The longest of the axes around the directions that the ball is seen in.
        let (middle, half) = (flat.to_angle() / FRAC_PI_4, (radius / distance).asin() / FRAC_PI_4);
        let (first, last) = ((middle - half).floor() as i32, (middle + half).ceil() as i32);
        let longest =
            (first..=last).map(|k| r[k.rem_euclid(SECTORS as i32) as usize]).fold(0.0, f32::max);
        distance - radius <= longest
    }

    /// The first tangent of the area; any one for a disc.
    pub fn axis(&self, normal: Vec3) -> Vec3 {
        match self {
            Self::Disc { .. } => normal.any_orthonormal_vector(),
            Self::Ellipse { axis, .. } | Self::Sectors { axis, .. } => *axis,
        }
    }

    /// `count` points of the boundary around `position`, in order.
    pub fn outline(
        &self, position: Vec3, normal: Vec3, count: usize,
    ) -> impl Iterator<Item = Vec3> {
        let (area, s) = (*self, self.axis(normal));
        let t = normal.cross(s);
        (0..count).map(move |k| {
            let (sin, cos) = (8.0 * FRAC_PI_4 * k as f32 / count as f32).sin_cos();
            position + area.boundary(Vec2::new(cos, sin)) * (cos * s + sin * t)
        })
    }
}

/// The axis k before the direction `v`, any length, in the plane of axes with the lengths `r`, and
/// where its ray meets the chord from the end of axis k to that of the next one, as a share of the
/// chord: `t = r_k sin ψ/(r_k sin ψ + r_{k+1} sin(45° - ψ))` with ψ measured from axis k.
#[inline]
pub(in crate::cache) fn sector(r: &[f32; SECTORS], v: Vec2) -> (usize, f32) {
    let steep = v.y.abs() > v.x.abs();
    let k = match (v.y >= 0.0, v.x >= 0.0) {
        (true, true) => usize::from(steep),
        (true, false) => 3 - usize::from(steep),
        (false, false) => 4 + usize::from(steep),
        (false, true) => 7 - usize::from(steep),
    };
    let (a, b) = (
        r[k] * AXES[k].perp_dot(v).max(0.0),
        r[(k + 1) % SECTORS] * v.perp_dot(AXES[k + 1]).max(0.0),
    );
    (k, if a + b > 0.0 { a / (a + b) } else { 0.0 })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sampling::Rng;

    fn shapes() -> [Area; 3] {
        [
            Area::Disc { r: 0.5 },
            Area::Ellipse { axis: Vec3::Y, r: [0.3, 0.8] },
            Area::Sectors { axis: Vec3::X, r: [0.3, 0.5, 0.8, 0.2, 0.4, 0.4, 0.9, 0.6] },
        ]
    }

    #[test]
    fn outlines_lie_where_the_share_is_one() {
        for shape in shapes() {
            for p in shape.outline(Vec3::ZERO, Vec3::Z, 37) {
                assert!((shape.share(Vec3::Z, p) - 1.0).abs() < 1e-5, "{shape:?} {p}");
                assert!(
                    p.length() <= shape.longest() * 1.00001
                        && p.length() >= shape.shortest() * 0.99999
                );
            }
        }
    }

    #[test]
    fn nothing_inside_is_further_away_than_the_longest_radius() {
        let mut rng = Rng::new(3);
        for shape in shapes() {
            for _ in 0..10_000 {
                let d = Vec3::from_array(std::array::from_fn(|_| 2.0 * rng.next_f32() - 1.0));
                let share = shape.share(Vec3::Z, d);
                assert!(share >= 0.9999 * d.length() / shape.longest(), "{shape:?} {d}");
                assert!((shape.share(Vec3::Z, 2.0 * d) - 2.0 * share).abs() < 1e-4 * share);
            }
        }
    }

    #[test]
    fn balls_that_meet_an_area_are_not_missed() {
        let mut rng = Rng::new(9);
        let mut missed = [0; 3];
        for (shape, missed) in shapes().iter().zip(&mut missed) {
            for _ in 0..20_000 {
                let d = Vec3::from_array(std::array::from_fn(|_| 3.0 * rng.next_f32() - 1.5));
                let radius = 0.4 * rng.next_f32();
                let near = d + radius
                    * rng.next_f32()
                    * Vec3::from_array(std::array::from_fn(|_| rng.next_f32() - 0.5)).normalize();
                let reached = shape.may_reach(Vec3::Z, d, radius);
                assert!(reached || shape.share(Vec3::Z, near) >= 0.9999, "{shape:?} {d} {radius}");
                *missed += usize::from(!reached && d.length() - radius < shape.longest());
            }
        }
        assert!(missed[0] == 0 && missed[2] > 1000, "{missed:?}");
    }

    #[test]
    fn equal_sectors_are_a_disc_and_axes_are_met_exactly() {
        let round = Area::Sectors { axis: Vec3::X, r: [0.7; SECTORS] };
        let Area::Sectors { r, .. } = shapes()[2] else { unreachable!() };
        for k in 0..360 {
            let (sin, cos) = (k as f32).to_radians().sin_cos();
            assert!((round.boundary(Vec2::new(cos, sin)) - 0.7).abs() < 1e-6);
            if k % 45 == 0 {
                assert!(
                    (shapes()[2].boundary(Vec2::new(cos, sin)) - r[k / 45]).abs() < 1e-5,
                    "{k}"
                );
            }
        }
        assert!(round.boundary(Vec2::ZERO) == 0.7);
    }

    #[test]
    fn bounds_act_along_the_axes() {
        // Nothing beyond 0.25 along x, 0.1 along y.
        let bound = |u: Option<Vec3>| match u {
            Some(u) if u.x.abs() > 0.9 => 0.25,
            Some(u) if u.y.abs() < 0.9 => f32::INFINITY,
            _ => 0.1,
        };
        let [disc, ellipse, sectors] = shapes().map(|s| s.bounded(Vec3::Z, bound));
        assert_eq!(disc, Area::Disc { r: 0.1 });
        // The axes change places: y is still the shorter one.
        assert_eq!(ellipse, Area::Ellipse { axis: Vec3::Y, r: [0.1, 0.25] });
        assert_eq!(sectors.radii(), [0.25, 0.5, 0.1, 0.2, 0.25, 0.4, 0.1, 0.6]);
        let swapped = shapes()[1]
            .bounded(Vec3::Z, |u| if u.unwrap().x.abs() > 0.9 { 0.2 } else { f32::INFINITY });
        assert_eq!(swapped, Area::Ellipse { axis: Vec3::NEG_X, r: [0.2, 0.3] });
    }
}
