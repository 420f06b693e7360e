//! The boundary to foreign code: raw declarations and the thin safe wrappers over them. The only
//! modules, with `capi`, that may say `unsafe`.

mod loading;
pub mod denoise;
pub mod mxcsr;
#[cfg(feature = "openexr")]
pub mod openexr;
pub mod ray;
#[cfg(feature = "embree")]
pub mod embree;
