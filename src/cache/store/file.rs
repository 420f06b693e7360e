//! Caches as files.
//!
//! A file begins with 8 bytes of magic, the version of the layout (u32), a mark of the byte order
//! (u32) and the length of the header (u64); then come the header, which is JSON, the columns that
//! it lists, one after the other, and a BLAKE3 hash of everything before it. Numbers are
//! little-endian. Columns that a reader does not know are skipped. Lengths are stored as the
//! gathers gave them, before neighbours clamped them, so that files can be joined.

use super::cache::Cache;
use super::columns::{self, Heading};
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
use std::io::Read;
use std::path::Path;

const MAGIC: &[u8; 8] = b"\x89LUMI\r\n\x1a";
/// 2: columns in which no record has anything are left out.
/// 3: the header has the zero of positions and the extent of what is lit.
const VERSION: u32 = 3;
const BYTE_ORDER: u32 = 0x0102_0304;
const FIXED: usize = 24;
const HASH: usize = blake3::OUT_LEN;
/// Longest header that is read: a hundred times what one needs.
const MAX_HEADER: u64 = 1 << 20;

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
    /// The irradiance records of `cache`, made for `origin`.
    pub fn new(cache: &Cache, origin: Origin) -> Self {
        let records = |level| {
            let derived = cache.derived_count(level);
            cache.records(level).iter().skip(derived).cloned().collect()
        };
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
    /// records of another origin are taken too, as far as they have the same zero; none is used at
    /// more than the scheme's error.
    ///
    /// # Errors
    /// [`Error::Stale`] naming `path` if the origins differ; [`Error::Corrupt`] for records that
    /// are to be used at more than the scheme's error.
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
        for (level, mut records) in (0..cache.level_count()).zip(self.levels) {
            let all_light = records.iter().any(|r| r.payload.lit.is_some());
            if all_light && (level != 1 || !cache.takes_radiosity()) {
                if reuse {
                    continue;
                }
                return Err(corrupt(path, "its column `lit` belongs to level 1 of other schemes"));
            }
            let most = if all_light {
                cache.placing_radiosity(Vec::new()).radius_rule(0)
            } else {
                cache.radius_rule(level)
            };
            let most = most.allowed_error();
            if !reuse && records.iter().any(|r| r.error > most) {
                return Err(corrupt(path, "its column `error` holds more than its scheme allows"));
            }
            records.iter_mut().for_each(|r| r.error = r.error.min(most));
            if all_light {
                let placed = cache.placing_radiosity(records);
                cache.set_radiosity(Cache::radiosity_of(&placed, placed.records(0).to_vec()));
            } else if !records.is_empty() {
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

    /// Reads the file at `path`. Its first bytes decide whether the others are worth reading.
    ///
    /// # Errors
    /// [`Error::Io`], [`Error::Corrupt`] for anything but an undamaged cache file,
    /// [`Error::Unsupported`] for one of a later layout, [`Error::OutOfMemory`].
    pub fn read(path: &Path) -> Result<Self> {
        let file = fsutil::open(path)?;
        let length = file.metadata().map_err(Error::io(path))?.len();
        let mut head = Vec::new();
        (&file).take(FIXED as u64).read_to_end(&mut head).map_err(Error::io(path))?;
        let header = head_of(&head, length, path)?;
        (&file).take(header).read_to_end(&mut head).map_err(Error::io(path))?;
        Header::parse(head.get(FIXED..).unwrap_or_default(), length, path)?;
        Self::from_bytes(&fsutil::read(path)?, path)
    }

    /// The file at `path` whose content is `bytes`.
    ///
    /// # Errors
    /// Those of [`CacheFile::read`].
    pub fn from_bytes(bytes: &[u8], path: &Path) -> Result<Self> {
        let length = bytes.len() as u64;
        let end = FIXED + head_of(bytes, length, path)? as usize;
        let header = Header::parse(&bytes[FIXED..end], length, path)?;
        let (content, hash) = bytes.split_at(bytes.len() - HASH);
        if blake3::hash(content).as_bytes() != hash {
            return Err(corrupt(path, "its checksum is wrong: it was changed"));
        }
        let read =
            |level: &LevelHeader| level.read(&content[end..]).map_err(|what| corrupt(path, &what));
        let levels = header.levels.iter().map(read).collect::<Result<_>>()?;
        Ok(Self { origin: header.origin, extent: header.extent, levels })
    }
}

fn corrupt(path: &Path, what: &str) -> Error {
    Error::Corrupt { file: path.to_owned(), what: what.to_owned() }
}

/// The length of the header of the file at `path` that begins with `bytes`.
fn head_of(bytes: &[u8], length: u64, path: &Path) -> Result<u64> {
    if !bytes.starts_with(MAGIC) {
        return Err(corrupt(path, "it is not a cache file of lumicache"));
    }
    let Some(head) = bytes.first_chunk::<FIXED>() else {
        return Err(corrupt(path, "it is cut short"));
    };
    let word = |at: usize| u32::from_le_bytes([head[at], head[at + 1], head[at + 2], head[at + 3]]);
    if word(8) > VERSION {
        let what = format!(
            "its layout has version {}, which a later lumicache wrote; this one reads up to {VERSION}",
            word(8)
        );
        return Err(Error::unsupported(path, "", what));
    }
    if word(8) == 0 || word(12) != BYTE_ORDER {
        return Err(corrupt(path, "its first bytes are damaged"));
    }
    let header = u64::from(word(16)) | u64::from(word(20)) << 32;
    if header > MAX_HEADER {
        return Err(corrupt(path, "its header is longer than one can be"));
    }
    if header + (FIXED + HASH) as u64 > length {
        return Err(corrupt(path, "it is cut short"));
    }
    Ok(header)
}

impl Header {
    /// The header in `bytes` of the file at `path`, all of whose other bytes must belong to the
    /// columns: no byte is read for two of them, so records cannot be many more than the file is
    /// long.
    fn parse(bytes: &[u8], length: u64, path: &Path) -> Result<Self> {
        let header: Self = serde_json::from_slice(bytes)
            .map_err(|e| corrupt(path, &format!("its header is damaged: {e}")))?;
        let data = length.checked_sub((FIXED + bytes.len() + HASH) as u64);
        let mut columns: Vec<_> = Vec::new();
        for level in &header.levels {
            let end = |c: &ColumnHeader| c.offset.checked_add(c.bytes.checked_mul(level.records)?);
            columns.extend(level.columns.iter().map(|c| Some((c.offset, end(c)?))));
        }
        let columns: Option<Vec<_>> = columns.into_iter().collect();
        let end = columns.and_then(|mut columns| {
            columns.sort_unstable();
            columns.iter().try_fold(0, |end, c| (c.0 == end).then_some(c.1))
        });
        match end {
            None => Err(corrupt(path, "its header names columns that overlap or leave room")),
            Some(end) if Some(end) > data => Err(corrupt(path, "it is cut short")),
            Some(end) if Some(end) < data => Err(corrupt(path, "it is longer than its columns")),
            Some(end) if end > 0 && !columns::EXTENTS.contains(&header.extent) => {
                Err(corrupt(path, "its extent is none that a scene can have"))
            }
            Some(_) => Ok(header),
        }
    }
}

impl LevelHeader {
    /// The level's records.
    ///
    /// # Errors
    /// The column that is missing, or a value that no record can have.
    fn read(&self, data: &[u8]) -> std::result::Result<Vec<Record<Irradiance>>, String> {
        let table = columns::table();
        let mut columns = Vec::with_capacity(table.len());
        for heading in &table {
            let found = self.columns.iter().find(|c| c.name == heading.name);
            let damaged = || format!("its column `{}` is missing or damaged", heading.name);
            columns.push(match found {
                Some(column) if column.bytes == heading.bytes as u64 => {
                    let range = column.offset..column.offset + column.bytes * self.records;
                    Some(data.get(range.start as usize..range.end as usize).ok_or_else(damaged)?)
                }
                None if heading.optional => None,
                _ => return Err(damaged()),
            });
        }
        let mut records = Vec::new();
        let count = usize::try_from(self.records).ok();
        count
            .and_then(|count| records.try_reserve_exact(count).ok())
            .ok_or_else(|| format!("there is no memory for {} records", self.records))?;
        let zeros = vec![0; table.iter().map(|h| h.bytes).max().unwrap_or(0)];
        for i in 0..self.records as usize {
            let value = |k: usize| {
                let bytes = table[k].bytes;
                columns[k].map_or(&zeros[..bytes], |c| &c[i * bytes..(i + 1) * bytes])
            };
            records.push(columns::get(value).map_err(|k| {
                let Heading { name, range, .. } = table[k];
                format!("its column `{name}` ({range}) is damaged, first at record {i}")
            })?);
        }
        Ok(records)
    }
}
