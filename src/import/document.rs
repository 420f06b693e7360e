//! A document: its text parsed and checked, and read by the crate `gltf`.

use super::container::{self, Container};
use super::fault::{Fault, Parsed};
use super::{check, extensions, parse};
use gltf::json;
use serde::Deserialize;
use serde_json::Value;
use std::path::Path;

/// A document that has passed the check.
pub(super) struct Document<'a> {
    /// As the crate reads it: indices are within their arrays, words are known but for those of
    /// [`super::schema::Unknown::Kept`], which are `Checked::Invalid`.
    pub gltf: gltf::Document,
    /// The JSON itself, for what the crate lacks: extensions, double precision, `extras`. It holds
    /// what [`super::schema`] names and nothing else.
    pub json: Value,
    /// The file around the text.
    pub container: Container<'a>,
    /// The folder of the file.
    pub folder: &'a Path,
}

impl<'a> Document<'a> {
    /// Reads the document in the bytes of the file at `path`.
    pub fn read(bytes: &'a [u8], path: &'a Path, warnings: &mut Vec<String>) -> Parsed<Self> {
        let container = container::split(bytes, path, warnings)?;
        let mut json = parse::parse(container.json)?;
        check::asset(&json, warnings)?;
        extensions::check(&json)?;
        check::document(&mut json, warnings)?;
        let root = json::Root::deserialize(&json)
            .map_err(|e| Fault::new("", format!("not a glTF document: {e}")))?;
        let gltf = gltf::Document::from_json_without_validation(root);
        let folder = path.parent().unwrap_or(Path::new(""));
        Ok(Self { gltf, json, container, folder })
    }

    /// The document as plain structs.
    pub fn root(&self) -> &json::Root {
        self.gltf.as_json()
    }
}
