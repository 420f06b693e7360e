//! Frames, and buffers that are lent.

use lumicache::geometry::Buffer;
use lumicache::math::{Frame, Vec3};
use std::sync::Arc;

#[test]
fn frames_are_orthonormal_and_right_handed() {
    for i in 0..1000 {
        let z = 1.0 - 2.0 * (i as f32 + 0.5) / 1000.0;
        let (phi, r) = (i as f32 * 2.399_963, (1.0 - z * z).sqrt());
        let n = Vec3::new(r * phi.cos(), r * phi.sin(), z).normalize();
        for f in [
            Frame::from_normal(n),
            Frame::from_normal_tangent(n, Vec3::new(0.3, -0.2, 0.9)),
            Frame::from_normal_tangent(n, n),
        ] {
            assert!((f.s.cross(f.t) - f.n).length() < 1e-5, "{f:?}");
            assert!((f.s.length() - 1.0).abs() < 1e-5 && f.s.dot(f.n).abs() < 1e-5, "{f:?}");
            let v = Vec3::new(0.2, -0.7, 0.4);
            assert!((f.to_world(f.to_local(v)) - v).length() < 1e-5);
        }
    }
}

#[test]
fn rounding_noise_does_not_flip_a_wall_s_tangents() {
    let a = Frame::from_normal(Vec3::new(1.0, 0.0, 1e-7).normalize());
    let b = Frame::from_normal(Vec3::new(1.0, 0.0, -1e-7).normalize());
    assert!((a.s - b.s).length() < 1e-5 && (a.t - b.t).length() < 1e-5);
}

#[test]
fn what_is_lent_is_read_in_place_and_copied_to_be_changed() {
    let owner = Arc::new(vec![1, 2, 3]);
    let mut buffer = Buffer::lent(owner.clone());
    assert_eq!((buffer.as_ptr(), buffer.len(), buffer.is_lent()), (owner.as_ptr(), 3, true));
    let copy = buffer.clone();
    assert_eq!(copy.as_ptr(), owner.as_ptr());
    buffer[1] = 7;
    assert_eq!((&*buffer, &**owner, buffer.is_lent()), (&[1, 7, 3][..], &[1, 2, 3][..], false));
    buffer.to_mut().push(9);
    assert_eq!(&*buffer, [1, 7, 3, 9]);
    drop(copy);
    assert_eq!(Arc::strong_count(&owner), 1);
}
