//! The sample stream of one light path.

use super::{Rng, hash};
use crate::math::Vec2;

/// Owen-scrambled Sobol points (Burley 2020 [Burley20]), dimension after dimension, for one sample
/// of one pixel; beyond the tabulated dimensions a hashed stream goes on. A pure function of
/// `(seed, index)`.
#[derive(Clone, Debug)]
pub struct Sampler {
    index: u32,
    seed: u32,
    /// Next set of four dimensions.
    set: u32,
    buffer: [f32; 4],
    used: usize,
    tail: Rng,
}

/// Sets of four dimensions that the Sobol table holds.
const SETS: u32 = sobol_burley::NUM_DIMENSION_SETS_4D;

impl Sampler {
    /// Sample `index` of the sequence that `seed` scrambles: the indices 0..n of one seed are well
    /// distributed together.
    pub fn new(seed: u64, index: u32) -> Self {
        let tail = Rng::new(hash(&[seed, u64::from(index)]));
        Self {
            index: index & 0xffff,
            seed: (seed ^ (seed >> 32)) as u32 ^ (index >> 16),
            set: 0,
            buffer: [0.0; 4],
            used: 4,
            tail,
        }
    }

    fn refill(&mut self) {
        self.buffer = if self.set < SETS {
            sobol_burley::sample_4d(self.index, self.set, self.seed)
        } else {
            let (a, b) = (self.tail.next_2d(), self.tail.next_2d());
            [a.x, a.y, b.x, b.y]
        };
        self.set += 1;
        self.used = 0;
    }

    /// The next dimension, in [0, 1).
    #[inline]
    pub fn next_1d(&mut self) -> f32 {
        if self.used >= 4 {
            self.refill();
        }
        self.used += 1;
        self.buffer[self.used - 1]
    }

    /// The next two dimensions of one stratified pair, each in [0, 1).
    #[inline]
    pub fn next_2d(&mut self) -> Vec2 {
        if self.used >= 3 {
            self.refill();
        }
        self.used += 2;
        Vec2::new(self.buffer[self.used - 2], self.buffer[self.used - 1])
    }
}
