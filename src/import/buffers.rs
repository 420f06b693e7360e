//! Buffers and buffer views: where the bytes of accessors and images come from.

use super::budget::Budget;
use super::container::Container;
use super::json::{Fault, Json, Parsed, quote};
use super::meshopt;
use super::uri::{self, Target};
use std::collections::HashMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Buffer views that hold vertex indices carry this target.
const ELEMENT_ARRAY_BUFFER: u64 = 34963;

enum Data<'a> {
    Chunk(&'a [u8]),
    /// Buffers of the same file share its bytes.
    Own(Arc<Vec<u8>>),
    /// Not to be had; says why. An error only where something needs the bytes.
    Absent(String),
}

struct Buffer<'a> {
    path: String,
    byte_length: u64,
    data: Data<'a>,
}

impl Buffer<'_> {
    /// The bytes, at least `byte_length` of them, or why there are none.
    fn bytes(&self) -> std::result::Result<&[u8], String> {
        match &self.data {
            Data::Chunk(bytes) => Ok(bytes),
            Data::Own(bytes) => Ok(bytes),
            Data::Absent(why) => Err(format!("needs the bytes of {}, and {why}", self.path)),
        }
    }
}

/// A part of a buffer.
pub(super) struct View {
    /// JSON path.
    pub path: String,
    /// Distance of elements where the document gives one.
    pub stride: Option<u64>,
    /// Length in bytes.
    pub length: u64,
    /// Start in the buffer.
    pub offset: u64,
    buffer: usize,
    /// The bytes where they do not stand in the buffer as they are.
    decoded: Option<Vec<u8>>,
}

/// All buffers and views of a document.
pub(super) struct Buffers<'a> {
    buffers: Vec<Buffer<'a>>,
    /// The views.
    pub views: Vec<View>,
}

impl<'a> Buffers<'a> {
    /// Reads every buffer, and checks and decompresses every view.
    pub fn parse(
        root: &Json,
        container: &'a Container,
        folder: &Path,
        budget: &mut Budget,
        warnings: &mut Vec<String>,
    ) -> Parsed<Self> {
        let mut buffers = Vec::new();
        let mut reader = Reader { container, folder, files: HashMap::new(), budget, warnings };
        for (i, json) in root.entities("buffers")?.iter().enumerate() {
            buffers.push(reader.buffer(json, i)?);
        }
        let mut this = Self { buffers, views: Vec::new() };
        for json in root.entities("bufferViews")? {
            let view = this.view(&json, budget)?;
            this.views.push(view);
        }
        Ok(this)
    }

    /// The bytes `offset..offset + length` of a buffer, or why there are none; `at` is who asks,
    /// and to blame if they do not fit.
    fn slice(
        &self,
        buffer: usize,
        offset: u64,
        length: u64,
        at: &Json,
    ) -> Parsed<std::result::Result<&[u8], String>> {
        let buffer = &self.buffers[buffer];
        let Buffer { byte_length, path, .. } = buffer;
        let end = offset.checked_add(length).filter(|end| end <= byte_length).ok_or_else(|| {
            at.fault(format!(
                "its {length} bytes from {offset} on do not fit the {byte_length} bytes of {path}"
            ))
        })?;
        Ok(buffer.bytes().map(|bytes| &bytes[offset as usize..end as usize]))
    }

    fn view(&self, json: &Json, budget: &mut Budget) -> Parsed<View> {
        let buffer = json.need_index("buffer", "buffers", self.buffers.len())?;
        let length = json.need_positive("byteLength")?;
        let offset = json.unsigned("byteOffset")?.unwrap_or(0);
        let stride = json.unsigned("byteStride")?;
        let target = json.unsigned("target")?;
        // Absent bytes are an error only where something needs them.
        let _ = self.slice(buffer, offset, length, json)?;
        if let Some(stride) = stride {
            let wrong = |what: String| Err(json.fault_at("byteStride", what));
            if !(4..=252).contains(&stride) || stride % 4 != 0 {
                return wrong(format!("{stride} is not a multiple of 4 from 4 to 252"));
            }
            if stride > length {
                return wrong(format!("{stride} is greater than the view's byteLength {length}"));
            }
            if target == Some(ELEMENT_ARRAY_BUFFER) {
                return wrong("a view of vertex indices must not have one".into());
            }
        }
        let decoded = match meshopt::Compressed::of(json, self.buffers.len())? {
            None => None,
            Some(compressed) => {
                let source = self.slice(
                    compressed.buffer,
                    compressed.offset,
                    compressed.length,
                    &compressed.json,
                )?;
                let source = source.map_err(|why| compressed.json.fault(why))?;
                Some(compressed.decode(source, length, budget)?)
            }
        };
        Ok(View { path: json.path().to_owned(), stride, length, offset, buffer, decoded })
    }

    /// The bytes of a view, or why there are none.
    pub fn bytes(&self, view: usize) -> std::result::Result<&[u8], String> {
        let View { buffer, offset, length, decoded, .. } = &self.views[view];
        if let Some(decoded) = decoded {
            return Ok(decoded);
        }
        // `view` has checked that the range fits.
        self.buffers[*buffer]
            .bytes()
            .map(|bytes| &bytes[*offset as usize..(*offset + *length) as usize])
    }
}

/// Reads buffers, each file once.
struct Reader<'r, 'a> {
    container: &'a Container,
    folder: &'r Path,
    files: HashMap<PathBuf, Arc<Vec<u8>>>,
    budget: &'r mut Budget,
    warnings: &'r mut Vec<String>,
}

impl<'a> Reader<'_, 'a> {
    fn buffer(&mut self, json: &Json, index: usize) -> Parsed<Buffer<'a>> {
        let byte_length = json.need_positive("byteLength")?;
        let data = match json.string("uri")? {
            None if meshopt::is_fallback(json)? => {
                Data::Absent("it is a placeholder for compressed data".into())
            }
            None if index == 0 && self.container.is_glb => self.chunk(json, byte_length)?,
            None => Data::Absent("it has no uri".into()),
            Some(uri) => self.external(json, uri)?,
        };
        let buffer = Buffer { path: json.path().to_owned(), byte_length, data };
        match buffer.bytes().map(<[u8]>::len) {
            Ok(length) if (length as u64) < byte_length => {
                let what = format!("{byte_length} bytes are declared, and only {length} are there");
                Err(json.fault_at("byteLength", what))
            }
            _ => Ok(buffer),
        }
    }

    fn chunk(&mut self, json: &Json, byte_length: u64) -> Parsed<Data<'a>> {
        let missing = "it has no uri and so stands for the GLB's binary chunk, which is missing";
        let chunk = self.container.bin().ok_or_else(|| json.fault(missing))?;
        if chunk.len() as u64 > byte_length.saturating_add(3) {
            self.warnings
                .push(format!("the GLB's binary chunk is longer than {} declares", json.path()));
        }
        Ok(Data::Chunk(chunk))
    }

    fn external(&mut self, json: &Json, uri: &str) -> Parsed<Data<'a>> {
        let at = json.path_of("uri");
        match uri::resolve(uri, &at, self.folder)? {
            Target::Data { media_type, bytes } => {
                if !["", "application/octet-stream", "application/gltf-buffer"]
                    .contains(&media_type.as_str())
                {
                    let wanted = "application/octet-stream or application/gltf-buffer";
                    let what = format!(
                        "a buffer's data URI must be of type {wanted}, not {}",
                        quote(&media_type)
                    );
                    return Err(Fault::new(at, what));
                }
                Ok(Data::Own(Arc::new(bytes)))
            }
            Target::File(file) => {
                if let Some(bytes) = self.files.get(&file) {
                    return Ok(Data::Own(bytes.clone()));
                }
                let bytes = Arc::new(uri::read(&file, &at, u64::MAX)?);
                self.budget.feed(bytes.len() as u64);
                self.files.insert(file, bytes.clone());
                Ok(Data::Own(bytes))
            }
            Target::Absolute => {
                let why = format!(
                    "its uri {} is not relative to the scene file: only such files are read, so copy the file there",
                    quote(uri)
                );
                self.warnings.push(format!("{} is not read: {why}", json.path()));
                Ok(Data::Absent(why))
            }
        }
    }
}
