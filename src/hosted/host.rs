//! The host: its tracer and what it says of itself.

use super::batch::Batch;
use crate::error::{Error, Result};
use crate::geometry::Aabb;
use std::ops::Range;
use std::sync::atomic::{AtomicU64, Ordering};

/// Gathers that wait at most.
const MOST_WAITING: usize = 192;

/// What a host says of itself and its scene.
#[derive(Clone, Copy, Debug)]
pub struct Description {
    /// Bounds of the scene.
    pub bounds: Aabb,
    /// Changes when the light in the scene does.
    pub scene_hash: u64,
    /// Whether answered radiance has light of all bounces, so that no path goes on.
    pub all_bounces: bool,
    /// Whether the tracer may run on any thread, and on several at once.
    pub concurrent: bool,
    /// Whether rays that miss bring radiance from the environment.
    pub environment: bool,
    /// Rays that a call should have.
    pub preferred_batch: usize,
    /// Most rays of a call.
    pub max_batch: usize,
}

impl Description {
    /// Rays that a call has where the host has no wish.
    pub const PREFERRED_BATCH: usize = 65536;
}

type Tracer = dyn Fn(&mut Batch, Range<usize>) -> Result<()> + Send + Sync;

/// A renderer that keeps its scene.
pub struct Host {
    description: Description,
    tracer: Box<Tracer>,
    calls: AtomicU64,
    rays: AtomicU64,
}

impl Host {
    /// A host whose `tracer` fills the answers of a range of a batch.
    ///
    /// # Errors
    /// [`Error::InvalidArgument`] where the bounds are empty or not finite.
    pub fn new(
        description: Description,
        tracer: impl Fn(&mut Batch, Range<usize>) -> Result<()> + Send + Sync + 'static,
    ) -> Result<Self> {
        let Aabb { min, max } = description.bounds;
        let sound = min.is_finite() && max.is_finite() && min.cmple(max).all();
        if !sound || description.bounds.diagonal() <= 0.0 {
            return Err(Error::InvalidArgument("host: the bounds are empty or no numbers".into()));
        }
        let (calls, rays) = Default::default();
        Ok(Self { description, tracer: Box::new(tracer), calls, rays })
    }

    /// Calls of the tracer and rays handed to it so far.
    pub fn counts(&self) -> [u64; 2] {
        [&self.calls, &self.rays].map(|c| c.load(Ordering::Relaxed))
    }

    /// Threads on which gathers of `rays` rays each should wait, so that a batch is full.
    pub fn gathering_threads(&self, rays: usize, processors: usize) -> usize {
        (self.preferred_batch / rays.max(1)).clamp(processors, MOST_WAITING.max(processors))
    }

    /// Has `batch` traced in calls of at most `max_batch` rays, and checks the answers.
    ///
    /// # Errors
    /// [`Error::Host`] when the tracer fails or an answer is impossible.
    pub fn trace(&self, batch: &mut Batch) -> Result<()> {
        let most = self.max_batch.max(1);
        for begin in (0..batch.len()).step_by(most) {
            let end = batch.len().min(begin.saturating_add(most));
            let outcome = (self.tracer)(batch, begin..end);
            self.calls.fetch_add(1, Ordering::Relaxed);
            self.rays.fetch_add((end - begin) as u64, Ordering::Relaxed);
            outcome?;
            (begin..end).try_for_each(|i| batch.check(i, i - begin, self.all_bounces))?;
        }
        Ok(())
    }
}

impl std::ops::Deref for Host {
    type Target = Description;

    fn deref(&self) -> &Description {
        &self.description
    }
}
