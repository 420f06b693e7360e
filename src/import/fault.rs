//! Complaints about a document, each with the place.

use crate::error::Error;
use serde_json::Value;
use std::path::Path;

/// What is wrong with a document and where; becomes an [`Error`] once the file's name is at hand.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Fault {
    /// JSON path, empty for the file as a whole.
    pub path: String,
    /// The complaint.
    pub what: String,
    /// What kind of complaint it is.
    pub why: Why,
}

/// What kind of complaint a [`Fault`] is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Why {
    /// The document breaks its specification.
    Broken,
    /// The document is sound, but we cannot read it.
    Unsupported,
    /// The document names a file that it may not have.
    Forbidden,
    /// The memory does not hold it.
    Memory,
}

/// The result of reading a part of a document.
pub(super) type Parsed<T> = std::result::Result<T, Fault>;

impl Fault {
    /// A breach of the specification at `path`.
    pub fn new(path: impl Into<String>, what: impl Into<String>) -> Self {
        Self { path: path.into(), what: what.into(), why: Why::Broken }
    }

    /// Something sound at `path` that we cannot read.
    pub fn unsupported(path: impl Into<String>, what: impl Into<String>) -> Self {
        Self { why: Why::Unsupported, ..Self::new(path, what) }
    }

    /// The error for the scene file `file`.
    pub fn into_error(self, file: &Path) -> Error {
        let (path, what) = (cut(self.path, 200), cut(self.what, 600));
        match self.why {
            Why::Broken | Why::Forbidden => Error::scene(file, path, what),
            Why::Unsupported => Error::unsupported(file, path, what),
            Why::Memory => Error::OutOfMemory(format!("{}: {path}: {what}", file.display())),
        }
    }
}

/// A text of at most `longest` characters: keys of a document may be as long as they like.
fn cut(text: String, longest: usize) -> String {
    match text.char_indices().nth(longest) {
        None => text,
        Some((end, _)) => format!("{}...", &text[..end]),
    }
}

/// A string of the document as it may appear in a message: quoted, control characters escaped, cut
/// to a readable length.
pub(super) fn quote(text: &str) -> String {
    format!("{:?}", cut(text.to_owned(), 80))
}

/// The object at `path` as messages call it: with its name if it has one.
pub(super) fn label(path: &str, object: &Value) -> String {
    match name(object) {
        Some(name) => format!("{path} ({})", quote(name)),
        None => path.to_owned(),
    }
}

/// The name of an object if it has one.
pub(super) fn name(object: &Value) -> Option<&str> {
    object["name"].as_str().filter(|name| !name.is_empty())
}
