//! glTF 2.0 / GLB import. The input is hostile: every index, offset and length is checked, no
//! URI leaves the upload, and memory is bounded by the size of the file and [`ImportLimits`].
//!
//! The way of the bytes: `container` (chunks, buffers, URIs) → `document` (the JSON part,
//! typed and validated) → `accessor` (typed reads) → `node` (what stands where), `material` and
//! `picture` (surfaces) → `geometry` (world-space triangles).

mod accessor;
mod baked;
mod container;
mod document;
mod geometry;
mod limits;
mod material;
mod node;
mod picture;
#[cfg(test)]
mod tests;
mod warnings;

pub use baked::BakedMesh;
pub use limits::{ImportLimits, Resources};

use super::{Scene, SceneError};
use document::clip;
use gltf::json::Root;
use warnings::Warnings;

/// Extensions that a file may require; what is lost of them, if anything, is warned of in place.
const KNOWN_EXTENSIONS: &[&str] = &[
    "EXT_texture_webp",
    "KHR_lights_punctual",
    "KHR_materials_anisotropy",
    "KHR_materials_clearcoat",
    "KHR_materials_diffuse_transmission",
    "KHR_materials_dispersion",
    "KHR_materials_emissive_strength",
    "KHR_materials_ior",
    "KHR_materials_iridescence",
    "KHR_materials_sheen",
    "KHR_materials_specular",
    "KHR_materials_transmission",
    "KHR_materials_unlit",
    "KHR_materials_volume",
    "KHR_mesh_quantization",
    "KHR_texture_transform",
    "KHR_xmp_json_ld",
];

/// Extensions without which a file can be shown, but not one that requires them; each use is
/// warned of in place or does not change the picture.
const OPTIONAL_EXTENSIONS: &[&str] = &[
    "EXT_mesh_gpu_instancing",
    "EXT_meshopt_compression",
    "KHR_draco_mesh_compression",
    "KHR_materials_pbrSpecularGlossiness",
];

/// What to do about some required extensions.
const EXTENSION_HINTS: &[(&str, &str)] = &[
    ("KHR_draco_mesh_compression", "export the scene without Draco mesh compression"),
    ("EXT_meshopt_compression", "export the scene without meshopt compression"),
    ("KHR_meshopt_compression", "export the scene without meshopt compression"),
    ("KHR_texture_basisu", "export textures as PNG, JPEG or WebP instead of KTX2"),
    ("EXT_texture_avif", "export textures as PNG, JPEG or WebP"),
    ("EXT_mesh_gpu_instancing", "export instances as nodes that share a mesh"),
    ("KHR_materials_pbrSpecularGlossiness", "convert the materials to metallic-roughness"),
];

/// Imports a `.glb` (or a `.gltf` with its `resources`).
///
/// The default scene is shown, or else the first. Triangles face front by their winding; every
/// vertex normal lies on the front side of the triangles that use it. A camera has its node's
/// name, or else its own.
///
/// # Errors
/// [`SceneError`] names the place in the file, what is wrong there and what to do.
pub fn import(
    bytes: &[u8],
    resources: &Resources,
    limits: &ImportLimits,
) -> Result<Scene, SceneError> {
    let mut warnings = Warnings::default();
    let (json, binary) = container::open(bytes, &mut warnings)?;
    let root = document::read(&json)?;
    check_extensions(&root, &mut warnings)?;
    let buffers = container::Buffers::new(&root, binary, resources)?;
    let accessors = accessor::accessors(&root, &buffers)?;
    let placed = node::place(&root, &mut warnings)?;

    let mut images = picture::Images::new(&root, &buffers, resources, limits);
    let materials = material::materials(&root, &mut images, &mut warnings)?;
    let mut scene =
        Scene { materials, textures: images.textures, cameras: placed.cameras, ..Scene::default() };
    let geometry =
        geometry::Geometry { root: &root, accessors: &accessors, instances: &placed.instances };
    geometry.build(limits, &mut scene, &mut warnings)?;
    if !root.animations.is_empty() {
        warnings.push("animations", "are ignored; everything is shown at rest");
    }
    if scene.triangles.is_empty() {
        warnings.push("meshes", "there is no triangle to be seen; pictures will be black");
    } else if scene.emissive_triangles() == 0 {
        warnings.push("materials", "no surface emits light; pictures will be black without a sky");
    }
    scene.warnings = warnings.finish();
    Ok(scene)
}

fn check_extensions(root: &Root, warnings: &mut Warnings) -> Result<(), SceneError> {
    for (index, name) in root.extensions_required.iter().enumerate() {
        if KNOWN_EXTENSIONS.contains(&name.as_str()) {
            continue;
        }
        let hint = EXTENSION_HINTS.iter().find(|(known, _)| known == name);
        return Err(SceneError::malformed(
            format!("extensionsRequired[{index}]"),
            format!("the file cannot be shown without {}, which is not supported", clip(name)),
            hint.map_or("export the scene without the extension", |(_, hint)| hint),
        ));
    }
    for (index, name) in root.extensions_used.iter().enumerate() {
        if !KNOWN_EXTENSIONS.contains(&name.as_str())
            && !OPTIONAL_EXTENSIONS.contains(&name.as_str())
        {
            warnings.push(
                format!("extensionsUsed[{index}]"),
                format!("{} is not supported and ignored", clip(name)),
            );
        }
    }
    Ok(())
}
