//! Light from infinity: lookup of an equirectangular map and sampling of directions in proportion
//! to it.

use super::source::{EnvironmentMap, weight};
use crate::math::{Affine3A, Color, Frame, INV_PI, PI, Vec2, Vec3};
use crate::sampling::sample_linear;

/// What an infinite pixel (an overflown sun) becomes: the largest finite half.
const INFINITE: f32 = 65504.0;
/// Largest value of a pixel; sums over more would leave the range of numbers.
const MAX_RADIANCE: f32 = 1e20;
/// Sampling grids have at least this many rows and twice as many columns, so that the factor sinθ
/// of coarse maps is resolved.
const MIN_ROWS: u32 = 64;

impl EnvironmentMap {
    /// The same radiance from everywhere.
    pub fn constant(radiance: Color) -> Self {
        Self {
            width: 1,
            height: 1,
            pixels: vec![radiance],
            scale: 1.0,
            from_world: Affine3A::IDENTITY,
        }
    }

    /// Radiance seen along a unit world direction, interpolated bilinearly between pixel centres;
    /// columns wrap round, rows end at the poles.
    pub fn radiance(&self, direction: Vec3) -> Color {
        self.bilinear(self.direction_to_square(direction)) * self.scale
    }

    /// The map's coordinates in the unit square of a unit world direction: x runs along the columns
    /// from the left, y down the rows.
    fn direction_to_square(&self, direction: Vec3) -> Vec2 {
        let d = self.from_world.matrix3 * direction;
        let theta = (d.x * d.x + d.z * d.z).sqrt().atan2(d.y);
        Vec2::new(0.5 + d.z.atan2(d.x) * (0.5 * INV_PI), theta * INV_PI)
    }

    /// The inverse of `direction_to_square`.
    fn square_to_direction(&self, square: Vec2) -> Vec3 {
        let (sin_theta, cos_theta) = (square.y * PI).sin_cos();
        let (sin_phi, cos_phi) = ((square.x - 0.5) * (2.0 * PI)).sin_cos();
        let d = Vec3::new(sin_theta * cos_phi, cos_theta, sin_theta * sin_phi);
        self.from_world.matrix3.transpose() * d
    }

    /// The interpolated pixels, before scaling.
    fn bilinear(&self, square: Vec2) -> Color {
        let (x, y) = (square.x * self.width as f32 - 0.5, square.y * self.height as f32 - 0.5);
        let (left, top) = (x.floor(), y.floor());
        let (fx, fy) = (x - left, y - top);
        let column =
            |offset: i64| (left as i64 + offset).rem_euclid(i64::from(self.width)) as usize;
        let row = |offset: i64| {
            (top as i64 + offset).clamp(0, i64::from(self.height) - 1) as usize
                * self.width as usize
        };
        let (x0, x1, y0, y1) = (column(0), column(1), row(0), row(1));
        let upper = self.pixels[y0 + x0].lerp(self.pixels[y0 + x1], fx);
        let lower = self.pixels[y1 + x0].lerp(self.pixels[y1 + x1], fx);
        upper.lerp(lower, fy)
    }
}

/// An environment with what sampling it needs.
#[derive(Clone, Debug)]
pub(super) struct Environment {
    map: EnvironmentMap,
    /// `None` for a map of one colour.
    grid: Option<Grid>,
    /// ∫ radiance dω over the sphere.
    fluence: Color,
}

impl Environment {
    /// `None` for a map that emits nothing or whose size is not that of its pixels. Pixels that are
    /// not a radiance are replaced: NaN and negative values by 0, infinite ones by the largest
    /// half.
    pub fn new(mut map: EnvironmentMap) -> Option<Self> {
        let size = map.width as usize * map.height as usize;
        if size == 0 || map.pixels.len() != size || !(map.scale > 0.0 && map.scale.is_finite()) {
            return None;
        }
        for pixel in &mut map.pixels {
            *pixel = Vec3::from_array(pixel.to_array().map(radiance_of));
        }
        let fluence = fluence(&map);
        if weight(fluence) <= 0.0 {
            return None;
        }
        let uniform = map.pixels.iter().all(|p| *p == map.pixels[0]);
        let grid = if uniform { None } else { Some(Grid::new(&map)) };
        Some(Self { map, grid, fluence })
    }

    /// Radiance seen along a unit world direction.
    pub fn radiance(&self, direction: Vec3) -> Color {
        if self.grid.is_none() {
            self.map.pixels[0] * self.map.scale
        } else {
            self.map.radiance(direction)
        }
    }

    /// The integral of the radiance over the sphere.
    pub fn fluence(&self) -> Color {
        self.fluence
    }

    /// A direction and its density per steradian: in proportion to the radiance; for a map of one
    /// colour in proportion to the cosine with `n`, or uniform without one.
    pub fn sample(&self, n: Option<Vec3>, u: Vec2) -> (Vec3, f32) {
        match (&self.grid, n) {
            (Some(grid), _) => {
                let (square, density) = grid.sample(&self.map, u);
                (self.map.square_to_direction(square), to_solid_angle(density, square.y))
            }
            (None, Some(n)) => {
                let (sin_phi, cos_phi) = (2.0 * PI * u.x).sin_cos();
                let (r, z) = (u.y.sqrt(), (1.0 - u.y).max(0.0).sqrt());
                (Frame::from_normal(n).to_world(Vec3::new(r * cos_phi, r * sin_phi, z)), z * INV_PI)
            }
            (None, None) => {
                let (sin_phi, cos_phi) = (2.0 * PI * u.x).sin_cos();
                let z = 1.0 - 2.0 * u.y;
                let r = (1.0 - z * z).max(0.0).sqrt();
                (Vec3::new(r * cos_phi, r * sin_phi, z), 0.25 * INV_PI)
            }
        }
    }

    /// Density per steradian with which [`Environment::sample`] chooses a direction.
    pub fn pdf(&self, n: Option<Vec3>, direction: Vec3) -> f32 {
        match (&self.grid, n) {
            (Some(grid), _) => {
                let square = self.map.direction_to_square(direction);
                to_solid_angle(grid.density(&self.map, square), square.y)
            }
            (None, Some(n)) => n.dot(direction).max(0.0) * INV_PI,
            (None, None) => 0.25 * INV_PI,
        }
    }
}

/// A pixel's value as a radiance.
fn radiance_of(value: f32) -> f32 {
    match value {
        f32::INFINITY => INFINITE,
        v if v.is_nan() => 0.0,
        v => v.clamp(0.0, MAX_RADIANCE),
    }
}

/// The density per steradian of a density over the map's square: dω = 2π² sinθ dx dy.
fn to_solid_angle(density: f32, y: f32) -> f32 {
    let sin_theta = (y * PI).sin();
    if sin_theta > 0.0 { density / (2.0 * PI * PI * sin_theta) } else { 0.0 }
}

/// ∫ radiance dω, by the exact solid angle of each pixel.
fn fluence(map: &EnvironmentMap) -> Color {
    let mut total = [0.0_f64; 3];
    for (row, pixels) in map.pixels.chunks_exact(map.width as usize).enumerate() {
        let cos = |y: usize| (std::f64::consts::PI * y as f64 / f64::from(map.height)).cos();
        let pixel_angle =
            2.0 * std::f64::consts::PI * (cos(row) - cos(row + 1)) / f64::from(map.width);
        let sum = pixels.iter().fold([0.0_f64; 3], |s, p| {
            [s[0] + f64::from(p.x), s[1] + f64::from(p.y), s[2] + f64::from(p.z)]
        });
        for (t, s) in total.iter_mut().zip(sum) {
            *t += s * pixel_angle;
        }
    }
    Vec3::from_array(total.map(|t| t as f32)) * map.scale
}

/// A piecewise bilinear density over the map's square, in proportion to radiance times sinθ.
///
/// Its knots are the pixel centres (of a refined grid for coarse maps). The radiance is
/// interpolated between the same knots, so the density is positive wherever the radiance is, and
/// the quotient of both is all but constant. Rows end in a strip of half a pixel at either pole, in
/// which the density of the first or last row continues.
#[derive(Clone, Debug)]
struct Grid {
    columns: usize,
    rows: usize,
    /// For each row of knots, the sums over its first 0, 1, ... cells between neighbouring knots:
    /// `columns + 1` numbers.
    row_sums: Vec<f32>,
    /// The sums over the first 0, 1, ... strips between neighbouring rows: `rows + 2` numbers.
    strip_sums: Vec<f64>,
}

impl Grid {
    fn new(map: &EnvironmentMap) -> Self {
        let columns = map.width as usize * (2 * MIN_ROWS).div_ceil(map.width) as usize;
        let rows = map.height as usize * MIN_ROWS.div_ceil(map.height) as usize;
        let mut grid = Self {
            columns,
            rows,
            row_sums: Vec::with_capacity((columns + 1) * rows),
            strip_sums: Vec::new(),
        };
        for row in 0..rows {
            let first = grid.knot(map, 0, row);
            let (mut sum, mut left) = (0.0_f64, first);
            grid.row_sums.push(0.0);
            for column in 0..columns {
                let right =
                    if column + 1 == columns { first } else { grid.knot(map, column + 1, row) };
                sum += 0.5 * (f64::from(left) + f64::from(right));
                grid.row_sums.push(sum as f32);
                left = right;
            }
        }
        let mut sum = 0.0;
        grid.strip_sums = vec![0.0];
        for strip in 0..=rows {
            let (upper, lower, height) = grid.strip(strip);
            sum += 0.5
                * f64::from(height)
                * (f64::from(grid.row_sum(upper)) + f64::from(grid.row_sum(lower)));
            grid.strip_sums.push(sum);
        }
        grid
    }

    /// The value at the centre of a cell of the refined grid.
    fn knot(&self, map: &EnvironmentMap, column: usize, row: usize) -> f32 {
        let y = (row as f32 + 0.5) / self.rows as f32;
        let radiance = if (self.columns, self.rows) == (map.width as usize, map.height as usize) {
            map.pixels[row * self.columns + column]
        } else {
            map.bilinear(Vec2::new((column as f32 + 0.5) / self.columns as f32, y))
        };
        weight(radiance) * (y * PI).sin()
    }

    /// The rows of knots above and below a strip, and its height in rows.
    fn strip(&self, strip: usize) -> (usize, usize, f32) {
        let height = if strip == 0 || strip == self.rows { 0.5 } else { 1.0 };
        (strip.saturating_sub(1), strip.min(self.rows - 1), height)
    }

    fn row_sum(&self, row: usize) -> f32 {
        self.row_sums[row * (self.columns + 1) + self.columns]
    }

    fn total(&self) -> f64 {
        self.strip_sums[self.rows + 1]
    }

    /// A point of the square and its density there.
    fn sample(&self, map: &EnvironmentMap, u: Vec2) -> (Vec2, f32) {
        // Choose the strip and the height inside it.
        let target = f64::from(u.y) * self.total();
        let strip = self.strip_sums[1..=self.rows].partition_point(|&s| s <= target);
        let (upper, lower, height) = self.strip(strip);
        let (top, bottom) = (self.row_sum(upper), self.row_sum(lower));
        let mass = self.strip_sums[strip + 1] - self.strip_sums[strip];
        let fy = sample_linear(((target - self.strip_sums[strip]) / mass) as f32, top, bottom);
        let y = if strip == 0 { 0.5 * fy } else { strip as f32 - 0.5 + height * fy };

        // Choose the column in the interpolated row.
        let stride = self.columns + 1;
        let (above, below) = (
            &self.row_sums[upper * stride..][..stride],
            &self.row_sums[lower * stride..][..stride],
        );
        let sum = |i: usize| above[i] + fy * (below[i] - above[i]);
        let target = u.x * sum(self.columns);
        let (mut low, mut high) = (0, self.columns);
        while high - low > 1 {
            let middle = usize::midpoint(low, high);
            if sum(middle) <= target { low = middle } else { high = middle }
        }
        let right = if low + 1 == self.columns { 0 } else { low + 1 };
        let value = |column| {
            let (a, b) = (self.knot(map, column, upper), self.knot(map, column, lower));
            a + fy * (b - a)
        };
        let (a, b) = (value(low), value(right));
        let fx = sample_linear((target - sum(low)) / (0.5 * (a + b)), a, b);
        let x = (low as f32 + 0.5 + fx) / self.columns as f32;
        let square = Vec2::new(if x < 1.0 { x } else { x - 1.0 }, y / self.rows as f32);
        (square, self.normalized(a + fx * (b - a)))
    }

    /// The density at a point of the square.
    fn density(&self, map: &EnvironmentMap, square: Vec2) -> f32 {
        let (x, y) = (square.x * self.columns as f32 - 0.5, square.y * self.rows as f32 - 0.5);
        let (left, top) = (x.floor(), y.floor());
        let (fx, fy) = (x - left, y - top);
        let column = |offset: i64| (left as i64 + offset).rem_euclid(self.columns as i64) as usize;
        let row = |offset: i64| (top as i64 + offset).clamp(0, self.rows as i64 - 1) as usize;
        let at = |i, j| self.knot(map, column(i), row(j));
        let (upper, lower) =
            (at(0, 0) + fx * (at(1, 0) - at(0, 0)), at(0, 1) + fx * (at(1, 1) - at(0, 1)));
        self.normalized(upper + fy * (lower - upper))
    }

    /// The density over the unit square of an interpolated value.
    fn normalized(&self, value: f32) -> f32 {
        (f64::from(value) * (self.columns * self.rows) as f64 / self.total()) as f32
    }
}
