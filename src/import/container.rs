//! The file around a document: plain JSON (.gltf) or the binary container (.glb) [glTF20, 4].

use super::json::{Fault, Parsed};
use std::ops::Range;
use std::path::Path;

const MAGIC: &[u8] = b"glTF";
const JSON_CHUNK: u32 = 0x4E4F_534A;
const BIN_CHUNK: u32 = 0x004E_4942;

/// A scene file in memory.
pub(super) struct Container {
    bytes: Vec<u8>,
    json: Range<usize>,
    bin: Option<Range<usize>>,
    /// True for a binary container.
    pub is_glb: bool,
}

impl Container {
    /// The text of the document.
    pub fn json(&self) -> &[u8] {
        &self.bytes[self.json.clone()]
    }

    /// The binary chunk.
    pub fn bin(&self) -> Option<&[u8]> {
        self.bin.clone().map(|range| &self.bytes[range])
    }

    /// Takes the bytes of a scene file apart; `path` only tells by its extension what the file
    /// claims to be.
    pub fn parse(bytes: Vec<u8>, path: &Path, warnings: &mut Vec<String>) -> Parsed<Self> {
        let claims_glb = path.extension().is_some_and(|e| e.eq_ignore_ascii_case("glb"));
        if claims_glb || bytes.starts_with(MAGIC) {
            let (json, bin) = chunks(&bytes, warnings)?;
            return Ok(Self { bytes, json, bin, is_glb: true });
        }
        if bytes.is_empty() {
            return Err(Fault::new("", "the file is empty"));
        }
        Ok(Self { json: 0..bytes.len(), bytes, bin: None, is_glb: false })
    }
}

/// The little-endian word at `offset`.
fn word(bytes: &[u8], offset: usize) -> Option<u32> {
    Some(u32::from_le_bytes(bytes.get(offset..offset.checked_add(4)?)?.try_into().ok()?))
}

/// The JSON chunk and the binary chunk of a container.
fn chunks(
    bytes: &[u8],
    warnings: &mut Vec<String>,
) -> Parsed<(Range<usize>, Option<Range<usize>>)> {
    let fault = |what: String| Err(Fault::new("", what));
    let (Some(_), Some(version), Some(declared)) = (word(bytes, 0), word(bytes, 4), word(bytes, 8))
    else {
        return fault(format!(
            "not a binary glTF: the file has {} bytes, and its header alone needs 12",
            bytes.len()
        ));
    };
    if !bytes.starts_with(MAGIC) {
        return fault("not a binary glTF: the file does not begin with \"glTF\"".into());
    }
    if version != 2 {
        return fault(format!("binary glTF version {version}; only version 2 is known"));
    }
    let length = declared as usize;
    if length < 20 {
        return fault(format!(
            "the GLB header declares a length of {length} bytes, too few for a JSON chunk"
        ));
    }
    if length > bytes.len() {
        return fault(format!(
            "the GLB header declares {length} bytes, and the file has {}: is it truncated?",
            bytes.len()
        ));
    }
    if length < bytes.len() {
        warnings.push(format!(
            "{} bytes after the end of the GLB container are ignored",
            bytes.len() - length
        ));
    }
    let (mut json, mut bin) = (None, None);
    let (mut offset, mut number) = (12, 0);
    while offset < length {
        let (Some(size), Some(kind), true) =
            (word(bytes, offset), word(bytes, offset + 4), offset + 8 <= length)
        else {
            return fault(format!("the GLB container ends inside the header of chunk {number}"));
        };
        let start = offset + 8;
        if size % 4 != 0 {
            return fault(format!(
                "the length {size} of GLB chunk {number} is not a multiple of 4"
            ));
        }
        let Some(end) = start.checked_add(size as usize).filter(|end| *end <= length) else {
            return fault(format!(
                "GLB chunk {number} of {size} bytes does not fit the container of {length} bytes"
            ));
        };
        match kind {
            JSON_CHUNK if number == 0 => {
                if size == 0 {
                    return fault("the JSON chunk of the GLB container is empty".into());
                }
                json = Some(start..end);
            }
            _ if number == 0 => {
                return fault(format!(
                    "the first GLB chunk must be JSON, and is of type {kind:#010x}"
                ));
            }
            JSON_CHUNK => return fault(format!("GLB chunk {number} is a second JSON chunk")),
            BIN_CHUNK if number == 1 => bin = Some(start..end),
            BIN_CHUNK if bin.is_some() => {
                return fault(format!("GLB chunk {number} is a second binary chunk"));
            }
            BIN_CHUNK => {
                return fault(format!("GLB chunk {number} is binary, which only chunk 1 may be"));
            }
            _ => warnings
                .push(format!("GLB chunk {number} of the unknown type {kind:#010x} is ignored")),
        }
        (offset, number) = (end, number + 1);
    }
    match json {
        Some(json) => Ok((json, bin)),
        None => fault("the GLB container has no JSON chunk".into()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn glb(chunks: &[(u32, &[u8])]) -> Vec<u8> {
        let mut body = Vec::new();
        for (kind, data) in chunks {
            body.extend((data.len() as u32).to_le_bytes());
            body.extend(kind.to_le_bytes());
            body.extend(*data);
        }
        [MAGIC, &2u32.to_le_bytes(), &(12 + body.len() as u32).to_le_bytes(), &body].concat()
    }

    fn parse(bytes: Vec<u8>) -> Parsed<Container> {
        Container::parse(bytes, Path::new("a.glb"), &mut Vec::new())
    }

    #[test]
    fn chunks_are_found_and_unknown_ones_skipped() {
        let file =
            parse(glb(&[(JSON_CHUNK, b"{}  "), (BIN_CHUNK, b"abcd"), (7, b"????")])).unwrap();
        assert_eq!(
            (file.json(), file.bin(), file.is_glb),
            (&b"{}  "[..], Some(&b"abcd"[..]), true)
        );
    }

    #[test]
    fn no_prefix_of_a_container_is_accepted() {
        let whole = glb(&[(JSON_CHUNK, b"{}  "), (BIN_CHUNK, b"abcd")]);
        for n in 0..whole.len() {
            assert!(parse(whole[..n].to_vec()).is_err(), "{n} bytes");
            // The same with a header that declares the shorter length.
            let mut cut = whole[..n].to_vec();
            if n >= 12 && n != 24 {
                cut[8..12].copy_from_slice(&(n as u32).to_le_bytes());
                assert!(parse(cut).is_err(), "{n} bytes, declared");
            }
        }
    }
}
