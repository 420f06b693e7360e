//! A value that one thread at a time replaces while any number of threads read it.
//!
//! Readers never wait: a read costs no more while somebody writes. `tests/loom` goes through all
//! interleavings of this file.

use super::sync::{Arc, Mutex, Swap};
use std::sync::PoisonError;

/// The value. Whoever reads sees one version of it, whole, for as long as the reading lasts.
pub struct Published<T> {
    current: Swap<T>,
    /// Writers take turns.
    writing: Mutex<()>,
}

impl<T> Published<T> {
    /// Publishes the first version.
    pub fn new(value: T) -> Self {
        Self { current: Swap::new(Arc::new(value)), writing: Mutex::new(()) }
    }

    /// Calls `f` with the current version.
    #[inline]
    pub fn read<R>(&self, f: impl FnOnce(&T) -> R) -> R {
        f(&self.current.load())
    }

    /// The current version, to be kept.
    pub fn get(&self) -> Arc<T> {
        self.current.load_full()
    }

    /// Puts `change(current)` in the place of the current version, or nothing if that is `None`; no
    /// other change comes between. Returns whether it did.
    pub fn update(&self, change: impl FnOnce(&T) -> Option<T>) -> bool {
        // A writer that panicked has stored nothing: what the lock guards is whole.
        let _turn = self.writing.lock().unwrap_or_else(PoisonError::into_inner);
        let next = change(&self.current.load());
        let changed = next.is_some();
        if let Some(next) = next {
            self.current.store(Arc::new(next));
        }
        changed
    }
}
