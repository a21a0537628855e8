//! Skins, morph targets, animations, scenes and instances.

use super::{File, close, front, square};
use crate::scene::gltf::{Choice, ImportLimits, ImportOptions, Resources, import_with};
use crate::scene::made::assemble;
use crate::scene::{Scene, SceneError};
use glam::{Quat, Vec3, Vec4};
use serde_json::{Value, json};
use std::f32::consts::{FRAC_1_SQRT_2, FRAC_PI_2, FRAC_PI_4, PI};

/// What a file becomes with these options.
pub(super) fn shown(file: &File, options: &ImportOptions) -> Result<Scene, SceneError> {
    let mut root = file.root.clone();
    root["buffers"] = json!([{ "byteLength": file.binary.len() }]);
    import_with(&assemble(&root, &file.binary), &Resources::new(), options)
}

pub(super) fn at_rest(file: &File) -> Result<Scene, SceneError> {
    shown(file, &ImportOptions::default())
}

/// What the first animation makes of a file at that time.
pub(super) fn at(file: &File, time: f64) -> Result<Scene, SceneError> {
    let animation = Some(Choice::Index(0));
    shown(file, &ImportOptions { animation, time, ..ImportOptions::default() })
}

pub(super) fn warned(scene: &Scene, text: &str) -> bool {
    scene.warnings.iter().any(|w| format!("{}: {}", w.at, w.what).contains(text))
}

/// A strip in z = 0 of two squares one above the other, of the heights 0, 1 and 2, whose upper
/// corners follow a second joint that stands at height 1.
pub(super) fn bendable() -> File {
    let mut file = File::new();
    let corners = [0., 0., 0., 1., 0., 0., 0., 1., 0., 1., 1., 0., 0., 2., 0., 1., 2., 0.];
    let position = file.floats(&corners, "VEC3", 3);
    let normal = file.floats(&[0., 0., 1.].repeat(6), "VEC3", 3);
    let joints: Vec<u8> =
        [[0, 0, 0, 0], [0, 1, 0, 0], [0, 1, 0, 0]].iter().flat_map(|set| set.repeat(2)).collect();
    let joints = file.accessor(&joints, 5121, "VEC4", 6);
    let weights: Vec<f32> = [[1., 0., 0., 0.], [0.5, 0.5, 0., 0.], [0., 1., 0., 0.]]
        .iter()
        .flat_map(|set| set.repeat(2))
        .collect();
    let weights = file.floats(&weights, "VEC4", 4);
    for (name, accessor) in
        [("POSITION", position), ("NORMAL", normal), ("JOINTS_0", joints), ("WEIGHTS_0", weights)]
    {
        file.attribute(name, accessor);
    }
    file.root["meshes"][0]["primitives"][0]["mode"] = json!(5);
    let mut inverse = glam::Mat4::IDENTITY.to_cols_array().to_vec();
    inverse.extend(glam::Mat4::from_translation(Vec3::NEG_Y).to_cols_array());
    let inverse = file.floats(&inverse, "MAT4", 16);
    file.root["scenes"] = json!([{ "nodes": [0, 1] }]);
    file.root["nodes"] = json!([
        // Its own place is of no use to a mesh with a skin.
        { "mesh": 0, "skin": 0, "translation": [50, 60, 70], "scale": [-3, 1, 1] },
        { "children": [2] },
        { "translation": [0, 1, 0] },
    ]);
    file.root["skins"] = json!([{ "joints": [1, 2], "inverseBindMatrices": inverse }]);
    file
}

/// Adds a channel to the file's first animation, keys of `width` floats each.
fn animate(
    file: &mut File,
    target: Value,
    (times, values): (&[f32], &[f32]),
    (kind, interpolation): (&str, &str),
) {
    let width = ["SCALAR", "", "VEC3", "VEC4"].iter().position(|k| *k == kind).unwrap();
    let width = if width == 0 { 1 } else { width + 1 };
    let input = file.floats(times, "SCALAR", 1);
    let output = file.floats(values, kind, width);
    if file.root["animations"].is_null() {
        file.root["animations"] = json!([{ "name": "move", "channels": [], "samplers": [] }]);
    }
    let animation = &mut file.root["animations"][0];
    let samplers = animation["samplers"].as_array_mut().unwrap();
    let sampler = json!({ "input": input, "output": output, "interpolation": interpolation });
    samplers.push(sampler);
    let channel = json!({ "sampler": samplers.len() - 1, "target": target });
    animation["channels"].as_array_mut().unwrap().push(channel);
}

fn positions(scene: &Scene) -> Vec<Vec3> {
    scene.vertices.iter().map(|vertex| vertex.position).collect()
}

fn has(scene: &Scene, place: Vec3) -> bool {
    positions(scene).iter().any(|position| close(*position, place))
}

#[test]
fn a_skinned_mesh_is_where_its_joints_put_it() {
    let mut file = bendable();
    let rest = at_rest(&file).unwrap();
    assert_eq!(rest.bounds(), Some((Vec3::ZERO, Vec3::new(1.0, 2.0, 0.0))));
    assert!(close(front(&rest), Vec3::Z), "the mirrored node turns nothing");
    assert_eq!(rest.warnings, []);
    // Joints outside of the shown scene move it as well.
    file.root["scenes"] = json!([{ "nodes": [0] }]);
    file.root["nodes"][1]["translation"] = json!([0, 0, 4]);
    let moved = at_rest(&file).unwrap();
    assert_eq!(moved.bounds(), Some((Vec3::new(0., 0., 4.), Vec3::new(1.0, 2.0, 4.0))));
}

#[test]
fn a_strip_bends_by_a_quarter_turn() {
    let mut file = bendable();
    // A quarter turn about x takes what is above the joint from +y to +z.
    let quarter = Quat::from_rotation_x(FRAC_PI_2).to_array();
    file.root["nodes"][2]["rotation"] = json!(quarter);
    let scene = at_rest(&file).unwrap();
    assert_eq!(scene.triangles.len(), 4);
    for x in [0.0, 1.0] {
        // The seam is at the joint itself, which turns about it.
        for place in [Vec3::new(x, 0., 0.), Vec3::new(x, 1., 0.), Vec3::new(x, 1., 1.)] {
            assert!(has(&scene, place), "{place}: {:?}", positions(&scene));
        }
    }
    for vertex in &scene.vertices {
        let expected = match vertex.position {
            Vec3 { y: 0.0, .. } => Vec3::Z,
            position if position.z > 0.5 => Vec3::NEG_Y,
            // Half of a quarter turn.
            _ => Vec3::new(0.0, -FRAC_1_SQRT_2, FRAC_1_SQRT_2),
        };
        assert!(close(vertex.normal, expected), "{vertex:?}");
    }
}

#[test]
fn weights_are_scaled_to_one_and_further_sets_are_read() {
    let mut file = bendable();
    file.root["nodes"][2]["translation"] = json!([0, 3, 0]);
    // The upper joint is 2 higher than the bind pose has it.
    let joints = file.accessor(&[1, 0, 0, 0].repeat(6), 5121, "VEC4", 6);
    let weights = file.floats(&[0.5, 0., 0., 0.].repeat(6), "VEC4", 4);
    file.attribute("JOINTS_1", joints).attribute("WEIGHTS_1", weights);
    let scene = at_rest(&file).unwrap();
    assert!(warned(&scene, "WEIGHTS_0: 6 vertices have weights that are not 1 in sum"));
    // Of weights 1 and ½: a third of the way; of ½, ½ and ½: two thirds; of 1 and ½: all of it.
    for (below, y) in [(0.0, 2.0 / 3.0), (1.0, 1.0 + 4.0 / 3.0), (2.0, 4.0)] {
        assert!(has(&scene, Vec3::new(1.0, y, 0.0)), "{below}: {:?}", positions(&scene));
    }
    // Bytes that are normalised by rounding are no cause for a warning.
    let bytes = file.accessor(&[85, 85, 84, 0].repeat(6), 5121, "VEC4", 6);
    file.root["accessors"][bytes]["normalized"] = json!(true);
    let both = file.accessor(&[0, 0, 1, 9].repeat(6), 5121, "VEC4", 6);
    let attributes = &mut file.root["meshes"][0]["primitives"][0]["attributes"];
    for name in ["JOINTS_1", "WEIGHTS_1"] {
        attributes.as_object_mut().unwrap().remove(name);
    }
    file.attribute("JOINTS_0", both).attribute("WEIGHTS_0", bytes);
    let scene = at_rest(&file).unwrap();
    assert_eq!(scene.warnings, [], "joint 9 has no weight and need not exist");
    let up = 2.0 * 84.0 / 254.0;
    assert!(has(&scene, Vec3::new(0.0, up, 0.0)), "{:?}", positions(&scene));
}

#[test]
fn mirrored_joints_turn_the_winding() {
    let mut file = bendable();
    file.root["nodes"][1]["scale"] = json!([-1, 1, 1]);
    let scene = at_rest(&file).unwrap();
    let (low, high) = scene.bounds().unwrap();
    assert_eq!((low.x, high.x), (-1.0, 0.0));
    assert!(close(front(&scene), Vec3::Z), "{}", front(&scene));
    assert!(scene.vertices.iter().all(|vertex| close(vertex.normal, Vec3::Z)));
}

/// A square whose two targets lift it along z and turn its normals, and push it along x.
pub(super) fn morphing() -> File {
    let mut file = square();
    let normal = file.floats(&[0., 0., 1.].repeat(4), "VEC3", 3);
    file.attribute("NORMAL", normal);
    let lift = file.floats(&[0., 0., 4.].repeat(4), "VEC3", 3);
    let lean = file.floats(&[0., 1., 0.].repeat(4), "VEC3", 3);
    // Two corners of the second are pushed, by a sparse accessor of nothing else.
    let (places, values) =
        (file.view(&[1, 3]), file.view(bytemuck::cast_slice(&[1.0f32, 0., 0., 2., 0., 0.])));
    let sparse = json!({
        "count": 2, "indices": { "bufferView": places, "componentType": 5121 },
        "values": { "bufferView": values },
    });
    let push = file.push(
        "accessors",
        json!({ "componentType": 5126, "type": "VEC3", "count": 4, "sparse": sparse }),
    );
    file.root["meshes"][0]["primitives"][0]["targets"] =
        json!([{ "POSITION": lift, "NORMAL": lean }, { "POSITION": push }]);
    file
}

#[test]
fn half_a_weight_moves_half_the_way() {
    let mut file = morphing();
    assert_eq!(at_rest(&file).unwrap().bounds().unwrap().1, Vec3::new(1.0, 1.0, 0.0));
    file.root["meshes"][0]["weights"] = json!([0.5, 0]);
    let scene = at_rest(&file).unwrap();
    assert_eq!(scene.warnings, []);
    assert!(positions(&scene).iter().all(|position| position.z == 2.0), "{:?}", positions(&scene));
    let normal = Vec3::new(0.0, 0.5, 1.0).normalize();
    assert!(scene.vertices.iter().all(|vertex| close(vertex.normal, normal)));
    // The node's weights go before the mesh's, and each node has its own shape.
    file.root["scenes"] = json!([{ "nodes": [0, 1] }]);
    file.root["nodes"] =
        json!([{ "mesh": 0, "weights": [0, 0.5] }, { "mesh": 0, "weights": [1, 0] }]);
    let scene = at_rest(&file).unwrap();
    assert_eq!(scene.triangles.len(), 4);
    for place in [Vec3::new(1.5, 0., 0.), Vec3::new(2., 1., 0.), Vec3::new(1., 1., 4.)] {
        assert!(has(&scene, place), "{place}: {:?}", positions(&scene));
    }
}

#[test]
fn tangents_colours_and_coordinates_morph() {
    let mut file = morphing();
    let uv = file.floats(&[0., 0., 1., 0., 0., 1., 1., 1.], "VEC2", 2);
    let tangent = file.floats(&[1., 0., 0., -1.].repeat(4), "VEC4", 4);
    let color = file.floats(&[0.5, 0.25, 0., 0.5].repeat(4), "VEC4", 4);
    file.attribute("TEXCOORD_0", uv).attribute("TANGENT", tangent).attribute("COLOR_0", color);
    file.root["materials"] = json!([{ "normalTexture": { "index": 0 } }]);
    let mut png = std::io::Cursor::new(Vec::new());
    let texel = image::RgbImage::from_pixel(1, 1, image::Rgb([128, 128, 255]));
    texel.write_to(&mut png, image::ImageFormat::Png).unwrap();
    file.image(&png.into_inner());
    let turned = file.floats(&[-1., 1., 0.].repeat(4), "VEC3", 3);
    let brighter = file.floats(&[0.25, 0., 9., 0.25].repeat(4), "VEC4", 4);
    let shifted = file.floats(&[0.5, 0.].repeat(4), "VEC2", 2);
    let primitive = &mut file.root["meshes"][0]["primitives"][0];
    primitive["material"] = json!(0);
    primitive["targets"] =
        json!([{ "TANGENT": turned, "COLOR_0": brighter, "TEXCOORD_0": shifted }]);
    file.root["meshes"][0]["weights"] = json!([1]);
    let scene = at_rest(&file).unwrap();
    for vertex in &scene.vertices {
        assert!(vertex.tangent.abs_diff_eq(Vec4::new(0., 1., 0., -1.), 1e-6), "{vertex:?}");
        assert!(close(vertex.color, Vec3::new(0.75, 0.25, 1.0)) && vertex.alpha == 0.75);
    }
    let reach = scene.vertices.iter().map(|vertex| vertex.uv[0].x).fold(0.0, f32::max);
    assert_eq!(reach, 1.5);
    // Without tangents in the file they are computed of the shape as it is morphed.
    let quarter: Vec<f32> = [[0., 0., 0.], [-1., 1., 0.], [-1., -1., 0.], [-2., 0., 0.]].concat();
    let quarter = file.floats(&quarter, "VEC3", 3);
    let primitive = &mut file.root["meshes"][0]["primitives"][0];
    primitive["attributes"].as_object_mut().unwrap().remove("TANGENT");
    primitive["targets"] = json!([{ "POSITION": quarter }]);
    let scene = at_rest(&file).unwrap();
    let turned = |vertex: &crate::scene::Vertex| close(vertex.tangent.truncate(), Vec3::Y);
    assert!(scene.vertices.iter().all(turned), "{:?}", scene.vertices);
}

#[test]
fn morphs_come_before_joints() {
    let mut file = bendable();
    let quarter = Quat::from_rotation_x(FRAC_PI_2).to_array();
    file.root["nodes"][2]["rotation"] = json!(quarter);
    let taller =
        file.floats(&[[0.; 12].to_vec(), [0., 2., 0., 0., 2., 0.].to_vec()].concat(), "VEC3", 3);
    file.root["meshes"][0]["primitives"][0]["targets"] = json!([{ "POSITION": taller }]);
    file.root["nodes"][0]["weights"] = json!([0.5]);
    let scene = at_rest(&file).unwrap();
    // The upper end is one longer before the joint lays it along z.
    assert!(has(&scene, Vec3::new(0., 1., 2.)), "{:?}", positions(&scene));
}

/// A square on a node that an animation moves.
pub(super) fn moved(path: &str, times: &[f32], values: &[f32], interpolation: &str) -> File {
    let mut file = square();
    let kind = if path == "rotation" { "VEC4" } else { "VEC3" };
    let target = json!({ "node": 0, "path": path });
    animate(&mut file, target, (times, values), (kind, interpolation));
    file
}

/// Where the square's corner at the origin is.
fn corner(file: &File, time: f64) -> Vec3 {
    at(file, time).unwrap().vertices[0].position
}

#[test]
fn keys_are_joined_as_the_file_says_and_hold_at_the_ends() {
    let times = [1.0, 2.0, 4.0];
    let values = [0., 0., 0., 1., 0., 0., 3., 2., 0.];
    for (interpolation, expected) in [
        ("LINEAR", [0.0, 0.0, 0.5, 1.0, 2.0, 3.0, 3.0]),
        ("STEP", [0.0, 0.0, 0.0, 1.0, 1.0, 3.0, 3.0]),
    ] {
        let file = moved("translation", &times, &values, interpolation);
        for (time, x) in [0.0, 1.0, 1.5, 2.0, 3.0, 4.0, 1e9].into_iter().zip(expected) {
            assert_eq!(corner(&file, time).x, x, "{interpolation} at {time}");
        }
    }
    let scaled = moved("scale", &[0.0, 1.0], &[1., 1., 1., 3., 1., 1.], "LINEAR");
    assert_eq!(at(&scaled, 0.5).unwrap().bounds().unwrap().1, Vec3::new(2.0, 1.0, 0.0));
    let scene = at_rest(&scaled).unwrap();
    assert!(warned(&scene, "animations: the file is shown at rest"), "{:?}", scene.warnings);
    assert_eq!(scene.bounds().unwrap().1.x, 1.0);
    let [animation] = &scene.animations[..] else { panic!("{:?}", scene.animations) };
    assert_eq!((animation.name.as_deref(), animation.seconds), (Some("move"), 1.0));
}

/// Of a cubic and its slopes at two keys, the spline is that cubic.
#[test]
fn cubic_keys_give_back_a_cubic() {
    let cubic = |t: f64| t.powi(3) - 2.0 * t * t + 0.5 * t + 3.0;
    let slope = |t: f64| 3.0 * t * t - 4.0 * t + 0.5;
    let times = [1.0f32, 3.0];
    // In-tangent, value, out-tangent; what is before the first and after the last key is unused.
    let key = |t: f64| [[7.0, 0., 0.], [cubic(t) as f32, 0., 0.], [slope(t) as f32, 0., 0.]];
    let mut values = [key(1.0), key(3.0)].concat().concat();
    values[9] = slope(3.0) as f32;
    values[15] = 7.0;
    let file = moved("translation", &times, &values, "CUBICSPLINE");
    for time in [1.0, 1.25, 2.0, 2.9, 3.0] {
        let x = f64::from(corner(&file, time).x);
        assert!((x - cubic(time)).abs() < 1e-5, "{time}: {x} {}", cubic(time));
    }
    assert!((f64::from(corner(&file, 0.0).x) - cubic(1.0)).abs() < 1e-6);
    assert!((f64::from(corner(&file, 9.0).x) - cubic(3.0)).abs() < 1e-5);
}

/// Where the square's side along x points.
fn side(file: &File, time: f64) -> Vec3 {
    let scene = at(file, time).unwrap();
    let to = scene.vertices.iter().map(|vertex| vertex.position);
    let [origin, end, ..] = to.collect::<Vec<_>>()[..] else { panic!("a square") };
    end - origin
}

#[test]
fn rotations_take_the_shortest_arc_at_an_even_pace() {
    let turn = |angle: f32| Quat::from_rotation_z(angle).to_array();
    let quarter = [turn(0.0), turn(FRAC_PI_2)].concat();
    let along = |angle: f32| Vec3::new(angle.cos(), angle.sin(), 0.0);
    let file = moved("rotation", &[0.0, 1.0], &quarter, "LINEAR");
    assert!(close(side(&file, 0.5), along(FRAC_PI_4)), "{}", side(&file, 0.5));
    assert!(close(side(&file, 1.0 / 3.0), along(PI / 6.0)), "an even pace");
    // The same rotation by the other quaternion is no way round.
    let other = [turn(0.0), turn(FRAC_PI_2).map(|x| -x)].concat();
    let file = moved("rotation", &[0.0, 1.0], &other, "LINEAR");
    assert!(close(side(&file, 0.5), along(FRAC_PI_4)), "{}", side(&file, 0.5));
    // Quaternions that are not of length 1 are made so, also between keys of a spline.
    let long =
        [[0.0; 4], turn(0.0).map(|x| 3.0 * x), [0.0; 4], [0.0; 4], turn(FRAC_PI_2), [0.0; 4]];
    let file = moved("rotation", &[0.0, 1.0], &long.concat(), "CUBICSPLINE");
    let scene = at(&file, 0.5).unwrap();
    assert!((scene.bounds().unwrap().1.length() - 2.0f32.sqrt()).abs() < 0.5);
    assert!((side(&file, 0.5).length() - 1.0).abs() < 1e-5);
    // Bytes are fractions.
    let mut file = square();
    let input = file.floats(&[0.0], "SCALAR", 1);
    let output = file.accessor(&[0, 0, 127, 0], 5120, "VEC4", 1);
    file.root["accessors"][output]["normalized"] = json!(true);
    let channel = json!({ "sampler": 0, "target": { "node": 0, "path": "rotation" } });
    let sampler = json!({ "input": input, "output": output });
    file.root["animations"] = json!([{ "channels": [channel], "samplers": [sampler] }]);
    assert!(close(side(&file, 0.0), Vec3::NEG_X), "half a turn");
}

#[test]
fn nested_nodes_move_together_with_lights_and_cameras() {
    let mut file = square();
    file.root["nodes"] = json!([
        { "children": [1], "translation": [0, 0, 5] },
        { "mesh": 0, "camera": 0, "translation": [1, 0, 0],
          "extensions": { "KHR_lights_punctual": { "light": 0 } } },
    ]);
    file.root["cameras"] =
        json!([{ "type": "perspective", "perspective": { "yfov": 1, "znear": 0.1 } }]);
    file.root["extensions"] =
        json!({ "KHR_lights_punctual": { "lights": [{ "type": "spot", "spot": {} }] } });
    let turn = [Quat::IDENTITY.to_array(), Quat::from_rotation_y(FRAC_PI_2).to_array()].concat();
    let rotation = json!({ "node": 0, "path": "rotation" });
    animate(&mut file, rotation, (&[0.0, 1.0], &turn), ("VEC4", "LINEAR"));
    let translation = json!({ "node": 1, "path": "translation" });
    animate(&mut file, translation, (&[0.0, 2.0], &[1., 0., 0., 5., 0., 0.]), ("VEC3", "LINEAR"));
    let scene = at(&file, 1.0).unwrap();
    // The inner node is 3 along its parent's x, which points to −z by then.
    let place = Vec3::new(0.0, 0.0, 2.0);
    assert!(close(scene.vertices[0].position, place), "{:?}", positions(&scene));
    assert!(close(scene.cameras[0].to_world.w_axis.truncate(), place));
    assert!(close(scene.lights[0].position, place));
    assert!(close(scene.lights[0].direction, Vec3::NEG_X), "{}", scene.lights[0].direction);
    assert_eq!(scene.warnings, []);
}

#[test]
fn weights_and_joints_are_animated() {
    let mut file = morphing();
    let weights = [0., 0., 1., 0., 0., 1.];
    let target = json!({ "node": 0, "path": "weights" });
    animate(&mut file, target, (&[0.0, 1.0, 2.0], &weights), ("SCALAR", "LINEAR"));
    let scene = at(&file, 1.5).unwrap();
    assert!(has(&scene, Vec3::new(2.0, 1.0, 2.0)), "{:?}", positions(&scene));
    let mut file = bendable();
    let turn = [Quat::IDENTITY.to_array(), Quat::from_rotation_x(PI / 1.5).to_array()].concat();
    let target = json!({ "node": 2, "path": "rotation" });
    animate(&mut file, target, (&[0.0, 4.0], &turn), ("VEC4", "LINEAR"));
    let scene = at(&file, 3.0).unwrap();
    assert!(has(&scene, Vec3::new(0.0, 1.0, 1.0)), "a quarter turn: {:?}", positions(&scene));
}

#[test]
fn cubic_weights_have_three_parts_a_key() {
    let mut file = morphing();
    // Of both targets in-tangents, then values, then out-tangents.
    let values = [0., 0., 0., 0., 0., 0., 0., 0., 1., 0.5, 0., 0.];
    let target = json!({ "node": 0, "path": "weights" });
    animate(&mut file, target, (&[0.0, 2.0], &values), ("SCALAR", "CUBICSPLINE"));
    // Half way between flat ends: half of both.
    let scene = at(&file, 1.0).unwrap();
    assert!(has(&scene, Vec3::new(1.5, 1.0, 2.0)), "{:?}", positions(&scene));
}

#[test]
fn scenes_are_chosen_by_name_or_index() {
    let mut file = square();
    file.root["scenes"] = json!([{ "nodes": [0] }, { "nodes": [1], "name": "far" }]);
    file.root["nodes"] = json!([{ "mesh": 0 }, { "mesh": 0, "translation": [9, 0, 0] }]);
    file.root["scene"] = json!(0);
    let of = |choice: Option<Choice>| {
        shown(&file, &ImportOptions { scene: choice, ..ImportOptions::default() })
    };
    let first = of(None).unwrap();
    assert!(warned(&first, "scenes: only scene 0 of 2 is shown"), "{:?}", first.warnings);
    assert_eq!(first.scenes, [None, Some("far".to_owned())]);
    for choice in [Choice::Index(1), Choice::Name("far".into()), Choice::Word("1".into())] {
        let scene = of(Some(choice)).unwrap();
        assert_eq!((scene.bounds().unwrap().0.x, scene.warnings), (9.0, vec![]));
    }
    let error = of(Some(Choice::Word("near".into()))).unwrap_err();
    assert!(error.what.contains(r#"no scene "near"; there are: 0, 1 "far""#), "{error}");
}

#[test]
fn coarser_levels_of_detail_are_not_shown() {
    let mut file = square();
    let lod = json!({ "MSFT_lod": { "ids": [1] } });
    file.root["nodes"] =
        json!([{ "mesh": 0, "extensions": lod }, { "mesh": 0, "translation": [9, 0, 0] }]);
    file.root["extensionsUsed"] = json!(["MSFT_lod"]);
    assert_eq!(at_rest(&file).unwrap().warnings, []);
    file.root.as_object_mut().unwrap().remove("scenes");
    let scene = at_rest(&file).unwrap();
    assert_eq!(scene.triangles.len(), 2, "all root nodes but the coarse one");
}

/// A square that is shown three times.
pub(super) fn instanced() -> File {
    let mut file = square();
    let translation = file.floats(&[0., 0., 0., 0., 5., 0., 0., 0., 5.], "VEC3", 3);
    let turned = [[0, 0, 0, 127], [0, 0, 127, 0], [0, 0, 0, 127]].concat();
    let rotation = file.accessor(&turned, 5120, "VEC4", 3);
    file.root["accessors"][rotation]["normalized"] = json!(true);
    let scale = file.floats(&[1., 1., 1., 1., 1., 1., 2., -1., 1.], "VEC3", 3);
    let ids = file.floats(&[1., 2., 3.], "SCALAR", 1);
    file.root["nodes"][0]["translation"] = json!([100, 0, 0]);
    file.root["nodes"][0]["extensions"] = json!({ "EXT_mesh_gpu_instancing": { "attributes":
        { "TRANSLATION": translation, "ROTATION": rotation, "SCALE": scale, "_ID": ids } } });
    file.root["extensionsRequired"] = json!(["EXT_mesh_gpu_instancing"]);
    file
}

#[test]
fn instances_stand_where_their_attributes_say() {
    let mut file = instanced();
    let scene = at_rest(&file).unwrap();
    assert_eq!((scene.triangles.len(), &scene.warnings[..]), (6, &[][..]));
    // As it is; by half a turn; twice as wide and upside down, which leaves its front.
    for far in [Vec3::new(101., 1., 0.), Vec3::new(99., 4., 0.), Vec3::new(102., -1., 5.)] {
        assert!(has(&scene, far), "{far}: {:?}", positions(&scene));
    }
    for triangle in &scene.triangles {
        let [a, b, c] = scene.corners(triangle);
        assert!(close((b - a).cross(c - a).normalize(), Vec3::Z));
    }
    let limits = ImportLimits { max_triangles: 5, ..ImportLimits::default() };
    let error = shown(&file, &ImportOptions { limits, ..ImportOptions::default() }).unwrap_err();
    let what = "6 triangles with all instances; 5 are allowed";
    assert!(error.too_large && error.what == what, "{error}");
    let attributes = "/nodes/0/extensions/EXT_mesh_gpu_instancing/attributes";
    file.root.pointer_mut(attributes).unwrap()["COLOR_0"] = json!(1);
    assert!(warned(&at_rest(&file).unwrap(), "attributes.COLOR_0: is ignored"));
}

/// Four thousand million instances are counted before anything is made of them.
#[test]
fn instances_are_counted_first() {
    let mut file = instanced();
    let many = json!({ "componentType": 5126, "type": "VEC3", "count": u32::MAX });
    let many = file.push("accessors", many);
    file.root["nodes"][0]["extensions"] = json!(
        { "EXT_mesh_gpu_instancing": { "attributes": { "TRANSLATION": many } } });
    let error = at_rest(&file).unwrap_err();
    assert!(error.too_large && error.what.starts_with("8589934590 triangles"), "{error}");
}
