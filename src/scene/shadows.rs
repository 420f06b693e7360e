//! Light that reaches a point straight through panes.
//!
//! A thin sheet does not bend a ray, and a solid between parallel faces gives it its direction
//! back. So light samples see through both: what a light sends along the ray arrives in the same
//! direction, times the transmittance of what it passes. Paths count the same light as seen
//! straight, so that both can be weighed against each other. Whatever turns a ray for good, a
//! bottle or a sphere, blocks light samples and is left to paths.

use super::Scene;
use super::world::SHORTENING;
use crate::accel::Ray;
use crate::geometry::SurfacePoint;
use crate::material::Pane;
use crate::math::{Color, Vec3};
use crate::sampling::LONGEST_PATH;

/// Unit directions that differ by less count as the same, squared: 0.06 degrees, for faces of panes
/// that are parallel but for their rounding.
const SAME_DIRECTION: f32 = 1e-6;
/// Panes whose normals have a larger cosine are parallel.
const PARALLEL: f32 = 1.0 - 1e-4;
/// Light that goes to and fro between two panes is looked into if it is more than this share.
const ECHO: f32 = 1e-4;
/// Steps towards the ray that meets a near light behind bending panes.
const STEPS: usize = 8;
/// Squared change of the direction at which the ray is found.
const FOUND: f32 = 1e-9;

/// True if two unit directions are the same but for what parallel faces of panes are off.
#[inline]
pub fn same_direction(a: Vec3, b: Vec3) -> bool {
    (a - b).length_squared() < SAME_DIRECTION
}

/// True if two unit normals are those of parallel planes.
#[inline]
pub fn are_parallel(a: Vec3, b: Vec3) -> bool {
    a.dot(b).abs() > PARALLEL
}

/// One pane, with all that is reflected inside it.
struct Sheet {
    normal: Vec3,
    passed: Color,
    reflected: Color,
}

/// The panes on a ray.
struct Passage {
    passed: Color,
    /// What the panes so far send back to where the light comes from; the last of them.
    reflected: Color,
    last: Option<Vec3>,
    /// The way inside solids, from face to face.
    inside: Vec3,
    /// What the way inside adds to the distance that light spreads over, across the plane of
    /// incidence and within it.
    spread: [f32; 2],
    /// Where the last pane is left.
    start: Vec3,
    /// Nothing else is in the way of the ray behind it.
    free: bool,
}

impl Passage {
    /// Adds a pane. Light that comes from it may `echo` between the panes: the sum of all its ways
    /// [Stokes62].
    fn add(&mut self, sheet: &Sheet, echo: bool) {
        let Sheet { normal, passed, reflected } = *sheet;
        let again =
            if echo { (Color::ONE - self.reflected * reflected).recip() } else { Color::ONE };
        let back = if echo { passed * passed * self.reflected * again } else { Color::ZERO };
        self.passed *= passed * again;
        self.reflected = reflected + back;
        self.last = Some(normal);
    }
}

impl Scene {
    /// Share of the light that comes along the shadow ray: 0 if something blocks it, 1 if nothing
    /// is in its way, the transmittance of panes if they are. `seed` decides at partly transparent
    /// surfaces.
    ///
    /// Exact for panes that do not bend, and for light from infinity. A lamp behind a solid pane is
    /// seen from a point a little off; its distance is corrected, its direction and the cosine at
    /// the receiver are not.
    pub fn visibility(&self, ray: &Ray, seed: u64) -> Color {
        self.share(ray, self.occluded(ray, seed), || seed)
    }

    /// [`Scene::visibility`] of many rays, whose own numbers decide as in [`Scene::occluded_many`].
    pub fn visibility_many(&self, rays: &[Ray]) -> Vec<Color> {
        let mut blocked = vec![false; rays.len()];
        self.occluded_many(rays, &mut blocked);
        let share = |(ray, blocked)| self.share(ray, blocked, || Self::seed_of(ray));
        rays.iter().zip(blocked).map(share).collect()
    }

    /// [`Scene::visibility`] of a ray of which it is known whether it is `blocked`.
    #[inline]
    fn share(&self, ray: &Ray, blocked: bool, seed: impl FnOnce() -> u64) -> Color {
        match blocked {
            false => Color::ONE,
            true if self.meets_pane(ray) => self.through_panes(ray, seed()).unwrap_or(Color::ZERO),
            true => Color::ZERO,
        }
    }

    /// Transmittance of a ray that meets something.
    #[cold]
    fn through_panes(&self, ray: &Ray, seed: u64) -> Option<Color> {
        let target = ray.tmax.is_finite().then(|| ray.origin + ray.dir * ray.tmax);
        let mut dir = ray.dir;
        for step in 1..=STEPS {
            let passage = self.passage(ray.origin, dir, target, seed)?;
            let Some(target) = target.filter(|_| passage.inside != Vec3::ZERO) else {
                return Some(passage.passed);
            };
            let outside = target - ray.origin - passage.inside;
            let (length, turned) = (outside.length(), outside.try_normalize()?);
            let change = (turned - dir).length_squared();
            if change < FOUND || (step == STEPS && change < SAME_DIRECTION) {
                let way = target - passage.start;
                let tmax = way.length() * (1.0 - SHORTENING);
                let last =
                    Ray { origin: passage.start, tmin: 0.0, dir: way.try_normalize()?, tmax };
                if !passage.free && self.occluded(&last, seed) {
                    return None;
                }
                let [across, within] = passage.spread.map(|s| length + s);
                return Some(passage.passed * (ray.tmax * ray.tmax / (across * within)));
            }
            dir = turned;
        }
        None
    }

    /// The panes on the way from `origin` along `dir`, as far as `target` or without end; `None` if
    /// something else is there, too. Behind bending panes the ray may miss the target and meet the
    /// lamp around it before: then the answer is left open.
    fn passage(&self, origin: Vec3, dir: Vec3, target: Option<Vec3>, seed: u64) -> Option<Passage> {
        let mut passage = Passage {
            passed: Color::ONE,
            reflected: Color::ZERO,
            last: None,
            inside: Vec3::ZERO,
            spread: [0.0; 2],
            start: origin,
            free: true,
        };
        let mut heading = dir;
        for _ in 0..LONGEST_PATH {
            let start = passage.start;
            let tmax = target.map_or(f32::INFINITY, |t| (t - start).dot(heading));
            let ray = Ray { origin: start, tmin: 0.0, dir: heading, tmax };
            let hit = if tmax > 0.0 { self.intersect(&ray, seed) } else { None };
            let Some((mut near, distance)) = hit else { return Some(passage) };
            let Some((pane, wi)) = self.pane(&mut near) else {
                let open = target.is_some() && passage.inside != Vec3::ZERO;
                return open.then_some(Passage { free: false, ..passage });
            };
            let absorbed = self.transmittance(&near, distance);
            let sheet = if same_direction(wi, dir) {
                (passage.start, heading) = (near.leave(wi), wi);
                Sheet {
                    normal: near.frame.n,
                    passed: pane.passed * absorbed,
                    reflected: pane.reflected,
                }
            } else {
                let (mut far, _) = self.intersect(&self.spawn(&near, wi), seed)?;
                let (exit, out) = self.pane(&mut far)?;
                if !same_direction(out, dir) {
                    return None;
                }
                let (cos, cos_inside) = (near.frame.n.dot(dir), near.frame.n.dot(wi));
                let way = far.position - near.position;
                let length = way.length();
                passage.inside += way;
                passage.spread[0] += length / pane.eta;
                passage.spread[1] += length / pane.eta * (cos / cos_inside).powi(2);
                (passage.start, heading) = (far.leave(out), out);
                // Light that is reflected inside leaves in the same direction [Stokes62].
                let once = self.transmittance(&far, length);
                let to_and_fro = (exit.reflected * once) * (exit.reflected * once);
                let passed = pane.passed * exit.passed * once / (Color::ONE - to_and_fro);
                Sheet {
                    normal: near.frame.n,
                    passed: passed * absorbed,
                    reflected: pane.reflected + passed * once * exit.reflected,
                }
            };
            if passage.passed * sheet.passed == Color::ZERO {
                return None;
            }
            let echo = passage.last.is_some_and(|n| are_parallel(n, sheet.normal))
                && (passage.reflected * sheet.reflected).max_element() > ECHO
                && self.echoes(&near, seed);
            passage.add(&sheet, echo);
        }
        None
    }

    /// True if light that `near` reflects back against its line of sight is reflected once more by
    /// a pane in front of it, and passes the plane of `near` by a pane.
    fn echoes(&self, near: &SurfacePoint, seed: u64) -> bool {
        let back = 2.0 * near.frame.n.dot(near.wo) * near.frame.n - near.wo;
        let parallel = |from: &SurfacePoint, dir: Vec3| {
            let (at, _) = self.intersect(&self.spawn(from, dir), seed)?;
            let parallel = are_parallel(at.ng, near.ng) && self.is_pane(at.material);
            parallel.then_some(at)
        };
        parallel(near, back).and_then(|front| parallel(&front, -near.wo)).is_some()
    }

    /// What the surface at `at` does as a pane, and the direction in which the ray goes on; `None`
    /// where it is none. Shades `at`.
    pub fn pane(&self, at: &mut SurfacePoint) -> Option<(Pane, Vec3)> {
        if !self.is_pane(at.material) {
            return None;
        }
        let pane = self.shade(at).pane(at.frame.to_local(at.wo))?;
        let wi = at.frame.to_world(pane.wi);
        (wi.dot(at.ng) < 0.0).then_some((pane, wi))
    }
}
