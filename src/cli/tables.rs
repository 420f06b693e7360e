//! Where the command line keeps tabulated glossy lobes between runs.

use lumicache::material::tables::TableStore;
use std::path::PathBuf;

/// The folder that the environment variable `LUMICACHE_TABLES` names (`off`: none), else
/// `lumicache` in the user's cache folder (`XDG_CACHE_HOME`, `~/.cache`).
pub fn tables() -> TableStore {
    let variable = |name: &str| std::env::var_os(name).filter(|v| !v.is_empty());
    let caches = || variable("XDG_CACHE_HOME").map(PathBuf::from).filter(|p| p.is_absolute());
    let home = || Some(PathBuf::from(variable("HOME")?).join(".cache"));
    let default = || caches().or_else(home).map(|c| c.join("lumicache"));
    let folder = variable("LUMICACHE_TABLES").map(PathBuf::from).or_else(default);
    TableStore::new(folder.filter(|f| f.as_os_str() != "off"))
}
