//! Files that commands read.

use std::path::Path;

/// Largest file that is read, bytes.
pub const MAX_FILE_BYTES: u64 = 1 << 30;

/// The bytes of a file.
///
/// # Errors
/// Those of the system, and one where it is larger than [`MAX_FILE_BYTES`].
pub fn read_file(path: &Path) -> std::io::Result<Vec<u8>> {
    let size = std::fs::metadata(path)?.len();
    if size > MAX_FILE_BYTES {
        return Err(std::io::Error::other(format!("larger than {MAX_FILE_BYTES} bytes")));
    }
    std::fs::read(path)
}
