//! One family of lobes in harmonics, for every outgoing direction.

use super::quadrature::{Row, rows};
use crate::basis::{Basis, index, triangle};
use crate::math::{Color, Vec2, Vec3, cell};
use rayon::prelude::*;
use std::f64::consts::{PI, TAU};

/// Up to three functions of two directions, which a surface adds up with factors of its own.
pub struct Lobe<'a> {
    /// `f(wo, wi)` of each part, without the cosine; both directions are above the surface. For an
    /// ordinary BRDF the parts are the three channels.
    pub f: &'a (dyn Fn(Vec3, Vec3) -> [f32; 3] + Sync),
    /// How many parts there are.
    pub parts: usize,
    /// `f` depends on the difference of the azimuths alone, and is even in it.
    pub isotropic: bool,
}

/// Nodes along tan(θ_o/2) of an isotropic lobe.
const NODES: usize = 48;
/// Nodes along each side of the square around the parabolic map of an anisotropic one.
const SIDE: usize = 32;
/// Nodes of the quadrature over `wi`, in cosine and over half a turn.
const QUADRATURE: (usize, usize) = (64, 64);
/// Least cosine of `wo`.
const MIN_COS: f32 = 1e-3;

/// The coefficients of a lobe times cos θ_i,
///
/// ```text
/// c_i(wo) = ∫ f(wo, wi) cos θ_i B_i(wi) dwi     [Krivanek05, Eq. 3, whose f includes the cosine]
/// ```
///
/// at nodes of the parabolic map `(x, y)/(1 + z)` of `wo`, interpolated between them, and the
/// energy `∫ (f cos θ_i)² dwi` that the bands from each order on hold: with order n, `1 - Σ_{l<n}
/// c_lm² / ∫ (f cos θ_i)² dwi` of the energy is lost [Ramamoorthi02].
///
/// An isotropic lobe is tabulated at azimuth 0, where the coefficients of negative m vanish, and
/// turned about the normal afterwards.
#[derive(Clone, Debug, PartialEq)]
pub struct LobeTable {
    pub(super) order: usize,
    pub(super) parts: usize,
    pub(super) isotropic: bool,
    /// For each node and each order from 0, which loses everything, to the highest the lost
    /// energy, as a quadratic form of the factors of the parts.
    pub(super) lost: Vec<f32>,
    /// For each node and each part the coefficients.
    pub(super) coefficients: Vec<f32>,
}

/// Nodes around a direction with their weights.
type Nodes = [(usize, f32); 4];

impl LobeTable {
    /// Tabulates `lobe` in `basis`.
    pub fn build(lobe: &Lobe, basis: &dyn Basis) -> Self {
        let quadrature = Quadrature::new(basis, lobe.isotropic);
        let directions: Vec<Option<Vec3>> = if lobe.isotropic {
            (0..NODES)
                .map(|i| Some(from_map(Vec2::new(i as f32 / (NODES - 1) as f32, 0.0))))
                .collect()
        } else {
            let place = |i: usize| 2.0 * i as f32 / (SIDE - 1) as f32 - 1.0;
            let diagonal = 2.0 * std::f32::consts::SQRT_2 / (SIDE - 1) as f32;
            // Nodes outside the disc stand for its rim, if their cell touches it.
            let node = |k: usize| Vec2::new(place(k % SIDE), place(k / SIDE));
            (0..SIDE * SIDE)
                .map(|k| {
                    (node(k).length() < 1.0 + diagonal)
                        .then(|| from_map(node(k).clamp_length_max(1.0)))
                })
                .collect()
        };
        let stride = Self::stride(basis.order(), lobe.isotropic, lobe.parts);
        let levels = Self::levels(basis.order(), lobe.parts);
        let rows: Vec<(Vec<f32>, Vec<f32>)> = directions
            .into_par_iter()
            .map(|wo| {
                wo.map_or_else(
                    || (vec![0.0; levels], vec![0.0; stride]),
                    |wo| quadrature.project(lobe, basis, wo),
                )
            })
            .collect();
        let (lost, coefficients): (Vec<_>, Vec<_>) = rows.into_iter().unzip();
        Self {
            order: basis.order(),
            parts: lobe.parts,
            isotropic: lobe.isotropic,
            lost: lost.concat(),
            coefficients: coefficients.concat(),
        }
    }

    /// Number of nodes of a table.
    pub(super) fn node_count(isotropic: bool) -> usize {
        if isotropic { NODES } else { SIDE * SIDE }
    }

    /// Numbers of lost energies per node.
    pub(super) fn levels(order: usize, parts: usize) -> usize {
        (order + 1) * forms(parts)
    }

    /// Coefficients per node.
    pub(super) fn stride(order: usize, isotropic: bool, parts: usize) -> usize {
        parts * if isotropic { triangle(order, 0) } else { order * order }
    }

    /// The nodes around `wo` in the map.
    fn nodes(&self, wo: Vec3) -> Nodes {
        let p = Vec2::new(wo.x, wo.y) / (1.0 + wo.z.max(0.0));
        if self.isotropic {
            let (i, t) = cell(p.length().min(1.0), NODES);
            return [(i, 1.0 - t), (i + 1, t), (i, 0.0), (i, 0.0)];
        }
        let ((i, s), (j, t)) = (cell(0.5 * (p.x + 1.0), SIDE), cell(0.5 * (p.y + 1.0), SIDE));
        let k = j * SIDE + i;
        [
            (k, (1.0 - s) * (1.0 - t)),
            (k + 1, s * (1.0 - t)),
            (k + SIDE, (1.0 - s) * t),
            (k + SIDE + 1, s * t),
        ]
    }

    /// The lowest order that loses no more than the share `loss` of the energy for `wo` in any
    /// channel, each part times its tint; `None` if the highest loses more: the lobe is of *high
    /// frequency* there.
    ///
    /// A share e² is a relative RMS error of e.
    pub fn needed_order(&self, wo: Vec3, tints: &[Color; 3], loss: f32) -> Option<usize> {
        let near = self.nodes(wo).into_iter().filter(|n| n.1 > 0.0);
        near.map(|(node, _)| self.order_at(node, tints, loss))
            .try_fold(1, |most, order| Some(most.max(order?)))
    }

    /// The highest order that any direction needs, of those that are of no high frequency; 0 if
    /// there is none.
    pub fn largest_order(&self, tints: &[Color; 3], loss: f32) -> usize {
        (0..Self::node_count(self.isotropic))
            .filter_map(|node| self.order_at(node, tints, loss))
            .max()
            .unwrap_or(0)
    }

    fn order_at(&self, node: usize, tints: &[Color; 3], loss: f32) -> Option<usize> {
        let size = forms(self.parts);
        let lost = &self.lost[node * Self::levels(self.order, self.parts)..];
        let form = |order: usize, channel: usize| {
            let mut sum = 0.0;
            let mut form = lost[order * size..].iter();
            for p in 0..self.parts {
                for q in 0..=p {
                    sum += tints[p][channel]
                        * tints[q][channel]
                        * form.next().expect("a number for each pair");
                }
            }
            sum
        };
        (0..3).try_fold(1, |most, channel| {
            let allowed = loss * form(0, channel);
            (most..=self.order).find(|&n| form(n, channel) <= allowed)
        })
    }

    /// Adds the coefficients for `wo` of bands below `order`, each part times its tint, to `out`,
    /// three runs of as many numbers as the basis has functions.
    pub fn add(&self, wo: Vec3, order: usize, tints: &[Color], out: &mut [f32]) {
        let count = self.order * self.order;
        let stride = Self::stride(self.order, self.isotropic, self.parts);
        // Nodes outside the disc have no weight and no coefficients; isotropic lobes use the first
        // two.
        let rows = self.nodes(wo).map(|(node, weight)| {
            let used =
                if weight > 0.0 { &self.coefficients[node * stride..][..stride] } else { &[] };
            (weight, used)
        });
        for (part, tint) in tints.iter().enumerate().take(self.parts) {
            let first = part * stride / self.parts;
            let at = |i: usize| -> f32 {
                let of =
                    |(weight, row): &(f32, &[f32])| row.get(first + i).map_or(0.0, |c| weight * c);
                if self.isotropic { of(&rows[0]) + of(&rows[1]) } else { rows.iter().map(of).sum() }
            };
            let mut store =
                |i: usize, value: f32| (0..3).for_each(|c| out[c * count + i] += tint[c] * value);
            if !self.isotropic {
                (0..order * order).for_each(|i| store(i, at(i)));
                continue;
            }
            let turn = Vec2::new(wo.x, wo.y).try_normalize().unwrap_or(Vec2::X);
            let mut power = Vec2::X;
            for m in 0..order {
                for l in m..order {
                    let c = at(triangle(l, m));
                    store(index(l, m as i32), power.x * c);
                    if m > 0 {
                        store(index(l, -(m as i32)), power.y * c);
                    }
                }
                power = power.rotate(turn);
            }
        }
    }
}

/// The direction at a point of the parabolic map, kept a little above the horizon.
fn from_map(p: Vec2) -> Vec3 {
    let square = p.length_squared();
    let w = Vec3::new(2.0 * p.x, 2.0 * p.y, 1.0 - square) / (1.0 + square);
    w.with_z(w.z.max(MIN_COS)).normalize()
}

/// Directions over the hemisphere: rows of equal cosine, evenly spaced azimuths.
struct Quadrature {
    rows: Vec<Row>,
    /// Sine and cosine of m times each azimuth, m first; half a turn of azimuths for lobes that
    /// are even in it.
    turns: Vec<Vec<(f64, f64)>>,
    /// Of a node, in the azimuth.
    width: f64,
}

impl Quadrature {
    fn new(basis: &dyn Basis, half: bool) -> Self {
        let (count, whole) = if half { (QUADRATURE.1, PI) } else { (2 * QUADRATURE.1, TAU) };
        let width = whole / count as f64;
        // m = 1 gives the azimuths themselves, whatever the order.
        let turn = |m: usize| {
            (0..count).map(|k| (m as f64 * (k as f64 + 0.5) * width).sin_cos()).collect()
        };
        Self {
            rows: rows(basis, QUADRATURE.0),
            turns: (0..basis.order().max(2)).map(turn).collect(),
            width: width * TAU / whole,
        }
    }

    /// What is lost by each order for `wo`, and the coefficients of all parts.
    fn project(&self, lobe: &Lobe, basis: &dyn Basis, wo: Vec3) -> (Vec<f32>, Vec<f32>) {
        let (order, count) = (basis.order(), basis.count());
        let mut c = vec![[0f64; 3]; count];
        let mut energy = vec![0f64; forms(lobe.parts)];
        let mut sums = vec![[0f64; 3]; 2 * order];
        let mut values = vec![[0f64; 3]; self.turns[1].len()];
        for row in &self.rows {
            let r = (1.0 - row.cos * row.cos).sqrt();
            for (value, (sin, cos)) in values.iter_mut().zip(&self.turns[1]) {
                let wi = Vec3::new((r * cos) as f32, (r * sin) as f32, row.cos as f32);
                *value = (lobe.f)(wo, wi).map(|f| f64::from(f) * row.cos);
            }
            let weight = row.weight * self.width;
            values.iter().for_each(|v| add_products(&mut energy, v, weight));
            sums.fill([0.0; 3]);
            for (m, turns) in self.turns.iter().enumerate().take(order) {
                for (value, (sin, cos)) in values.iter().zip(turns) {
                    for p in 0..lobe.parts {
                        sums[2 * m][p] += cos * value[p];
                        sums[2 * m + 1][p] += sin * value[p];
                    }
                }
            }
            for l in 0..order {
                for m in 0..=l {
                    let scale = weight * f64::from(row.zonal[triangle(l, m)]);
                    for p in 0..lobe.parts {
                        c[index(l, m as i32)][p] += scale * sums[2 * m][p];
                        if m > 0 && !lobe.isotropic {
                            c[index(l, -(m as i32))][p] += scale * sums[2 * m + 1][p];
                        }
                    }
                }
            }
        }
        let mut lost: Vec<f32> = energy.iter().map(|e| *e as f32).collect();
        for l in 0..order {
            c[l * l..(l + 1) * (l + 1)].iter().for_each(|c| add_products(&mut energy, c, -1.0));
            lost.extend(energy.iter().map(|e| *e as f32));
        }
        let first = |l: usize| if lobe.isotropic { 0 } else { -(l as i32) };
        let kept: Vec<[f64; 3]> = (0..order)
            .flat_map(|l| (first(l)..=l as i32).map(move |m| index(l, m)))
            .map(|i| c[i])
            .collect();
        let out = (0..lobe.parts).flat_map(|p| kept.iter().map(move |c| c[p] as f32)).collect();
        (lost, out)
    }
}

/// Size of a quadratic form of `parts` numbers.
fn forms(parts: usize) -> usize {
    parts * (parts + 1) / 2
}

/// Adds `weight` times the products of the parts, each pair once, those of different parts twofold.
fn add_products(form: &mut [f64], parts: &[f64; 3], weight: f64) {
    let mut form = form.iter_mut();
    for p in 0..3 {
        for q in 0..=p {
            let Some(sum) = form.next() else { return };
            *sum += weight * parts[p] * parts[q] * if p == q { 1.0 } else { 2.0 };
        }
    }
}
