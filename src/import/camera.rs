//! Cameras of the document, and the one for a document without.

use super::ImportOptions;
use super::document::Document;
use super::fault::{Fault, Parsed};
use super::warnings::Warnings;
use crate::camera::{Camera, Projection, without_scale};
use crate::geometry::Aabb;
use crate::math::{Affine3A, Mat3, Vec3};
use glam::DAffine3;
use gltf::json::camera as json;
use gltf::json::validation::Checked;
use std::f32::consts::PI;

/// A camera as the document describes it, still without a place.
#[derive(Clone, Debug)]
pub(super) struct CameraKind {
    name: Option<String>,
    projection: Projection,
    aspect: Option<f32>,
    clip: [f32; 2],
}

/// All cameras of the document; `None` for one that cannot be used.
pub(super) fn cameras(
    document: &Document, options: &ImportOptions, warnings: &mut Warnings,
) -> Parsed<Vec<Option<CameraKind>>> {
    let cameras = document.root().cameras.iter().enumerate();
    let read = |(i, json)| {
        let camera = camera(json, &format!("/cameras/{i}"), warnings)?;
        let clip = |c: CameraKind| if options.no_clip { c.without_clip() } else { c };
        Ok(camera.map(clip))
    };
    cameras.map(read).collect()
}

fn camera(json: &json::Camera, path: &str, warnings: &mut Warnings) -> Parsed<Option<CameraKind>> {
    if json.perspective.is_some() && json.orthographic.is_some() {
        let what = "must have either a perspective or an orthographic property, and not both";
        return Err(Fault::new(path, what));
    }
    let missing = |key: &str| Fault::new(path, format!("the property \"{key}\" is missing"));
    let depths = |key: &str, near: f32, far: Option<f32>| match far {
        Some(far) if far <= near => {
            let what = format!("{far} does not exceed znear {near}");
            Err(Fault::new(format!("{path}/{key}/zfar"), what))
        }
        _ => Ok(()),
    };
    let (projection, aspect, clip) = match json.type_ {
        Checked::Valid(json::Type::Perspective) => {
            let lens = json.perspective.as_ref().ok_or_else(|| missing("perspective"))?;
            depths("perspective", lens.znear, lens.zfar)?;
            if lens.yfov >= PI {
                warnings.push(format!(
                    "{path}/perspective: the field of view of {} rad is no angle below 180 degrees; the camera is left out",
                    lens.yfov
                ));
                return Ok(None);
            }
            let clip = [lens.znear, lens.zfar.unwrap_or(f32::INFINITY)];
            (Projection::Perspective { yfov: lens.yfov }, lens.aspect_ratio, clip)
        }
        Checked::Valid(json::Type::Orthographic) => {
            let lens = json.orthographic.as_ref().ok_or_else(|| missing("orthographic"))?;
            depths("orthographic", lens.znear, Some(lens.zfar))?;
            if lens.xmag == 0.0 || lens.ymag == 0.0 {
                let what = "a magnification is 0; the camera is left out";
                warnings.mend(&format!("{path}/orthographic"), what)?;
                return Ok(None);
            }
            if lens.xmag < 0.0 || lens.ymag < 0.0 {
                warnings.push(format!(
                    "{path}/orthographic: a negative magnification is taken as a positive one"
                ));
            }
            let (xmag, ymag) = (lens.xmag.abs(), lens.ymag.abs());
            let clip = [lens.znear, lens.zfar];
            (Projection::Orthographic { xmag, ymag }, Some(xmag / ymag), clip)
        }
        Checked::Invalid => return Ok(None),
    };
    let name = json.name.clone().filter(|name| !name.is_empty());
    Ok(Some(CameraKind { name, projection, aspect, clip }))
}

impl CameraKind {
    /// The same without near and far plane.
    fn without_clip(self) -> Self {
        Self { clip: Camera::NO_CLIP, ..self }
    }

    /// The camera on a node, `None` where the node's transform leaves it no direction to look in.
    pub fn placed(&self, to_world: &DAffine3, fallback_name: &str) -> Option<Camera> {
        Some(Camera {
            name: self.name.clone().unwrap_or_else(|| fallback_name.to_owned()),
            projection: self.projection,
            aspect: self.aspect,
            to_world: without_scale(to_world)?,
            // In the node's own units, as viewers have it whose camera is scaled along.
            clip: self.clip.map(|plane| plane * to_world.matrix3.z_axis.length() as f32),
        })
    }
}

/// The camera for a scene without one: from the front, a little from the right and from above, with
/// all of `bounds` in a picture of any aspect from 1 on. An empty box is taken as a point at the
/// origin.
pub fn default_camera(bounds: &Aabb) -> Camera {
    const YFOV: f32 = 0.7;
    const MARGIN: f32 = 1.05;
    let (center, half) = if bounds.is_empty() {
        (Vec3::ZERO, Vec3::ZERO)
    } else {
        (bounds.center(), 0.5 * (bounds.max - bounds.min))
    };
    let back = Vec3::new(0.55, 0.4, 1.0).normalize();
    let right = Vec3::Y.cross(back).normalize();
    let up = back.cross(right);
    // A corner r is inside where |r·right| and |r·up| are at most tan * (distance - r·back).
    let tan = (0.5 * YFOV).tan();
    let mut distance = 0.0f32;
    for corner in 0..8 {
        let sign = |bit: u32| if corner >> bit & 1 == 0 { -1.0 } else { 1.0 };
        let r = half * Vec3::new(sign(0), sign(1), sign(2));
        distance =
            distance.max(r.dot(back) + MARGIN * r.dot(right).abs().max(r.dot(up).abs()) / tan);
    }
    if distance <= 0.0 {
        distance = 1.0;
    }
    Camera {
        name: "default".to_owned(),
        projection: Projection::Perspective { yfov: YFOV },
        aspect: None,
        to_world: Affine3A::from_mat3_translation(
            Mat3::from_cols(right, up, back),
            center + distance * back,
        ),
        clip: Camera::NO_CLIP,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DVec3;

    #[test]
    fn the_default_camera_sees_the_whole_box() {
        for (min, max) in [
            (Vec3::new(-1.0, -2.0, -3.0), Vec3::new(4.0, 5.0, 6.0)),
            (Vec3::new(100.0, 0.0, 0.0), Vec3::new(101.0, 0.0, 50.0)),
            (Vec3::ONE, Vec3::ONE),
        ] {
            let camera = default_camera(&Aabb { min, max });
            let Projection::Perspective { yfov } = camera.projection else {
                panic!("not perspective")
            };
            for i in 0..8 {
                let pick = |bit: u32, a: f32, b: f32| if i >> bit & 1 == 0 { a } else { b };
                let corner =
                    Vec3::new(pick(0, min.x, max.x), pick(1, min.y, max.y), pick(2, min.z, max.z));
                let local = camera.to_world.inverse().transform_point3(corner);
                assert!(local.z < 0.0, "{local}");
                let extent = local.x.abs().max(local.y.abs()) / -local.z;
                assert!(extent < (0.5 * yfov).tan(), "{local}");
            }
        }
        let nothing = default_camera(&Aabb::EMPTY);
        assert!(nothing.to_world.is_finite());
    }

    #[test]
    fn scale_and_mirroring_do_not_reach_the_camera() {
        let kind = CameraKind {
            name: None,
            projection: Projection::Perspective { yfov: 1.0 },
            aspect: None,
            clip: Camera::NO_CLIP,
        };
        let node = DAffine3::from_scale_rotation_translation(
            DVec3::new(-3.0, 0.5, 7.0),
            glam::DQuat::from_rotation_y(1.0),
            DVec3::new(1.0, 2.0, 3.0),
        );
        let camera = kind.placed(&node, "eye").unwrap();
        let wanted = Affine3A::from_rotation_translation(
            glam::Quat::from_rotation_y(1.0),
            Vec3::new(1.0, 2.0, 3.0),
        );
        assert!(camera.to_world.abs_diff_eq(wanted, 1e-6), "{:?}", camera.to_world);
        assert_eq!(camera.name, "eye");
        assert!(kind.placed(&DAffine3::from_scale(DVec3::new(1.0, 1.0, 0.0)), "eye").is_none());
    }
}
