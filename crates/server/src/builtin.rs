//! Scenes that come with the program.

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

/// Names of the built-in scenes.
pub fn names() -> Vec<&'static str> {
    SCENES.iter().map(|(name, _)| *name).collect()
}
