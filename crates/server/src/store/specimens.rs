//! What tests of several modules put into stores and among files.

use super::jobs::NewJob;
use super::keys::Submitter;
use crate::api::environments::{EnvironmentMap, MapFormat};
use crate::api::request_hash::RequestHash;
use crate::api::scenes::{Scene, SceneFormat};
use crate::hash::sha256_hex;
use uuid::Uuid;

/// The record of a scene whose file has this content.
pub fn scene(content: &[u8]) -> Scene {
    Scene {
        id: sha256_hex(content),
        name: None,
        format: SceneFormat::Gltf,
        size: content.len() as u64,
        created_at: jiff::Timestamp::now(),
        triangles: 1,
        vertices: 3,
        materials: 1,
        textures: 0,
        lights: 0,
        bounds: None,
        cameras: Vec::new(),
        variants: None,
        animations: None,
        gltf_scenes: None,
        kept_triangles: None,
        warnings: Vec::new(),
    }
}

/// The record of a map of a sky whose file has this content.
pub fn map(content: &[u8]) -> EnvironmentMap {
    EnvironmentMap {
        id: sha256_hex(content),
        name: None,
        format: MapFormat::Exr,
        size: content.len() as u64,
        created_at: jiff::Timestamp::now(),
        width: 2,
        height: 1,
        mean: [1.0; 3],
    }
}

/// A job about that scene, as all defaults have it, of nobody in particular.
pub fn job(scene_id: &str) -> NewJob {
    NewJob {
        id: Uuid::now_v7(),
        scene_id: scene_id.into(),
        request: serde_json::from_str("{}").expect("all members have defaults"),
        idempotency_key: None,
        request_hash: RequestHash::default(),
        submitter: Submitter::default(),
        render_key: None,
    }
}
