//! References to data outside the document: data URIs and files beside it.

use super::fault::{Fault, Parsed, quote};
use data_url::DataUrl;
use percent_encoding::percent_decode_str;
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
        return data(uri).map_err(|what| {
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
    let decoded = match percent_decode_str(uri).decode_utf8() {
        Ok(decoded) => decoded.into_owned(),
        Err(_) if folder.join(uri).is_file() => uri.to_owned(),
        Err(_) => {
            let what = format!("the URI {} is invalid: its encoding is not UTF-8", quote(uri));
            return Err(Fault::new(at, what));
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
    let file = crate::fsutil::open(path).map_err(|e| Fault::new(at, format!("cannot read {e}")))?;
    file.take(limit).read_to_end(&mut bytes).map_err(|e| fault(e.to_string()))?;
    Ok(bytes)
}

/// Reads a data URI.
fn data(uri: &str) -> std::result::Result<Target, String> {
    let (head, body) = uri.split_once(',').ok_or("it has no comma")?;
    let mut parts = head[5..].split(';');
    let media_type = parts.next().unwrap_or("").trim().to_ascii_lowercase();
    if !media_type.is_empty() && !media_type.contains('/') {
        return Err(format!("{} is no media type", quote(&media_type)));
    }
    // The crate reads as leniently as browsers do.
    let mut strange = parts.filter(|p| !p.eq_ignore_ascii_case("base64") && p.find('=') < Some(1));
    if let Some(part) = strange.next() {
        return Err(format!("{} is no parameter", quote(part)));
    }
    // Some exporters write base64 in the alphabet that is safe in URLs.
    let base64 = head.to_ascii_lowercase().ends_with(";base64");
    let standard = (base64 && body.contains(['-', '_']))
        .then(|| format!("{head},{}", body.replace('-', "+").replace('_', "/")));
    let url = DataUrl::process(standard.as_deref().unwrap_or(uri)).map_err(|e| e.to_string())?;
    let (bytes, _) = url.decode_to_vec().map_err(|e| format!("its base64 is invalid: {e}"))?;
    Ok(Target::Data { media_type, bytes })
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
        assert_eq!(bytes("data:a/b;base64,-_-_"), Some(vec![0xfb, 0xff, 0xbf]));
        assert_eq!(bytes("DATA:application/gltf-buffer,a%20b"), Some(b"a b".to_vec()));
        for broken in ["data:", "data:a/b;base64,`", "data:a/b;base64,A", "data:a/b;base64,A==="] {
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
