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
    /// The document is sound, but we cannot read it.
    pub unsupported: bool,
}

/// The result of reading a part of a document.
pub(super) type Parsed<T> = std::result::Result<T, Fault>;

impl Fault {
    /// A breach of the specification at `path`.
    pub fn new(path: impl Into<String>, what: impl Into<String>) -> Self {
        Self { path: path.into(), what: what.into(), unsupported: false }
    }

    /// Something sound at `path` that we cannot read.
    pub fn unsupported(path: impl Into<String>, what: impl Into<String>) -> Self {
        Self { path: path.into(), what: what.into(), unsupported: true }
    }

    /// The error for the scene file `file`.
    pub fn into_error(self, file: &Path) -> Error {
        if self.unsupported {
            Error::unsupported(file, self.path, self.what)
        } else {
            Error::scene(file, self.path, self.what)
        }
    }
}

/// A string of the document as it may appear in a message: quoted, control characters escaped, cut
/// to a readable length.
pub(super) fn quote(text: &str) -> String {
    const LONGEST: usize = 80;
    match text.char_indices().nth(LONGEST) {
        None => format!("{text:?}"),
        Some((end, _)) => format!("{:?}...", &text[..end]),
    }
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
