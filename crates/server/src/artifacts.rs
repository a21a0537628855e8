//! Files: uploaded scenes and finished pictures. Content is hashed, written atomically and
//! fsynced before it is named anywhere.

mod content;
mod error;
mod files;
mod kept;
mod keys;
mod orphans;
mod pictures;
mod scenes;
mod sound;
mod stream;

pub use content::{Content, Hashing};
pub use error::ArtifactError;
pub use files::Artifacts;
pub use keys::{FilePlace, picture_file};
pub use orphans::SetAside;
pub use stream::Opened;

pub use crate::hash::sha256_hex;
