//! The scenes load without a warning, have what they promise, and come out the same twice.

use super::*;
use crate::scene::gltf::{ImportLimits, Resources, import};
use crate::scene::{Alpha, Scene};

fn imported(scene: &RealScene) -> Scene {
    let loaded = import(&scene.glb, &Resources::new(), &ImportLimits::default())
        .unwrap_or_else(|error| panic!("{}: {error}", scene.name));
    assert_eq!(loaded.warnings, [], "{}", scene.name);
    loaded
}

#[test]
fn all_load_and_are_lit() {
    for scene in all(1) {
        let loaded = imported(&scene);
        assert_eq!(loaded.cameras.len(), 1, "{}", scene.name);
        assert_eq!(scene.environment.check(), Ok(()), "{}", scene.name);
        let lit = loaded.emissive_triangles() > 0
            || !loaded.lights.is_empty()
            || !scene.environment.is_dark();
        assert!(lit, "{}", scene.name);
    }
}

#[test]
fn seeds_alone_make_a_difference() {
    let bytes = |seed| all(seed).into_iter().map(|scene| scene.glb).collect::<Vec<_>>();
    let (first, again, other) = (bytes(1), bytes(1), bytes(2));
    assert!(first == again);
    let names: Vec<_> = all(1).into_iter().map(|scene| scene.name).collect();
    let random = |name: &str| ["foliage", "screens"].contains(&name) || name.contains("court");
    for (index, name) in names.iter().enumerate() {
        assert_eq!(first[index] != other[index], random(name), "{name}");
    }
}

/// The tree has its leaves, each an alpha-masked quad, and about half of a leaf's quad is there.
#[test]
fn a_tree_has_its_leaves() {
    for leaves in [500, LEAVES] {
        let tree = imported(&foliage(leaves, 1));
        let masked =
            |material: u32| matches!(tree.materials[material as usize].alpha, Alpha::Mask { .. });
        let quads = tree.triangles.iter().filter(|triangle| masked(triangle.material));
        assert_eq!(quads.count() as u32, 2 * leaves);
        let texels = &tree.textures[0].texels;
        let solid = texels.iter().filter(|texel| texel[3] > 127).count() as f32;
        let share = solid / texels.len() as f32;
        // Two thirds lie below a parabola.
        assert!((0.6..0.72).contains(&share), "{share}");
    }
}

/// Courtyards of many seeds have glass, and lights of both kinds are among them.
#[test]
fn courtyards_differ() {
    let (mut bulbs, mut points, mut suns) = (0, 0, 0);
    for seed in 0..24 {
        let court = courtyard(seed);
        let loaded = imported(&court);
        assert!(loaded.materials.iter().any(|material| material.clear_share() > 0.0), "{seed}");
        bulbs += u32::from(loaded.emissive_triangles() > 0);
        points += loaded.lights.len();
        suns += u32::from(court.environment.sun.is_some());
    }
    assert!(bulbs > 3 && points > 3 && suns > 3, "{bulbs} {points} {suns}");
}

/// Random rooms of many seeds load without a warning, each with a light, and all kinds of things
/// are among them; the same seed makes the same room.
#[test]
fn random_rooms_differ() {
    let (mut windows, mut mirrors, mut points, mut textures) = (0, 0, 0, 0);
    for seed in 0..40 {
        let made = random_room(seed);
        assert!(made.glb == random_room(seed).glb, "{seed}");
        let loaded = imported(&made);
        let is_windowed = !made.environment.is_dark();
        let has_lamps = loaded.emissive_triangles() > 0 || !loaded.lights.is_empty();
        assert!(is_windowed || has_lamps, "{seed}");
        let has_mirror = loaded.materials.iter().any(|material| material.name == "mirror");
        assert!(!has_mirror || loaded.lights.is_empty(), "{seed}");
        windows += u32::from(is_windowed);
        mirrors += u32::from(has_mirror);
        points += u32::from(!loaded.lights.is_empty());
        textures += u32::from(!loaded.textures.is_empty());
    }
    let counts = [windows, mirrors, points, textures];
    assert!(counts.iter().all(|count| (3..38).contains(count)), "{counts:?}");
}

/// Sunny rooms of many seeds load without a warning, each with a sun that comes in by the window, a sky, and no
/// mirror; some have lamps. The same seed makes the same room.
#[test]
fn sunny_rooms_differ() {
    let mut lit = 0;
    for seed in 0..40 {
        let made = sunny_room(seed);
        assert!(made.glb == sunny_room(seed).glb, "{seed}");
        assert!(made.environment == sunny_room(seed).environment, "{seed}");
        let sun = made.environment.sun.expect("a sun");
        assert!(sun.direction.x < 0.0 && sun.direction.y > 0.0, "{seed}: {}", sun.direction);
        let loaded = imported(&made);
        assert!(loaded.materials.iter().all(|material| material.name != "mirror"), "{seed}");
        lit += u32::from(loaded.emissive_triangles() > 0 || !loaded.lights.is_empty());
    }
    assert!((8..33).contains(&lit), "{lit}");
}

/// Odd rooms of many seeds load without a warning, each with a lamp, some open; the same seed makes the same
/// room, and materials of all kinds are among them.
#[test]
fn odd_rooms_differ() {
    let mut open = 0;
    let mut names = std::collections::BTreeSet::new();
    for seed in 0..40 {
        let made = odd_room(seed);
        assert!(made.glb == odd_room(seed).glb, "{seed}");
        let loaded = imported(&made);
        assert!(loaded.emissive_triangles() > 0, "{seed}");
        names.extend(loaded.materials.iter().map(|material| material.name.clone()));
        open += u32::from(!made.environment.is_dark());
    }
    assert!((3..30).contains(&open), "{open}");
    let kinds = ["matte", "black", "metal", "gloss", "veil", "glass", "pane", "card"];
    assert!(kinds.iter().all(|kind| names.contains(*kind)), "{names:?}");
}
