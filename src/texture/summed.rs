//! Sums over parts of a texture, however often it repeats.

use super::Wrap;
use crate::math::{DVec2, Vec2};

/// Share of a triangle's sum that a piece of its border may hold to be judged by its area alone, or
/// by which its halves may differ from what their areas say.
const FINE: f64 = 1e-4;
/// The same for the first guess of that sum.
const COARSE: f64 = 1e-3;
/// A piece with even halves may hold so many times as much: most textures are alike all over.
const EVEN: f64 = 32.0;

/// A grid of `N` numbers from 0 on per cell that is summed over rectangles in constant time
/// [Crow84], wrapped over the whole plane as the sampler says. Coordinates count cells.
#[derive(Clone, Debug)]
pub struct SummedTable<const N: usize> {
    size: [usize; 2],
    wrap: [Wrap; 2],
    /// Sums over the cells above and to the left of each corner of the grid: whole numbers, so
    /// that differences are exact and a dark window is exactly 0.
    sums: Vec<[f64; N]>,
    /// What 1 of the sums stands for.
    unit: [f64; N],
}

/// A rectangle of cells: from the first corner to the second one.
pub type Window = [[i64; 2]; 2];

impl<const N: usize> SummedTable<N> {
    /// A table of `size` columns and rows, whose values stand row by row in `values`. Values are
    /// rounded up to multiples of 2⁻²⁶ of the largest one.
    pub fn new(
        size: [usize; 2], wrap: [Wrap; 2], values: impl Iterator<Item = [f32; N]> + Clone,
    ) -> Self {
        let [width, height] = size;
        let largest = values
            .clone()
            .fold([0.0; N], |most, value| std::array::from_fn(|k| f32::max(most[k], value[k])));
        let unit = |most: f32| if most > 0.0 { f64::from(most) * 2f64.powi(-26) } else { 1.0 };
        let unit = largest.map(unit);
        let mut sums = vec![[0.0; N]; (width + 1) * (height + 1)];
        let mut row = [0.0; N];
        for (i, value) in values.take(width * height).enumerate() {
            let (x, y) = (i % width, i / width);
            let above = sums[y * (width + 1) + x + 1];
            let below = &mut sums[(y + 1) * (width + 1) + x + 1];
            for k in 0..N {
                let value = (f64::from(value[k]) / unit[k]).ceil();
                row[k] = if x == 0 { value } else { row[k] + value };
                below[k] = above[k] + row[k];
            }
        }
        Self { size, wrap, sums, unit }
    }

    /// The sums over a rectangle.
    pub fn sums(&self, window: Window) -> [f64; N] {
        self.in_units(self.whole(window))
    }

    /// The sum of the first numbers over a rectangle.
    pub fn sum(&self, window: Window) -> f64 {
        self.sums(window)[0]
    }

    fn in_units(&self, mut sums: [f64; N]) -> [f64; N] {
        sums.iter_mut().zip(self.unit).for_each(|(sum, unit)| *sum *= unit);
        sums
    }

    /// The sums over a rectangle in units: whole numbers.
    fn whole(&self, [[x0, y0], [x1, y1]]: Window) -> [f64; N] {
        let [left, right] = [x0, x1].map(|x| prefix(x, self.size[0], self.wrap[0]));
        let [top, bottom] = [y0, y1].map(|y| prefix(y, self.size[1], self.wrap[1]));
        let columns = [(-1.0, left), (1.0, right)];
        let mut sums = [0.0; N];
        for (sign, rows) in [(-1.0, top), (1.0, bottom)] {
            for (b, y) in rows.into_iter().filter(|(b, _)| *b != 0.0) {
                let line = &self.sums[y * (self.size[0] + 1)..(y + 1) * (self.size[0] + 1)];
                for (side, terms) in columns {
                    for (a, x) in terms.into_iter().filter(|(a, _)| *a != 0.0) {
                        let factor = sign * side * a * b;
                        sums.iter_mut().zip(line[x]).for_each(|(s, term)| *s += factor * term);
                    }
                }
            }
        }
        sums.map(|sum| sum.max(0.0))
    }

    /// The first value of the cell that holds a point.
    pub fn value(&self, at: DVec2) -> f64 {
        let [x, y] = [at.x.floor() as i64, at.y.floor() as i64];
        self.sum([[x, y], [x + 1, y + 1]])
    }

    /// A point of `window` drawn in proportion to the first values; `u` in [0, 1)². The sum over
    /// the window must not be 0.
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

/// The integrals of a table over a triangle. Cells that it cuts count in proportion to their part
/// in it. The first numbers decide how finely: where they are 0, so must be the others.
pub fn integrals<const N: usize>(table: &SummedTable<N>, triangle: [DVec2; 3]) -> [f64; N] {
    let window = window_of(triangle);
    let mut corners = Corners::default();
    triangle.into_iter().for_each(|corner| corners.push(corner));
    let around = table.whole(window);
    let sums = |small| {
        let mut pieces = Pieces { table, small, sums: [0.0; N] };
        pieces.add(window, around, &corners, false);
        pieces.sums
    };
    table.in_units(sums(FINE * sums(COARSE * around[0])[0]))
}

/// Adds up the integrals over pieces of a triangle, in units of the table.
struct Pieces<'a, const N: usize> {
    table: &'a SummedTable<N>,
    /// Pieces of the border that hold no more are not cut further.
    small: f64,
    sums: [f64; N],
}

impl<const N: usize> Pieces<'_, N> {
    /// Adds those over a convex polygon in `window`, over which the sums are `around`. `even` says
    /// whether the window is half of a piece with even halves.
    fn add(&mut self, window: Window, around: [f64; N], polygon: &Corners, even: bool) {
        let [[x0, y0], [x1, y1]] = window;
        let (width, height) = (x1 - x0, y1 - y0);
        let whole = around[0];
        let share = area(polygon.get()) / (width as f64 * height as f64);
        if whole <= 0.0 || share <= 0.0 {
            return;
        }
        if share >= 1.0 - 1e-12 || width * height <= 1 || whole <= self.small {
            return self.take(around, share);
        }
        let (axis, middle) =
            if width >= height { (0, x0 + width / 2) } else { (1, y0 + height / 2) };
        let (mut first, mut second) = (window, window);
        (first[1][axis], second[0][axis]) = (middle, middle);
        let sums = self.table.whole(first);
        let part = (middle - window[0][axis]) as f64 / (window[1][axis] - window[0][axis]) as f64;
        let halves_even = (sums[0] - part * whole).abs() <= self.small;
        if even && halves_even && whole <= EVEN * self.small {
            return self.take(around, share);
        }
        let [below, above] = polygon.cut(axis, middle as f64);
        let rest = std::array::from_fn(|k| (around[k] - sums[k]).max(0.0));
        self.add(first, sums, &below, halves_even);
        self.add(second, rest, &above, halves_even);
    }

    /// Adds the part `share` of a piece.
    fn take(&mut self, around: [f64; N], share: f64) {
        self.sums.iter_mut().zip(around).for_each(|(sum, piece)| *sum += piece * share.min(1.0));
    }
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
    use crate::sampling::hash;

    const MODES: [Wrap; 3] = [Wrap::Repeat, Wrap::Mirror, Wrap::Clamp];

    /// A grid of 5 by 3 with a dark and a bright part, and its values in the endless plane.
    fn table(wrap: [Wrap; 2]) -> (SummedTable<1>, impl Fn(i64, i64) -> f64) {
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
        (SummedTable::new([5, 3], wrap, values.iter().map(|v| [*v])), at)
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
            let exact = integrals(&table, corners)[0] / area(&corners);
            assert!((exact / mean - 1.0).abs() < 2e-3, "{wrap:?}: {exact} {mean}");
        }
    }

    /// Against those in which every cell is cut.
    #[test]
    fn integrals_of_noise_and_of_single_cells_are_right_within_a_thousandth() {
        let side = 256;
        let number = |seed: u64, i: u64| hash(&[seed, i]) as u32 as f32 / u32::MAX as f32;
        let noise = |i: u64| number(1, i);
        let few = |i: u64| f32::from(number(2, i) < 0.01);
        for values in [&noise as &dyn Fn(u64) -> f32, &few] {
            let cells = (0..(side * side) as u64).map(|i| [values(i), values(i).powi(2)]);
            let table = SummedTable::new([side; 2], [Wrap::Repeat; 2], cells);
            let mut squares = 0.0;
            for k in 0..200 {
                let corners = [0, 1, 2_u64].map(|c| {
                    let at = |axis| f64::from(number(3, 8 * k + 2 * c + axis));
                    300.0 * DVec2::new(at(0), at(1))
                });
                let mut all = Corners::default();
                corners.into_iter().for_each(|corner| all.push(corner));
                let mut pieces = Pieces { table: &table, small: 0.0, sums: [0.0; 2] };
                pieces.add(window_of(corners), table.whole(window_of(corners)), &all, false);
                let exact = table.in_units(pieces.sums);
                let found = integrals(&table, corners);

                let errors = [0, 1].map(|n| (found[n] / exact[n] - 1.0).abs());
                assert!(errors.iter().all(|e| *e < 5e-3), "{corners:?}: {errors:?}");
                squares += errors[0] * errors[0] / 200.0;
            }
            assert!(squares.sqrt() < 1e-3, "{}", squares.sqrt());
        }
    }

    #[test]
    fn a_million_periods_are_summed_as_well() {
        let (table, _) = table([Wrap::Repeat; 2]);
        let far = [DVec2::ZERO, DVec2::new(5e6, 0.0), DVec2::new(0.0, 3e6)];
        let mean = table.sum([[0, 0], [5, 3]]) / 15.0;
        assert!((integrals(&table, far)[0] / area(&far) / mean - 1.0).abs() < 1e-4);
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
