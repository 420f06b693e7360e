//! What a gather saw as point sources that stay where they are, so that irradiance can be had beside the point, and under another normal, without tracing a ray.

use super::gradient::MIN_COS_HIT;
use super::{Density, HemisphereSamples};
use crate::math::{Color, INV_PI, PI, Vec2, Vec3};

/// Sources worked on at a time.
const LANES: usize = 8;

/// Light that arrives at a point straight from one place of a light source.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Arrival {
    /// Unit world direction from the point to the source.
    pub dir: Vec3,
    /// Irradiance on a surface across `dir`; zero where something is in the way.
    pub light: Color,
}

/// Places on the light sources, chosen once for the surroundings of a point. The same places are asked about everywhere: what differs from one point to the next is light, not noise.
pub trait DirectLight {
    /// Appends what arrives at each of `points` from each place, point by point. The irradiance at a point is the sum of its arrivals times the cosine.
    fn arriving(&self, points: &[Vec3], out: &mut Vec<Arrival>);
}

/// How [`super::RadianceProbe::lights`] chooses places.
#[derive(Clone, Copy, Debug)]
pub struct LightChoice {
    /// Number of light samples.
    pub samples: u32,
    /// Of the rays of the gather that met the environment, every so many stand for it.
    pub every: u32,
    /// Density of those rays.
    pub density: Density,
    /// Seed of all choices.
    pub seed: u64,
}

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
    /// What is left when the distances and the cosine at the source are taken out.
    strength: [[f32; LANES]; 3],
}

/// Indirect light of a gather as equivalent point sources [Ribardiere11, Eq. 8-13].
///
/// A hit at y whose normal is n_y stands for a diffuse patch of the area `A = Ω r²/cos ξ` with the radiance L that the ray brought. At x', beside the gather in its tangent plane, it gives
///
/// ```text
/// E(x') = Ω L cos θ · (cos θ'/cos θ) (cos ξ'/cos ξ) (r² + A/π)/(r'² + A/π),
/// ```
///
/// and nothing behind its own plane. A/π keeps a source finite that the point comes close to; at the gather itself the sum is [`HemisphereSamples::irradiance`]. What is infinitely far, and what is seen at
/// a grazing angle, stays as it is.
pub struct PointSources<'a> {
    samples: &'a HemisphereSamples,
    lanes: Vec<Lane>,
    /// Irradiance that does not change.
    constant: Color,
}

impl HemisphereSamples {
    /// Its samples as point sources.
    pub fn point_sources(&self) -> PointSources<'_> {
        let b = &self.bundle;
        let (mut lanes, mut used, mut constant) = (Vec::with_capacity(b.len() / LANES + 1), LANES, Color::ZERO);
        for (k, (&w, &r)) in b.dir_local.iter().zip(&b.distance).enumerate() {
            let solid_angle = self.solid_angle(k);
            let irradiance = b.radiance[k] * (w.z * solid_angle);
            if irradiance == Color::ZERO {
                continue;
            }
            let against = -self.frame.to_local(b.normal[k]);
            let cosine = against.dot(w);
            if !r.is_finite() || r <= 0.0 || cosine < MIN_COS_HIT {
                constant += irradiance;
                continue;
            }
            if used == LANES {
                lanes.push(Lane { z: [1.0; LANES], ..Lane::default() });
                used = 0;
            }
            let Some(lane) = lanes.last_mut() else { continue };
            let area = solid_angle * r * r * INV_PI / cosine;
            let strength = irradiance * (r * (r * r + area) / cosine);
            let at = r * w;
            (lane.x[used], lane.y[used], lane.z[used]) = (at.x, at.y, at.z);
            (lane.nx[used], lane.ny[used], lane.nz[used]) = (against.x, against.y, against.z);
            lane.area[used] = area;
            (0..3).for_each(|c| lane.strength[c][used] = strength[c]);
            used += 1;
        }
        PointSources { samples: self, lanes, constant }
    }
}

impl PointSources<'_> {
    /// Irradiance at the place `d` in the tangent plane of the gather, scene units along its tangents.
    pub fn irradiance_at(&self, d: Vec2) -> Color {
        let mut sums = [[0.0_f32; LANES]; 3];
        for lane in &self.lanes {
            let mut share = [0.0_f32; LANES];
            for k in 0..LANES {
                let (x, y, z) = (lane.x[k] - d.x, lane.y[k] - d.y, lane.z[k]);
                let squared = x * x + y * y + z * z;
                let facing = (lane.nx[k] * x + lane.ny[k] * y + lane.nz[k] * z).max(0.0);
                share[k] = facing / (squared * (squared + lane.area[k]));
            }
            for (sum, strength) in sums.iter_mut().zip(&lane.strength) {
                for k in 0..LANES {
                    sum[k] += strength[k] * share[k];
                }
            }
        }
        self.constant + Color::from_array(sums.map(|s| s.iter().sum()))
    }

    /// Irradiance on a surface through the point of the gather whose normal is tilted by `angle` towards the unit tangent `towards`, local [Ribardiere11, Eq. 20].
    ///
    /// The gather has not seen what lies below its own tangent plane. That wedge, which a surface of unit radiance would give `π (1 - cos angle)/2` by, is taken to shine as what lies just above the plane on its
    /// side; without it a tilt would darken every scene whose walls go on there.
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
        if weights > 0.0 { seen + low * (0.5 * PI * (1.0 - cos) / weights) } else { seen }
    }
}

/// The irradiance of `arrivals` on a surface with the unit normal `n`.
pub fn irradiance_of(arrivals: &[Arrival], n: Vec3) -> Color {
    arrivals.iter().map(|a| a.light * n.dot(a.dir).max(0.0)).sum()
}
