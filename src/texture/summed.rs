//! Sums over parts of a texture, however often it repeats.

use super::Wrap;
use crate::math::{DVec2, Vec2};

/// Share of a triangle's sum that a piece of its border may hold to be judged by its area alone.
const FINE: f64 = 3e-5;
/// The same for the first guess of that sum.
const COARSE: f64 = 1e-3;

/// A grid of numbers from 0 on that is summed over rectangles in constant time [Crow84], wrapped
/// over the whole plane as the sampler says. Coordinates count cells.
#[derive(Clone, Debug)]
pub struct SummedTable {
    size: [usize; 2],
    wrap: [Wrap; 2],
    /// Sums over the cells above and to the left of each corner of the grid: whole numbers, so
    /// that differences are exact and a dark window is exactly 0.
    sums: Vec<f64>,
    /// What 1 of the sums stands for.
    unit: f64,
}

/// A rectangle of cells: from the first corner to the second one.
pub type Window = [[i64; 2]; 2];

impl SummedTable {
    /// A table of `size` columns and rows, whose values stand row by row in `values`. Values are
    /// rounded up to multiples of 2⁻²⁶ of the largest one.
    pub fn new(
        size: [usize; 2], wrap: [Wrap; 2], values: impl Iterator<Item = f32> + Clone,
    ) -> Self {
        let [width, height] = size;
        let largest = f64::from(values.clone().fold(0.0, f32::max));
        let unit = if largest > 0.0 { largest * 2f64.powi(-26) } else { 1.0 };
        let mut sums = vec![0.0; (width + 1) * (height + 1)];
        let mut row = 0.0;
        for (i, value) in values.take(width * height).enumerate() {
            let (x, y) = (i % width, i / width);
            let value = (f64::from(value) / unit).ceil();
            row = if x == 0 { value } else { row + value };
            sums[(y + 1) * (width + 1) + x + 1] = sums[y * (width + 1) + x + 1] + row;
        }
        Self { size, wrap, sums, unit }
    }

    /// The sum over a rectangle.
    pub fn sum(&self, [[x0, y0], [x1, y1]]: Window) -> f64 {
        let [left, right] = [x0, x1].map(|x| prefix(x, self.size[0], self.wrap[0]));
        let [top, bottom] = [y0, y1].map(|y| prefix(y, self.size[1], self.wrap[1]));
        let columns = [(-1.0, left), (1.0, right)];
        let mut sum = 0.0;
        for (sign, rows) in [(-1.0, top), (1.0, bottom)] {
            for (b, y) in rows.into_iter().filter(|(b, _)| *b != 0.0) {
                let line = &self.sums[y * (self.size[0] + 1)..(y + 1) * (self.size[0] + 1)];
                for (side, terms) in columns {
                    for (a, x) in terms.into_iter().filter(|(a, _)| *a != 0.0) {
                        sum += sign * side * a * b * line[x];
                    }
                }
            }
        }
        sum.max(0.0) * self.unit
    }

    /// The value of the cell that holds a point.
    pub fn value(&self, at: DVec2) -> f64 {
        let [x, y] = [at.x.floor() as i64, at.y.floor() as i64];
        self.sum([[x, y], [x + 1, y + 1]])
    }

    /// A point of `window` drawn in proportion to the values; `u` in [0, 1)². The sum over the
    /// window must not be 0.
    pub fn sample(&self, window: Window, u: Vec2) -> DVec2 {
        let [[x0, y0], [x1, y1]] = window;
        let (x, fx) = self.find(f64::from(u.x), x0, x1, |a, b| [[a, y0], [b, y1]]);
        let (y, fy) = self.find(f64::from(u.y), y0, y1, |a, b| [[x, a], [x + 1, b]]);
        DVec2::new(x as f64 + fx, y as f64 + fy)
    }

    /// The column or row at the share `u` of the sum from `first` to `end`, and the place in it.
    fn find(
        &self, u: f64, first: i64, end: i64, window: impl Fn(i64, i64) -> Window,
    ) -> (i64, f64) {
        let target = u * self.sum(window(first, end));
        let (mut low, mut high) = (first, end);
        while high - low > 1 {
            let middle = low + (high - low) / 2;
            if self.sum(window(first, middle)) <= target { low = middle } else { high = middle }
        }
        let inside = self.sum(window(low, high));
        let place = (target - self.sum(window(first, low))) / inside;
        (low, if place.is_finite() { place.clamp(0.0, 1.0 - f64::EPSILON) } else { 0.5 })
    }
}

/// The integrals of tables of one size over a triangle. Cells that it cuts count in proportion to
/// their part in it. The first table decides how finely: where it is 0, so must be the others.
pub fn integrals<const N: usize>(tables: [&SummedTable; N], triangle: [DVec2; 3]) -> [f64; N] {
    let window = window_of(triangle);
    let mut corners = Corners::default();
    triangle.into_iter().for_each(|corner| corners.push(corner));
    let around = tables[0].sum(window);
    let sums = |share| {
        let mut sums = [0.0; N];
        pieces(tables, window, &corners, share, &mut sums);
        sums
    };
    sums(FINE * sums(COARSE * around)[0])
}

/// Adds the integrals over a convex polygon in `window`. Pieces of the border that hold no more
/// than `small` are not cut further.
fn pieces<const N: usize>(
    tables: [&SummedTable; N], window: Window, polygon: &Corners, small: f64, sums: &mut [f64; N],
) {
    let [[x0, y0], [x1, y1]] = window;
    let (width, height) = (x1 - x0, y1 - y0);
    let whole = tables[0].sum(window);
    let share = area(polygon.get()) / (width as f64 * height as f64);
    if whole <= 0.0 || share <= 0.0 {
        return;
    }
    if share >= 1.0 - 1e-12 || width * height <= 1 || whole <= small {
        sums[0] += whole * share.min(1.0);
        for k in 1..N {
            sums[k] += tables[k].sum(window) * share.min(1.0);
        }
        return;
    }
    let (axis, middle) = if width >= height { (0, x0 + width / 2) } else { (1, y0 + height / 2) };
    let [below, above] = polygon.cut(axis, middle as f64);
    let (mut first, mut second) = (window, window);
    (first[1][axis], second[0][axis]) = (middle, middle);
    pieces(tables, first, &below, small, sums);
    pieces(tables, second, &above, small, sums);
}

/// The corners of a triangle cut by the sides of a rectangle: at most seven.
#[derive(Clone, Copy, Default)]
struct Corners {
    at: [DVec2; 8],
    count: usize,
}

impl Corners {
    fn push(&mut self, corner: DVec2) {
        // Rounding makes a few more corners of slivers; they bound no area.
        if self.count < self.at.len() {
            self.at[self.count] = corner;
            self.count += 1;
        }
    }

    fn get(&self) -> &[DVec2] {
        &self.at[..self.count]
    }

    /// The parts below and above a line across an axis [Sutherland74, pp. 32-42].
    fn cut(&self, axis: usize, bound: f64) -> [Self; 2] {
        let [mut below, mut above] = [Self::default(); 2];
        for (i, &p) in self.get().iter().enumerate() {
            let next = self.at[if i + 1 == self.count { 0 } else { i + 1 }];
            let (here, there) = (p[axis] - bound, next[axis] - bound);
            if here <= 0.0 {
                below.push(p);
            }
            if here >= 0.0 {
                above.push(p);
            }
            if here * there < 0.0 {
                let crossing = p + (next - p) * (here / (here - there));
                below.push(crossing);
                above.push(crossing);
            }
        }
        [below, above]
    }
}

/// The cells that a triangle touches.
pub fn window_of(triangle: [DVec2; 3]) -> Window {
    let [a, b, c] = triangle;
    let (min, max) = (a.min(b).min(c).floor(), a.max(b).max(c).ceil());
    let lower = [min.x as i64, min.y as i64];
    [lower, [(max.x as i64).max(lower[0] + 1), (max.y as i64).max(lower[1] + 1)]]
}

/// The sum over the first `i` cells of the endless plane as factors on sums over the first cells of
/// the table; negative `i` count backwards.
fn prefix(i: i64, size: usize, wrap: Wrap) -> [(f64, usize); 2] {
    let n = size as i64;
    match wrap {
        Wrap::Repeat => [(i.div_euclid(n) as f64, size), (1.0, i.rem_euclid(n) as usize)],
        Wrap::Mirror => {
            let (periods, rest) = (i.div_euclid(2 * n), i.rem_euclid(2 * n));
            if rest <= n {
                [((2 * periods) as f64, size), (1.0, rest as usize)]
            } else {
                [((2 * periods + 2) as f64, size), (-1.0, (2 * n - rest) as usize)]
            }
        }
        Wrap::Clamp if i < 0 => [(i as f64, 1), (0.0, 0)],
        Wrap::Clamp if i > n => [((1 + i - n) as f64, size), ((n - i) as f64, size - 1)],
        Wrap::Clamp => [(1.0, i as usize), (0.0, 0)],
    }
}

/// The area of a polygon.
pub fn area(corners: &[DVec2]) -> f64 {
    let Some(&first) = corners.first() else { return 0.0 };
    let pairs = corners.windows(2).map(|p| (p[0] - first).perp_dot(p[1] - first));
    0.5 * pairs.sum::<f64>().abs()
}

#[cfg(test)]
mod tests {
    use super::*;

    const MODES: [Wrap; 3] = [Wrap::Repeat, Wrap::Mirror, Wrap::Clamp];

    /// A grid of 5 by 3 with a dark and a bright part, and its values in the endless plane.
    fn table(wrap: [Wrap; 2]) -> (SummedTable, impl Fn(i64, i64) -> f64) {
        let values: Vec<f32> = (0..15).map(|i| (i * i % 7) as f32).collect();
        let at = move |x: i64, y: i64| {
            let fold = |i: i64, n: i64, wrap| match wrap {
                Wrap::Repeat => i.rem_euclid(n),
                Wrap::Mirror if i.rem_euclid(2 * n) < n => i.rem_euclid(2 * n),
                Wrap::Mirror => 2 * n - 1 - i.rem_euclid(2 * n),
                Wrap::Clamp => i.clamp(0, n - 1),
            };
            f64::from(((fold(y, 3, wrap[1]) * 5 + fold(x, 5, wrap[0])) as i32).pow(2) % 7)
        };
        (SummedTable::new([5, 3], wrap, values.iter().copied()), at)
    }

    #[test]
    fn sums_are_those_of_the_wrapped_cells() {
        for wrap in MODES.into_iter().flat_map(|a| MODES.map(|b| [a, b])) {
            let (table, at) = table(wrap);
            for window in
                [[[0, 0], [5, 3]], [[-13, -8], [17, 11]], [[2, 4], [3, 5]], [[9, -4], [21, 2]]]
            {
                let [[x0, y0], [x1, y1]] = window;
                let sum: f64 = (y0..y1)
                    .flat_map(|y| (x0..x1).map(move |x| (x, y)))
                    .map(|(x, y)| at(x, y))
                    .sum();
                assert!((table.sum(window) - sum).abs() < 1e-4, "{wrap:?} {window:?}");
            }
        }
    }

    /// Against the mean of the cells at a million points.
    #[test]
    fn integrals_over_triangles_are_those_of_fine_grids() {
        for wrap in MODES.map(|mode| [mode; 2]) {
            let (table, _) = table(wrap);
            let corners = [DVec2::new(-7.3, 1.2), DVec2::new(9.4, -3.7), DVec2::new(4.9, 8.6)];
            let side = 1000;
            let mut sum = 0.0;
            for i in 0..side {
                for j in 0..side - i {
                    let (u, v) = (f64::from(i) + 1.0 / 3.0, f64::from(j) + 1.0 / 3.0);
                    let [a, b, c] = corners;
                    sum += table.value(a + ((b - a) * u + (c - a) * v) / f64::from(side));
                }
            }
            let mean = sum / f64::from(side * (side + 1) / 2);
            let exact = integrals([&table], corners)[0] / area(&corners);
            assert!((exact / mean - 1.0).abs() < 2e-3, "{wrap:?}: {exact} {mean}");
        }
    }

    #[test]
    fn a_million_periods_are_summed_as_well() {
        let (table, _) = table([Wrap::Repeat; 2]);
        let far = [DVec2::ZERO, DVec2::new(5e6, 0.0), DVec2::new(0.0, 3e6)];
        let mean = table.sum([[0, 0], [5, 3]]) / 15.0;
        assert!((integrals([&table], far)[0] / area(&far) / mean - 1.0).abs() < 1e-4);
    }

    #[test]
    fn samples_fall_in_proportion_to_the_values() {
        let (table, at) = table([Wrap::Mirror, Wrap::Repeat]);
        let window = [[-4, -2], [8, 5]];
        let (side, total) = (400, table.sum(window));
        let mut counts = std::collections::HashMap::new();
        for i in 0..side * side {
            let u = (Vec2::new((i % side) as f32, (i / side) as f32) + 0.5) / side as f32;
            let p = table.sample(window, u).floor();
            *counts.entry((p.x as i64, p.y as i64)).or_insert(0.0) += 1.0 / f64::from(side * side);
        }
        for (x, y) in (-4..8).flat_map(|x| (-2..5).map(move |y| (x, y))) {
            let share = counts.get(&(x, y)).copied().unwrap_or(0.0);
            // A column is off by two points of the grid at most, of which its cells have their
            // part.
            assert!((share - at(x, y) / total).abs() < 1e-3, "{x} {y}: {share}");
        }
    }
}
