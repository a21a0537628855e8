//! Scenes that others made, which lie beside some checkouts: they import as they are, and the made
//! Cornell box is the one among them.

use glam::Vec3;
use hemilux_engine::scene::gltf::{ImportLimits, Resources, import};
use hemilux_engine::scene::{Scene, made};
use hemilux_tests::skips::shared_or_skip;

fn imported(name: &str, glb: &[u8]) -> Scene {
    import(glb, &Resources::new(), &ImportLimits::default())
        .unwrap_or_else(|error| panic!("{name}: {error}"))
}

fn shared_scene(name: &str) -> Option<Scene> {
    let [glb] = shared_or_skip([&*format!("scenes/{name}")])?;
    Some(imported(name, &glb))
}

#[test]
fn living_room_imports() {
    let Some(scene) = shared_scene("living_room.glb") else { return };
    // 3,537 of the file's 5,088 triangles have no area: bevels of width 0.
    assert_eq!(scene.triangles.len(), 1551);
    let left_out = " triangles without area are left out";
    let counts = scene.warnings.iter().filter_map(|warning| warning.what.strip_suffix(left_out));
    let dropped: usize = counts.map(|count| count.parse::<usize>().unwrap()).sum();
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
fn cubes_import_with_their_light() {
    let Some(scene) = shared_scene("cubes.glb") else { return };
    assert_eq!(scene.triangles.len(), 36);
    assert_eq!(scene.warnings, []);
    assert_eq!(scene.lights.len(), 1);
}

#[test]
fn cornell_box_imports() {
    let Some(scene) = shared_scene("cornell.glb") else { return };
    assert_eq!(scene.triangles.len(), 46);
    assert_eq!(scene.emissive_triangles(), 2);
    assert_eq!(scene.cameras.len(), 1);
    assert_eq!(scene.warnings, []);
}

/// A triangle's corners, its diffuse reflectance and its emission, in units of 10⁻⁵.
type Surface = ([[i64; 3]; 3], [i64; 3], [i64; 3]);

/// Triangles with their surfaces in an order that neither that of the file nor that of the
/// corners shows in.
fn surfaces(scene: &Scene) -> Vec<Surface> {
    let rounded = |v: Vec3| v.to_array().map(|x| (f64::from(x) * 1e5).round() as i64);
    let surface = |triangle| {
        let mut corners = scene.corners(triangle).map(rounded);
        let first = (0..3).min_by_key(|i| corners[*i]).unwrap_or(0);
        corners.rotate_left(first);
        let material = &scene.materials[triangle.material as usize];
        let diffuse = material.reflectance(&material.appearance(material.base_color)).diffuse;
        (corners, rounded(diffuse), rounded(material.emission))
    };
    let mut list: Vec<_> = scene.triangles.iter().map(surface).collect();
    list.sort_unstable();
    list
}

#[test]
fn the_made_cornell_box_is_the_shared_one() {
    let Some(theirs) = shared_scene("cornell.glb") else { return };
    let ours = imported("ours", &made::cornell());
    assert_eq!(surfaces(&ours), surfaces(&theirs));
    assert!(ours.cameras[0].to_world.abs_diff_eq(theirs.cameras[0].to_world, 1e-6));
    assert_eq!(ours.cameras[0].projection, theirs.cameras[0].projection);
    let mut planted = theirs.clone();
    planted.vertices[0].position.x += 1e-3;
    assert_ne!(surfaces(&ours), surfaces(&planted), "a corner that is a millimetre off passes");
}
