//! Open Image Denoise 2 or newer, loaded at run time: the functions of its C interface that a
//! filter of one picture needs, and a safe wrapper around them.
//!
//! The library's names stay out of the global scope, so a host that has another copy keeps its own.
//! The library is never unloaded, because its threads outlive its devices.

use super::loading;
use crate::math::Vec3;
use libloading::os::unix::Library;
use std::ffi::{CStr, c_char, c_int, c_void};
use std::path::{Path, PathBuf};
use std::ptr::NonNull;

/// The file name of the library. As a place it stands for the system's folders.
pub const NAME: &str = "libOpenImageDenoise.so.2";
/// Where the library lies in a folder that somebody names: there, in an installation, and in the
/// Python package `pyoidn`.
const INSIDE: [&str; 4] = ["", "lib", "oidn/lib", "pyoidn/oidn/lib"];
/// `oidnGetDeviceInt(device, "version")` of the oldest version that will do.
const OLDEST: c_int = 2_00_00;
/// How the names begin of the files that the library needs beside it.
const PARTS: [&str; 2] = ["libOpenImageDenoise", "libtbb"];
/// How the name begins of the file that the library loads for processors.
const PROCESSOR: &str = "libOpenImageDenoise_device_cpu.";

const DEVICE_CPU: c_int = 1;
const FORMAT_FLOAT3: c_int = 3;
const _: () = assert!(size_of::<Vec3>() == 3 * size_of::<f32>(), "pixels lie without gaps");
/// Most megabytes of a filter's own memory: larger pictures are filtered in tiles that overlap.
/// Pictures of 4096 x 4096 pixels are.
pub const MEMORY: u32 = 2048;

/// Columns and rows below which the network has too little to look at.
const LEAST: usize = 32;

/// An object of the library.
type Handle = NonNull<c_void>;
/// What the library calls with the share of the work that is done; false ends the work.
type Monitor = unsafe extern "C" fn(*mut c_void, f64) -> bool;
/// Hears which share of the work is done, 0 to 1, and says whether to go on.
pub type GoOn<'a> = dyn Fn(f64) -> bool + Sync + 'a;

macro_rules! functions {
    ($($field:ident: $name:literal, fn($($argument:ty),*) $(-> $result:ty)?;)*) => {
        /// The functions of the library.
        #[derive(Clone, Copy)]
        struct Functions {
            $($field: unsafe extern "C" fn($($argument),*) $(-> $result)?,)*
        }

        impl Functions {
            /// The functions of `library`; the name of the first that it lacks, if it does.
            fn of(library: &Library) -> Result<Self, &'static str> {
                // SAFETY: the functions have these types in every 2.x of the library.
                Ok(Self { $($field: *unsafe { library.get(concat!($name, "\0").as_bytes()) }
                    .map_err(|_| $name)?,)* })
            }
        }
    };
}

functions! {
    new_device: "oidnNewDevice", fn(c_int) -> Option<Handle>;
    set_device_bool: "oidnSetDeviceBool", fn(Handle, *const c_char, bool);
    set_device_int: "oidnSetDeviceInt", fn(Handle, *const c_char, c_int);
    get_device_int: "oidnGetDeviceInt", fn(Handle, *const c_char) -> c_int;
    commit_device: "oidnCommitDevice", fn(Handle);
    get_device_error: "oidnGetDeviceError", fn(Option<Handle>, *mut *const c_char) -> c_int;
    release_device: "oidnReleaseDevice", fn(Handle);
    new_filter: "oidnNewFilter", fn(Handle, *const c_char) -> Option<Handle>;
    set_image: "oidnSetSharedFilterImage",
        fn(Handle, *const c_char, *mut c_void, c_int, usize, usize, usize, usize, usize);
    set_filter_bool: "oidnSetFilterBool", fn(Handle, *const c_char, bool);
    set_filter_int: "oidnSetFilterInt", fn(Handle, *const c_char, c_int);
    set_monitor: "oidnSetFilterProgressMonitorFunction", fn(Handle, Option<Monitor>, *mut c_void);
    commit_filter: "oidnCommitFilter", fn(Handle);
    execute_filter: "oidnExecuteFilter", fn(Handle);
    release_filter: "oidnReleaseFilter", fn(Handle);
}

/// The library, loaded.
pub struct Denoiser {
    functions: Functions,
    path: PathBuf,
    version: c_int,
    /// Keeps the library open.
    _library: Library,
}

/// A picture to be denoised, row by row, and what is known of its surfaces without noise. All
/// numbers are finite.
pub struct Noisy<'a> {
    /// Columns and rows.
    pub size: [u32; 2],
    /// Linear light.
    pub color: &'a [Vec3],
    /// Albedo, 0 to 1.
    pub albedo: &'a [Vec3],
    /// Normals, in any frame.
    pub normal: &'a [Vec3],
}

impl Denoiser {
    /// Loads the library from the first of `places` that has it: files, folders that hold it, or
    /// its bare name [`NAME`] for the system's folders.
    ///
    /// # Errors
    /// One line that says what is missing or wrong.
    pub fn load(places: &[PathBuf]) -> Result<Self, String> {
        let mut missing = Vec::new();
        for place in places {
            if place.as_os_str() == NAME {
                match loading::open(place) {
                    Ok(library) => return Self::new(library, place),
                    Err(error) => missing.push(error),
                }
            } else if let Some(file) = library_at(place) {
                let library =
                    open(&file).map_err(|e| format!("the denoiser does not load: {e}"))?;
                return Self::new(library, &file);
            } else {
                missing.push(format!("{}: no file, and no folder with it", place.display()));
            }
        }
        Err(format!("Open Image Denoise was not found ({})", missing.join("; ")))
    }

    /// The denoiser in `library`, which is the file at `path`.
    fn new(library: Library, path: &Path) -> Result<Self, String> {
        let named = path.display();
        let functions = Functions::of(&library).map_err(|name| {
            format!("{named} is not Open Image Denoise 2 or newer: it has no function {name}")
        })?;
        let mut this = Self { functions, path: path.to_owned(), version: 0, _library: library };
        let version = this.device(1).map(|device| device.version());
        this.version = version.map_err(|what| format!("{named}: {what}"))?;
        if this.version < OLDEST {
            let version = this.version();
            return Err(format!("{named} is Open Image Denoise {version}: 2.0 or newer is needed"));
        }
        Ok(this)
    }

    /// The version, such as "2.5.1".
    pub fn version(&self) -> String {
        let v = self.version;
        format!("{}.{}.{}", v / 10000, v / 100 % 100, v % 100)
    }

    /// The file of the library; its bare name if the system found it.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// `noisy` without its noise, by `threads` threads. Numbers of the result may be negative.
    ///
    /// # Errors
    /// The library's own message; also when `go_on` said no.
    pub fn run(&self, noisy: &Noisy, threads: usize, go_on: &GoOn) -> Result<Vec<Vec3>, String> {
        let [width, height] = noisy.size.map(|n| n as usize);
        let inputs = [noisy.color, noisy.albedo, noisy.normal];
        if inputs.iter().any(|pixels| pixels.len() != width * height) || width * height == 0 {
            return Err(format!("the images to denoise do not have {width} x {height} pixels"));
        }
        let wide = [width.max(LEAST), height.max(LEAST)];
        if wide == [width, height] {
            return self.filter(inputs, wide, threads, go_on);
        }
        // Of small pictures the last column and row are repeated.
        let widen = |pixels: &[Vec3]| -> Vec<Vec3> {
            let at = |i: usize| {
                let (x, y) = (i % wide[0], i / wide[0]);
                pixels[y.min(height - 1) * width + x.min(width - 1)]
            };
            (0..wide[0] * wide[1]).map(at).collect()
        };
        let [color, albedo, normal] = inputs.map(widen);
        let output = self.filter([&color, &albedo, &normal], wide, threads, go_on)?;
        Ok((0..width * height).map(|i| output[i / width * wide[0] + i % width]).collect())
    }

    /// Filters colour by albedo and normal, each of this size.
    fn filter(
        &self, [color, albedo, normal]: [&[Vec3]; 3], size: [usize; 2], threads: usize,
        go_on: &GoOn,
    ) -> Result<Vec<Vec3>, String> {
        let mut output = vec![Vec3::ZERO; size[0] * size[1]];
        let device = self.device(threads)?;
        let filter = device.filter()?;
        for (name, pixels) in [(c"color", color), (c"albedo", albedo), (c"normal", normal)] {
            filter.image(name, pixels.as_ptr().cast_mut().cast(), size);
        }
        filter.image(c"output", output.as_mut_ptr().cast(), size);
        filter.run(&device, go_on)?;
        Ok(output)
    }

    /// A device for processors, not for graphics cards.
    fn device(&self, threads: usize) -> Result<Device<'_>, String> {
        let f = &self.functions;
        // SAFETY: the handle is used while the device lives, and the strings end in NUL.
        unsafe {
            let Some(handle) = (f.new_device)(DEVICE_CPU) else {
                return Err(failure(f, None).unwrap_or_else(|| "no device".to_owned()));
            };
            let device = Device { functions: f, handle };
            let threads = c_int::try_from(threads).unwrap_or(0);
            (f.set_device_int)(handle, c"numThreads".as_ptr(), threads);
            (f.set_device_bool)(handle, c"setAffinity".as_ptr(), false);
            (f.commit_device)(handle);
            device.checked()
        }
    }
}

/// The library that `place` is or holds.
fn library_at(place: &Path) -> Option<PathBuf> {
    let files = INSIDE.iter().map(|folder| place.join(folder).join(NAME));
    let file = std::iter::once(place.to_owned()).chain(files).find(|path| path.is_file())?;
    // A path without a slash would be looked for elsewhere.
    file.canonicalize().ok()
}

/// The files beside `file` whose names begin so.
fn beside(file: &Path, begin: &str) -> Vec<PathBuf> {
    let entries = file.parent().and_then(|folder| folder.read_dir().ok()).into_iter().flatten();
    let ours = entries.flatten().filter(|e| e.file_name().to_string_lossy().starts_with(begin));
    ours.map(|entry| entry.path()).collect()
}

/// Loads the library that is `file`.
fn open(file: &Path) -> Result<Library, String> {
    let needed = PARTS.iter().flat_map(|part| beside(file, part));
    let mut files = std::iter::once(file.to_owned()).chain(needed);
    if let Some(broken) = files.find(|path| !loading::is_whole(path)) {
        return Err(format!("{} is incomplete", broken.display()));
    }
    let library = loading::open(file)?;
    // The library would load this file so that it prefers what is in the global scope: functions of
    // a host's copy of another version. What is loaded already is not loaded again.
    if let [processor] = &beside(file, PROCESSOR)[..] {
        let _ = loading::open(processor);
    }
    Ok(library)
}

/// What went wrong since somebody asked last.
fn failure(functions: &Functions, device: Option<Handle>) -> Option<String> {
    let mut message = std::ptr::null();
    // SAFETY: the message lives until the next call.
    unsafe {
        let code = (functions.get_device_error)(device, &raw mut message);
        let text = || match message.is_null() {
            true => format!("error {code}"),
            false => CStr::from_ptr(message).to_string_lossy().into_owned(),
        };
        (code != 0).then(text)
    }
}

/// A device, released when dropped.
struct Device<'a> {
    functions: &'a Functions,
    handle: Handle,
}

impl<'a> Device<'a> {
    /// The device, unless something went wrong.
    fn checked(self) -> Result<Self, String> {
        failure(self.functions, Some(self.handle)).map_or(Ok(self), Err)
    }

    fn version(&self) -> c_int {
        // SAFETY: the device is alive, and the string ends in NUL.
        unsafe { (self.functions.get_device_int)(self.handle, c"version".as_ptr()) }
    }

    /// A filter for traced pictures of linear light with guides that have no noise.
    fn filter(&self) -> Result<Filter<'a>, String> {
        let f = self.functions;
        // SAFETY: the device is alive, and the strings end in NUL.
        unsafe {
            let Some(handle) = (f.new_filter)(self.handle, c"RT".as_ptr()) else {
                let what = failure(f, Some(self.handle));
                return Err(what.unwrap_or_else(|| "no filter".to_owned()));
            };
            (f.set_filter_bool)(handle, c"hdr".as_ptr(), true);
            (f.set_filter_bool)(handle, c"cleanAux".as_ptr(), true);
            (f.set_filter_int)(handle, c"maxMemoryMB".as_ptr(), MEMORY as c_int);
            Ok(Filter { functions: f, handle })
        }
    }
}

impl Drop for Device<'_> {
    fn drop(&mut self) {
        // SAFETY: the device is alive, and nothing uses it any more.
        unsafe { (self.functions.release_device)(self.handle) }
    }
}

/// A filter, released when dropped.
struct Filter<'a> {
    functions: &'a Functions,
    handle: Handle,
}

impl Filter<'_> {
    /// Names `width` x `height` pixels of three floats. They live until the filter is dropped.
    fn image(&self, name: &CStr, pixels: *mut c_void, [width, height]: [usize; 2]) {
        let image = self.functions.set_image;
        // SAFETY: the filter is alive, and there are as many pixels; zero stands for no gaps.
        unsafe {
            image(self.handle, name.as_ptr(), pixels, FORMAT_FLOAT3, width, height, 0, 0, 0);
        }
    }

    fn run(&self, device: &Device, mut go_on: &GoOn) -> Result<(), String> {
        let user: *mut &GoOn = &raw mut go_on;
        // SAFETY: filter and device are alive, and so are the images and what `user` points to,
        // which is called no more when the filter has been executed.
        unsafe {
            (self.functions.set_monitor)(self.handle, Some(monitor), user.cast());
            (self.functions.commit_filter)(self.handle);
            (self.functions.execute_filter)(self.handle);
        }
        failure(device.functions, Some(device.handle)).map_or(Ok(()), Err)
    }
}

/// Asks the [`GoOn`] behind `user`.
unsafe extern "C" fn monitor(user: *mut c_void, done: f64) -> bool {
    // SAFETY: `Filter::run` gave this pointer and waits.
    let go_on = unsafe { &*user.cast::<&GoOn>() };
    go_on(done)
}

impl Drop for Filter<'_> {
    fn drop(&mut self) {
        // SAFETY: the filter is alive, and nothing uses it any more.
        unsafe { (self.functions.release_filter)(self.handle) }
    }
}

// SAFETY: the functions of the library may be called from any thread.
unsafe impl Send for Denoiser {}
// SAFETY: as above; each call makes a device of its own.
unsafe impl Sync for Denoiser {}
