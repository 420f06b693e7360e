//! The file around a document: plain JSON (.gltf) or the binary container (.glb) [glTF20, 4].

use super::fault::{Fault, Parsed};
use super::warnings::Warnings;
use std::path::Path;

const MAGIC: &[u8] = b"glTF";
const JSON: u32 = u32::from_le_bytes(*b"JSON");
const BIN: u32 = u32::from_le_bytes(*b"BIN\0");

/// A scene file taken apart.
#[derive(Debug)]
pub(super) struct Container<'a> {
    /// The text of the document.
    pub json: &'a [u8],
    /// The binary chunk.
    pub bin: Option<&'a [u8]>,
    /// True for a binary container.
    pub is_glb: bool,
}

/// Takes the bytes of a scene file apart; `path` only tells by its extension what the file claims
/// to be.
pub(super) fn split<'a>(
    bytes: &'a [u8], path: &Path, warnings: &mut Warnings,
) -> Parsed<Container<'a>> {
    if let Some(what) = foreign(&bytes[..bytes.len().min(HEAD as usize)], path) {
        return Err(Fault::unsupported("", what));
    }
    let claims_glb = path.extension().is_some_and(|e| e.eq_ignore_ascii_case("glb"));
    if claims_glb || bytes.starts_with(MAGIC) {
        return chunks(bytes, warnings).map_err(|what| Fault::new("", what));
    }
    if bytes.is_empty() {
        return Err(Fault::new("", "the file is empty"));
    }
    Ok(Container { json: bytes, bin: None, is_glb: false })
}

/// Bytes of a file that tell what it is.
pub(super) const HEAD: u64 = 512;

/// Files that people take for a scene: the bytes they begin with, the extension that they have
/// where those do not tell, and what they are.
const FOREIGN: [(&[u8], &str, &str); 22] = [
    (b"PK\x03\x04", "zip", "a ZIP archive"),
    (b"PK\x05\x06", "zip", "a ZIP archive"),
    (b"\x1f\x8b", "gz", "a gzip archive"),
    (b"\x28\xb5\x2f\xfd", "blend", "a Blender file"),
    (b"BLENDER", "blend", "a Blender file"),
    (b"Kaydara FBX Binary", "fbx", "an FBX file"),
    (b"; FBX", "fbx", "an FBX file"),
    (b"PXR-USDC", "usdc", "a USD file"),
    (b"#usda", "usda", "a USD file"),
    (b"#usda", "usd", "a USD file"),
    (b"PK\x03\x04", "usdz", "a USD file"),
    (b"mtllib ", "obj", "a Wavefront OBJ file"),
    (b"newmtl ", "mtl", "a Wavefront material file"),
    (b"ply\n", "ply", "a PLY file"),
    (b"solid ", "stl", "an STL file"),
    (b"<", "dae", "a COLLADA or another XML file"),
    (b"MM\0", "3ds", "a 3DS file"),
    (b"Ogawa", "abc", "an Alembic file"),
    (b"#INVENTOR", "iv", "an Inventor file"),
    (b"#VRML", "wrl", "a VRML file"),
    (b"\x89PNG", "png", "an image"),
    (b"\xff\xd8\xff", "jpg", "an image"),
];

/// What a file that begins with `head` is, if it is of another kind than glTF and known, and what
/// to do about it; content counts before the extension.
pub(super) fn foreign(head: &[u8], path: &Path) -> Option<String> {
    let text = head.strip_prefix(b"\xEF\xBB\xBF").unwrap_or(head).trim_ascii_start();
    if head.starts_with(MAGIC) || text.starts_with(b"{") || text.starts_with(b"[") {
        return None;
    }
    let has = |extension: &str| path.extension().is_some_and(|e| e.eq_ignore_ascii_case(extension));
    let by_content = |(magic, ..): &&(&[u8], _, _)| text.starts_with(magic);
    let by_name = |(_, extension, _): &&(_, &str, _)| has(extension);
    let both = FOREIGN.iter().filter(by_content).find(by_name);
    let found = both.or_else(|| FOREIGN.iter().find(by_content));
    let what = match found.or_else(|| FOREIGN.iter().find(by_name)) {
        Some((.., what)) => what,
        // Its statements come in any order, after comments.
        None if is_obj(text) => "a Wavefront OBJ file",
        None => return None,
    };
    let advice = if what.ends_with("archive") {
        "unpack it and give the .gltf or .glb file inside"
    } else {
        "open it in the program that made it, or in Blender, and export it as glTF 2.0 (.glb or .gltf)"
    };
    Some(format!("it is {what}, and only glTF 2.0 scenes are read: {advice}"))
}

/// True if the first lines are statements of a Wavefront OBJ file, or comments.
fn is_obj(head: &[u8]) -> bool {
    let text = String::from_utf8_lossy(head);
    let mut lines = text.lines().map(str::trim).filter(|l| !l.is_empty() && !l.starts_with('#'));
    let word = lines.next().and_then(|line| line.split_once(' ')).map_or("", |(word, _)| word);
    ["v", "vn", "vt", "f", "o", "g", "s", "usemtl", "mtllib"].contains(&word)
}

/// The first little-endian word of `bytes`, and what follows it.
fn word(bytes: &[u8]) -> Option<(u32, &[u8])> {
    bytes.split_first_chunk().map(|(word, rest)| (u32::from_le_bytes(*word), rest))
}

fn chunks<'a>(
    bytes: &'a [u8], warnings: &mut Warnings,
) -> std::result::Result<Container<'a>, String> {
    let size = bytes.len();
    let header = word(bytes).and_then(|(_, rest)| word(rest));
    let header = header.and_then(|(version, rest)| Some((version, word(rest)?.0)));
    let Some((version, length)) = header else {
        return Err(format!(
            "not a binary glTF: the file has {size} bytes, and its header alone needs 12"
        ));
    };
    if !bytes.starts_with(MAGIC) {
        return Err("not a binary glTF: the file does not begin with \"glTF\"".into());
    }
    if version != 2 {
        return Err(format!("binary glTF version {version}; only version 2 is known"));
    }
    let length = length as usize;
    if length > size {
        return Err(format!(
            "the GLB header declares {length} bytes, and the file has {size}: is it truncated?"
        ));
    }
    if length < size {
        let rest = size - length;
        warnings.push(format!("{rest} bytes after the end of the GLB container are ignored"));
    }
    let mut chunks = Vec::new();
    let mut rest = bytes.get(12..length).unwrap_or_default();
    while !rest.is_empty() {
        let number = chunks.len();
        let header = word(rest).and_then(|(size, rest)| Some((size as usize, word(rest)?)));
        let Some((size, (kind, body))) = header else {
            return Err(format!("the GLB container ends inside the header of chunk {number}"));
        };
        if size % 4 != 0 {
            return Err(format!("the length {size} of GLB chunk {number} is not a multiple of 4"));
        }
        let Some((chunk, after)) = body.split_at_checked(size) else {
            return Err(format!("GLB chunk {number} of {size} bytes does not fit the container"));
        };
        chunks.push((kind, chunk));
        rest = after;
    }
    let mut file = match chunks.first() {
        Some(&(JSON, json)) if !json.is_empty() => Container { json, bin: None, is_glb: true },
        Some((JSON, _)) => return Err("the JSON chunk of the GLB container is empty".into()),
        _ => return Err("the GLB container does not begin with a JSON chunk".into()),
    };
    for (number, (kind, chunk)) in chunks.iter().enumerate().skip(1) {
        match *kind {
            BIN if number == 1 => file.bin = Some(chunk),
            JSON | BIN => {
                return Err(format!("GLB chunk {number} has a type that may not stand there"));
            }
            _ => warnings.push(format!("GLB chunk {number} of an unknown type is ignored")),
        }
    }
    Ok(file)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn glb(chunks: &[(&[u8], &[u8])]) -> Vec<u8> {
        let mut body = Vec::new();
        for (kind, data) in chunks {
            body.extend((data.len() as u32).to_le_bytes());
            body.extend(*kind);
            body.extend(*data);
        }
        [MAGIC, &2u32.to_le_bytes(), &(12 + body.len() as u32).to_le_bytes(), &body].concat()
    }

    fn parse(bytes: &[u8]) -> Parsed<Container<'_>> {
        split(bytes, Path::new("a.glb"), &mut Warnings::default())
    }

    #[test]
    fn chunks_are_found_and_unknown_ones_skipped() {
        let bytes = glb(&[(b"JSON", b"{}  "), (b"BIN\0", b"abcd"), (b"xxxx", b"????")]);
        let file = parse(&bytes).unwrap();
        assert_eq!((file.json, file.bin, file.is_glb), (&b"{}  "[..], Some(&b"abcd"[..]), true));
        assert!(parse(&glb(&[(b"JSON", b"{}  "), (b"JSON", b"{}  ")])).is_err());
    }

    #[test]
    fn files_of_other_kinds_are_named() {
        for (head, name, what) in [
            (&b"PK\x03\x04\x14"[..], "a.gltf", "a ZIP archive"),
            (b"PK\x03\x04\x14", "a.usdz", "a USD file"),
            (b"# made by hand\n\nv 1 2 3\n", "a.gltf", "OBJ"),
            (b"o Cube\nv 1 2 3\n", "a.glb", "OBJ"),
            (b"", "a.OBJ", "OBJ"),
            (b"\x01\x02", "scene.fbx", "FBX"),
            (b"Kaydara FBX Binary  \0", "a.glb", "FBX"),
            (b"#usda 1.0\n", "a.gltf", "USD"),
            (b"PXR-USDC", "a", "USD"),
            (b"BLENDER-v402", "a.gltf", "Blender"),
            (b"<?xml version=\"1.0\"?><COLLADA>", "a.dae", "COLLADA"),
        ] {
            let text = foreign(head, Path::new(name)).expect(name);
            assert!(text.contains(what) && text.contains("glTF 2.0"), "{text}");
        }
        for (head, name) in
            [(&b"{}"[..], "a.obj"), (b"glTF", "a.fbx"), (b" \n{", "a.zip"), (b"hello", "a.gltf")]
        {
            assert_eq!(foreign(head, Path::new(name)), None, "{name}");
        }
    }

    #[test]
    fn no_prefix_of_a_container_is_accepted() {
        let whole = glb(&[(b"JSON", b"{}  "), (b"BIN\0", b"abcd")]);
        for n in 0..whole.len() {
            assert!(parse(&whole[..n]).is_err(), "{n} bytes");
            // The same with a header that declares the shorter length.
            let mut cut = whole[..n].to_vec();
            if n >= 12 && n != 24 {
                cut[8..12].copy_from_slice(&(n as u32).to_le_bytes());
                assert!(parse(&cut).is_err(), "{n} bytes, declared");
            }
        }
    }
}
