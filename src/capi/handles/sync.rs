//! The primitives under [`table`](super::table), so that a model checker can put its own in
//! their place: `tests/loom` does.

pub use std::sync::Mutex;
pub use std::sync::atomic::{AtomicU64, Ordering};

/// A cell whose users see to it that nobody reads while somebody writes.
pub struct Cell<T>(std::cell::UnsafeCell<T>);

impl<T> Cell<T> {
    pub fn new(value: T) -> Self {
        Self(std::cell::UnsafeCell::new(value))
    }

    #[inline]
    pub fn with<R>(&self, f: impl FnOnce(*const T) -> R) -> R {
        f(self.0.get())
    }

    #[inline]
    pub fn with_mut<R>(&self, f: impl FnOnce(*mut T) -> R) -> R {
        f(self.0.get())
    }
}
