//! Cameras: pixel sample to ray, with its footprint.

use crate::math::{Affine3A, Vec2, Vec3};

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
}

/// A camera ray.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CameraRay {
    /// Start.
    pub origin: Vec3,
    /// Unit direction.
    pub dir: Vec3,
    /// Diameter of a pixel at distance t along the ray is `pixel_offset + pixel_angle * t`: offset for orthographic cameras, angle for perspective ones.
    pub pixel_offset: f32,
    /// See `pixel_offset`; radians.
    pub pixel_angle: f32,
}

impl Camera {
    /// The ray through `raster` (pixels from the upper left corner of the image) of an image of `size` pixels.
    ///
    /// The vertical field of view is the file's whatever the image's aspect, as in other glTF viewers.
    pub fn ray(&self, raster: Vec2, size: [u32; 2]) -> CameraRay {
        let (w, h) = (size[0] as f32, size[1] as f32);
        let (x, y) = (2.0 * raster.x / w - 1.0, 1.0 - 2.0 * raster.y / h);
        match self.projection {
            Projection::Perspective { yfov } => {
                let tan = (0.5 * yfov).tan();
                let local = Vec3::new(x * tan * w / h, y * tan, -1.0);
                let dir = self.to_world.transform_vector3(local).normalize();
                let pixel_angle = 2.0 * tan / h / local.length_squared();
                CameraRay { origin: self.to_world.translation.into(), dir, pixel_offset: 0.0, pixel_angle }
            }
            Projection::Orthographic { xmag, ymag } => {
                let origin = self.to_world.transform_point3(Vec3::new(x * xmag, y * ymag, 0.0));
                let dir = self.to_world.transform_vector3(Vec3::NEG_Z).normalize();
                CameraRay { origin, dir, pixel_offset: 2.0 * ymag / h, pixel_angle: 0.0 }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_image_is_neither_mirrored_nor_upside_down() {
        let camera = Camera {
            name: String::new(),
            projection: Projection::Perspective { yfov: 1.0 },
            aspect: None,
            to_world: Affine3A::IDENTITY,
        };
        let upper_right = camera.ray(Vec2::new(90.0, 10.0), [100, 100]);
        assert!(upper_right.dir.x > 0.0 && upper_right.dir.y > 0.0 && upper_right.dir.z < 0.0);
        let center = camera.ray(Vec2::new(50.0, 50.0), [100, 100]);
        assert!((center.dir - Vec3::NEG_Z).length() < 1e-6);
        let next = camera.ray(Vec2::new(50.0, 51.0), [100, 100]);
        assert!((next.dir.angle_between(center.dir) / center.pixel_angle - 1.0).abs() < 1e-2);
    }
}
