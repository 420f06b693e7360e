//! The floating point mode of the current thread: rounding, traps, denormal numbers.
//!
//! Embree advises to flush denormal numbers: a kernel that meets one is up to a hundred times
//! slower. Threads of our own do so for good. A host's threads have the mode that the host likes,
//! perhaps rounding upwards or with traps for numbers that are none. Inside the library they have
//! the default mode ([`Own`]), so that results do not depend on the host, and callbacks have the
//! host's ([`as_caller`]). A new thread inherits the mode of the thread that starts it.

use std::cell::Cell;
use std::marker::PhantomData;

/// The mode of a thread.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Mode {
    /// The control and status register of SSE.
    mxcsr: u32,
    /// The control word of x87.
    x87: u16,
}

impl Mode {
    /// To the nearest, no traps, denormal numbers as they are: the mode that C programs start in.
    pub const DEFAULT: Self = Self { mxcsr: 0x1f80, x87: 0x037f };
    /// The same with denormal numbers as zero: flush to zero (bit 15), denormals are zero (bit 6).
    const FLUSHING: Self = Self { mxcsr: Self::DEFAULT.mxcsr | 0x8040, ..Self::DEFAULT };

    /// The mode of the current thread.
    pub fn current() -> Self {
        imp::read()
    }

    fn set(self) {
        imp::write(self);
    }
}

#[cfg(all(target_arch = "x86_64", not(miri)))]
mod imp {
    use super::Mode;
    use std::arch::asm;

    pub fn read() -> Mode {
        let mut mode = Mode { mxcsr: 0, x87: 0 };
        // SAFETY: stmxcsr stores four bytes at the given address and fnstcw two, live and aligned.
        unsafe {
            asm!(
                "stmxcsr [{}]", "fnstcw [{}]",
                in(reg) &raw mut mode.mxcsr, in(reg) &raw mut mode.x87,
                options(nostack, preserves_flags)
            );
        }
        mode
    }

    pub fn write(mode: Mode) {
        // SAFETY: ldmxcsr loads four bytes from a live, aligned u32. Every mode was read from the
        // registers or is a constant of this file, so no reserved bit is set.
        unsafe {
            asm!("ldmxcsr [{}]", in(reg) &raw const mode.mxcsr, options(nostack, readonly, preserves_flags))
        };
        if mode.x87 != read().x87 {
            // SAFETY: as above for fldcw. Flags that were raised meanwhile would trap at once where
            // the mode has traps, so fnclex clears them first.
            unsafe {
                asm!("fnclex", "fldcw [{}]", in(reg) &raw const mode.x87, options(nostack, readonly, preserves_flags))
            };
        }
    }
}

/// Other machines, and an interpreter, which knows no registers.
#[cfg(any(not(target_arch = "x86_64"), miri))]
mod imp {
    use super::Mode;

    pub fn read() -> Mode {
        Mode::DEFAULT
    }
    pub fn write(_: Mode) {}
}

thread_local! {
    /// The mode of the host while the thread is inside the library.
    static CALLER: Cell<Option<Mode>> = const { Cell::new(None) };
}

/// From now on the current thread, one of our own, rounds to the nearest, has no traps and treats
/// denormal numbers as zero. Nothing happens on machines other than x86-64.
pub fn flush_denormals() {
    Mode::FLUSHING.set();
}

/// While it lives, the current thread computes as our own do; then the thread's earlier mode comes
/// back.
#[derive(Debug)]
pub struct FlushDenormals {
    before: Mode,
    /// The mode belongs to a thread, so the guard must not leave it.
    _not_send: PhantomData<*const ()>,
}

impl FlushDenormals {
    /// Sets the mode.
    #[must_use = "the mode ends with the guard"]
    pub fn new() -> Self {
        let before = Mode::current();
        Mode::FLUSHING.set();
        Self { before, _not_send: PhantomData }
    }
}

impl Default for FlushDenormals {
    fn default() -> Self {
        Self::new()
    }
}

impl Drop for FlushDenormals {
    fn drop(&mut self) {
        self.before.set();
    }
}

/// While it lives, a thread of the host is in the default mode; then in the host's again.
#[derive(Debug)]
pub struct Own {
    /// The host's mode of a call that this one is inside of.
    outer: Option<Mode>,
    _not_send: PhantomData<*const ()>,
}

impl Own {
    /// Sets the mode.
    #[must_use = "the mode ends with the guard"]
    pub fn enter() -> Self {
        let outer = CALLER.replace(Some(Mode::current()));
        Mode::DEFAULT.set();
        Self { outer, _not_send: PhantomData }
    }
}

impl Drop for Own {
    fn drop(&mut self) {
        if let Some(mode) = CALLER.replace(self.outer) {
            mode.set();
        }
    }
}

/// The mode of the host that the current thread works for, if it works for one.
pub fn caller() -> Option<Mode> {
    CALLER.get()
}

/// Makes a thread of our own work for a host with the mode `caller`.
pub fn work_for(caller: Option<Mode>) {
    CALLER.set(caller);
}

/// Calls `f`, which is the host's, in the host's mode. What `f` changes of the mode stays.
pub fn as_caller<R>(f: impl FnOnce() -> R) -> R {
    let Some(caller) = CALLER.get() else { return f() };
    let own = Mode::current();
    caller.set();
    let result = f();
    CALLER.set(Some(Mode::current()));
    own.set();
    result
}

#[cfg(all(test, target_arch = "x86_64", not(miri)))]
mod tests {
    use super::*;
    use std::hint::black_box;

    fn half_of_the_least_normal() -> f32 {
        black_box(f32::MIN_POSITIVE) * black_box(0.5)
    }

    #[test]
    fn the_guard_sets_the_mode_and_restores_it() {
        std::thread::spawn(|| {
            assert!(half_of_the_least_normal() > 0.0);
            {
                let _guard = FlushDenormals::new();
                assert_eq!(half_of_the_least_normal(), 0.0);
                {
                    let _inner = FlushDenormals::new();
                }
                assert_eq!(half_of_the_least_normal(), 0.0);
            }
            assert!(half_of_the_least_normal() > 0.0);
            flush_denormals();
            assert_eq!(half_of_the_least_normal(), 0.0);
        })
        .join()
        .unwrap();
    }

    #[test]
    fn inside_the_library_the_mode_is_the_default_and_callbacks_have_the_host_s() {
        std::thread::spawn(|| {
            // Upwards, with denormals as zero, in both units.
            let host = Mode { mxcsr: 0x1f80 | 0x4000 | 0x8040, x87: 0x037f | 0x0800 };
            // Rounded to the nearest it lies below what it stands for.
            let third = || black_box(-1.0_f32) / black_box(3.0);
            let (nearest, upwards) = (third(), third().next_up());
            let without_flags = |mode: Mode| Mode { mxcsr: mode.mxcsr & !0x3f, ..mode };
            host.set();
            assert_eq!(third(), upwards);
            {
                let _own = Own::enter();
                assert_eq!((third(), caller().map(without_flags)), (nearest, Some(host)));
                assert!(half_of_the_least_normal() > 0.0);
                as_caller(|| {
                    assert_eq!(third(), upwards);
                    let _nested = Own::enter();
                    assert_eq!(third(), nearest);
                });
                assert_eq!(third(), nearest);
            }
            assert_eq!(without_flags(Mode::current()), host);
            assert_eq!((third(), caller()), (upwards, None));
            Mode::DEFAULT.set();
        })
        .join()
        .unwrap();
    }
}
