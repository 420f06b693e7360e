//! Where records are kept: indexes, levels, caches, what several threads share, and files.

mod sync;
mod published;
mod index;
mod level;
mod radiosity;
mod cache;
mod live;
mod columns;
mod file;

pub use cache::{Behind, Cache};
pub use file::{CacheFile, Origin};
pub use index::{Answer, Index};
pub(super) use level::Rules;
pub use level::{Level, Store};
pub use live::{Live, Snapshot};
pub use radiosity::Radiosity;
