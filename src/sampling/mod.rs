//! Random numbers that depend on counters alone, low-discrepancy points, and warps with their
//! densities and inverses.

pub mod stream;
mod sampler;
mod warp;

pub use sampler::Sampler;
pub use warp::{
    cosine_hemisphere_pdf, cosine_hemisphere_to_square, disk_to_square, lattice_point,
    sample_linear, square_to_cosine_hemisphere, square_to_disk, square_to_triangle,
};

/// Paths of fewer surface interactions are never ended by Russian roulette.
pub const ROULETTE_AFTER: u32 = 4;
/// Highest probability of survival in Russian roulette.
pub const MAX_SURVIVAL: f32 = 0.98;
/// A bound on unlimited paths: beyond any that light in a scene takes, short of a hall of perfect
/// mirrors.
pub const LONGEST_PATH: u32 = 4096;

/// Mixes the bits of `x`: every input bit changes about half of the output bits. A bijection on 64
/// bits (the finaliser of SplitMix64 [Steele14]).
#[inline]
pub fn mix(x: u64) -> u64 {
    let x = (x ^ (x >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    let x = (x ^ (x >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    x ^ (x >> 31)
}

/// A hash of a sequence of words, for seeds: `hash(&[pixel, depth, seed])`.
#[inline]
pub fn hash(words: &[u64]) -> u64 {
    words.iter().fold(0x9e37_79b9_7f4a_7c15, |h, &w| {
        mix(h ^ w.wrapping_mul(0xd6e8_feb8_6659_fd93)).wrapping_add(0x9e37_79b9_7f4a_7c15)
    })
}

/// The upper 24 bits of `x` as a number in [0, 1).
#[inline]
pub fn unit_f32(x: u32) -> f32 {
    (x >> 8) as f32 * (1.0 / 16_777_216.0)
}

/// A random stream that is a pure function of its seed (SplitMix64).
#[derive(Clone, Debug)]
pub struct Rng {
    state: u64,
}

impl Rng {
    /// The stream of `seed`.
    pub fn new(seed: u64) -> Self {
        Self { state: seed }
    }

    /// The next 64 bits.
    #[inline]
    pub fn next_u64(&mut self) -> u64 {
        self.state = self.state.wrapping_add(0x9e37_79b9_7f4a_7c15);
        mix(self.state)
    }

    /// The next number, uniform in [0, 1).
    #[inline]
    pub fn next_f32(&mut self) -> f32 {
        unit_f32((self.next_u64() >> 32) as u32)
    }

    /// Two independent numbers, uniform in [0, 1).
    #[inline]
    pub fn next_2d(&mut self) -> crate::math::Vec2 {
        let x = self.next_u64();
        crate::math::Vec2::new(unit_f32(x as u32), unit_f32((x >> 32) as u32))
    }
}
