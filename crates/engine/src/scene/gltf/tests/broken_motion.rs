//! Skins, morph targets, animations and instances that break the format: each is refused with its
//! place, or warned of.

use super::File;
use super::motion::{at, at_rest, bendable, instanced, morphing, moved, shown, warned};
use crate::scene::gltf::{Choice, ImportOptions};
use crate::scene::{Scene, SceneError};
use serde_json::{Value, json};

/// Refused at a place that contains `place`, with a message that contains `what`.
fn refused(outcome: Result<Scene, SceneError>, place: &str, what: &str) {
    let error = outcome.map(|scene| scene.warnings).unwrap_err();
    assert!(error.at.contains(place) && error.what.contains(what), "{place}, {what}: {error}");
}

#[test]
fn broken_skins_are_refused_by_their_place() {
    let set = |pointer: &str, value: Value| {
        let mut file = bendable();
        *file.root.pointer_mut(pointer).unwrap() = value;
        at_rest(&file)
    };
    refused(set("/nodes/0/skin", json!(1)), "nodes[0].skin", "1, but there are 1 skins");
    refused(set("/skins/0/joints/1", json!(3)), "skins[0].joints[1]", "3, but there are 3 nodes");
    refused(set("/skins/0/joints", json!([])), "skins[0].joints", "is empty");
    let inverse = "/skins/0/inverseBindMatrices";
    refused(set(inverse, json!(9)), "skins[0].inverseBindMatrices", "there are 5 accessors");
    refused(set(inverse, json!(0)), "skins[0].inverseBindMatrices", "is Vec3 of F32");
    refused(
        set("/accessors/4/count", json!(1)),
        "skins[0].inverseBindMatrices",
        "1 matrices for 2",
    );
    let attribute = |name: &str| format!("/meshes/0/primitives/0/attributes/{name}");
    refused(set(&attribute("JOINTS_0"), json!(3)), "JOINTS_0", "is Vec4 of F32");
    refused(set(&attribute("WEIGHTS_0"), json!(0)), "WEIGHTS_0", "is Vec3 of F32");
    refused(set("/accessors/2/count", json!(5)), "JOINTS_0", "has 5 elements for 6 positions");
    refused(set("/accessors/3/count", json!(5)), "WEIGHTS_0", "has 5 elements for 6 positions");
}

#[test]
fn broken_weights_and_matrices_are_refused_by_their_place() {
    let write = |offset: usize, bytes: &[u8]| {
        let mut file = bendable();
        file.binary[offset..offset + bytes.len()].copy_from_slice(bytes);
        at_rest(&file)
    };
    let begins =
        |view: usize| bendable().root["bufferViews"][view]["byteOffset"].as_u64().unwrap() as usize;
    assert!(write(begins(2) + 20, &[2]).is_ok(), "a joint without weight may be anything");
    refused(write(begins(2) + 21, &[2]), "accessors[2]", "vertex 5 follows joint 2 of 2");
    let nan = f32::NAN.to_le_bytes();
    refused(write(begins(3), &nan), "accessors[3]", "vertex 0 has the weight NaN");
    let negative = (-1.0f32).to_le_bytes();
    refused(write(begins(3), &negative), "accessors[3]", "vertex 0 has the weight -1");
    refused(write(begins(4) + 64, &nan), "accessors[4]", "matrix 1 is not finite or not affine");
    refused(
        write(begins(4) + 12, &negative),
        "accessors[4]",
        "matrix 0 is not finite or not affine",
    );
    let mut file = bendable();
    file.root["meshes"][0]["primitives"][0]["attributes"]
        .as_object_mut()
        .unwrap()
        .remove("WEIGHTS_0");
    refused(at_rest(&file), "attributes", "has JOINTS_0, but no WEIGHTS_0");
}

#[test]
fn skins_without_weights_are_warned_of() {
    let mut file = bendable();
    let zeros = file.floats(&[0.0; 24], "VEC4", 4);
    file.attribute("WEIGHTS_0", zeros);
    assert!(warned(&at_rest(&file).unwrap(), "6 vertices have no weight"));
    let attributes = file.root["meshes"][0]["primitives"][0]["attributes"].as_object_mut().unwrap();
    for name in ["JOINTS_0", "WEIGHTS_0"] {
        attributes.remove(name);
    }
    let scene = at_rest(&file).unwrap();
    assert!(warned(&scene, "has no joints (JOINTS_0)"), "{:?}", scene.warnings);
    assert_eq!(scene.bounds().unwrap().1.z, 70.0, "it stays at its node");
}

#[test]
fn broken_morph_targets_are_refused_by_their_place() {
    let set = |pointer: &str, value: Value| {
        let mut file = morphing();
        file.root["meshes"][0]["weights"] = json!([1, 1]);
        file.root["nodes"][0]["weights"] = json!([1, 1]);
        *file.root.pointer_mut(pointer).unwrap() = value;
        at_rest(&file)
    };
    let target = "/meshes/0/primitives/0/targets/0";
    let at = "meshes[0].primitives[0].targets[0].";
    for name in ["POSITION", "NORMAL", "TANGENT", "COLOR_0", "TEXCOORD_1"] {
        let at = format!("{at}{name}");
        let what = "5 accessors";
        refused(set(target, json!({ name: 5 })), &at, what);
    }
    refused(set("/accessors/2/type", json!("VEC2")), &format!("{at}POSITION"), "is Vec2 of F32");
    refused(set("/accessors/3/count", json!(3)), &format!("{at}NORMAL"), "3 elements for 4");
    refused(
        set("/nodes/0/weights", json!([1])),
        "nodes[0].weights",
        "1 weights for 2 morph targets",
    );
    refused(set("/nodes/0/weights", json!([1, 1e300])), "nodes[0].weights[1]", "is not finite");
    let mut file = morphing();
    file.root["meshes"][0]["weights"] = json!([1, 2, 3]);
    refused(at_rest(&file), "meshes[0].weights", "3 weights for 2 morph targets");
    let mut file = morphing();
    file.root["meshes"][0]["weights"] = json!([1, 0]);
    let begin = file.root["bufferViews"][2]["byteOffset"].as_u64().unwrap() as usize;
    file.binary[begin..begin + 4].copy_from_slice(&f32::INFINITY.to_le_bytes());
    refused(at_rest(&file), "accessors[2]", "element 0 is not finite");
    let mut file = morphing();
    let bare = json!({ "attributes": { "POSITION": 0 }, "mode": 0 });
    file.root["meshes"][0]["primitives"].as_array_mut().unwrap().push(bare);
    refused(at_rest(&file), "primitives[1].targets", "0 morph targets, but the mesh's first");
}

#[test]
fn displacements_are_counted_first() {
    let mut file = morphing();
    // A mesh of many corners that are all the same, and many targets that cost nothing.
    let many = json!({ "componentType": 5126, "type": "VEC3", "count": 3_000_000 });
    let position = file.push("accessors", many);
    let primitive = &mut file.root["meshes"][0]["primitives"][0];
    *primitive = json!({ "attributes": { "POSITION": position }, "targets": vec![json!({ "POSITION": position }); 100] });
    file.root["meshes"][0]["weights"] = json!(vec![1; 100]);
    let error = at_rest(&file).unwrap_err();
    assert!(error.too_large && error.what.contains("displace 300000000 vertices"), "{error}");
}

/// The square that moves along x.
fn slide() -> File {
    moved("translation", &[0.0, 1.0], &[0., 0., 0., 1., 0., 0.], "LINEAR")
}

/// The sliding square with something else in its file, at rest and in motion.
fn altered(pointer: &str, value: Value) -> [Result<Scene, SceneError>; 2] {
    let mut file = slide();
    *file.root.pointer_mut(pointer).unwrap() = value;
    [at_rest(&file), at(&file, 0.5)]
}

/// Indices are judged whether the animation is chosen or not.
#[test]
fn animations_that_name_what_is_not_there_are_refused() {
    let wrong = |pointer: &str, value: Value, place: &str, what: &str| {
        for outcome in altered(&format!("/animations/0/{pointer}"), value) {
            refused(outcome, &format!("animations[0].{place}"), what);
        }
    };
    let channel = "channels[0]";
    let sampler = format!("{channel}.sampler");
    wrong("channels/0/sampler", json!(1), &sampler, "there are 1 samplers");
    let node = format!("{channel}.target.node");
    wrong("channels/0/target/node", json!(7), &node, "7, but there are 1 nodes");
    wrong("samplers/0/input", json!(3), "samplers[0].input", "there are 3 accessors");
    wrong("samplers/0/output", json!(4), "samplers[0].output", "there are 3 accessors");
    wrong("samplers/0/interpolation", json!("WILD"), "samplers[0].interpolation", "WILD");
    wrong("channels/0", json!({ "sampler": 0 }), channel, "missing field `target`");
    for outcome in altered("/animations", json!({})) {
        refused(outcome, "animations", "expected an array");
    }
}

#[test]
fn broken_animations_are_refused_where_they_are_chosen() {
    let wrong = |pointer: &str, value: Value, place: &str, what: &str| {
        let [rest, moved] = altered(pointer, value);
        assert!(rest.is_ok(), "{pointer}");
        refused(moved, &format!("animations[0].{place}"), what);
    };
    let path = "/animations/0/channels/0/target/path";
    let at = "channels[0].target.path";
    wrong(path, json!("colour"), at, "\"colour\" is not a property");
    wrong(path, json!("rotation"), "samplers[0].output", "is Vec3 of F32");
    let sampler = "/animations/0/samplers/0";
    let of = |member: &str| format!("{sampler}/{member}");
    wrong(&of("input"), json!(0), "samplers[0].input", "times are Scalar of F32");
    let output = "samplers[0].output";
    wrong(&of("output"), json!(0), output, "has 4 elements; 2 keys need 2");
    wrong(&of("interpolation"), json!("CUBICSPLINE"), output, "2 keys need 6");
    let matrix = json!({ "mesh": 0, "matrix": glam::Mat4::IDENTITY.to_cols_array() });
    wrong("/nodes/0", matrix, "channels[0].target.node", "node 0 has a matrix");
}

#[test]
fn keys_that_are_no_moments_are_refused() {
    let values = [0.0; 6];
    let of = |times: [f32; 2]| at(&moved("translation", &times, &values, "LINEAR"), 0.5);
    refused(of([0.0, f32::NAN]), "accessors[1]", "key 1 is at NaN seconds");
    refused(of([-1.0, 1.0]), "accessors[1]", "key 0 is at -1 seconds");
    refused(of([0.0, f32::INFINITY]), "accessors[1]", "key 1 is at inf seconds");
    refused(of([1.0, 1.0]), "accessors[1]", "key 1 is at 1 s, not after the one before at 1 s");
    refused(of([2.0, 1.0]), "accessors[1]", "key 1 is at 1 s, not after");
    let nan = moved("translation", &[0.0, 1.0], &[0., 0., 0., f32::NAN, 0., 0.], "LINEAR");
    refused(at(&nan, 0.5), "accessors[2]", "element 1 is not finite");
    let flat = moved("rotation", &[0.0, 1.0], &[0., 0., 0., 1., 0., 0., 0., 0.], "LINEAR");
    refused(at(&flat, 0.5), "accessors[2]", "key 1 is not a rotation");
    assert!(at(&flat, 0.0).is_ok(), "only keys about the moment are read");
    for time in [f64::NAN, f64::INFINITY, -0.5] {
        refused(at(&slide(), time), "time", "is no moment of an animation");
    }
    let unknown = Some(Choice::Name("jump".into()));
    let options = ImportOptions { animation: unknown, ..ImportOptions::default() };
    refused(shown(&slide(), &options), "animations", r#"no animation "jump"; there are: 0 "move""#);
}

#[test]
fn what_cannot_be_moved_is_warned_of() {
    let mut file = slide();
    let channels = file.root.pointer_mut("/animations/0/channels").unwrap().as_array_mut().unwrap();
    let pointer = json!({ "KHR_animation_pointer": { "pointer": "/materials/0/emissiveFactor" } });
    channels.extend([
        json!({ "sampler": 0, "target": { "path": "pointer", "extensions": pointer } }),
        json!({ "sampler": 0, "target": { "path": "translation" } }),
        json!({ "sampler": 0, "target": { "node": 0, "path": "weights" } }),
        json!({ "sampler": 0, "target": { "node": 0, "path": "translation" } }),
    ]);
    file.root["extensionsUsed"] = json!(["KHR_animation_pointer"]);
    let scene = at(&file, 0.5).unwrap();
    assert_eq!(scene.vertices[0].position.x, 0.5);
    let warnings: Vec<_> = scene.warnings.iter().map(|w| format!("{}: {}", w.at, w.what)).collect();
    for (place, text) in [
        (1, "only what the format itself animates"),
        (2, "names no node"),
        (3, "no mesh with morph targets"),
        (4, "moves already"),
    ] {
        let at = format!("animations[0].channels[{place}].target: ");
        assert!(warnings.iter().any(|w| w.starts_with(&at) && w.contains(text)), "{warnings:?}");
    }
    assert_eq!(warnings.len(), 4, "{warnings:?}");
}

#[test]
fn broken_instances_are_refused_by_their_place() {
    let set = |pointer: &str, value: Value| {
        let mut file = instanced();
        *file.root.pointer_mut(pointer).unwrap() = value;
        at_rest(&file)
    };
    let attributes = "/nodes/0/extensions/EXT_mesh_gpu_instancing/attributes";
    let at = "nodes[0].extensions.EXT_mesh_gpu_instancing.attributes";
    refused(set(attributes, json!({})), at, "missing or empty");
    refused(set(attributes, json!(3)), at, "missing or empty");
    let scale = format!("{attributes}/SCALE");
    refused(set(&scale, json!(99)), "attributes.SCALE", "99, but there are 5 accessors");
    refused(set(&scale, json!("one")), "attributes.SCALE", "but there are 5 accessors");
    refused(set(&scale, json!(2)), "attributes.SCALE", "is Vec4 of I8");
    refused(set("/accessors/1/count", json!(2)), "attributes.TRANSLATION", "has 2 elements");
    let write = |view: usize, bytes: &[u8]| {
        let mut file = instanced();
        let begin = file.root["bufferViews"][view]["byteOffset"].as_u64().unwrap() as usize;
        file.binary[begin..begin + bytes.len()].copy_from_slice(bytes);
        at_rest(&file)
    };
    refused(write(1, &f32::NAN.to_le_bytes()), "accessors[1]", "element 0 is not finite");
    refused(write(2, &[0; 4]), "accessors[2]", "element 0 is not a rotation");
}
