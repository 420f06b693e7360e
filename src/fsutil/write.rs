//! Writing: through a temporary file and a rename.
//!
//! A temporary file stands beside the output and is called `.NAME.lumicache-RANDOM.tmp`. Its writer
//! holds a lock on it. Whoever writes the same output next removes those that nobody holds: a
//! process that was killed leaves one file at most, and not for long.

use super::read::{identity, was_read};
use crate::error::{Error, Result};
use nix::errno::Errno;
use nix::fcntl::{Flock, FlockArg};
use nix::libc::{O_NOFOLLOW, O_NONBLOCK};
use std::fs::{File, Metadata, OpenOptions, Permissions};
use std::io::{self, ErrorKind, Write};
use std::os::unix::ffi::{OsStrExt, OsStringExt};
use std::os::unix::fs::{MetadataExt, OpenOptionsExt, PermissionsExt, fchown};
use std::path::{Path, PathBuf};
use tempfile::NamedTempFile;

/// How a temporary file's name ends.
const SUFFIX: &str = ".tmp";
/// So much of the output's name stands in that of the temporary file; names end at 255 bytes.
const NAME: usize = 120;
/// Symbolic links that are followed to a file that is not there, as Linux does.
const LINKS: usize = 40;
/// Another process may take a new file for a left one before it is locked. That happens once in a
/// long while, not twice in a row.
const ATTEMPTS: usize = 100;

/// The folder a file named `path` would lie in.
fn folder(path: &Path) -> &Path {
    path.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."))
}

/// Runs `write` on the path of a temporary file beside `path`, syncs it and renames it to `path`,
/// so that no reader and no failure ever sees a partial file under the final name.
///
/// Symbolic links are followed. An existing file's mode stays as it is.
///
/// # Errors
/// What `write` returns, after which nothing is left behind; [`Error::Io`] naming `path` where it
/// is no regular file, is read-only, or was read as an input. Where only the rename fails, the
/// finished file is kept, and the error names it.
pub fn write_atomically_with(path: &Path, write: impl FnOnce(&Path) -> Result<()>) -> Result<()> {
    let target = Target::of(path)?;
    let temporary = target.temporary()?;
    write(temporary.file.path())?;
    target.finish(temporary)
}

/// Writes `bytes` to `path` through a temporary file and a rename.
///
/// # Errors
/// As for [`write_atomically_with`].
pub fn write_atomically(path: &Path, bytes: &[u8]) -> Result<()> {
    write_atomically_with(path, |temporary| {
        File::create(temporary).and_then(|mut f| f.write_all(bytes)).map_err(Error::io(path))
    })
}

/// Fails, without leaving anything behind, when a file named `path` could not be written. Removes
/// what a killed process left of an earlier attempt.
///
/// # Errors
/// As for [`write_atomically_with`].
pub fn check_writable(path: &Path) -> Result<()> {
    Target::of(path)?.temporary().map(drop)
}

/// Fails when two of `outputs` are one file, or one of them is one of `inputs`, links included: the
/// later write would lose what was there.
///
/// # Errors
/// [`Error::InvalidArgument`] naming the file.
pub fn check_distinct(inputs: &[&Path], outputs: &[PathBuf]) -> Result<()> {
    let mut known: Vec<_> = inputs.iter().filter_map(|path| Place::of(path)).collect();
    for path in outputs {
        let Some(place) = Place::of(path) else { continue };
        if known.contains(&place) {
            return Err(Error::InvalidArgument(format!(
                "{}: one file cannot be two of the inputs and the outputs",
                path.display()
            )));
        }
        known.push(place);
    }
    Ok(())
}

/// What two names of one file have in common.
#[derive(PartialEq)]
enum Place {
    Existing([u64; 2]),
    New(PathBuf),
}

impl Place {
    /// `None` for a path that no file can have.
    fn of(path: &Path) -> Option<Self> {
        match std::fs::metadata(path) {
            Ok(found) => Some(Self::Existing(identity(&found))),
            Err(_) => {
                let path = follow(path);
                Some(Self::New(folder(&path).canonicalize().ok()?.join(path.file_name()?)))
            }
        }
    }
}

/// Where a file is made that is created at `path`: links that lead nowhere yet are followed.
fn follow(path: &Path) -> PathBuf {
    let mut place = path.to_owned();
    for _ in 0..LINKS {
        let Ok(next) = std::fs::read_link(&place) else { break };
        place = folder(&place).join(next);
    }
    place
}

/// A file that is going to be written.
struct Target<'a> {
    /// As the user calls it.
    path: &'a Path,
    /// The file itself, links followed.
    place: PathBuf,
    old: Option<Metadata>,
}

/// A temporary file and the lock on it, which some file systems do not have.
struct Temporary {
    file: NamedTempFile,
    _lock: Option<Flock<File>>,
}

impl<'a> Target<'a> {
    fn of(path: &'a Path) -> Result<Self> {
        let refused = |what: &str| Err(Error::io(path)(io::Error::other(what)));
        let old = match std::fs::metadata(path) {
            Err(e) if e.kind() == ErrorKind::NotFound => {
                return Ok(Self { path, place: follow(path), old: None });
            }
            found => found.map_err(Error::io(path))?,
        };
        if old.is_dir() {
            return Err(Error::io(path)(ErrorKind::IsADirectory.into()));
        }
        if !old.is_file() {
            return refused("it is a device or a pipe; name a regular file to write");
        }
        if was_read(&old) {
            return refused("it was read as an input; give the output another name");
        }
        if old.permissions().readonly() {
            return refused("it is read-only; make it writable, or give the output another name");
        }
        // The system may have reasons of its own.
        OpenOptions::new().write(true).open(path).map_err(Error::io(path))?;
        let place = path.canonicalize().map_err(Error::io(path))?;
        Ok(Self { path, place, old: Some(old) })
    }

    /// How the names of its temporary files begin.
    fn prefix(&self) -> Vec<u8> {
        let name = self.place.file_name().unwrap_or_default().as_bytes();
        [b".", &name[..name.len().min(NAME)], b".lumicache-"].concat()
    }

    /// Removes the temporary files of writers that are no more.
    fn clean(&self) {
        let prefix = self.prefix();
        let entries = std::fs::read_dir(folder(&self.place)).into_iter().flatten().flatten();
        let left = entries.filter(|e| {
            let name = e.file_name();
            name.as_bytes().starts_with(&prefix) && name.as_bytes().ends_with(SUFFIX.as_bytes())
        });
        for path in left.map(|e| e.path()) {
            let open = OpenOptions::new()
                .read(true)
                .custom_flags(O_NONBLOCK | O_NOFOLLOW)
                .open(&path)
                .ok()
                .filter(|f| f.metadata().is_ok_and(|m| m.is_file() && m.uid() == user()));
            let lock = open.map(|file| Flock::lock(file, FlockArg::LockExclusiveNonblock));
            if matches!(lock, Some(Ok(_))) {
                // Another process that cleans may have been faster.
                let _ = std::fs::remove_file(path);
            }
        }
    }

    /// A new temporary file, which nobody else removes.
    fn temporary(&self) -> Result<Temporary> {
        self.clean();
        let mode = self.old.as_ref().map_or(0o666, Metadata::mode) & 0o777;
        let prefix = std::ffi::OsString::from_vec(self.prefix());
        for _ in 0..ATTEMPTS {
            let file = tempfile::Builder::new()
                .prefix(&prefix)
                .suffix(SUFFIX)
                .permissions(Permissions::from_mode(mode))
                .tempfile_in(folder(&self.place))
                .map_err(Error::io(self.path))?;
            let handle = file.as_file().try_clone().map_err(Error::io(self.path))?;
            let lock = match Flock::lock(handle, FlockArg::LockExclusiveNonblock) {
                Err((_, Errno::EWOULDBLOCK)) => continue,
                lock => lock.ok(),
            };
            if file.as_file().metadata().is_ok_and(|m| m.nlink() > 0) {
                return Ok(Temporary { file, _lock: lock });
            }
        }
        Err(Error::io(self.path)(ErrorKind::WouldBlock.into()))
    }

    /// Gives the temporary file its name.
    fn finish(self, temporary: Temporary) -> Result<()> {
        let Temporary { file, _lock } = temporary;
        match self.settle(file.as_file()) {
            Err(e) => Err(self.keep(file, e)),
            Ok(()) => match file.persist(&self.place) {
                Err(e) => Err(self.keep(e.file, e.error)),
                Ok(_) => {
                    // The name survives a crash of the machine where the system can promise it.
                    let _ = File::open(folder(&self.place)).and_then(|f| f.sync_all());
                    Ok(())
                }
            },
        }
    }

    /// Gives `file` the owner and the mode of the old file, and puts it on the disk.
    fn settle(&self, file: &File) -> io::Result<()> {
        if let Some(old) = &self.old {
            // Only root may give files away; others own what they write.
            let _ = fchown(file, Some(old.uid()), Some(old.gid()));
            file.set_permissions(Permissions::from_mode(old.mode() & 0o7777))?;
        }
        file.sync_all()
    }

    /// Keeps the finished `file` although it could not be put in its place, under a name that
    /// nobody cleans if there can be one, and says so.
    fn keep(&self, file: NamedTempFile, error: io::Error) -> Error {
        let kept = match file.keep() {
            Ok((_, hidden)) => {
                let mut name = self.place.file_name().unwrap_or_default().to_owned();
                name.push(format!(".unsaved-{}", std::process::id()));
                let shown = self.place.with_file_name(name);
                match std::fs::rename(&hidden, &shown) {
                    Ok(()) => shown,
                    Err(_) => hidden,
                }
            }
            Err(e) => return Error::io(self.path)(e.error),
        };
        let what = format!("{error}; the finished file is kept as {}", kept.display());
        Error::io(self.path)(io::Error::new(error.kind(), what))
    }
}

/// The user that new files belong to.
fn user() -> u32 {
    nix::unistd::geteuid().as_raw()
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::os::unix::fs::symlink;

    fn names(folder: &Path) -> Vec<String> {
        let entries = std::fs::read_dir(folder).unwrap();
        entries.map(|e| e.unwrap().file_name().into_string().unwrap()).collect()
    }

    #[test]
    fn a_failed_write_leaves_the_old_file_and_no_litter() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("a.txt");
        write_atomically(&path, b"old").unwrap();
        let failed = write_atomically_with(&path, |_| Err(Error::Cancelled));
        assert!(matches!(failed, Err(Error::Cancelled)));
        assert_eq!(std::fs::read(&path).unwrap(), b"old");
        assert_eq!(names(dir.path()), ["a.txt"]);
    }

    #[test]
    fn an_unwritable_place_is_known_beforehand() {
        let dir = tempfile::tempdir().unwrap();
        assert!(check_writable(&dir.path().join("a.exr")).is_ok());
        assert!(check_writable(&dir.path().join("missing/a.exr")).is_err());
        assert!(check_writable(dir.path()).is_err());
        let fifo = dir.path().join("fifo");
        nix::unistd::mkfifo(&fifo, nix::sys::stat::Mode::S_IRWXU).unwrap();
        for path in [&fifo, Path::new("/dev/null")] {
            assert!(write_atomically(path, b"x").unwrap_err().to_string().contains("a pipe"));
            assert!(!std::fs::metadata(path).unwrap().is_file(), "{path:?} was replaced");
        }
    }

    #[test]
    fn links_modes_and_read_only_files_are_respected() {
        let dir = tempfile::tempdir().unwrap();
        let at = |name: &str| dir.path().join(name);
        let mode = |name: &str| std::fs::metadata(at(name)).unwrap().mode() & 0o7777;
        write_atomically(&at("plain"), b"x").unwrap();
        File::create(at("made")).unwrap();
        assert_eq!(mode("plain"), mode("made"), "a new file has the mode that all have");
        for bits in [0o600, 0o640, 0o666, 0o755] {
            std::fs::set_permissions(at("plain"), Permissions::from_mode(bits)).unwrap();
            write_atomically(&at("plain"), &bits.to_le_bytes()).unwrap();
            assert_eq!(
                (mode("plain"), std::fs::read(at("plain")).unwrap()),
                (bits, bits.to_le_bytes().to_vec())
            );
        }
        std::fs::create_dir(at("sub")).unwrap();
        // To a file, to a link to it, and to where nothing is yet.
        for (link, to) in [("one", "sub/file"), ("two", "one"), ("three", "sub/new")] {
            symlink(to, at(link)).unwrap();
        }
        for (link, file) in [("one", "sub/file"), ("two", "sub/file"), ("three", "sub/new")] {
            write_atomically(&at(link), link.as_bytes()).unwrap();
            assert!(at(link).is_symlink());
            assert_eq!(std::fs::read(at(file)).unwrap(), link.as_bytes());
        }
        std::fs::set_permissions(at("plain"), Permissions::from_mode(0o444)).unwrap();
        let refused = write_atomically(&at("plain"), b"y").unwrap_err().to_string();
        assert!(refused.contains("read-only") && std::fs::read(at("plain")).unwrap() != b"y");
    }

    #[test]
    fn the_next_writer_removes_what_a_killed_one_left_and_nothing_else() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("a.exr");
        let target = Target::of(&path).unwrap();
        // A writer at work, and one that is no more.
        let (working, dead) = (target.temporary().unwrap(), target.temporary().unwrap());
        let name = dead.file.path().file_name().unwrap().to_str().unwrap().to_owned();
        assert!(name.starts_with(".a.exr.lumicache-") && name.ends_with(".tmp"), "{name}");
        let Temporary { file, _lock } = dead;
        file.keep().unwrap();
        drop(_lock);
        for other in [".b.exr.lumicache-x.tmp", ".a.exr.lumicache-x", "a.exr.lumicache-x.tmp"] {
            std::fs::write(dir.path().join(other), "not ours").unwrap();
        }
        let before = names(dir.path());
        write_atomically(&path, b"new").unwrap();
        let mut gone: Vec<_> = before;
        gone.retain(|n| !names(dir.path()).contains(n));
        assert_eq!(gone, [name]);
        drop(working);
        assert_eq!(names(dir.path()).len(), 4);
    }

    #[test]
    fn a_finished_file_that_cannot_take_its_place_is_kept_and_named() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("a.txt");
        let failed = write_atomically_with(&path, |temporary| {
            std::fs::write(temporary, "finished").unwrap();
            // What nobody can rename a file to.
            std::fs::create_dir_all(path.join("full")).unwrap();
            Ok(())
        });
        let error = failed.unwrap_err().to_string();
        let kept = error.split(" is kept as ").nth(1).expect("the error names the file");
        assert_eq!(std::fs::read(kept).unwrap(), b"finished");
        assert!(check_writable(&path).is_err() && Path::new(kept).exists());
    }

    #[test]
    fn many_writers_of_one_file_all_succeed() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("a.txt");
        std::thread::scope(|scope| {
            for k in 0..8u8 {
                let path = &path;
                scope.spawn(move || {
                    for _ in 0..25 {
                        write_atomically(path, &[k; 4096]).unwrap();
                    }
                });
            }
        });
        let last = std::fs::read(&path).unwrap();
        assert!(last.len() == 4096 && last.iter().all(|b| *b == last[0]));
        assert_eq!(names(dir.path()), ["a.txt"]);
    }

    #[test]
    fn one_file_by_two_names_is_found() {
        let dir = tempfile::tempdir().unwrap();
        let at = |name: &str| dir.path().join(name);
        std::fs::write(at("scene"), "").unwrap();
        symlink("scene", at("soft")).unwrap();
        std::fs::hard_link(at("scene"), at("hard")).unwrap();
        symlink("new", at("to-new")).unwrap();
        let scene = at("scene");
        for same in ["scene", "soft", "hard", "./scene"] {
            assert!(check_distinct(&[&scene], &[at("other"), at(same)]).is_err(), "{same}");
        }
        assert!(check_distinct(&[&scene], &[at("new"), at("to-new")]).is_err());
        assert!(check_distinct(&[&scene], &[at("a"), at("b")]).is_ok());
    }
}
