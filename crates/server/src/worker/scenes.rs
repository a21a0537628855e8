//! Scene files to scenes, and files of maps of skies to maps.

use crate::api::Warning;
use crate::api::environments::{EnvironmentMap, MapFormat};
use crate::api::jobs::JobRequest;
use crate::api::parts::{AnimationName, PartRequest, SceneName};
use crate::api::scenes::{Bounds, CameraName, Scene, SceneFormat};
use crate::bundle;
use hemilux_engine::scene;
use hemilux_engine::scene::gltf::{Choice, ImportLimits, ImportOptions, Resources, import_with};
use hemilux_engine::scene::sky_map::SkyMap;
use serde::{Deserialize, Serialize};
use std::io::{self, Read};
use std::panic::{AssertUnwindSafe, catch_unwind};

/// Why a scene cannot be used.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct SceneRefusal {
    /// Where in the file.
    pub at: String,
    /// What is wrong.
    pub what: String,
    /// What the sender can do.
    pub fix: String,
    /// Whether a limit is the reason.
    pub too_large: bool,
}

impl std::fmt::Display for SceneRefusal {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{}: {}; {}", self.at, self.what, self.fix)
    }
}

impl std::error::Error for SceneRefusal {}

impl SceneRefusal {
    fn damaged(what: impl Into<String>, fix: &str) -> Self {
        Self { at: "file".into(), what: what.into(), fix: fix.into(), too_large: false }
    }
}

/// What is asked of an import: so many triangles at most, and what a job wants to see of the file;
/// without a job the file as it is at rest.
pub fn options(max_triangles: usize, job: Option<&JobRequest>) -> ImportOptions {
    let limits = ImportLimits { max_triangles, ..ImportLimits::default() };
    let at_rest = ImportOptions { limits, ..ImportOptions::default() };
    let Some(job) = job else { return at_rest };
    ImportOptions {
        variant: job.variant.clone(),
        scene: job.gltf_scene.as_ref().map(choice),
        animation: job.animation.as_ref().map(choice),
        time: job.time.unwrap_or(0.0),
        ..at_rest
    }
}

fn choice(part: &PartRequest) -> Choice {
    match part {
        PartRequest::Index(index) => Choice::Index(*index),
        PartRequest::Name(name) => Choice::Name(name.clone()),
    }
}

/// Imports a file with the resources that came with it.
///
/// # Errors
/// As [`load`].
pub fn load_file(
    main: &[u8],
    resources: &Resources,
    options: &ImportOptions,
) -> Result<scene::Scene, SceneRefusal> {
    guarded(|| import_with(main, resources, options).map_err(refusal))
}

/// Relative URIs that a file names, as written; none where it is not glTF.
pub fn resource_names(main: &[u8]) -> Vec<String> {
    let json = binary_json(main).unwrap_or(main);
    let Ok(document) = serde_json::from_slice::<serde_json::Value>(json) else { return Vec::new() };
    ["buffers", "images"]
        .iter()
        .filter_map(|list| document.get(list)?.as_array())
        .flatten()
        .filter_map(|entry| entry.get("uri")?.as_str())
        .filter(|uri| !uri.contains(':'))
        .map(str::to_owned)
        .collect()
}

/// The JSON chunk of a .glb, which is its first one; `None` of any other file.
fn binary_json(main: &[u8]) -> Option<&[u8]> {
    const HEADER_BYTES: usize = 12;
    let chunk = main.strip_prefix(b"glTF").and_then(|_| main.get(HEADER_BYTES..))?;
    let (length, rest) =
        chunk.split_first_chunk().map(|(n, rest)| (u32::from_le_bytes(*n), rest))?;
    rest.strip_prefix(b"JSON")?.get(..length as usize)
}

/// Imports a scene. The importer reads hostile input: should it ever panic, that refuses the
/// scene and nothing else.
///
/// # Errors
/// [`SceneRefusal`] says where, what and what to do.
pub fn load(
    format: SceneFormat,
    bytes: &[u8],
    options: &ImportOptions,
) -> Result<scene::Scene, SceneRefusal> {
    guarded(|| match format {
        SceneFormat::Gltf => import_with(bytes, &Resources::new(), options).map_err(refusal),
        SceneFormat::Bundle => match bundle::unpack(bytes) {
            Some((main, resources)) => import_with(main, &resources, options).map_err(refusal),
            None => Err(damaged_bundle()),
        },
    })
}

/// As [`load`], of a scene that is read rather than held; each of its files is in memory once.
///
/// # Errors
/// Where it cannot be read; inside, as [`load`].
pub fn load_from(
    from: &mut impl Read,
    format: SceneFormat,
    options: &ImportOptions,
) -> io::Result<Result<scene::Scene, SceneRefusal>> {
    let (main, resources) = match format {
        SceneFormat::Gltf => {
            let mut main = Vec::new();
            from.read_to_end(&mut main)?;
            (main, Resources::new())
        }
        SceneFormat::Bundle => match bundle::read(from)? {
            Some(parts) => parts,
            None => return Ok(Err(damaged_bundle())),
        },
    };
    Ok(guarded(|| import_with(&main, &resources, options).map_err(refusal)))
}

fn damaged_bundle() -> SceneRefusal {
    SceneRefusal::damaged("the stored bundle is damaged", "send it again")
}

fn guarded(
    import: impl FnOnce() -> Result<scene::Scene, SceneRefusal>,
) -> Result<scene::Scene, SceneRefusal> {
    catch_unwind(AssertUnwindSafe(import)).unwrap_or_else(|panic| {
        let text = crate::panic_text(&*panic);
        tracing::error!(panic = text, "the importer panicked");
        let fix = "the file is probably damaged; check it with a glTF validator";
        Err(SceneRefusal::damaged(format!("the importer failed: {text}"), fix))
    })
}

fn refusal(error: scene::SceneError) -> SceneRefusal {
    let scene::SceneError { at, what, fix, too_large } = error;
    SceneRefusal { at, what, fix, too_large }
}

/// What a scene of so many stored bytes holds.
pub fn describe(id: String, format: SceneFormat, size: u64, scene: &scene::Scene) -> Scene {
    let cameras = scene.cameras.iter().zip(0..);
    let bounds = scene.bounds();
    Scene {
        id,
        name: None,
        format,
        size,
        created_at: crate::clock::now(),
        triangles: scene.triangles.len() as u64,
        vertices: scene.vertices.len() as u64,
        materials: scene.materials.len() as u64,
        textures: scene.textures.len() as u64,
        lights: scene.emissive_triangles() as u64,
        bounds: bounds.map(|(min, max)| Bounds { min: min.to_array(), max: max.to_array() }),
        cameras: cameras
            .map(|(camera, index)| CameraName { index, name: camera.name.clone() })
            .collect(),
        variants: Some(scene.variants.clone()),
        animations: Some(animations(scene)),
        gltf_scenes: Some(gltf_scenes(scene)),
        warnings: scene.warnings.iter().map(warning).collect(),
    }
}

fn animations(scene: &scene::Scene) -> Vec<AnimationName> {
    let animations = scene.animations.iter().zip(0..);
    let named = animations.map(|(animation, index)| AnimationName {
        index,
        name: animation.name.clone(),
        seconds: animation.seconds,
    });
    named.collect()
}

fn gltf_scenes(scene: &scene::Scene) -> Vec<SceneName> {
    let scenes = scene.scenes.iter().zip(0..);
    scenes.map(|(name, index)| SceneName { index, name: name.clone() }).collect()
}

/// The map of a sky in a file. The decoder reads hostile input and answers for itself.
///
/// # Errors
/// [`SceneRefusal`] says what is wrong and what to do.
pub fn load_map(bytes: &[u8]) -> Result<SkyMap, SceneRefusal> {
    SkyMap::decode(bytes).map_err(refusal)
}

/// What a map's file holds.
///
/// # Errors
/// As [`load_map`].
pub fn describe_map(id: String, bytes: &[u8]) -> Result<EnvironmentMap, SceneRefusal> {
    /// How OpenEXR files begin; the others are Radiance HDR.
    const EXR: [u8; 4] = [0x76, 0x2f, 0x31, 0x01];
    let map = load_map(bytes)?;
    Ok(EnvironmentMap {
        id,
        name: None,
        format: if bytes.starts_with(&EXR) { MapFormat::Exr } else { MapFormat::Hdr },
        size: bytes.len() as u64,
        created_at: crate::clock::now(),
        width: map.width(),
        height: map.height(),
        mean: map.mean().to_array(),
    })
}

/// An engine's warning in the API's words.
pub fn warning(warning: &scene::Warning) -> Warning {
    Warning { at: warning.at.clone(), what: warning.what.clone() }
}
