//! Long work: on the device's threads, while the calling thread serves the host's callbacks.

use super::cache::CacheObject;
use super::device;
use super::status::Outcome;
use crate::hosted::{self, Exchange, Host};
use crate::progress::Progress;
use std::ffi::CString;

impl CacheObject {
    /// Runs `work` on other threads. Meanwhile this thread calls the host's tracer, if the host
    /// wants it so, and tells of `progress` where it is watched.
    pub fn run<R: Send>(
        &self,
        progress: &Progress,
        watched: bool,
        work: impl FnOnce(&Exchange) -> R + Send,
    ) -> Outcome<R> {
        let own = &self.scene.device.pool;
        let host = self.scene.committed()?.host();
        let pool = host.map_or(Ok(own), |host| self.host_pool(host))?;
        let watch = || {
            if watched {
                self.report(progress);
            }
        };
        Ok(hosted::run(pool, host, own.current_num_threads(), watch, work)?)
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
        let fraction = (snapshot.done as f64 / snapshot.total.max(1) as f64).min(1.0);
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
