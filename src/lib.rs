//! Global illumination by irradiance and radiance caching.
//!
//! Three uses of one code base: a renderer (glTF in, multi-layer OpenEXR out), a C library that
//! other renderers load, and a bench. The modules are listed in the order in which they may import
//! one another: a module uses only those above it (`tests/tools/architecture.rs` holds the rule,
//! `docs/ARCHITECTURE.md` the reasons).

#![deny(unsafe_code)]
#![warn(missing_docs)]
#![allow(
    rustdoc::broken_intra_doc_links,
    reason = "citations such as [Ward88] resolve in docs/references.bib, which a test checks"
)]

pub mod error;
pub mod progress;
pub mod fsutil;
pub mod words;
pub mod math;
pub mod sampling;
pub mod basis;
pub mod geometry;
#[allow(unsafe_code, reason = "the one place, with capi, where foreign functions are called")]
pub mod ffi;
pub mod imagefile;
pub mod accel;
pub mod texture;
pub mod material;
pub mod light;
pub mod camera;
pub mod scene;
pub mod gather;
pub mod cache;
pub mod transport;
pub mod film;
pub mod hosted;
pub mod import;
pub mod render;
pub mod compare;
pub mod bench;
#[allow(unsafe_code, reason = "the boundary to C")]
pub mod capi;
