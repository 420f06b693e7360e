//! Light as it leaves its sources: the start of light paths, drawn in proportion to power.

use super::lights::Lights;
use super::pattern::Pattern;
use super::source::{LightSource, PunctualLight, weight};
use super::tree::Pick;
use crate::geometry::Aabb;
use crate::math::{Color, Frame, INV_PI, PI, Vec2, Vec3};
use crate::sampling::{square_to_cosine_hemisphere, square_to_disk};

/// Where a path ends on a light.
#[derive(Clone, Copy, Debug)]
pub struct LightEnd {
    /// The light; the weights of a triangle's vertices count only where its emission is textured.
    pub source: LightSource,
    /// World position, of no meaning for light from infinity.
    pub position: Vec3,
    /// Unit normal of an emitting surface on the side that the path is on, zero for lights that
    /// are none.
    pub normal: Vec3,
    /// The light comes from infinity.
    pub distant: bool,
    /// No path that does not start here can end here: the light has no extent.
    pub delta: bool,
}

/// The start of a light path.
#[derive(Clone, Copy, Debug)]
pub struct Emission {
    /// Its end on the light.
    pub end: LightEnd,
    /// Where the ray starts.
    pub origin: Vec3,
    /// Unit direction in which the light travels.
    pub direction: Vec3,
    /// What is emitted, the mean over the triangle for an emissive one: radiance; for a light with
    /// a position radiant intensity; for a directional one irradiance.
    pub emitted: Color,
    /// The factor that makes flux of it: the cosine at a surface over the density of start and
    /// direction.
    pub measure: f32,
    /// Density of the end: see [`EmissionSampler::end_density`].
    pub end_density: f32,
    /// Density of the ray: see [`EmissionSampler::ray_density`].
    pub ray_density: f32,
}

/// The ball that most light paths from infinity are aimed at.
#[derive(Clone, Copy, Debug)]
pub struct Focus {
    /// Its middle.
    pub center: Vec3,
    /// Its radius.
    pub radius: f32,
}

/// Part of the paths from infinity that cross the focus; the others cross the whole scene.
const FOCUSED: f32 = 0.8;

#[derive(Clone, Copy)]
enum Item {
    Triangle(usize),
    /// A light with a position, by its place in the tree.
    Point(usize),
    Directional(usize),
    Environment,
}

/// Draws the starts of light paths. A light is chosen by its power, with the same bounds on the
/// part of the lights at infinity that sampling towards lights has.
pub struct EmissionSampler<'a> {
    lights: &'a Lights,
    items: Vec<Item>,
    /// Sums of the first 1, 2, ... weights; the last is 1.
    sums: Vec<f64>,
    /// First item of lights with a position, for the items before which are triangles.
    points: usize,
    /// For each punctual light of the scene, its item.
    punctual: Vec<usize>,
    bounds: Aabb,
    radius: f32,
    focus: Option<Focus>,
}

impl<'a> EmissionSampler<'a> {
    /// For the lights of a scene with the box `bounds`, which all light from infinity must cross.
    pub fn new(lights: &'a Lights, bounds: Aabb) -> Self {
        let radius = 0.5 * bounds.diagonal();
        let area = PI * radius * radius;
        let (tree, directional) = (lights.tree(), lights.directional());
        let triangles = tree
            .triangles()
            .iter()
            .enumerate()
            .map(|(i, t)| (Item::Triangle(i), weight(t.power())));
        let points = tree
            .punctual_lights()
            .iter()
            .enumerate()
            .map(|(i, (_, l))| (Item::Point(i), weight(l.power())));
        let parallel = directional
            .iter()
            .enumerate()
            .map(|(i, (_, l))| (Item::Directional(i), area * weight(l.strength())));
        let environment = lights.distant().map(|e| (Item::Environment, area * weight(e.fluence())));
        let near: Vec<_> = triangles.chain(points).collect();
        let far: Vec<_> = parallel.chain(environment).filter(|_| radius > 0.0).collect();

        let total = |items: &[(Item, f32)]| items.iter().map(|(_, w)| f64::from(*w)).sum::<f64>();
        let share = match (total(&near) > 0.0, total(&far) > 0.0) {
            (true, true) => f64::from(lights.infinite_share()),
            (_, far) => f64::from(u8::from(far)),
        };
        let mut sum = 0.0;
        let mut sums = Vec::with_capacity(near.len() + far.len());
        for (group, part) in [(&near, 1.0 - share), (&far, share)] {
            let total = total(group);
            for (_, weight) in group {
                sum += if total > 0.0 { f64::from(*weight) / total * part } else { 0.0 };
                sums.push(sum);
            }
        }
        let items: Vec<Item> = near.iter().chain(&far).map(|(item, _)| *item).collect();
        let mut punctual = Vec::new();
        for (i, item) in items.iter().enumerate() {
            let index = match item {
                Item::Point(p) => tree.punctual(*p).0,
                Item::Directional(d) => directional[*d].0,
                Item::Triangle(_) | Item::Environment => continue,
            } as usize;
            if punctual.len() <= index {
                punctual.resize(index + 1, usize::MAX);
            }
            punctual[index] = i;
        }
        let points = tree.triangles().len();
        Self { lights, items, sums, points, punctual, bounds, radius, focus: None }
    }

    /// The same with most of the paths from infinity aimed at `focus`. Nothing changes where that
    /// is hardly smaller than the scene.
    ///
    /// The paths of a scene with a ground plane of a hundred kilometres would all miss the room
    /// that stands there. The density of a ray is that of both kinds of paths together, so any ray
    /// may be of any kind.
    #[must_use]
    pub fn aimed_at(self, focus: Option<Focus>) -> Self {
        let small = |f: &Focus| f.radius > 0.0 && 2.0 * f.radius.powi(2) < self.radius.powi(2);
        Self { focus: focus.filter(small), ..self }
    }

    fn probability(&self, item: usize) -> f32 {
        let below = if item == 0 { 0.0 } else { self.sums[item - 1] };
        (self.sums[item] - below) as f32
    }

    /// The light of an index among the scene's punctual lights.
    fn punctual(&self, index: u32) -> Option<(usize, &PunctualLight)> {
        let item = *self.punctual.get(index as usize).filter(|i| **i != usize::MAX)?;
        match self.items[item] {
            Item::Point(i) => Some((item, self.lights.tree().punctual(i).1)),
            Item::Directional(i) => Some((item, &self.lights.directional()[i].1)),
            Item::Triangle(_) | Item::Environment => None,
        }
    }

    /// The start of a path: `select` in [0, 1) chooses the light, `place` and `turn` in [0, 1)² the
    /// start and the direction. `None` where nothing is emitted.
    pub fn sample(&self, select: f32, place: Vec2, turn: Vec2) -> Option<Emission> {
        let total = *self.sums.last()?;
        let target = f64::from(select) * total;
        let item = self.sums.partition_point(|s| *s <= target).min(self.items.len() - 1);
        let probability = self.probability(item);
        let emission = match self.items[item] {
            Item::Triangle(i) => {
                let light = &self.lights.tree().triangles()[i];
                let pattern = self.lights.pattern(i);
                let ([u, v], position) = match pattern {
                    None => light.point(place),
                    Some(pattern) => match pattern.draw(place) {
                        Some(weights) => (weights, light.position(weights)),
                        None => light.point(Pattern::rest(place)),
                    },
                };
                let density = probability * pattern.map_or(1.0, |p| p.mixed_density([u, v]));
                let emitter = light.emitter();
                // With two faces the first half of the turn chooses the front.
                let (x, faces) =
                    if emitter.double_sided { (2.0 * turn.x, 2.0) } else { (turn.x, 1.0) };
                let normal = light.normal() * if x < 1.0 { 1.0 } else { -1.0 };
                let local = square_to_cosine_hemisphere(Vec2::new(x.fract(), turn.y));
                let source = LightSource::Triangle {
                    instance: emitter.instance,
                    triangle: emitter.triangle,
                    u,
                    v,
                };
                Emission {
                    end: LightEnd { source, position, normal, distant: false, delta: false },
                    origin: position,
                    direction: Frame::from_normal(normal).to_world(local),
                    emitted: emitter.radiance,
                    measure: PI * faces * light.area() / density,
                    end_density: density / light.area(),
                    ray_density: local.z * INV_PI / faces,
                }
            }
            Item::Point(i) => {
                let (index, light) = self.lights.tree().punctual(i);
                let position = light.position()?;
                let direction = light.sample_direction(turn)?;
                let density = light.direction_density(direction);
                let source = LightSource::Punctual(index);
                Emission {
                    end: LightEnd {
                        source,
                        position,
                        normal: Vec3::ZERO,
                        distant: false,
                        delta: true,
                    },
                    origin: position,
                    direction,
                    emitted: light.intensity(direction),
                    measure: 1.0 / (probability * density),
                    end_density: probability,
                    ray_density: density,
                }
            }
            Item::Directional(i) => {
                let (index, light) = &self.lights.directional()[i];
                let PunctualLight::Directional { direction, irradiance } = *light else {
                    return None;
                };
                self.start_at_infinity(
                    LightSource::Punctual(*index),
                    true,
                    direction,
                    irradiance,
                    place,
                    probability,
                )
            }
            Item::Environment => {
                let environment = self.lights.distant()?;
                let (towards, density) = environment.sample(None, turn);
                let radiance = environment.radiance(towards);
                self.start_at_infinity(
                    LightSource::Environment,
                    false,
                    -towards,
                    radiance,
                    place,
                    probability * density,
                )
            }
        };
        (emission.measure > 0.0 && emission.measure.is_finite()).then_some(emission)
    }

    /// A ray through the disc across the direction that covers the scene, or its focus.
    fn start_at_infinity(
        &self, source: LightSource, delta: bool, direction: Vec3, emitted: Color, place: Vec2,
        density: f32,
    ) -> Emission {
        let frame = Frame::from_normal(direction);
        let beside = |middle: Vec3, place: Vec2, radius: f32| {
            let disc = square_to_disk(place) * radius;
            middle + frame.s * disc.x + frame.t * disc.y
        };
        let x = place.x / FOCUSED;
        let origin = match self.focus {
            Some(Focus { center, radius }) if x < 1.0 => {
                let at = beside(center, Vec2::new(x, place.y), radius);
                self.outside(at, direction, radius)
            }
            focus => {
                let x = (place.x - FOCUSED) / (1.0 - FOCUSED);
                let rest = Vec2::new(x.min(1.0 - f32::EPSILON), place.y);
                let place = if focus.is_some() { rest } else { place };
                beside(self.bounds.center() - direction * self.radius, place, self.radius)
            }
        };
        let ray_density = self.disc_density(origin, direction);
        Emission {
            end: LightEnd { source, position: origin, normal: Vec3::ZERO, distant: true, delta },
            origin,
            direction,
            emitted,
            measure: 1.0 / (density * ray_density),
            end_density: density,
            ray_density,
        }
    }

    /// A place on the line through `at`, `margin` before it enters the scene: from farther away
    /// rounding would shift the ray.
    fn outside(&self, at: Vec3, direction: Vec3, margin: f32) -> Vec3 {
        let mut entry = f32::NEG_INFINITY;
        for axis in (0..3).filter(|axis| direction[*axis] != 0.0) {
            let sides = [self.bounds.min, self.bounds.max];
            let [a, b] = sides.map(|side| (side[axis] - at[axis]) / direction[axis]);
            entry = entry.max(a.min(b));
        }
        at + direction * (entry.min(0.0) - margin)
    }

    /// Density per area across `direction` of the rays from infinity that pass `at`.
    fn disc_density(&self, at: Vec3, direction: Vec3) -> f32 {
        let disc = |radius: f32| INV_PI / (radius * radius);
        let Some(Focus { center, radius }) = self.focus else { return disc(self.radius) };
        let offset = at - center;
        let aside = offset - direction * offset.dot(direction);
        let focused = if aside.length() < radius { FOCUSED * disc(radius) } else { 0.0 };
        focused + (1.0 - FOCUSED) * disc(self.radius)
    }

    /// The density with which paths start at an end: per area on a surface, per steradian for the
    /// environment, whose light travels along `direction`; a probability for lights
    /// without extent.
    pub fn end_density(&self, end: &LightEnd, direction: Vec3) -> f32 {
        match end.source {
            LightSource::Triangle { instance, triangle, .. } => {
                let Some(index) = self.lights.emitter_index(instance, triangle) else { return 0.0 };
                debug_assert!(index < self.points);
                let light = &self.lights.tree().triangles()[index];
                let density = self
                    .lights
                    .pattern(index)
                    .map_or(1.0, |p| p.mixed_density(light.weights(end.position)));
                self.probability(index) * density / light.area()
            }
            LightSource::Environment => match (self.lights.distant(), self.items.last()) {
                (Some(environment), Some(Item::Environment)) => {
                    self.probability(self.items.len() - 1) * environment.pdf(None, -direction)
                }
                _ => 0.0,
            },
            LightSource::Punctual(index) => {
                self.punctual(index).map_or(0.0, |(item, _)| self.probability(item))
            }
        }
    }

    /// The density of the ray that leaves an end along the unit direction and passes `at`: per
    /// steradian, for lights at infinity per area across it.
    pub fn ray_density(&self, end: &LightEnd, direction: Vec3, at: Vec3) -> f32 {
        match end.source {
            LightSource::Triangle { instance, triangle, .. } => {
                let double = self
                    .lights
                    .emitter(instance, triangle)
                    .is_some_and(|t| t.emitter().double_sided);
                end.normal.dot(direction).max(0.0) * INV_PI * if double { 0.5 } else { 1.0 }
            }
            LightSource::Environment => self.disc_density(at, direction),
            LightSource::Punctual(_) if end.distant => self.disc_density(at, direction),
            LightSource::Punctual(index) => {
                self.punctual(index).map_or(0.0, |(_, light)| light.direction_density(direction))
            }
        }
    }

    /// What is left of the light of an end after `distance`: less than 1 only for punctual lights
    /// with a range.
    pub fn window(&self, end: &LightEnd, distance: f32) -> f32 {
        match end.source {
            LightSource::Punctual(index) => {
                self.punctual(index).map_or(1.0, |(_, light)| light.window(distance))
            }
            LightSource::Triangle { .. } | LightSource::Environment => 1.0,
        }
    }
}

impl Lights {
    /// The probability with which [`Lights::sample`] chooses a punctual light, by its index in the
    /// scene.
    pub fn pdf_punctual(&self, p: Vec3, n: Option<Vec3>, index: u32) -> f32 {
        let (infinite, total) = self.infinite_probability(p, n);
        if let Some((_, light)) = self.directional().iter().find(|(i, _)| *i == index) {
            return if total > 0.0 { infinite * light.importance(p, n) / total } else { 0.0 };
        }
        match self.tree().find_punctual(index) {
            Some(place) => (1.0 - infinite) * self.tree().probability(p, n, Pick::Punctual(place)),
            None => 0.0,
        }
    }

    /// What reaches `p` from a punctual light, by its index in the scene, occlusion aside: the unit
    /// direction to the light, the distance, and the irradiance across that direction.
    pub fn from_punctual(&self, p: Vec3, index: u32) -> Option<(Vec3, f32, Color)> {
        let light = match self.directional().iter().find(|(i, _)| *i == index) {
            Some((_, light)) => light,
            None => self.tree().punctual(self.tree().find_punctual(index)?).1,
        };
        light.incidence(p).map(|i| (i.wi, i.distance, i.irradiance))
    }
}
