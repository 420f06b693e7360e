//! The one error type of the library.

use std::fmt::{self, Display, Formatter, Write};
use std::path::{Path, PathBuf};

/// What every fallible function of the library returns.
pub type Result<T> = std::result::Result<T, Error>;

/// A failure, told so that its reader knows which file and place to look at and what to do.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// A scene file breaks its specification; `path` is the JSON path of the offending value, such
    /// as `/meshes/0/primitives/1`.
    Scene {
        /// The scene file.
        file: PathBuf,
        /// The JSON path inside it, empty for the file as a whole.
        path: String,
        /// What is wrong.
        what: String,
    },
    /// A file is sound but needs something that this program lacks; `what` names it and says what
    /// to do instead.
    Unsupported {
        /// The file.
        file: PathBuf,
        /// The JSON path inside it, empty for the file as a whole.
        path: String,
        /// What is missing, and the way around it.
        what: String,
    },
    /// An image file cannot be decoded or encoded.
    Image {
        /// The image file.
        file: PathBuf,
        /// What is wrong.
        what: String,
    },
    /// An argument is outside its domain.
    InvalidArgument(String),
    /// The ray tracing device or the denoiser failed, or is missing.
    Device(String),
    /// There is no memory for what was asked.
    OutOfMemory(String),
    /// Reading or writing a file failed.
    Io {
        /// The file.
        file: PathBuf,
        /// The operating system's reason.
        source: std::io::Error,
    },
    /// A cache file is damaged, or no cache file at all.
    Corrupt {
        /// The file.
        file: PathBuf,
        /// What is wrong.
        what: String,
    },
    /// A cache file is sound, but its records were made for another scene or under other settings.
    Stale {
        /// The file.
        file: PathBuf,
        /// What differs, and the way around it.
        what: String,
    },
    /// A host's callback failed, or answered what cannot be.
    Host(String),
    /// The caller asked to stop.
    Cancelled,
}

impl Display for Error {
    fn fmt(&self, f: &mut Formatter) -> fmt::Result {
        let text = match self {
            Self::Scene { file, path, what } | Self::Unsupported { file, path, what } => {
                let colon = if path.is_empty() { "" } else { ": " };
                format!("{}: {path}{colon}{what}", file.display())
            }
            Self::Image { file, what }
            | Self::Corrupt { file, what }
            | Self::Stale { file, what } => format!("{}: {what}", file.display()),
            Self::Io { file, source } => format!("{}: {source}", file.display()),
            Self::InvalidArgument(what)
            | Self::Device(what)
            | Self::OutOfMemory(what)
            | Self::Host(what) => what.clone(),
            Self::Cancelled => "cancelled".to_owned(),
        };
        f.write_str(&one_line(&text))
    }
}

/// Fails unless there is memory for `bytes` bytes more, which `what` is about to need. Nothing
/// stays taken. Ask before many allocations that cannot fail without ending the process.
///
/// # Errors
/// [`Error::OutOfMemory`].
pub fn check_room(what: impl Display, bytes: u64) -> Result<()> {
    let room = |bytes| {
        let mut buffer = Vec::<u8>::new();
        // The compiler must not conclude that nobody needs the buffer.
        std::hint::black_box(&mut buffer).try_reserve_exact(bytes).is_ok()
    };
    let fits = usize::try_from(bytes).is_ok_and(room);
    if fits { Ok(()) } else { Err(Error::memory(what, bytes)) }
}

/// `text` as it may reach a terminal or a log: one line, whose control characters are escaped, and
/// so are those that turn the direction of the text around them.
pub fn one_line(text: &str) -> String {
    let mut line = String::with_capacity(text.len());
    for c in text.chars() {
        let turns = matches!(c, '\u{200e}' | '\u{200f}' | '\u{2028}'..='\u{202e}');
        if c.is_control() || turns || matches!(c, '\u{2066}'..='\u{2069}') {
            let _ = write!(line, "{}", c.escape_default());
        } else {
            line.push(c);
        }
    }
    line
}

impl Error {
    /// A [`Error::Scene`] for `file` at the JSON path `path`.
    pub fn scene(file: &Path, path: impl Into<String>, what: impl Into<String>) -> Self {
        Self::Scene { file: file.to_owned(), path: path.into(), what: what.into() }
    }

    /// A [`Error::Unsupported`] for `file` at the JSON path `path`.
    pub fn unsupported(file: &Path, path: impl Into<String>, what: impl Into<String>) -> Self {
        Self::Unsupported { file: file.to_owned(), path: path.into(), what: what.into() }
    }

    /// A [`Error::Image`] for `file`.
    pub fn image(file: &Path, what: impl Into<String>) -> Self {
        Self::Image { file: file.to_owned(), what: what.into() }
    }

    /// A [`Error::OutOfMemory`] for `bytes` bytes that `what` needs.
    pub fn memory(what: impl std::fmt::Display, bytes: u64) -> Self {
        Self::OutOfMemory(format!("{what}: there is no memory for {bytes} bytes"))
    }

    /// Turns an I/O error on `file` into ours; for use with `map_err`.
    pub fn io(file: &Path) -> impl FnOnce(std::io::Error) -> Self + '_ {
        move |source| Self::Io { file: file.to_owned(), source }
    }
}
