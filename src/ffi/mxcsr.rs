//! The floating point mode of the current thread.
//!
//! Embree advises to flush denormal numbers: a kernel that meets one is up to a hundred times
//! slower. The bits belong to the thread, and inside a host to the host, so library code uses the
//! guard and only threads of our own are changed for good.

#[cfg(target_arch = "x86_64")]
mod imp {
    use std::arch::asm;

    /// Flush to zero (bit 15) and denormals are zero (bit 6).
    const FTZ_DAZ: u32 = 0x8040;

    pub fn read() -> u32 {
        let mut value = 0_u32;
        // SAFETY: stmxcsr stores four bytes at the given address, which is a live, aligned u32.
        unsafe { asm!("stmxcsr [{}]", in(reg) &raw mut value, options(nostack, preserves_flags)) };
        value
    }

    pub fn write(value: u32) {
        // SAFETY: ldmxcsr loads four bytes from a live, aligned u32. Every caller passes a value
        // that was read from the register, with at most FTZ and DAZ changed: no reserved
        // bit and no exception is unmasked that was masked before.
        unsafe {
            asm!("ldmxcsr [{}]", in(reg) &raw const value, options(nostack, readonly, preserves_flags))
        };
    }

    pub fn with_flush(value: u32) -> u32 {
        value | FTZ_DAZ
    }
}

#[cfg(not(target_arch = "x86_64"))]
mod imp {
    pub fn read() -> u32 {
        0
    }
    pub fn write(_: u32) {}
    pub fn with_flush(value: u32) -> u32 {
        value
    }
}

/// Makes the current thread treat denormal numbers as zero (FTZ and DAZ) from now on. Nothing
/// happens on machines other than x86-64.
pub fn flush_denormals() {
    imp::write(imp::with_flush(imp::read()));
}

/// While it lives, the current thread treats denormal numbers as zero; then the thread's earlier
/// mode comes back.
#[derive(Debug)]
pub struct FlushDenormals {
    before: u32,
    /// The mode belongs to a thread, so the guard must not leave it.
    _not_send: std::marker::PhantomData<*const ()>,
}

impl FlushDenormals {
    /// Sets the mode.
    #[must_use = "the mode ends with the guard"]
    pub fn new() -> Self {
        let before = imp::read();
        imp::write(imp::with_flush(before));
        Self { before, _not_send: std::marker::PhantomData }
    }
}

impl Default for FlushDenormals {
    fn default() -> Self {
        Self::new()
    }
}

impl Drop for FlushDenormals {
    fn drop(&mut self) {
        imp::write(self.before);
    }
}

#[cfg(all(test, target_arch = "x86_64"))]
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
}
