//! Light with extent from infinity: an environment map, and discs such as the sun's in front of it.

use super::environment::Environment;
use super::source::weight;
use crate::math::{Color, Frame, INV_PI, PI, Vec2, Vec3};

/// A disc in the sky of the same radiance all over.
#[derive(Clone, Copy, Debug)]
struct Disc {
    /// Unit direction to its centre.
    center: Vec3,
    radiance: Color,
    /// As sampling weighs colours, across the rays.
    irradiance: f32,
    sin_radius: f32,
    /// 1 - cos of the angular radius, which single precision keeps where the cosine does not.
    versine: f32,
}

impl Disc {
    /// True if a unit direction lies inside: the squared chord 2 - 2 cos is exact for small angles.
    fn holds(&self, direction: Vec3) -> bool {
        (direction - self.center).length_squared() <= 2.0 * self.versine
    }

    fn density(&self) -> f32 {
        0.5 * INV_PI / self.versine
    }

    /// Irradiance on a surface with normal `n`, or across the rays; positive while any part is
    /// above the horizon.
    fn importance(&self, n: Option<Vec3>) -> f32 {
        self.irradiance * n.map_or(1.0, |n| (n.dot(self.center) + self.sin_radius).clamp(0.0, 1.0))
    }

    fn sample(&self, u: Vec2) -> Vec3 {
        let below_one = u.y * self.versine;
        let sin = (below_one * (2.0 - below_one)).sqrt();
        let (s, c) = (2.0 * PI * u.x).sin_cos();
        Frame::from_normal(self.center).to_world(Vec3::new(sin * c, sin * s, 1.0 - below_one))
    }
}

/// All light with extent from infinity, sampled as one: by a mixture of the map's density and those
/// of the discs, in proportion to the irradiance that each sends to the receiver (for the map: its
/// mean over all orientations).
#[derive(Clone, Debug)]
pub(super) struct Distant {
    map: Option<Environment>,
    discs: Vec<Disc>,
    /// Mean irradiance from the map over all orientations.
    map_weight: f32,
    fluence: Color,
}

impl Distant {
    /// `None` without light. A disc is its centre, its irradiance across the rays and its angular
    /// radius.
    pub fn new(
        map: Option<Environment>, discs: impl Iterator<Item = (Vec3, Color, f32)>,
    ) -> Option<Self> {
        let discs: Vec<Disc> = discs
            .filter(|(_, irradiance, radius)| weight(*irradiance) > 0.0 && *radius > 0.0)
            .map(|(center, irradiance, radius)| {
                let sin_radius = radius.sin();
                let versine = 2.0 * (0.5 * radius).sin().powi(2);
                let radiance = irradiance / (PI * sin_radius * sin_radius);
                Disc { center, radiance, irradiance: weight(irradiance), sin_radius, versine }
            })
            .collect();
        if map.is_none() && discs.is_empty() {
            return None;
        }
        let map_fluence = map.as_ref().map_or(Color::ZERO, Environment::fluence);
        let fluence =
            map_fluence + discs.iter().map(|d| d.radiance * (2.0 * PI * d.versine)).sum::<Color>();
        Some(Self { map, discs, map_weight: 0.25 * weight(map_fluence), fluence })
    }

    /// Radiance seen along a unit world direction.
    pub fn radiance(&self, direction: Vec3) -> Color {
        let map = self.map.as_ref().map_or(Color::ZERO, |m| m.radiance(direction));
        map + self.discs.iter().filter(|d| d.holds(direction)).map(|d| d.radiance).sum::<Color>()
    }

    /// True if there is any disc.
    pub fn has_discs(&self) -> bool {
        !self.discs.is_empty()
    }

    /// The integral of the radiance over the sphere.
    pub fn fluence(&self) -> Color {
        self.fluence
    }

    /// An estimate of the irradiance at a surface with normal `n`, or at a point.
    pub fn importance(&self, n: Option<Vec3>) -> f32 {
        self.map_weight + self.discs.iter().map(|d| d.importance(n)).sum::<f32>()
    }

    /// A direction and its density per steradian. Positive only where something shines.
    pub fn sample(&self, n: Option<Vec3>, u: Vec2) -> (Vec3, f32) {
        let mut x = u.x * self.importance(n);
        for disc in &self.discs {
            let share = disc.importance(n);
            if x < share {
                let direction = disc.sample(Vec2::new((x / share).min(1.0 - f32::EPSILON), u.y));
                return (direction, self.pdf(n, direction));
            }
            x -= share;
        }
        match &self.map {
            Some(map) if self.discs.is_empty() => map.sample(n, u),
            Some(map) => {
                let (direction, _) = map.sample(
                    n,
                    Vec2::new((x / self.map_weight).clamp(0.0, 1.0 - f32::EPSILON), u.y),
                );
                (direction, self.pdf(n, direction))
            }
            // Rounding can leave a remainder; without a map and above the last disc there is
            // nothing.
            None => (Vec3::Y, 0.0),
        }
    }

    /// Density per steradian with which [`Distant::sample`] draws a direction.
    pub fn pdf(&self, n: Option<Vec3>, direction: Vec3) -> f32 {
        let total = self.importance(n);
        let map = self.map.as_ref().map_or(0.0, |m| self.map_weight * m.pdf(n, direction));
        let discs = self
            .discs
            .iter()
            .filter(|d| d.holds(direction))
            .map(|d| d.importance(n) * d.density())
            .sum::<f32>();
        if total > 0.0 { (map + discs) / total } else { 0.0 }
    }
}
