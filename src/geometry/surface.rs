//! Points on surfaces: interpolation of a hit's attributes and the safe start of the next ray.

use super::Geometry;
use crate::math::{Frame, Vec2, Vec3, Vec4};

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
    /// Diameter of a pixel projected on the plane across the viewing path, in world units; 0 where
    /// there is no camera path.
    pub footprint: f32,
}

impl SurfacePoint {
    /// A point of which no more is known than where it lies and its unit normal, seen from straight
    /// above.
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
            footprint: 0.0,
        }
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
        footprint: 0.0,
    }
}

/// Where a ray that leaves the surface at `position` towards `direction` should start so that it
/// does not hit the surface again: pushed along the geometric normal `ng`, to the side of
/// `direction`, by a few units in the last place of the largest coordinate.
#[inline]
pub fn offset_origin(position: Vec3, ng: Vec3, direction: Vec3) -> Vec3 {
    let distance = position.abs().max_element() * 4e-6 + 1e-7;
    position + ng * if ng.dot(direction) < 0.0 { -distance } else { distance }
}
