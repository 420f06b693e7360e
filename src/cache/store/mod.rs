//! Where records are kept: indexes, levels, caches, what several threads share, and files.

mod sync;
mod published;
mod index;
mod records;
mod radiosity;
mod level;
mod cache;
mod live;
mod columns;
mod file;

pub use cache::{Behind, Cache};
pub use file::{CacheFile, Origin};
pub use index::{Answer, Index};
pub use level::Level;
pub use live::{Live, Snapshot};
pub use radiosity::Radiosity;
pub(super) use records::Rules;
pub use records::Store;
