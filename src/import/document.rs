//! A document: its text parsed and checked, and read by the crate `gltf`.

use super::budget::Budget;
use super::container::{self, Container};
use super::fault::{Fault, Parsed};
use super::uri::Folder;
use super::warnings::Warnings;
use super::{check, extensions, parse};
use serde::Deserialize;
use serde_json::{Value, json};
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
    pub folder: Folder,
}

impl<'a> Document<'a> {
    /// Reads the document in the bytes of the file at `path`; `outside` allows files outside its
    /// folder.
    pub fn read(
        bytes: &'a [u8], path: &Path, outside: bool, budget: &mut Budget, warnings: &mut Warnings,
    ) -> Parsed<Self> {
        let container = container::split(bytes, path, warnings)?;
        let mut json = parse::parse(container.json, budget)?;
        check::asset(&json, warnings)?;
        extensions::check(&json)?;
        check::document(&mut json, warnings)?;
        // Nodes are many, and read from the JSON alone.
        let nodes = json.get_mut("nodes").map(|nodes| std::mem::replace(nodes, json!([])));
        let root = gltf::json::Root::deserialize(&json)
            .map_err(|e| Fault::new("", format!("not a glTF document: {e}")))?;
        if let Some(nodes) = nodes {
            json["nodes"] = nodes;
        }
        let gltf = gltf::Document::from_json_without_validation(root);
        let folder = Folder::of(path, outside);
        Ok(Self { gltf, json, container, folder })
    }

    /// The document as plain structs.
    pub fn root(&self) -> &gltf::json::Root {
        self.gltf.as_json()
    }
}
