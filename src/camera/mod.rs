//! Cameras: pixel sample to ray, with its footprint, and how they move.

mod motion;

pub use motion::{Interpolation, Joint, Motion, Track, without_scale};

use crate::math::{Affine3A, Vec2, Vec3};
use glam::{DVec3, Mat4};

/// The two projections of glTF.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Projection {
    /// Vertical field of view in radians, in (0, π).
    Perspective {
        /// The vertical field of view.
        yfov: f32,
    },
    /// Half the width and half the height of the view volume.
    Orthographic {
        /// Half width.
        xmag: f32,
        /// Half height.
        ymag: f32,
    },
}

/// A camera looking along its local -Z with +Y up.
#[derive(Clone, Debug, PartialEq)]
pub struct Camera {
    /// Name in the scene file.
    pub name: String,
    /// The projection.
    pub projection: Projection,
    /// Width over height as the file has it, if it does.
    pub aspect: Option<f32>,
    /// Camera to world, scale already removed.
    pub to_world: Affine3A,
    /// Near and far plane: distances along the view axis. The camera sees what lies between them;
    /// light goes everywhere.
    pub clip: [f32; 2],
}

/// A camera ray.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CameraRay {
    /// Start.
    pub origin: Vec3,
    /// Unit direction.
    pub dir: Vec3,
    /// Diameter of a pixel at distance t along the ray is `pixel_offset + pixel_angle * t`: offset
    /// for orthographic cameras, angle for perspective ones.
    pub pixel_offset: f32,
    /// See `pixel_offset`; radians.
    pub pixel_angle: f32,
    /// Distances along the ray between which the camera sees.
    pub range: [f32; 2],
}

/// A point as a camera sees it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CameraView {
    /// Where in the image: pixels from its upper left corner.
    pub raster: Vec2,
    /// Unit direction from the point to the camera.
    pub to_camera: Vec3,
    /// Distance from the point to the camera.
    pub distance: f32,
    /// Distance from the point to the camera's near plane, in the same direction.
    pub clear: f32,
    /// Pixels per unit area of a surface at the point that lies across `to_camera`: the importance
    /// of the point. A pixel is the mean of the radiance over its square of the image, so this
    /// is also the density of camera samples that are uniform in the image, times its number of
    /// pixels.
    pub pixels_per_area: f32,
}

impl Camera {
    /// A camera without near and far plane.
    pub const NO_CLIP: [f32; 2] = [0.0, f32::INFINITY];

    /// The camera moved by `by`.
    #[must_use]
    pub fn shifted(mut self, by: DVec3) -> Self {
        self.to_world.translation = (self.to_world.translation.as_dvec3() + by).as_vec3a();
        self
    }

    /// World to camera space.
    pub fn world_to_camera(&self) -> Mat4 {
        Mat4::from(self.to_world.inverse())
    }

    /// World to normalised device coordinates of an image of `size` pixels: x and y in [-1, 1]
    /// over the image, y up.
    pub fn world_to_ndc(&self, size: [u32; 2]) -> Mat4 {
        let aspect = size[0] as f32 / size[1] as f32;
        let projection = match self.projection {
            Projection::Perspective { yfov } => {
                glam::camera::rh::proj::opengl::perspective(yfov, aspect, 0.01, 1e5)
            }
            Projection::Orthographic { xmag, ymag } => {
                glam::camera::rh::proj::opengl::orthographic(-xmag, xmag, -ymag, ymag, 0.01, 1e5)
            }
        };
        projection * self.world_to_camera()
    }

    /// The unit direction from `point` to the camera, wherever that looks.
    pub fn towards(&self, point: Vec3) -> Vec3 {
        let back = Vec3::from(self.to_world.matrix3.z_axis);
        match self.projection {
            Projection::Perspective { .. } => {
                (Vec3::from(self.to_world.translation) - point).normalize_or(back)
            }
            Projection::Orthographic { .. } => back,
        }
    }

    /// How the camera sees `point` in an image of `size` pixels, the inverse of [`Camera::ray`];
    /// `None` for a point that is not between its near and its far plane. The point may lie outside
    /// the image.
    ///
    /// ```text
    /// pixels per area = h² / (4 tan²(yfov/2) cos³θ d²)   perspective
    ///                 = w h / (4 xmag ymag)              orthographic
    /// ```
    ///
    /// with the angle θ to the view axis and the distance d.
    pub fn view(&self, point: Vec3, size: [u32; 2]) -> Option<CameraView> {
        let (w, h) = (size[0] as f32, size[1] as f32);
        let axes = self.to_world.matrix3;
        let offset = point - Vec3::from(self.to_world.translation);
        let local = Vec3::from(axes.transpose() * glam::Vec3A::from(offset));
        let depth = -local.z;
        let [near, far] = self.clip;
        if depth.is_nan() || depth <= near.max(0.0) || depth > far {
            return None;
        }
        let (x, y, to_camera, distance, pixels_per_area) = match self.projection {
            Projection::Perspective { yfov } => {
                let tan = (0.5 * yfov).tan();
                let squared = offset.length_squared();
                let distance = squared.sqrt();
                let cos = depth / distance;
                let pixels = h * h / (4.0 * tan * tan * cos * cos * cos * squared);
                (
                    local.x / (depth * tan * w / h),
                    local.y / (depth * tan),
                    -offset / distance,
                    distance,
                    pixels,
                )
            }
            Projection::Orthographic { xmag, ymag } => (
                local.x / xmag,
                local.y / ymag,
                axes.z_axis.into(),
                depth,
                w * h / (4.0 * xmag * ymag),
            ),
        };
        let raster = Vec2::new(0.5 * (x + 1.0) * w, 0.5 * (1.0 - y) * h);
        pixels_per_area.is_finite().then_some(CameraView {
            raster,
            to_camera,
            distance,
            clear: distance * (1.0 - near / depth),
            pixels_per_area,
        })
    }

    /// The ray through `raster` (pixels from the upper left corner of the image) of an image of
    /// `size` pixels.
    ///
    /// The vertical field of view is the file's whatever the image's aspect, as in other glTF
    /// viewers.
    pub fn ray(&self, raster: Vec2, size: [u32; 2]) -> CameraRay {
        let (w, h) = (size[0] as f32, size[1] as f32);
        let (x, y) = (2.0 * raster.x / w - 1.0, 1.0 - 2.0 * raster.y / h);
        match self.projection {
            Projection::Perspective { yfov } => {
                let tan = (0.5 * yfov).tan();
                let local = Vec3::new(x * tan * w / h, y * tan, -1.0);
                let dir = self.to_world.transform_vector3(local).normalize();
                let pixel_angle = 2.0 * tan / h / local.length_squared();
                let range = self.clip.map(|depth| depth * local.length());
                CameraRay {
                    origin: self.to_world.translation.into(),
                    dir,
                    pixel_offset: 0.0,
                    pixel_angle,
                    range,
                }
            }
            Projection::Orthographic { xmag, ymag } => {
                let origin = self.to_world.transform_point3(Vec3::new(x * xmag, y * ymag, 0.0));
                let dir = self.to_world.transform_vector3(Vec3::NEG_Z).normalize();
                let pixel_offset = 2.0 * ymag / h;
                CameraRay { origin, dir, pixel_offset, pixel_angle: 0.0, range: self.clip }
            }
        }
    }
}
