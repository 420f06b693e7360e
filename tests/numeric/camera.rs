//! Rays of cameras, what undoes them, and keyframes.

use glam::{DQuat, DVec3};
use lumicache::camera::{Camera, Interpolation, Joint, Motion, Projection, Track};
use lumicache::math::{Affine3A, Vec2, Vec3};

#[test]
fn the_image_is_neither_mirrored_nor_upside_down() {
    let camera = Camera {
        name: String::new(),
        projection: Projection::Perspective { yfov: 1.0 },
        aspect: None,
        to_world: Affine3A::IDENTITY,
        clip: Camera::NO_CLIP,
    };
    let upper_right = camera.ray(Vec2::new(90.0, 10.0), [100, 100]);
    assert!(upper_right.dir.x > 0.0 && upper_right.dir.y > 0.0 && upper_right.dir.z < 0.0);
    let center = camera.ray(Vec2::new(50.0, 50.0), [100, 100]);
    assert!((center.dir - Vec3::NEG_Z).length() < 1e-6);
    let next = camera.ray(Vec2::new(50.0, 51.0), [100, 100]);
    assert!((next.dir.angle_between(center.dir) / center.pixel_angle - 1.0).abs() < 1e-2);
}

#[test]
fn a_view_undoes_a_ray_and_counts_pixels() {
    let to_world = Affine3A::from_rotation_translation(
        glam::Quat::from_rotation_y(0.7) * glam::Quat::from_rotation_x(-0.4),
        Vec3::new(3.0, -2.0, 1.0),
    );
    for projection in
        [Projection::Perspective { yfov: 0.9 }, Projection::Orthographic { xmag: 2.0, ymag: 1.5 }]
    {
        let clip = Camera::NO_CLIP;
        let camera = Camera { name: String::new(), projection, aspect: None, to_world, clip };
        let size = [200, 120];
        for raster in [Vec2::new(3.0, 100.0), Vec2::new(100.0, 60.0), Vec2::new(170.5, 20.25)] {
            let at = |raster: Vec2| {
                let ray = camera.ray(raster, size);
                (ray, ray.origin + ray.dir * 7.0)
            };
            let (ray, point) = at(raster);
            let view = camera.view(point, size).unwrap();
            assert!((view.raster - raster).length() < 1e-2, "{view:?}");
            assert!(
                (view.to_camera + ray.dir).length() < 1e-5 && (view.distance - 7.0).abs() < 1e-4,
                "{view:?}"
            );
            // The area across the ray that a square of two pixels covers.
            let onto = |r: Vec2| {
                let ray2 = camera.ray(r, size);
                let t = (point - ray2.origin).dot(ray.dir) / ray2.dir.dot(ray.dir);
                ray2.origin + ray2.dir * t
            };
            let (dx, dy) = (
                onto(raster + Vec2::X) - onto(raster - Vec2::X),
                onto(raster + Vec2::Y) - onto(raster - Vec2::Y),
            );
            let pixels = 4.0 / dx.cross(dy).length();
            assert!((view.pixels_per_area / pixels - 1.0).abs() < 1e-2, "{view:?} {pixels}");
            assert!(camera.view(ray.origin - ray.dir * 2.0, size).is_none());
        }
    }
}

fn track<const N: usize>(interpolation: Interpolation, values: &[[f32; N]]) -> Option<Track<N>> {
    let keys = if interpolation == Interpolation::Cubic { values.len() / 3 } else { values.len() };
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
        let motion =
            Motion { joints: vec![Joint { translation: track(interpolation, values), ..joint() }] };
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
    let motion =
        Motion { joints: vec![Joint { rotation: track(Interpolation::Cubic, &cubic), ..joint() }] };
    let matrix = motion.at(2.0).unwrap().matrix3;
    assert!((matrix.determinant() - 1.0).abs() < 1e-6);
    assert!((Vec3::from(matrix.z_axis) - Vec3::new(quarter, 0.0, quarter)).length() < 1e-6);
}

#[test]
fn nodes_above_carry_those_below() {
    let turn = Joint {
        rest: (DVec3::ZERO, DQuat::from_rotation_y(std::f64::consts::FRAC_PI_2), DVec3::splat(2.0)),
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
    let flat = Joint { rest: (DVec3::ZERO, DQuat::IDENTITY, DVec3::new(1.0, 1.0, 0.0)), ..joint() };
    assert!(Motion { joints: vec![flat] }.at(0.0).is_none());
}
