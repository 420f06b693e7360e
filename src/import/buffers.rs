//! Buffers and buffer views: where the bytes of accessors and images come from.

use super::budget::Budget;
use super::container::Container;
use super::json::{Fault, Json, Parsed, quote};
use super::meshopt;
use super::uri::{self, Target};
use std::borrow::Cow;
use std::path::Path;

/// Buffer views that hold vertex indices carry this target.
const ELEMENT_ARRAY_BUFFER: u64 = 34963;

enum Data<'a> {
    Here(Cow<'a, [u8]>),
    /// Not to be had; says why. An error only where something needs the bytes.
    Absent(String),
}

struct Buffer<'a> {
    path: String,
    byte_length: u64,
    data: Data<'a>,
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
        for (i, json) in root.entities("buffers")?.iter().enumerate() {
            let buffer = buffer(json, i, container, folder, warnings)?;
            if let Data::Here(bytes) = &buffer.data {
                budget.feed(bytes.len() as u64);
            }
            buffers.push(buffer);
        }
        let mut this = Self { buffers, views: Vec::new() };
        for json in root.entities("bufferViews")? {
            let view = this.view(&json, budget)?;
            this.views.push(view);
        }
        Ok(this)
    }

    /// The bytes `offset..offset + length` of a buffer; `at` is the JSON path of who asks.
    fn slice(&self, buffer: usize, offset: u64, length: u64, at: &Json) -> Parsed<Option<&[u8]>> {
        let Buffer { byte_length, data, path } = &self.buffers[buffer];
        let end = offset.checked_add(length).filter(|end| end <= byte_length).ok_or_else(|| {
            at.fault(format!("its {length} bytes from {offset} on do not fit the {byte_length} bytes of {path}"))
        })?;
        Ok(match data {
            Data::Here(bytes) => Some(&bytes[offset as usize..end as usize]),
            Data::Absent(_) => None,
        })
    }

    fn view(&self, json: &Json, budget: &mut Budget) -> Parsed<View> {
        let buffer = json.need_index("buffer", "buffers", self.buffers.len())?;
        let length = json.need_positive("byteLength")?;
        let offset = json.unsigned("byteOffset")?.unwrap_or(0);
        let stride = json.unsigned("byteStride")?;
        let target = json.unsigned("target")?;
        self.slice(buffer, offset, length, json)?;
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
                let source = self.slice(compressed.buffer, compressed.offset, compressed.length, &compressed.json)?;
                let source = source.ok_or_else(|| compressed.json.fault(self.absence(compressed.buffer)))?;
                Some(compressed.decode(source, length, budget)?)
            }
        };
        Ok(View { path: json.path().to_owned(), stride, length, offset, buffer, decoded })
    }

    fn absence(&self, buffer: usize) -> String {
        let Buffer { path, data, .. } = &self.buffers[buffer];
        match data {
            Data::Here(_) => String::new(),
            Data::Absent(why) => format!("needs the bytes of {path}, and {why}"),
        }
    }

    /// The bytes of a view, or why there are none.
    pub fn bytes(&self, view: usize) -> std::result::Result<&[u8], String> {
        let View { buffer, offset, length, decoded, .. } = &self.views[view];
        if let Some(decoded) = decoded {
            return Ok(decoded);
        }
        match &self.buffers[*buffer].data {
            // `view` has checked that the range fits.
            Data::Here(bytes) => Ok(&bytes[*offset as usize..(*offset + *length) as usize]),
            Data::Absent(_) => Err(self.absence(*buffer)),
        }
    }
}

fn buffer<'a>(
    json: &Json,
    index: usize,
    container: &'a Container,
    folder: &Path,
    warnings: &mut Vec<String>,
) -> Parsed<Buffer<'a>> {
    let byte_length = json.need_positive("byteLength")?;
    let path = json.path().to_owned();
    let too_short =
        |actual: usize| json.fault_at("byteLength", format!("{byte_length} bytes are declared, and only {actual} are there"));
    let data = match json.string("uri")? {
        None if meshopt::is_fallback(json)? => Data::Absent("it is a placeholder for compressed data".into()),
        None if index == 0 && container.is_glb => {
            let chunk = container
                .bin()
                .ok_or_else(|| json.fault("it has no uri and so stands for the GLB's binary chunk, which is missing"))?;
            if (chunk.len() as u64) < byte_length {
                return Err(too_short(chunk.len()));
            }
            if chunk.len() as u64 - byte_length > 3 {
                warnings.push(format!("the GLB's binary chunk is longer than {path} declares"));
            }
            Data::Here(Cow::Borrowed(&chunk[..byte_length as usize]))
        }
        None => Data::Absent("it has no uri".into()),
        Some(uri) => {
            let at = json.path_of("uri");
            match uri::resolve(uri, &at, folder)? {
                Target::Data { media_type, bytes } => {
                    if !["", "application/octet-stream", "application/gltf-buffer"].contains(&media_type.as_str()) {
                        let media_type = quote(&media_type);
                        return Err(Fault::new(
                            at,
                            format!(
                                "a buffer's data URI must be of type application/octet-stream or application/gltf-buffer, \
                                 not {media_type}"
                            ),
                        ));
                    }
                    if (bytes.len() as u64) < byte_length {
                        return Err(too_short(bytes.len()));
                    }
                    Data::Here(Cow::Owned(bytes))
                }
                Target::File(file) => {
                    let bytes = uri::read(&file, &at, byte_length)?;
                    if (bytes.len() as u64) < byte_length {
                        return Err(too_short(bytes.len()));
                    }
                    Data::Here(Cow::Owned(bytes))
                }
                Target::Absolute => {
                    let why = format!(
                        "its uri {} is not relative to the scene file: only such files are read, so copy the file there",
                        quote(uri)
                    );
                    warnings.push(format!("{path} is not read: {why}"));
                    Data::Absent(why)
                }
            }
        }
    };
    Ok(Buffer { path, byte_length, data })
}
