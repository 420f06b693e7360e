//! Libraries loaded at run time, for us alone.
//!
//! A plugin that links a library gets whatever library of that name its host has loaded before, and
//! functions of whatever copy is in the process's global scope. Here a library is opened by its
//! path, its names stay out of the global scope, and it prefers its own to those in there.

use libloading::os::unix::{Library, RTLD_LOCAL, RTLD_NOW};
use std::ffi::c_int;
use std::fs::File;
use std::io::{self, Read, Seek, SeekFrom};
use std::path::Path;

/// glibc: the library's own definitions come before the global ones.
const RTLD_DEEPBIND: c_int = if cfg!(all(target_os = "linux", target_env = "gnu")) { 8 } else { 0 };
/// The library stays loaded when its handle is closed.
const RTLD_NODELETE: c_int = if cfg!(target_os = "macos") { 0x80 } else { 0x1000 };

/// Loads the file at `path` for good: threads of a library may outlive what was made of it.
///
/// # Errors
/// The loader's message.
pub(super) fn open(path: &Path) -> Result<Library, String> {
    let flags = RTLD_NOW | RTLD_LOCAL | RTLD_NODELETE | deep_bind();
    // SAFETY: loading runs the initialisers of Embree, TBB and Open Image Denoise, which ask for
    // nothing.
    unsafe { Library::open(Some(path), flags) }.map_err(|error| error.to_string())
}

/// The address sanitizer replaces malloc in the global scope, which deep binding would pass by: it
/// refuses to go on then.
fn deep_bind() -> c_int {
    // SAFETY: the symbol is not called, only looked for.
    let sanitized = unsafe { Library::this().get::<*const u8>(b"__asan_init\0") }.is_ok();
    if sanitized { 0 } else { RTLD_DEEPBIND }
}

/// False for an ELF file of 64 bits that ends before its segments do: a download or a copy that was
/// interrupted. The loader would map it, and the process would die of a bus error.
pub(super) fn is_whole(path: &Path) -> bool {
    // The loader has its own words for files that cannot be read and for other formats.
    segments_end(path).map_or(true, |[end, length]| end <= length)
}

/// Where the segments of the ELF file at `path` end, and where the file does.
fn segments_end(path: &Path) -> io::Result<[u64; 2]> {
    let mut file = File::open(path)?;
    let length = file.metadata()?.len();
    let mut head = [0; 64];
    file.read_exact(&mut head)?;
    if head[..4] != *b"\x7fELF" || head[4] != 2 {
        return Ok([0, length]);
    }
    let number = |bytes: &[u8]| bytes.iter().rev().fold(0, |sum, &b| sum << 8 | u64::from(b));
    // e_phoff, e_phentsize, e_phnum.
    let (table, size, count) =
        (number(&head[0x20..0x28]), number(&head[0x36..0x38]), number(&head[0x38..0x3a]));
    let mut end = table.saturating_add(size * count);
    if end > length || size < 56 {
        return Ok([end, length]);
    }
    file.seek(SeekFrom::Start(table))?;
    let mut rows = vec![0; (size * count) as usize];
    file.read_exact(&mut rows)?;
    for row in rows.chunks_exact(size as usize).filter(|row| number(&row[..4]) == 1) {
        // p_offset, p_filesz.
        end = end.max(number(&row[8..16]).saturating_add(number(&row[32..40])));
    }
    Ok([end, length])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_program_is_whole_up_to_the_end_of_its_segments() {
        let program = std::env::current_exe().unwrap();
        assert!(is_whole(&program));
        let bytes = std::fs::read(&program).unwrap();
        let folder = tempfile::tempdir().unwrap();
        let part = folder.path().join("part");
        // Names and lines for debuggers follow the segments.
        let end = usize::try_from(segments_end(&program).unwrap()[0]).unwrap();
        assert!(end > 1 << 20);
        let cuts = [(end, true), (end - 1, false), (end / 2, false), (100, false)];
        for (length, whole) in cuts.into_iter().chain([(10, true), (0, true)]) {
            std::fs::write(&part, &bytes[..length]).unwrap();
            assert_eq!(is_whole(&part), whole, "{length}");
        }
        std::fs::write(&part, "no library\n".repeat(100)).unwrap();
        assert!(is_whole(&part) && is_whole(folder.path()) && is_whole(Path::new("/nowhere")));
    }
}
