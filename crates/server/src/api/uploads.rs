//! What the records of uploaded files have in common, whatever is in the files.

use jiff::Timestamp;
use serde::Serialize;
use serde::de::DeserializeOwned;

/// The record of a file that clients sent, which is kept once however often it is sent.
pub trait Upload: Serialize + DeserializeOwned + Clone + Send + Sync + 'static {
    /// The kind of files, as the store calls it.
    const KIND: &'static str;

    /// SHA-256 of the file, in hex.
    fn id(&self) -> &str;

    /// Bytes of the file.
    fn size(&self) -> u64;

    /// When it was first stored.
    fn created_at(&self) -> Timestamp;

    /// The record as one of those sees it who sent the file: with their name for it, and since when
    /// they have had it.
    fn seen_as(self, name: Option<String>, created_at: Timestamp) -> Self;
}
