//! Zip archives: whatever the bytes, finding and unpacking the scene ends, without a panic, and no
//! more comes out than may.
#![no_main]

use hemilux::archive::{ArchiveError, Packed, Stretch};
use libfuzzer_sys::fuzz_target;
use std::fs::File;
use std::io::{Read, Write};

const MOST: u64 = 1 << 20;

fuzz_target!(|data: &[u8]| {
    let mut file = tempfile::tempfile().expect("a temporary file");
    file.write_all(data).expect("it takes the bytes");
    match unpack(&file, data.len() as u64) {
        Ok(size) => assert!(size <= MOST),
        Err(ArchiveError::Refused(_)) => {}
        Err(ArchiveError::Trouble(error)) => panic!("{error}"),
    }
});

/// Unpacks all of an archive; how many bytes came out.
fn unpack(file: &File, size: u64) -> Result<u64, ArchiveError> {
    let packed = Packed::open(Stretch { file, start: 0, size }, MOST)?;
    let mut sum = 0;
    for (_, mut contents) in packed.resources().into_values().chain([packed.main()]) {
        let mut bytes = Vec::new();
        contents.read_to_end(&mut bytes)?;
        sum += bytes.len() as u64;
    }
    Ok(sum)
}
