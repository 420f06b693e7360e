//! First and second derivatives of the coefficients of incident radiance in spherical harmonics,
//! from the triangulated hemisphere.
//!
//! The published derivation gives each triangle one direction and differentiates its solid angle
//! and the basis function there [Zhao, Eq. 3.30-3.31]. The coefficient of a polygon of constant
//! radiance is an integral over its area on the sphere; only its border moves, so the derivative is
//! an integral along the edges with the basis function Y as a weight. With the chord of an edge as
//! in `gather/mesh/edges.rs`, its directions ω = ĉ/|ĉ|, `d(u) = (1-u) p_a + u p_b`, `k = â × b̂` and
//! ∇Y the gradient on the sphere:
//!
//! ```text
//! ∇λ  = Σ_edges ΔL k ∫ Y d/g^{3/2} du
//! ∇²λ = Σ_edges ΔL sym( k ⊗ ∫ (3 Y ω - ∇Y) d²/g² du )        in the tangent plane
//! ```
//!
//! The term `[m]ₓ ∫ Y d/g^{3/2}` that the second line also has, `m = p_a b̂ - p_b â`, is
//! antisymmetric in the tangent plane, and its sum vanishes with the antisymmetric part of the
//! other. No second derivative of Y is needed, and edges between triangles of the same radiance do
//! not count. Along an edge Y and ∇Y are interpolated between its ends. So the sums over edges
//! become weights of vertices, and every basis function is evaluated once per sample.

use super::coefficients::Coefficients;
use crate::basis::{Basis, LANES, Lane, Sh};
use crate::gather::mesh::{Mesh, TriangleRadiance};
use crate::gather::samples::HemisphereSamples;
use crate::math::{DVec2, DVec3, Vec3};

/// The derivatives of the coefficients of incident radiance in the tangent plane of the gather's
/// frame.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct RadianceDerivatives {
    /// Along each tangent.
    pub gradient: [Coefficients; 2],
    /// Twice along the first tangent, along both, twice along the second; empty if they were not
    /// asked for.
    pub hessian: [Coefficients; 3],
}

/// What the basis functions at one vertex are multiplied with, per channel.
#[derive(Clone, Copy, Default)]
struct Weights {
    /// The factor of Y in the gradient.
    gradient: [DVec3; 2],
    /// The factor of `3 Y ω - ∇Y` in the Hessian.
    bend: [DVec3; 2],
    /// The factor of Y in the Hessian.
    hessian: [DVec3; 3],
}

impl Weights {
    fn vanish(&self) -> bool {
        self.gradient.iter().chain(&self.bend).chain(&self.hessian).all(|w| *w == DVec3::ZERO)
    }
}

impl HemisphereSamples {
    /// Gradient of the coefficients from the triangulated hemisphere, and their Hessian if
    /// `hessians` is set; `rule` gives the triangles their radiance. The notes of
    /// [`HemisphereSamples::triangulated`] on the horizon, on silhouettes and on the change of
    /// radiance at hits hold here too.
    ///
    /// # Panics
    /// On another layout than the concentric one; schemes are checked for it when they are made.
    pub fn radiance_derivatives(
        &self, basis: &Sh, rule: TriangleRadiance, hessians: bool,
    ) -> RadianceDerivatives {
        let mesh = Mesh::new(self, &self.bundle.radiance, rule);
        let mut weights = vec![Weights::default(); mesh.vertices.len()];
        sweep(&mesh, |vertex, first, second| {
            let w = &mut weights[vertex];
            for axis in 0..2 {
                w.gradient[axis] += first[axis];
                w.bend[axis] += second[axis];
            }
        });
        if let Some(change) = self.change() {
            for (axis, along) in change.into_iter().enumerate() {
                for (k, c) in along.iter().enumerate() {
                    weights[k].gradient[axis] += (*c * self.solid_angle(k)).as_dvec3();
                }
                if hessians {
                    sweep(&Mesh::new(self, along, rule), |vertex, first, _| {
                        let h = &mut weights[vertex].hessian;
                        h[axis] += (2 - axis) as f64 * first[0];
                        h[axis + 1] += (1 + axis) as f64 * first[1];
                    });
                }
            }
        }
        let vertices = mesh.vertices.iter().map(|v| DVec3::from_slice(&v[..3]).as_vec3());
        project(basis, vertices.zip(&weights).filter(|(_, w)| !w.vanish()), hessians)
    }
}

/// Calls `visit(vertex, gradient, bend)` for both ends of every edge that matters, with their
/// shares in the weights.
fn sweep(mesh: &Mesh, mut visit: impl FnMut(usize, [DVec3; 2], [DVec3; 2])) {
    mesh.edges(|a, b, left, right| {
        if left == right {
            return;
        }
        let ([ux, uy, uz, p], [vx, vy, vz, q]) = (mesh.vertices[a], mesh.vertices[b]);
        let (u, v) = (DVec3::new(ux, uy, uz), DVec3::new(vx, vy, vz));
        let k = u.cross(v).truncate();
        let z = (u - v).length_squared();
        let difference = (left - right).as_dvec3();
        // ∫g^{-3/2} and ∫g^{-2} to first order in z, as factors.
        let (narrow, narrower) = (1.0 + 0.25 * z, 1.0 + z / 3.0);
        let mut share = |vertex: usize, p: f64, q: f64| {
            // ∫(1-u) d and ∫(1-u) d².
            let first = k * (narrow * (p / 3.0 + q / 6.0));
            let second = k * (narrower * (p * p / 4.0 + p * q / 6.0 + q * q / 12.0));
            let parts = |w: DVec2| [difference * w.x, difference * w.y];
            visit(vertex, parts(first), parts(second));
        };
        share(a, p, q);
        share(b, q, p);
    });
}

/// Vertices whose basis functions wait to be summed, so that sums are loaded and stored less often.
const BLOCK: usize = 4;

/// One number per vertex of a block.
type Block = [Lane; BLOCK];

fn project<'a>(
    basis: &Sh, vertices: impl Iterator<Item = (Vec3, &'a Weights)>, hessians: bool,
) -> RadianceDerivatives {
    let count = basis.count();
    let vertices: Vec<(Vec3, &Weights)> = vertices.collect();
    let mut functions = vec![vec![[Lane::default(); 3]; count]; BLOCK];
    let mut sums = vec![[[0.0_f32; 3]; 5]; count];
    for chunk in vertices.chunks(BLOCK * LANES) {
        let vertex = |g: usize, k: usize| chunk.get(g * LANES + k);
        let mut w = [[Vec3::Z; LANES]; BLOCK];
        let mut weights = [[[[0.0_f32; LANES]; BLOCK]; 3]; 7];
        for g in 0..BLOCK {
            for k in 0..LANES {
                let Some((direction, of)) = vertex(g, k) else { continue };
                w[g][k] = *direction;
                for (slots, value) in
                    weights.iter_mut().zip(of.gradient.iter().chain(&of.bend).chain(&of.hessian))
                {
                    for channel in 0..3 {
                        slots[channel][g][k] = value[channel] as f32;
                    }
                }
            }
            basis.slopes(&w[g], &mut functions[g]);
        }
        let x: Block = w.map(|w| w.map(|w| w.x));
        let y: Block = w.map(|w| w.map(|w| w.y));
        for (i, sum) in sums.iter_mut().enumerate() {
            let values: Block = std::array::from_fn(|g| functions[g][i][0]);
            let [gx, gy]: [Block; 2] = [1, 2].map(|c| std::array::from_fn(|g| functions[g][i][c]));
            let bend = |at: &Block, slope: &Block| -> Block {
                std::array::from_fn(|g| {
                    std::array::from_fn(|k| 3.0 * values[g][k] * at[g][k] - slope[g][k])
                })
            };
            let (bx, by) = (bend(&x, &gx), bend(&y, &gy));
            for channel in 0..3 {
                let [gs, gt, ks, kt, ss, st, tt] = weights.each_ref().map(|w| &w[channel]);
                sum[0][channel] += dot(gs, &values);
                sum[1][channel] += dot(gt, &values);
                if hessians {
                    sum[2][channel] += dot(ks, &bx) + dot(ss, &values);
                    sum[3][channel] += 0.5 * (dot(ks, &by) + dot(kt, &bx)) + dot(st, &values);
                    sum[4][channel] += dot(kt, &by) + dot(tt, &values);
                }
            }
        }
    }
    let run = |d: usize| {
        (0..3).flat_map(|channel| sums.iter().map(move |s| s[d][channel])).collect::<Coefficients>()
    };
    let hessian = if hessians { [run(2), run(3), run(4)] } else { Default::default() };
    RadianceDerivatives { gradient: [run(0), run(1)], hessian }
}

#[inline]
fn dot(a: &Block, b: &Block) -> f32 {
    let mut lanes = Lane::default();
    for (a, b) in a.iter().zip(b) {
        for k in 0..LANES {
            lanes[k] += a[k] * b[k];
        }
    }
    lanes.iter().sum()
}
