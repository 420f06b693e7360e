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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::Vec3;

    fn track<const N: usize>(
        interpolation: Interpolation,
        values: &[[f32; N]],
    ) -> Option<Track<N>> {
        let keys =
            if interpolation == Interpolation::Cubic { values.len() / 3 } else { values.len() };
        Some(Track {
            times: (0..keys).map(|k| 1.0 + 2.0 * k as f32).collect(),
            values: values.to_vec(),
            interpolation,
        })
    }

    fn joint() -> Joint {
        Joint {
            rest: (DVec3::ZERO, DQuat::IDENTITY, DVec3::ONE),
            translation: None,
            rotation: None,
            scale: None,
        }
    }

    #[test]
    fn values_between_keyframes() {
        let place = |interpolation, values: &[[f32; 3]], seconds| {
            let motion = Motion {
                joints: vec![Joint { translation: track(interpolation, values), ..joint() }],
            };
            Vec3::from(motion.at(seconds).unwrap().translation)
        };
        let line = [[0.0, 1.0, 0.0], [4.0, 1.0, 0.0]];
        for (seconds, linear, step) in
            [(0.0, 0.0, 0.0), (1.5, 1.0, 0.0), (2.5, 3.0, 0.0), (3.0, 4.0, 4.0), (9.0, 4.0, 4.0)]
        {
            assert_eq!(place(Interpolation::Linear, &line, seconds), Vec3::new(linear, 1.0, 0.0));
            assert_eq!(place(Interpolation::Step, &line, seconds), Vec3::new(step, 1.0, 0.0));
        }
        // The cubic t³ - t, t seconds from the first keyframe, with its own tangents there and two
        // seconds later.
        let cubic = [[9.0; 3], [0.0; 3], [-1.0; 3], [11.0; 3], [6.0; 3], [9.0; 3]];
        for t in [0.0, 0.5, 1.0, 1.7, 2.0] {
            let got = place(Interpolation::Cubic, &cubic, 1.0 + f64::from(t));
            assert!((got - Vec3::splat(t * t * t - t)).length() < 1e-5, "{t}: {got}");
        }
    }

    #[test]
    fn rotations_take_the_shorter_arc_and_stay_rotations() {
        let quarter = std::f32::consts::FRAC_1_SQRT_2;
        // The same quarter turn around y twice, once with the other sign.
        for sign in [1.0, -1.0] {
            let values = [[0.0, 0.0, 0.0, 1.0], [0.0, sign * quarter, 0.0, sign * quarter]];
            let motion = Motion {
                joints: vec![Joint { rotation: track(Interpolation::Linear, &values), ..joint() }],
            };
            let back = Vec3::from(motion.at(2.0).unwrap().matrix3.z_axis);
            assert!((back - Vec3::new(quarter, 0.0, quarter)).length() < 1e-6, "{back}");
        }
        let cubic = [
            [0.0; 4],
            [0.0, 0.0, 0.0, 1.0],
            [0.0; 4],
            [0.0; 4],
            [0.0, quarter, 0.0, quarter],
            [0.0; 4],
        ];
        let motion = Motion {
            joints: vec![Joint { rotation: track(Interpolation::Cubic, &cubic), ..joint() }],
        };
        let matrix = motion.at(2.0).unwrap().matrix3;
        assert!((matrix.determinant() - 1.0).abs() < 1e-6);
        assert!((Vec3::from(matrix.z_axis) - Vec3::new(quarter, 0.0, quarter)).length() < 1e-6);
    }

    #[test]
    fn nodes_above_carry_those_below() {
        let turn = Joint {
            rest: (
                DVec3::ZERO,
                DQuat::from_rotation_y(std::f64::consts::FRAC_PI_2),
                DVec3::splat(2.0),
            ),
            ..joint()
        };
        let slide = Joint {
            translation: track(Interpolation::Linear, &[[0.0; 3], [0.0, 0.0, 1.0]]),
            ..joint()
        };
        let to_world = Motion { joints: vec![turn, slide] }.at(3.0).unwrap();
        // A quarter turn takes z to x, and the scale above stretches the way but not the camera.
        assert!((Vec3::from(to_world.translation) - Vec3::new(2.0, 0.0, 0.0)).length() < 1e-6);
        assert!((to_world.matrix3.determinant() - 1.0).abs() < 1e-6);
        let flat =
            Joint { rest: (DVec3::ZERO, DQuat::IDENTITY, DVec3::new(1.0, 1.0, 0.0)), ..joint() };
        assert!(Motion { joints: vec![flat] }.at(0.0).is_none());
    }
}
