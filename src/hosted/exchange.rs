//! Where gathers hand in rays, and the threads that take them to the host.

use super::batch::Batch;
use super::host::Host;
use crate::error::{Error, Result};
use crate::ffi::mxcsr::{self, work_for};
use std::collections::VecDeque;
use std::sync::mpsc::{SyncSender, sync_channel};
use std::sync::{Condvar, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

/// A batch that is not full goes off when nothing has come for this long.
const PATIENCE: Duration = Duration::from_micros(300);
/// Time between two reports of progress.
const INTERVAL: Duration = Duration::from_millis(50);

#[derive(Default)]
struct Waiting {
    /// Rays, and where they go back to with their answers.
    requests: VecDeque<(Batch, SyncSender<Batch>)>,
    rays: usize,
    closed: bool,
    failure: Option<Error>,
}

/// Where gathers hand in rays and serving threads take them.
#[derive(Default)]
pub struct Exchange {
    waiting: Mutex<Waiting>,
    changed: Condvar,
}

impl Exchange {
    fn lock(&self) -> MutexGuard<'_, Waiting> {
        self.waiting.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn wait<'a>(
        &self, waiting: MutexGuard<'a, Waiting>, time: Duration,
    ) -> MutexGuard<'a, Waiting> {
        self.changed.wait_timeout(waiting, time).unwrap_or_else(PoisonError::into_inner).0
    }

    /// Hands `batch` in and waits for the answers; `None` when the host has failed.
    pub fn ask(&self, batch: Batch) -> Option<Batch> {
        let (reply, receiver) = sync_channel(1);
        let mut waiting = self.lock();
        if waiting.closed {
            return None;
        }
        waiting.rays += batch.len();
        waiting.requests.push_back((batch, reply));
        drop(waiting);
        self.changed.notify_all();
        receiver.recv().ok()
    }

    /// Ends the exchange: who waits gets nothing, and nobody waits from now on.
    fn close(&self) {
        let mut waiting = self.lock();
        waiting.closed = true;
        waiting.requests.clear();
        drop(waiting);
        self.changed.notify_all();
    }

    /// Waits for the end for `time` at most; false once it has come.
    fn is_open_after(&self, time: Duration) -> bool {
        let open = self.changed.wait_timeout_while(self.lock(), time, |w| !w.closed);
        !open.unwrap_or_else(PoisonError::into_inner).0.closed
    }

    /// Takes waiting rays to the host: a full batch at once, fewer rays when no more come. Waits
    /// for `timeout` at most. False once the exchange is closed.
    fn serve(&self, host: &Host, timeout: Duration) -> bool {
        let mut waiting = self.lock();
        if waiting.requests.is_empty() && !waiting.closed {
            waiting = self.wait(waiting, timeout);
        }
        loop {
            let before = waiting.requests.len();
            if before == 0 || waiting.closed || waiting.rays >= host.preferred_batch {
                break;
            }
            waiting = self.wait(waiting, PATIENCE);
            if waiting.requests.len() == before {
                break;
            }
        }
        if waiting.closed {
            return false;
        }
        let (mut taken, mut all) = (Vec::new(), Batch::default());
        while all.len() < host.preferred_batch {
            let Some((mut batch, reply)) = waiting.requests.pop_front() else { break };
            waiting.rays -= batch.len();
            taken.push((all.len(), reply));
            all.append(&mut batch);
        }
        drop(waiting);
        if let Err(error) = host.trace(&mut all) {
            self.lock().failure.get_or_insert(error);
            self.close();
            return false;
        }
        for (first, reply) in taken.into_iter().rev() {
            // Nobody listens any more when the gather was given up.
            let _ = reply.send(all.split_off(first));
        }
        true
    }
}

/// Ends the waiting of the calling thread, also when the work panics.
struct End<'a>(&'a Exchange);

impl Drop for End<'_> {
    fn drop(&mut self) {
        self.0.close();
    }
}

/// Runs `work` on `pool`. Meanwhile the calling thread calls `watch` from time to time and serves
/// `host`, or as many threads serve it as `servers` says where it is concurrent.
///
/// # Errors
/// [`Error::Host`] when the host has failed.
///
/// # Panics
/// If `work` panics.
pub fn run<R: Send>(
    pool: &rayon::ThreadPool, host: Option<&Host>, servers: usize, watch: impl Fn(),
    work: impl FnOnce(&Exchange) -> R + Send,
) -> Result<R> {
    let (exchange, caller) = (Exchange::default(), mxcsr::caller());
    let mut result = None;
    std::thread::scope(|threads| {
        pool.in_place_scope(|scope| {
            let (exchange, result) = (&exchange, &mut result);
            scope.spawn(move |_| {
                let _end = End(exchange);
                *result = Some(work(exchange));
            });
            if let Some(host) = host.filter(|h| h.concurrent) {
                for _ in 0..servers {
                    threads.spawn(move || {
                        work_for(caller);
                        while exchange.serve(host, INTERVAL) {}
                    });
                }
            }
            let serving = host.filter(|h| !h.concurrent);
            loop {
                let open = match serving {
                    Some(host) => exchange.serve(host, INTERVAL),
                    None => exchange.is_open_after(INTERVAL),
                };
                if !open {
                    break;
                }
                watch();
            }
        });
    });
    let failure = exchange.lock().failure.take();
    match (failure, result) {
        (Some(error), _) => Err(error),
        (None, Some(result)) => Ok(result),
        (None, None) => unreachable!("the scope passes a panic of the work on"),
    }
}
