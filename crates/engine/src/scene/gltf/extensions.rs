//! The extensions of glTF that the import knows, and what it makes of each.

use super::document::clip;
use super::warnings::Warnings;
use crate::scene::SceneError;
use gltf::json::Root;
use std::fmt::Write as _;

/// What becomes of a file's use of an extension.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Support {
    /// It is shown as the extension says.
    Implemented,
    /// It is shown nearly so; what is lost or changed.
    Approximated(&'static str),
    /// It says nothing that a picture shows: names, metadata, behaviour, sound, or another way to
    /// store what the file has without it too.
    Unseen,
    /// A surface or an animation is shown without it, which is warned of there; what is lost.
    Ignored(&'static str),
    /// The whole file is shown without it, which is warned of once; what is lost.
    LeftOut(&'static str),
    /// A file that requires it is refused, as is geometry or a picture that is there in no other
    /// form; what the sender can do.
    Refused(&'static str),
}

/// An extension and what becomes of its use.
#[derive(Clone, Copy, Debug)]
pub struct Extension {
    /// Its name in files.
    pub name: &'static str,
    /// What becomes of it.
    pub support: Support,
}

const fn extension(name: &'static str, support: Support) -> Extension {
    Extension { name, support }
}

/// All of them, by name. Warnings, refusals and the table of docs/gltf.md are made of it.
pub const EXTENSIONS: &[Extension] = &[
    extension(
        "CESIUM_RTC",
        Support::LeftOut("the scene stands at its own origin, not at its place on the globe"),
    ),
    extension("CESIUM_primitive_outline", Support::LeftOut("outlines are left out")),
    extension("EXT_feature_metadata", Support::Unseen),
    extension("EXT_instance_features", Support::Unseen),
    extension(
        "EXT_lights_image_based",
        Support::LeftOut("the sky that the file names is ignored; name one as the sky"),
    ),
    extension("EXT_mesh_features", Support::Unseen),
    extension("EXT_mesh_gpu_instancing", Support::Implemented),
    extension("EXT_mesh_manifold", Support::Unseen),
    extension("EXT_mesh_polygon", Support::Unseen),
    extension("EXT_meshopt_compression", Support::Implemented),
    extension("EXT_structural_metadata", Support::Unseen),
    extension("EXT_texture_avif", Support::Refused("export textures as PNG, JPEG, WebP or KTX2")),
    extension("EXT_texture_webp", Support::Implemented),
    extension("FB_ngon_encoding", Support::Unseen),
    extension("GODOT_single_root", Support::Unseen),
    extension(
        "KHR_animation_pointer",
        Support::Ignored("only what the format itself animates is moved; all else is at rest"),
    ),
    extension("KHR_audio_emitter", Support::Unseen),
    extension("KHR_draco_mesh_compression", Support::Implemented),
    extension(
        "KHR_gaussian_splatting",
        Support::LeftOut("splats are no surfaces; they are left out"),
    ),
    extension(
        "KHR_gaussian_splatting_compression_spz_2",
        Support::LeftOut("splats are no surfaces; they are left out"),
    ),
    extension("KHR_implicit_shapes", Support::Unseen),
    extension("KHR_interactivity", Support::Unseen),
    extension("KHR_lights_punctual", Support::Implemented),
    extension("KHR_materials_anisotropy", Support::Implemented),
    extension(
        "KHR_materials_clearcoat",
        Support::Approximated(
            "what shines under a clear coat is dimmed alike in all directions, and what is clear (KHR_materials_transmission) has no coat",
        ),
    ),
    extension(
        "KHR_materials_diffuse_transmission",
        Support::Approximated(
            "what a body takes of light inside it (KHR_materials_volume) is ignored, as is the colour of a thin film over what passes",
        ),
    ),
    extension("KHR_materials_dispersion", Support::Implemented),
    extension("KHR_materials_emissive_strength", Support::Implemented),
    extension("KHR_materials_ior", Support::Implemented),
    extension(
        "KHR_materials_iridescence",
        Support::Approximated("what is clear (KHR_materials_transmission) has no film"),
    ),
    extension(
        "KHR_materials_pbrSpecularGlossiness",
        Support::Approximated(
            "specular-glossiness is shown as a dielectric whose reflection has the given colour; what is diffuse is weakened by what is reflected, channel by channel, instead of by the strongest channel, and roughness from a texture is rounded to 1/255",
        ),
    ),
    extension(
        "KHR_materials_sheen",
        Support::Approximated(
            "roughness of sheen below 0.2 is shown as 0.2, so that it does not send more light than it gets",
        ),
    ),
    extension("KHR_materials_specular", Support::Implemented),
    extension("KHR_materials_transmission", Support::Implemented),
    extension("KHR_materials_unlit", Support::Implemented),
    extension("KHR_materials_variants", Support::Implemented),
    extension(
        "KHR_materials_volume",
        Support::Approximated(
            "the thickness texture is ignored: light goes the way that the geometry gives it, but straight on through panes fifty times as wide as thick; a body that lies in one plane with something has air between",
        ),
    ),
    extension("KHR_mesh_quantization", Support::Implemented),
    extension("KHR_meshopt_compression", Support::Implemented),
    extension("KHR_node_hoverability", Support::Unseen),
    extension("KHR_node_selectability", Support::Unseen),
    extension("KHR_node_visibility", Support::Implemented),
    extension("KHR_physics_rigid_bodies", Support::Unseen),
    extension(
        "KHR_techniques_webgl",
        Support::Refused(
            "export materials as metallic-roughness ones; shaders in files are not run",
        ),
    ),
    extension("KHR_texture_basisu", Support::Implemented),
    extension("KHR_texture_transform", Support::Implemented),
    extension("KHR_xmp", Support::Unseen),
    extension("KHR_xmp_json_ld", Support::Unseen),
    extension("MOZ_hubs_components", Support::Unseen),
    extension("MSFT_lod", Support::Implemented),
    extension("MSFT_texture_dds", Support::Refused("export textures as PNG, JPEG, WebP or KTX2")),
    extension("VRM", Support::Unseen),
    extension(
        "VRMC_materials_mtoon",
        Support::Ignored("toon shading is ignored; the surface is lit like all others"),
    ),
    extension("VRMC_node_constraint", Support::Unseen),
    extension("VRMC_springBone", Support::Unseen),
    extension("VRMC_springBone_extended_collider", Support::Unseen),
    extension("VRMC_vrm", Support::Unseen),
];

/// What becomes of the extension of that name; `None` of an unknown one.
pub(super) fn support(name: &str) -> Option<Support> {
    EXTENSIONS.iter().find(|extension| extension.name == name).map(|extension| extension.support)
}

/// What the use of an extension loses; empty where nothing.
pub(super) fn loss(name: &str) -> &'static str {
    match support(name) {
        Some(Support::Approximated(loss) | Support::Ignored(loss)) => loss,
        _ => "",
    }
}

/// The table of docs/gltf.md.
pub fn extensions_as_markdown() -> String {
    let mut table = String::from("| extension | | what is lost, or what to do |\n|---|---|---|\n");
    for Extension { name, support } in EXTENSIONS {
        let (how, what) = match support {
            Support::Implemented => ("implemented", ""),
            Support::Approximated(loss) => ("approximated", *loss),
            Support::Unseen => ("nothing to be seen", ""),
            Support::Ignored(loss) | Support::LeftOut(loss) => ("ignored", *loss),
            Support::Refused(hint) => ("refused where required", *hint),
        };
        let end = if what.is_empty() { "" } else { " " };
        // Writing to a string cannot fail.
        let _ = writeln!(table, "| `{name}` | {how} | {what}{end}|");
    }
    table
}

/// Refuses files that require what is not there, and warns of unknown extensions and of those that
/// the whole file is shown without. What is lost of others is warned of where they are used.
pub(super) fn check(root: &Root, warnings: &mut Warnings) -> Result<(), SceneError> {
    for (index, name) in root.extensions_required.iter().enumerate() {
        let hint = match support(name) {
            Some(Support::Refused(hint)) => hint,
            Some(_) => continue,
            None => "export the scene without the extension",
        };
        return Err(SceneError::malformed(
            format!("extensionsRequired[{index}]"),
            format!("the file cannot be shown without {}, which is not supported", clip(name)),
            hint,
        ));
    }
    for (index, name) in root.extensions_used.iter().enumerate() {
        let what = match support(name) {
            None => format!("{} is not supported and ignored", clip(name)),
            Some(Support::LeftOut(loss)) => format!("{name}: {loss}"),
            Some(_) => continue,
        };
        warnings.push(format!("extensionsUsed[{index}]"), what);
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::path::Path;

    const BEGIN: &str = "<!-- generated: extensions -->\n";
    const END: &str = "<!-- end -->";

    /// What stands between the marks of a page.
    fn table(page: &str) -> Option<&str> {
        let (_, rest) = page.split_once(BEGIN)?;
        rest.split_once(END).map(|(table, _)| table)
    }

    #[test]
    fn the_page_has_the_table_of_the_code() {
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../docs/gltf.md");
        let page = std::fs::read_to_string(path).expect("docs/gltf.md is there");
        let made = extensions_as_markdown();
        assert!(made.lines().count() == EXTENSIONS.len() + 2);
        assert!(table(&page) == Some(&made), "put this between the marks of docs/gltf.md:\n{made}");
        assert!(table(&page.replace("| implemented |", "| planned |")) != Some(&made));
    }

    #[test]
    fn names_are_sorted_and_losses_are_said() {
        assert!(EXTENSIONS.is_sorted_by(|a, b| a.name < b.name));
        for Extension { name, support } in EXTENSIONS {
            if let Support::Approximated(what)
            | Support::Ignored(what)
            | Support::LeftOut(what)
            | Support::Refused(what) = support
            {
                assert!(what.len() > 10 && !what.contains('|'), "{name}");
            }
        }
    }
}
