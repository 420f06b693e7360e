//! A scene ready for rays.

use super::emitters::emitters;
use super::{SceneData, joined};
use crate::accel::{Accel, Backend, Coherence, Hit, Ray};
use crate::camera::{Camera, Motion};
use crate::error::{Error, Result};
use crate::geometry::{Aabb, Geometry, MAP_ROUNDING, SurfacePoint, interpolate};
use crate::light::{EmissionSampler, EnvironmentMap, Focus, LightSample, LightSource, Lights};
use crate::material::tables::TableStore;
use crate::material::{Bsdf, Material};
use crate::math::{Color, Vec3};
use crate::sampling::{hash, unit_f32};
use crate::texture::Texture;
use glam::DVec3;
use std::collections::BTreeMap;

/// A scene with its ray tracing structure and light sampling; immutable and shared by all threads.
pub struct Scene {
    origin: DVec3,
    geometry: Geometry,
    materials: Vec<Material>,
    textures: Vec<Texture>,
    cameras: Vec<Camera>,
    motions: Vec<Option<Motion>>,
    hashes: BTreeMap<String, String>,
    lights: Lights,
    accel: Accel,
    bounds: Aabb,
    /// For each material: rays may pass through it by its alpha.
    see_through: Vec<bool>,
    any_see_through: bool,
    /// For each material: it may pass light as an ideal pane.
    panes: Vec<bool>,
    /// What rays meet of such materials; `None` if there are none.
    pane_accel: Option<Accel>,
    tables: TableStore,
}

/// Layers of alpha after which a ray is taken to be blocked: more than any wood has.
const MAX_LAYERS: usize = 1 << 16;
/// A ray between two points ends this share of its length before the second: the rounding of its
/// direction and of the distance at which it is hit.
pub(super) const SHORTENING: f32 = 32.0 * f32::EPSILON;
/// Largest diagonal of a scene: squares of distances in it are numbers still.
const LARGEST: f32 = 1e18;
/// Radiance of the dome that lights a scene without any light.
const DOME: Color = Color::splat(0.8);

impl Scene {
    /// Builds the ray tracing structure and the light sampling of `data`.
    ///
    /// A scene without any light gets a neutral dome. The returned lines tell the user of that and
    /// of what the importer noticed.
    ///
    /// # Errors
    /// Those of the ray tracing back end; [`Error::InvalidArgument`] for a scene whose diagonal is
    /// longer than 1e18 units.
    pub fn new(data: SceneData, backend: Backend) -> Result<(Self, Vec<String>)> {
        let hashes = data.hashes();
        let SceneData {
            origin,
            geometry,
            materials,
            textures,
            punctual,
            mut environment,
            cameras,
            motions,
            mut warnings,
        } = data;
        let bounds = geometry.bounds();
        let reach = bounds.diagonal();
        if reach > LARGEST {
            let what = format!("the scene reaches over {reach:e} units, more than {LARGEST:e}");
            return Err(Error::InvalidArgument(what));
        }
        let accel = Accel::build(&geometry, backend)?;
        let (emitters, patterns) = emitters(&geometry, &materials, &textures);
        let unlit_only = !materials.is_empty() && materials.iter().all(|m| m.unlit);
        if emitters.is_empty() && punctual.is_empty() && environment.is_none() && !unlit_only {
            warnings.push("the scene has no light: a neutral dome lights it".to_owned());
            environment = Some(EnvironmentMap::constant(DOME));
        }
        let lights = Lights::build(&geometry, emitters, punctual, environment, bounds)
            .with_patterns(patterns);
        let see_through: Vec<bool> = materials.iter().map(|m| !m.is_opaque()).collect();
        let any_see_through = see_through.contains(&true);
        let panes: Vec<bool> = materials.iter().map(Material::may_be_pane).collect();
        let glass = geometry.of_materials(|material| panes[material as usize]);
        let is_there = !glass.instances.is_empty();
        let pane_accel = is_there.then(|| Accel::build(&glass, backend)).transpose()?;
        let scene = Self {
            origin,
            geometry,
            materials,
            textures,
            cameras,
            motions,
            hashes,
            lights,
            accel,
            bounds,
            see_through,
            any_see_through,
            panes,
            pane_accel,
            tables: TableStore::default(),
        };
        Ok((scene, warnings))
    }

    /// The scene with its materials' tables kept in `tables` between runs; without this call they
    /// live in memory alone.
    pub fn with_tables(self, tables: TableStore) -> Self {
        Self { tables, ..self }
    }

    /// Where the tables of the materials are kept.
    pub fn tables(&self) -> &TableStore {
        &self.tables
    }

    /// Where the zero of the scene's coordinates lies in the world: a scene far from there is kept
    /// around its own middle.
    pub fn origin(&self) -> DVec3 {
        self.origin
    }

    /// A position of the scene in the world.
    pub fn to_world(&self, position: Vec3) -> Vec3 {
        (position.as_dvec3() + self.origin).as_vec3()
    }

    /// A position of the world in the scene.
    pub fn from_world(&self, position: Vec3) -> Vec3 {
        (position.as_dvec3() - self.origin).as_vec3()
    }

    /// Meshes and instances.
    pub fn geometry(&self) -> &Geometry {
        &self.geometry
    }

    /// The cameras of the file.
    pub fn cameras(&self) -> &[Camera] {
        &self.cameras
    }

    /// How the cameras move: [`SceneData::motions`].
    pub fn motions(&self) -> &[Option<Motion>] {
        &self.motions
    }

    /// [`SceneData::hashes`] of the data that the scene was built from.
    pub fn hashes(&self) -> &BTreeMap<String, String> {
        &self.hashes
    }

    /// [`SceneData::hash`] of the data that the scene was built from.
    pub fn hash(&self) -> String {
        joined(&self.hashes)
    }

    /// The light sources.
    pub fn lights(&self) -> &Lights {
        &self.lights
    }

    /// Starts of light paths; most of those from infinity are aimed at `focus`.
    pub fn emission_sampler(&self, focus: Option<Focus>) -> EmissionSampler<'_> {
        EmissionSampler::new(&self.lights, self.bounds).aimed_at(focus)
    }

    /// The ray tracing structure.
    pub fn accel(&self) -> &Accel {
        &self.accel
    }

    /// World-space bounds.
    pub fn bounds(&self) -> Aabb {
        self.bounds
    }

    /// Length of the diagonal of the bounds; 1 for an empty scene.
    pub fn size(&self) -> f32 {
        let d = self.bounds.diagonal();
        if d > 0.0 { d } else { 1.0 }
    }

    /// The materials, by the numbers that surface points have.
    pub fn materials(&self) -> &[Material] {
        &self.materials
    }

    /// The material at a surface point.
    #[inline]
    pub fn material(&self, at: &SurfacePoint) -> &Material {
        &self.materials[at.material as usize]
    }

    /// True if the material may pass light as an ideal pane: [`Material::may_be_pane`].
    #[inline]
    pub fn is_pane(&self, material: u32) -> bool {
        self.panes[material as usize]
    }

    /// True if any material may pass light as an ideal pane.
    #[inline]
    pub fn has_panes(&self) -> bool {
        self.pane_accel.is_some()
    }

    /// True if a ray meets anything that may pass light as an ideal pane, even behind something
    /// else.
    #[inline]
    pub(super) fn meets_pane(&self, ray: &Ray) -> bool {
        self.pane_accel.as_ref().is_some_and(|accel| accel.occluded(ray))
    }

    /// Radiance emitted at `at` towards `at.wo`.
    #[inline]
    pub fn emission(&self, at: &SurfacePoint) -> Color {
        self.material(at).emission_at(&self.textures, at)
    }

    /// True if the light that an instance sends may vary over its triangles.
    #[inline]
    fn emission_varies(&self, instance: u32) -> bool {
        let mesh = self.geometry.instances[instance as usize].mesh;
        let material = &self.materials[self.geometry.meshes[mesh as usize].material as usize];
        material.emission_texture.is_some() || !material.is_opaque()
    }

    /// Radiance that `source` sends against the direction `dir`, along which it is looked at, where
    /// `mean` is that of the whole light: what alpha does not stop does not shine.
    #[inline]
    pub fn sent(&self, source: LightSource, mean: Color, dir: Vec3) -> Color {
        match source {
            LightSource::Triangle { instance, triangle, u, v }
                if self.emission_varies(instance) =>
            {
                let at = interpolate(&self.geometry, instance, triangle, u, v, dir);
                self.emission(&at) * self.material(&at).opacity(&self.textures, &at)
            }
            _ => mean,
        }
    }

    /// The BSDF at `at`; the shading frame is set to that of the normal map.
    #[inline]
    pub fn shade(&self, at: &mut SurfacePoint) -> Bsdf {
        self.materials[at.material as usize].shade(&self.textures, at)
    }

    /// What is left of radiance that travelled `distance` to the surface `at`: less than 1 inside
    /// an absorbing solid, whose surface is seen from behind.
    #[inline]
    pub fn transmittance(&self, at: &SurfacePoint, distance: f32) -> Color {
        if !at.back_face {
            return Color::ONE;
        }
        let attenuation = self.material(at).attenuation();
        if attenuation == Color::ZERO { Color::ONE } else { (-attenuation * distance).exp() }
    }

    /// The surface point of a hit, seen along `dir`.
    #[inline]
    pub fn surface(&self, hit: &Hit, dir: Vec3) -> SurfacePoint {
        let mut point = interpolate(&self.geometry, hit.instance, hit.triangle, hit.u, hit.v, dir);
        if self.accel.is_shared(hit.instance) {
            let map = &self.geometry.instances[hit.instance as usize].to_world;
            point.error += MAP_ROUNDING
                * (point.position.abs().max_element() + map.translation.abs().max_element());
        }
        point
    }

    /// The ray from a surface point towards the unit direction `dir`.
    #[inline]
    pub fn spawn(&self, at: &SurfacePoint, dir: Vec3) -> Ray {
        Ray { origin: at.leave(dir), tmin: 0.0, dir, tmax: f32::INFINITY }
    }

    /// The ray from `at` to the point at `distance` along the unit direction `dir`, where the
    /// distance is that from the point itself, not from where the ray starts; it ends `gap` before.
    pub fn segment(&self, at: &SurfacePoint, dir: Vec3, distance: f32, gap: f32) -> Ray {
        let ray = self.spawn(at, dir);
        if distance.is_infinite() {
            return ray;
        }
        let way = dir * distance - (ray.origin - at.position);
        let length = way.length();
        if length <= gap {
            return Ray { tmax: 0.0, ..ray };
        }
        Ray { dir: way / length, tmax: (length - gap) * (1.0 - SHORTENING), ..ray }
    }

    /// The ray that tests whether two surface points see each other.
    pub fn between(&self, from: &SurfacePoint, to: &SurfacePoint) -> Ray {
        let offset = to.position - from.position;
        let distance = offset.length();
        let dir = offset / distance.max(f32::MIN_POSITIVE);
        self.segment(from, dir, distance, gap(to.error, to.ng.dot(dir), distance))
    }

    /// What a ray sees first, with surfaces that alpha lets it pass left out; `seed` decides at
    /// partly transparent ones. Returns the distance too.
    pub fn intersect(&self, ray: &Ray, seed: u64) -> Option<(SurfacePoint, f32)> {
        self.resolve(ray, self.accel.intersect(ray), seed)
    }

    /// As [`Scene::intersect`], where the first hit on any surface is known.
    #[inline]
    pub fn resolve(&self, ray: &Ray, hit: Hit, seed: u64) -> Option<(SurfacePoint, f32)> {
        if !hit.is_hit() {
            return None;
        }
        let point = self.surface(&hit, ray.dir);
        if !self.any_see_through || !self.passes(&point, &hit, seed) {
            return Some((point, hit.t));
        }
        self.pass_layers(ray, point, seed)
    }

    /// Goes on behind the see-through surface at `point`.
    #[cold]
    fn pass_layers(
        &self, ray: &Ray, mut point: SurfacePoint, seed: u64,
    ) -> Option<(SurfacePoint, f32)> {
        for _ in 0..MAX_LAYERS {
            let mut next = self.spawn(&point, ray.dir);
            let travelled = (next.origin - ray.origin).dot(ray.dir);
            next.tmax = ray.tmax - travelled;
            let hit = if next.tmax > 0.0 { self.accel.intersect(&next) } else { Hit::MISS };
            if !hit.is_hit() {
                return None;
            }
            point = self.surface(&hit, ray.dir);
            if !self.passes(&point, &hit, seed) {
                return Some((point, travelled + hit.t));
            }
        }
        None
    }

    /// True if alpha lets the ray with `seed` through the surface.
    fn passes(&self, at: &SurfacePoint, hit: &Hit, seed: u64) -> bool {
        if !self.see_through[at.material as usize] {
            return false;
        }
        let opacity = self.material(at).opacity(&self.textures, at);
        opacity < 1.0 && {
            let place = (u64::from(hit.instance) << 32) | u64::from(hit.triangle);
            let word = hash(&[seed, place, u64::from(hit.u.to_bits())]);
            unit_f32(word as u32) >= opacity
        }
    }

    /// The ray that tests whether `light` reaches `at`.
    #[inline]
    pub fn shadow_ray(&self, at: &SurfacePoint, light: &LightSample) -> Ray {
        let gap = match light.source {
            LightSource::Triangle { instance, triangle, .. } => self
                .lights
                .emitter(instance, triangle)
                .map_or(0.0, |lamp| gap(lamp.error(), lamp.normal().dot(light.wi), light.distance)),
            LightSource::Environment | LightSource::Punctual(_) => 0.0,
        };
        self.segment(at, light.wi, light.distance, gap)
    }

    /// True if something opaque, or something that stochastic alpha makes so, lies on the ray.
    pub fn occluded(&self, ray: &Ray, seed: u64) -> bool {
        self.accel.occluded(ray) && (!self.any_see_through || self.intersect(ray, seed).is_some())
    }

    /// [`Scene::occluded`] of many rays. Each ray's own numbers decide at partly transparent
    /// surfaces, so the answers do not depend on the company it is in.
    pub fn occluded_many(&self, rays: &[Ray], blocked: &mut [bool]) {
        self.accel.occluded_many(rays, blocked);
        if self.any_see_through {
            for (ray, blocked) in rays.iter().zip(blocked).filter(|(_, blocked)| **blocked) {
                *blocked = self.intersect(ray, Self::seed_of(ray)).is_some();
            }
        }
    }

    /// A seed that a ray's own numbers make.
    pub(super) fn seed_of(ray: &Ray) -> u64 {
        let bits = |v: Vec3| v.to_array().map(|x| u64::from(x.to_bits()));
        let ([a, b, c], [d, e, f]) = (bits(ray.origin), bits(ray.dir));
        hash(&[a, b, c, d, e, f])
    }

    /// First hits of many rays on any surface; [`Scene::resolve`] takes alpha into account.
    pub fn intersect_many(&self, rays: &[Ray], coherence: Coherence, hits: &mut [Hit]) {
        self.accel.intersect_many(rays, coherence, hits);
    }
}

/// How far before a surface a ray ends that meets it under the cosine `cos` and must not hit it,
/// where the surface may be off by `error` along its normal; at most half of the way.
pub fn gap(error: f32, cos: f32, distance: f32) -> f32 {
    (error / cos.abs().max(f32::MIN_POSITIVE)).min(0.5 * distance)
}
