//! Reading: regular files only, and which of them were read.

use crate::error::{Error, Result};
use nix::libc::O_NONBLOCK;
use std::collections::BTreeSet;
use std::fs::{File, Metadata, OpenOptions};
use std::io::Read;
use std::os::unix::fs::{MetadataExt, OpenOptionsExt};
use std::path::Path;
use std::sync::{Mutex, PoisonError};

/// Device and number of every file that was read; `None` while nobody wants to know.
static READ: Mutex<Option<BTreeSet<[u64; 2]>>> = Mutex::new(None);

/// From now on no file that [`open`] has opened can be written: what the user gave as input is
/// never lost to an output. For programs that read their inputs once; a library must not call it.
pub fn remember_what_is_read() {
    READ.lock().unwrap_or_else(PoisonError::into_inner).get_or_insert_default();
}

pub(super) fn identity(file: &Metadata) -> [u64; 2] {
    [file.dev(), file.ino()]
}

/// True for a file that was read since somebody wanted to know.
pub(super) fn was_read(file: &Metadata) -> bool {
    let read = READ.lock().unwrap_or_else(PoisonError::into_inner);
    read.as_ref().is_some_and(|read| read.contains(&identity(file)))
}

/// Opens the file at `path` to read it. What is no regular file is refused before it is opened: a
/// FIFO would wait for its writer, and a device might never end.
///
/// # Errors
/// [`Error::Io`] naming `path`.
pub fn open(path: &Path) -> Result<File> {
    let regular = |found: Metadata| match found.is_file() {
        true => Ok(found),
        false => Err(std::io::Error::other("it is not a regular file")),
    };
    let open = || {
        regular(std::fs::metadata(path)?)?;
        // Something else may have taken its place since.
        let file = OpenOptions::new().read(true).custom_flags(O_NONBLOCK).open(path)?;
        let found = regular(file.metadata()?)?;
        if let Some(read) = READ.lock().unwrap_or_else(PoisonError::into_inner).as_mut() {
            read.insert(identity(&found));
        }
        Ok(file)
    };
    open().map_err(Error::io(path))
}

/// The content of the file at `path`.
///
/// # Errors
/// Those of [`open`]; [`Error::OutOfMemory`] where the content does not fit.
pub fn read(path: &Path) -> Result<Vec<u8>> {
    let mut file = open(path)?;
    let length = file.metadata().map_err(Error::io(path))?.len();
    let mut bytes = Vec::new();
    let room = usize::try_from(length).ok().and_then(|n| bytes.try_reserve_exact(n).ok());
    room.ok_or_else(|| Error::memory(path.display(), length))?;
    file.read_to_end(&mut bytes).map_err(Error::io(path))?;
    Ok(bytes)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_no_regular_file_is_refused_at_once() {
        let folder = tempfile::tempdir().unwrap();
        let fifo = folder.path().join("fifo");
        nix::unistd::mkfifo(&fifo, nix::sys::stat::Mode::S_IRWXU).unwrap();
        for path in [&fifo, Path::new("/dev/zero"), folder.path()] {
            let error = read(path).unwrap_err().to_string();
            assert_eq!(error, format!("{}: it is not a regular file", path.display()));
        }
        std::fs::write(folder.path().join("a"), "content").unwrap();
        assert_eq!(read(&folder.path().join("a")).unwrap(), b"content");
    }

    #[test]
    fn a_file_too_large_for_memory_is_an_error() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("sparse");
        // More than any machine can address, less than a file system refuses.
        let sparse = File::create(&path).unwrap();
        if sparse.set_len(1 << 43).is_ok() {
            assert!(
                matches!(read(&path), Err(Error::OutOfMemory(what)) if what.contains("sparse"))
            );
        }
    }
}
