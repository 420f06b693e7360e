//! Points on surfaces: interpolation of a hit's attributes and the safe start of the next ray.

use super::Geometry;
use crate::math::{Affine3A, Frame, Vec2, Vec3, Vec4};

/// A point on a surface as the shading, the gather and the cache see it. Everything is in world
/// space; `ng` and `frame.n` are on the side from which the surface is looked at.
#[derive(Clone, Copy, Debug)]
pub struct SurfacePoint {
    /// The point.
    pub position: Vec3,
    /// Unit geometric normal, towards the viewer.
    pub ng: Vec3,
    /// Shading frame; `frame.n · ng > 0`.
    pub frame: Frame,
    /// Mesh tangent for normal maps, w the sign of the bitangent; zero where the mesh has none.
    pub tangent: Vec4,
    /// Texture coordinates of both sets, zero where the mesh has none.
    pub uv: [Vec2; 2],
    /// Vertex colour, linear RGBA, white where the mesh has none.
    pub color: Vec4,
    /// Index into the scene's materials.
    pub material: u32,
    /// Instance that was hit.
    pub instance: u32,
    /// Triangle inside the instance's mesh.
    pub triangle: u32,
    /// True if the viewer sees the back of the triangle.
    pub back_face: bool,
    /// Unit direction towards the viewer.
    pub wo: Vec3,
    /// How far the point may lie off the surface that rays meet, along `ng`: rays leave from this
    /// far above it.
    pub error: f32,
    /// Diameter of a pixel projected on the plane across the viewing path, in world units; 0 where
    /// there is no camera path.
    pub footprint: f32,
}

impl SurfacePoint {
    /// A point of which no more is known than where it lies and its unit normal, seen from straight
    /// above. Its error is taken to be a few units in the last place of its largest coordinate.
    pub fn plain(position: Vec3, normal: Vec3) -> Self {
        Self {
            position,
            ng: normal,
            frame: Frame::from_normal(normal),
            tangent: Vec4::ZERO,
            uv: [Vec2::ZERO; 2],
            color: Vec4::ONE,
            material: 0,
            instance: 0,
            triangle: 0,
            back_face: false,
            wo: normal,
            error: MAP_ROUNDING * position.abs().max_element(),
            footprint: 0.0,
        }
    }

    /// Where a ray that leaves the surface towards `direction` starts: on the side of the surface
    /// that `direction` is on, beyond the error of the point.
    #[inline]
    pub fn leave(&self, direction: Vec3) -> Vec3 {
        let away = if self.ng.dot(direction) < 0.0 { -self.error } else { self.error };
        self.position + self.ng * away
    }

    /// The point as [`interpolate`] gives it when it is looked at from the unit direction `wo`: the
    /// normals are on that side. Of a point that was not shaded yet.
    #[must_use]
    pub fn seen_from(&self, wo: Vec3) -> Self {
        if wo.dot(self.ng) >= 0.0 {
            return Self { wo, ..*self };
        }
        Self {
            ng: -self.ng,
            frame: Frame::from_normal(-self.frame.n),
            back_face: !self.back_face,
            wo,
            ..*self
        }
    }
}

/// The surface point at barycentric coordinates `(u, v)` (weights of the second and third vertex)
/// of a triangle, seen along the unit direction `dir`.
///
/// The position comes from the vertices and not from the ray, which loses fewer bits. Shading
/// normals that point away from the viewer's side are mirrored back to it.
pub fn interpolate(
    geometry: &Geometry, instance: u32, triangle: u32, u: f32, v: f32, dir: Vec3,
) -> SurfacePoint {
    let inst = &geometry.instances[instance as usize];
    let mesh = &geometry.meshes[inst.mesh as usize];
    let [ia, ib, ic] = mesh.indices[triangle as usize].map(|i| i as usize);
    let w = 1.0 - u - v;
    let (pa, pb, pc) = (mesh.positions[ia], mesh.positions[ib], mesh.positions[ic]);
    let linear = &inst.to_world.matrix3;
    let mirrored = linear.determinant() < 0.0;
    let (ea, eb) =
        (inst.to_world.transform_vector3(pb - pa), inst.to_world.transform_vector3(pc - pa));
    let mut ng = ea.cross(eb).normalize_or(Vec3::Z);
    if mirrored {
        ng = -ng;
    }
    let back_face = ng.dot(dir) > 0.0;
    if back_face {
        ng = -ng;
    }
    let position = inst.to_world.transform_point3(pa) + u * ea + v * eb;
    let mut n = ng;
    if let Some(normals) = &mesh.normals {
        let local = w * normals[ia] + u * normals[ib] + v * normals[ic];
        // Normals transform by the inverse transpose; its determinant only scales them, and the
        // side is chosen below.
        let cofactor = [
            linear.y_axis.cross(linear.z_axis),
            linear.z_axis.cross(linear.x_axis),
            linear.x_axis.cross(linear.y_axis),
        ];
        let world =
            Vec3::from(cofactor[0] * local.x + cofactor[1] * local.y + cofactor[2] * local.z);
        if let Some(unit) = world.try_normalize().filter(|n| n.is_finite()) {
            n = if unit.dot(ng) < 0.0 { -unit } else { unit };
        }
    }
    let mut tangent = Vec4::ZERO;
    if let Some(tangents) = &mesh.tangents {
        let local = w * tangents[ia] + u * tangents[ib] + v * tangents[ic];
        let world = inst.to_world.transform_vector3(local.truncate()).normalize_or_zero();
        let sign = if tangents[ia].w < 0.0 { -1.0 } else { 1.0 };
        tangent = world.extend(if mirrored { -sign } else { sign });
    }
    let uv_at = |set: &Option<Vec<Vec2>>| {
        set.as_ref().map_or(Vec2::ZERO, |t| w * t[ia] + u * t[ib] + v * t[ic])
    };
    SurfacePoint {
        position,
        ng,
        frame: Frame::from_normal(n),
        tangent,
        uv: [uv_at(&mesh.uv[0]), uv_at(&mesh.uv[1])],
        color: mesh.colors.as_ref().map_or(Vec4::ONE, |c| w * c[ia] + u * c[ib] + v * c[ic]),
        material: mesh.material,
        instance,
        triangle,
        back_face,
        wo: -dir,
        error: rounding_error(&inst.to_world, [pa, pb, pc], ng),
        footprint: 0.0,
    }
}

/// Bound on the distance along the unit normal `ng` between a point of a triangle that was put
/// together from its corners in object space and the triangle that rays are traced against, whose
/// corners were rounded on their way into the world.
///
/// Each component of the point is off by at most `24 u (|M| p + |t|)`, where `M` and `t` take
/// objects to the world, p holds the largest absolute coordinates of the corners and u = 2⁻²⁴ is
/// the rounding of one operation: the products and sums of the map, of the edges and of the weights
/// follow each other [Pharr23, Sec. 6.8]. Planes along the axes are so only as inexact as their
/// own coordinate, however far they reach.
#[inline]
fn rounding_error(to_world: &Affine3A, corners: [Vec3; 3], ng: Vec3) -> f32 {
    const STEPS: f32 = 24.0 * UNIT_ROUNDOFF;
    let [a, b, c] = corners.map(Vec3::abs);
    let p = a.max(b).max(c);
    let m = to_world.matrix3.abs();
    let size =
        Vec3::from(m.x_axis * p.x + m.y_axis * p.y + m.z_axis * p.z + to_world.translation.abs());
    // The second term keeps a point in a plane through the origin off it.
    STEPS * size.dot(ng.abs()) + UNIT_ROUNDOFF * size.max_element()
}

/// Rounding of a single operation, relative.
const UNIT_ROUNDOFF: f32 = f32::EPSILON / 2.0;

/// Rounding of a point that is mapped to another space and back, relative to its largest
/// coordinate: what rays against instances that share their mesh's hierarchy suffer.
pub const MAP_ROUNDING: f32 = 64.0 * UNIT_ROUNDOFF;
