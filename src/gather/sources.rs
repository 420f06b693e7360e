//! What a gather saw as point sources that stay where they are, so that irradiance can be had
//! beside the point, and under another normal, without tracing a ray.

use super::samples::{HemisphereSamples, MIN_COS_HIT};
use crate::math::{Color, INV_PI, PI, Vec2, Vec3};

/// Sources worked on at a time.
const LANES: usize = 8;

/// Eight sources that lie relative to the point of the gather, in its local frame.
#[derive(Clone, Copy, Default)]
struct Lane {
    x: [f32; LANES],
    y: [f32; LANES],
    z: [f32; LANES],
    /// Against the normal at the hit.
    nx: [f32; LANES],
    ny: [f32; LANES],
    nz: [f32; LANES],
    /// The area that a source stands for, over π.
    area: [f32; LANES],
    /// F, with the distances and the cosine at the source taken out.
    weight: [f32; LANES],
    /// Radiance.
    radiance: [[f32; LANES]; 3],
}

/// Indirect light of a gather as equivalent point sources [Ribardiere11, Eq. 8-13].
///
/// A hit at y whose normal is n_y stands for a diffuse patch of the area `A = Ω r²/cos ξ` with the
/// radiance L that the ray brought. At x', beside the gather in its tangent plane, it gives
///
/// ```text
/// F'    = Ω cos θ · (cos θ'/cos θ) (cos ξ'/cos ξ) (r² + A/π)/(r'² + A/π)
/// E(x') = Σ L F' · Σ F/Σ F'
/// ```
///
/// and F' = 0 behind its own plane. A/π keeps a source finite that the point comes close to; what
/// is infinitely far, and what is seen at a grazing angle, keeps its F. At the gather itself the
/// sum is [`HemisphereSamples::irradiance`]. The published sum lacks the last factor. But
/// beside a wall x' leaves behind the patches that were seen, and the patches ahead were hardly
/// seen. So the patches cover less than the hemisphere of x', and corners come out dark by tens of
/// percents. The factor spreads the light of the patches over the whole hemisphere; in a uniform
/// world irradiance does not change at all.
pub struct PointSources<'a> {
    samples: &'a HemisphereSamples,
    lanes: Vec<Lane>,
    /// Places on light paths: irradiance in the place of radiance, and no part of Σ F.
    joints: Vec<Lane>,
    /// Irradiance that does not change, and the part of Σ F that does not.
    constant: (Color, f32),
    /// Σ F.
    whole: f32,
}

impl HemisphereSamples {
    /// Its samples as point sources.
    pub fn point_sources(&self) -> PointSources<'_> {
        let b = &self.bundle;
        let mut lanes = Vec::with_capacity(b.len());
        let (mut constant, mut whole) = ((Color::ZERO, 0.0), 0.0);
        for (k, (&w, &r)) in b.dir_local.iter().zip(&b.distance).enumerate() {
            let solid_angle = self.solid_angle(k);
            let factor = w.z * solid_angle;
            let against = -self.frame.to_local(b.normal[k]);
            let cosine = against.dot(w);
            whole += factor;
            if !r.is_finite() || r <= 0.0 || cosine < MIN_COS_HIT {
                constant.0 += factor * b.radiance[k];
                constant.1 += factor;
                continue;
            }
            let area = solid_angle * r * r / cosine;
            lanes.push(Source {
                at: r * w,
                against,
                area,
                weight: factor,
                radiance: b.radiance[k],
            });
        }
        let joints = b.joints.iter().map(|j| Source {
            at: self.frame.to_local(j.offset),
            against: -self.frame.to_local(j.normal),
            area: j.area,
            weight: 1.0,
            radiance: j.irradiance,
        });
        let (lanes, joints) = (Lane::all(lanes.into_iter()), Lane::all(joints));
        PointSources { samples: self, lanes, joints, constant, whole }
    }
}

/// One source, in the local frame of the gather.
struct Source {
    at: Vec3,
    against: Vec3,
    area: f32,
    weight: f32,
    radiance: Color,
}

impl Lane {
    /// Lanes of all `sources`.
    fn all(sources: impl ExactSizeIterator<Item = Source>) -> Vec<Self> {
        // What is not filled is nowhere near a place where it could divide by zero.
        let mut lanes =
            vec![Self { z: [1.0; LANES], ..Self::default() }; sources.len().div_ceil(LANES)];
        for (k, source) in sources.enumerate() {
            let (lane, k) = (&mut lanes[k / LANES], k % LANES);
            let (squared, area) = (source.at.length_squared(), source.area * INV_PI);
            let facing = source.against.dot(source.at);
            (lane.x[k], lane.y[k], lane.z[k]) = source.at.into();
            (lane.nx[k], lane.ny[k], lane.nz[k]) = source.against.into();
            (lane.area[k], lane.weight[k]) =
                (area, source.weight * squared * (squared + area) / facing);
            (0..3).for_each(|c| lane.radiance[c][k] = source.radiance[c]);
        }
        lanes
    }

    /// Adds the F' of its sources at `d` to `factors`, and those times the radiance to `sums`.
    #[inline]
    fn add(&self, d: Vec2, sums: &mut [[f32; LANES]; 3], factors: &mut [f32; LANES]) {
        let mut factor = [0.0_f32; LANES];
        for k in 0..LANES {
            let (x, y, z) = (self.x[k] - d.x, self.y[k] - d.y, self.z[k]);
            let squared = x * x + y * y + z * z;
            let facing = (self.nx[k] * x + self.ny[k] * y + self.nz[k] * z).max(0.0);
            factor[k] = self.weight[k] * facing / (squared * (squared + self.area[k]));
            factors[k] += factor[k];
        }
        for (sum, radiance) in sums.iter_mut().zip(&self.radiance) {
            for k in 0..LANES {
                sum[k] += radiance[k] * factor[k];
            }
        }
    }
}

impl PointSources<'_> {
    /// Irradiance at the place `d` in the tangent plane of the gather, scene units along its
    /// tangents.
    pub fn irradiance_at(&self, d: Vec2) -> Color {
        let (mut sums, mut factors) = ([[0.0_f32; LANES]; 3], [0.0_f32; LANES]);
        self.lanes.iter().for_each(|lane| lane.add(d, &mut sums, &mut factors));
        let covered = self.constant.1 + factors.iter().sum::<f32>();
        let sum = self.constant.0 + Color::from_array(sums.map(|s| s.iter().sum()));
        let spread = if covered > 0.0 { sum * (self.whole / covered) } else { sum };
        let mut joined = [[0.0_f32; LANES]; 3];
        self.joints.iter().for_each(|lane| lane.add(d, &mut joined, &mut factors));
        spread + Color::from_array(joined.map(|s| s.iter().sum()))
    }

    /// Irradiance on a surface through the point of the gather whose normal is tilted by `angle`
    /// towards the unit tangent `towards`, local [Ribardiere11, Eq. 20].
    ///
    /// The gather has not seen what lies below its own tangent plane. That wedge, which a surface
    /// of unit radiance would give `π (1 - cos angle)/2` by, is taken to shine as what lies just
    /// above the plane on its side; without it a tilt would darken every scene whose walls go
    /// on there.
    pub fn irradiance_tilted(&self, towards: Vec2, angle: f32) -> Color {
        let b = &self.samples.bundle;
        let (sin, cos) = angle.sin_cos();
        let normal = (sin * towards).extend(cos);
        let (mut seen, mut low, mut weights) = (Color::ZERO, Color::ZERO, 0.0);
        for (k, w) in b.dir_local.iter().enumerate() {
            let solid_angle = self.samples.solid_angle(k);
            seen += b.radiance[k] * (normal.dot(*w).max(0.0) * solid_angle);
            let side = towards.dot(w.truncate());
            if w.z < sin && side > 0.0 {
                low += b.radiance[k] * (side * solid_angle);
                weights += side * solid_angle;
            }
        }
        for joint in &b.joints {
            let w = self.samples.frame.to_local(joint.offset);
            seen += joint.irradiance * (normal.dot(w) / w.z).max(0.0);
        }
        if weights > 0.0 { seen + low * (0.5 * PI * (1.0 - cos) / weights) } else { seen }
    }
}
