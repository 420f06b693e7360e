//! References to data outside the document: data URIs and files.
//!
//! One rule holds for every file that a scene names, whatever for: it lies inside the folder of the
//! scene file, after links are followed, unless the caller allows others.

use super::budget::Budget;
use super::fault::{Fault, Parsed, Why, quote};
use data_url::DataUrl;
use percent_encoding::percent_decode_str;
use std::io::Read;
use std::path::{Component, Path, PathBuf};

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
    /// A file that may be read, by its path.
    File(PathBuf),
    /// An absolute URI with another scheme than that of files.
    Absolute,
}

/// The folder of a scene file.
#[derive(Debug)]
pub(super) struct Folder {
    path: PathBuf,
    /// Files elsewhere may be read too.
    outside: bool,
}

impl Folder {
    /// The folder of the file at `path`; `outside` allows files elsewhere.
    pub fn of(path: &Path, outside: bool) -> Self {
        let folder = path.parent().filter(|p| !p.as_os_str().is_empty());
        Self { path: folder.unwrap_or(Path::new(".")).to_owned(), outside }
    }

    /// As [`Folder::file`], for a path that may begin with the folder's.
    pub fn file_at(&self, path: &Path) -> Option<PathBuf> {
        self.file(&path.strip_prefix(&self.path).unwrap_or(path).to_string_lossy())
    }

    /// The file called `name`, an absolute path or one from here; `None` if it may not be read.
    pub fn file(&self, name: &str) -> Option<PathBuf> {
        let file = self.path.join(name);
        let inside = match (file.canonicalize(), self.path.canonicalize()) {
            (Ok(file), Ok(folder)) => file.starts_with(folder),
            // There is nothing to read, and nothing is told about places elsewhere.
            _ => {
                let mut depth = 0;
                Path::new(name).components().all(|part| {
                    depth += match part {
                        Component::Normal(_) => 1,
                        Component::CurDir => 0,
                        _ => -1,
                    };
                    depth >= 0
                })
            }
        };
        (inside || self.outside).then_some(file)
    }
}

/// Why [`Folder::file`] has no file.
pub(super) const OUTSIDE: &str = "lies outside the scene's folder, and only files inside it are \
    read: copy the file there, or allow others by --allow-outside";

/// Resolves `uri`, which stands at the JSON path `at`, against the folder of the scene file.
pub(super) fn resolve(uri: &str, at: &str, folder: &Folder) -> Parsed<Target> {
    if uri.get(..5).is_some_and(|prefix| prefix.eq_ignore_ascii_case("data:")) {
        return data(uri).map_err(|what| {
            Fault::new(at, format!("the data URI {} is broken: {what}", quote(uri)))
        });
    }
    if uri.is_empty() {
        return Err(Fault::new(at, "the URI is empty"));
    }
    if uri.starts_with('\\') {
        return Ok(Target::Absolute);
    }
    let mut name = uri;
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
        if !scheme.eq_ignore_ascii_case("file") {
            return Ok(Target::Absolute);
        }
        let path = &uri[colon + 1..];
        let host =
            path.strip_prefix("//").map(|rest| rest.strip_prefix("localhost").unwrap_or(rest));
        name = host.unwrap_or(path);
        if !name.starts_with('/') {
            return Ok(Target::Absolute);
        }
    }
    Ok(Target::File(file(name, at, folder)?))
}

/// The file that a reference names: percent-decoded as the specification says, or as it stands
/// where an exporter forgot to encode.
fn file(uri: &str, at: &str, folder: &Folder) -> Parsed<PathBuf> {
    let decoded = match percent_decode_str(uri).decode_utf8() {
        Ok(decoded) => decoded.into_owned(),
        Err(_) if folder.file(uri).is_some_and(|path| path.is_file()) => uri.to_owned(),
        Err(_) => {
            let what = format!("the URI {} is invalid: its encoding is not UTF-8", quote(uri));
            return Err(Fault::new(at, what));
        }
    };
    if decoded.contains('\0') {
        return Err(Fault::new(at, format!("the URI {} is no path", quote(uri))));
    }
    let candidates = [decoded.clone(), uri.to_owned(), decoded.replace('\\', "/")];
    let mut files = candidates.iter().filter_map(|name| folder.file(name));
    if let Some(found) = files.find(|path| path.is_file()).or_else(|| folder.file(&decoded)) {
        return Ok(found);
    }
    let what = format!("the file {} {OUTSIDE}", quote(uri));
    Err(Fault { why: Why::Forbidden, ..Fault::new(at, what) })
}

/// Reads at most `limit` bytes of the file that the URI at the JSON path `at` names.
pub(super) fn read(path: &Path, at: &str, limit: u64, budget: &mut Budget) -> Parsed<Vec<u8>> {
    let fault = |what: String| {
        Fault::new(at, format!("cannot read {}: {what}", quote(&path.to_string_lossy())))
    };
    let metadata = std::fs::metadata(path).map_err(|e| fault(e.to_string()))?;
    if !metadata.is_file() {
        return Err(fault("it is not a regular file".into()));
    }
    let limit = limit.min(metadata.len());
    budget.read(limit, at)?;
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
        match resolve(uri, "/x", &Folder::of(Path::new("x"), false)) {
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
            assert!(resolve(broken, "/x", &Folder::of(Path::new("x"), false)).is_err(), "{broken}");
        }
    }

    #[test]
    fn files_inside_the_folder_are_found_and_no_others() {
        let dir = tempfile::tempdir().unwrap();
        let scene = dir.path().join("scene/a.gltf");
        std::fs::create_dir_all(dir.path().join("scene/deep")).unwrap();
        std::fs::write(dir.path().join("scene/a b%.bin"), b"x").unwrap();
        std::fs::write(dir.path().join("secret"), b"x").unwrap();
        std::os::unix::fs::symlink("../secret", dir.path().join("scene/link")).unwrap();
        std::os::unix::fs::symlink("a b%.bin", dir.path().join("scene/good")).unwrap();
        std::os::unix::fs::symlink("/", dir.path().join("scene/root")).unwrap();
        let (strict, lax) = (Folder::of(&scene, false), Folder::of(&scene, true));
        let own = format!("file://{}/scene/good", dir.path().display());
        for uri in [
            "a%20b%25.bin",
            "a b%.bin",
            "./a%20b%25.bin",
            "deep/../good",
            "../scene/good",
            own.as_str(),
        ] {
            let found = resolve(uri, "/x", &strict).unwrap();
            assert!(matches!(&found, Target::File(p) if p.is_file()), "{uri}: {found:?}");
        }
        let absolute = dir.path().join("secret").display().to_string();
        for uri in [
            "../secret",
            "%2e%2e/secret",
            "%2E%2E%2Fsecret",
            "deep/../../secret",
            "link",
            "root/etc/passwd",
            "/etc/passwd",
            "%2Fetc%2Fpasswd",
            "file:///etc/passwd",
            "../nothing",
            "/nothing/at/all",
            absolute.as_str(),
        ] {
            let fault = resolve(uri, "/x", &strict).unwrap_err();
            assert_eq!(fault.why, Why::Forbidden, "{uri}: {fault:?}");
            assert!(matches!(resolve(uri, "/x", &lax).unwrap(), Target::File(_)), "{uri}");
        }
        for uri in ["http://example.com/a", "C:\\a.bin", "\\\\host\\a", "file:a"] {
            assert_eq!(resolve(uri, "/x", &lax).unwrap(), Target::Absolute, "{uri}");
        }
        for uri in ["", ":", "1x:y", "a%00b", "a%FF"] {
            assert!(resolve(uri, "/x", &lax).is_err(), "{uri}");
        }
    }

    #[test]
    fn only_regular_files_are_read() {
        let dir = tempfile::tempdir().unwrap();
        let mut budget = Budget::new(Some(10));
        assert!(read(dir.path(), "/x", 10, &mut budget).unwrap_err().what.contains("regular"));
        std::fs::write(dir.path().join("a"), b"0123456789").unwrap();
        assert_eq!(read(&dir.path().join("a"), "/x", 4, &mut budget).unwrap(), b"0123");
        assert!(read(&dir.path().join("a"), "/x", 10, &mut budget).is_err());
    }
}
