//! All interleavings of `src/capi/handles/table.rs` and `src/cache/store/published.rs`, as far as
//! loom goes: up to three threads with a few steps each.
//!
//! What arc-swap does inside is not seen here; it has models of its own. In its place stands a
//! lock, so what is checked is what we build on it.

#![allow(dead_code, reason = "the library uses more of these files than the models")]

#[path = "."]
pub mod handles {
    mod sync {
        pub use loom::sync::Mutex;
        pub use loom::sync::atomic::{AtomicU64, Ordering};

        /// Loom's cell notices when a read and a write overlap.
        pub struct Cell<T>(loom::cell::UnsafeCell<T>);

        impl<T> Cell<T> {
            pub fn new(value: T) -> Self {
                Self(loom::cell::UnsafeCell::new(value))
            }

            pub fn with<R>(&self, f: impl FnOnce(*const T) -> R) -> R {
                self.0.with(f)
            }

            pub fn with_mut<R>(&self, f: impl FnOnce(*mut T) -> R) -> R {
                self.0.with_mut(f)
            }
        }
    }

    #[path = "../../../src/capi/handles/table.rs"]
    pub mod table;
}

#[path = "."]
pub mod cache {
    mod sync {
        pub use loom::sync::{Arc, Mutex};

        /// Stands for arc-swap: takes and replaces in one step.
        pub struct Swap<T>(Mutex<Arc<T>>);

        impl<T> Swap<T> {
            pub fn new(value: Arc<T>) -> Self {
                Self(Mutex::new(value))
            }

            pub fn load(&self) -> Arc<T> {
                self.load_full()
            }

            pub fn load_full(&self) -> Arc<T> {
                self.0.lock().unwrap().clone()
            }

            pub fn store(&self, value: Arc<T>) {
                *self.0.lock().unwrap() = value;
            }
        }
    }

    #[path = "../../../src/cache/store/published.rs"]
    pub mod published;
}
