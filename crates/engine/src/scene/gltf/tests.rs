//! Imports of whole files.

use super::*;
use std::path::Path;

fn import_bytes(bytes: &[u8]) -> Result<Scene, SceneError> {
    import(bytes, &Resources::new(), &ImportLimits::default())
}

/// A scene of the folder that lies beside some checkouts; `None` where there is none.
fn shared_scene(name: &str) -> Option<Scene> {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../shared/scenes").join(name);
    let Ok(bytes) = std::fs::read(&path) else {
        println!("skipped: {} is not there", path.display());
        return None;
    };
    Some(import_bytes(&bytes).unwrap_or_else(|error| panic!("{name}: {error}")))
}

#[test]
fn living_room_imports() {
    let Some(scene) = shared_scene("living_room.glb") else { return };
    // 3,537 of the file's 5,088 triangles have no area: bevels of width 0.
    assert_eq!(scene.triangles.len(), 1551);
    let dropped: usize = scene
        .warnings
        .iter()
        .filter_map(|warning| warning.what.strip_suffix(" triangles without area are left out"))
        .map(|count| count.parse::<usize>().unwrap())
        .sum();
    assert_eq!(scene.triangles.len() + dropped, 5088);
    assert_eq!(scene.emissive_triangles(), 0);
    assert!(scene.cameras.is_empty());
}

#[test]
fn blender_cornell_box_imports() {
    let Some(scene) = shared_scene("cornell_uv2.glb") else { return };
    assert_eq!(scene.triangles.len(), 36);
    assert_eq!(scene.emissive_triangles(), 2);
    assert_eq!(scene.warnings, []);
}

#[test]
fn cubes_import_with_a_warning_about_their_light() {
    let Some(scene) = shared_scene("cubes.glb") else { return };
    assert_eq!(scene.triangles.len(), 36);
    let at: Vec<_> = scene.warnings.iter().map(|warning| warning.at.as_str()).collect();
    assert_eq!(at, ["nodes[0].extensions.KHR_lights_punctual", "materials"]);
}

#[test]
fn shared_cornell_box_imports() {
    let Some(scene) = shared_scene("cornell.glb") else { return };
    assert_eq!(scene.triangles.len(), 46);
    assert_eq!(scene.emissive_triangles(), 2);
    assert_eq!(scene.cameras.len(), 1);
    assert_eq!(scene.warnings, []);
}
