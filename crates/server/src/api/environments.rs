//! Maps of skies as the API shows them.

use super::instant;
use super::uploads::Upload;
use jiff::Timestamp;
use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

/// How the stored bytes of a map are to be read.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum MapFormat {
    /// OpenEXR.
    Exr,
    /// Radiance HDR.
    Hdr,
}

/// A stored map of a sky: radiance by direction, equirectangular. The top row is straight up (+Y);
/// the middle of the map looks along +X, and columns go on towards +Z.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct EnvironmentMap {
    /// SHA-256 of the stored bytes, in hex; the same upload always gets the same id.
    #[schema(example = "5feceb66ffc86f38d952786c6d696c79c2dbc239dd4e91b46729d73a27fb57e9")]
    pub id: String,
    /// What whoever asks calls it.
    #[serde(default)]
    #[schema(required, max_length = 255, example = "meadow.exr")]
    pub name: Option<String>,
    /// How it was sent.
    pub format: MapFormat,
    /// Stored bytes.
    #[schema(minimum = 0)]
    pub size: u64,
    /// When whoever asks first sent it. (Who sees everyone's maps sees when it was first stored.)
    #[schema(value_type = String, format = DateTime)]
    #[serde(serialize_with = "instant::serialize")]
    pub created_at: Timestamp,
    /// Texels around.
    pub width: u32,
    /// Texels from straight up to straight down.
    pub height: u32,
    /// Mean linear RGB radiance over all directions: a job's `scale` of 1 / this makes it 1.
    pub mean: [f32; 3],
}

impl Upload for EnvironmentMap {
    const KIND: &'static str = "environment";

    fn id(&self) -> &str {
        &self.id
    }

    fn size(&self) -> u64 {
        self.size
    }

    fn created_at(&self) -> Timestamp {
        self.created_at
    }

    fn seen_as(self, name: Option<String>, created_at: Timestamp) -> Self {
        Self { name, created_at, ..self }
    }
}

/// One page of maps, newest first.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct EnvironmentPage {
    /// The maps.
    pub environments: Vec<EnvironmentMap>,
    /// Give this as `cursor` for the next page; `null` on the last one.
    #[schema(required)]
    pub next_cursor: Option<String>,
}
