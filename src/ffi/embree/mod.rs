//! Embree 3 or 4: devices and scenes here, rays in `trace`. Every call of an `rtc*` function is in
//! this module, by the macro `rtc!`: the library is linked, or with the feature `private-embree`
//! loaded by `library`.
//!
//! The two major versions differ, for us, in how options reach the ray functions, which `trace`
//! hides, and in the size of the hit structures, which bindgen reads from the header that the build
//! found.

/// `rtc!(rtcFunction; arguments)` calls a function of Embree.
macro_rules! rtc {
    ($function:ident; $($argument:expr),* $(,)?) => {{
        #[cfg(not(feature = "private-embree"))]
        let result = raw::$function($($argument),*);
        #[cfg(feature = "private-embree")]
        let result = $crate::ffi::embree::library::loaded().$function($($argument),*);
        result
    }};
}

#[cfg(feature = "private-embree")]
pub(in crate::ffi) mod library;
mod device;
mod scene;
mod trace;

pub use device::{Device, HEADER_VERSION, check_version};
#[cfg(feature = "private-embree")]
pub use library::name as name_library;
pub use scene::{Scene, SceneBuilder};

#[allow(
    non_camel_case_types,
    non_snake_case,
    non_upper_case_globals,
    missing_docs,
    dead_code,
    unsafe_op_in_unsafe_fn,
    clippy::all,
    reason = "written by bindgen in Embree's own names"
)]
mod raw {
    include!(concat!(env!("OUT_DIR"), "/embree.rs"));
}
