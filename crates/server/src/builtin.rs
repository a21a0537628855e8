//! Scenes that come with the program.

use crate::hash::sha256_hex;
use std::collections::HashMap;
use std::sync::OnceLock;

/// Names and files.
const SCENES: &[(&str, &[u8])] = &[
    ("cornell", include_bytes!("../../../scenes/cornell.glb")),
    ("cornell_phong", include_bytes!("../../../scenes/cornell_phong.glb")),
    ("corridor", include_bytes!("../../../scenes/corridor.glb")),
    ("furnace", include_bytes!("../../../scenes/furnace.glb")),
    ("glass", include_bytes!("../../../scenes/glass.glb")),
    ("office", include_bytes!("../../../scenes/office.glb")),
    ("ring", include_bytes!("../../../scenes/ring.glb")),
];

/// The `.glb` file of that built-in scene.
pub fn scene(name: &str) -> Option<&'static [u8]> {
    SCENES.iter().find(|(known, _)| *known == name).map(|(_, bytes)| *bytes)
}

/// The name of the built-in scene whose content has that hash.
pub fn name_of(id: &str) -> Option<&'static str> {
    static NAMES: OnceLock<HashMap<String, &'static str>> = OnceLock::new();
    let names = NAMES
        .get_or_init(|| SCENES.iter().map(|(name, bytes)| (sha256_hex(bytes), *name)).collect());
    names.get(id).copied()
}

/// Names of the built-in scenes.
pub fn names() -> Vec<&'static str> {
    SCENES.iter().map(|(name, _)| *name).collect()
}
