//! A glTF file and the resources that it names, packed into one byte string, so that a scene of
//! several files has one content hash. The same files always pack to the same bytes.
//!
//! Layout: 8 bytes of magic; manifest length, u32 little-endian; manifest, JSON; the files.

use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::io::{self, Read, Write};

const MAGIC: &[u8; 8] = b"hmlxbndl";

#[derive(Serialize, Deserialize)]
struct Manifest {
    main_size: u64,
    resources: BTreeMap<String, u64>,
}

/// Files by the relative URI that the main file names them with.
pub type Resources = BTreeMap<String, Vec<u8>>;

/// A file that is to be packed: its size and where it is read from.
pub type Packable<R> = (u64, R);

/// Packs a main file and its resources by relative URI into `out`. Each is read once, piece by
/// piece, so that packing takes no memory that grows with the files.
///
/// # Errors
/// Where a file cannot be read, is shorter than its size, or `out` takes no more.
pub fn pack<R: Read>(
    out: &mut impl Write,
    main: Packable<R>,
    resources: BTreeMap<String, Packable<R>>,
) -> io::Result<()> {
    let manifest = Manifest {
        main_size: main.0,
        resources: resources.iter().map(|(uri, (size, _))| (uri.clone(), *size)).collect(),
    };
    let manifest = serde_json::to_vec(&manifest)?;
    let length = u32::try_from(manifest.len()).map_err(io::Error::other)?;
    out.write_all(MAGIC)?;
    out.write_all(&length.to_le_bytes())?;
    out.write_all(&manifest)?;
    for (size, file) in std::iter::once(main).chain(resources.into_values()) {
        if io::copy(&mut file.take(size), out)? < size {
            return Err(io::ErrorKind::UnexpectedEof.into());
        }
    }
    Ok(())
}

/// The main file and the resources of a packed bundle; `None` where it is damaged.
pub fn unpack(packed: &[u8]) -> Option<(&[u8], Resources)> {
    let rest = packed.strip_prefix(MAGIC)?;
    let (length, rest) = rest.split_first_chunk::<4>()?;
    let (manifest, rest) = rest.split_at_checked(u32::from_le_bytes(*length) as usize)?;
    let manifest: Manifest = serde_json::from_slice(manifest).ok()?;
    let (main, mut rest) = rest.split_at_checked(usize::try_from(manifest.main_size).ok()?)?;
    let mut resources = BTreeMap::new();
    for (uri, size) in manifest.resources {
        let (bytes, tail) = rest.split_at_checked(usize::try_from(size).ok()?)?;
        resources.insert(uri, bytes.to_vec());
        rest = tail;
    }
    rest.is_empty().then_some((main, resources))
}

/// As [`unpack`], of a bundle that is read rather than held: each file is in memory once. `None`
/// where it is damaged.
///
/// # Errors
/// Where it cannot be read.
pub fn read(from: &mut impl Read) -> io::Result<Option<(Vec<u8>, Resources)>> {
    let mut part = |size: u64| -> io::Result<Option<Vec<u8>>> {
        let mut bytes = Vec::new();
        // Room for all at once, unless the size is nonsense.
        let _ = usize::try_from(size).map(|size| bytes.try_reserve_exact(size));
        let got = from.by_ref().take(size).read_to_end(&mut bytes)?;
        Ok((got as u64 == size).then_some(bytes))
    };
    let magic = part(MAGIC.len() as u64)?;
    let length = part(4)?.and_then(|bytes| bytes.try_into().ok()).map(u32::from_le_bytes);
    let Some(length) = length.filter(|_| magic.as_deref() == Some(MAGIC)) else { return Ok(None) };
    let manifest = part(length.into())?.and_then(|bytes| serde_json::from_slice(&bytes).ok());
    let Some(Manifest { main_size, resources: sizes }) = manifest else { return Ok(None) };
    let Some(main) = part(main_size)? else { return Ok(None) };
    let mut resources = BTreeMap::new();
    for (uri, size) in sizes {
        let Some(bytes) = part(size)? else { return Ok(None) };
        resources.insert(uri, bytes);
    }
    Ok(part(1)?.is_none().then_some((main, resources)))
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
        let files =
            resources.iter().map(|(uri, bytes)| (uri.clone(), (bytes.len() as u64, &bytes[..])));
        let mut packed = Vec::new();
        pack(&mut packed, (2, &b"{}"[..]), files.collect()).unwrap();
        assert_eq!(unpack(&packed), Some((&b"{}"[..], resources.clone())));
        assert_eq!(read(&mut &packed[..]).unwrap(), Some((b"{}".to_vec(), resources)));
        for length in 0..packed.len() {
            assert_eq!(unpack(&packed[..length]), None, "cut to {length}");
            assert_eq!(read(&mut &packed[..length]).unwrap(), None, "cut to {length}");
        }
        packed.push(0);
        assert_eq!((unpack(&packed), read(&mut &packed[..]).unwrap()), (None, None));
        let short = pack(&mut Vec::new(), (3, &b"{}"[..]), BTreeMap::new());
        assert_eq!(short.unwrap_err().kind(), io::ErrorKind::UnexpectedEof);
    }
}
