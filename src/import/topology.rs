//! From indices to triangles.

use crate::math::Vec3;

/// How a primitive's vertices are joined.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(super) enum Mode {
    Triangles,
    Strip,
    Fan,
}

/// The triangles of `count` vertices in the order in which `vertex` tells them.
///
/// Vertices that do not complete a triangle are left over [glTF20, 3.7.2.1].
pub(super) fn triangulate(
    mode: Mode, count: usize, vertex: impl Fn(usize) -> u32,
) -> Vec<[u32; 3]> {
    match mode {
        Mode::Triangles => {
            (0..count / 3).map(|i| [3 * i, 3 * i + 1, 3 * i + 2].map(&vertex)).collect()
        }
        // Every second triangle of a strip runs the other way.
        Mode::Strip => (0..count.saturating_sub(2))
            .map(|i| [i, i + 1 + i % 2, i + 2 - i % 2].map(&vertex))
            .collect(),
        Mode::Fan => (0..count.saturating_sub(2)).map(|i| [i + 1, i + 2, 0].map(&vertex)).collect(),
    }
}

/// Removes the triangles without area: those whose normal single precision cannot tell. Returns how
/// many they were.
pub(super) fn drop_degenerate(triangles: &mut Vec<[u32; 3]>, positions: &[Vec3]) -> usize {
    let before = triangles.len();
    triangles.retain(|t| {
        let [a, b, c] = t.map(|i| positions[i as usize]);
        let (ab, ac) = (b - a, c - a);
        let (abd, acd) = (ab.as_dvec3(), ac.as_dvec3());
        let area = abd.cross(acd).length();
        let longest =
            abd.length_squared().max(acd.length_squared()).max((acd - abd).length_squared());
        area > 1e-12 * longest && ab.cross(ac).try_normalize().is_some()
    });
    before - triangles.len()
}

/// The vertices that triangles use, in ascending order; `None` if those are all `count` vertices.
pub(super) fn used_vertices(triangles: &[[u32; 3]], count: usize) -> Option<Vec<u32>> {
    let mut used: Vec<u32> = triangles.as_flattened().to_vec();
    used.sort_unstable();
    used.dedup();
    (used.len() < count).then_some(used)
}

/// Renumbers the corners of triangles from vertices to places in `used`, which has every one of
/// them.
pub(super) fn renumber(triangles: &mut [[u32; 3]], used: &[u32]) {
    for corner in triangles.as_flattened_mut() {
        if let Ok(place) = used.binary_search(corner) {
            *corner = place as u32;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn modes_follow_the_specification() {
        let make = |mode, n| triangulate(mode, n, |i| i as u32 + 10);
        assert_eq!(make(Mode::Triangles, 7), [[10, 11, 12], [13, 14, 15]]);
        assert_eq!(make(Mode::Strip, 5), [[10, 11, 12], [11, 13, 12], [12, 13, 14]]);
        assert_eq!(make(Mode::Fan, 5), [[11, 12, 10], [12, 13, 10], [13, 14, 10]]);
        for mode in [Mode::Triangles, Mode::Strip, Mode::Fan] {
            assert!((0..3).all(|n| make(mode, n).is_empty()));
        }
    }

    #[test]
    fn triangles_without_area_go_and_thin_ones_stay() {
        let p = [
            Vec3::ZERO,
            Vec3::X,
            2.0 * Vec3::X,
            Vec3::new(0.5, 1e-6, 0.0),
            Vec3::new(1e-30, 0.0, 0.0),
            Vec3::new(0.0, 1e-30, 0.0),
        ];
        let mut triangles = vec![[0, 1, 2], [0, 0, 1], [0, 1, 3], [0, 4, 5]];
        assert_eq!(drop_degenerate(&mut triangles, &p), 3);
        assert_eq!(triangles, [[0, 1, 3]]);
    }

    #[test]
    fn unused_vertices_are_found_and_skipped() {
        let mut triangles = vec![[7, 3, 9], [9, 3, 4]];
        let used = used_vertices(&triangles, 10).unwrap();
        assert_eq!(used, [3, 4, 7, 9]);
        renumber(&mut triangles, &used);
        assert_eq!(triangles, [[2, 0, 3], [3, 0, 1]]);
        assert!(used_vertices(&triangles, 4).is_none());
    }
}
