//! Directions drawn from the lobes of a surface.

use crate::math::{Color, Vec3};

/// Which kind of lobe a direction was drawn from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Lobe {
    /// Lambert's.
    Diffuse,
    /// A lobe of finite width.
    Glossy,
    /// A single direction.
    Delta,
}

/// A direction drawn by [`super::Bsdf::sample`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BsdfSample {
    /// Unit direction, local frame, away from the surface.
    pub wi: Vec3,
    /// `f(wo, wi) |cosθ_i| / pdf` with all lobes of finite width in both `f` and `pdf`; for a
    /// delta lobe its share of the light over the probability of choosing it.
    pub weight: Color,
    /// Density per steradian; infinite for a delta direction.
    pub pdf: f32,
    /// The lobe that drew the direction.
    pub lobe: Lobe,
    /// True if `wi` is on the other side of the surface.
    pub transmitted: bool,
    /// Index of refraction of the far side over that of `wo`'s side if the light was refracted,
    /// else 1. Radiance was scaled by `1/eta²`: Russian roulette should look at the throughput
    /// times the product of `eta²`.
    pub eta: f32,
}

/// What a surface does as an ideal pane to light along one line: see [`super::Bsdf::pane`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pane {
    /// Unit direction, local frame, from which the light comes on the other side.
    pub wi: Vec3,
    /// Share of the light that is passed, without the factor `1/η²` of refraction.
    pub passed: Color,
    /// Share of the light along `wo` that goes back by ideal reflection.
    pub reflected: Color,
    /// Index of refraction of the far side over the near side, 1 where nothing is bent.
    pub eta: f32,
}

/// Mean of the channels, the weight by which lobes are chosen.
#[inline]
pub(super) fn mean(c: Color) -> f32 {
    (c.x + c.y + c.z) * (1.0 / 3.0)
}
