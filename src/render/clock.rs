//! Wall and CPU time of the phases of a run.

use crate::progress::Phase;
use nix::sys::resource::{UsageWho, getrusage};
use nix::sys::time::TimeValLike;
use serde_json::{Value, json};
use std::time::Instant;

/// Seconds spent in one phase.
#[derive(Clone, Copy, Debug, Default)]
struct Spent {
    wall: f64,
    cpu: f64,
}

/// A stopwatch that knows which phase runs.
pub struct Clock {
    running: Option<(Phase, Instant, f64)>,
    spent: [Spent; Phase::ALL.len()],
}

/// CPU seconds of the whole process so far.
fn cpu_seconds() -> f64 {
    getrusage(UsageWho::RUSAGE_SELF).map_or(0.0, |u| {
        (u.user_time().num_microseconds() + u.system_time().num_microseconds()) as f64 * 1e-6
    })
}

/// Largest resident set of the process so far, in bytes.
pub fn peak_memory_bytes() -> u64 {
    getrusage(UsageWho::RUSAGE_SELF).map_or(0, |u| u.max_rss() as u64 * 1024)
}

impl Default for Clock {
    fn default() -> Self {
        Self { running: None, spent: [Spent::default(); Phase::ALL.len()] }
    }
}

impl Clock {
    /// Ends the phase that runs, if any, and starts `phase`.
    pub fn start(&mut self, phase: Phase) {
        self.stop();
        self.running = Some((phase, Instant::now(), cpu_seconds()));
    }

    /// Ends the phase that runs, if any.
    pub fn stop(&mut self) {
        if let Some((phase, wall, cpu)) = self.running.take() {
            let spent = &mut self.spent[phase as usize];
            spent.wall += wall.elapsed().as_secs_f64();
            spent.cpu += cpu_seconds() - cpu;
        }
    }

    /// Wall seconds over all phases that ended.
    pub fn total_seconds(&self) -> f64 {
        self.spent.iter().map(|s| s.wall).sum()
    }

    /// Wall and CPU seconds spent in `phase`.
    pub fn seconds(&self, phase: Phase) -> [f64; 2] {
        let spent = self.spent[phase as usize];
        [spent.wall, spent.cpu]
    }

    /// Adds the seconds of `other`.
    pub fn add(&mut self, other: &Self) {
        for (sum, spent) in self.spent.iter_mut().zip(other.spent) {
            sum.wall += spent.wall;
            sum.cpu += spent.cpu;
        }
    }

    /// `{"load": {"seconds": .., "cpu_seconds": ..}, ..}`.
    pub fn to_json(&self) -> Value {
        Phase::ALL
            .iter()
            // Part of the fill.
            .filter(|&&p| p != Phase::Solve)
            .map(|&p| {
                let s = self.spent[p as usize];
                (p.name().replace(' ', "_"), json!({"seconds": s.wall, "cpu_seconds": s.cpu}))
            })
            .collect()
    }
}
