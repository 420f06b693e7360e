//! The surroundings of a point as a triangle mesh over the samples of one hemisphere, and the
//! derivatives of irradiance from it.
//!
//! Neighbouring samples are connected into triangles of constant radiance whose corners are the
//! hits [Schwarzhaupt12]. A triangle between a near and a far hit stands for the silhouette in
//! between: the triangle grows or shrinks when the receiver moves and the occluder uncovers or
//! hides what lies behind. So the derivatives of the mesh know of occlusion, although nothing in
//! the mesh is occluded.

use super::edges::{EdgeSum, Vertex};
use super::hessians::{Derivatives, Hessian};
use crate::gather::irradiance::Gradient;
use crate::gather::samples::HemisphereSamples;
use crate::gather::strata::Layout;
use crate::math::Color;
use serde::{Deserialize, Serialize};

/// Which radiance a triangle has.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum TriangleRadiance {
    /// That of its farthest corner: what a silhouette uncovers or hides lies behind it
    /// [Schwarzhaupt12]. Texture on a continuous surface is displaced by up to a sample.
    Farthest,
    /// The mean of the corners that are nearly as far as the farthest one: the mean on a continuous
    /// surface, the far side across a silhouette.
    Hybrid,
}

/// A corner counts as being as far as the farthest if that is no more than this multiple of its
/// distance.
const NEARLY_AS_FAR: f64 = 1.5;

/// The samples of a concentric layout with the ring of vertices on the horizon that closes the
/// mesh.
///
/// Vertex `j n + i` is sample (j, i); ring vertices follow in the order of the samples along the
/// grid's border, counter-clockwise. Every square of four samples is cut along the diagonal from
/// (j, i+1) to (j+1, i). The winding of triangles is that of the grid. Jitter may turn a few
/// triangles over; these then cancel what their neighbours have too much.
pub struct Mesh {
    n: usize,
    pub vertices: Vec<Vertex>,
    radiance: Vec<Color>,
    /// Radiance of the triangle at the lower corner (j, i) of each square, then of the other one.
    squares: Vec<[Color; 2]>,
    /// Radiance of the two triangles outside each edge of the grid's border: the one that touches
    /// the ring with an edge, then the one that touches it with a corner.
    skirt: Vec<[Color; 2]>,
}

impl HemisphereSamples {
    /// Gradient and Hessian of irradiance from the triangulated hemisphere; `rule` gives the
    /// triangles their radiance.
    ///
    /// The outermost samples do not reach the horizon. A mesh that ended with them would be a lit
    /// cap in a black world, with a gradient and a Hessian of its own. So each of these samples is
    /// continued straight down to the horizon at its distance.
    ///
    /// The gradient is consistent with occlusion. The Hessian is too, but for corners where a
    /// silhouette crosses another edge; its error falls only as the distance between samples, which
    /// is good enough for radii.
    ///
    /// Where the probe told how the radiance of hits changes with the receiver's position
    /// ([`HitChange`](crate::gather::HitChange)), the gradient has the term `Σ Ω_k cos θ_k ∇L_k`,
    /// and the Hessian the products of that change with the motion of the mesh. The second
    /// derivatives of L_k are left out.
    ///
    /// # Panics
    /// On another layout than the concentric one; schemes are checked for it when they are made.
    pub fn triangulated(&self, rule: TriangleRadiance) -> Derivatives {
        let color = |c: [f64; 3]| Color::from_array(c.map(|c| c as f32));
        let [mut x, mut y, mut xx, mut xy, mut yy] =
            Mesh::new(self, &self.bundle.radiance, rule).sum().map(color);
        if let Some(change) = self.change() {
            let cosine = |k: usize| self.bundle.dir_local[k].z * self.solid_angle(k);
            let [along_s, along_t] = &change;
            x += along_s.iter().enumerate().map(|(k, c)| *c * cosine(k)).sum::<Color>();
            y += along_t.iter().enumerate().map(|(k, c)| *c * cosine(k)).sum::<Color>();
            let [ss, st, ..] = Mesh::new(self, along_s, rule).sum().map(color);
            let [ts, tt, ..] = Mesh::new(self, along_t, rule).sum().map(color);
            xx += 2.0 * ss;
            xy += st + ts;
            yy += 2.0 * tt;
        }
        Derivatives {
            gradient: Gradient { s: x, t: y },
            hessian: Hessian { ss: xx, st: xy, tt: yy },
        }
    }
}

impl Mesh {
    /// The mesh over `samples`, whose triangles have a radiance made of `of_samples`, one value for
    /// each sample.
    pub fn new(samples: &HemisphereSamples, of_samples: &[Color], rule: TriangleRadiance) -> Self {
        let Layout::Concentric { n } = samples.layout else {
            panic!("the triangulated hemisphere needs the concentric layout")
        };
        let n = n as usize;
        let b = &samples.bundle;
        let ring = 4 * (n - 1);
        let mut vertices = Vec::with_capacity(n * n + ring);
        vertices.extend(b.dir_local.iter().zip(&b.distance).map(|(w, r)| {
            // Of unit length in single precision; one step of Newton's gives it that in double
            // precision.
            let w = w.as_dvec3();
            let w = w * (1.5 - 0.5 * w.length_squared());
            // Something at distance 0 would be infinitely important; it is taken to be as far as
            // the smallest normal number.
            [w.x, w.y, w.z, 1.0 / f64::from(r.max(f32::MIN_POSITIVE))]
        }));
        let mut radiance = Vec::with_capacity(n * n + ring);
        radiance.extend_from_slice(of_samples);
        for k in 0..ring {
            let sample = Self::border(n, k);
            let [x, y, _, inverse] = vertices[sample];
            let length = x.hypot(y);
            vertices.push(if length > 0.0 {
                [x / length, y / length, 0.0, inverse]
            } else {
                [1.0, 0.0, 0.0, inverse]
            });
            radiance.push(of_samples[sample]);
        }
        let mut mesh = Self {
            n,
            vertices,
            radiance,
            squares: Vec::with_capacity((n - 1) * (n - 1)),
            skirt: Vec::with_capacity(ring),
        };
        for j in 0..n - 1 {
            for i in 0..n - 1 {
                let k = j * n + i;
                let square =
                    [[k, k + 1, k + n], [k + n + 1, k + n, k + 1]].map(|t| mesh.triangle(t, rule));
                mesh.squares.push(square);
            }
        }
        for k in 0..ring {
            let (here, next) = (Self::border(n, k), Self::border(n, k + 1));
            let (below, below_next) = (n * n + k, n * n + (k + 1) % ring);
            let skirt = [[here, below, below_next], [here, below_next, next]]
                .map(|t| mesh.triangle(t, rule));
            mesh.skirt.push(skirt);
        }
        mesh
    }

    /// The sample at place `k` along the border of the grid, counter-clockwise from (0, 0).
    fn border(n: usize, k: usize) -> usize {
        let (side, step) = (k / (n - 1) % 4, k % (n - 1));
        match side {
            0 => step,
            1 => step * n + n - 1,
            2 => n * n - 1 - step,
            _ => (n - 1 - step) * n,
        }
    }

    #[inline]
    fn triangle(&self, corners: [usize; 3], rule: TriangleRadiance) -> Color {
        let inverse = corners.map(|c| self.vertices[c][3]);
        let farthest = inverse[0].min(inverse[1]).min(inverse[2]);
        let limit = match rule {
            TriangleRadiance::Farthest => {
                // The first of them where several are equally far.
                let first = inverse.iter().position(|&p| p == farthest).unwrap_or(0);
                return self.radiance[corners[first]];
            }
            TriangleRadiance::Hybrid => NEARLY_AS_FAR * farthest,
        };
        let (mut sum, mut count) = (Color::ZERO, 0.0);
        for (c, p) in corners.iter().zip(inverse) {
            if p <= limit {
                sum += self.radiance[*c];
                count += 1.0;
            }
        }
        sum / count
    }

    /// Gradient and Hessian in the tangent plane, per channel. Only edges between triangles of
    /// different radiance count.
    fn sum(&self) -> [[f64; 3]; 5] {
        let mut sum = EdgeSum::new();
        self.edges(|a, b, left, right| {
            if left != right {
                sum.add(&self.vertices[a], &self.vertices[b], (left - right).as_dvec3().to_array());
            }
        });
        sum.finish()
    }

    /// Calls `visit(a, b, left, right)` for every edge from vertex a to vertex b between triangles
    /// of radiance `left` and `right`; outside the mesh it is black.
    #[inline]
    pub fn edges(&self, mut visit: impl FnMut(usize, usize, Color, Color)) {
        let n = self.n;
        let across = n - 1;
        for j in 0..across {
            for i in 0..across {
                let (k, square) = (j * n + i, j * across + i);
                let [lower, upper] = self.squares[square];
                visit(k + 1, k + n, lower, upper);
                if j > 0 {
                    visit(k, k + 1, lower, self.squares[square - across][1]);
                }
                if i > 0 {
                    visit(k, k + n, self.squares[square - 1][1], lower);
                }
            }
        }
        let ring = self.skirt.len();
        for k in 0..ring {
            let (side, step) = (k / across, k % across);
            // The grid's triangle at this edge of the border.
            let inside = match side {
                0 => self.squares[step][0],
                1 => self.squares[step * across + across - 1][1],
                2 => self.squares[across * across - 1 - step][1],
                _ => self.squares[(across - 1 - step) * across][0],
            };
            let (here, next) = (Self::border(n, k), Self::border(n, k + 1));
            let (below, below_next) = (n * n + k, n * n + (k + 1) % ring);
            let [low, high] = self.skirt[k];
            visit(here, next, inside, high);
            visit(here, below, low, self.skirt[(k + ring - 1) % ring][1]);
            visit(here, below_next, high, low);
            visit(below, below_next, low, Color::ZERO);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::gather::Density;
    use crate::math::{DMat2, DVec2, DVec3};
    use crate::sampling::Rng;

    fn furnace(n: u32, seed: u64, radiance: impl Fn(usize) -> Color) -> HemisphereSamples {
        let mut samples = HemisphereSamples::new(Layout::Concentric { n }, Density::Cosine);
        samples.bundle.reset(samples.layout.rays());
        samples.layout.directions(
            Density::Cosine,
            seed,
            &mut samples.bundle.dir_local,
            &mut samples.bundle.pdf,
        );
        let mut rng = Rng::new(seed);
        for k in 0..samples.bundle.len() {
            // Half of the rays leave the scene.
            samples.bundle.distance[k] =
                if k % 2 == 0 { 0.5 + 3.5 * rng.next_f32() } else { f32::INFINITY };
            samples.bundle.radiance[k] = radiance(k);
        }
        samples
    }

    /// Every edge of every triangle, one triangle at a time: what the sum over differences must
    /// equal. Also irradiance, by Lambert's formula.
    fn one_by_one(samples: &HemisphereSamples, rule: TriangleRadiance) -> (f64, [f64; 5]) {
        let mesh = Mesh::new(samples, &samples.bundle.radiance, rule);
        let (n, across, ring) = (mesh.n, mesh.n - 1, mesh.skirt.len());
        let mut triangles = Vec::new();
        for (square, colors) in mesh.squares.iter().enumerate() {
            let k = square / across * n + square % across;
            triangles.push(([k, k + 1, k + n], colors[0]));
            triangles.push(([k + n + 1, k + n, k + 1], colors[1]));
        }
        for (k, colors) in mesh.skirt.iter().enumerate() {
            let (here, next) = (Mesh::border(n, k), Mesh::border(n, k + 1));
            let (below, below_next) = (n * n + k, n * n + (k + 1) % ring);
            triangles.push(([here, below, below_next], colors[0]));
            triangles.push(([here, below_next, next], colors[1]));
        }
        let (mut e, mut sum) = (0.0, EdgeSum::new());
        for (corners, radiance) in triangles {
            for k in 0..3 {
                let (a, b) = (&mesh.vertices[corners[k]], &mesh.vertices[corners[(k + 1) % 3]]);
                let (u, v) = (DVec3::from_slice(a), DVec3::from_slice(b));
                let c = u.cross(v);
                let angle = c.length().atan2(u.dot(v));
                if angle > 0.0 {
                    e += 0.5 * f64::from(radiance.x) * c.z / c.length() * angle;
                }
                sum.add(a, b, radiance.as_dvec3().to_array());
            }
        }
        (e, sum.finish().map(|c| c[0]))
    }

    #[test]
    fn a_furnace_of_any_shape_is_flat() {
        for n in [4, 9, 32, 96] {
            for seed in 0..4 {
                let samples = furnace(n, seed, |_| Color::ONE);
                let sum =
                    Mesh::new(&samples, &samples.bundle.radiance, TriangleRadiance::Hybrid).sum();
                assert!(sum.iter().flatten().all(|x| x.abs() < 1e-9), "{n}: {sum:?}");
                let (e, each) = one_by_one(&samples, TriangleRadiance::Hybrid);
                assert!((e - std::f64::consts::PI).abs() < 1e-9, "{e}");
                assert!(each.iter().all(|x| x.abs() < 1e-9), "{n}: {each:?}");
            }
        }
    }

    #[test]
    fn the_sum_over_edges_is_the_sum_over_triangles() {
        let samples = furnace(24, 7, |k| Color::splat((k % 7) as f32));
        for rule in [TriangleRadiance::Farthest, TriangleRadiance::Hybrid] {
            let d = samples.triangulated(rule);
            let edges =
                [d.gradient.s.x, d.gradient.t.x, d.hessian.ss.x, d.hessian.st.x, d.hessian.tt.x];
            let (_, each) = one_by_one(&samples, rule);
            for (a, b) in edges.iter().zip(each) {
                assert!((f64::from(*a) - b).abs() < 1e-5 * (1.0 + b.abs()), "{rule:?} {a} {b}");
            }
        }
    }

    #[test]
    fn turned_samples_have_turned_derivatives() {
        let samples = furnace(16, 3, |k| Color::splat((k % 5) as f32));
        let (sin, cos) = 0.7_f32.sin_cos();
        let mut turned = furnace(16, 3, |k| Color::splat((k % 5) as f32));
        for w in &mut turned.bundle.dir_local {
            *w = crate::math::Vec3::new(cos * w.x - sin * w.y, sin * w.x + cos * w.y, w.z);
        }
        let [a, b] = [&samples, &turned].map(|s| s.triangulated(TriangleRadiance::Hybrid));
        let parts = |d: &Derivatives| {
            let [x, y, xx, xy, yy] =
                [d.gradient.s, d.gradient.t, d.hessian.ss, d.hessian.st, d.hessian.tt]
                    .map(|c| f64::from(c.x));
            (DVec2::new(x, y), DMat2::from_cols(DVec2::new(xx, xy), DVec2::new(xy, yy)))
        };
        let ((g, h), (g1, h1)) = (parts(&a), parts(&b));
        let r = DMat2::from_angle(f64::from(0.7_f32));
        assert!((r * g - g1).length() < 1e-5 * g.length(), "{g} {g1}");
        let off = r * h * r.transpose() - h1;
        assert!(off.to_cols_array().iter().all(|x| x.abs() < 1e-5 * h.x_axis.length()), "{h} {h1}");
    }
}
