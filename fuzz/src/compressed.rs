//! Files whose one mesh or picture is there in compressed form only, so that decoders get what the
//! fuzzer makes.

use hemilux::api::scenes::SceneFormat;
use hemilux::worker::scenes::{load, options};
use serde_json::{Value, json};

/// Most triangles of an import.
pub const MAX_TRIANGLES: usize = 10_000;

/// Imports a file whose binary chunk is `binary`, and checks that it ends without a panic.
///
/// # Panics
/// Where the importer does.
pub fn import(json: &Value, binary: &[u8]) {
    let glb = glb(json, binary);
    match load(SceneFormat::Gltf, &glb, &options(MAX_TRIANGLES, None)) {
        Ok(scene) => assert!(scene.triangles.len() <= MAX_TRIANGLES),
        // The service lives through a panic of the importer or of a decoder; here it is a finding.
        Err(refusal) => {
            let what = &refusal.what;
            let is_panic = what.starts_with("the importer failed") || what.contains("gave up");
            assert!(!is_panic, "{refusal}");
        }
    }
}

fn glb(json: &Value, binary: &[u8]) -> Vec<u8> {
    let mut json = json.to_string().into_bytes();
    json.resize(json.len().next_multiple_of(4), b' ');
    let mut binary = binary.to_vec();
    binary.resize(binary.len().next_multiple_of(4), 0);
    let mut glb = b"glTF\x02\0\0\0".to_vec();
    let length = |bytes: &[u8]| (bytes.len() as u32).to_le_bytes();
    glb.extend((28 + json.len() as u32 + binary.len() as u32).to_le_bytes());
    for (name, chunk) in [(b"JSON", &json), (b"BIN\0", &binary)] {
        glb.extend(length(chunk));
        glb.extend(name);
        glb.extend(chunk);
    }
    glb
}

/// A file of one primitive whose accessors are `accessors`, the first of them positions.
fn mesh(accessors: Value, views: Value, size: usize, primitive: Value) -> Value {
    json!({
        "asset": { "version": "2.0" }, "scenes": [{ "nodes": [0] }], "nodes": [{ "mesh": 0 }],
        "meshes": [{ "primitives": [primitive] }], "accessors": accessors, "bufferViews": views,
        "buffers": [{ "byteLength": size }, { "byteLength": 1 << 20 }],
    })
}

/// A primitive whose stream of Draco is `data`.
pub fn draco(data: &[u8]) -> Value {
    let accessor = |component, kind, count| json!({ "componentType": component, "type": kind, "count": count });
    let accessors = json!([
        accessor(5126, "VEC3", 3 * MAX_TRIANGLES),
        accessor(5126, "VEC3", 3 * MAX_TRIANGLES),
        accessor(5126, "VEC2", 3 * MAX_TRIANGLES),
        accessor(5125, "SCALAR", 3 * MAX_TRIANGLES),
    ]);
    let attributes = json!({ "POSITION": 0, "NORMAL": 1, "TEXCOORD_0": 2 });
    let stream = json!({ "bufferView": 0, "attributes": attributes });
    let primitive = json!({
        "attributes": attributes, "indices": 3,
        "extensions": { "KHR_draco_mesh_compression": stream },
    });
    let views = json!([{ "buffer": 0, "byteLength": data.len() }]);
    mesh(accessors, views, data.len(), primitive)
}

/// A primitive whose buffer view has the stream of meshopt `data`, decoded as `how` says: mode,
/// filter, and a part of the number of elements.
pub fn meshopt(how: u8, data: &[u8]) -> Value {
    let (mode, filter, stride, component, kind) = match how % 8 {
        0 => ("ATTRIBUTES", "NONE", 12, 5126, "VEC3"),
        1 => ("ATTRIBUTES", "OCTAHEDRAL", 4, 5120, "VEC3"),
        2 => ("ATTRIBUTES", "OCTAHEDRAL", 8, 5122, "VEC3"),
        3 => ("ATTRIBUTES", "QUATERNION", 8, 5122, "VEC3"),
        4 => ("ATTRIBUTES", "EXPONENTIAL", 12, 5126, "VEC3"),
        5 => ("ATTRIBUTES", "COLOR", 4, 5121, "VEC3"),
        6 => ("TRIANGLES", "NONE", 4, 5125, "SCALAR"),
        _ => ("INDICES", "NONE", 4, 5125, "SCALAR"),
    };
    let count = 3 * (1 + usize::from(how / 8));
    let object = json!({
        "buffer": 0, "byteLength": data.len(), "byteStride": stride, "count": count,
        "mode": mode, "filter": filter,
    });
    let mut views = json!([{
        "buffer": 1, "byteLength": stride * count,
        "extensions": { "KHR_meshopt_compression": object },
    }]);
    if kind == "VEC3" {
        views[0]["byteStride"] = json!(stride);
    }
    let compressed =
        json!({ "bufferView": 0, "componentType": component, "type": kind, "count": count });
    let positions = json!({ "componentType": 5126, "type": "VEC3", "count": count });
    let primitive = match kind {
        "VEC3" => json!({ "attributes": { "POSITION": 0 } }),
        _ => json!({ "attributes": { "POSITION": 1 }, "indices": 0 }),
    };
    mesh(json!([compressed, positions]), views, data.len(), primitive)
}

/// A triangle whose texture is the KTX2 file `data`.
pub fn ktx2(data: &[u8]) -> Value {
    let positions = json!([{ "componentType": 5126, "type": "VEC3", "count": 3 }]);
    let views = json!([{ "buffer": 0, "byteLength": data.len() }]);
    let primitive = json!({ "attributes": { "POSITION": 0 }, "material": 0 });
    let mut file = mesh(positions, views, data.len(), primitive);
    file["buffers"] = json!([{ "byteLength": data.len() }]);
    file["images"] = json!([{ "bufferView": 0 }]);
    file["textures"] = json!([{ "extensions": { "KHR_texture_basisu": { "source": 0 } } }]);
    let surface = json!({ "baseColorTexture": { "index": 0 } });
    file["materials"] = json!([{ "pbrMetallicRoughness": surface }]);
    file
}
