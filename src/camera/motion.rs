//! Cameras that move: keyframes on the nodes that carry one.

use crate::math::{Affine3A, Mat3};
use glam::{DAffine3, DQuat, DVec3};

/// How values between keyframes are made [glTF20, Appendix C].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Interpolation {
    /// The value of the keyframe before.
    Step,
    /// Along the straight line, or for rotations along the shorter arc.
    Linear,
    /// By the cubic with the keyframes' values and tangents.
    Cubic,
}

/// Keyframes of one property.
#[derive(Clone, Debug, PartialEq)]
pub struct Track<const N: usize> {
    /// Seconds, strictly increasing; at least one.
    pub times: Vec<f32>,
    /// A value for each time; for [`Interpolation::Cubic`] three: the tangent before it, the
    /// value, and the tangent behind it.
    pub values: Vec<[f32; N]>,
    /// What lies between.
    pub interpolation: Interpolation,
}

/// A node above a camera, or the camera's own.
#[derive(Clone, Debug, PartialEq)]
pub struct Joint {
    /// Translation, rotation and scale where no track changes them.
    pub rest: (DVec3, DQuat, DVec3),
    /// Keyframes of the translation.
    pub translation: Option<Track<3>>,
    /// Keyframes of the rotation: quaternions x, y, z, w.
    pub rotation: Option<Track<4>>,
    /// Keyframes of the scale.
    pub scale: Option<Track<3>>,
}

/// The movement of a camera: its node and those above it, root first.
#[derive(Clone, Debug, PartialEq)]
pub struct Motion {
    /// The nodes.
    pub joints: Vec<Joint>,
}

impl Motion {
    /// The same movement, moved by `by`.
    #[must_use]
    pub fn shifted(&self, by: DVec3) -> Self {
        let root = Joint {
            rest: (by, DQuat::IDENTITY, DVec3::ONE),
            translation: None,
            rotation: None,
            scale: None,
        };
        Self { joints: std::iter::once(root).chain(self.joints.iter().cloned()).collect() }
    }

    /// Camera to world after `seconds`, without scale; `None` where the nodes leave the camera no
    /// direction to look in. Before the first and after the last keyframe everything stands still.
    pub fn at(&self, seconds: f64) -> Option<Affine3A> {
        let to_world =
            self.joints.iter().fold(DAffine3::IDENTITY, |above, joint| above * joint.at(seconds));
        without_scale(&to_world)
    }
}

/// The place and the orientation that a node's transform gives a camera: the view axis and the up
/// axis keep their directions; scale, shear and mirroring go. `None` where no direction is left.
pub fn without_scale(to_world: &DAffine3) -> Option<Affine3A> {
    let back = to_world.transform_vector3(DVec3::Z).try_normalize()?;
    let right = to_world.transform_vector3(DVec3::Y).cross(back).try_normalize()?;
    let rotation = Mat3::from_cols(right.as_vec3(), back.cross(right).as_vec3(), back.as_vec3());
    Some(Affine3A::from_mat3_translation(rotation, to_world.translation.as_vec3()))
}

impl Joint {
    fn at(&self, seconds: f64) -> DAffine3 {
        let (translation, rotation, scale) = self.rest;
        let vector = |track: &Option<Track<3>>, rest| {
            track.as_ref().map_or(rest, |t| DVec3::from_array(t.at(seconds, lerp)))
        };
        let rotation = self.rotation.as_ref().map_or(rotation, |t| {
            let q = DQuat::from_array(t.at(seconds, |a, b, s| {
                DQuat::from_array(a)
                    .normalize()
                    .slerp(DQuat::from_array(b).normalize(), s)
                    .to_array()
            }));
            // Cubics leave the unit sphere.
            if q.length_squared() > 1e-12 { q.normalize() } else { rotation }
        });
        DAffine3::from_scale_rotation_translation(
            vector(&self.scale, scale),
            rotation,
            vector(&self.translation, translation),
        )
    }
}

fn lerp<const N: usize>(a: [f64; N], b: [f64; N], s: f64) -> [f64; N] {
    std::array::from_fn(|k| a[k] + (b[k] - a[k]) * s)
}

impl<const N: usize> Track<N> {
    /// The value after `seconds`; `between` interpolates linearly.
    fn at(&self, seconds: f64, between: impl Fn([f64; N], [f64; N], f64) -> [f64; N]) -> [f64; N] {
        let part = |key: usize, which: usize| {
            let place =
                if self.interpolation == Interpolation::Cubic { 3 * key + which } else { key };
            self.values[place].map(f64::from)
        };
        let value = |key: usize| part(key, 1);
        let after = self.times.partition_point(|t| f64::from(*t) <= seconds);
        let Some(before) = after.checked_sub(1) else { return value(0) };
        if after == self.times.len() {
            return value(before);
        }
        let start = f64::from(self.times[before]);
        let length = f64::from(self.times[after]) - start;
        let s = (seconds - start) / length;
        match self.interpolation {
            Interpolation::Step => value(before),
            Interpolation::Linear => between(value(before), value(after), s),
            Interpolation::Cubic => {
                let (s2, s3) = (s * s, s * s * s);
                let weights = [
                    2.0 * s3 - 3.0 * s2 + 1.0,
                    length * (s3 - 2.0 * s2 + s),
                    3.0 * s2 - 2.0 * s3,
                    length * (s3 - s2),
                ];
                let terms = [value(before), part(before, 2), value(after), part(after, 0)];
                std::array::from_fn(|k| weights.iter().zip(&terms).map(|(w, t)| w * t[k]).sum())
            }
        }
    }
}
