//! A bound on what a file may make of itself in memory.

use super::fault::{Fault, Parsed, Why};
use crate::error::check_room;

/// Counts the bytes that reading takes, before they are allocated, so that a small hostile file
/// cannot fill the memory.
///
/// Honest files come nowhere near: an index of one byte becomes four, a position of six becomes
/// twelve, and pictures of one colour, which compress a thousandfold, are rarely large.
#[derive(Debug)]
pub(super) struct Budget {
    left: u64,
    /// Bytes of the files that have been read.
    read: u64,
    /// What is left grows with the files.
    grows: bool,
}

impl Budget {
    /// Bytes that any file may take.
    const BASE: u64 = 1 << 30;
    /// Further bytes for each byte that is read.
    const RATIO: u64 = 64;
    /// Bytes that checks of any file may look at.
    const WORK: u64 = 1 << 27;
    /// Allocations from this size on are tried before they are made.
    const LARGE: u64 = 1 << 22;

    /// The allowance for a file that has yet to be read, with those it refers to: `limit` bytes,
    /// else what its size allows.
    pub fn new(limit: Option<u64>) -> Self {
        Self { left: limit.unwrap_or(Self::BASE), read: 0, grows: limit.is_none() }
    }

    /// The allowance for looking at the bytes that have been read.
    pub fn of_work(&self) -> Self {
        let left = self.read.saturating_mul(Self::RATIO).saturating_add(Self::WORK);
        Self { left, read: 0, grows: false }
    }

    /// A file of `bytes` bytes is about to be read for what stands at the JSON path `at`.
    pub fn read(&mut self, bytes: u64, at: &str) -> Parsed<()> {
        self.read = self.read.saturating_add(bytes);
        if self.grows {
            self.left = self.left.saturating_add(bytes.saturating_mul(Self::RATIO));
        }
        self.spend(bytes, 1, at)
    }

    /// `count` elements of `size` bytes are about to be made for what stands at the JSON path `at`.
    pub fn spend(&mut self, count: u64, size: u64, at: &str) -> Parsed<()> {
        let bytes = count.saturating_mul(size);
        let Some(left) = self.left.checked_sub(bytes) else {
            let what = format!(
                "{count} more elements of {size} bytes: a file of this size cannot sensibly ask for so much memory; a higher --memory-limit allows it"
            );
            return Err(Fault { why: Why::Memory, ..Fault::new(at, what) });
        };
        self.left = left;
        if bytes < Self::LARGE {
            return Ok(());
        }
        let what = format_args!("{count} elements of {size} bytes");
        check_room(what, bytes)
            .map_err(|e| Fault { why: Why::Memory, ..Fault::new(at, e.to_string()) })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn spending_is_bounded_and_does_not_overflow() {
        let mut budget = Budget::new(None);
        assert!(budget.spend(u64::MAX, u64::MAX, "/x").is_err());
        assert!(budget.spend(1 << 20, 12, "/x").is_ok());
        let mut rest = 0;
        while budget.spend(1 << 24, 12, "/x").is_ok() {
            rest += 1;
        }
        assert!(rest < 10);
        budget.read(1 << 24, "/x").unwrap();
        assert!(budget.spend(1 << 24, 60, "/x").is_ok());
        let mut limited = Budget::new(Some(1000));
        limited.read(900, "/x").unwrap();
        assert!(limited.spend(101, 1, "/x").is_err() && limited.spend(100, 1, "/x").is_ok());
    }

    #[test]
    fn what_the_memory_does_not_hold_is_an_error() {
        let fault = Budget::new(Some(u64::MAX)).spend(1 << 60, 1, "/x").unwrap_err();
        assert_eq!(fault.why, Why::Memory);
    }
}
