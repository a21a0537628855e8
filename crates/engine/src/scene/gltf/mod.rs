//! glTF 2.0 / GLB import. The input is hostile: every index, offset and length is checked, no
//! URI leaves the upload, and memory is bounded by the size of the file and [`ImportLimits`].
//!
//! The way of the bytes: `container` (chunks, buffers, URIs; `meshopt` decompresses buffer views) →
//! `document` (the JSON part, typed and validated) → `draco` (decompresses primitives) → `accessor`
//! (typed reads) → `node` and `lights` (what stands where),
//! `material`, `textures`, `picture` and `ktx2` (surfaces) → `attributes`, `tangents` and `geometry`
//! (world-space triangles). `extensions` lists what is known beyond the format's core.

mod accessor;
mod attributes;
mod baked;
mod container;
mod document;
mod draco;
mod extensions;
mod factors;
mod geometry;
mod ktx2;
mod lights;
mod limits;
mod local;
mod material;
mod material_extensions;
mod meshopt;
mod node;
mod picture;
mod tangents;
#[cfg(test)]
mod tests;
mod textures;
mod variants;
mod warnings;

pub use baked::BakedMesh;
pub use extensions::{EXTENSIONS, Extension, Support, extensions_as_markdown};
pub use limits::{ImportLimits, ImportOptions, Resources};

use super::{Alpha, Scene, SceneError};
use warnings::Warnings;

/// Imports a `.glb` (or a `.gltf` with its `resources`).
///
/// The default scene is shown, or else the first. Triangles face front by their winding; every
/// vertex normal lies on the front side of the triangles that use it. A camera and a light have
/// their node's name, or else their own.
///
/// # Errors
/// [`SceneError`] names the place in the file, what is wrong there and what to do.
pub fn import(
    bytes: &[u8],
    resources: &Resources,
    limits: &ImportLimits,
) -> Result<Scene, SceneError> {
    import_with(bytes, resources, &ImportOptions { limits: *limits, variant: None })
}

/// As [`import`], with everything that can be asked for.
///
/// # Errors
/// As [`import`], and where the file has no variant of the name asked for.
pub fn import_with(
    bytes: &[u8],
    resources: &Resources,
    options: &ImportOptions,
) -> Result<Scene, SceneError> {
    let mut warnings = Warnings::default();
    let (json, binary) = container::open(bytes, &mut warnings)?;
    let mut document = document::read(&json)?;
    extensions::check(&document.root, &mut warnings)?;
    let mut buffers = container::Buffers::new(&document.root, binary, resources, &options.limits)?;
    let made = draco::decompress(&mut document.root, &mut buffers, &options.limits, &mut warnings)?;
    let root = &document.root;
    let variants = variants::Variants::new(root, options.variant.as_deref())?;
    let accessors = accessor::accessors(root, &buffers, &made)?;
    let placed = node::place(root, &mut warnings)?;

    let mut images = picture::Images::new(root, &buffers, resources, &options.limits);
    let materials = material::materials(&document, &mut images, &mut warnings)?;
    let (lights, cameras) = (placed.lights, placed.cameras);
    let mut scene = Scene { materials, lights, cameras, ..Scene::default() };
    let geometry = geometry::Geometry {
        root,
        accessors: &accessors,
        instances: &placed.instances,
        variants: &variants,
    };
    geometry.build(&options.limits, &mut scene, &mut warnings)?;
    close_holes(&mut scene, &images);
    scene.textures = images.textures;
    scene.variants = variants::Variants::names(root);
    if !root.animations.is_empty() {
        warnings.push("animations", "are ignored; everything is shown at rest");
    }
    if scene.triangles.is_empty() {
        warnings.push("meshes", "there is no triangle to be seen");
    }
    scene.warnings = warnings.finish();
    Ok(scene)
}

/// Makes materials opaque whose alpha leaves no hole anywhere: many exporters call everything
/// blended, and light passes what is opaque faster.
fn close_holes(scene: &mut Scene, images: &picture::Images<'_>) {
    let mut least = vec![1.0f32; scene.materials.len()];
    for triangle in &scene.triangles {
        let least = &mut least[triangle.material as usize];
        for vertex in triangle.vertices {
            *least = least.min(scene.vertices[vertex as usize].alpha);
        }
    }
    for (material, least) in scene.materials.iter_mut().zip(least) {
        let texture = material.base_color_texture.filter(|_| material.has_holes());
        let texel = texture.map_or(1.0, |slot| images.least_alpha(slot.texture));
        let alpha = material.opacity * least * texel;
        let closed = match material.alpha {
            Alpha::Opaque => true,
            Alpha::Mask { cutoff } => alpha >= cutoff,
            Alpha::Blend => alpha >= 1.0,
        };
        if closed {
            material.alpha = Alpha::Opaque;
        }
    }
}
