//! Tables kept on disk between runs.

use super::lobe::LobeTable;
use crate::fsutil::write_atomically;
use std::path::PathBuf;

/// First bytes of a file; the number changes with the format and with what tables mean.
const MAGIC: &[u8; 8] = b"lumiBT01";
/// Length of the checksum at the end of a file.
const CHECKSUM: usize = blake3::OUT_LEN;

/// Where tables are kept between runs: a folder, or nowhere.
#[derive(Clone, Debug, Default)]
pub struct TableStore(Option<PathBuf>);

impl TableStore {
    /// Tables in `folder`, which is made when the first table is; without a folder they live in
    /// memory alone.
    pub fn new(folder: Option<PathBuf>) -> Self {
        Self(folder)
    }

    /// The table for `key`, which names everything that the table depends on: read, or else made
    /// by `build` and written. A damaged file counts as none. A folder that cannot be written costs
    /// time, no more.
    pub fn get(&self, key: &str, build: impl FnOnce() -> LobeTable) -> LobeTable {
        let Some(folder) = &self.0 else { return build() };
        let path = folder.join(format!("{}.brdf", &blake3::hash(key.as_bytes()).to_hex()[..32]));
        if let Some(table) = std::fs::read(&path).ok().and_then(|bytes| decode(&bytes, key)) {
            return table;
        }
        let table = build();
        if std::fs::create_dir_all(folder).is_ok() {
            // Not being able to keep it is no failure.
            let _ = write_atomically(&path, &encode(&table, key));
        }
        table
    }
}

/// Magic, key, shape, lost energies and coefficients in little-endian order, checksum.
fn encode(table: &LobeTable, key: &str) -> Vec<u8> {
    let mut bytes = MAGIC.to_vec();
    bytes.extend((key.len() as u32).to_le_bytes());
    bytes.extend(key.as_bytes());
    bytes.extend([table.order as u8, table.parts as u8, u8::from(table.isotropic)]);
    bytes.extend(table.lost.iter().chain(&table.coefficients).flat_map(|c| c.to_le_bytes()));
    let checksum = blake3::hash(&bytes);
    bytes.extend(checksum.as_bytes());
    bytes
}

/// The table in `bytes`, if they are whole and are what `key` asks for.
fn decode(bytes: &[u8], key: &str) -> Option<LobeTable> {
    let (body, checksum) = bytes.split_at_checked(bytes.len().checked_sub(CHECKSUM)?)?;
    if blake3::hash(body).as_bytes() != checksum {
        return None;
    }
    let body = body.strip_prefix(MAGIC)?;
    let body =
        body.strip_prefix(&(key.len() as u32).to_le_bytes())?.strip_prefix(key.as_bytes())?;
    let (&[order, parts, isotropic], body) = body.split_first_chunk()?;
    let (order, parts, isotropic) = (usize::from(order), usize::from(parts), isotropic != 0);
    let nodes = LobeTable::node_count(isotropic);
    let (lost, coefficients) = (
        nodes * LobeTable::levels(order, parts),
        nodes * LobeTable::stride(order, isotropic, parts),
    );
    if body.len() != 4 * (lost + coefficients) {
        return None;
    }
    let mut numbers =
        body.chunks_exact(4).map(|c| f32::from_le_bytes(c.try_into().expect("four bytes")));
    let lost = numbers.by_ref().take(lost).collect();
    Some(LobeTable { order, parts, isotropic, lost, coefficients: numbers.collect() })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::basis::Hsh;
    use crate::material::tables::Lobe;
    use std::cell::Cell;

    #[test]
    fn tables_are_kept_checked_and_made_again_when_damaged() {
        let dir = tempfile::tempdir().unwrap();
        let made = Cell::new(0);
        let build = || {
            made.set(made.get() + 1);
            let lobe = Lobe { f: &|_, wi| [wi.z, 0.0, 0.0], parts: 1, isotropic: true };
            LobeTable::build(&lobe, &Hsh::new(4))
        };
        let store = TableStore::new(Some(dir.path().join("new")));
        let first = store.get("a", build);
        assert_eq!((store.get("a", build), made.get()), (first.clone(), 1));
        let _ = store.get("b", build);
        assert_eq!(made.get(), 2, "another key, another table");
        let files: Vec<_> =
            std::fs::read_dir(dir.path().join("new")).unwrap().map(|e| e.unwrap().path()).collect();
        assert_eq!(files.len(), 2);
        for (damage, cut) in [(true, 0), (false, 1), (false, 200)] {
            for file in &files {
                let mut bytes = std::fs::read(file).unwrap();
                let middle = bytes.len() / 2;
                bytes[middle] ^= u8::from(damage);
                bytes.truncate(bytes.len() - cut);
                std::fs::write(file, bytes).unwrap();
            }
            let before = made.get();
            assert_eq!(store.get("a", build), first);
            assert_eq!(store.get("b", build), first);
            assert_eq!(made.get(), before + 2, "damaged files are not used");
            assert_eq!(
                (store.get("a", build), made.get()),
                (first.clone(), before + 2),
                "and are replaced"
            );
        }
        assert_eq!(TableStore::default().get("a", build), first);
    }
}
