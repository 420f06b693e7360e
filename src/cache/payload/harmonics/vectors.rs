//! The numbers of a radiance record: coefficients of incident radiance and their derivatives, in
//! single or half precision.

use crate::basis::Lane;
use crate::cache::payload::irradiance::SECOND_ORDER;
use crate::cache::scheme::Storage;
use crate::gather::Coefficients;
use crate::math::{Color, Vec2, Vec4};
use half::f16;
use half::slice::HalfFloatSliceExt;

/// Most coefficients of one channel.
pub(super) const MOST: usize = 400;

/// The coefficients of one channel after another, as they are kept.
#[derive(Clone)]
enum Vector {
    Single(Vec<f32>),
    Half { scale: f32, values: Vec<f16> },
}

impl Vector {
    fn new(values: Coefficients, storage: Storage) -> Self {
        match storage {
            Storage::F32 => Self::Single(values),
            Storage::F16 => {
                let scale =
                    values.iter().fold(0.0_f32, |most, v| most.max(v.abs())).max(f32::MIN_POSITIVE);
                Self::Half {
                    scale,
                    values: values.iter().map(|v| f16::from_f32(v / scale)).collect(),
                }
            }
        }
    }

    /// The product of the numbers in `run` with `c`.
    fn dot(&self, first: usize, c: &[f32]) -> f32 {
        match self {
            Self::Single(values) => dot(c, &values[first..first + c.len()]),
            Self::Half { scale, values } => {
                let mut buffer = [0.0; MOST];
                let wide = &mut buffer[..c.len()];
                values[first..first + c.len()].convert_to_f32_slice(wide);
                scale * dot(c, wide)
            }
        }
    }

    fn to_single(&self) -> Coefficients {
        match self {
            Self::Single(values) => values.clone(),
            Self::Half { scale, values } => values.iter().map(|v| scale * v.to_f32()).collect(),
        }
    }

    fn bytes(&self) -> usize {
        match self {
            Self::Single(values) => size_of_val(&values[..]),
            Self::Half { values, .. } => size_of_val(&values[..]),
        }
    }
}

/// The coefficients of a record; then, if it has them, their derivatives along both tangents; then
/// the second ones, twice along the first tangent, along both, twice along the second.
#[derive(Clone)]
pub(super) struct Vectors {
    /// Number of coefficients of one channel.
    count: usize,
    vectors: Vec<Vector>,
}

impl Vectors {
    /// `vectors` are one, three or six.
    pub fn new(vectors: Vec<Coefficients>, storage: Storage) -> Self {
        let count = vectors.first().map_or(0, |v| v.len() / 3);
        Self { count, vectors: vectors.into_iter().map(|v| Vector::new(v, storage)).collect() }
    }

    /// The product, channel by channel, of `c` with the coefficients continued by `offset` along
    /// the tangents, by no more vectors than `most`: 1 for their value, 3 for first order, 6 for
    /// second. The second-order change is no larger than the first-order one and a quarter of
    /// the value together, see [`Curve`](crate::cache::Curve).
    pub fn product(&self, offset: Vec2, c: [&[f32]; 3], most: usize) -> Color {
        let used = self.count.min(c[0].len());
        let vectors = &self.vectors[..self.vectors.len().min(most)];
        let channel = |k: usize| {
            let (at, c) = (k * self.count, &c[k][..used]);
            let term = |v: &Vector| v.dot(at, c);
            let [value, s, t, rest @ ..] = vectors else { return term(&vectors[0]) };
            let [value, s, t] = match [value, s, t] {
                [Vector::Single(value), Vector::Single(s), Vector::Single(t)] => {
                    dots(c, [value, s, t].map(|v| &v[at..at + used]))
                }
                halves => halves.map(term),
            };
            let first = offset.x * s + offset.y * t;
            let [ss, st, tt] = rest else { return value + first };
            let second = 0.5 * offset.x * offset.x * term(ss)
                + offset.x * offset.y * term(st)
                + 0.5 * offset.y * offset.y * term(tt);
            let limit = first.abs() + SECOND_ORDER * value.abs();
            value + first + second.clamp(-limit, limit)
        };
        Color::new(channel(0), channel(1), channel(2))
    }

    /// All vectors in single precision.
    pub fn to_single(&self) -> Vec<Coefficients> {
        self.vectors.iter().map(Vector::to_single).collect()
    }

    /// Bytes of the numbers.
    pub fn bytes(&self) -> usize {
        self.vectors.iter().map(Vector::bytes).sum()
    }
}

/// The product of two vectors of the same length, in eight interleaved sums.
pub(super) fn dot(a: &[f32], b: &[f32]) -> f32 {
    let ((a8, a), (b8, b)) = (a.as_chunks(), b.as_chunks());
    let mut sums = Sums::default();
    a8.iter().zip(b8).for_each(|(a, b)| sums.add(lanes(a), b));
    sums.total(a, b)
}

/// The products of `a` with three vectors that are as long, in one pass whose sums do not wait for
/// each other.
pub(super) fn dots(a: &[f32], [x, y, z]: [&[f32]; 3]) -> [f32; 3] {
    let ((a8, a), (x8, x), (y8, y), (z8, z)) =
        (a.as_chunks(), x.as_chunks(), y.as_chunks(), z.as_chunks());
    let [mut with_x, mut with_y, mut with_z] = [Sums::default(); 3];
    for (((a, x), y), z) in a8.iter().zip(x8).zip(y8).zip(z8) {
        let a = lanes(a);
        with_x.add(a, x);
        with_y.add(a, y);
        with_z.add(a, z);
    }
    [with_x.total(a, x), with_y.total(a, y), with_z.total(a, z)]
}

/// Eight sums. Registers by name: left to itself the compiler packs the three vectors together
/// instead of the lanes of each.
#[derive(Clone, Copy, Default)]
struct Sums([Vec4; 2]);

impl Sums {
    #[inline(always)]
    fn add(&mut self, [a, b]: [Vec4; 2], v: &Lane) {
        let [c, d] = lanes(v);
        self.0[0] += a * c;
        self.0[1] += b * d;
    }

    /// The sum of all, and of the products of what is left of the vectors.
    #[inline(always)]
    fn total(self, a: &[f32], b: &[f32]) -> f32 {
        let rest: f32 = a.iter().zip(b).map(|(a, b)| a * b).sum();
        (self.0[0] + self.0[1]).element_sum() + rest
    }
}

#[inline(always)]
fn lanes(v: &Lane) -> [Vec4; 2] {
    [Vec4::from_slice(&v[..4]), Vec4::from_slice(&v[4..])]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sampling::Rng;

    /// Six vectors of nine coefficients per channel.
    fn vectors(scale: f32) -> Vec<Coefficients> {
        let mut rng = Rng::new(3);
        (0..6).map(|_| (0..27).map(|_| scale * (2.0 * rng.next_f32() - 1.0)).collect()).collect()
    }

    #[test]
    fn half_precision_keeps_three_digits_of_any_magnitude() {
        for scale in [1e-6, 1.0, 1e7] {
            let [single, half] =
                [Storage::F32, Storage::F16].map(|storage| Vectors::new(vectors(scale), storage));
            assert_eq!(single.bytes(), 6 * 27 * 4);
            assert_eq!(half.bytes(), single.bytes() / 2);
            let c = [1.0; 9];
            for most in [1, 3, 6] {
                let [a, b] =
                    [&single, &half].map(|p| p.product(Vec2::new(0.3, -0.2), [&c; 3], most));
                assert!((a - b).length() < 4e-3 * scale, "{a} {b}");
            }
            for (a, b) in single.to_single().concat().iter().zip(half.to_single().concat()) {
                assert!((a - b).abs() < 6e-4 * scale, "{a} {b}");
            }
        }
    }

    #[test]
    fn orders_of_extrapolation_add_up_and_the_second_is_limited() {
        let payload = Vectors::new(vectors(1.0), Storage::F32);
        let v = vectors(1.0);
        // A lobe that picks the second coefficient.
        let mut c = [0.0; 9];
        c[1] = 1.0;
        let at = |d: usize, channel: usize| v[d][9 * channel + 1];
        let x = Vec2::new(0.01, -0.02);
        let [zeroth, first, second] = [1, 3, 6].map(|most| payload.product(x, [&c; 3], most));
        for k in 0..3 {
            assert_eq!(zeroth[k], at(0, k));
            assert!((first[k] - zeroth[k] - x.x * at(1, k) - x.y * at(2, k)).abs() < 1e-6);
            let bend =
                0.5 * (x.x * x.x * at(3, k) + 2.0 * x.x * x.y * at(4, k) + x.y * x.y * at(5, k));
            assert!((second[k] - first[k] - bend).abs() < 1e-6);
        }
        let far = Vec2::splat(1e3);
        let [zeroth, first, second] = [1, 3, 6].map(|most| payload.product(far, [&c; 3], most));
        assert!(
            (second - first)
                .abs()
                .cmple((first - zeroth).abs() * 1.0001 + 0.25 * zeroth.abs())
                .all()
        );
    }
}
