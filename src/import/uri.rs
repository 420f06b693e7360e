//! References to data outside the document: data URIs and files beside it.

use super::json::{Fault, Parsed, quote};
use std::io::Read;
use std::path::{Path, PathBuf};

/// What a URI refers to.
#[derive(Debug, PartialEq)]
pub(super) enum Target {
    /// The bytes themselves, with the media type that the URI declares (lower case, maybe empty).
    Data {
        /// Media type.
        media_type: String,
        /// The bytes.
        bytes: Vec<u8>,
    },
    /// A file, by its path.
    File(PathBuf),
    /// An absolute URI with this scheme, or an absolute path; we read neither.
    Absolute,
}

/// Resolves `uri`, which stands at the JSON path `at`, against the folder of the scene file.
pub(super) fn resolve(uri: &str, at: &str, folder: &Path) -> Parsed<Target> {
    if uri.get(..5).is_some_and(|prefix| prefix.eq_ignore_ascii_case("data:")) {
        return data(&uri[5..]).map_err(|what| {
            Fault::new(at, format!("the data URI {} is broken: {what}", quote(uri)))
        });
    }
    if uri.is_empty() {
        return Err(Fault::new(at, "the URI is empty"));
    }
    if uri.starts_with(['/', '\\']) {
        return Ok(Target::Absolute);
    }
    if let Some(colon) = uri.find([':', '/', '?', '#']).filter(|i| uri.as_bytes()[*i] == b':') {
        let scheme = &uri[..colon];
        let valid = scheme.starts_with(|c: char| c.is_ascii_alphabetic())
            && scheme.bytes().all(|c| c.is_ascii_alphanumeric() || b"+-.".contains(&c));
        if !valid {
            return Err(Fault::new(
                at,
                format!("the URI {} is invalid: {} is no scheme", quote(uri), quote(scheme)),
            ));
        }
        return Ok(Target::Absolute);
    }
    Ok(Target::File(file(uri, at, folder)?))
}

/// The file that a relative reference names: percent-decoded as the specification says, or as it
/// stands where an exporter forgot to encode.
fn file(uri: &str, at: &str, folder: &Path) -> Parsed<PathBuf> {
    let decoded = percent_decode(uri.as_bytes()).and_then(|bytes| {
        String::from_utf8(bytes).map_err(|_| "its percent-encoding is not UTF-8".to_owned())
    });
    let decoded = match decoded {
        Ok(decoded) => decoded,
        Err(_) if folder.join(uri).is_file() => uri.to_owned(),
        Err(what) => {
            return Err(Fault::new(at, format!("the URI {} is invalid: {what}", quote(uri))));
        }
    };
    if decoded.contains('\0') || Path::new(&decoded).is_absolute() {
        return Err(Fault::new(at, format!("the URI {} is not a relative path", quote(uri))));
    }
    let candidates = [decoded.clone(), uri.to_owned(), decoded.replace('\\', "/")];
    let found = candidates.iter().map(|name| folder.join(name)).find(|path| path.is_file());
    Ok(found.unwrap_or_else(|| folder.join(decoded)))
}

/// Reads at most `limit` bytes of the file that the URI at the JSON path `at` names.
pub(super) fn read(path: &Path, at: &str, limit: u64) -> Parsed<Vec<u8>> {
    let fault = |what: String| Fault::new(at, format!("cannot read {}: {what}", path.display()));
    let metadata = std::fs::metadata(path).map_err(|e| fault(e.to_string()))?;
    if !metadata.is_file() {
        return Err(fault("it is not a regular file".into()));
    }
    let mut bytes = Vec::new();
    let file = std::fs::File::open(path).map_err(|e| fault(e.to_string()))?;
    file.take(limit).read_to_end(&mut bytes).map_err(|e| fault(e.to_string()))?;
    Ok(bytes)
}

/// Reads what follows `data:`.
fn data(rest: &str) -> std::result::Result<Target, String> {
    let (head, body) = rest.split_once(',').ok_or("it has no comma")?;
    let mut parts = head.split(';');
    let media_type = parts.next().unwrap_or("").trim().to_ascii_lowercase();
    if !media_type.is_empty() && !media_type.contains('/') {
        return Err(format!("{} is no media type", quote(&media_type)));
    }
    let mut base64 = false;
    for part in parts {
        match part.split_once('=') {
            Some((name, _)) if !name.is_empty() => {}
            None if part.eq_ignore_ascii_case("base64") => base64 = true,
            _ => return Err(format!("{} is no parameter", quote(part))),
        }
    }
    let body = if body.contains('%') || !base64 {
        percent_decode(body.as_bytes())?
    } else {
        body.as_bytes().to_vec()
    };
    Ok(Target::Data { media_type, bytes: if base64 { base64_decode(&body)? } else { body } })
}

/// Undoes percent-encoding.
fn percent_decode(text: &[u8]) -> std::result::Result<Vec<u8>, String> {
    let digit = |i: usize| text.get(i).and_then(|c| (*c as char).to_digit(16));
    let mut out = Vec::with_capacity(text.len());
    let mut i = 0;
    while i < text.len() {
        if text[i] == b'%' {
            let (Some(high), Some(low)) = (digit(i + 1), digit(i + 2)) else {
                return Err("a percent sign is not followed by two hexadecimal digits".into());
            };
            out.push((high * 16 + low) as u8);
            i += 3;
        } else {
            out.push(text[i]);
            i += 1;
        }
    }
    Ok(out)
}

/// Decodes base64 (RFC 4648, standard or URL-safe alphabet); padding may be missing, but not be
/// followed by data.
fn base64_decode(text: &[u8]) -> std::result::Result<Vec<u8>, String> {
    let trimmed = text.iter().rposition(|c| *c != b'=').map_or(0, |last| last + 1);
    if text.len() - trimmed > 2 || trimmed % 4 == 1 {
        return Err("its base64 has an impossible length".into());
    }
    let mut out = Vec::with_capacity(trimmed / 4 * 3 + 2);
    let (mut bits, mut count) = (0u32, 0);
    for (i, c) in text[..trimmed].iter().enumerate() {
        let value = match c {
            b'A'..=b'Z' => c - b'A',
            b'a'..=b'z' => c - b'a' + 26,
            b'0'..=b'9' => c - b'0' + 52,
            b'+' | b'-' => 62,
            b'/' | b'_' => 63,
            _ => return Err(format!("character {} of its base64 is invalid", i + 1)),
        };
        bits = bits << 6 | u32::from(value);
        count += 6;
        if count >= 8 {
            count -= 8;
            out.push((bits >> count) as u8);
            bits &= (1 << count) - 1;
        }
    }
    Ok(out)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn bytes(uri: &str) -> Option<Vec<u8>> {
        match resolve(uri, "/x", Path::new(".")) {
            Ok(Target::Data { bytes, .. }) => Some(bytes),
            _ => None,
        }
    }

    #[test]
    fn data_uris() {
        assert_eq!(bytes("data:application/octet-stream;base64,AA=="), Some(vec![0]));
        assert_eq!(bytes("data:application/octet-stream;base64,AAECAw"), Some(vec![0, 1, 2, 3]));
        assert_eq!(bytes("data:;charset=x;base64,AP%2F%2F"), Some(vec![0, 255, 255]));
        assert_eq!(bytes("DATA:application/gltf-buffer,a%20b"), Some(b"a b".to_vec()));
        for broken in [
            "data:",
            "data:a/b;;base64,AA==",
            "data:a/b;base64,`",
            "data:a/b;base64,A",
            "data:a/b;base64,A===",
            "data:a/b,%4",
        ] {
            assert!(resolve(broken, "/x", Path::new(".")).is_err(), "{broken}");
        }
    }

    #[test]
    fn relative_references_are_decoded_and_absolute_ones_refused() {
        let dir = tempfile::tempdir().unwrap();
        std::fs::write(dir.path().join("a b%.bin"), b"x").unwrap();
        let file = Target::File(dir.path().join("a b%.bin"));
        for uri in ["a%20b%25.bin", "a b%.bin", "./a%20b%25.bin"] {
            let found = resolve(uri, "/x", dir.path()).unwrap();
            assert!(
                found == file || matches!(&found, Target::File(p) if p.is_file()),
                "{uri}: {found:?}"
            );
        }
        for uri in [
            "http://example.com/a",
            "file:///etc/passwd",
            "/etc/passwd",
            "C:\\a.bin",
            "\\\\host\\a",
        ] {
            assert_eq!(resolve(uri, "/x", dir.path()).unwrap(), Target::Absolute, "{uri}");
        }
        for uri in ["", ":", "1x:y", "%2Fetc%2Fpasswd", "a%00b"] {
            assert!(resolve(uri, "/x", dir.path()).is_err(), "{uri}");
        }
    }

    #[test]
    fn only_regular_files_are_read() {
        let dir = tempfile::tempdir().unwrap();
        assert!(read(dir.path(), "/x", 10).unwrap_err().what.contains("regular"));
        std::fs::write(dir.path().join("a"), b"0123456789").unwrap();
        assert_eq!(read(&dir.path().join("a"), "/x", 4).unwrap(), b"0123");
    }
}
