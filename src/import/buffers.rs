//! Buffers and buffer views: where the bytes of accessors and images come from.

use super::budget::Budget;
use super::document::Document;
use super::fault::{Fault, Parsed, quote};
use super::meshopt;
use super::uri::{self, Target};
use super::warnings::Warnings;
use gltf::json::{buffer, validation::Checked};
use std::collections::HashMap;
use std::path::PathBuf;
use std::sync::Arc;

/// The bytes of a buffer.
enum Data<'a> {
    Chunk(&'a [u8]),
    /// Buffers of the same file share its bytes.
    Own(Arc<Vec<u8>>),
    /// Not to be had; says why. An error only where something needs the bytes.
    Absent(String),
}

/// A part of a buffer.
pub(super) struct View<'a> {
    /// JSON path.
    pub path: String,
    /// As the document describes it.
    pub json: &'a buffer::View,
    /// The bytes where they do not stand in the buffer as they are.
    decoded: Option<Vec<u8>>,
}

impl View<'_> {
    /// Distance of elements where the document gives one.
    pub fn stride(&self) -> Option<u64> {
        self.json.byte_stride.map(|stride| stride.0 as u64)
    }
}

/// All buffers and views of a document.
pub(super) struct Buffers<'a> {
    /// Lengths as the document declares them, and the bytes, which are no fewer.
    buffers: Vec<(u64, Data<'a>)>,
    /// The views.
    pub views: Vec<View<'a>>,
}

impl<'a> Buffers<'a> {
    /// Reads every buffer, and checks and decompresses every view.
    pub fn parse(
        document: &'a Document, budget: &mut Budget, warnings: &mut Warnings,
    ) -> Parsed<Self> {
        let mut reader = Reader { document, files: HashMap::new(), budget, warnings };
        let buffers = document.root().buffers.iter().enumerate();
        let buffers = buffers.map(|(i, json)| reader.buffer(i, json)).collect::<Parsed<_>>()?;
        let mut this = Self { buffers, views: Vec::new() };
        for (i, json) in document.root().buffer_views.iter().enumerate() {
            let path = format!("/bufferViews/{i}");
            let decoded = this.view(document, i, json, &path, budget)?;
            this.views.push(View { path, json, decoded });
        }
        Ok(this)
    }

    /// The bytes of a buffer, or why there are none.
    fn buffer(&self, buffer: usize) -> std::result::Result<&[u8], String> {
        match &self.buffers[buffer].1 {
            Data::Chunk(bytes) => Ok(bytes),
            Data::Own(bytes) => Ok(bytes),
            Data::Absent(why) => Err(format!("needs the bytes of /buffers/{buffer}, and {why}")),
        }
    }

    /// The bytes `offset..offset + length` of a buffer, or why there are none; `at` is who asks,
    /// and to blame if they do not fit.
    fn slice(
        &self, buffer: usize, offset: u64, length: u64, at: &str,
    ) -> Parsed<std::result::Result<&[u8], String>> {
        let whole = self.buffers[buffer].0;
        let end = offset.checked_add(length).filter(|end| *end <= whole).ok_or_else(|| {
            let what = format!(
                "its {length} bytes from {offset} on do not fit the {whole} bytes of /buffers/{buffer}"
            );
            Fault::new(at, what)
        })?;
        Ok(self.buffer(buffer).map(|bytes| &bytes[offset as usize..end as usize]))
    }

    /// Checks a view; returns its bytes if they are compressed.
    fn view(
        &self, document: &Document, index: usize, json: &buffer::View, path: &str,
        budget: &mut Budget,
    ) -> Parsed<Option<Vec<u8>>> {
        let length = json.byte_length.0;
        // Absent bytes are an error only where something needs them.
        let _ =
            self.slice(json.buffer.value(), json.byte_offset.unwrap_or_default().0, length, path)?;
        if let Some(stride) = json.byte_stride.map(|stride| stride.0) {
            let wrong = |what: String| Err(Fault::new(format!("{path}/byteStride"), what));
            if !(buffer::MIN_BYTE_STRIDE..=buffer::MAX_BYTE_STRIDE).contains(&stride)
                || stride % 4 != 0
            {
                return wrong(format!("{stride} is not a multiple of 4 from 4 to 252"));
            }
            if stride as u64 > length {
                return wrong(format!("{stride} is greater than the view's byteLength {length}"));
            }
            if json.target == Some(Checked::Valid(buffer::Target::ElementArrayBuffer)) {
                return wrong("a view of vertex indices must not have one".into());
            }
        }
        let Some(compressed) = meshopt::Compressed::of(&document.json["bufferViews"][index], path)?
        else {
            return Ok(None);
        };
        let at = compressed.path.as_str();
        let source = self.slice(compressed.buffer, compressed.offset, compressed.length, at)?;
        let source = source.map_err(|why| Fault::new(at, why))?;
        compressed.decode(source, length, budget).map(Some)
    }

    /// The bytes of a view, or why there are none.
    pub fn bytes(&self, view: usize) -> std::result::Result<&[u8], String> {
        let View { json, decoded, .. } = &self.views[view];
        if let Some(decoded) = decoded {
            return Ok(decoded);
        }
        // `view` has checked that the range fits.
        let start = json.byte_offset.unwrap_or_default().0 as usize;
        let range = start..start + json.byte_length.0 as usize;
        self.buffer(json.buffer.value()).map(|bytes| &bytes[range])
    }
}

/// Reads buffers, each file once.
struct Reader<'r, 'a> {
    document: &'a Document<'a>,
    files: HashMap<PathBuf, Arc<Vec<u8>>>,
    budget: &'r mut Budget,
    warnings: &'r mut Warnings,
}

impl<'a> Reader<'_, 'a> {
    fn buffer(&mut self, index: usize, json: &buffer::Buffer) -> Parsed<(u64, Data<'a>)> {
        let path = format!("/buffers/{index}");
        let declared = json.byte_length.0;
        let data = match &json.uri {
            None if meshopt::is_fallback(&self.document.json["buffers"][index]) => {
                Data::Absent("it is a placeholder for compressed data".into())
            }
            None if index == 0 && self.document.container.is_glb => self.chunk(declared)?,
            None => Data::Absent("it has no uri".into()),
            Some(uri) => self.external(&path, uri)?,
        };
        let actual = match &data {
            Data::Chunk(bytes) => bytes.len() as u64,
            Data::Own(bytes) => bytes.len() as u64,
            Data::Absent(_) => declared,
        };
        if actual > declared && matches!(data, Data::Own(_)) {
            let what = "the data is longer than that";
            self.warnings.allow(&format!("{path}/byteLength"), what)?;
        }
        if actual < declared {
            let what = format!("{declared} bytes are declared, and only {actual} are there");
            return Err(Fault::new(format!("{path}/byteLength"), what));
        }
        Ok((declared, data))
    }

    fn chunk(&mut self, declared: u64) -> Parsed<Data<'a>> {
        let missing = "it has no uri and so stands for the GLB's binary chunk, which is missing";
        let chunk = self.document.container.bin.ok_or_else(|| Fault::new("/buffers/0", missing))?;
        if chunk.len() as u64 > declared.saturating_add(3) {
            let what = "the GLB's binary chunk is longer than /buffers/0 declares";
            self.warnings.push(what);
        }
        Ok(Data::Chunk(chunk))
    }

    fn external(&mut self, path: &str, uri: &str) -> Parsed<Data<'a>> {
        let at = format!("{path}/uri");
        match uri::resolve(uri, &at, &self.document.folder)? {
            Target::Data { media_type, bytes } => {
                let known = ["", "application/octet-stream", "application/gltf-buffer"];
                if !known.contains(&media_type.as_str()) {
                    let what = format!(
                        "a buffer's data URI should be of type {} or {}, not {}",
                        known[1],
                        known[2],
                        quote(&media_type)
                    );
                    self.warnings.mend(&at, what)?;
                }
                Ok(Data::Own(Arc::new(bytes)))
            }
            Target::File(file) => {
                if let Some(bytes) = self.files.get(&file) {
                    return Ok(Data::Own(bytes.clone()));
                }
                let bytes = Arc::new(uri::read(&file, &at, u64::MAX, self.budget)?);
                self.files.insert(file, bytes.clone());
                Ok(Data::Own(bytes))
            }
            Target::Absolute => {
                let why = format!(
                    "its uri {} is not relative to the scene file: only such files are read, so copy the file there",
                    quote(uri)
                );
                self.warnings.push(format!("{path} is not read: {why}"));
                Ok(Data::Absent(why))
            }
        }
    }
}
