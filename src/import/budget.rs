//! A bound on what a file may make of itself in memory.

use super::fault::{Fault, Parsed};

/// Counts the bytes that decoding produces against the bytes that were read, so that a small
/// hostile file cannot fill the memory.
///
/// Honest files come nowhere near: an index of one byte becomes four, a position of six becomes
/// twelve.
#[derive(Debug)]
pub(super) struct Budget {
    left: u64,
}

impl Budget {
    /// Bytes of geometry that any file may decode to.
    const GEOMETRY: u64 = 1 << 29;
    /// Bytes that checks of any file may look at.
    const WORK: u64 = 1 << 27;
    /// Bytes of pixels that any file may decode to; pictures of one colour compress a thousandfold.
    const PIXELS: u64 = 4 << 30;
    /// Decoded bytes per byte read.
    const RATIO: u64 = 64;

    /// The allowance for the geometry of a file that has yet to be read.
    pub fn of_geometry() -> Self {
        Self { left: Self::GEOMETRY }
    }

    /// The allowance for looking at the bytes of files, of which `self` has been told.
    pub fn of_work(&self) -> Self {
        Self { left: self.left.saturating_sub(Self::GEOMETRY).saturating_add(Self::WORK) }
    }

    /// The allowance for the pixels of images that have yet to be read.
    pub fn of_pixels() -> Self {
        Self { left: Self::PIXELS }
    }

    /// `read` bytes more have been read.
    pub fn feed(&mut self, read: u64) {
        self.left = self.left.saturating_add(read.saturating_mul(Self::RATIO));
    }

    /// `count` elements of `size` bytes are about to be made for what stands at the JSON path `at`.
    pub fn spend(&mut self, count: u64, size: u64, at: &str) -> Parsed<()> {
        let bytes = count.saturating_mul(size);
        match self.left.checked_sub(bytes) {
            Some(left) => {
                self.left = left;
                Ok(())
            }
            None => {
                let what = format!(
                    "{count} more elements of {size} bytes: a file of this size cannot sensibly ask for so much"
                );
                Err(Fault::new(at, what))
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn spending_is_bounded_and_does_not_overflow() {
        let mut budget = Budget::of_geometry();
        assert!(budget.spend(u64::MAX, u64::MAX, "/x").is_err());
        assert!(budget.spend(1 << 20, 12, "/x").is_ok());
        let mut rest = 0;
        while budget.spend(1 << 24, 12, "/x").is_ok() {
            rest += 1;
        }
        assert!(rest < 10);
        budget.feed(u64::MAX);
        assert!(budget.spend(1 << 40, 4, "/x").is_ok());
    }
}
