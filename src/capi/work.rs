//! Long work: on the device's threads, while the calling thread serves the host's callbacks.

use super::cache::CacheObject;
use super::device;
use super::host::{Exchange, Host};
use super::scene::World;
use super::status::Outcome;
use crate::error::Error;
use crate::progress::Progress;
use std::ffi::CString;
use std::sync::{Condvar, Mutex, PoisonError};
use std::time::Duration;

/// How often the host hears of progress.
const INTERVAL: Duration = Duration::from_millis(50);

/// Ends the waiting of the calling thread, also when the work panics.
struct End<'a> {
    done: &'a Done,
    exchange: &'a Exchange,
}

#[derive(Default)]
struct Done {
    done: Mutex<bool>,
    changed: Condvar,
}

impl Done {
    /// Waits for the end for `time` at most; true once it has come.
    fn wait(&self, time: Duration) -> bool {
        let done = self.done.lock().unwrap_or_else(PoisonError::into_inner);
        if *done {
            return true;
        }
        *self.changed.wait_timeout(done, time).unwrap_or_else(PoisonError::into_inner).0
    }
}

impl Drop for End<'_> {
    fn drop(&mut self) {
        *self.done.done.lock().unwrap_or_else(PoisonError::into_inner) = true;
        self.done.changed.notify_all();
        self.exchange.close();
    }
}

impl CacheObject {
    /// Runs `work` on other threads. Meanwhile this one, if the host wants it so, calls the host's
    /// tracer, and tells of `progress` where it is watched.
    pub fn run<R: Send>(
        &self,
        progress: &Progress,
        watched: bool,
        work: impl FnOnce(&Exchange) -> R + Send,
    ) -> Outcome<R> {
        let committed = self.scene.committed()?;
        let host = match &committed.world {
            World::Own(_) => None,
            World::Host(host) => Some(host),
        };
        let pool = match host {
            None => &self.scene.device.pool,
            Some(host) => self.host_pool(host)?,
        };
        let (exchange, done) = (Exchange::default(), Done::default());
        let mut result = None;
        std::thread::scope(|servers| {
            pool.in_place_scope(|scope| {
                let (exchange, done, result) = (&exchange, &done, &mut result);
                scope.spawn(move |_| {
                    let _end = End { done, exchange };
                    *result = Some(work(exchange));
                });
                let concurrent = host.filter(|h| h.is_concurrent());
                if let Some(host) = concurrent {
                    for _ in 0..self.scene.device.pool.current_num_threads() {
                        servers.spawn(move || while exchange.serve(host, INTERVAL) {});
                    }
                }
                let mut serving = host.filter(|h| !h.is_concurrent());
                loop {
                    let ended = match serving {
                        Some(host) => {
                            if !exchange.serve(host, INTERVAL) {
                                serving = None;
                            }
                            false
                        }
                        None => done.wait(INTERVAL),
                    };
                    if ended {
                        break;
                    }
                    if watched {
                        self.report(progress);
                    }
                }
            });
        });
        if let Some(error) = exchange.failure() {
            return Err(error.into());
        }
        // Without a result the work has panicked, and the scope has passed that on.
        result.ok_or_else(|| Error::Cancelled.into())
    }

    /// Threads for gathers that wait for the host; made once.
    fn host_pool(&self, host: &Host) -> Outcome<&rayon::ThreadPool> {
        if let Some(pool) = self.waiting.get() {
            return Ok(pool);
        }
        let rays = self.settings().scheme.gather.rays as usize;
        let threads = host.gathering_threads(rays, self.scene.device.pool.current_num_threads());
        let made = device::pool(threads, "lumicache-gather")?;
        Ok(self.waiting.get_or_init(|| made))
    }

    /// Tells the host how far the work is; stops it if the host says so.
    fn report(&self, progress: &Progress) {
        let Some((callback, user)) = self.watcher() else { return };
        let snapshot = progress.snapshot();
        let fraction = if snapshot.total == 0 {
            0.0
        } else {
            (snapshot.done as f64 / snapshot.total as f64).min(1.0)
        };
        let phase = CString::new(snapshot.phase.name()).unwrap_or_default();
        // SAFETY: the host has given a function of this type and a pointer for it; the text lives
        // during the call. No lock is held.
        let stop = unsafe {
            callback(std::ptr::with_exposed_provenance_mut(user), fraction, phase.as_ptr())
        };
        if stop != 0 {
            progress.cancel();
        }
    }
}
