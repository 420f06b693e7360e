//! Hosts that trace and shade: their callback as a probe, with the rays of many gathers in one
//! call.
//!
//! Gathers run on more threads than there are processors. Each hands its rays in and sleeps until
//! they are answered, so that as many gathers as fit a batch wait together. The serving threads
//! (the caller's alone, or several) take what has come together to the host. What a gather gets
//! does not depend on its company.

use super::status::{Fault, Outcome};
use super::types::{
    LUMI_HOST_CONCURRENT, LUMI_HOST_ENV_IN_MISS, LUMI_HOST_FULL, lumi_host_desc, lumi_ray_batch,
};
use crate::error::{Error, Result};
use crate::geometry::Aabb;
use crate::math::{Color, Vec3};
use std::collections::VecDeque;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::sync::{Condvar, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

/// Rays of a batch where the host has no wish.
const PREFERRED: usize = 65536;
/// Gathers that wait at most.
const MOST_WAITING: usize = 192;
/// A batch that is not full goes off when nothing has come for this long.
const PATIENCE: Duration = Duration::from_micros(300);
/// An albedo or a normal's length may be this far outside its range.
const SLACK: f32 = 1e-2;

/// The callback with what the host says of itself.
pub(super) struct Host {
    desc: lumi_host_desc,
    pub bounds: Aabb,
    pub hash: u64,
    calls: AtomicU64,
    rays: AtomicU64,
}

// SAFETY: the host's pointer is only handed back to the host's function, on the threads that its
// flags allow.
unsafe impl Send for Host {}
// SAFETY: as above.
unsafe impl Sync for Host {}

/// Rays for the host.
#[derive(Default)]
pub(super) struct Rays {
    pub origin: Vec<Vec3>,
    pub dir: Vec<Vec3>,
    pub bounce: Vec<u32>,
    pub seed: Vec<u32>,
}

/// What the host said of them.
#[derive(Default)]
pub(super) struct Answers {
    pub radiance: Vec<Color>,
    pub distance: Vec<f32>,
    pub normal: Vec<Vec3>,
    pub albedo: Vec<Color>,
}

impl Rays {
    pub fn len(&self) -> usize {
        self.origin.len()
    }

    pub fn push(&mut self, origin: Vec3, dir: Vec3, bounce: u32, seed: u64) {
        self.origin.push(origin);
        self.dir.push(dir);
        self.bounce.push(bounce);
        self.seed.push((seed ^ (seed >> 32)) as u32);
    }

    fn append(&mut self, other: &Self) {
        self.origin.extend(&other.origin);
        self.dir.extend(&other.dir);
        self.bounce.extend(&other.bounce);
        self.seed.extend(&other.seed);
    }
}

impl Answers {
    fn room(n: usize) -> Self {
        Self {
            radiance: vec![Color::ZERO; n],
            distance: vec![f32::INFINITY; n],
            normal: vec![Vec3::ZERO; n],
            albedo: vec![Color::ZERO; n],
        }
    }

    fn part(&self, range: std::ops::Range<usize>) -> Self {
        Self {
            radiance: self.radiance[range.clone()].to_vec(),
            distance: self.distance[range.clone()].to_vec(),
            normal: self.normal[range.clone()].to_vec(),
            albedo: self.albedo[range].to_vec(),
        }
    }
}

impl Host {
    pub fn new(desc: &lumi_host_desc) -> Outcome<Self> {
        let known = LUMI_HOST_CONCURRENT | LUMI_HOST_FULL | LUMI_HOST_ENV_IN_MISS;
        if desc.flags & !known != 0 {
            return Err(Fault::argument(format!("host: unknown flags {:#x}", desc.flags & !known)));
        }
        if desc.trace.is_none() {
            return Err(Fault::argument("host: the tracer is NULL"));
        }
        let bounds = Aabb { min: desc.bounds_min.into(), max: desc.bounds_max.into() };
        if !(bounds.min.is_finite()
            && bounds.max.is_finite()
            && bounds.min.cmple(bounds.max).all()
            && bounds.diagonal() > 0.0)
        {
            return Err(Fault::argument("host: the bounds are empty or no numbers"));
        }
        Ok(Self {
            desc: *desc,
            bounds,
            hash: desc.scene_hash,
            calls: AtomicU64::new(0),
            rays: AtomicU64::new(0),
        })
    }

    fn has(&self, flag: u32) -> bool {
        self.desc.flags & flag != 0
    }

    pub fn is_full(&self) -> bool {
        self.has(LUMI_HOST_FULL)
    }

    pub fn is_concurrent(&self) -> bool {
        self.has(LUMI_HOST_CONCURRENT)
    }

    pub fn has_environment(&self) -> bool {
        self.has(LUMI_HOST_ENV_IN_MISS)
    }

    /// Calls and rays so far.
    pub fn counts(&self) -> [u64; 2] {
        [&self.calls, &self.rays].map(|c| c.load(Ordering::Relaxed))
    }

    fn preferred(&self) -> usize {
        if self.desc.preferred_batch == 0 { PREFERRED } else { self.desc.preferred_batch as usize }
    }

    /// Threads on which gathers of `rays` rays each should wait, so that a batch is full.
    pub fn gathering_threads(&self, rays: usize, processors: usize) -> usize {
        (self.preferred() / rays.max(1)).clamp(processors, MOST_WAITING.max(processors))
    }

    /// Has `rays` traced, in calls of at most `max_batch`, and checks the answers.
    ///
    /// # Errors
    /// [`Error::Host`] when the host fails or lies.
    pub fn trace(&self, rays: &Rays) -> Result<Answers> {
        let most =
            if self.desc.max_batch == 0 { u32::MAX as usize } else { self.desc.max_batch as usize };
        let mut answers = Answers::room(rays.len());
        let mut begin = 0;
        while begin < rays.len() {
            let n = (rays.len() - begin).min(most);
            self.call(rays, &mut answers, begin, n)?;
            begin += n;
        }
        Ok(answers)
    }

    fn call(&self, rays: &Rays, answers: &mut Answers, begin: usize, n: usize) -> Result<()> {
        let range = begin..begin + n;
        let floats = |v: &[Vec3]| v.as_ptr().cast::<f32>();
        let mut batch = lumi_ray_batch {
            struct_size: size_of::<lumi_ray_batch>() as u32,
            n: n as u32,
            origin: floats(&rays.origin[range.clone()]),
            dir: floats(&rays.dir[range.clone()]),
            bounce: rays.bounce[range.clone()].as_ptr(),
            seed: rays.seed[range.clone()].as_ptr(),
            radiance: answers.radiance[range.clone()].as_mut_ptr().cast(),
            distance: answers.distance[range.clone()].as_mut_ptr(),
            normal: answers.normal[range.clone()].as_mut_ptr().cast(),
            albedo: answers.albedo[range.clone()].as_mut_ptr().cast(),
        };
        let Some(trace) = self.desc.trace else {
            return Err(Error::Host("there is no tracer".into()));
        };
        // SAFETY: the arrays have n elements and live during the call; the host has promised to
        // fill no more than that. A failing host unwinds no further than this `extern "C"`
        // call.
        let code = unsafe { trace(self.desc.user, &raw mut batch) };
        self.calls.fetch_add(1, Ordering::Relaxed);
        self.rays.fetch_add(n as u64, Ordering::Relaxed);
        if code != 0 {
            return Err(Error::Host(format!("the host's tracer stopped with code {code}")));
        }
        if batch.n as usize != n {
            return Err(Error::Host(format!(
                "the host's tracer was given {n} rays and says that they are {}",
                batch.n
            )));
        }
        range.into_iter().try_for_each(|i| self.check(answers, i, i - begin))
    }

    /// Refuses answers that cannot be, and puts the others right: unit normals, albedos in their
    /// range.
    fn check(&self, answers: &mut Answers, i: usize, number: usize) -> Result<()> {
        let lie = |what: String| {
            Err(Error::Host(format!(
                "the host's tracer answered ray {number} of its batch with {what}"
            )))
        };
        let distance = answers.distance[i];
        if distance.is_nan() || distance < 0.0 {
            return lie(format!("the distance {distance}"));
        }
        let radiance = answers.radiance[i];
        if !radiance.is_finite() || radiance.min_element() < 0.0 {
            return lie(format!("the radiance {radiance}"));
        }
        if distance == f32::INFINITY {
            return Ok(());
        }
        let normal = answers.normal[i];
        let length = normal.length();
        if self.is_full() && normal == Vec3::ZERO {
            return Ok(());
        }
        let is_unit = (length - 1.0).abs() < SLACK;
        if !is_unit {
            return lie(format!("the normal {normal}, which has not unit length"));
        }
        answers.normal[i] = normal / length;
        let albedo = answers.albedo[i];
        if !(albedo.is_finite()
            && albedo.min_element() >= 0.0
            && albedo.max_element() <= 1.0 + SLACK)
        {
            return lie(format!("the albedo {albedo}"));
        }
        answers.albedo[i] = albedo.min(Color::ONE);
        Ok(())
    }
}

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
pub(super) struct Exchange {
    waiting: Mutex<Waiting>,
    changed: Condvar,
}

impl Exchange {
    fn lock(&self) -> MutexGuard<'_, Waiting> {
        self.waiting.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Hands `rays` in and waits; `None` when the host has failed.
    pub fn ask(&self, rays: Rays) -> Option<Answers> {
        let receiver: Receiver<Answers> = {
            let mut waiting = self.lock();
            if waiting.closed {
                return None;
            }
            let (reply, receiver) = sync_channel(1);
            waiting.rays += rays.len();
            waiting.requests.push_back(Request { rays, reply });
            receiver
        };
        self.changed.notify_all();
        receiver.recv().ok()
    }

    /// Ends the exchange: who waits gets nothing, nobody waits from now on.
    pub fn close(&self) {
        let mut waiting = self.lock();
        waiting.closed = true;
        waiting.requests.clear();
        drop(waiting);
        self.changed.notify_all();
    }

    /// Why the host failed, if it did.
    pub fn failure(&self) -> Option<Error> {
        self.lock().failure.take()
    }

    /// Takes what has come together to the host, at once if that is a full batch and else when
    /// nothing more comes; waits for `timeout` at most. False once the exchange is closed.
    pub fn serve(&self, host: &Host, timeout: Duration) -> bool {
        let mut waiting = self.lock();
        if waiting.requests.is_empty() && !waiting.closed {
            waiting = self
                .changed
                .wait_timeout(waiting, timeout)
                .unwrap_or_else(PoisonError::into_inner)
                .0;
        }
        loop {
            let before = waiting.requests.len();
            if before == 0 || waiting.closed || waiting.rays >= host.preferred() {
                break;
            }
            waiting = self
                .changed
                .wait_timeout(waiting, PATIENCE)
                .unwrap_or_else(PoisonError::into_inner)
                .0;
            if waiting.requests.len() == before {
                break;
            }
        }
        if waiting.closed {
            return false;
        }
        let (mut taken, mut rays) = (Vec::new(), Rays::default());
        while rays.len() < host.preferred() {
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
                    // Nobody listens any more when its gather was given up.
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
