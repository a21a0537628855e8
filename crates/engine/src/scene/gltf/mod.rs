//! glTF 2.0 / GLB import. The input is hostile: every index, offset and length is checked, no
//! URI leaves the upload, and memory is bounded by the size of the file and [`ImportLimits`].
//!
//! The way of the bytes: `container` (chunks, buffers, URIs; `meshopt` decompresses buffer views) →
//! `document` (the JSON part, typed and validated) → `draco` (decompresses primitives) → `accessor`
//! (typed reads) → `animation` and `pose` (what an animation moves) → `node`, `instancing` and
//! `lights` (what stands where), `material`, `textures`, `picture` and `ktx2` (surfaces) →
//! `attributes`, `morph`, `tangents` and `geometry` (shapes) → `skin` and `placing` (world-space
//! triangles) or `sharing` (meshes that are kept once for many instances). `extensions` lists what is known beyond the format's core.

mod accessor;
mod animation;
mod attributes;
mod baked;
mod choice;
mod container;
mod document;
mod draco;
mod extensions;
mod factors;
mod geometry;
mod instancing;
mod ktx2;
mod lights;
mod limits;
mod local;
mod material;
mod material_extensions;
mod material_layers;
mod meshopt;
mod morph;
mod node;
mod panes;
mod picture;
mod placing;
mod pose;
mod sharing;
mod skin;
mod tangents;
#[cfg(test)]
mod tests;
mod textures;
mod variants;
mod warnings;

pub use baked::BakedMesh;
pub use choice::Choice;
pub use extensions::{EXTENSIONS, Extension, Support, extensions_as_markdown};
pub use limits::{ImportLimits, ImportOptions, Resources};

use super::{Alpha, Scene, SceneError};
use warnings::Warnings;

/// Imports a `.glb` (or a `.gltf` with its `resources`).
///
/// The default scene is shown, or else the first. Triangles face front by their winding; every
/// vertex normal lies on the front side of the triangles that use it; those of a mesh that instances
/// share do in the mesh's own space. A camera and a light have
/// their node's name, or else their own.
///
/// # Errors
/// [`SceneError`] names the place in the file, what is wrong there and what to do.
pub fn import(
    bytes: &[u8],
    resources: &Resources,
    limits: &ImportLimits,
) -> Result<Scene, SceneError> {
    import_with(bytes, resources, &ImportOptions { limits: *limits, ..ImportOptions::default() })
}

/// As [`import`], with everything that can be asked for.
///
/// # Errors
/// As [`import`], and where the file has no variant, scene or animation of the name asked for.
pub fn import_with(
    bytes: &[u8],
    resources: &Resources,
    options: &ImportOptions,
) -> Result<Scene, SceneError> {
    let mut warnings = Warnings::default();
    let (json, binary) = container::open(bytes, &mut warnings)?;
    let mut document = document::read(&json)?;
    let animations = std::mem::take(&mut document.animations);
    extensions::check(&document.root, &mut warnings)?;
    let mut buffers = container::Buffers::new(&document.root, binary, resources, &options.limits)?;
    let made = draco::decompress(&mut document.root, &mut buffers, &options.limits, &mut warnings)?;
    let root = &document.root;
    let variants = variants::Variants::new(root, options.variant.as_deref())?;
    let accessors = accessor::accessors(root, &buffers, &made)?;
    let animations = animation::read(animations, root)?;
    let posed = pose::Posed { root, accessors: &accessors, animations: &animations };
    let pose = posed.chosen(options.animation.as_ref(), options.time, &mut warnings)?;
    let scene = options.scene.as_ref();
    let graph = node::Graph { root, accessors: &accessors, pose: &pose, scene };
    let placed = node::place(graph, &mut warnings)?;
    let skins = skin::matrices(root, &accessors, &placed.worlds, &placed.instances)?;

    let mut images = picture::Images::new(root, &buffers, resources, &options.limits);
    let materials = material::materials(&document, &mut images, &mut warnings)?;
    let (lights, cameras) = (placed.lights, placed.cameras);
    let mut scene = Scene { materials, lights, cameras, ..Scene::default() };
    let geometry = geometry::Geometry {
        root,
        accessors: &accessors,
        instances: &placed.instances,
        skins: &skins,
        pose: &pose,
        more_targets: &document.more_targets,
        variants: &variants,
    };
    geometry.build(&options.limits, &mut scene, &mut warnings)?;
    close_holes(&mut scene, &images);
    panes::straighten(&mut scene);
    scene.part_touching();
    scene.textures = images.textures;
    scene.variants = variants::Variants::names(root);
    scene.animations = animation::names(&animations, &accessors);
    scene.scenes = root.scenes.iter().map(|scene| scene.name.clone()).collect();
    if scene.triangle_count() == 0 {
        warnings.push("meshes", "there is no triangle to be seen");
    }
    scene.warnings = warnings.finish();
    Ok(scene)
}

/// Makes materials opaque whose alpha leaves no hole anywhere: many exporters call everything
/// blended, and light passes what is opaque faster.
fn close_holes(scene: &mut Scene, images: &picture::Images<'_>) {
    let mut least = vec![1.0f32; scene.materials.len()];
    for triangle in scene.unique_triangles().map(|index| scene.triangle(index)) {
        let least = &mut least[triangle.material as usize];
        let alphas = scene.of_sources(&triangle, |vertex| vertex.alpha);
        *least = alphas.into_iter().fold(*least, f32::min);
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
