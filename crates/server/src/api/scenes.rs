//! Scenes as the API shows them.

use super::parts::{AnimationName, SceneName};
use super::uploads::Upload;
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
    /// What whoever asks calls it: the name of the file that they sent, or of the built-in scene.
    #[serde(default)]
    #[schema(required, max_length = 255, example = "atrium.glb")]
    pub name: Option<String>,
    /// How it was sent.
    pub format: SceneFormat,
    /// Stored bytes.
    #[schema(minimum = 0)]
    pub size: u64,
    /// When whoever asks first sent or used it. (Who sees everyone's scenes sees when it was
    /// first stored.)
    #[schema(value_type = String, format = DateTime)]
    #[serde(serialize_with = "instant::serialize")]
    pub created_at: Timestamp,
    /// Triangles after instancing.
    pub triangles: u64,
    /// Triangles that take memory where instances share meshes: those of a shared mesh count once, and
    /// each of its instances as two; `null` of scenes that were stored by a release that did not
    /// look.
    #[serde(default)]
    #[schema(required)]
    pub kept_triangles: Option<u64>,
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
    /// Names of the sets of materials that a job can choose from as `variant`; `null` of scenes that
    /// were stored by a release that did not look.
    #[serde(default)]
    #[schema(required)]
    pub variants: Option<Vec<String>>,
    /// Animations that a job can choose from as `animation`; `null` of scenes that were stored by a
    /// release that did not look.
    #[serde(default)]
    #[schema(required)]
    pub animations: Option<Vec<AnimationName>>,
    /// Scenes of the file that a job can choose from as `gltf_scene`; `null` of scenes that were
    /// stored by a release that did not look.
    #[serde(default)]
    #[schema(required)]
    pub gltf_scenes: Option<Vec<SceneName>>,
    /// What was approximated or ignored.
    pub warnings: Vec<Warning>,
}

impl Upload for Scene {
    const KIND: &'static str = "scene";

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

/// Longest name of a scene, characters.
pub const MAX_NAME_CHARS: usize = 255;

/// What a scene may be called after a file: without folders, without what cannot be seen, and not
/// too long; nothing where nothing is left.
pub fn name_of_file(path: &str) -> Option<String> {
    let name = path.rsplit(['/', '\\']).next().unwrap_or("");
    // Control characters, and what turns the direction of the text around it.
    let is_hidden = |c: char| {
        c.is_control()
            || matches!(c, '\u{200b}'..='\u{200f}' | '\u{2028}'..='\u{202e}' | '\u{2066}'..='\u{2069}' | '\u{feff}')
    };
    let name: String = name.chars().filter(|c| !is_hidden(*c)).collect();
    let name: String = name.trim().chars().take(MAX_NAME_CHARS).collect();
    (!name.is_empty()).then_some(name)
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_what_can_be_read_of_file_names() {
        for (path, name) in [
            ("atrium.glb", "atrium.glb"),
            ("C:\\scenes\\my room.gltf", "my room.gltf"),
            ("/home/ann/x.glb", "x.glb"),
            (" a\u{0}b\u{1b}[31m\u{202e}c\n ", "ab[31mc"),
            ("Küche 厨房.glb", "Küche 厨房.glb"),
        ] {
            assert_eq!(name_of_file(path).as_deref(), Some(name), "{path:?}");
        }
        for nothing in ["", "/", "a/", "\u{1}\u{2}", "  "] {
            assert_eq!(name_of_file(nothing), None, "{nothing:?}");
        }
        assert_eq!(name_of_file(&"ä".repeat(1000)).unwrap().chars().count(), MAX_NAME_CHARS);
    }
}
