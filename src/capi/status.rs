//! Error codes, the message of each thread, and the guard through which every exported function
//! goes.

use crate::error::Error;
use crate::ffi::mxcsr::{self, as_caller};
use std::cell::RefCell;
use std::ffi::{CString, c_char, c_void};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// What a function reports: LUMI_OK or one of the LUMI_ERROR_* codes.
pub type lumi_error = i32;

/// All is well.
pub const LUMI_OK: lumi_error = 0;
/// Something outside the library failed or is missing: threads, the ray tracer, the denoiser.
pub const LUMI_ERROR_UNKNOWN: lumi_error = 1;
/// An argument is outside its range: NULL, a released handle, a handle of another kind, NaN.
pub const LUMI_ERROR_INVALID_ARGUMENT: lumi_error = 2;
/// The state of the object does not allow the call.
pub const LUMI_ERROR_INVALID_OPERATION: lumi_error = 3;
/// Memory, or room for objects, ran out.
pub const LUMI_ERROR_OUT_OF_MEMORY: lumi_error = 4;
/// This version of the library cannot do what was asked.
pub const LUMI_ERROR_UNSUPPORTED: lumi_error = 5;
/// The progress callback asked to stop.
pub const LUMI_ERROR_CANCELLED: lumi_error = 6;
/// A file cannot be read or written.
pub const LUMI_ERROR_IO: lumi_error = 7;
/// A file is damaged or breaks its format.
pub const LUMI_ERROR_CORRUPT_FILE: lumi_error = 8;
/// A cache file is sound, but was made for another scene or under other settings.
pub const LUMI_ERROR_STALE_CACHE: lumi_error = 9;
/// The versions of header and library do not match, or a struct is shorter than its first version.
pub const LUMI_ERROR_VERSION: lumi_error = 10;
/// The host's callback failed or gave an impossible answer.
pub const LUMI_ERROR_HOST_CALLBACK: lumi_error = 11;
/// A fault of the library. The objects of the call can only be released.
pub const LUMI_ERROR_INTERNAL: lumi_error = 12;

/// Severity of a log message: for information.
pub const LUMI_LOG_INFO: i32 = 0;
/// Severity of a log message: the result may not be what was wanted.
pub const LUMI_LOG_WARNING: i32 = 1;
/// Severity of a log message: a function has failed.
pub const LUMI_LOG_ERROR: i32 = 2;

/// Takes messages, on the thread whose call is reported. The callback must not call the library for
/// that device.
pub type lumi_log_fn = Option<
    unsafe extern "C" fn(
        user: *mut c_void,
        severity: i32,
        code: lumi_error,
        message: *const c_char,
    ),
>;

/// A failed call: code and message.
#[derive(Debug)]
pub(super) struct Fault {
    pub code: lumi_error,
    pub message: String,
}

/// What the inside of an exported function returns.
pub(super) type Outcome<T = ()> = Result<T, Fault>;

impl Fault {
    pub fn new(code: lumi_error, message: impl Into<String>) -> Self {
        Self { code, message: message.into() }
    }

    pub fn argument(message: impl Into<String>) -> Self {
        Self::new(LUMI_ERROR_INVALID_ARGUMENT, message)
    }

    pub fn operation(message: impl Into<String>) -> Self {
        Self::new(LUMI_ERROR_INVALID_OPERATION, message)
    }
}

/// Ends the call with an invalid argument unless the condition holds.
macro_rules! ensure {
    ($condition:expr, $($text:tt)*) => {
        if std::ops::Not::not($condition) {
            return Err($crate::capi::status::Fault::argument(format!($($text)*)));
        }
    };
}
pub(super) use ensure;

/// Fails with an invalid operation unless the state of an object `allows` the call.
pub(super) fn state(allows: bool, otherwise: &str) -> Outcome {
    if allows { Ok(()) } else { Err(Fault::operation(otherwise)) }
}

impl From<Error> for Fault {
    fn from(error: Error) -> Self {
        let code = match &error {
            Error::InvalidArgument(_) => LUMI_ERROR_INVALID_ARGUMENT,
            Error::Unsupported { .. } => LUMI_ERROR_UNSUPPORTED,
            Error::Cancelled => LUMI_ERROR_CANCELLED,
            Error::Io { .. } => LUMI_ERROR_IO,
            Error::Corrupt { .. } | Error::Scene { .. } | Error::Image { .. } => {
                LUMI_ERROR_CORRUPT_FILE
            }
            Error::Stale { .. } => LUMI_ERROR_STALE_CACHE,
            Error::Host(_) => LUMI_ERROR_HOST_CALLBACK,
            Error::OutOfMemory(_) => LUMI_ERROR_OUT_OF_MEMORY,
            Error::Device(_) => LUMI_ERROR_UNKNOWN,
        };
        Self::new(code, error.to_string())
    }
}

/// Locks `mutex`, also after a panic of another thread.
pub(super) fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

/// The host's log callback.
#[derive(Default)]
pub(super) struct Log(Mutex<(lumi_log_fn, usize)>);

impl Log {
    pub fn set(&self, callback: lumi_log_fn, user: *mut c_void) {
        *lock(&self.0) = (callback, user.expose_provenance());
    }

    /// Hands a message to the host, if it listens.
    pub fn tell(&self, severity: i32, code: lumi_error, message: &str) {
        let (callback, user) = *lock(&self.0);
        if let Some(callback) = callback {
            let text = c_string(message);
            // SAFETY: the host has given a function of this type and a pointer for it; the text
            // ends in NUL and lives during the call. No lock is held.
            as_caller(|| unsafe {
                callback(std::ptr::with_exposed_provenance_mut(user), severity, code, text.as_ptr())
            });
        }
    }
}

/// What a call touches: where its failure is told, and what a panic spoils.
#[derive(Clone, Default)]
pub(super) struct Touched {
    pub log: Arc<Log>,
    pub broken: Arc<AtomicBool>,
}

impl Touched {
    /// That of an object that tells its failures where this one does.
    pub fn child(&self) -> Self {
        Self { log: self.log.clone(), broken: Arc::default() }
    }
}

#[derive(Default)]
struct Thread {
    /// The first failure since the host last asked.
    failure: Option<(lumi_error, CString)>,
    /// The message that the host was given last.
    given: Option<CString>,
    /// What the call under way has touched.
    touched: Vec<Touched>,
}

thread_local! {
    static THREAD: RefCell<Thread> = RefCell::default();
}

fn c_string(text: &str) -> CString {
    CString::new(text.replace('\0', "\u{fffd}")).unwrap_or_default()
}

/// Runs `f` on what the thread remembers; nothing when the thread is about to end, or calls the
/// library from inside such a call.
fn thread<R: Default>(f: impl FnOnce(&mut Thread) -> R) -> R {
    THREAD
        .try_with(|t| t.try_borrow_mut().map_or_else(|_| R::default(), |mut t| f(&mut t)))
        .unwrap_or_default()
}

/// Notes that the call under way works on an object.
pub(super) fn touch(what: Touched) {
    thread(|t| t.touched.push(what));
}

/// Runs the inside of an exported function: no panic leaves it, and its failure becomes the
/// thread's. The host's floating point mode waits outside.
pub(super) fn guard(name: &'static str, inside: impl FnOnce() -> Outcome) -> lumi_error {
    let _mode = mxcsr::Own::enter();
    // A callback of the host may call the library again: the outer call's list waits meanwhile.
    let outer = thread(|t| std::mem::take(&mut t.touched));
    let outcome = catch_unwind(AssertUnwindSafe(inside));
    let touched = thread(|t| std::mem::replace(&mut t.touched, outer));
    let fault = match outcome {
        Ok(Ok(())) => return LUMI_OK,
        Ok(Err(fault)) => fault,
        Err(panic) => {
            touched.iter().for_each(|t| t.broken.store(true, Ordering::Release));
            let text = panic
                .downcast_ref::<&str>()
                .map(|s| (*s).to_owned())
                .or_else(|| panic.downcast_ref::<String>().cloned());
            // Dropping what was thrown could throw again.
            std::mem::forget(panic);
            Fault::new(LUMI_ERROR_INTERNAL, format!("internal error: {}", text.unwrap_or_default()))
        }
    };
    let message = format!("{name}: {}", fault.message);
    if let Some(t) = touched.first() {
        t.log.tell(LUMI_LOG_ERROR, fault.code, &message);
    }
    thread(|t| {
        t.failure.get_or_insert_with(|| (fault.code, c_string(&message)));
    });
    fault.code
}

/// [`guard`] for functions without a result.
pub(super) fn guard_void(name: &'static str, inside: impl FnOnce() -> Outcome) {
    guard(name, inside);
}

/// The code of the first failed call on this thread since the last call of this function; LUMI_OK
/// without a failure. The library forgets the failure then.
///
/// `message`: receives a text that says what failed and why, "" without a failure; it lives until
/// the thread calls this function again or ends. May be NULL.
///
/// Threads: any. Every thread has its own errors.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn lumi_get_last_error(message: *mut *const c_char) -> lumi_error {
    let mut code = LUMI_OK;
    guard("lumi_get_last_error", || {
        let text = thread(|t| {
            let (first, text) = t.failure.take().unwrap_or_default();
            code = first;
            t.given.insert(text).as_ptr() as usize
        });
        if !message.is_null() {
            let text = std::ptr::with_exposed_provenance::<c_char>(text);
            let text = if text.is_null() { c"".as_ptr() } else { text };
            // SAFETY: the caller passes NULL or the address of a pointer.
            unsafe { message.write(text) };
        }
        Ok(())
    });
    code
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::ffi::CStr;

    fn last() -> (lumi_error, String) {
        let mut text = std::ptr::null();
        // SAFETY: the pointer is valid.
        let code = unsafe { lumi_get_last_error(&raw mut text) };
        // SAFETY: the library gives a string that ends in NUL.
        (code, unsafe { CStr::from_ptr(text) }.to_str().unwrap().to_owned())
    }

    #[test]
    fn the_first_failure_is_kept_until_it_is_asked_for() {
        assert_eq!(guard("lumi_a", || Err(Fault::argument("first"))), LUMI_ERROR_INVALID_ARGUMENT);
        assert_eq!(
            guard("lumi_b", || Err(Fault::operation("second"))),
            LUMI_ERROR_INVALID_OPERATION
        );
        assert_eq!(guard("lumi_c", || Ok(())), LUMI_OK);
        assert_eq!(
            std::thread::spawn(last).join().unwrap(),
            (LUMI_OK, String::new()),
            "another thread has no error"
        );
        assert_eq!(last(), (LUMI_ERROR_INVALID_ARGUMENT, "lumi_a: first".into()));
        assert_eq!(last(), (LUMI_OK, String::new()));
    }

    #[test]
    fn a_panic_becomes_an_error_and_spoils_what_it_touched() {
        let touched = Touched::default();
        let untouched = Touched::default();
        touch(untouched.clone());
        let code = guard("lumi_a", || {
            touch(touched.clone());
            panic!("of the {}", "test")
        });
        assert_eq!(code, LUMI_ERROR_INTERNAL);
        assert_eq!(last().1, "lumi_a: internal error: of the test");
        assert!(
            touched.broken.load(Ordering::Acquire) && !untouched.broken.load(Ordering::Acquire)
        );
        thread(|t| t.touched.clear());
    }
}
