//! A glTF file and the resources that it names, packed into one byte string, so that a scene of
//! several files has one content hash. The same files always pack to the same bytes.
//!
//! Layout: 8 bytes of magic; manifest length, u32 little-endian; manifest, JSON; the files.

use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

const MAGIC: &[u8; 8] = b"hmlxbndl";

#[derive(Serialize, Deserialize)]
struct Manifest {
    main_size: usize,
    resources: BTreeMap<String, usize>,
}

/// Files by the relative URI that the main file names them with.
pub type Resources = BTreeMap<String, Vec<u8>>;

/// Packs a main file and its resources by relative URI.
pub fn pack(main: &[u8], resources: &Resources) -> Vec<u8> {
    let manifest = Manifest {
        main_size: main.len(),
        resources: resources.iter().map(|(uri, bytes)| (uri.clone(), bytes.len())).collect(),
    };
    let manifest = serde_json::to_vec(&manifest).expect("a manifest serialises");
    let total: usize = resources.values().map(Vec::len).sum();
    let mut packed = Vec::with_capacity(12 + manifest.len() + main.len() + total);
    packed.extend(MAGIC);
    packed.extend((manifest.len() as u32).to_le_bytes());
    packed.extend(manifest);
    packed.extend(main);
    resources.values().for_each(|bytes| packed.extend(bytes));
    packed
}

/// The main file and the resources of a packed bundle; `None` where it is damaged.
pub fn unpack(packed: &[u8]) -> Option<(&[u8], Resources)> {
    let rest = packed.strip_prefix(MAGIC)?;
    let (length, rest) = rest.split_first_chunk::<4>()?;
    let (manifest, rest) = rest.split_at_checked(u32::from_le_bytes(*length) as usize)?;
    let manifest: Manifest = serde_json::from_slice(manifest).ok()?;
    let (main, mut rest) = rest.split_at_checked(manifest.main_size)?;
    let mut resources = BTreeMap::new();
    for (uri, size) in manifest.resources {
        let (bytes, tail) = rest.split_at_checked(size)?;
        resources.insert(uri, bytes.to_vec());
        rest = tail;
    }
    rest.is_empty().then_some((main, resources))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_was_packed_comes_out_and_damage_is_seen() {
        let resources = BTreeMap::from([
            ("b.png".to_owned(), vec![1, 2, 3]),
            ("a/ä.bin".to_owned(), Vec::new()),
        ]);
        let packed = pack(b"{}", &resources);
        assert_eq!(unpack(&packed), Some((&b"{}"[..], resources)));
        for length in 0..packed.len() {
            assert_eq!(unpack(&packed[..length]), None, "cut to {length}");
        }
    }
}
