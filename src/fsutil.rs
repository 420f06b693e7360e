//! Files: atomic writing.

use crate::error::{Error, Result};
use std::io::Write;
use std::path::{Path, PathBuf};

/// The folder a file named `path` would lie in.
fn folder(path: &Path) -> &Path {
    path.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."))
}

/// Runs `write` on the path of a temporary file beside `path`, syncs it and renames it to `path`,
/// so that no reader and no failure ever sees a partial file under the final name.
///
/// # Errors
/// What `write` returns, or [`Error::Io`] naming `path`; the temporary file is removed.
pub fn write_atomically_with(path: &Path, write: impl FnOnce(&Path) -> Result<()>) -> Result<()> {
    let file = tempfile::Builder::new()
        .prefix(".lumicache-")
        .suffix(
            path.extension()
                .map_or(String::new(), |e| format!(".{}", e.to_string_lossy()))
                .as_str(),
        )
        .tempfile_in(folder(path))
        .map_err(Error::io(path))?;
    write(file.path())?;
    set_default_mode(file.path()).map_err(Error::io(path))?;
    std::fs::File::open(file.path()).and_then(|f| f.sync_all()).map_err(Error::io(path))?;
    file.persist(path).map_err(|e| Error::Io { file: path.to_owned(), source: e.error })?;
    Ok(())
}

/// Writes `bytes` to `path` through a temporary file and a rename.
///
/// # Errors
/// [`Error::Io`] naming `path`.
pub fn write_atomically(path: &Path, bytes: &[u8]) -> Result<()> {
    write_atomically_with(path, |temporary| {
        std::fs::File::create(temporary)
            .and_then(|mut f| f.write_all(bytes))
            .map_err(Error::io(path))
    })
}

/// Fails, without leaving anything behind, when a file named `path` could not be written.
///
/// # Errors
/// [`Error::Io`] naming `path`.
pub fn check_writable(path: &Path) -> Result<()> {
    if path.is_dir() {
        return Err(Error::Io {
            file: path.to_owned(),
            source: std::io::ErrorKind::IsADirectory.into(),
        });
    }
    tempfile::Builder::new()
        .prefix(".lumicache-")
        .tempfile_in(folder(path))
        .map_err(Error::io(path))?;
    Ok(())
}

/// Fails when two of `outputs`, whose folders exist, are one file, or one of them is `input`: the
/// later write would lose what was there.
///
/// # Errors
/// [`Error::InvalidArgument`] naming the file.
pub fn check_distinct(input: &Path, outputs: &[PathBuf]) -> Result<()> {
    // The file need not exist yet, but its folder does.
    let place =
        |path: &Path| Some((folder(path).canonicalize().ok()?, path.file_name()?.to_owned()));
    let mut known = vec![place(input)];
    for path in outputs {
        let place = place(path);
        if place.is_some() && known.contains(&place) {
            return Err(Error::InvalidArgument(format!(
                "{}: one file cannot be two of the scene and the outputs",
                path.display()
            )));
        }
        known.push(place);
    }
    Ok(())
}

/// Temporary files are private; an output file gets the permissions that the user's umask gives any
/// new file.
#[cfg(unix)]
fn set_default_mode(path: &Path) -> std::io::Result<()> {
    use std::os::unix::fs::PermissionsExt;
    let probe = path.with_extension("mode");
    let mode =
        std::fs::File::create(&probe).and_then(|f| f.metadata()).map(|m| m.permissions().mode());
    // The probe is ours alone: nothing is lost when it is already gone.
    let _ = std::fs::remove_file(&probe);
    std::fs::set_permissions(path, std::fs::Permissions::from_mode(mode?))
}

#[cfg(not(unix))]
fn set_default_mode(_: &Path) -> std::io::Result<()> {
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_failed_write_leaves_the_old_file_and_no_litter() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("a.txt");
        write_atomically(&path, b"old").unwrap();
        let failed = write_atomically_with(&path, |_| Err(Error::Cancelled));
        assert!(matches!(failed, Err(Error::Cancelled)));
        assert_eq!(std::fs::read(&path).unwrap(), b"old");
        assert_eq!(std::fs::read_dir(dir.path()).unwrap().count(), 1);
    }

    #[test]
    fn an_unwritable_place_is_known_beforehand() {
        let dir = tempfile::tempdir().unwrap();
        assert!(check_writable(&dir.path().join("a.exr")).is_ok());
        assert!(check_writable(&dir.path().join("missing/a.exr")).is_err());
        assert!(check_writable(dir.path()).is_err());
    }
}
