//! Broken skins, morph targets, animations and instances.

use super::{Cases, accepted, refused, too_large};
use serde_json::{Value, json};

/// Adds an accessor of `count` elements that reads what follows at the end of the binary part.
fn accessor(root: &mut Value, binary: &mut Vec<u8>, bytes: &[u8], object: Value) -> usize {
    binary.resize(binary.len().next_multiple_of(4), 0);
    let views = root["bufferViews"].as_array_mut().expect("a list");
    views.push(json!({ "buffer": 0, "byteOffset": binary.len(), "byteLength": bytes.len() }));
    let view = views.len() - 1;
    binary.extend_from_slice(bytes);
    root["buffers"][0]["byteLength"] = json!(binary.len());
    let accessors = root["accessors"].as_array_mut().expect("a list");
    accessors.push(object);
    let index = accessors.len() - 1;
    accessors[index]["bufferView"] = json!(view);
    index
}

/// As [`accessor`], of floats.
fn floats(root: &mut Value, binary: &mut Vec<u8>, values: &[f32], kind: &str) -> usize {
    let width = match kind {
        "SCALAR" => 1,
        "VEC3" => 3,
        "VEC4" => 4,
        _ => 16,
    };
    let bytes: Vec<u8> = values.iter().flat_map(|value| value.to_le_bytes()).collect();
    let count = values.len() / width;
    accessor(root, binary, &bytes, json!({ "componentType": 5126, "type": kind, "count": count }))
}

/// Gives the file everything that moves: its mesh two joints and a morph target, and an animation
/// that turns a joint, moves the camera and changes the weight; and another mesh in two instances.
pub fn with_motion(root: &mut Value, binary: &mut Vec<u8>) {
    let bytes = json!({ "componentType": 5121, "type": "VEC4", "count": 3 });
    let joints = accessor(root, binary, &[0, 1, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0], bytes.clone());
    let weights = accessor(root, binary, &[255, 0, 0, 0, 128, 127, 0, 0, 0, 255, 0, 0], bytes);
    root["accessors"][weights]["normalized"] = json!(true);
    let identity: Vec<f32> = (0..16).map(|i| if i % 5 == 0 { 1.0 } else { 0.0 }).collect();
    let inverse = floats(root, binary, &identity.repeat(2), "MAT4");
    let lift = floats(root, binary, &[0.0, 0.0, 0.5].repeat(3), "VEC3");
    let times = floats(root, binary, &[0.0, 1.0], "SCALAR");
    let turns = floats(root, binary, &[0.0, 0.0, 0.0, 1.0, 0.0, 0.6, 0.0, 0.8], "VEC4");
    let steps = floats(root, binary, &[0.0, 0.0, 3.0, 0.0, 1.0, 4.0], "VEC3");
    let spline = floats(root, binary, &[0.0, 0.0, 1.0, 1.0, 1.0, 0.0], "SCALAR");
    let nodes = root["nodes"].as_array_mut().expect("a list");
    let first = nodes.len();
    nodes.extend([json!({ "children": [first + 1] }), json!({ "translation": [0, 0.5, 0] })]);
    let instancing = json!({ "attributes": { "TRANSLATION": steps, "ROTATION": turns } });
    let copied = json!({ "EXT_mesh_gpu_instancing": instancing });
    nodes.push(json!({ "mesh": 0, "extensions": copied }));
    nodes[0]["skin"] = json!(0);
    let roots = root["scenes"][0]["nodes"].as_array_mut().expect("a list");
    roots.extend([json!(first), json!(first + 2)]);
    root["skins"] =
        json!([{ "joints": [first, first + 1], "inverseBindMatrices": inverse, "skeleton": 0 }]);
    for primitive in root["meshes"][0]["primitives"].as_array_mut().expect("a list") {
        primitive["attributes"]["JOINTS_0"] = json!(joints);
        primitive["attributes"]["WEIGHTS_0"] = json!(weights);
        primitive["targets"] = json!([{ "POSITION": lift, "NORMAL": lift }]);
    }
    root["meshes"][0]["weights"] = json!([0.25]);
    let channel = |sampler: usize, node: usize, path: &str| json!({ "sampler": sampler, "target": { "node": node, "path": path } });
    root["animations"] = json!([{
        "name": "move",
        "channels": [
            channel(0, first + 1, "rotation"), channel(1, 1, "translation"), channel(2, 0, "weights"),
        ],
        "samplers": [
            { "input": times, "output": turns }, { "input": times, "output": steps, "interpolation": "STEP" },
            { "input": times, "output": spline, "interpolation": "CUBICSPLINE" },
        ],
    }]);
}

/// One member of the moving file set to something else.
pub(super) fn motion(cases: &mut Cases) {
    let mut set = |name: &'static str, pointer: &str, value: Value, expect| {
        cases.edit(name, expect, |root, binary| {
            with_motion(root, binary);
            *root.pointer_mut(pointer).expect("it is there") = value;
        });
    };
    let rest = accepted("animations: the file is shown at rest");
    set("everything that moves", "/nodes/0/skin", json!(0), rest);
    let skin = refused("nodes[0].skin", "1, but there are 1 skins");
    set("skin out of range", "/nodes/0/skin", json!(1), skin);
    let joint = refused("skins[0].joints[1]", "9, but there are 5 nodes");
    set("joint out of range", "/skins/0/joints/1", json!(9), joint);
    set("skeleton out of range", "/skins/0/skeleton", json!(99), rest);
    let inverse = "/skins/0/inverseBindMatrices";
    let kind = refused("skins[0].inverseBindMatrices", "is Vec3 of F32");
    set("inverse bind matrices that are vectors", inverse, json!(0), kind);
    let third = refused("accessors[3]", "follows joint 1 of 1");
    set("a joint that the skin has not", "/skins/0/joints", json!([2]), third);
    let attribute = |name: &str| format!("/meshes/0/primitives/0/attributes/{name}");
    let out = refused("attributes.JOINTS_0", "there are 11 accessors");
    set("joints out of range", &attribute("JOINTS_0"), json!(77), out);
    let target = "/meshes/0/primitives/0/targets/0";
    let position = refused("targets[0].POSITION", "77, but there are 11 accessors");
    set("morph target out of range", target, json!({ "POSITION": 77 }), position);
    let colour = refused("targets[0].COLOR_0", "names none of the 11 accessors");
    set("colours of a morph target out of range", target, json!({ "COLOR_0": -1 }), colour);
    let count = refused("meshes[0].weights", "2 weights for 1 morph targets");
    set("one weight too many", "/meshes/0/weights", json!([1, 1]), count);
    let animation = "/animations/0";
    let of = |member: &str| format!("{animation}/{member}");
    let sampler = refused("animations[0].channels[1].sampler", "there are 3 samplers");
    set("sampler of a channel out of range", &of("channels/1/sampler"), json!(3), sampler);
    let node = refused("animations[0].channels[0].target.node", "there are 5 nodes");
    set("animated node out of range", &of("channels/0/target/node"), json!(5), node);
    let input = refused("animations[0].samplers[0].input", "there are 11 accessors");
    set("times out of range", &of("samplers/0/input"), json!(11), input);
    let output = refused("animations[0].samplers[2].output", "whole number");
    set("animated values at −1", &of("samplers/2/output"), json!(-1), output);
    let copies = "/nodes/4/extensions/EXT_mesh_gpu_instancing/attributes/TRANSLATION";
    let missing = refused("attributes.TRANSLATION", "11, but there are 11 accessors");
    set("places of instances out of range", copies, json!(11), missing);
    let many = too_large("meshes", "4294967296 triangles with all instances");
    cases.edit("instances by the thousand million", many, |root, binary| {
        with_motion(root, binary);
        let places = json!({ "componentType": 5126, "type": "VEC3", "count": u32::MAX });
        root["accessors"].as_array_mut().expect("a list").push(places);
        let attributes = json!({ "TRANSLATION": 11 });
        root["nodes"][4]["extensions"]["EXT_mesh_gpu_instancing"]["attributes"] = attributes;
    });
}
