//! Threads that render.

use crate::error::{Error, Result};
use crate::ffi::mxcsr;
use rayon::{ThreadPool, ThreadPoolBuilder};

/// `count` threads that render as those of the command line do; 0 stands for all processors.
///
/// # Errors
/// [`Error::Device`] if the threads cannot be started.
pub fn workers(count: usize) -> Result<ThreadPool> {
    ThreadPoolBuilder::new()
        .num_threads(count)
        .start_handler(|_| mxcsr::flush_denormals())
        .build()
        .map_err(|e| Error::Device(format!("threads could not be started: {e}")))
}

/// Does `work` on the thread pool of the calling thread, or else on one of its own.
pub(super) fn on_workers<R: Send>(work: impl FnOnce() -> Result<R> + Send) -> Result<R> {
    if rayon::current_thread_index().is_some() { work() } else { workers(0)?.install(work) }
}
