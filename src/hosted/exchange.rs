//! Where gathers hand in rays, and the threads that take them to the host.

use super::batch::{Answers, Rays};
use super::host::Host;
use crate::error::{Error, Result};
use std::collections::VecDeque;
use std::sync::mpsc::{SyncSender, sync_channel};
use std::sync::{Condvar, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

/// A batch that is not full goes off when nothing has come for this long.
const PATIENCE: Duration = Duration::from_micros(300);
/// Time between two reports of progress.
const INTERVAL: Duration = Duration::from_millis(50);

/// Rays that wait, and where their answers go.
struct Request {
    rays: Rays,
    reply: SyncSender<Answers>,
}

#[derive(Default)]
struct Waiting {
    requests: VecDeque<Request>,
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
        &self,
        waiting: MutexGuard<'a, Waiting>,
        time: Duration,
    ) -> MutexGuard<'a, Waiting> {
        self.changed.wait_timeout(waiting, time).unwrap_or_else(PoisonError::into_inner).0
    }

    /// Hands `rays` in and waits for the answers; `None` when the host has failed.
    pub fn ask(&self, rays: Rays) -> Option<Answers> {
        let (reply, receiver) = sync_channel(1);
        let mut waiting = self.lock();
        if waiting.closed {
            return None;
        }
        waiting.rays += rays.len();
        waiting.requests.push_back(Request { rays, reply });
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
        let (mut taken, mut rays) = (Vec::new(), Rays::default());
        while rays.len() < host.preferred_batch {
            let Some(request) = waiting.requests.pop_front() else { break };
            waiting.rays -= request.rays.len();
            rays.append(&request.rays);
            taken.push(request);
        }
        drop(waiting);
        if taken.is_empty() {
            return true;
        }
        match host.trace(&rays) {
            Ok(answers) => {
                let mut begin = 0;
                for request in taken {
                    let end = begin + request.rays.len();
                    // Nobody listens any more when the gather was given up.
                    let _ = request.reply.send(answers.part(begin..end));
                    begin = end;
                }
                true
            }
            Err(error) => {
                self.lock().failure.get_or_insert(error);
                self.close();
                false
            }
        }
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
    pool: &rayon::ThreadPool,
    host: Option<&Host>,
    servers: usize,
    watch: impl Fn(),
    work: impl FnOnce(&Exchange) -> R + Send,
) -> Result<R> {
    let exchange = Exchange::default();
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
                    threads.spawn(move || while exchange.serve(host, INTERVAL) {});
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
