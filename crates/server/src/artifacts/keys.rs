//! Where files lie: the keys under which the storage has them, and what a key stands for.

use crate::api::jobs::PictureFormat;
use object_store::path::Path as Key;
use uuid::Uuid;

/// How the names of kept files end.
pub(super) const KEPT_ENDINGS: [&str; 2] = [".checkpoint", ".glb"];

/// The key of a file that is kept of a job beside its pictures.
pub(super) fn kept_key(job: Uuid, file: &str) -> Key {
    Key::from(format!("jobs/{job}/{file}"))
}

/// Where a picture is found over HTTP.
pub(super) fn picture_url(job: Uuid, sha256: &str, format: PictureFormat) -> String {
    format!("/v1/jobs/{job}/snapshots/{sha256}.{}", format.suffix())
}

/// The key of a scene's file.
pub(super) fn scene_key(id: &str) -> Key {
    Key::from(format!("scenes/{id}"))
}

/// The key of a picture's file.
pub(super) fn picture_key(job: Uuid, sha256: &str, format: PictureFormat) -> Key {
    Key::from(format!("jobs/{job}/{}", picture_file(sha256, format)))
}

/// The name of a picture's file in its job's folder.
pub fn picture_file(sha256: &str, format: PictureFormat) -> String {
    format!("{sha256}.{}", format.suffix())
}

/// Where a file belongs.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum FilePlace {
    /// A scene or a map of a sky, by its id.
    Scene(String),
    /// A file of a job, by its name.
    Job(Uuid, String),
}

impl FilePlace {
    /// Its key in the storage.
    pub(super) fn key(&self) -> Key {
        match self {
            Self::Scene(id) => scene_key(id),
            Self::Job(job, name) => Key::from(format!("jobs/{job}/{name}")),
        }
    }

    /// The path of the file in the folder of files.
    pub fn path(&self) -> String {
        self.key().to_string()
    }

    /// Where a path in the folder of files leads, if it is that of a scene or of a job's file.
    pub fn of(path: &str) -> Option<Self> {
        let mut parts = path.split('/');
        match (parts.next()?, parts.next()?, parts.next(), parts.next()) {
            ("scenes", id, None, None) => Some(Self::Scene(id.to_owned())),
            ("jobs", job, Some(name), None) => Some(Self::Job(job.parse().ok()?, name.to_owned())),
            _ => None,
        }
    }
}
