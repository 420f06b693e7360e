//! Joining the walks: what every pair of prefixes contributes.

use super::vertex::{Scattering, Vertex};
use super::walk::{Escape, hit_density};
use super::weight::{Density, LightDensity, weight};
use super::{Bidirectional, Splat, Workspace};
use crate::accel::Ray;
use crate::light::{LightEnd, LightSample, LightSource, TriangleLight};
use crate::math::{Color, Vec3};
use crate::sampling::hash;
use crate::transport::path::Reflected;
use crate::transport::{CameraSample, Radiance};

/// Both walks joined in one way.
pub(super) struct Link {
    /// What the path brings, before its weight and occlusion, by the two parts of the surface that
    /// the camera sees.
    pub light: Reflected,
    /// Densities of the light's end.
    pub end: LightDensity,
    /// Densities that the joint decides, per area: of the last light vertex and the one before it
    /// for the camera's walk, of the last camera vertex and the one before it for the light's.
    pub light_side: [f64; 2],
    pub camera_side: [f64; 2],
    /// What must be free.
    pub ray: Option<Ray>,
    /// Where the path falls in the image, for a light path that the camera sees.
    pub pixel: Option<u32>,
}

impl Bidirectional<'_> {
    /// Adds up all ways to join the walks.
    pub(super) fn connect(
        &self, sample: &CameraSample, work: &mut Workspace, radiance: &mut Radiance,
        splats: &mut Vec<Splat>,
    ) {
        let seed = sample.alpha_seed();
        let (seen, lit) = (work.seen.vertices.len(), work.lit.vertices.len());
        let most = self.most_surfaces();
        // What the camera sees without any scattering has one way only.
        match (work.seen.vertices.first(), work.seen.escaped) {
            (Some(first), _) => radiance.emission = self.tracer.scene.emission(&first.vertex.point),
            (None, Some(escape)) => {
                radiance.emission = self.tracer.scene.lights().environment(escape.direction)
            }
            (None, None) => {}
        }
        // With t vertices from the camera, itself among them; t = seen + 2 is a path that left the
        // scene.
        for t in 1..=seen + 2 {
            for s in 0..=lit + 1 {
                let scattering = if s == 0 { t.saturating_sub(2) } else { s + t - 2 };
                // Light samples pass panes, which count for no other way then.
                let surfaces = scattering - panes(work, s, t);
                if surfaces == 0 || surfaces > most || (s > 0 && t > seen + 1) {
                    continue;
                }
                let Some(link) = self.link(work, s, t) else { continue };
                let (scene, seed) = (self.tracer.scene, hash(&[seed, s as u64, t as u64]));
                let visible = match &link.ray {
                    Some(ray) if s == 1 => scene.visibility(ray, seed),
                    Some(ray) if scene.occluded(ray, seed) => Color::ZERO,
                    _ => Color::ONE,
                };
                if visible == Color::ZERO {
                    continue;
                }
                let share = self.weigh(work, &link, s, t) as f32;
                let light = link.light.scaled(visible * share);
                if !light.sum().is_finite() {
                    continue;
                }
                let direct = surfaces == 1;
                match link.pixel {
                    None if direct => {
                        radiance.diffuse_direct += light.diffuse;
                        radiance.glossy_direct += light.glossy;
                    }
                    None => {
                        radiance.diffuse_indirect += light.diffuse;
                        radiance.glossy_indirect += light.glossy;
                    }
                    Some(pixel) => {
                        // Parts 0 and 2 are direct, 1 and 3 indirect.
                        let first = u8::from(!direct);
                        let parts = [(first, light.diffuse), (first + 2, light.glossy)];
                        let parts = parts.into_iter().filter(|(_, light)| *light != Color::ZERO);
                        splats.extend(parts.map(|(part, light)| Splat { pixel, part, light }));
                    }
                }
            }
        }
    }

    /// The way with `s` vertices from the light and `t` from the camera; `None` where it brings
    /// nothing.
    pub(super) fn link(&self, work: &Workspace, s: usize, t: usize) -> Option<Link> {
        match (s, t) {
            (0, 0..=2) | (1, 1) => None,
            (0, _) => self.hit(work, t),
            (1, _) => self.sample_light(work, t),
            (_, 1) => self.see(work, s),
            _ => self.join(work, s, t),
        }
    }

    /// The camera path hits a lamp, or the environment.
    fn hit(&self, work: &Workspace, t: usize) -> Option<Link> {
        let path = &work.seen;
        let last = &path.vertices.get(t - 3 - panes(work, 0, t))?.vertex;
        let (end, emitted, carried, hit, direction) = match path.vertices.get(t - 2) {
            Some(lamp) => {
                let point = &lamp.vertex.point;
                let source = LightSource::Triangle {
                    instance: point.instance,
                    triangle: point.triangle,
                    u: 0.0,
                    v: 0.0,
                };
                let end = LightEnd {
                    source,
                    position: point.position,
                    normal: point.ng,
                    distant: false,
                    delta: false,
                };
                let hit = lamp.straight.map_or(lamp.vertex.forward, |straight| {
                    hit_density(&end, straight.density, last.point.position)
                });
                (end, self.tracer.scene.emission(point), lamp.arrived, hit, point.wo)
            }
            None => {
                let Escape { direction, density, carried, straight } =
                    path.escaped.filter(|_| t == path.vertices.len() + 2)?;
                let density = straight.map_or(density, |straight| f64::from(straight.density));
                let end = LightEnd {
                    source: LightSource::Environment,
                    position: Vec3::ZERO,
                    normal: Vec3::ZERO,
                    distant: true,
                    delta: false,
                };
                (
                    end,
                    self.tracer.scene.lights().environment(direction),
                    carried,
                    density,
                    -direction,
                )
            }
        };
        if emitted == Color::ZERO {
            return None;
        }
        let origin = last.site().origin();
        let lights = self.tracer.scene.lights();
        let sampled = match end.source {
            LightSource::Triangle { instance, triangle, .. } => {
                let offset = end.position - origin.position;
                let distance = offset.length();
                let towards = if panes(work, 0, t) > 0 { offset / distance } else { -direction };
                let pdf = lights.pdf_triangle(
                    origin.position,
                    origin.facing,
                    instance,
                    triangle,
                    towards,
                    distance,
                );
                hit_density(&end, pdf, origin.position)
            }
            _ => f64::from(lights.pdf_environment(origin.position, origin.facing, -direction)),
        };
        let density = LightDensity {
            hit,
            sampled,
            emitted: f64::from(self.emission.end_density(&end, direction)),
        };
        Some(Link {
            light: first_parts(work, emitted * carried),
            end: density,
            light_side: [0.0; 2],
            camera_side: [self.ray_density(last, &end, direction), 0.0],
            ray: None,
            pixel: None,
        })
    }

    /// Density per area of a surface vertex for a light path that starts at `end` along
    /// `direction`.
    fn ray_density(&self, vertex: &Vertex, end: &LightEnd, direction: Vec3) -> f64 {
        let density = self.emission.ray_density(end, direction, vertex.point.position);
        if end.distant {
            vertex.per_area_of_parallel(density, direction)
        } else {
            vertex.per_area(density, end.position)
        }
    }

    /// Light sampling at a camera vertex.
    fn sample_light(&self, work: &Workspace, t: usize) -> Option<Link> {
        let seen = work.seen.vertices.get(t - 2)?;
        let v = &seen.vertex;
        if !v.is_open() || self.tracer.scene.lights().is_empty() {
            return None;
        }
        let origin = v.site().origin();
        let light = self.tracer.scene.lights().sample(
            origin.position,
            origin.facing,
            seen.choice.0,
            seen.choice.1,
        )?;
        if !v.agrees(light.wi) {
            return None;
        }
        let scattering = v.of_camera_path(light.wi);
        let radiance = self.tracer.scene.sent(light.source, light.radiance, light.wi);
        let brought = radiance * (v.point.frame.n.dot(light.wi).abs() / light.pdf);
        let light_parts = self.parts(work, t, &scattering, brought)?;
        let end = self.end_of(&light, v);
        let density = LightDensity {
            hit: hit_density(&end, scattering.to_light, v.point.position),
            sampled: if end.delta {
                f64::from(light.pdf)
            } else {
                hit_density(&end, light.pdf, v.point.position)
            },
            emitted: f64::from(self.emission.end_density(&end, -light.wi)),
        };
        Some(Link {
            light: light_parts,
            end: density,
            light_side: [0.0; 2],
            camera_side: [
                self.ray_density(v, &end, -light.wi),
                self.before_camera(work, t, v.camera_density(light.wi)),
            ],
            ray: Some(self.tracer.scene.shadow_ray(&v.point, &light)),
            pixel: None,
        })
    }

    /// The end of a path on a sampled light.
    fn end_of(&self, light: &LightSample, from: &Vertex) -> LightEnd {
        let distant = light.distance.is_infinite();
        let position =
            if distant { Vec3::ZERO } else { from.point.position + light.wi * light.distance };
        let normal = match light.source {
            LightSource::Triangle { instance, triangle, .. } => {
                let normal = self
                    .tracer
                    .scene
                    .lights()
                    .emitter(instance, triangle)
                    .map_or(Vec3::ZERO, TriangleLight::normal);
                if normal.dot(light.wi) > 0.0 { -normal } else { normal }
            }
            LightSource::Environment | LightSource::Punctual(_) => Vec3::ZERO,
        };
        LightEnd { source: light.source, position, normal, distant, delta: light.delta }
    }

    /// The camera sees a light path's last vertex.
    fn see(&self, work: &Workspace, s: usize) -> Option<Link> {
        let v = work.lit.vertices.get(s - 2).filter(|v| v.is_open())?;
        let view = self.camera.view(v.point.position, self.size)?;
        let [x0, y0, x1, y1] = self.window;
        let (x, y) = (view.raster.x, view.raster.y);
        let inside = x >= x0 as f32 && x < x1 as f32 && y >= y0 as f32 && y < y1 as f32;
        if !inside || !v.agrees(view.to_camera) {
            return None;
        }
        let pixel = (y as u32 - y0) * (x1 - x0) + (x as u32 - x0);
        let scattering = v.of_light_path(self.tracer.scene, view.to_camera);
        let factor = v.light_cosine(view.to_camera) * view.pixels_per_area / self.pixels() as f32;
        let light = scattering.scaled(v.beta * factor);
        if light.sum() == Color::ZERO {
            return None;
        }
        let made =
            f64::from(view.pixels_per_area * v.point.ng.dot(view.to_camera).abs()) / self.pixels();
        let (end, before) = self.before_light(work, s, scattering.to_light);
        let ray = self.tracer.scene.segment(&v.point, view.to_camera, view.clear, 0.0);
        Some(Link {
            light,
            end,
            light_side: [made, before],
            camera_side: [0.0; 2],
            ray: Some(ray),
            pixel: Some(pixel),
        })
    }

    /// A ray joins the last vertices of both walks.
    fn join(&self, work: &Workspace, s: usize, t: usize) -> Option<Link> {
        let y = work.lit.vertices.get(s - 2).filter(|v| v.is_open())?;
        let z = &work.seen.vertices.get(t - 2).filter(|v| v.vertex.is_open())?.vertex;
        let offset = y.point.position - z.point.position;
        let squared = offset.length_squared();
        let distance = squared.sqrt();
        let wi = offset / distance;
        if !wi.is_finite() || !z.agrees(wi) || !y.agrees(-wi) {
            return None;
        }
        let at_camera = z.of_camera_path(wi);
        if at_camera.f == Color::ZERO {
            return None;
        }
        let at_light = y.of_light_path(self.tracer.scene, -wi);
        let geometry = y.light_cosine(-wi) * z.point.frame.n.dot(wi).abs() / squared;
        let brought =
            y.beta * at_light.f * geometry * y.transmittance(self.tracer.scene, -wi, distance);
        let light = self.parts(work, t, &at_camera, brought)?;
        let (end, before) = self.before_light(work, s, at_light.to_light);
        Some(Link {
            light,
            end,
            light_side: [y.per_area(at_camera.to_light, z.point.position), before],
            camera_side: [
                z.per_area(y.onward(-wi), y.point.position),
                self.before_camera(work, t, z.camera_density(wi)),
            ],
            ray: Some(self.tracer.scene.between(&z.point, &y.point)),
            pixel: None,
        })
    }

    /// What `brought` becomes at the last of `t` camera vertices and on the way to the camera;
    /// `None` for nothing.
    fn parts(
        &self, work: &Workspace, t: usize, scattering: &Scattering, brought: Color,
    ) -> Option<Reflected> {
        let carried = work.seen.vertices[t - 2].vertex.beta;
        let light = if t == 2 {
            scattering.scaled(brought * carried)
        } else {
            first_parts(work, scattering.f * brought * carried)
        };
        (light.sum() != Color::ZERO).then_some(light)
    }

    /// Density per area of the last but one of `t` camera vertices for a light path that samples
    /// with `density` at the last.
    fn before_camera(&self, work: &Workspace, t: usize, density: f32) -> f64 {
        if t < 3 {
            return 0.0;
        }
        let [before, last] = [t - 3, t - 2].map(|i| &work.seen.vertices[i].vertex);
        before.per_area(density, last.point.position)
    }

    /// The densities of the light's end, and of the last but one of `s` light vertices where that
    /// is a surface, for a camera path that samples with `density` at the last.
    fn before_light(&self, work: &Workspace, s: usize, density: f32) -> (LightDensity, f64) {
        let path = &work.lit;
        let last = path.vertices[s - 2].point.position;
        let panes = path.panes(s - 1);
        let Some(end) = path.end.filter(|_| s == 2 || panes > 0) else {
            return (path.density, path.vertices[s - 3].per_area(density, last));
        };
        let behind = &path.vertices[panes];
        let (back, before) = match s.checked_sub(3).filter(|before| *before >= panes) {
            None => (density, 0.0),
            Some(before) => (path.back, path.vertices[before].per_area(density, last)),
        };
        let sampled =
            if panes > 0 { self.sampled_density(behind, &end) } else { path.density.sampled };
        let hit = hit_density(&end, back, behind.point.position);
        (LightDensity { hit, sampled, ..path.density }, before)
    }

    /// The weight of a way.
    pub(super) fn weigh(&self, work: &mut Workspace, link: &Link, s: usize, t: usize) -> f64 {
        self.collect(work, link, s, t);
        let panes = if s > 1 { work.lit.panes(s - 1) } else { 0 };
        weight(&link.end, &work.densities, s - panes)
    }

    /// Puts the densities of all vertices but the light's end into `work`, in order from there.
    pub(super) fn collect(&self, work: &mut Workspace, link: &Link, s: usize, t: usize) {
        let skipped = panes(work, s, t);
        let Workspace { seen, lit, densities } = work;
        densities.clear();
        for i in if s > 1 { skipped + 1 } else { 1 }..s {
            let v = &lit.vertices[i - 1];
            let from_camera = match s - 1 - i {
                0 => link.light_side[0],
                1 => link.light_side[1],
                _ => v.backward,
            };
            densities.push(Density {
                from_light: if i == skipped + 1 { lit.forward(skipped) } else { v.forward },
                from_camera,
                open: i == s - 1 || !v.delta,
            });
        }
        // Without vertices from the light, the last camera vertex is the light's end.
        let last = if s == 0 { t - 2 - skipped } else { t - 1 };
        for j in (1..=last).rev() {
            let v = &seen.vertices[j - 1].vertex;
            let from_light = match last - j {
                0 => link.camera_side[0],
                1 if s > 0 => link.camera_side[1],
                _ => v.backward,
            };
            densities.push(Density {
                from_light,
                from_camera: v.forward,
                open: (s > 0 && j == last) || !v.delta,
            });
        }
        densities.push(Density { from_light: 1.0, from_camera: 1.0, open: true });
    }
}

/// The number of panes on a path next to its light which light samples pass as if they were not
/// there.
fn panes(work: &Workspace, s: usize, t: usize) -> usize {
    match s {
        0 => {
            let path = &work.seen;
            let straight = match path.vertices.get(t.wrapping_sub(2)) {
                Some(lamp) => lamp.straight,
                None => path.escaped.and_then(|escape| escape.straight),
            };
            straight.map_or(0, |straight| straight.panes)
        }
        1 => 0,
        _ => work.lit.panes(s - 1),
    }
}

/// Light that arrives at the first vertex from the second, by the parts of the first.
fn first_parts(work: &Workspace, light: Color) -> Reflected {
    let (diffuse, glossy) = work.seen.first;
    Reflected { diffuse: diffuse * light, glossy: glossy * light }
}
