//! Devices: threads, ray tracer and log of one user of the library.

use super::abi::{LUMI_ABI_VERSION, copy_text, lumi_device, lumi_device_s, text};
use super::handles::{Kind, borrow, clear, publish, release, retain};
use super::pool::Pool;
use super::status::{
    Fault, LUMI_ERROR_VERSION, LUMI_LOG_WARNING, LUMI_OK, Outcome, Touched, ensure, guard,
    guard_void, lumi_error, lumi_log_fn,
};
use crate::accel::{Accel, Backend};
use crate::error::one_line;
use crate::geometry::Geometry;
use crate::material::tables::TableStore;
use crate::render::denoiser_places;
use std::ffi::{c_char, c_void};
use std::path::PathBuf;

/// The environment variable that names the folder of tables where the host names none.
const TABLES: &str = "LUMICACHE_TABLES";
/// The environment variable that names the file of Embree, in builds that load it at run time.
#[cfg(feature = "private-embree")]
const EMBREE: &str = "LUMICACHE_EMBREE";

/// A device.
pub(super) struct DeviceObject {
    pub touched: Touched,
    pub pool: Pool,
    pub backend: Backend,
    /// Name and version of the ray tracer.
    pub backend_version: String,
    /// Where tabulated lobes are kept between runs.
    pub tables: TableStore,
    /// Where Open Image Denoise is looked for.
    pub denoisers: Vec<PathBuf>,
}

impl Kind for DeviceObject {
    type Opaque = lumi_device_s;
    const NAME: &'static str = "device";
    fn touched(&self) -> &Touched {
        &self.touched
    }
}

impl DeviceObject {
    pub fn warn(&self, message: &str) {
        self.touched.log.tell(LUMI_LOG_WARNING, LUMI_OK, &one_line(message));
    }
}

fn new_device(config: &str) -> Outcome<DeviceObject> {
    let (mut threads, mut wanted) = (0_usize, None);
    let mut tables = std::env::var_os(TABLES);
    let mut denoisers = denoiser_places(|name| std::env::var_os(name));
    for item in config.split(',').map(str::trim).filter(|i| !i.is_empty()) {
        let (key, value) = item.split_once('=').unwrap_or((item, ""));
        match key.trim() {
            "threads" => {
                threads = value.trim().parse().ok().filter(|n| *n <= 4096).ok_or_else(|| {
                    let expected = "expected a number from 0 (all processors) to 4096";
                    Fault::argument(format!("config: threads={value}: {expected}"))
                })?;
            }
            "backend" => wanted = Some(value.trim().parse::<Backend>()?),
            "tables" => tables = Some(value.trim().into()),
            "denoiser" if value.trim().is_empty() => (),
            "denoiser" => denoisers = vec![value.trim().into()],
            _ => ensure!(
                false,
                "config: there is no `{key}`; there are threads, backend, tables and denoiser"
            ),
        }
    }
    #[cfg(feature = "private-embree")]
    if let Some(path) = std::env::var_os(EMBREE).filter(|path| !path.is_empty()) {
        crate::ffi::embree::name_library(path);
    }
    let backend = wanted.unwrap_or_default();
    let backend_version = Accel::build(&Geometry::default(), backend)?.version();
    let (touched, pool) = (Touched::default(), Pool::new(threads, "lumicache")?);
    let folder = tables.filter(|t| !t.is_empty() && t != "off").map(PathBuf::from);
    let tables = TableStore::new(folder);
    Ok(DeviceObject { touched, pool, backend, backend_version, tables, denoisers })
}

/// The version of the ABI that the library has, as LUMI_ABI_VERSION of its header.
///
/// Threads: any.
#[unsafe(no_mangle)]
pub extern "C" fn lumi_get_abi_version() -> u32 {
    let mut version = 0;
    guard("lumi_get_abi_version", || {
        version = LUMI_ABI_VERSION;
        Ok(())
    });
    version
}

/// The version of the library, such as "0.1.0"; lives as long as the library.
///
/// Threads: any.
#[unsafe(no_mangle)]
pub extern "C" fn lumi_get_version_string() -> *const c_char {
    let mut version = std::ptr::null();
    guard("lumi_get_version_string", || {
        version = concat!(env!("CARGO_PKG_VERSION"), "\0").as_ptr().cast();
        Ok(())
    });
    version
}

/// Makes a device; the caller owns a reference to it.
///
/// `abi_version`: pass LUMI_ABI_VERSION. Another major version, or a later minor one than the
/// library's, fails with LUMI_ERROR_VERSION. `config`: NULL, or settings separated by commas:
/// `threads=N` (0: all processors), `backend=embree` or `backend=bvh` (default: Embree if it
/// starts), `tables=FOLDER` (where tabulated glossy lobes are kept between runs, `off` for memory
/// alone; default: the folder that the environment variable LUMICACHE_TABLES names, else `off`),
/// `denoiser=PATH` (the file of Open Image Denoise, or a folder that has it; default: what the
/// environment variable LUMICACHE_OIDN names, else `lumicache/oidn` in the user's data folder, then
/// the system's folders).
/// `out`: receives the device, NULL on failure.
///
/// Threads: any.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn lumi_device_new(
    abi_version: u32, config: *const c_char, out: *mut lumi_device,
) -> lumi_error {
    guard("lumi_device_new", || {
        clear(out)?;
        if abi_version >> 16 != LUMI_ABI_VERSION >> 16 || abi_version > LUMI_ABI_VERSION {
            let what = format!(
                "the caller was compiled for ABI {abi_version:#x}, this library has {LUMI_ABI_VERSION:#x}"
            );
            return Err(Fault::new(LUMI_ERROR_VERSION, what));
        }
        let config = if config.is_null() { "" } else { text(config, "config")? };
        publish(new_device(config)?, out)
    })
}

/// Adds a reference.
///
/// Threads: any.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn lumi_device_retain(device: lumi_device) {
    guard_void("lumi_device_retain", || retain::<DeviceObject>(device));
}

/// Drops a reference. Scenes and caches keep what they need of their device. NULL is ignored.
///
/// Threads: any.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn lumi_device_release(device: lumi_device) {
    guard_void("lumi_device_release", || release::<DeviceObject>(device));
}

/// Sets the callback that hears of warnings and failures of calls on this device, its scenes and
/// its caches; NULL: none.
///
/// Threads: any; a message under way may still go to the former callback.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn lumi_device_set_log(
    device: lumi_device, callback: lumi_log_fn, user: *mut c_void,
) -> lumi_error {
    guard("lumi_device_set_log", || {
        borrow::<DeviceObject>(device)?.touched.log.set(callback, user);
        Ok(())
    })
}

/// Writes name and version of the ray tracer, such as "Embree 4.3.3", to `buffer`, cut off to
/// `size` bytes with its NUL.
///
/// Threads: any.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn lumi_device_get_backend(
    device: lumi_device, buffer: *mut c_char, size: usize,
) -> lumi_error {
    guard("lumi_device_get_backend", || {
        let device = borrow::<DeviceObject>(device)?;
        ensure!(!buffer.is_null() && size > 0, "there is no room for the text");
        let size = size.min(device.backend_version.len() + 1);
        // SAFETY: the host passes room for at least `size` bytes, and at least one.
        let room = unsafe {
            std::ptr::write_bytes(buffer, 0, size);
            std::slice::from_raw_parts_mut(buffer, size)
        };
        copy_text(&device.backend_version, &mut room[..size - 1]);
        Ok(())
    })
}
