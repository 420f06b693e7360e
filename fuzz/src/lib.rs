//! What the targets share.

use std::path::Path;

/// Hands `bytes` to `read` as a file of that name, alone in its folder.
pub fn as_file(name: &str, bytes: &[u8], read: impl FnOnce(&Path)) {
    thread_local! {
        static FOLDER: tempfile::TempDir = tempfile::tempdir().expect("a folder");
    }
    FOLDER.with(|folder| {
        let path = folder.path().join(name);
        std::fs::write(&path, bytes).expect("a file");
        read(&path);
    });
}
