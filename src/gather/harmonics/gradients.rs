//! The gradients of the coefficients of incident radiance.

use super::coefficients::{Coefficients, Sums};
use crate::basis::{Basis, Jet, LANES, Sh, index, triangle, zonal_factors};
use crate::gather::mesh::TriangleRadiance;
use crate::gather::samples::{HemisphereSamples, MIN_COS_HIT};
use crate::gather::strata::Layout;
use crate::math::{Color, Vec2, Vec3};
use crate::words::words;
use std::f32::consts::TAU;

words! {
    /// The estimators of the translational gradient of radiance coefficients.
    pub enum RadianceGradient {
        /// Not at all.
        None = "none",
        /// By central differences over a small displacement, each sample a patch that keeps its
        /// radiance [Krivanek05, Sec. 4.3].
        Displacement = "displacement",
        /// By patches, one for each sample, that keep their radiance [Krivanek05, Eq. 7-11].
        PerSample = "per-sample",
        /// By moving boundaries between strata; sees silhouettes. Strata `polar` only.
        Boundary = "boundary",
        /// By a mesh over the hits; sees silhouettes, and has second derivatives. Strata
        /// `concentric` and spherical harmonics only.
        Triangulated = "triangulated",
    }
}

/// Displacement of the numerical gradient as a share of the smallest distance.
const DISPLACEMENT: f32 = 1e-3;

impl HemisphereSamples {
    /// The change of the coefficients per unit along each tangent of the gather's frame, by the
    /// method `kind`.
    ///
    /// # Panics
    /// For [`RadianceGradient::Boundary`] on another layout than the polar one, for
    /// [`RadianceGradient::Triangulated`] on another than the concentric one; schemes are checked
    /// for it when they are made.
    pub fn radiance_gradient(
        &self, basis: &dyn Basis, kind: RadianceGradient,
    ) -> [Coefficients; 2] {
        match kind {
            RadianceGradient::None => std::array::from_fn(|_| vec![0.0; 3 * basis.count()]),
            RadianceGradient::Displacement => self.displacement(basis),
            RadianceGradient::PerSample => self.per_sample_radiance(basis),
            RadianceGradient::Boundary => self.boundary(basis),
            RadianceGradient::Triangulated => {
                self.radiance_derivatives(&Sh::new(basis.order()), TriangleRadiance::Hybrid, false)
                    .gradient
            }
        }
    }

    /// The gradient of Ward and Heckbert [WardHeckbert92] with a basis function H in place of the
    /// cosine: where two strata of different radiance meet, the boundary moves with the nearer
    /// of the two hits, and what it sweeps is weighed by H there. Ring j from the pole, sector k,
    ///
    /// ```text
    /// ∇λ = Σ_k { u_k (2π/N) Σ_{j≥1} sin θ_j- cos θ_j- H(θ_j-, φ_k) D(jk; j-1,k)
    ///          + v_k- Σ_j (θ_j+ - θ_j-) H(θ_j, φ_k-) D(jk; j,k-1) }
    /// ```
    ///
    /// with `D(a; b) = (L_a - L_b)/min(r_a, r_b)`. No derivative of H and no normal at the hit are
    /// needed. The zonal factor of H is the same for all sectors, so the sums over j are made
    /// before the trigonometric factor is applied.
    fn boundary(&self, basis: &dyn Basis) -> [Coefficients; 2] {
        let Layout::Polar { m, n } = self.layout else {
            panic!("the boundary gradient needs the polar layout")
        };
        let (m, n) = (m as usize, n as usize);
        let edges: Vec<f32> =
            (0..=m).map(|j| self.bundle.density.angle(j as f32 / m as f32)).collect();
        let middles: Vec<f32> = edges.windows(2).map(|e| 0.5 * (e[0] + e[1])).collect();
        let (at_edges, at_middles) = (zonal(basis, &edges[..m]), zonal(basis, &middles));
        let width = at_edges.len() / m;
        let b = &self.bundle;
        // What the boundary between two samples sweeps per unit of displacement, before its weight.
        let swept = |here: usize, there: usize| {
            (b.radiance[here] - b.radiance[there]) / b.distance[here].min(b.distance[there])
        };

        let mut gradient = [vec![0.0; 3 * basis.count()], vec![0.0; 3 * basis.count()]];
        let mut rings = vec![0.0; 3 * width];
        let mut sectors = vec![0.0; 3 * width];
        for k in 0..n {
            let before = (k + n - 1) % n;
            rings.fill(0.0);
            sectors.fill(0.0);
            for j in 0..m {
                let zonal = j * width..(j + 1) * width;
                let across = (edges[j + 1] - edges[j]) * swept(j * n + k, j * n + before);
                accumulate(&mut sectors, &at_middles[zonal.clone()], across);
                if j > 0 {
                    let (sin, cos) = edges[j].sin_cos();
                    let outward = sin * cos * TAU / n as f32 * swept(j * n + k, (j - 1) * n + k);
                    accumulate(&mut rings, &at_edges[zonal], outward);
                }
            }
            let (middle, lower) = (TAU * (k as f32 + 0.5) / n as f32, TAU * k as f32 / n as f32);
            spread(basis, &rings, middle, Vec2::new(middle.cos(), middle.sin()), &mut gradient);
            spread(basis, &sectors, lower, Vec2::new(-lower.sin(), lower.cos()), &mut gradient);
        }
        gradient
    }

    /// A hit q at distance r with normal n_q seen under cos ξ stands for a fixed patch: `∇Ω = Ω
    /// (n_q/(r cos ξ) + 3 w/r)`, and the direction to it moves, `∇B = -∇_S B / r`. In Cartesian
    /// form, where the polar form has 0/0 at the pole. Escaped rays contribute nothing.
    fn per_sample_radiance(&self, basis: &dyn Basis) -> [Coefficients; 2] {
        let b = &self.bundle;
        let count = basis.count();
        let mut sums = [vec![0f64; 3 * count], vec![0f64; 3 * count]];
        let mut jets = vec![Jet::default(); count];
        for k in (0..b.len()).filter(|&k| b.distance[k].is_finite()) {
            let w = b.dir_local[k];
            let normal = self.frame.to_local(b.normal[k]);
            let patch = normal / (-normal.dot(w)).max(MIN_COS_HIT) + 3.0 * w;
            let radiance = (b.radiance[k] * (self.solid_angle(k) / b.distance[k])).as_dvec3();
            basis.jets(w.as_dvec3(), false, &mut jets);
            for (axis, sum) in sums.iter_mut().enumerate() {
                let patch = f64::from(patch[axis]);
                for (i, jet) in jets.iter().enumerate() {
                    let change = patch * jet.value - jet.gradient[axis];
                    (0..3).for_each(|c| sum[c * count + i] += radiance[c] * change);
                }
            }
        }
        sums.map(|s| s.into_iter().map(|x| x as f32).collect())
    }

    /// As [`Self::per_sample_radiance`], by evaluating the patches from two displaced points on
    /// either side along each tangent. A patch that would sink below the horizon or show its back
    /// counts as unmoved.
    fn displacement(&self, basis: &dyn Basis) -> [Coefficients; 2] {
        let b = &self.bundle;
        let step = DISPLACEMENT * b.distance.iter().copied().fold(f32::INFINITY, f32::min);
        if !(step.is_finite() && step > 0.0) {
            return self.radiance_gradient(basis, RadianceGradient::None);
        }
        [Vec3::X, Vec3::Y].map(|axis| {
            let mut sums = Sums::new(basis);
            let mut lanes = Vec::with_capacity(LANES);
            let mut flush = |lanes: &mut Vec<(Vec3, Color)>| {
                let lane = |k: usize| lanes.get(k).copied().unwrap_or((Vec3::Z, Color::ZERO));
                sums.add(
                    basis,
                    &std::array::from_fn(|k| lane(k).0),
                    &std::array::from_fn(|k| lane(k).1),
                );
                lanes.clear();
            };
            for k in (0..b.len()).filter(|&k| b.distance[k].is_finite()) {
                let (w, r) = (b.dir_local[k], b.distance[k]);
                let normal = self.frame.to_local(b.normal[k]);
                let cos_hit = (-normal.dot(w)).max(MIN_COS_HIT);
                let moved = |sign: f32| {
                    let to = r * w - sign * step * axis;
                    let (direction, length) = (to.normalize(), to.length());
                    let share = -normal.dot(direction) * r * r / (cos_hit * length * length);
                    (direction.z > 0.0 && share > 0.0).then_some((direction, share))
                };
                if let (Some(ahead), Some(behind)) = (moved(1.0), moved(-1.0)) {
                    let weight = b.radiance[k] * (self.solid_angle(k) / (2.0 * step));
                    lanes.push((ahead.0, weight * ahead.1));
                    lanes.push((behind.0, -weight * behind.1));
                    if lanes.len() == LANES {
                        flush(&mut lanes);
                    }
                }
            }
            flush(&mut lanes);
            sums.finish()
        })
    }
}

/// The zonal factors at each of the angles θ, one run of them after another.
fn zonal(basis: &dyn Basis, angles: &[f32]) -> Vec<f32> {
    let (mut lanes, mut out) = (Vec::new(), Vec::new());
    for chunk in angles.chunks(LANES) {
        zonal_factors(
            basis,
            &std::array::from_fn(|k| chunk.get(k).copied().unwrap_or(0.0).cos()),
            &mut lanes,
        );
        for k in 0..chunk.len() {
            out.extend(lanes.iter().map(|lane| lane[k]));
        }
    }
    out
}

/// Adds `weight` times the zonal factors, channel by channel.
fn accumulate(sums: &mut [f32], zonal: &[f32], weight: Color) {
    for (sums, weight) in sums.chunks_exact_mut(zonal.len()).zip(weight.to_array()) {
        for (sum, z) in sums.iter_mut().zip(zonal) {
            *sum += weight * z;
        }
    }
}

/// Adds sums over zonal factors, times the trigonometric factors at azimuth `phi`, along
/// `direction`.
fn spread(
    basis: &dyn Basis, sums: &[f32], phi: f32, direction: Vec2, gradient: &mut [Coefficients; 2],
) {
    let (width, count) = (sums.len() / 3, basis.count());
    for m in 0..basis.order() {
        let (sin, cos) = (m as f32 * phi).sin_cos();
        for l in m..basis.order() {
            for channel in 0..3 {
                let sum = sums[channel * width + triangle(l, m)];
                let mut add = |i: usize, value: f32| {
                    gradient[0][channel * count + i] += direction.x * value;
                    gradient[1][channel * count + i] += direction.y * value;
                };
                add(index(l, m as i32), cos * sum);
                if m > 0 {
                    add(index(l, -(m as i32)), sin * sum);
                }
            }
        }
    }
}
