//! Threads that end with their owner.

use super::status::Outcome;
use crate::error::Error;
use crate::ffi::mxcsr;
use rayon::{ThreadPool, ThreadPoolBuilder};
use std::ops::Deref;
use std::thread::JoinHandle;

/// A pool whose threads round to the nearest and flush denormals, as the tracer wants. When it is
/// dropped, it waits for their ends: a host may unload the library once it has released all.
pub(super) struct Pool {
    pool: ThreadPool,
    /// Dropped after the pool, which tells them to end.
    _threads: Threads,
}

struct Threads {
    started: Vec<JoinHandle<()>>,
    /// A process that was forked from the owner's has none of them.
    process: u32,
}

impl Drop for Threads {
    fn drop(&mut self) {
        if self.process != std::process::id() {
            return;
        }
        let own = std::thread::current().id();
        for thread in self.started.drain(..).filter(|thread| thread.thread().id() != own) {
            // Rayon lets no panic out of its threads.
            let _ = thread.join();
        }
    }
}

impl Pool {
    /// Starts so many threads, called by `name` and their numbers; 0 stands for all processors.
    pub fn new(threads: usize, name: &str) -> Outcome<Self> {
        let mut ends = Threads { started: Vec::new(), process: std::process::id() };
        let pool = ThreadPoolBuilder::new()
            .num_threads(threads)
            .start_handler(|_| mxcsr::flush_denormals())
            .spawn_handler(|thread| {
                let named = std::thread::Builder::new().name(format!("{name}-{}", thread.index()));
                ends.started.push(named.spawn(|| thread.run())?);
                Ok(())
            })
            .build()
            .map_err(|e| Error::Device(format!("threads could not be started: {e}")))?;
        Ok(Self { pool, _threads: ends })
    }
}

impl Deref for Pool {
    type Target = ThreadPool;

    fn deref(&self) -> &ThreadPool {
        &self.pool
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::cell::RefCell;
    use std::sync::Arc;
    use std::time::Duration;

    #[test]
    fn threads_have_ended_when_their_pool_is_gone() {
        /// Takes its time at the end of a thread.
        struct Slow {
            _held: Arc<()>,
        }
        impl Drop for Slow {
            fn drop(&mut self) {
                std::thread::sleep(Duration::from_millis(50));
            }
        }
        thread_local! {
            static SLOW: RefCell<Option<Slow>> = const { RefCell::new(None) };
        }
        let alive = Arc::new(());
        let pool = Pool::new(3, "test").unwrap();
        pool.broadcast(|_| SLOW.set(Some(Slow { _held: alive.clone() })));
        assert_eq!(Arc::strong_count(&alive), 4);
        drop(pool);
        assert_eq!(Arc::strong_count(&alive), 1);
    }
}
