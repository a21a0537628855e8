//! The JSON part, read into the `gltf` crate's typed structs and judged by its validation.

use crate::scene::SceneError;
use gltf::json::mesh::Semantic;
use gltf::json::validation::{Checked, Error, Validate};
use gltf::json::{Index, Material, Path, Root};
use serde::de::DeserializeOwned;
use serde_json::{Number, Value, json};
use std::collections::HashMap;

/// What a sender can do about a file that breaks the format.
pub(super) const FIX_FILE: &str = "check the file with a glTF validator and export it again";

/// Longest piece of the file that a message or a name repeats, in characters.
const MAX_QUOTED_CHARS: usize = 100;

/// Most memory that the parsed JSON may take, bytes.
const MAX_PARSED_BYTES: usize = 512 << 20;

/// Members that may exceed 32 bits.
const SIZES: &[&str] = &["byteLength", "byteOffset", "count"];

/// By member: the list that its index points into; all others point at accessors.
const LISTS: &[(&str, &str)] = &[
    ("buffer", "buffers"),
    ("bufferView", "bufferViews"),
    ("camera", "cameras"),
    ("children", "nodes"),
    ("index", "textures"),
    ("joints", "nodes"),
    ("material", "materials"),
    ("mesh", "meshes"),
    ("nodes", "nodes"),
    ("sampler", "samplers"),
    ("scene", "scenes"),
    ("skin", "skins"),
    ("source", "images"),
];

/// What `serde` calls things, and what glTF does.
const TERMS: &[(&str, &str)] = &[
    ("expected u64", "expected a whole number that is not negative"),
    ("expected u32", "expected a whole number that is not negative"),
    ("expected usize", "expected a whole number that is not negative"),
    ("expected index into child of root", "expected an index"),
    ("expected f32", "expected a number"),
    ("expected a sequence", "expected an array"),
    ("expected a map", "expected an object"),
    ("expected struct ", "expected an object, "),
    ("invalid type: sequence", "invalid type: array"),
    ("invalid type: map", "invalid type: object"),
];

/// By the crate's word at the end of a path within a morph target: the format's.
const TARGET_MEMBERS: &[(&str, &str)] =
    &[(".positions", ".POSITION"), (".normals", ".NORMAL"), (".tangents", ".TANGENT")];

/// Parts of the paths of what the import never reads; that is not held against the file.
const UNREAD: &[&str] = &[
    // Covers `extensionsRequired` too, which is checked where hints are given.
    "extensions",
    // Read, but what is wrong with a camera costs the camera alone.
    "cameras[",
    ".skeleton",
    "occlusionTexture",
    ".minFilter",
    "<invalid semantic name>",
];

/// The end of the path of what else it never reads: what a buffer view is for. Morph targets, whose
/// paths go on behind the same word, are read.
const UNREAD_END: &str = "].target";

/// A malformed input, to be mended by exporting the file again.
pub(super) fn malformed(at: impl Into<String>, what: impl Into<String>) -> SceneError {
    SceneError::malformed(at, what, FIX_FILE)
}

/// `text` shortened for messages and names.
pub(super) fn clip(text: &str) -> String {
    match text.char_indices().nth(MAX_QUOTED_CHARS) {
        Some((end, _)) => format!("{}…", &text[..end]),
        None => text.to_owned(),
    }
}

/// A `name`, shortened; `None` when it is absent or empty.
pub(super) fn name(name: &Option<String>) -> Option<String> {
    name.as_deref().filter(|name| !name.is_empty()).map(clip)
}

/// A value of an enumeration.
pub(super) fn valid<T: Copy>(value: &Checked<T>, at: impl Into<String>) -> Result<T, SceneError> {
    match value {
        Checked::Valid(value) => Ok(*value),
        Checked::Invalid => Err(malformed(at, "is not a value that glTF 2.0 allows here")),
    }
}

/// The JSON part, typed.
pub(super) struct Document {
    /// All that the crate knows.
    pub root: Root,
    /// By material: whether its `extras.phong` is true.
    pub phong: Vec<bool>,
    /// The list of animations as it stands, in which the crate knows no channels without a node.
    pub animations: Value,
    /// What the crate does not know of morph targets.
    pub more_targets: MoreTargets,
}

/// Attributes of morph targets beside positions, normals and tangents: by mesh and primitive, the
/// target, the attribute's name and its accessor, which may be out of range.
pub(super) type MoreTargets = HashMap<(usize, usize), Vec<(usize, &'static str, u64)>>;

/// Reads the JSON part. In what it returns, every index of a node, mesh, camera, skin, material,
/// texture, accessor or buffer view that the import follows is in range, but for the
/// `source` of a texture, which may be absent, for those within extensions, and for those of
/// animations and of [`MoreTargets`].
pub(super) fn read(text: &[u8]) -> Result<Document, SceneError> {
    check_size(text)?;
    let mut json: Value = serde_json::from_slice(text).map_err(|error| {
        malformed(
            format!("JSON, line {}, column {}", error.line(), error.column()),
            format!("not valid JSON: {}", clip(&error.to_string())),
        )
    })?;
    if !json.is_object() {
        return Err(malformed("JSON", "the root is not an object"));
    }
    check_version(&json)?;
    let materials = json.get("materials").and_then(Value::as_array).into_iter().flatten();
    let phong = materials.map(|object| object.pointer("/extras/phong") == Some(&json!(true)));
    let phong = phong.collect();
    let animations = adapt(&mut json);
    let more_targets = more_targets(&json);
    // Even an empty material is large once typed.
    let materials = length(&json, "materials");
    let most = MAX_PARSED_BYTES / (3 * size_of::<Material>());
    if materials > most {
        return Err(SceneError::too_large(
            "materials",
            format!("{materials} materials; {most} are allowed"),
            "share materials among meshes",
        ));
    }
    let root: Root = typed(&json, "")?;
    validate(&root, &json)?;
    Ok(Document { root, phong, animations, more_targets })
}

/// What stands at `at`, typed; `at` is empty for the whole file.
pub(super) fn typed<T: DeserializeOwned>(json: &Value, at: &str) -> Result<T, SceneError> {
    // Keeping track of the path is slow, so it is done for files that turn out to be wrong.
    T::deserialize(json).or_else(|_| serde_path_to_error::deserialize(json)).map_err(
        |error: serde_path_to_error::Error<serde_json::Error>| {
            let at = match (at, error.path().to_string().as_str()) {
                ("", ".") => "JSON".to_owned(),
                (at, ".") => at.to_owned(),
                (at, path) => clip(&format!("{at}{path}")),
            };
            let what = error.into_inner().to_string();
            let what = TERMS.iter().fold(what, |what, (serde, ours)| what.replace(serde, ours));
            malformed(at, clip(&what))
        },
    )
}

/// Refuses what might take too much memory once parsed.
fn check_size(text: &[u8]) -> Result<(), SceneError> {
    // An upper bound on what the parsed tree takes, and about what its typed form takes again: a map
    // allocates whole B-tree nodes and a list at least four elements, so a hostile file could
    // otherwise grow a hundredfold. Text in strings counts as well, and escapes as the worst that
    // they can hide: `serde_json` parses a string whose key is its own mark for raw values.
    let estimate = text.windows(2).fold(text.len(), |sum, pair| {
        sum.saturating_add(match pair {
            [b'{', _] | b"\\u" => 640,
            [b':' | b'[', _] => 128,
            [b',', _] => 64,
            _ => 0,
        })
    });
    if estimate > MAX_PARSED_BYTES {
        return Err(SceneError::too_large(
            "JSON",
            format!(
                "the JSON part may need {estimate} bytes once parsed; {MAX_PARSED_BYTES} are allowed"
            ),
            "send fewer nodes, meshes and accessors, or merge them",
        ));
    }
    Ok(())
}

/// Refuses other versions before anything in them looks wrong. An absent one is no version 2 either,
/// as the crate will say.
fn check_version(json: &Value) -> Result<(), SceneError> {
    let of = |key: &str| json.pointer(key).and_then(Value::as_str);
    let version = of("/asset/version").unwrap_or("2.0");
    let needed = of("/asset/minVersion").unwrap_or("2.0");
    let unsupported = if version.starts_with("2.") { needed } else { version };
    if unsupported == "2.0" {
        return Ok(());
    }
    Err(SceneError::malformed(
        "asset.version",
        format!("glTF {} is not supported", clip(unsupported)),
        "export the scene as glTF 2.0",
    ))
}

/// Makes what the format allows, or exporters write, fit the crate's structs. Returns the list of
/// animations, which is taken out.
fn adapt(json: &mut Value) -> Value {
    // `nodes` is optional by the format and required by the crate.
    for scene in list(json, "scenes").filter_map(Value::as_object_mut) {
        scene.entry("nodes").or_insert_with(|| json!([]));
    }
    // Unused here; validation would copy them for every primitive.
    for accessor in list(json, "accessors").filter_map(Value::as_object_mut) {
        accessor.remove("min");
        accessor.remove("max");
    }
    normalise(json, false);
    json.as_object_mut().and_then(|root| root.remove("animations")).unwrap_or_default()
}

/// The attributes of morph targets that the crate does not know.
fn more_targets(json: &Value) -> MoreTargets {
    fn items<'a>(value: &'a Value, key: &str) -> impl Iterator<Item = (usize, &'a Value)> {
        value.get(key).and_then(Value::as_array).into_iter().flatten().enumerate()
    }
    let mut found = MoreTargets::new();
    for (mesh, object) in items(json, "meshes") {
        for (primitive, object) in items(object, "primitives") {
            for (target, object) in items(object, "targets") {
                for name in ["TEXCOORD_0", "TEXCOORD_1", "COLOR_0"] {
                    if let Some(value) = object.get(name) {
                        let accessor = value.as_u64().unwrap_or(u64::MAX);
                        found.entry((mesh, primitive)).or_default().push((target, name, accessor));
                    }
                }
            }
        }
    }
    found
}

fn list<'a>(json: &'a mut Value, key: &str) -> impl Iterator<Item = &'a mut Value> {
    json.get_mut(key).and_then(Value::as_array_mut).into_iter().flatten()
}

/// Drops `extras` and nulls, takes `4.0` for 4, and makes integers beyond 32 bits floats, since the
/// crate would cut them off to indices and codes that are in range.
fn normalise(value: &mut Value, is_size: bool) {
    match value {
        Value::Array(items) => items.iter_mut().for_each(|item| normalise(item, is_size)),
        Value::Object(members) => {
            members.retain(|key, value| key != "extras" && !value.is_null());
            for (key, value) in members {
                normalise(value, SIZES.contains(&key.as_str()));
            }
        }
        Value::Number(number) if !(is_size && number.is_u64()) => {
            let most = if is_size { 9e15 } else { f64::from(u32::MAX) };
            match number.as_f64() {
                Some(float) if float.fract() == 0.0 && (0.0..=most).contains(&float) => {
                    *number = Number::from(float as u64);
                }
                Some(float) if number.is_u64() => {
                    *number = Number::from_f64(float).unwrap_or_else(|| Number::from(0));
                }
                _ => {}
            }
        }
        _ => {}
    }
}

/// Refuses indices out of range and unknown codes wherever the import reads them. Absent members
/// are judged where they are read.
fn validate(root: &Root, json: &Value) -> Result<(), SceneError> {
    let mut first = position_out_of_range(root).map(|at| (at, Error::IndexOutOfBounds));
    if first.is_none() {
        root.validate(root, Path::new, &mut |path, error| {
            if first.is_some() || error == Error::Missing {
                return;
            }
            let at = path().0.replace("[\"", ".").replace("\"]", "");
            let is_unread = at.ends_with(UNREAD_END) || UNREAD.iter().any(|part| at.contains(part));
            if !is_unread {
                first = Some((at, error));
            }
        });
    }
    let Some((mut at, error)) = first else { return Ok(()) };
    if at.contains("].targets[") {
        for (ours, theirs) in TARGET_MEMBERS {
            at = at.replace(ours, theirs);
        }
    }
    let pointer = format!("/{}", at.replace(['.', '['], "/").replace(']', ""));
    let value = json.pointer(&pointer).map_or("the value".into(), |value| clip(&value.to_string()));
    let what = match error {
        Error::IndexOutOfBounds => {
            let member = at.rsplit('.').next().and_then(|member| member.split('[').next());
            let list = LISTS.iter().find(|(key, _)| Some(*key) == member);
            let list = list.map_or("accessors", |(_, list)| list);
            format!("{value}, but there are {} {list}", length(json, list))
        }
        _ => format!("{value} is not a value that glTF 2.0 allows here"),
    };
    Err(malformed(clip(&at), what))
}

/// Length of a list of the root.
fn length(json: &Value, key: &str) -> usize {
    json.get(key).and_then(Value::as_array).map_or(0, Vec::len)
}

/// The first primitive whose positions are out of range, on which the crate's validation panics.
fn position_out_of_range(root: &Root) -> Option<String> {
    let out_of_range = |index: &Index<_>| index.value() >= root.accessors.len();
    root.meshes.iter().enumerate().find_map(|(mesh, object)| {
        let primitive = object.primitives.iter().position(|primitive| {
            primitive.attributes.get(&Checked::Valid(Semantic::Positions)).is_some_and(out_of_range)
        })?;
        Some(format!("meshes[{mesh}].primitives[{primitive}].attributes.POSITION"))
    })
}
