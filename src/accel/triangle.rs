//! One triangle against one ray, without gaps between neighbours.

use super::build::LIMIT;
use crate::math::{DVec3, Vec3};

/// A triangle prepared for [`Triangle::intersect`].
#[derive(Clone, Copy, Debug)]
pub struct Triangle {
    vertices: [Vec3; 3],
    /// Unit normal, rounded once from double precision.
    normal: Vec3,
}

/// Distance and barycentric weights of the second and third vertex.
#[derive(Clone, Copy, Debug)]
pub struct TriangleHit {
    pub t: f32,
    pub u: f32,
    pub v: f32,
}

impl Triangle {
    /// `None` where nothing can be hit: a triangle without area, or with a vertex that is not
    /// finite or beyond [`LIMIT`].
    pub fn new(vertices: [Vec3; 3]) -> Option<Self> {
        let [a, b, c] = vertices.map(|p| p.as_dvec3());
        let normal = (b - a).cross(c - a).try_normalize()?;
        vertices
            .iter()
            .all(|p| p.abs().cmple(Vec3::splat(LIMIT)).all())
            .then_some(Self { vertices, normal: normal.as_vec3() })
    }

    pub fn vertices(&self) -> [Vec3; 3] {
        self.vertices
    }

    /// The hit with `tmin < t <= tmax`, from either side.
    ///
    /// With a, b the ends of an edge as seen from the ray's origin and d its direction, d · (a × b)
    /// = ½ d · ((a - b) × (a + b)) tells on which side of the edge the ray passes, and its
    /// value only changes sign when a and b are swapped: two triangles agree about their common
    /// edge, so no ray slips between them. The three values are also the barycentric weights,
    /// times a common factor. [Davidovic12, edge functions] The sides are taken in double
    /// precision, and a ray may pass outside by their rounding error: at a vertex, where all sides
    /// are about zero, the triangles around it could otherwise all lose the ray. Few triangles
    /// get that far.
    #[inline]
    pub fn intersect(&self, origin: Vec3, dir: Vec3, tmin: f32, tmax: f32) -> Option<TriangleHit> {
        let t = (self.vertices[0] - origin).dot(self.normal) / dir.dot(self.normal);
        if !(t > tmin && t <= tmax) {
            return None;
        }
        let (o, d) = (origin.as_dvec3(), dir.as_dvec3());
        let [a, b, c] = self.vertices.map(|p| p.as_dvec3() - o);
        let side = |a: DVec3, b: DVec3| d.dot((a - b).cross(a + b));
        let (wa, wb, wc) = (side(b, c), side(c, a), side(a, b));
        let reach = a.abs().max(b.abs()).max(c.abs()).max_element();
        let rounding = 16.0 * f64::EPSILON * reach * reach * d.abs().max_element();
        if wa.min(wb).min(wc) < -rounding && wa.max(wb).max(wc) > rounding {
            return None;
        }
        let scale = 1.0 / (wa + wb + wc);
        Some(TriangleHit {
            t,
            u: ((wb * scale) as f32).clamp(0.0, 1.0),
            v: ((wc * scale) as f32).clamp(0.0, 1.0),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const CORNERS: [Vec3; 3] =
        [Vec3::new(1.0, 2.0, 5.0), Vec3::new(4.0, 2.0, 6.0), Vec3::new(1.0, 7.0, 4.0)];

    #[test]
    fn distance_and_weights_reproduce_the_point() {
        let triangle = Triangle::new(CORNERS).unwrap();
        for (u, v) in [(0.2, 0.3), (0.01, 0.01), (0.9, 0.05), (0.0, 0.5), (0.5, 0.5)] {
            let target = CORNERS[0] + u * (CORNERS[1] - CORNERS[0]) + v * (CORNERS[2] - CORNERS[0]);
            for origin in [Vec3::ZERO, Vec3::new(3.0, -2.0, 15.0)] {
                let hit = triangle
                    .intersect(origin, 0.5 * (target - origin), 0.0, f32::INFINITY)
                    .unwrap();
                assert!(
                    (hit.t - 2.0).abs() < 1e-5
                        && (hit.u - u).abs() < 1e-5
                        && (hit.v - v).abs() < 1e-5,
                    "{hit:?}"
                );
            }
        }
    }

    #[test]
    fn the_interval_is_open_below_and_closed_above() {
        let triangle = Triangle::new([
            Vec3::new(-1.0, -1.0, 2.0),
            Vec3::new(1.0, -1.0, 2.0),
            Vec3::new(0.0, 1.0, 2.0),
        ])
        .unwrap();
        assert!(triangle.intersect(Vec3::ZERO, Vec3::Z, 0.0, 2.0).is_some());
        assert!(triangle.intersect(Vec3::ZERO, Vec3::Z, 2.0, 3.0).is_none());
        assert!(triangle.intersect(Vec3::ZERO, Vec3::Z, 0.0, 1.999).is_none());
        assert!(triangle.intersect(Vec3::ZERO, -Vec3::Z, 0.0, 3.0).is_none());
        assert!(triangle.intersect(Vec3::ZERO, Vec3::X, 0.0, 3.0).is_none());
    }

    #[test]
    fn triangles_that_cannot_be_hit_are_refused() {
        assert!(Triangle::new([Vec3::X, Vec3::X, Vec3::Y]).is_none());
        assert!(Triangle::new([Vec3::X, 2.0 * Vec3::X, 3.0 * Vec3::X]).is_none());
        assert!(Triangle::new([Vec3::X, Vec3::NAN, Vec3::Y]).is_none());
        assert!(Triangle::new([Vec3::X, Vec3::INFINITY, Vec3::Y]).is_none());
        assert!(Triangle::new(CORNERS.map(|p| 1e-15 * p)).is_some());
    }
}
