//! Devices, and the errors and memory that Embree reports to them.

use super::raw;
use crate::error::{Error, Result};
use std::ffi::{CStr, CString, c_char, c_void};
use std::sync::atomic::{AtomicIsize, Ordering};
use std::sync::{Arc, Mutex, PoisonError};

/// An Embree device: the owner of error and memory reports, shared by its scenes.
pub struct Device {
    pub(super) handle: raw::RTCDevice,
    /// Boxed because Embree holds its address.
    report: Box<Report>,
}

/// What Embree's callbacks write into.
#[derive(Default)]
struct Report {
    first_error: Mutex<Option<(raw::RTCError, String)>>,
    bytes: AtomicIsize,
    /// Bytes beyond which an allocation fails; 0 is no limit.
    limit: AtomicIsize,
}

// SAFETY: Embree's device functions may be called from any thread, and `Report` is made of a mutex
// and atomics.
unsafe impl Send for Device {}
// SAFETY: as above.
unsafe impl Sync for Device {}

unsafe extern "C" fn on_error(report: *mut c_void, code: raw::RTCError, text: *const c_char) {
    // SAFETY: `report` is the address of the device's boxed `Report`, which outlives the device.
    let report = unsafe { &*report.cast::<Report>() };
    let text = if text.is_null() {
        String::new()
    } else {
        // SAFETY: Embree passes a string that ends in NUL and lives during the call.
        unsafe { CStr::from_ptr(text) }.to_string_lossy().into_owned()
    };
    report.first_error.lock().unwrap_or_else(PoisonError::into_inner).get_or_insert((code, text));
}

unsafe extern "C" fn on_memory(report: *mut c_void, bytes: isize, allocated: bool) -> bool {
    // SAFETY: `report` is the address of the device's boxed `Report`, which outlives the device.
    let report = unsafe { &*report.cast::<Report>() };
    let total = report.bytes.fetch_add(bytes, Ordering::Relaxed) + bytes;
    let limit = report.limit.load(Ordering::Relaxed);
    let refused = bytes > 0 && !allocated && limit > 0 && total > limit;
    if refused {
        report.bytes.fetch_sub(bytes, Ordering::Relaxed);
    }
    !refused
}

fn describe(code: raw::RTCError) -> &'static str {
    match code {
        raw::RTC_ERROR_INVALID_ARGUMENT => "invalid argument",
        raw::RTC_ERROR_INVALID_OPERATION => "invalid operation",
        raw::RTC_ERROR_OUT_OF_MEMORY => "out of memory",
        raw::RTC_ERROR_UNSUPPORTED_CPU => "this CPU is not supported",
        raw::RTC_ERROR_CANCELLED => "cancelled",
        _ => "unknown error",
    }
}

/// The version of the headers this program was compiled with, as major and minor.
pub const HEADER_VERSION: (u32, u32) = (raw::RTC_VERSION_MAJOR, raw::RTC_VERSION_MINOR);

/// Whether a library of version `library` (major, minor) may serve a program compiled for the
/// headers `header`: within a major version Embree keeps old structures and functions, and adds new
/// ones in minor versions.
///
/// # Errors
/// `Error::Device` that names both versions and what to do.
pub fn check_version(header: (u32, u32), library: (u32, u32)) -> Result<()> {
    if library.0 == header.0 && library.1 >= header.1 {
        return Ok(());
    }
    Err(Error::Device(format!(
        "lumicache was compiled for Embree {}.{}, but the library found at run time is Embree {}.{}: install Embree {}.{} or a later {0}.x \
         (Debian package libembree-dev), or compile lumicache again for this one, or choose the backend \"bvh\"",
        header.0, header.1, library.0, library.1, header.0, header.1
    )))
}

impl Device {
    /// Opens a device and checks the library's version. `options` is Embree's configuration string.
    ///
    /// # Errors
    /// `Error::Device` if the CPU lacks what Embree needs, or the library is of another version
    /// than the headers.
    pub fn new(options: &str) -> Result<Arc<Self>> {
        let options = CString::new(options)
            .map_err(|_| Error::InvalidArgument("Embree options contain NUL".into()))?;
        #[cfg(feature = "private-embree")]
        super::library::load()?;
        // SAFETY: the string ends in NUL and lives during the call.
        let handle = unsafe { rtc!(rtcNewDevice; options.as_ptr()) };
        if handle.is_null() {
            // SAFETY: a null device is Embree's way to ask why the last rtcNewDevice of this thread
            // failed.
            let code = unsafe { rtc!(rtcGetDeviceError; std::ptr::null_mut()) };
            return Err(Error::Device(format!(
                "Embree cannot start: {}; choose the backend \"bvh\"",
                describe(code)
            )));
        }
        let device = Self { handle, report: Box::default() };
        check_version(HEADER_VERSION, device.version_numbers())?;
        let report = (&raw const *device.report).cast_mut().cast();
        // SAFETY: the handle is valid; `report` points to a box that `device` owns and frees after
        // the device is released.
        unsafe {
            rtc!(rtcSetDeviceErrorFunction; handle, Some(on_error), report);
            rtc!(rtcSetDeviceMemoryMonitorFunction; handle, Some(on_memory), report);
        }
        Ok(Arc::new(device))
    }

    pub(super) fn property(&self, property: raw::RTCDeviceProperty) -> u32 {
        // SAFETY: the handle is valid while self lives.
        let value = unsafe { rtc!(rtcGetDeviceProperty; self.handle, property) };
        u32::try_from(value).unwrap_or(0)
    }

    fn version_numbers(&self) -> (u32, u32) {
        (
            self.property(raw::RTC_DEVICE_PROPERTY_VERSION_MAJOR),
            self.property(raw::RTC_DEVICE_PROPERTY_VERSION_MINOR),
        )
    }

    /// The library's version, such as `Embree 3.13.5`.
    pub fn version(&self) -> String {
        let (major, minor) = self.version_numbers();
        format!("Embree {major}.{minor}.{}", self.property(raw::RTC_DEVICE_PROPERTY_VERSION_PATCH))
    }

    /// Bytes that Embree holds for this device now.
    pub fn memory_bytes(&self) -> usize {
        usize::try_from(self.report.bytes.load(Ordering::Relaxed)).unwrap_or(0)
    }

    /// Lets every allocation fail that would bring the device's memory beyond `bytes`.
    pub fn limit_memory(&self, bytes: usize) {
        self.report.limit.store(isize::try_from(bytes).unwrap_or(isize::MAX), Ordering::Relaxed);
    }

    /// The first error since the last call, if there was one, as `Error::OutOfMemory` or
    /// `Error::Device` that begins with `what`.
    pub(super) fn check(&self, what: &str) -> Result<()> {
        // SAFETY: the handle is valid while self lives. The call clears the thread's error code.
        let code = unsafe { rtc!(rtcGetDeviceError; self.handle) };
        let reported =
            self.report.first_error.lock().unwrap_or_else(PoisonError::into_inner).take();
        let code_alone = (code != raw::RTC_ERROR_NONE).then(|| (code, String::new()));
        let Some((code, text)) = reported.or(code_alone) else { return Ok(()) };
        let text = if text.is_empty() { text } else { format!(" ({text})") };
        let text = format!("Embree, {what}: {}{text}", describe(code));
        Err(match code {
            raw::RTC_ERROR_OUT_OF_MEMORY => Error::OutOfMemory(text),
            _ => Error::Device(text),
        })
    }
}

impl Drop for Device {
    fn drop(&mut self) {
        // SAFETY: the handle is valid and this is its only release; every scene holds an Arc of the
        // device, so none is left.
        unsafe { rtc!(rtcReleaseDevice; self.handle) };
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_library_of_another_version_is_refused() {
        assert!(check_version((3, 13), (3, 13)).is_ok() && check_version((3, 12), (3, 13)).is_ok());
        for library in [(4, 3), (4, 13), (3, 12), (2, 17)] {
            let text = check_version((3, 13), library).unwrap_err().to_string();
            assert!(text.contains("compiled for Embree 3.13"), "{text}");
            assert!(
                text.contains(&format!("Embree {}.{}", library.0, library.1))
                    && text.contains("choose the backend \"bvh\""),
                "{text}"
            );
        }
        let device = Device::new("").unwrap();
        assert!(
            device.version().starts_with(&format!("Embree {}.", HEADER_VERSION.0)),
            "{}",
            device.version()
        );
    }
}
