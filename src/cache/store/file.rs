//! Caches as files.
//!
//! A file begins with 8 bytes of magic, the version of the layout (u32), a mark of the byte order
//! (u32) and the length of the header (u64); then come the header, which is JSON, the columns that
//! it lists, and a BLAKE3 hash of everything before it. Numbers are little-endian. Columns that a
//! reader does not know are skipped. Lengths are stored as the gathers gave them, before neighbours
//! clamped them, so that files can be joined.

use super::cache::Cache;
use super::columns;
use crate::cache::payload::Irradiance;
use crate::cache::record::Record;
use crate::cache::scheme::Scheme;
use crate::error::{Error, Result};
use crate::fsutil;
use crate::math::Vec3;
use glam::DVec3;
use serde::{Deserialize, Serialize};
use serde_json::Value;
use std::collections::{BTreeMap, HashSet};
use std::path::Path;

const MAGIC: &[u8; 8] = b"\x89LUMI\r\n\x1a";
/// 2: columns in which no record has anything are left out.
/// 3: the header has the zero of positions and the extent of what is lit.
const VERSION: u32 = 3;
const BYTE_ORDER: u32 = 0x0102_0304;
const FIXED: usize = 24;
const HASH: usize = blake3::OUT_LEN;
/// Longest header that is read: thousands of times what one needs.
const MAX_HEADER: u64 = 1 << 24;

/// What records were made for, and how: those of another origin are of no use.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Origin {
    /// Hashes of the scene's parts, by name.
    pub scene: BTreeMap<String, String>,
    /// The scheme, field by field.
    pub scheme: Value,
    /// Most interactions of light paths after the camera hit; `None` without a bound.
    pub max_bounces: Option<u32>,
    /// Where the zero of the records' positions lies in the world.
    pub zero: [f64; 3],
}

impl Origin {
    /// The origin of records made under `scheme` in the scene with these hashes, whose coordinates
    /// have their zero at `zero` in the world; `u32::MAX` bounces are no bound.
    pub fn new(
        scene: BTreeMap<String, String>, scheme: &Scheme, max_bounces: u32, zero: DVec3,
    ) -> Self {
        Self {
            scene,
            zero: zero.to_array(),
            scheme: scheme.settings().into(),
            max_bounces: (max_bounces != u32::MAX).then_some(max_bounces),
        }
    }

    /// What differs between records from here and `wanted`, in words; `None` if they may stand in
    /// for each other.
    pub fn difference(&self, wanted: &Self) -> Option<String> {
        let names: Vec<&str> =
            self.scene.keys().chain(wanted.scene.keys()).map(String::as_str).collect();
        let mut parts: Vec<&str> =
            names.into_iter().filter(|n| self.scene.get(*n) != wanted.scene.get(*n)).collect();
        parts.dedup();
        if !parts.is_empty() {
            parts.sort_unstable();
            parts.dedup();
            return Some(format!("made for another scene: the {} differ", parts.join(" and the ")));
        }
        let text = |bounces: Option<u32>| bounces.map_or("unlimited".to_owned(), |n| n.to_string());
        if self.zero != wanted.zero {
            let place = |[x, y, z]: [f64; 3]| format!("({x} {y} {z})");
            let (have, want) = (place(self.zero), place(wanted.zero));
            return Some(format!("made for a scene around {have}, not {want}"));
        }
        if self.max_bounces != wanted.max_bounces {
            return Some(format!(
                "made for {} bounces, not {}",
                text(self.max_bounces),
                text(wanted.max_bounces)
            ));
        }
        let fields = |scheme: &Value| scheme.as_object().cloned().unwrap_or_default();
        let (have, want) = (fields(&self.scheme), fields(&wanted.scheme));
        let keys = want.keys().chain(have.keys().filter(|k| !want.contains_key(*k)));
        let differ: Vec<String> = keys
            .filter(|k| have.get(*k) != want.get(*k))
            .map(|k| {
                let value = |of: &serde_json::Map<String, Value>| {
                    of.get(k).map_or("none".to_owned(), Value::to_string)
                };
                format!("{k} {}, not {}", value(&have), value(&want))
            })
            .collect();
        (!differ.is_empty()).then(|| format!("made under other settings: {}", differ.join(", ")))
    }
}

/// The records of a cache with what they were made for.
#[derive(Clone, Debug, PartialEq)]
pub struct CacheFile {
    /// What they were made for.
    pub origin: Origin,
    /// The length that their radii are relative to, 0 where there are none.
    pub extent: f32,
    /// The records of each level, camera first.
    pub levels: Vec<Vec<Record<Irradiance>>>,
}

#[derive(Serialize, Deserialize)]
struct Header {
    software: String,
    #[serde(flatten)]
    origin: Origin,
    extent: f32,
    /// Lowest and highest corner of the records' positions; for readers of the header.
    bounds: Option<[[f32; 3]; 2]>,
    levels: Vec<LevelHeader>,
}

#[derive(Serialize, Deserialize)]
struct LevelHeader {
    records: u64,
    columns: Vec<ColumnHeader>,
}

#[derive(Serialize, Deserialize)]
struct ColumnHeader {
    name: String,
    /// Bytes of one value.
    bytes: u64,
    /// Where the column begins, counted from the end of the header.
    offset: u64,
}

impl CacheFile {
    /// The records of `cache`, made for `origin`.
    pub fn new(cache: &Cache, origin: Origin) -> Self {
        let records = |level| cache.records(level).to_vec();
        Self {
            origin,
            extent: cache.extent(),
            levels: (0..cache.level_count()).map(records).collect(),
        }
    }

    /// The position of a record in the world.
    pub fn position(&self, record: &Record<Irradiance>) -> DVec3 {
        DVec3::from(self.origin.zero) + record.position.as_dvec3()
    }

    /// A cache of `scheme` with these records, for the use that `origin` describes. With `reuse`
    /// records of another origin are taken too, as far as they have the same zero.
    ///
    /// # Errors
    /// [`Error::Stale`] naming `path` if the origins differ.
    pub fn into_cache(
        self, scheme: Scheme, origin: &Origin, reuse: bool, path: &Path,
    ) -> Result<Cache> {
        if let Some(difference) =
            self.origin.difference(origin).filter(|_| !reuse || self.origin.zero != origin.zero)
        {
            let what = format!("the cache was {difference}; make it anew, or ask for its reuse");
            return Err(Error::Stale { file: path.to_owned(), what });
        }
        let mut cache =
            Cache::new(scheme, origin.max_bounces.unwrap_or(u32::MAX)).with_extent(self.extent);
        for (level, records) in (0..cache.level_count()).zip(self.levels) {
            if !records.is_empty() {
                cache.replace(level, records);
            }
        }
        Ok(cache)
    }

    /// Adds the records of `other`, read from `path`, but for those that are here already. With
    /// `reuse` records of another origin are taken too, as far as they have the same zero.
    ///
    /// # Errors
    /// [`Error::Stale`] naming `path` if the origins differ.
    pub fn merge(&mut self, other: Self, reuse: bool, path: &Path) -> Result<()> {
        if let Some(difference) = other
            .origin
            .difference(&self.origin)
            .filter(|_| !reuse || other.origin.zero != self.origin.zero)
        {
            return Err(Error::Stale {
                file: path.to_owned(),
                what: format!("the cache was {difference}"),
            });
        }
        self.levels.resize_with(self.levels.len().max(other.levels.len()), Vec::new);
        for (mine, theirs) in self.levels.iter_mut().zip(other.levels) {
            let place = |r: &Record<Irradiance>| {
                [r.position, r.normal].map(|v| v.to_array().map(f32::to_bits))
            };
            let known: HashSet<_> = mine.iter().map(place).collect();
            mine.extend(theirs.into_iter().filter(|r| !known.contains(&place(r))));
        }
        Ok(())
    }

    /// Number of records on all levels.
    pub fn record_count(&self) -> usize {
        self.levels.iter().map(Vec::len).sum()
    }

    /// Writes the file through a temporary one and a rename.
    ///
    /// # Errors
    /// [`Error::Io`] naming `path`.
    pub fn write(&self, path: &Path) -> Result<()> {
        fsutil::write_atomically(path, &self.to_bytes())
    }

    /// The content of the file.
    pub fn to_bytes(&self) -> Vec<u8> {
        let table = columns::table();
        let mut data = Vec::new();
        let mut levels = Vec::new();
        for records in &self.levels {
            let mut columns: Vec<Vec<u8>> =
                table.iter().map(|h| Vec::with_capacity(h.bytes * records.len())).collect();
            records.iter().for_each(|r| columns::put(r, &mut columns));
            let kept = table
                .iter()
                .zip(columns)
                .filter(|(h, column)| !h.optional || column.iter().any(|b| *b != 0));
            let headers = kept.map(|(heading, column)| {
                let offset = data.len() as u64;
                data.extend(column);
                ColumnHeader { name: heading.name.to_owned(), bytes: heading.bytes as u64, offset }
            });
            levels.push(LevelHeader { columns: headers.collect(), records: records.len() as u64 });
        }
        let positions = || self.levels.iter().flatten().map(|r| r.position);
        let bounds = positions().next().map(|first| {
            let (low, high) =
                positions().fold((first, first), |(a, b): (Vec3, Vec3), p| (a.min(p), b.max(p)));
            [low.to_array(), high.to_array()]
        });
        let software = concat!("lumicache ", env!("CARGO_PKG_VERSION")).to_owned();
        let (origin, extent) = (self.origin.clone(), self.extent);
        let header = Header { software, origin, extent, bounds, levels };
        let header = serde_json::to_vec(&header).expect("a header is plain data");
        let mut bytes = Vec::with_capacity(FIXED + header.len() + data.len() + HASH);
        bytes.extend(MAGIC);
        bytes.extend(VERSION.to_le_bytes());
        bytes.extend(BYTE_ORDER.to_le_bytes());
        bytes.extend((header.len() as u64).to_le_bytes());
        bytes.extend(header);
        bytes.extend(data);
        let hash = blake3::hash(&bytes);
        bytes.extend(hash.as_bytes());
        bytes
    }

    /// Reads the file at `path`.
    ///
    /// # Errors
    /// [`Error::Io`], [`Error::Corrupt`] for anything but an undamaged cache file,
    /// [`Error::Unsupported`] for one of a later layout.
    pub fn read(path: &Path) -> Result<Self> {
        Self::from_bytes(&std::fs::read(path).map_err(Error::io(path))?, path)
    }

    /// The file at `path` whose content is `bytes`.
    ///
    /// # Errors
    /// Those of [`CacheFile::read`].
    pub fn from_bytes(bytes: &[u8], path: &Path) -> Result<Self> {
        let corrupt = |what: &str| Error::Corrupt { file: path.to_owned(), what: what.to_owned() };
        if !bytes.starts_with(MAGIC) {
            return Err(corrupt("it is not a cache file of lumicache"));
        }
        let (content, hash) = bytes
            .split_last_chunk::<HASH>()
            .filter(|(c, _)| c.len() >= FIXED)
            .ok_or_else(|| corrupt("it is cut short"))?;
        let word = |at: usize| {
            u32::from_le_bytes([content[at], content[at + 1], content[at + 2], content[at + 3]])
        };
        if word(8) > VERSION {
            let what = format!(
                "its layout has version {}, which a later lumicache wrote; this one reads up to {VERSION}",
                word(8)
            );
            return Err(Error::unsupported(path, "", what));
        }
        if blake3::hash(content) != *hash {
            return Err(corrupt("its checksum is wrong: it was cut short or changed"));
        }
        if word(8) == 0 || word(12) != BYTE_ORDER {
            return Err(corrupt("its first bytes are damaged"));
        }
        let length = u64::from(word(16)) | u64::from(word(20)) << 32;
        let (header, data) = usize::try_from(length.min(MAX_HEADER + 1))
            .ok()
            .and_then(|n| content[FIXED..].split_at_checked(n))
            .ok_or_else(|| corrupt("its header is longer than the file"))?;
        let header: Header = serde_json::from_slice(header)
            .map_err(|e| corrupt(&format!("its header is damaged: {e}")))?;
        let levels: Option<Vec<Vec<Record<Irradiance>>>> =
            header.levels.iter().map(|level| level.read(data)).collect();
        let levels =
            levels.ok_or_else(|| corrupt("a record is missing or holds what no record can"))?;
        Ok(Self { origin: header.origin, extent: header.extent, levels })
    }
}

impl LevelHeader {
    /// The level's records; `None` if any is missing or broken.
    fn read(&self, data: &[u8]) -> Option<Vec<Record<Irradiance>>> {
        let count = usize::try_from(self.records).ok()?;
        let mut columns = BTreeMap::new();
        let zeros = vec![0; columns::table().iter().map(|h| h.bytes).max()?];
        for heading in columns::table() {
            let bytes = heading.bytes;
            let found = match self.columns.iter().find(|c| c.name == heading.name) {
                Some(column) if column.bytes == bytes as u64 => {
                    let start = usize::try_from(column.offset).ok()?;
                    Some(data.get(start..start.checked_add(bytes.checked_mul(count)?)?)?)
                }
                None if heading.optional => None,
                _ => return None,
            };
            columns.insert(heading.name, (bytes, found));
        }
        let value = |name: &str, i: usize| {
            columns.get(name).map(|&(bytes, data)| {
                data.map_or(&zeros[..bytes], |d| &d[i * bytes..(i + 1) * bytes])
            })
        };
        (0..count).map(|i| columns::get(|name| value(name, i))).collect()
    }
}
