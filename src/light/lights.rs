//! All lights of a scene: choice of a light, sampling towards it, and the densities of both.

use super::distant::Distant;
use super::environment::Environment;
use super::pattern::Pattern;
use super::punctual::PunctualIncidence;
use super::simd::LANES;
use super::source::{Emitter, EnvironmentMap, LightSample, LightSource, PunctualLight, weight};
use super::tree::{Comb, LightTree, Pick, Share};
use super::triangle::{TriangleLight, View};
use crate::geometry::{Aabb, Geometry};
use crate::math::{Color, PI, Vec2, Vec3};
use crate::sampling::unit_f32;

/// Least part of the samples that the lights at infinity and those at finite distance get where the
/// scene has both: an estimate of their power says nothing about which of them is occluded.
const MIN_SHARE: f32 = 0.2;
/// Most boxes around the emissive triangles.
const BOXES: usize = 8;
/// Marks a triangle that does not emit.
const NONE: u32 = u32::MAX;

/// The lights of a scene, immutable. All queries are deterministic and without allocation.
///
/// A light is chosen in two steps. The first decides between the lights at infinity (environment
/// and directional lights, chosen by irradiance) and those at finite distance, with fixed
/// probabilities by estimated irradiance inside the scene. The second chooses one of the latter by
/// a tree over them [Conty18, Sec. 4], which takes O(log n). Up to 16 of them are weighed one by
/// one, nearly in proportion to the irradiance that each sends to the receiver.
///
/// A receiver is a world-space point `p` and, for a surface, its unit normal `n`; lights that lie
/// wholly below the horizon of `n` are never chosen.
#[derive(Clone, Debug)]
pub struct Lights {
    tree: LightTree,
    environment: Option<Distant>,
    directional: Vec<(u32, PunctualLight)>,
    /// Probability of the lights at infinity where both groups reach the receiver.
    infinite_share: f32,
    /// For each instance, the index of each triangle among the tree's triangles or `NONE`; empty
    /// for an instance that does not emit.
    emitters: Vec<Vec<u32>>,
    /// For each of the tree's triangles, how its emission varies; empty where none does.
    patterns: Vec<Option<Pattern>>,
    /// Boxes around all emissive triangles, at most `BOXES`.
    boxes: Vec<Aabb>,
    power: Color,
}

impl Lights {
    /// Prepares the lights of a scene for sampling; `bounds` is the scene's box.
    ///
    /// Emitters without area or mean radiance and lights without power are never chosen. Emitters
    /// that name no triangle of `geometry` are ignored, as is an environment whose size
    /// contradicts its pixels.
    pub fn build(
        geometry: &Geometry, emitters: Vec<Emitter>, punctual: Vec<PunctualLight>,
        environment: Option<EnvironmentMap>, bounds: Aabb,
    ) -> Self {
        let triangles = emitters
            .into_iter()
            .filter(|e| exists(geometry, e))
            .map(|e| TriangleLight::new(geometry, e))
            .collect();
        let discs: Vec<_> = punctual.iter().filter_map(PunctualLight::disc).collect();
        let (directional, near): (Vec<_>, Vec<_>) = (0..)
            .zip(punctual)
            .filter(|(_, light)| light.disc().is_none())
            .partition(|(_, light)| matches!(light, PunctualLight::Directional { .. }));
        let directional: Vec<_> =
            directional.into_iter().filter(|(_, l)| weight(l.strength()) > 0.0).collect();
        let near_power: Color =
            near.iter().filter(|(_, l)| weight(l.strength()) > 0.0).map(|(_, l)| l.power()).sum();
        let tree = LightTree::new(triangles, near);
        let environment = Distant::new(environment.and_then(Environment::new), discs.into_iter());

        // Mean irradiance on the walls of the scene's box, as if it were convex and empty: a
        // quarter of the fluence from outside, power over area from inside.
        let finite_power =
            near_power + tree.triangles().iter().map(TriangleLight::power).sum::<Color>();
        let fluence = environment.as_ref().map_or(Color::ZERO, Distant::fluence);
        let parallel: Color = directional.iter().map(|(_, l)| l.strength()).sum();
        let size = if bounds.is_empty() { Vec3::ZERO } else { bounds.max - bounds.min };
        let walls = 2.0 * (size.x * size.y + size.y * size.z + size.z * size.x);
        // A ground plane around the scene is no wall of it.
        let walls = geometry.extent().map_or(walls, |extent| walls.min(2.0 * extent * extent));
        let outside = 0.25 * (weight(fluence) + weight(parallel));
        let share = outside / (outside + weight(finite_power) / walls);
        let share = if share.is_nan() { 0.5 } else { share.clamp(MIN_SHARE, 1.0 - MIN_SHARE) };

        let radius = 0.5 * bounds.diagonal();
        Self {
            emitters: index_emitters(geometry, tree.triangles()),
            power: finite_power + (fluence + parallel) * (PI * radius * radius),
            infinite_share: share,
            boxes: boxes(tree.triangles()),
            patterns: Vec::new(),
            tree,
            environment,
            directional,
        }
    }

    /// The lights with the knowledge of how emission is spread over triangles, given by instance
    /// and triangle. Those that do not emit are ignored.
    #[must_use]
    pub fn with_patterns(
        mut self, patterns: impl IntoIterator<Item = (u32, u32, Pattern)>,
    ) -> Self {
        for (instance, triangle, pattern) in patterns {
            if let Some(index) = self.emitter_index(instance, triangle) {
                self.patterns.resize(self.tree.triangles().len(), None);
                self.patterns[index] = Some(pattern);
            }
        }
        self
    }

    /// How the emission of one of the tree's triangles varies.
    pub(super) fn pattern(&self, index: usize) -> Option<&Pattern> {
        self.patterns.get(index)?.as_ref()
    }

    /// True if nothing emits.
    pub fn is_empty(&self) -> bool {
        self.emitter_count() == 0
            && !self.tree.has_punctual()
            && self.directional.is_empty()
            && self.environment.is_none()
    }

    /// True if light comes from all directions at infinity.
    pub fn has_environment(&self) -> bool {
        self.environment.is_some()
    }

    /// True if there are discs such as the sun's in the environment.
    pub fn has_discs(&self) -> bool {
        self.environment.as_ref().is_some_and(Distant::has_discs)
    }

    /// False only if a ray from `origin` along `direction` can meet nothing that shines, whatever
    /// is in its way.
    pub fn may_shine_along(&self, origin: Vec3, direction: Vec3) -> bool {
        let inverse = direction.recip();
        self.has_environment() || self.boxes.iter().any(|b| b.is_met(origin, inverse))
    }

    /// Number of emissive triangles that have area and radiance.
    pub fn emitter_count(&self) -> usize {
        self.tree.triangles().len()
    }

    /// The emissive triangle of that name, `None` if it does not emit.
    pub fn emitter(&self, instance: u32, triangle: u32) -> Option<&TriangleLight> {
        self.emitter_index(instance, triangle).map(|i| &self.tree.triangles()[i])
    }

    pub(super) fn emitter_index(&self, instance: u32, triangle: u32) -> Option<usize> {
        let index = *self.emitters.get(instance as usize)?.get(triangle as usize)?;
        (index != NONE).then_some(index as usize)
    }

    /// Irradiance at `p` on a surface with unit normal `n` from all emissive triangles, each taken
    /// to emit its mean radiance all over, without occlusion. Takes time in proportion to their
    /// number.
    pub fn unoccluded_irradiance(&self, p: Vec3, n: Vec3) -> Color {
        self.tree.triangles().iter().map(|t| t.emitter().radiance * t.irradiance(p, n)).sum()
    }

    /// Radiant power of all lights: π A L of each emissive face, the integrated intensity of point
    /// and spot lights, and what enters the sphere around the scene's box from the environment
    /// and from directional lights.
    pub fn power(&self) -> Color {
        self.power
    }

    /// Radiance of the environment along a unit world direction, discs such as the sun's included;
    /// zero without one.
    pub fn environment(&self, direction: Vec3) -> Color {
        self.environment.as_ref().map_or(Color::ZERO, |e| e.radiance(direction))
    }

    /// One direction towards one light; `select` in [0,1) chooses the light, `u` in [0,1)² the
    /// direction. `None` where no light can reach the receiver or the direction lies below its
    /// horizon.
    pub fn sample(&self, p: Vec3, n: Option<Vec3>, select: f32, u: Vec2) -> Option<LightSample> {
        let mut sample = None;
        let comb = Comb { offset: f64::from(select), count: 1 };
        self.distribute(p, n, comb, &mut |light, share| {
            if let Some(light) = self.prepare(light, share.probability, p, n) {
                light.sample(1, |_| u, &mut |s| sample = Some(s));
            }
        });
        sample
    }

    /// `count` samples at one receiver with much less noise than as many calls of
    /// [`Lights::sample`]: each light gets its share of the samples, rounded up or down at
    /// random, and the directions to one light are stratified. The mean over `count` of f cosθ
    /// radiance / pdf, summed over all calls of `out`, is unbiased; there may be fewer than
    /// `count` calls. Samples of one light come one after another. The same `seed` gives
    /// the same samples.
    pub fn stratified(
        &self, p: Vec3, n: Option<Vec3>, count: u32, seed: u32, out: &mut impl FnMut(LightSample),
    ) {
        let comb = Comb { offset: f64::from(unit_f32(hash(seed))), count };
        self.distribute(p, n, comb, &mut |light, share| {
            if let Some(light) = self.prepare(light, share.probability, p, n) {
                let scramble = hash(seed ^ hash(share.choices.start.wrapping_add(0x9e37_79b9)));
                let count = share.choices.len() as u32;
                light.sample(count, |i| stratified_point(i, count, scramble), out);
            }
        });
    }

    /// Density per steradian with which [`Lights::sample`] chooses the unit direction `wi`, which
    /// meets the triangle at `distance`, by way of this triangle; 0 if that does not emit
    /// towards `p`.
    pub fn pdf_triangle(
        &self, p: Vec3, n: Option<Vec3>, instance: u32, triangle: u32, wi: Vec3, distance: f32,
    ) -> f32 {
        let Some(index) = self.emitter_index(instance, triangle) else { return 0.0 };
        if below_horizon(n, wi) {
            return 0.0;
        }
        let triangle = &self.tree.triangles()[index];
        let density = triangle.pdf(p, wi, distance, self.pattern(index));
        if density <= 0.0 {
            return 0.0;
        }
        let (infinite, _) = self.infinite_probability(p, n);
        (1.0 - infinite) * self.tree.probability(p, n, Pick::Triangle(index)) * density
    }

    /// Density per steradian with which [`Lights::sample`] chooses the unit direction `wi` by way
    /// of the environment.
    pub fn pdf_environment(&self, p: Vec3, n: Option<Vec3>, wi: Vec3) -> f32 {
        let Some(environment) = &self.environment else { return 0.0 };
        if below_horizon(n, wi) {
            return 0.0;
        }
        let (infinite, total) = self.infinite_probability(p, n);
        infinite * (environment.importance(n) / total) * environment.pdf(n, wi)
    }

    pub(super) fn tree(&self) -> &LightTree {
        &self.tree
    }

    pub(super) fn directional(&self) -> &[(u32, PunctualLight)] {
        &self.directional
    }

    pub(super) fn distant(&self) -> Option<&Distant> {
        self.environment.as_ref()
    }

    pub(super) fn infinite_share(&self) -> f32 {
        self.infinite_share
    }

    fn environment_importance(&self, n: Option<Vec3>) -> f32 {
        self.environment.as_ref().map_or(0.0, |e| e.importance(n))
    }

    /// The probability of the lights at infinity, and the sum of their weights.
    pub(super) fn infinite_probability(&self, p: Vec3, n: Option<Vec3>) -> (f32, f32) {
        let total = self.environment_importance(n)
            + self.directional.iter().map(|(_, l)| l.importance(p, n)).sum::<f32>();
        if total <= 0.0 {
            (0.0, total)
        } else if self.tree.reaches(p, n) {
            (self.infinite_share, total)
        } else {
            (1.0, total)
        }
    }

    /// Distributes the choices of a comb over all lights, those at infinity first.
    fn distribute(&self, p: Vec3, n: Option<Vec3>, comb: Comb, out: &mut impl FnMut(Light, Share)) {
        let (infinite, _) = self.infinite_probability(p, n);
        let groups = comb.split(Share::all(comb), [infinite, 1.0 - infinite].into_iter());
        for (group, share) in groups {
            if group == 1 {
                self.tree.distribute(p, n, comb, share, &mut |pick, share| {
                    out(Light::Finite(pick), share)
                });
                continue;
            }
            let directional = self.directional.iter().map(|(_, l)| l.importance(p, n));
            for (i, share) in comb
                .split(share, std::iter::once(self.environment_importance(n)).chain(directional))
            {
                out(if i == 0 { Light::Environment } else { Light::Directional(i - 1) }, share);
            }
        }
    }

    /// `None` if the light turns out not to reach the receiver.
    fn prepare(
        &self, light: Light, probability: f64, p: Vec3, n: Option<Vec3>,
    ) -> Option<Prepared<'_>> {
        let kind = match light {
            Light::Environment => PreparedKind::Environment(self.environment.as_ref()?),
            Light::Finite(Pick::Triangle(index)) => {
                let view = self.tree.triangles()[index].view(p)?;
                match self.pattern(index) {
                    None => PreparedKind::Triangle(view),
                    Some(pattern) => PreparedKind::Patterned(view, pattern),
                }
            }
            Light::Finite(Pick::Punctual(index)) => {
                let (index, light) = self.tree.punctual(index);
                PreparedKind::Punctual(index, light.incidence(p)?)
            }
            Light::Directional(index) => {
                let (index, light) = &self.directional[index];
                PreparedKind::Punctual(*index, light.incidence(p)?)
            }
        };
        Some(Prepared { kind, probability: probability as f32, n })
    }
}

/// Boxes around `triangles`, which are in an order that keeps near ones together; a little larger
/// than they are, against rounding.
fn boxes(triangles: &[TriangleLight]) -> Vec<Aabb> {
    let group = |lights: &[TriangleLight]| {
        let corners =
            lights.iter().flat_map(|t| [t.corner, t.corner + t.edges[0], t.corner + t.edges[1]]);
        let tight = corners.fold(Aabb::EMPTY, Aabb::with);
        let margin =
            1e-4 * tight.diagonal() + 1e-5 * tight.min.abs().max(tight.max.abs()).max_element();
        Aabb { min: tight.min - margin, max: tight.max + margin }
    };
    triangles.chunks(triangles.len().div_ceil(BOXES).max(1)).map(group).collect()
}

/// A chosen light with what all samples of it from one receiver share.
struct Prepared<'a> {
    kind: PreparedKind<'a>,
    probability: f32,
    n: Option<Vec3>,
}

enum PreparedKind<'a> {
    Environment(&'a Distant),
    Triangle(View<'a>),
    Patterned(View<'a>, &'a Pattern),
    Punctual(u32, PunctualIncidence),
}

impl Prepared<'_> {
    /// Calls `out` for those of `count` samples, made of the points `u(i)` of the unit square, that
    /// lie above the horizon.
    #[inline]
    fn sample(&self, count: u32, u: impl Fn(u32) -> Vec2, out: &mut impl FnMut(LightSample)) {
        let mut emit = |wi, distance, radiance, density, source| {
            let pdf = self.probability * density;
            if pdf > 0.0 && !below_horizon(self.n, wi) {
                out(LightSample {
                    wi,
                    distance,
                    radiance,
                    pdf,
                    delta: matches!(source, LightSource::Punctual(_)),
                    source,
                });
            }
        };
        match &self.kind {
            PreparedKind::Environment(environment) => {
                for i in 0..count {
                    let (wi, density) = environment.sample(self.n, u(i));
                    emit(
                        wi,
                        f32::INFINITY,
                        environment.radiance(wi),
                        density,
                        LightSource::Environment,
                    );
                }
            }
            PreparedKind::Triangle(view) => {
                let &Emitter { instance, triangle, radiance, .. } = view.light.emitter();
                for first in (0..count).step_by(LANES) {
                    let used = LANES.min((count - first) as usize);
                    let points = view.sample(std::array::from_fn(|lane| {
                        if lane < used { u(first + lane as u32) } else { Vec2::ZERO }
                    }));
                    for point in (0..used).filter_map(|lane| points.get(lane)) {
                        let [u, v] = point.barycentric;
                        emit(
                            point.wi,
                            point.distance,
                            radiance,
                            point.pdf,
                            LightSource::Triangle { instance, triangle, u, v },
                        );
                    }
                }
            }
            PreparedKind::Patterned(view, pattern) => {
                let &Emitter { instance, triangle, radiance, .. } = view.light.emitter();
                for point in (0..count).filter_map(|i| view.sample_pattern(pattern, u(i))) {
                    let [u, v] = point.barycentric;
                    let source = LightSource::Triangle { instance, triangle, u, v };
                    emit(point.wi, point.distance, radiance, point.pdf, source);
                }
            }
            PreparedKind::Punctual(index, incidence) => {
                for _ in 0..count {
                    emit(
                        incidence.wi,
                        incidence.distance,
                        incidence.irradiance,
                        1.0,
                        LightSource::Punctual(*index),
                    );
                }
            }
        }
    }
}

/// A chosen light.
#[derive(Clone, Copy)]
enum Light {
    Environment,
    /// Index into `Lights::directional`.
    Directional(usize),
    Finite(Pick),
}

fn below_horizon(n: Option<Vec3>, wi: Vec3) -> bool {
    n.is_some_and(|n| n.dot(wi) <= 0.0)
}

fn exists(geometry: &Geometry, emitter: &Emitter) -> bool {
    let mesh = geometry
        .instances
        .get(emitter.instance as usize)
        .and_then(|i| geometry.meshes.get(i.mesh as usize));
    mesh.is_some_and(|mesh| (emitter.triangle as usize) < mesh.indices.len())
}

fn index_emitters(geometry: &Geometry, triangles: &[TriangleLight]) -> Vec<Vec<u32>> {
    let mut emitters = vec![Vec::new(); geometry.instances.len()];
    for (index, triangle) in (0..).zip(triangles) {
        let Emitter { instance, triangle, .. } = *triangle.emitter();
        let entries = &mut emitters[instance as usize];
        if entries.is_empty() {
            let mesh = geometry.instances[instance as usize].mesh;
            entries.resize(geometry.meshes[mesh as usize].indices.len(), NONE);
        }
        entries[triangle as usize] = index;
    }
    emitters
}

/// Point `i` of `count` in [0,1)²: jittered along x, a randomly permuted base 2 sequence along y
/// (Hammersley's set with the nested scrambling of [Laine11, Sec. 3]).
fn stratified_point(i: u32, count: u32, scramble: u32) -> Vec2 {
    let x = (i as f32 + unit_f32(hash(scramble ^ i.wrapping_mul(0x85eb_ca6b)))) / count as f32;
    let mut y = i.wrapping_add(hash(!scramble));
    for multiplier in [0x6c50_b47c, 0xb82f_1e52, 0xc7af_e638, 0x8d22_f6e6_u32] {
        y ^= y.wrapping_mul(multiplier);
    }
    Vec2::new(x.min(ONE_BELOW), unit_f32(y.reverse_bits()))
}

const ONE_BELOW: f32 = 1.0 - f32::EPSILON / 2.0;

/// Mixes 32 bits.
fn hash(mut x: u32) -> u32 {
    x = (x ^ (x >> 16)).wrapping_mul(0x7feb_352d);
    x = (x ^ (x >> 15)).wrapping_mul(0x846c_a68b);
    x ^ (x >> 16)
}
