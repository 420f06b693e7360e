//! The vertices of both walks, and scattering there in either direction.

use crate::geometry::SurfacePoint;
use crate::material::Bsdf;
use crate::math::{Color, Frame, INV_PI, Vec3};
use crate::scene::Scene;
use crate::transport::path::Reflected;
use crate::transport::vertex::Vertex as Site;

/// Below this cosine with the viewer a shading normal may have been bent towards it.
const BENT_COS: f32 = 5e-3;

/// A surface vertex of a walk, as seen from where the walk came from.
#[derive(Clone, Copy)]
pub(super) struct Vertex {
    /// The point before shading turned its frame.
    raw: SurfacePoint,
    /// The point; `point.wo` leads back along the walk.
    pub point: SurfacePoint,
    pub bsdf: Bsdf,
    /// What the walk carries on arrival: flux for a light path, importance for a camera path.
    pub beta: Color,
    /// Density per area with which its own walk made it.
    pub forward: f64,
    /// Density per area with which the opposite walk, coming from its successor, would make it.
    pub backward: f64,
    /// The walk went on in a single direction.
    pub delta: bool,
}

/// Scattering from one direction into another.
#[derive(Clone, Copy)]
pub(super) struct Scattering {
    /// `f` for light on its way to the camera.
    pub f: Color,
    /// The part of `f` that the diffuse lobe has.
    pub diffuse: Color,
    /// Density per steradian with which a camera path samples the direction towards the light.
    pub to_light: f32,
}

impl Scattering {
    fn new(bsdf: &Bsdf, frame: &Frame, towards_camera: Vec3, towards_light: Vec3) -> Self {
        let (wo, wi) = (frame.to_local(towards_camera), frame.to_local(towards_light));
        let (f, to_light) = bsdf.f_pdf(wo, wi);
        let lambert = wo.z > 0.0 && wi.z > 0.0 && bsdf.has_diffuse();
        let diffuse = if lambert { (bsdf.diffuse_albedo(wo) * INV_PI).min(f) } else { Color::ZERO };
        Self { f, diffuse, to_light }
    }

    /// Both parts times `factor`.
    pub fn scaled(&self, factor: Color) -> Reflected {
        Reflected { diffuse: self.diffuse * factor, glossy: (self.f - self.diffuse) * factor }
    }
}

impl Vertex {
    /// A vertex at `raw`, shaded.
    pub fn new(scene: &Scene, raw: SurfacePoint, beta: Color, forward: f64) -> Self {
        let mut point = raw;
        let bsdf = scene.shade(&mut point);
        Self { raw, point, bsdf, beta, forward, backward: 0.0, delta: false }
    }

    /// The vertex as the path tracer has it.
    pub fn site(&self) -> Site {
        Site { point: self.point, bsdf: self.bsdf }
    }

    /// Whether the path can be joined here with something in another direction.
    pub fn is_open(&self) -> bool {
        !self.bsdf.is_delta_only()
    }

    /// Density per area of this vertex for a walk that samples, at `from`, the direction to it with
    /// `density` per steradian.
    pub fn per_area(&self, density: f32, from: Vec3) -> f64 {
        let offset = from - self.point.position;
        let squared = offset.length_squared();
        if squared > 0.0 {
            f64::from(density * self.point.ng.dot(offset).abs() / (squared * squared.sqrt()))
        } else {
            0.0
        }
    }

    /// The same for a walk of parallel rays with `density` per area across them.
    pub fn per_area_of_parallel(&self, density: f32, direction: Vec3) -> f64 {
        f64::from(density * self.point.ng.dot(direction).abs())
    }

    /// Density per steradian with which the vertex's own walk goes on from `point.wo` into a
    /// direction.
    pub fn onward(&self, to: Vec3) -> f32 {
        self.bsdf.pdf(self.point.frame.to_local(self.point.wo), self.point.frame.to_local(to))
    }

    /// For a camera path: scattering of light that comes from the unit direction `light` towards
    /// the camera.
    pub fn of_camera_path(&self, light: Vec3) -> Scattering {
        Scattering::new(&self.bsdf, &self.point.frame, self.point.wo, light)
    }

    /// For a camera path: the density per steradian with which a light path from `light` goes on
    /// towards the camera.
    pub fn camera_density(&self, light: Vec3) -> f32 {
        self.bsdf.pdf(self.point.frame.to_local(light), self.point.frame.to_local(self.point.wo))
    }

    /// True if shading agrees with geometry on the side of a direction.
    pub fn agrees(&self, direction: Vec3) -> bool {
        (self.point.frame.n.dot(direction) > 0.0) == (self.point.ng.dot(direction) > 0.0)
    }

    /// For a light path: scattering of its light into the unit direction `camera`, the surface
    /// shaded as a camera path from there would see it. Its shading normal may be bent towards
    /// the viewer, and what lies on the other side may be another medium.
    pub fn of_light_path(&self, scene: &Scene, camera: Vec3) -> Scattering {
        let (n, light) = (self.point.frame.n, self.point.wo);
        let same = camera.dot(self.point.ng) > 0.0
            && (n == self.point.ng || n.dot(camera).min(n.dot(light)) > BENT_COS);
        if same {
            return Scattering::new(&self.bsdf, &self.point.frame, camera, light);
        }
        let mut point = self.raw.seen_from(camera);
        let bsdf = scene.shade(&mut point);
        Scattering::new(&bsdf, &point.frame, camera, light)
    }

    /// For a light path: the factor beside `f` for light that goes on into a direction. Shading
    /// normals count as they do for a camera path, where the cosine of the incident direction
    /// is the shading one [Veach97, Eq. 5.17].
    ///
    /// ```text
    /// |n_s · light| |n_g · camera| / |n_g · light|
    /// ```
    pub fn light_cosine(&self, camera: Vec3) -> f32 {
        let (n, ng, light) = (self.point.frame.n, self.point.ng, self.point.wo);
        if n == ng {
            return ng.dot(camera).abs();
        }
        let below = ng.dot(light).abs();
        if below > 0.0 { n.dot(light).abs() * ng.dot(camera).abs() / below } else { 0.0 }
    }

    /// What is left of light that left the vertex along `camera` after `distance`, as a camera path
    /// from there applies it.
    pub fn transmittance(&self, scene: &Scene, camera: Vec3, distance: f32) -> Color {
        let behind = camera.dot(self.point.ng) < 0.0;
        if self.point.back_face == behind {
            return Color::ONE;
        }
        scene.transmittance(&SurfacePoint { back_face: true, ..self.point }, distance)
    }
}
