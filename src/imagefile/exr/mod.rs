//! OpenEXR files.
//!
//! [`write()`] makes one part of scan lines with ZIP compression, through OpenEXR itself with the
//! cargo feature `openexr` and through the `exr` crate without the feature. [`read`] always goes
//! through the `exr` crate and accepts whatever that crate can decode.

mod prepared;
mod read;
mod write_exrs;
#[cfg(feature = "openexr")]
mod write_openexr;

pub(super) use read::read_bytes_within;
pub use read::{read, read_bytes};

use super::picture::Picture;
use crate::error::{Error, Result};
use crate::fsutil::write_atomically_with;
use prepared::Prepared;
use std::path::Path;

/// The names of outputs; a name without an extension is that of an OpenEXR file, too.
pub const EXTENSIONS: [&str; 2] = ["exr", ""];

/// The programs that can write a file. Their files hold the same pixels and attributes in different
/// bytes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Encoder {
    /// OpenEXR's C core.
    #[cfg(feature = "openexr")]
    OpenExr,
    /// The `exr` crate.
    Exrs,
}

impl Default for Encoder {
    fn default() -> Self {
        #[cfg(feature = "openexr")]
        return Self::OpenExr;
        #[cfg(not(feature = "openexr"))]
        return Self::Exrs;
    }
}

/// Writes `picture` to `path` through a temporary file and a rename. The bytes depend on `picture`
/// alone.
///
/// # Errors
/// [`Error::Image`] naming `path` for sizes that do not fit, missing channels, empty, too long or
/// duplicate names, attributes that every file has anyway, and `Uint` samples that are no whole
/// numbers up to 2^24; [`Error::Io`] when the file cannot be written.
pub fn write(path: &Path, picture: &Picture) -> Result<()> {
    write_with(path, picture, Encoder::default())
}

/// [`write()`] with a chosen encoder.
///
/// # Errors
/// As for [`write()`].
pub fn write_with(path: &Path, picture: &Picture, encoder: Encoder) -> Result<()> {
    let image = Prepared::new(picture).map_err(|what| Error::image(path, what))?;
    write_atomically_with(path, |temporary| match encoder {
        #[cfg(feature = "openexr")]
        Encoder::OpenExr => write_openexr::write(temporary, &image)
            .map_err(|what| Error::image(path, format!("OpenEXR: {what}"))),
        Encoder::Exrs => write_exrs::write(temporary, &image).map_err(|e| match e {
            ::exr::error::Error::Io(source) => Error::Io { file: path.to_owned(), source },
            other => Error::image(path, other.to_string()),
        }),
    })
}
