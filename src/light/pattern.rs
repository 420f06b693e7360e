//! Emission that varies over a triangle.

use crate::math::{DMat2, DVec2, Vec2};
use crate::sampling::{hash, unit_f32};
use crate::texture::{SummedTable, Window, area, window_of};
use std::sync::Arc;

/// Most points that are drawn until one lies inside the triangle.
const TRIES: u32 = 64;
/// Part of the samples that ask where a triangle glows; the others ask how large its parts look.
const SHARE: f64 = 0.75;

/// How the emission of a textured triangle is spread over it: points are drawn in proportion to the
/// cells of a table that the triangles of a texture share.
///
/// A point is drawn in the rectangle around the triangle until it lies inside. So its density is
/// exactly that of the table over the triangle, and the chance that no try succeeds is known.
#[derive(Clone, Debug)]
pub struct Pattern {
    table: Arc<SummedTable<1>>,
    window: Window,
    corner: DVec2,
    edges: DMat2,
    to_weights: DMat2,
    /// One over the mean of the table over the triangle.
    scale: f64,
    /// Probability that a point is drawn by the table.
    share: f64,
}

impl Pattern {
    /// The pattern of a triangle with these corners, in the cells of `table` and in the order of
    /// the mesh, over which the table's integral is `integral`. `None` where the triangle has no
    /// area there or does not glow.
    pub fn new(table: Arc<SummedTable<1>>, corners: [DVec2; 3], integral: f64) -> Option<Self> {
        let [a, b, c] = corners;
        let window = window_of(corners);
        let around = table.sum(window);
        let edges = DMat2::from_cols(b - a, c - a);
        let to_weights = edges.inverse();
        let scale = area(&corners) / integral;
        let missed = (1.0 - integral / around).clamp(0.0, 1.0).powi(TRIES as i32);
        let share = SHARE * (1.0 - missed);
        (to_weights.is_finite() && scale.is_finite() && scale > 0.0 && share > 0.0)
            .then_some(Self { table, window, corner: a, edges, to_weights, scale, share })
    }

    /// The weights of the second and third vertex of a point drawn by the table; `None` for those
    /// that are to be drawn without it, as [`Pattern::share`] has it. `u` in [0, 1)².
    pub fn draw(&self, u: Vec2) -> Option<[f32; 2]> {
        let x = u.x / SHARE as f32;
        if x < 1.0 { self.inside(Vec2::new(x, u.y)) } else { None }
    }

    /// A point in proportion to the table; `None` where no try meets the triangle.
    pub fn inside(&self, mut u: Vec2) -> Option<[f32; 2]> {
        for _ in 0..TRIES {
            let weights = self.to_weights * (self.table.sample(self.window, u) - self.corner);
            if weights.min_element() >= 0.0 && weights.x + weights.y <= 1.0 {
                return Some(weights.as_vec2().to_array());
            }
            u = afresh(u);
        }
        None
    }

    /// Numbers for a point that [`Pattern::draw`] left to others.
    pub fn rest(u: Vec2) -> Vec2 {
        if u.x < SHARE as f32 {
            return afresh(Vec2::new(u.y, u.x));
        }
        Vec2::new(((u.x - SHARE as f32) / (1.0 - SHARE as f32)).min(1.0 - f32::EPSILON), u.y)
    }

    /// Probability that [`Pattern::draw`] draws a point.
    pub fn share(&self) -> f32 {
        self.share as f32
    }

    /// Density of the points of [`Pattern::draw`], as a multiple of the uniform one.
    pub fn density(&self, [beta, gamma]: [f32; 2]) -> f32 {
        let at = self.corner + self.edges * DVec2::new(f64::from(beta), f64::from(gamma));
        (self.table.value(at) * self.scale) as f32
    }

    /// Density of a point that is drawn uniformly where the table leaves it to others, as a
    /// multiple of the uniform one.
    pub fn mixed_density(&self, weights: [f32; 2]) -> f32 {
        let share = self.share();
        share * self.density(weights) + (1.0 - share)
    }
}

/// Other numbers in [0, 1)².
fn afresh(u: Vec2) -> Vec2 {
    let word = hash(&[u64::from(u.x.to_bits()), u64::from(u.y.to_bits())]);
    Vec2::new(unit_f32(word as u32), unit_f32((word >> 32) as u32))
}
