//! Progress and cancellation: one object that the fill and the frame both report through.

use std::sync::atomic::{AtomicBool, AtomicU8, AtomicU64, Ordering};

/// The phases of a run, in order.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub enum Phase {
    /// Reading the scene file and its textures.
    Load,
    /// Building the ray tracing structure.
    Build,
    /// Finding out how light passes between surfaces behind the visible ones.
    Solve,
    /// Making cache records.
    Fill,
    /// Rendering pixels.
    Render,
    /// Taking out noise.
    Denoise,
    /// Writing files.
    Write,
}

impl Phase {
    /// Every phase, in the order in which a run goes through them.
    pub const ALL: [Self; 7] = [
        Self::Load,
        Self::Build,
        Self::Solve,
        Self::Fill,
        Self::Render,
        Self::Denoise,
        Self::Write,
    ];

    /// The name as it is shown and written into statistics.
    pub fn name(self) -> &'static str {
        match self {
            Self::Load => "load",
            Self::Build => "accel build",
            Self::Solve => "solve",
            Self::Fill => "fill",
            Self::Render => "render",
            Self::Denoise => "denoise",
            Self::Write => "write",
        }
    }
}

/// Shared state of a running job: where it is, and whether it should stop.
///
/// Workers call [`Progress::advance`] and poll [`Progress::is_cancelled`]; a watcher reads
/// [`Progress::snapshot`].
#[derive(Debug, Default)]
pub struct Progress {
    phase: AtomicU8,
    done: AtomicU64,
    total: AtomicU64,
    cancelled: AtomicBool,
}

/// One reading of a [`Progress`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Snapshot {
    /// The phase that runs now.
    pub phase: Phase,
    /// Units of work done in this phase.
    pub done: u64,
    /// Units of work of this phase, 0 where unknown.
    pub total: u64,
}

impl Progress {
    /// Starts `phase` with `total` units of work (0 where unknown).
    pub fn start(&self, phase: Phase, total: u64) {
        self.done.store(0, Ordering::Relaxed);
        self.total.store(total, Ordering::Relaxed);
        self.phase.store(phase as u8, Ordering::Release);
    }

    /// Adds `units` of finished work.
    pub fn advance(&self, units: u64) {
        self.done.fetch_add(units, Ordering::Relaxed);
    }

    /// Raises the finished work to `units`, if it is less.
    pub fn reach(&self, units: u64) {
        self.done.fetch_max(units, Ordering::Relaxed);
    }

    /// Adds `units` to the work still to do, when more is found on the way.
    pub fn extend(&self, units: u64) {
        self.total.fetch_add(units, Ordering::Relaxed);
    }

    /// Where the job is.
    pub fn snapshot(&self) -> Snapshot {
        let phase =
            Phase::ALL[usize::from(self.phase.load(Ordering::Acquire)).min(Phase::ALL.len() - 1)];
        Snapshot {
            phase,
            done: self.done.load(Ordering::Relaxed),
            total: self.total.load(Ordering::Relaxed),
        }
    }

    /// Asks the job to stop at its next safe point. Safe to call from a signal handling thread.
    pub fn cancel(&self) {
        self.cancelled.store(true, Ordering::Release);
    }

    /// True once [`Progress::cancel`] was called.
    pub fn is_cancelled(&self) -> bool {
        self.cancelled.load(Ordering::Acquire)
    }
}
