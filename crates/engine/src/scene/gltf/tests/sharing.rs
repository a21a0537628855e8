//! Meshes that instances share: the same as copies, and never too many.

use super::File;
use super::motion::{at_rest, shown, warned};
use crate::scene::gltf::{ImportLimits, ImportOptions};
use crate::scene::{Scene, SceneError, Vertex};
use serde_json::json;

/// A bent sheet of 32 triangles with normals, texture coordinates and a normal map, shown by nodes
/// within nodes that turn, stretch and mirror it, and three times by one of them.
fn sheets() -> File {
    let mut file = File::new();
    let (mut positions, mut normals, mut coordinates, mut indices) =
        (Vec::new(), Vec::new(), Vec::new(), Vec::new());
    for index in 0..25u8 {
        let (x, y) = (f32::from(index % 5) / 4.0, f32::from(index / 5) / 4.0);
        positions.extend([x, y, 0.3 * x * x - 0.2 * y]);
        normals.extend([-0.6 * x, 0.2, 1.0]);
        coordinates.extend([x, 1.0 - y]);
    }
    for cell in 0..16u8 {
        let first = cell / 4 * 5 + cell % 4;
        indices.extend([first, first + 1, first + 6, first, first + 6, first + 5]);
    }
    let position = file.floats(&positions, "VEC3", 3);
    let normal = file.floats(&normals, "VEC3", 3);
    let coordinate = file.floats(&coordinates, "VEC2", 2);
    let count = indices.len();
    let indices = file.accessor(&indices, 5121, "SCALAR", count);
    for (name, accessor) in [("POSITION", position), ("NORMAL", normal), ("TEXCOORD_0", coordinate)]
    {
        file.attribute(name, accessor);
    }
    file.root["meshes"][0]["primitives"][0]["indices"] = json!(indices);
    file.root["meshes"][0]["primitives"][0]["material"] = json!(0);
    let mut png = std::io::Cursor::new(Vec::new());
    let tilted = image::RgbImage::from_pixel(1, 1, image::Rgb([140, 120, 250]));
    tilted.write_to(&mut png, image::ImageFormat::Png).unwrap();
    let texture = file.image(&png.into_inner());
    file.root["materials"] = json!([{ "normalTexture": { "index": texture } }]);
    let translation = file.floats(&[0., 0., 0., 0., 5., 0., 0., 0., 5.], "VEC3", 3);
    let scale = file.floats(&[1., 1., 1., 1., 3., 1., 2., -1., 0.5], "VEC3", 3);
    let copies = json!({ "attributes": { "TRANSLATION": translation, "SCALE": scale } });
    file.root["extensionsUsed"] = json!(["EXT_mesh_gpu_instancing"]);
    file.root["scenes"] = json!([{ "nodes": [0, 3] }]);
    file.root["nodes"] = json!([
        { "mesh": 0, "children": [1], "rotation": [0.0, 0.6, 0.0, 0.8], "scale": [1, -2, 1] },
        { "mesh": 0, "children": [2], "translation": [3, 1, 0], "scale": [-1, 1, 1.5] },
        { "mesh": 0, "translation": [0, 0, 4], "rotation": [0.6, 0.0, 0.0, 0.8] },
        { "mesh": 0, "translation": [0, 9, 0], "extensions": { "EXT_mesh_gpu_instancing": copies } },
    ]);
    file
}

/// With meshes shared whatever that saves, or never.
fn with(file: &File, share_above: u64, max_triangles: usize) -> Result<Scene, SceneError> {
    let limits = ImportLimits { share_above, max_triangles, ..ImportLimits::default() };
    shown(file, &ImportOptions { limits, ..ImportOptions::default() })
}

/// The corners of all triangles, as numbers to sort and compare by.
fn surface(scene: &Scene) -> Vec<Vec<f32>> {
    let numbers = |v: &Vertex| {
        let Vertex { position, normal, tangent, .. } = v;
        let all = position.to_array().into_iter().chain(normal.to_array());
        all.chain(tangent.to_array()).chain(v.uv[0].to_array()).collect::<Vec<f32>>()
    };
    let triangles = (0..scene.triangle_count() as u32).map(|index| scene.triangle(index));
    let mut all: Vec<Vec<f32>> =
        triangles.map(|triangle| scene.of_corners(&triangle, numbers).concat()).collect();
    let key = |one: &Vec<f32>| one.iter().map(|x| (x * 500.0).round() as i32).collect::<Vec<_>>();
    all.sort_by_key(key);
    all
}

/// Largest difference of any number.
fn difference(one: &Scene, other: &Scene) -> f32 {
    let (one, other) = (surface(one), surface(other));
    assert_eq!(one.len(), other.len());
    let pairs = one.iter().flatten().zip(other.iter().flatten());
    pairs.map(|(a, b)| (a - b).abs()).fold(0.0, f32::max)
}

#[test]
fn shared_meshes_are_what_copies_are() {
    let file = sheets();
    let (shared, copied) = (with(&file, 0, 1000).unwrap(), with(&file, 1000, 1000).unwrap());
    assert_eq!((shared.triangles.len(), shared.unique_count()), (0, 32));
    assert_eq!((copied.triangles.len(), copied.instances.is_empty()), (6 * 32, true));
    assert!(difference(&shared, &copied) < 1e-5, "{}", difference(&shared, &copied));
    assert_eq!(shared.warnings, copied.warnings);
    let mut moved = sheets();
    moved.root["nodes"][2]["translation"] = json!([0, 0, 4.01]);
    let moved = with(&moved, 0, 1000).unwrap();
    assert!(difference(&moved, &copied) > 1e-3, "what is elsewhere looks the same");
}

/// What leaves triangles no area, or hardly any, can't be shared.
#[test]
fn flattened_instances_are_copied() {
    let mut file = sheets();
    file.root["nodes"][2]["scale"] = json!([1, 1, 0]);
    let (shared, copied) = (with(&file, 0, 1000).unwrap(), with(&file, 1000, 1000).unwrap());
    assert_eq!((shared.triangles.len(), shared.instances.all().len()), (32, 5));
    assert!(difference(&shared, &copied) < 1e-5);
    file.root["nodes"][2]["scale"] = json!([0, 1, 1e-9]);
    let (shared, copied) = (with(&file, 0, 1000).unwrap(), with(&file, 1000, 1000).unwrap());
    assert_eq!(shared.triangle_count(), copied.triangle_count());
    assert!(warned(&shared, "32 triangles without area are left out"), "{:?}", shared.warnings);
}

/// Instances that can't share their mesh count as copies do.
#[test]
fn copies_of_shared_meshes_are_counted() {
    let mut file = sheets();
    for node in 0..3 {
        file.root["nodes"][node]["scale"] = json!([1, 0, 1]);
    }
    assert!(with(&file, 0, 96).is_ok());
    let error = with(&file, 0, 95).unwrap_err();
    assert!(error.too_large && error.what.contains("can't share their mesh"), "{error}");
}

/// What copies would not be allowed, shared meshes are, until they are too many, too.
#[test]
fn shared_triangles_count_once_and_instances_as_two() {
    let file = sheets();
    let shared = with(&file, u64::MAX, 44).unwrap();
    assert_eq!((shared.unique_count(), shared.kept_triangles()), (32, 44));
    let error = with(&file, u64::MAX, 43).unwrap_err();
    assert!(error.too_large && error.what.starts_with("44 triangles, those of shared"), "{error}");
}

/// A million million triangles are refused before any is made.
#[test]
fn a_million_instances_of_a_million_triangles_are_refused() {
    let mut file = sheets();
    let bytes = json!({ "componentType": 5126, "type": "VEC3", "count": 1_000_000 });
    let translation = file.push("accessors", bytes);
    let indices = json!({ "componentType": 5125, "type": "SCALAR", "count": 3_000_000 });
    let indices = file.push("accessors", indices);
    file.root["meshes"][0]["primitives"][0]["indices"] = json!(indices);
    file.root["nodes"][3]["extensions"]["EXT_mesh_gpu_instancing"]["attributes"] =
        json!({ "TRANSLATION": translation });
    let error = at_rest(&file).unwrap_err();
    let what = "1000003000000 triangles with all instances; 1073741824 are allowed";
    assert!(error.too_large && error.what.starts_with(what), "{error}");
    // Few triangles, but more instances than would fit.
    let mut file = sheets();
    let bytes = json!({ "componentType": 5126, "type": "VEC3", "count": 3_000_000 });
    let translation = file.push("accessors", bytes);
    file.root["nodes"][3]["extensions"]["EXT_mesh_gpu_instancing"]["attributes"] =
        json!({ "TRANSLATION": translation });
    let error = at_rest(&file).unwrap_err();
    assert!(error.too_large && error.what.starts_with("6000038 triangles, those of"), "{error}");
}
