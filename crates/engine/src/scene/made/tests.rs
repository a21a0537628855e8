//! What is shipped is what the code makes, and it is clean geometry.

use super::*;
use crate::scene::gltf::{ImportLimits, Resources, import};
use crate::scene::{Material, Model, Scene};
use glam::{DVec2, DVec3, Vec3};
use std::collections::{BTreeMap, BTreeSet, HashMap};
use std::path::Path;

fn imported(name: &str, bytes: &[u8]) -> Scene {
    let scene = import(bytes, &Resources::new(), &ImportLimits::default())
        .unwrap_or_else(|error| panic!("{name}: {error}"));
    assert_eq!(scene.warnings, [], "{name}");
    scene
}

fn all() -> Vec<(String, Scene)> {
    let mut scenes: Vec<_> = shipped()
        .into_iter()
        .map(|(name, bytes)| (name.to_owned(), imported(name, &bytes)))
        .collect();
    let name = "tessellated room of 3000".to_owned();
    let scene = imported(&name, &tessellated_room(3000));
    scenes.push((name, scene));
    scenes
}

#[test]
fn shipped_files_are_what_the_code_makes() {
    for (name, bytes) in shipped() {
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../scenes").join(name);
        let file = std::fs::read(&path).unwrap_or_else(|e| panic!("{}: {e}", path.display()));
        assert!(
            file == bytes,
            "scenes/{name} has drifted; run: cargo run --release -p hemilux-engine --example make_scenes -- scenes"
        );
        assert!(bytes.len() < 600 << 10, "{name} has {} bytes", bytes.len());
    }
}

#[test]
fn scenes_have_what_they_promise() {
    let scenes: BTreeMap<String, Scene> = all().into_iter().collect();
    for (name, scene) in &scenes {
        println!("{name}: {} triangles", scene.triangles.len());
        assert!(scene.emissive_triangles() > 0, "{name}");
        assert!(!scene.cameras.is_empty(), "{name}");
    }
    assert_eq!(scenes["cornell.glb"].triangles.len(), 46);
    assert_eq!(scenes["furnace.glb"].triangles.len(), 12);
    let office = &scenes["office.glb"];
    assert!((5_000..20_000).contains(&office.triangles.len()));
    assert_eq!((office.textures.len(), office.emissive_triangles()), (1, 6));
    assert_eq!(scenes["corridor.glb"].emissive_triangles(), 2);
}

#[test]
fn patterns_are_what_they_are_called() {
    let checker = imported("checker", &checker(4.0));
    assert_eq!((checker.emissive_triangles(), checker.textures.len()), (0, 1));
    let [one, same, other] = [3, 3, 4].map(|seed| imported("screens", &screens(seed)));
    assert_eq!((one.emissive_triangles(), one.textures.len()), (18, 9));
    let texels =
        |scene: &Scene| scene.textures.iter().map(|t| t.texels.clone()).collect::<Vec<_>>();
    assert!(texels(&one) == texels(&same) && texels(&one) != texels(&other));
    for texels in texels(&one) {
        let black = texels.iter().filter(|texel| texel[..3] == [0; 3]).count() as f32;
        let share = black / texels.len() as f32;
        assert!((0.1..0.4).contains(&share), "{share} of a screen is black");
    }
}

#[test]
fn tessellated_rooms_have_about_the_triangles_asked_for() {
    for asked in [1_000, 10_000, 100_000] {
        let scene = imported("room", &tessellated_room(asked));
        let ratio = scene.triangles.len() as f64 / asked as f64;
        assert!((0.8..1.25).contains(&ratio), "{asked}: {}", scene.triangles.len());
    }
}

#[test]
fn phong_materials_have_the_lobe_they_name() {
    for (specular, exponent) in [(0.27, 28.0), (0.2, 10.0), (0.25, 30.0), (0.05, 60.0)] {
        let albedo = Vec3::new(0.1, 0.2, 0.3);
        let material = Material::phong("x", albedo, specular, exponent);
        let reflectance = material.reflectance(&material.appearance(material.base_color));
        assert!((reflectance.specular - Vec3::splat(specular)).abs().max_element() < 1e-5);
        assert!((reflectance.diffuse - albedo).abs().max_element() < 1e-5);
        assert!((reflectance.exponent / exponent - 1.0).abs() < 1e-3);
    }
    // And once more through a file.
    let scene = imported("cornell_phong.glb", &phong_cornell());
    for (name, specular, exponent) in [("robot", 0.27, 28.0), ("alien", 0.20, 10.0)] {
        let material = scene.materials.iter().find(|m| m.name == name).unwrap();
        assert_eq!(material.model, Model::Phong, "{name}");
        let reflectance = material.reflectance(&material.appearance(material.base_color));
        assert!((reflectance.specular.x - specular).abs() < 1e-4, "{name}");
        assert!((reflectance.exponent / exponent - 1.0).abs() < 1e-3, "{name}");
    }
}

/// A position as a key: two that are meant to be one have the same bits.
fn key(position: Vec3) -> [u32; 3] {
    position.to_array().map(|x| (x + 0.0).to_bits())
}

/// Triangles grouped into connected bodies, corners welded by position.
fn bodies(scene: &Scene) -> Vec<Vec<[Vec3; 3]>> {
    fn find(parents: &mut [usize], mut item: usize) -> usize {
        while parents[item] != item {
            parents[item] = parents[parents[item]];
            item = parents[item];
        }
        item
    }
    let mut places = HashMap::new();
    let mut parents: Vec<usize> = Vec::new();
    let mut firsts = Vec::new();
    for triangle in &scene.triangles {
        let corners = scene.corners(triangle).map(|position| {
            *places.entry(key(position)).or_insert_with(|| {
                parents.push(parents.len());
                parents.len() - 1
            })
        });
        for pair in corners.windows(2) {
            let (a, b) = (find(&mut parents, pair[0]), find(&mut parents, pair[1]));
            parents[a] = b;
        }
        firsts.push(corners[0]);
    }
    let mut groups: BTreeMap<usize, Vec<[Vec3; 3]>> = BTreeMap::new();
    for (triangle, first) in scene.triangles.iter().zip(firsts) {
        groups.entry(find(&mut parents, first)).or_default().push(scene.corners(triangle));
    }
    groups.into_values().collect()
}

fn bounds(body: &[[Vec3; 3]]) -> (Vec3, Vec3) {
    let points = || body.iter().flatten().copied();
    (points().reduce(Vec3::min).unwrap(), points().reduce(Vec3::max).unwrap())
}

/// ⅙ Σ (a × b)·c: positive where the faces look outwards. Taken around the middle of the box, so
/// that the sign also holds for a body whose bottom is left out.
fn signed_volume(body: &[[Vec3; 3]]) -> f64 {
    let (low, high) = bounds(body);
    let middle = (0.5 * (low + high)).as_dvec3();
    body.iter()
        .map(|corners| {
            let [a, b, c] = corners.map(|corner| corner.as_dvec3() - middle);
            a.cross(b).dot(c) / 6.0
        })
        .sum()
}

#[test]
fn bodies_face_outwards_and_rooms_inwards() {
    for (name, scene) in all() {
        let (low, high) = scene.bounds().unwrap();
        let mut rooms = 0;
        for body in bodies(&scene) {
            let is_room = bounds(&body) == (low, high);
            rooms += usize::from(is_room);
            let volume = signed_volume(&body);
            assert!(
                if is_room { volume < 0.0 } else { volume > 0.0 },
                "{name}: a body of {} triangles in {:?} (scene {low} … {high}) has the signed volume {volume}",
                body.len(),
                bounds(&body)
            );
        }
        assert_eq!(rooms, 1, "{name}");
    }
}

#[test]
fn neighbours_are_wound_alike_and_rooms_are_closed() {
    for (name, scene) in all() {
        let mut edges = BTreeSet::new();
        for triangle in &scene.triangles {
            let corners = scene.corners(triangle).map(key);
            for side in 0..3 {
                let edge = (corners[side], corners[(side + 1) % 3]);
                assert!(edges.insert(edge), "{name}: an edge is used twice in one direction");
            }
        }
        if name.starts_with("cornell") {
            // Open at the front, and its ceiling is cut where its walls are not.
            continue;
        }
        // A body may lack the face that it stands on; a room lacks none.
        let open = edges.iter().filter(|(a, b)| !edges.contains(&(*b, *a)));
        let (low, high) = scene.bounds().unwrap();
        for (a, b) in open {
            let [a, b] = [a, b].map(|bits| Vec3::from_array(bits.map(f32::from_bits)));
            let on_floor = a.y == low.y && b.y == low.y;
            let on_room_side =
                |p: Vec3| (0..3).any(|i| i != 1 && (p[i] == low[i] || p[i] == high[i]));
            assert!(on_floor && !(on_room_side(a) && on_room_side(b)), "{name}: open edge {a} {b}");
        }
    }
}

#[test]
fn no_two_faces_lie_on_each_other() {
    for (name, scene) in all() {
        let mut planes: BTreeMap<[i64; 4], Vec<[DVec3; 3]>> = BTreeMap::new();
        for triangle in &scene.triangles {
            let corners = scene.corners(triangle).map(Vec3::as_dvec3);
            let mut normal = (corners[1] - corners[0]).cross(corners[2] - corners[0]).normalize();
            // Back to back counts as well.
            if normal.to_array().into_iter().find(|x| x.abs() > 1e-3).unwrap() < 0.0 {
                normal = -normal;
            }
            let plane = normal.extend(normal.dot(corners[0]) * 2.0);
            let key = plane.to_array().map(|x| (x * 1e4).round() as i64);
            planes.entry(key).or_default().push(corners);
        }
        for triangles in planes.values() {
            for (index, a) in triangles.iter().enumerate() {
                for b in &triangles[..index] {
                    assert!(!overlap(a, b), "{name}: {a:?} and {b:?} lie on each other");
                }
            }
        }
    }
}

/// Whether two coplanar triangles share area: no side of either separates them.
fn overlap(a: &[DVec3; 3], b: &[DVec3; 3]) -> bool {
    let normal = (a[1] - a[0]).cross(a[2] - a[0]);
    let drop = (0..3).max_by(|i, j| normal[*i].abs().total_cmp(&normal[*j].abs())).unwrap();
    let flat = |p: &DVec3| DVec2::new(p[(drop + 1) % 3], p[(drop + 2) % 3]);
    let (a, b) = (a.each_ref().map(flat), b.each_ref().map(flat));
    let separates = |one: &[DVec2; 3], other: &[DVec2; 3]| {
        (0..3).any(|side| {
            let axis = (one[(side + 1) % 3] - one[side]).perp().normalize();
            let reach = |t: &[DVec2; 3]| {
                t.iter()
                    .map(|p| axis.dot(*p))
                    .fold((f64::MAX, f64::MIN), |(low, high), x| (low.min(x), high.max(x)))
            };
            let ((low_a, high_a), (low_b, high_b)) = (reach(one), reach(other));
            high_a <= low_b + 1e-5 || high_b <= low_a + 1e-5
        })
    };
    !separates(&a, &b) && !separates(&b, &a)
}
