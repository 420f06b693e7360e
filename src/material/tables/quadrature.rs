//! Quadrature over the hemisphere in rows of equal cosine.

use crate::basis::{Basis, LANES, gauss_legendre, index, triangle, zonal_factors};
use std::f64::consts::TAU;

/// Directions of one cosine.
pub(super) struct Row {
    pub cos: f64,
    /// In the cosine.
    pub weight: f64,
    /// The zonal factors of the basis.
    pub zonal: Vec<f32>,
}

/// `count` rows over the hemisphere.
pub(super) fn rows(basis: &dyn Basis, count: usize) -> Vec<Row> {
    // cos θ = t²: √cos θ, which hemispherical harmonics contain, is smooth in t.
    let nodes: Vec<(f64, f64)> = gauss_legendre(count, 0.0, 1.0)
        .into_iter()
        .map(|(t, weight)| (t * t, 2.0 * t * weight))
        .collect();
    let mut rows = Vec::with_capacity(count);
    let mut lanes = Vec::new();
    for chunk in nodes.chunks(LANES) {
        let cosines = std::array::from_fn(|k| chunk.get(k).map_or(1.0, |n| n.0 as f32));
        zonal_factors(basis, &cosines, &mut lanes);
        rows.extend(chunk.iter().enumerate().map(|(k, &(cos, weight))| Row {
            cos,
            weight,
            zonal: lanes.iter().map(|lane| lane[k]).collect(),
        }));
    }
    rows
}

/// The coefficients of the cosine over the hemisphere.
pub(super) fn cosine(basis: &dyn Basis) -> Vec<f32> {
    let mut c = vec![0.0; basis.count()];
    let mut zonal = Vec::new();
    for nodes in gauss_legendre(4 * LANES, 0.0, 1.0).chunks_exact(LANES) {
        zonal_factors(basis, &std::array::from_fn(|k| nodes[k].0 as f32), &mut zonal);
        for l in 0..basis.order() {
            let sum: f64 = (0..LANES)
                .map(|k| TAU * nodes[k].0 * nodes[k].1 * f64::from(zonal[triangle(l, 0)][k]))
                .sum();
            c[index(l, 0)] += sum as f32;
        }
    }
    c
}
