//! Scenes as the API shows them.

use super::{Warning, instant};
use jiff::Timestamp;
use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

/// How the stored bytes of a scene are to be read.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum SceneFormat {
    /// One glTF file, binary or JSON.
    Gltf,
    /// A glTF file with the resources that it names, packed together.
    Bundle,
}

/// A stored scene.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct Scene {
    /// SHA-256 of the stored bytes, in hex; the same upload always gets the same id.
    #[schema(example = "9f86d081884c7d659a2feaa0c55ad015a3bf4f1b2b0b822cd15d6c15b0f00a08")]
    pub id: String,
    /// How it was sent.
    pub format: SceneFormat,
    /// Stored bytes.
    #[schema(minimum = 0)]
    pub size: u64,
    /// When it was first stored.
    #[schema(value_type = String, format = DateTime)]
    #[serde(serialize_with = "instant::serialize")]
    pub created_at: Timestamp,
    /// Triangles after instancing.
    pub triangles: u64,
    /// Vertices after instancing.
    pub vertices: u64,
    /// Materials.
    pub materials: u64,
    /// Decoded textures.
    pub textures: u64,
    /// Triangles that emit light.
    pub lights: u64,
    /// Box around all triangles; `null` without triangles.
    #[schema(required)]
    pub bounds: Option<Bounds>,
    /// Cameras in node order.
    pub cameras: Vec<CameraName>,
    /// What was approximated or ignored.
    pub warnings: Vec<Warning>,
}

/// An axis-aligned box, metres.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct Bounds {
    /// Smallest corner.
    pub min: [f32; 3],
    /// Largest corner.
    pub max: [f32; 3],
}

/// A camera that a job can name.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct CameraName {
    /// Position in the file.
    pub index: u32,
    /// Name in the file, or a made-up one.
    #[schema(example = "front")]
    pub name: String,
}

/// One page of scenes, newest first.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct ScenePage {
    /// The scenes.
    pub scenes: Vec<Scene>,
    /// Give this as `cursor` for the next page; `null` on the last one.
    #[schema(required)]
    pub next_cursor: Option<String>,
}
