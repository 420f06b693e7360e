//! Where the command line looks for Open Image Denoise.

use super::terminal::print;
use lumicache::error::Result;
use lumicache::render::{denoiser_places, find_denoiser};
use std::path::PathBuf;

/// The places that the environment names: see [`denoiser_places`].
pub fn places() -> Vec<PathBuf> {
    denoiser_places(|name| std::env::var_os(name))
}

/// Prints version and file of the denoiser.
pub fn info() -> Result<()> {
    let denoiser = find_denoiser(&places())?;
    let (version, path) = (denoiser.version(), denoiser.path().display().to_string());
    print(format!("Open Image Denoise {version}\n  file        {path}\n").as_bytes())
}
