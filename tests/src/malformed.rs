//! Scene files that are broken, hostile or just odd, and what must become of each.

mod motion;
mod surfaces;

pub use motion::with_motion;

use Expect::{Accepted, Refused};
use hemilux_engine::scene::made::assemble;
use serde_json::{Value, json};

/// What the import must do with a file.
#[derive(Clone, Copy, Debug)]
pub enum Expect {
    /// Refuse it.
    Refused {
        /// Part of the place that the error names.
        at_contains: &'static str,
        /// Part of what the error says is wrong.
        what_contains: &'static str,
        /// Whether it is a limit that the file exceeds rather than a rule that it breaks.
        too_large: bool,
    },
    /// Take it.
    Accepted {
        /// Part of one warning, as `place: what`; empty where there must be no warning at all.
        warning_contains: &'static str,
    },
}

const fn refused(at_contains: &'static str, what_contains: &'static str) -> Expect {
    Refused { at_contains, what_contains, too_large: false }
}

const fn too_large(at_contains: &'static str, what_contains: &'static str) -> Expect {
    Refused { at_contains, what_contains, too_large: true }
}

const fn accepted(warning_contains: &'static str) -> Expect {
    Accepted { warning_contains }
}

/// Name, file contents and expected outcome.
pub type Case = (&'static str, Vec<u8>, Expect);

/// A valid file: one emitting, textured triangle and a camera.
pub fn triangle() -> (Value, Vec<u8>) {
    let mut binary = Vec::new();
    for x in [0.0f32, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0] {
        binary.extend(x.to_le_bytes());
    }
    for index in [0u16, 1, 2, 0] {
        binary.extend(index.to_le_bytes());
    }
    for x in [0.0f32, 0.0, 1.0, 0.0, 0.0, 1.0] {
        binary.extend(x.to_le_bytes());
    }
    let image = png(2, 2, image::ExtendedColorType::Rgb8, &[255; 12]);
    let root = json!({
        "asset": { "version": "2.0" },
        "scene": 0,
        "scenes": [{ "nodes": [0, 1] }],
        "nodes": [
            { "mesh": 0 },
            { "camera": 0, "translation": [0, 0, 3] },
        ],
        "cameras": [{ "type": "perspective", "perspective": { "yfov": 0.8, "znear": 0.1 } }],
        "meshes": [{ "primitives": [{
            "attributes": { "POSITION": 0, "TEXCOORD_0": 2 }, "indices": 1, "material": 0,
        }] }],
        "materials": [{
            "pbrMetallicRoughness": { "baseColorTexture": { "index": 0 }, "metallicFactor": 0 },
            "emissiveFactor": [1, 1, 1],
        }],
        "textures": [{ "source": 0 }],
        "images": [{ "bufferView": 3, "mimeType": "image/png" }],
        "accessors": [
            { "bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3" },
            { "bufferView": 1, "componentType": 5123, "count": 3, "type": "SCALAR" },
            { "bufferView": 2, "componentType": 5126, "count": 3, "type": "VEC2" },
        ],
        "bufferViews": [
            { "buffer": 0, "byteOffset": 0, "byteLength": 36 },
            { "buffer": 0, "byteOffset": 36, "byteLength": 6 },
            { "buffer": 0, "byteOffset": 44, "byteLength": 24 },
            { "buffer": 0, "byteOffset": 68, "byteLength": image.len() },
        ],
        "buffers": [{ "byteLength": 68 + image.len() }],
    });
    binary.extend(image);
    (root, binary)
}

fn png(width: u32, height: u32, kind: image::ExtendedColorType, bytes: &[u8]) -> Vec<u8> {
    let mut out = std::io::Cursor::new(Vec::new());
    image::write_buffer_with_format(&mut out, bytes, width, height, kind, image::ImageFormat::Png)
        .expect("a small PNG can be written");
    out.into_inner()
}

/// A PNG that says it has `width` × `height` texels and holds next to none.
fn png_claiming(width: u32, height: u32) -> Vec<u8> {
    let mut bytes = png(1, 1, image::ExtendedColorType::Rgb8, &[0; 3]);
    bytes[16..20].copy_from_slice(&width.to_be_bytes());
    bytes[20..24].copy_from_slice(&height.to_be_bytes());
    // CRC-32 of the IHDR chunk, so that only the size is odd.
    let mut crc = u32::MAX;
    for byte in &bytes[12..29] {
        crc ^= u32::from(*byte);
        for _ in 0..8 {
            crc = if crc & 1 == 1 { (crc >> 1) ^ 0xedb8_8320 } else { crc >> 1 };
        }
    }
    bytes[29..33].copy_from_slice(&(!crc).to_be_bytes());
    bytes
}

struct Cases(Vec<Case>);

impl Cases {
    fn raw(&mut self, name: &'static str, bytes: Vec<u8>, expect: Expect) {
        assert!(self.0.iter().all(|(other, ..)| *other != name), "{name} is there twice");
        self.0.push((name, bytes, expect));
    }

    /// The valid file with one member set; `pointer` is a JSON pointer to an object or list
    /// element that exists, or to a new member of one.
    fn set(&mut self, name: &'static str, pointer: &str, value: Value, expect: Expect) {
        let (mut root, binary) = triangle();
        let (parent, key) = pointer.rsplit_once('/').expect("a pointer has a slash");
        let parent = root.pointer_mut(parent).expect("the parent exists");
        match parent {
            Value::Array(list) => list[key.parse::<usize>().expect("a list index")] = value,
            other => other[key] = value,
        }
        self.raw(name, assemble(&root, &binary), expect);
    }

    fn edit(
        &mut self,
        name: &'static str,
        expect: Expect,
        change: impl FnOnce(&mut Value, &mut Vec<u8>),
    ) {
        let (mut root, mut binary) = triangle();
        change(&mut root, &mut binary);
        self.raw(name, assemble(&root, &binary), expect);
    }

    /// The valid file with its image replaced.
    fn image(&mut self, name: &'static str, image: &[u8], expect: Expect) {
        self.edit(name, expect, |root, binary| {
            binary.truncate(68);
            binary.extend_from_slice(image);
            root["bufferViews"][3]["byteLength"] = json!(image.len());
            root["buffers"][0]["byteLength"] = json!(binary.len());
        });
    }
}

/// All cases; names are unique.
pub fn cases() -> Vec<Case> {
    let mut cases = Cases(Vec::new());
    containers(&mut cases);
    json_texts(&mut cases);
    buffers(&mut cases);
    accessors(&mut cases);
    meshes(&mut cases);
    nodes_and_cameras(&mut cases);
    surfaces::lights(&mut cases);
    surfaces::materials(&mut cases);
    surfaces::images(&mut cases);
    surfaces::material_extensions(&mut cases);
    motion::motion(&mut cases);
    cases.0
}

fn containers(cases: &mut Cases) {
    let (root, binary) = triangle();
    let whole = assemble(&root, &binary);
    let json_end = 20 + u32::from_le_bytes(whole[12..16].try_into().expect("4 bytes")) as usize;
    let patched = |offset: usize, bytes: &[u8]| {
        let mut file = whole.clone();
        file[offset..offset + bytes.len()].copy_from_slice(bytes);
        file
    };
    cases.raw("valid", whole.clone(), accepted(""));
    cases.raw("empty", Vec::new(), refused("file", "is empty"));
    cases.raw("random bytes", (0..=255).collect(), refused("file", "neither binary glTF"));
    cases.raw("magic only", whole[..4].to_vec(), refused("GLB header", "ends within"));
    cases.raw("cut in the header", whole[..10].to_vec(), refused("GLB header", "ends within"));
    cases.raw("cut in the JSON", whole[..60].to_vec(), refused("GLB header", "says the file has"));
    let cut = whole[..whole.len() - 8].to_vec();
    cases.raw("cut in the binary", cut, refused("GLB header", "says the file has"));
    cases.raw("wrong magic", patched(0, b"glTG"), refused("file", "neither binary glTF"));
    let version = patched(4, &1u32.to_le_bytes());
    cases.raw("container version 1", version, refused("GLB header", "version 1"));
    let length = patched(8, &5u32.to_le_bytes());
    cases.raw("header length too small", length, refused("GLB header", "says the file has 5"));
    let length = patched(12, &u32::MAX.to_le_bytes());
    cases.raw("JSON chunk length 2³²−1", length, refused("GLB chunk 0", "are left"));
    let length = patched(json_end, &0xffff_fff0u32.to_le_bytes());
    cases.raw("binary chunk length near 2³²", length, refused("GLB chunk 1", "are left"));
    let kind = patched(16, b"BIN\0");
    cases.raw("first chunk is binary", kind, refused("GLB chunk 0", "not JSON"));
    let mut no_chunk = whole[..12].to_vec();
    no_chunk[8..12].copy_from_slice(&12u32.to_le_bytes());
    cases.raw("no chunk", no_chunk, refused("GLB chunk 0", "ends within"));
    let kind = patched(json_end + 4, b"WHAT");
    cases.raw("binary chunk of unknown kind", kind, refused("buffers[0]", "no BIN chunk"));
    let mut longer = whole.clone();
    longer.extend(b"trailing");
    cases.raw("bytes after the end", longer, accepted("GLB header: 8 bytes after the end"));
    let mut text = root.to_string().into_bytes();
    text.extend([0xff, 0xfe]);
    cases.raw("JSON with bytes that are not UTF-8", text, refused("JSON", "not valid JSON"));
}

fn json_texts(cases: &mut Cases) {
    let deep = format!("{{\"asset\":{}1{}}}", "[".repeat(100_000), "]".repeat(100_000));
    cases.raw("JSON nested 100,000 deep", deep.into_bytes(), refused("JSON", "recursion"));
    let wide = format!("{{\"extras\":[{}]}}", "{\"\":0},".repeat(1 << 20));
    cases.raw("JSON of a million objects", wide.into_bytes(), too_large("JSON", "once parsed"));
    let mark = "$serde_json::private::RawValue";
    let hidden =
        format!("{{\"a\":{{\"{mark}\":\"[{}0]\"}}}}", "\\u007b\\u007d\\u002c".repeat(1 << 19));
    cases.raw("JSON hidden in escapes", hidden.into_bytes(), too_large("JSON", "once parsed"));
    cases.raw("JSON cut short", b"{\"asset\":{".to_vec(), refused("JSON, line 1", "not valid"));
    let nan = b"{\"asset\":{\"version\":\"2.0\"},\"nodes\":[{\"scale\":[NaN,1,1]}]}".to_vec();
    cases.raw("JSON with NaN", nan, refused("JSON, line 1", "not valid JSON"));
    cases.raw("no asset", b"{}".to_vec(), refused("JSON", "missing field `asset`"));
    let bare = br#"{"asset":{"version":"2.0"}}"#.to_vec();
    cases.raw("nothing but an asset", bare, accepted("scenes: the file has no scene"));
    cases.set("glTF 1.0", "/asset/version", json!("1.0"), refused("asset.version", "glTF 1.0"));
    cases.set(
        "version as a number",
        "/asset/version",
        json!(2.0),
        refused("asset.version", "a string"),
    );
    cases.set("nodes as an object", "/nodes", json!({}), refused("nodes", "expected an array"));
    cases.set(
        "a node that is a number",
        "/nodes/0",
        json!(7),
        refused("nodes[0]", "expected an object"),
    );
    let unknown = json!(["EXT_light_from_nowhere"]);
    cases.set(
        "unknown extension required",
        "/extensionsRequired",
        unknown.clone(),
        refused("extensionsRequired[0]", "EXT_light_from_nowhere"),
    );
    cases.set(
        "unknown extension used",
        "/extensionsUsed",
        unknown,
        accepted("extensionsUsed[0]: EXT_light_from_nowhere is not supported"),
    );
    cases.set(
        "AVIF required",
        "/extensionsRequired",
        json!(["EXT_texture_avif"]),
        refused("extensionsRequired[0]", "EXT_texture_avif"),
    );
}

fn buffers(cases: &mut Cases) {
    let uris = [
        ("URI %ff", "%ff", "not UTF-8"),
        ("URI with half an escape", "a%4", "broken percent-encoding"),
        ("URI ../", "../secret.bin", "leaves the folder"),
        ("URI ../ behind escapes", "%2e%2e%2fsecret.bin", "leaves the folder"),
        ("URI file://", "file:///etc/passwd", "has a scheme"),
        ("URI http://", "http://127.0.0.1:1/x.bin", "has a scheme"),
        ("URI of an absolute path", "/etc/passwd", "absolute path"),
        ("URI with a backslash", "..\\secret.bin", "a backslash"),
        ("URI of a file that is not there", "other.bin", "not among the files"),
        ("data URI without a comma", "data:;base64", "no comma"),
        ("data URI that is not base64", "data:;base64,!!!!", "not base64"),
    ];
    for (name, uri, what) in uris {
        cases.set(name, "/buffers/0/uri", json!(uri), refused("buffers[0].uri", what));
    }
    let length = "/buffers/0/byteLength";
    let at = "buffers[0].byteLength";
    cases.set(
        "buffer longer than the chunk",
        length,
        json!(1u64 << 40),
        refused(at, "the buffer has"),
    );
    cases.set("buffer of negative length", length, json!(-4), refused(at, "not negative"));
    cases.set("buffer of length 1.5", length, json!(1.5), refused(at, "whole number"));
    let view = refused("bufferViews[0]", "do not fit buffer 0");
    cases.set("view beyond its buffer", "/bufferViews/0/byteOffset", json!(1000), view);
    cases.edit("view whose end overflows", view, |root, _| {
        root["bufferViews"][0]["byteOffset"] = json!(u64::MAX);
        root["bufferViews"][0]["byteLength"] = json!(u64::MAX);
    });
    let buffer = refused("bufferViews[0].buffer", "there are 1 buffers");
    cases.set("view of a buffer that is not there", "/bufferViews/0/buffer", json!(9), buffer);
    let stride = "/bufferViews/0/byteStride";
    let at = "bufferViews[0].byteStride";
    cases.set("stride less than an element", stride, json!(4), refused(at, "less than the 12"));
    cases.set("stride beyond the view", stride, json!(252), refused("accessors[0]", "do not fit"));
    cases.set("stride 0", stride, json!(0), refused(at, "0 is not a value"));
}

fn accessors(cases: &mut Cases) {
    let count = "/accessors/0/count";
    let at = "accessors[0].count";
    cases.set("10⁹ vertices", count, json!(1_000_000_000), refused("accessors[0]", "do not fit"));
    cases.set("count 2⁶⁴−1", count, json!(u64::MAX), refused(at, "is not in"));
    cases.set("count 0", count, json!(0), refused(at, "is not in"));
    cases.set("negative count", count, json!(-3), refused(at, "not negative"));
    cases.set("count as text", count, json!("3"), refused(at, "whole number"));
    let offset = "/accessors/0/byteOffset";
    cases.set("offset 2⁶⁴−1", offset, json!(u64::MAX), refused("accessors[0]", "do not fit"));
    let kind = "/accessors/0/type";
    cases.set(
        "unknown type",
        kind,
        json!("VEC9"),
        refused("accessors[0].type", "\"VEC9\" is not a value"),
    );
    let position = refused("attributes.POSITION", "accessors[0] is Vec2");
    cases.set("positions of two components", kind, json!("VEC2"), position);
    let component = "/accessors/0/componentType";
    let at = "accessors[0].componentType";
    cases.set("unknown component type", component, json!(1), refused(at, "1 is not"));
    let position = refused("attributes.POSITION", "Vec3 of U32");
    cases.set("positions of 32-bit integers", component, json!(5125), position);
    cases.edit("zeros by the thousand million", too_large("meshes", "triangles"), |root, _| {
        for accessor in [0, 2] {
            root["accessors"][accessor] =
                json!({ "componentType": 5126, "count": 3_000_000_000u32, "type": "VEC3" });
        }
        root["accessors"][2]["type"] = json!("VEC2");
        let primitive = &mut root["meshes"][0]["primitives"][0];
        primitive.as_object_mut().expect("an object").remove("indices");
    });
    let sparse = |count: Value, indices_type: u32, offset: u32| {
        json!({
            "count": count,
            "indices": { "bufferView": 1, "componentType": indices_type, "byteOffset": offset },
            "values": { "bufferView": 0 },
        })
    };
    let member = "/accessors/0/sparse";
    let good = sparse(json!(3), 5123, 0);
    cases.set("sparse accessor that is valid", member, good, accepted(""));
    let at = "accessors[0].sparse.count";
    cases.set("sparse count −1", member, sparse(json!(-1), 5123, 0), refused(at, "not negative"));
    let more = sparse(json!(1_000_000), 5123, 0);
    cases.set("sparse count above the count", member, more, refused(at, "is not in 1…3"));
    let beyond = sparse(json!(3), 5125, 0);
    let at = "accessors[0].sparse.indices";
    cases.set("sparse indices beyond their view", member, beyond, refused(at, "do not fit"));
    let floats = sparse(json!(1), 5126, 0);
    cases.set("sparse indices of floats", member, floats, refused(at, "5126 is not a value"));
    cases.edit("sparse indices that fall", refused(at, "must increase"), |root, binary| {
        root["accessors"][0]["sparse"] = sparse(json!(3), 5123, 0);
        binary[36..42].copy_from_slice(&[2, 0, 1, 0, 0, 0]);
    });
    cases.edit(
        "sparse without values",
        refused("accessors[0].sparse", "missing field `values`"),
        |root, _| {
            let mut part = sparse(json!(1), 5123, 0);
            part.as_object_mut().expect("an object").remove("values");
            root["accessors"][0]["sparse"] = part;
        },
    );
}

fn meshes(cases: &mut Cases) {
    cases.edit("vertex at NaN", refused("accessors[0]", "not finite"), |_, binary| {
        binary[0..4].copy_from_slice(&f32::NAN.to_le_bytes());
    });
    cases.edit("vertex at infinity", refused("accessors[0]", "not finite"), |_, binary| {
        binary[4..8].copy_from_slice(&f32::INFINITY.to_le_bytes());
    });
    cases.edit("vertex at 10³⁰ m", refused("nodes[0]", "beyond"), |_, binary| {
        binary[12..16].copy_from_slice(&1e30f32.to_le_bytes());
    });
    cases.edit("index out of range", refused("accessors[1]", "there are 3"), |_, binary| {
        binary[36] = 3;
    });
    cases.edit("primitive restart", refused("accessors[1]", "restart"), |_, binary| {
        binary[36..38].copy_from_slice(&[0xff, 0xff]);
    });
    let zero_area = accepted("meshes[0].primitives[0]: 1 triangles without area");
    cases.edit("triangle without area", zero_area, |_, binary| binary[12..36].fill(0));
    let line = accepted("meshes[0].primitives[0]: 1 triangles without area");
    cases.edit("corners on a line", line, |_, binary| {
        binary[24..28].copy_from_slice(&2.0f32.to_le_bytes());
        binary[28..32].fill(0);
    });
    let primitive = "/meshes/0/primitives/0";
    let of = |member: &str| format!("{primitive}/{member}");
    let missing = accepted("attributes.POSITION: is missing");
    cases.set("no POSITION", &of("attributes"), json!({}), missing);
    let attributes = refused("meshes[0].primitives[0].attributes", "an object");
    cases.set("attributes as a list", &of("attributes"), json!([0]), attributes);
    cases.edit(
        "no attributes",
        refused("primitives[0]", "missing field `attributes`"),
        |root, _| {
            root["meshes"][0]["primitives"][0] = json!({ "indices": 1 });
        },
    );
    let accessor = refused("attributes.POSITION", "there are 3 accessors");
    cases.set("POSITION out of range", &of("attributes/POSITION"), json!(99), accessor);
    let normal = refused("attributes.NORMAL", "is Vec2");
    cases.set("normals that are texture coordinates", &of("attributes/NORMAL"), json!(2), normal);
    cases.edit("fewer texture coordinates", accepted("TEXCOORD_0: has 2 elements"), |root, _| {
        root["accessors"][2]["count"] = json!(2);
    });
    cases.edit("fewer normals", accepted("NORMAL: has 2 elements for 3 positions"), |root, _| {
        let normals = json!({ "componentType": 5126, "count": 2, "type": "VEC3" });
        root["accessors"].as_array_mut().expect("a list").push(normals);
        root["meshes"][0]["primitives"][0]["attributes"]["NORMAL"] = json!(3);
    });
    let indices = refused("primitives[0].indices", "not a list of unsigned");
    cases.set("indices that are positions", &of("indices"), json!(0), indices);
    let material = refused("primitives[0].material", "there are 1 materials");
    cases.set("material out of range", &of("material"), json!(4_000_000_000u32), material);
    cases.set("mode 9", &of("mode"), json!(9), refused("primitives[0].mode", "9 is not a value"));
    cases.set("points", &of("mode"), json!(0), accepted("mode: points have no area"));
    cases.set("lines", &of("mode"), json!(1), accepted("mode: lines have no area"));
    let rest = accepted("2 corners make no whole number");
    cases.set("two corners", "/accessors/1/count", json!(2), rest);
    cases.edit("no meshes", accepted("meshes: there is no triangle"), |root, _| {
        root.as_object_mut().expect("an object").remove("meshes");
        root["nodes"][0] = json!({});
    });
    let emission = "/materials/0/emissiveFactor";
    cases.set("no light", emission, json!([0, 0, 0]), accepted(""));
}

fn nodes_and_cameras(cases: &mut Cases) {
    let children = "/nodes/0/children";
    cases.set("node that is its own child", children, json!([0]), refused("nodes[0]", "ancestor"));
    cases.edit("cycle of two nodes", refused("nodes[", "ancestor"), |root, _| {
        root["nodes"][0]["children"] = json!([1]);
        root["nodes"][1]["children"] = json!([0]);
    });
    cases.edit("node with two parents", refused("nodes[1].children[0]", "already"), |root, _| {
        root["nodes"] = json!([{ "children": [2] }, { "children": [2] }, { "mesh": 0 }]);
    });
    cases.edit("root twice", refused("scenes[0].nodes", "node 0 twice"), |root, _| {
        root["scenes"][0]["nodes"] = json!([0, 0]);
    });
    cases.edit("nodes 100,000 deep", too_large("nodes[", "levels deep"), |root, _| {
        let mut nodes: Vec<_> = (1..100_000).map(|next| json!({ "children": [next] })).collect();
        nodes.push(json!({ "mesh": 0 }));
        root["nodes"] = json!(nodes);
        root["scenes"][0]["nodes"] = json!([0]);
    });
    cases.set("child out of range", children, json!([7]), refused("children[0]", "2 nodes"));
    cases.set("mesh out of range", "/nodes/0/mesh", json!(1), refused("nodes[0].mesh", "1 meshes"));
    let matrix = "/nodes/0/matrix";
    let at = "nodes[0].matrix";
    cases.set("matrix of zeros", matrix, json!(vec![0; 16]), refused(at, "not affine"));
    cases.set(
        "matrix of 15 numbers",
        matrix,
        json!(vec![0; 15]),
        refused(at, "an array of length 16"),
    );
    let huge: Vec<f64> = (0..16)
        .map(|i| {
            if i == 15 {
                1.0
            } else if i % 4 == 3 {
                0.0
            } else {
                1e300
            }
        })
        .collect();
    cases.set("matrix of 10³⁰⁰", matrix, json!(huge), refused("nodes[0]", "beyond"));
    let flat = accepted("triangles without area");
    cases.set("scale 0", "/nodes/0/scale", json!([0, 0, 0]), flat);
    let turn = refused("nodes[0].rotation", "not a rotation");
    cases.set("rotation of length 0", "/nodes/0/rotation", json!([0, 0, 0, 0]), turn);
    cases.set("scene out of range", "/scene", json!(3), refused("scene", "there are 1 scenes"));
    cases.edit("no scenes", accepted("scenes: the file has no scene"), |root, _| {
        let root = root.as_object_mut().expect("an object");
        root.remove("scene");
        root.remove("scenes");
    });
    cases.edit("no camera", accepted(""), |root, _| {
        root.as_object_mut().expect("an object").remove("cameras");
        root["nodes"][1] = json!({});
    });
    let yfov = "/cameras/0/perspective/yfov";
    let lens = "radians is not a field of view between 0 and π; the camera is left out";
    cases.set("field of view 0", yfov, json!(0), accepted(lens));
    cases.set("field of view 4", yfov, json!(4), accepted(lens));
    let kind = accepted("cameras[0].type: is not a value");
    cases.set("camera of unknown kind", "/cameras/0/type", json!("fisheye"), kind);
    let lens = accepted("cameras[0].orthographic: is missing");
    cases.set("orthographic camera without a size", "/cameras/0/type", json!("orthographic"), lens);
    let squashed = accepted("nodes[1]: its camera is left out");
    cases.set("camera squashed flat", "/nodes/1/scale", json!([1, 0, 1]), squashed);
}
