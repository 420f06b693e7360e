//! How the light that a hit sends to the point of a gather changes when that point moves.
//!
//! The hit stays where it is, and so does all that reaches it; only the direction wo in which it is
//! looked at turns. What was traced from it, a light sample, a cached irradiance and one path, is
//! kept as it is, and the lobes are evaluated again towards points a little aside: `∂L/∂t = Σ
//! (f(wo+) - f(wo-))/(2δ f(wo)) L_part` [Zhao, Eq. 3.41, for the samples at hand instead of a
//! hemisphere at each hit]. Weights and densities of the samples count as constants, as they do in
//! the sum itself, so that the expected value is the change of the glossy reflection. No ray is
//! traced. What a delta lobe shows moves in another way and is left out.

use super::IndirectLight;
use super::path::{Reflected, Sampled, Step};
use super::vertex::Vertex;
use crate::accel::Ray;
use crate::gather::HitChange;
use crate::geometry::SurfacePoint;
use crate::material::Lobe;
use crate::material::tables::GlossyTables;
use crate::math::{Color, INV_PI, Vec3};

/// The point of the gather is moved by this share of the distance of the hit.
const STEP: f32 = 0.01;

/// The directions to a point and to points beside it, seen from a hit, in its local frame.
pub(super) struct Views<'a> {
    vertex: &'a Vertex,
    wo: Vec3,
    /// For each tangent ahead and behind.
    beside: [[Vec3; 2]; 2],
    /// Derivatives of the direction.
    turn: [Vec3; 2],
    step: f32,
    how: HitChange,
    /// The lobes in harmonics, where those are wanted.
    tables: Option<&'a GlossyTables>,
}

/// Changes along both tangents of the gather's frame.
pub(super) type Change = [Color; 2];

impl<'a> Views<'a> {
    /// Those of the hit `vertex` at `distance` from the gather `from`; `None` where nothing
    /// changes.
    pub fn new(
        how: HitChange, tables: Option<&'a GlossyTables>, from: &SurfacePoint, vertex: &'a Vertex,
        distance: f32,
    ) -> Option<Self> {
        if how == HitChange::None || !vertex.bsdf.has_glossy() || vertex.bsdf.is_delta_only() {
            return None;
        }
        let (frame, step) = (&vertex.point.frame, STEP * distance);
        let back = distance * vertex.point.wo;
        let tangents = [from.frame.s, from.frame.t];
        let towards = |offset: Vec3| frame.to_local((back + offset).normalize());
        let wo = frame.to_local(vertex.point.wo);
        Some(Self {
            vertex,
            wo,
            beside: tangents.map(|t| [towards(step * t), towards(-step * t)]),
            turn: tangents
                .map(|t| frame.to_local(t - vertex.point.wo * vertex.point.wo.dot(t)) / distance),
            step,
            how,
            tables: tables.filter(|_| how == HitChange::Harmonics),
        })
    }

    /// The change of what is reflected without a shadow ray: cached light, and the light `next`
    /// that the sampled direction of `step` brings, both as they arrive. Where records have told
    /// what glossy lobes reflect, those on the level of the hit are asked again for other
    /// directions: their product with the lobe is known in all of them, and without noise
    /// [Zhao, Eq. 3.46-3.48].
    pub fn of_step(
        &self, step: &Step, next: Color, (indirect, level): (IndirectLight, u8),
    ) -> Change {
        let bsdf = &self.vertex.bsdf;
        let mut cached = self.relative(step.cached.diffuse, |wo| bsdf.diffuse_albedo(wo));
        if step.sampled == Sampled::Nothing {
            let seen = |wo: Vec3| indirect.seen_from(level, self.vertex, wo);
            for (sum, [ahead, behind]) in cached.iter_mut().zip(self.beside) {
                if let (Some(ahead), Some(behind)) = (seen(ahead), seen(behind)) {
                    *sum += (ahead - behind) / (2.0 * self.step);
                }
            }
        }
        let Some((sample, _)) = step.next.as_ref().filter(|(s, _)| s.lobe != Lobe::Delta) else {
            return cached;
        };
        let followed = match step.sampled {
            Sampled::Everything => {
                let diffuse = |wo: Vec3| {
                    if sample.wi.z > 0.0 { bsdf.diffuse_albedo(wo) * INV_PI } else { Color::ZERO }
                };
                match self.slope(sample.wi) {
                    // A diffuse lobe below it does not depend on wo.
                    Some((glossy, slope)) => {
                        let share = glossy
                            / (glossy + diffuse(self.wo)).max(Color::splat(f32::MIN_POSITIVE));
                        slope.map(|s| next * share * s)
                    }
                    None => self.lobes(next, sample.wi, bsdf.f(self.wo, sample.wi), |wo| {
                        bsdf.f(wo, sample.wi)
                    }),
                }
            }
            _ => self.of_gloss(next, sample.wi),
        };
        [cached[0] + followed[0], cached[1] + followed[1]]
    }

    /// The change of the light sample that `shadow` goes to.
    pub fn of_light(&self, shadow: &Ray, light: &Reflected) -> Change {
        let wi = self.vertex.point.frame.to_local(shadow.dir);
        let diffuse = self.relative(light.diffuse, |wo| self.vertex.bsdf.diffuse_albedo(wo));
        let glossy = self.of_gloss(light.glossy, wi);
        [diffuse[0] + glossy[0], diffuse[1] + glossy[1]]
    }

    /// The change of `light`, which came from `wi` and was reflected by the lobes other than the
    /// diffuse one.
    fn of_gloss(&self, light: Color, wi: Vec3) -> Change {
        match self.slope(wi) {
            Some((_, slope)) => slope.map(|s| light * s),
            None => self.lobes(light, wi, self.vertex.bsdf.f_glossy(self.wo, wi), |wo| {
                self.vertex.bsdf.f_glossy(wo, wi)
            }),
        }
    }

    /// The change of `light`, which came from `wi` and is proportional to `f`, `here` towards the
    /// point of the gather.
    fn lobes(&self, light: Color, wi: Vec3, here: Color, f: impl Fn(Vec3) -> Color) -> Change {
        let Vertex { point, bsdf } = self.vertex;
        match self.tables {
            // The diffuse lobe is part of the sum, and of no difference.
            Some(tables) if wi.z > 0.0 => self
                .difference(light, here, |wo| tables.reflect(point.material, bsdf, wo, wi) / wi.z),
            _ => self.difference(light, here, f),
        }
    }

    /// The glossy part of f for `wi`, and its relative change, if it is asked for and has a closed
    /// form.
    fn slope(&self, wi: Vec3) -> Option<(Color, [f32; 2])> {
        if self.how != HitChange::Analytic {
            return None;
        }
        let slope = self.vertex.bsdf.logarithmic_slope(self.wo, wi)?;
        Some((self.vertex.bsdf.f_glossy(self.wo, wi), self.turn.map(|t| slope.dot(t))))
    }

    /// The change of `light`, which is proportional to `f(wo)`.
    fn relative(&self, light: Color, f: impl Fn(Vec3) -> Color) -> Change {
        self.difference(light, f(self.wo), f)
    }

    /// The change of `light`, which is as `here` is; `f` tells that aside.
    fn difference(&self, light: Color, here: Color, f: impl Fn(Vec3) -> Color) -> Change {
        if light == Color::ZERO {
            return [Color::ZERO; 2];
        }
        self.beside.map(|[ahead, behind]| {
            // Towards a point below the hit's horizon nothing is reflected, which is no slope.
            if ahead.z * self.wo.z <= 0.0 || behind.z * self.wo.z <= 0.0 {
                return Color::ZERO;
            }
            let difference = (f(ahead) - f(behind)) / (2.0 * self.step);
            Color::select(here.cmpgt(Color::ZERO), light * difference / here, Color::ZERO)
        })
    }
}
