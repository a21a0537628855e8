//! Geometry and pictures that are there in compressed form only.

use super::*;

/// The bytes of hexadecimal digits.
fn bytes(hex: &str) -> Vec<u8> {
    let digit = |byte: u8| (byte as char).to_digit(16).expect("a digit") as u8;
    hex.as_bytes().chunks(2).map(|pair| digit(pair[0]) << 4 | digit(pair[1])).collect()
}

// A square of eight triangles as the reference encoder of Draco stores it: positions of 11 bits,
// normals of 8, texture coordinates of 10, colours of four bytes.
const EDGEBREAKER: &str = "445241434f0202010100000009080308010003efd31aff0111ff028840ff028840ff02884004ff000000000001\
     000002000001000903000002010109030001030103090200020201020204000301010101000c031d071f711c75\
     1c048811bf85ffff3f00ffefffff01a0ff00002080ff010000ff03000000040080ff0100c07f00000000ff0700\
     00000000000000000000000000000000400b00030101018001713cfff7910303a0cc8aff0000007f0000000801\
     0101000b03ad2a1f5515032a624cffffffbfff00f42f0000000000ff03000000000000000000000000803f0a01\
     0101000903ad2a175515032a624cc8c80e05c7c8000000c7000200000000000000ff000000";
const VALENCE: &str = "445241434f0202010100000009080308010003efd31aff0111ff028840ff028840ff02884004ff000100000001\
     000002000001000903000002010109030001030103090200020201020204000301010101000c031d071f711c75\
     1c048811bf85ffff3f00ffefffff01a0ff00002080ff010000ff03000000040080ff0100c07f00000000ff0700\
     00000000000000000000000000000000400b0603010009031d0717e5380335c585c11fc10fd50ed51c04bfd0aa\
     d086acaa00ff0000007f000000ff02994008050101000b03390e0f1d071d07390e1d073d0e051113bcce96ffff\
     ffbfff40ee3c011b0060eab205070000002503f5058100000000ff03000000000000000000000000803f0a0101\
     01000903ad2a175515032a624cc8c80e05c7c8000000c7000200000000000000ff000000";
/// The same with floats as they are.
const SEQUENTIAL: &str = "445241434f02020100000008090100010303010401020404020503040606040704050707050801040009030000\
     010903000103090200020202040003000000010000000000000000000000000000803f00000000000000000000\
     00400000000000000000000000000000803f000000000000803f0000803f0000003f000000400000803f000080\
     3f0000000000000040000000000000803f000000400000803f0000004000000040000000400000000000000000\
     0000803f00000000000000000000803f00000000000000000000803f00000000000000000000803f0000000000\
     0000000000803f00000000000000000000803f00000000000000000000803f00000000000000000000803f0000\
     0000000000000000803f00000000000000000000003f000000000000803f00000000000000000000003f000000\
     3f0000003f0000803f0000003f000000000000803f0000003f0000803f0000803f0000803f0001010102c90171\
     1c710c91032bc901ff839103ff5b390e0c24a7cdf838c98ca9ecef308100000000ff000000";

/// What the reference decoder makes of a stream: corners of triangles, positions, texture
/// coordinates and colours.
struct Decoded {
    corners: [usize; 24],
    positions: [f32; 27],
    uv: [f32; 18],
    colors: [u8; 36],
}

const QUANTIZED: Decoded = Decoded {
    corners: [0, 1, 2, 2, 1, 3, 4, 3, 5, 3, 1, 5, 5, 1, 6, 6, 1, 7, 1, 0, 7, 0, 8, 7],
    positions: [
        0.,
        1.000_488_5,
        0.,
        1.000_488_5,
        1.000_488_5,
        0.500_244_26,
        0.,
        2.,
        0.,
        1.000_488_5,
        2.,
        1.000_488_5,
        2.,
        2.,
        2.,
        2.,
        1.000_488_5,
        1.000_488_5,
        2.,
        0.,
        0.,
        1.000_488_5,
        0.,
        0.,
        0.,
        0.,
        0.,
    ],
    uv: [
        0.,
        0.500_488_76,
        0.500_488_76,
        0.500_488_76,
        0.,
        1.,
        0.500_488_76,
        1.,
        1.,
        1.,
        1.,
        0.500_488_76,
        1.,
        0.,
        0.500_488_76,
        0.,
        0.,
        0.,
    ],
    colors: [
        0, 100, 7, 254, 100, 100, 7, 253, 0, 200, 7, 253, 100, 200, 7, 252, 200, 200, 7, 251, 200,
        100, 7, 252, 200, 0, 7, 253, 100, 0, 7, 254, 0, 0, 7, 255,
    ],
};
const EXACT: Decoded = Decoded {
    corners: [0, 1, 3, 3, 1, 4, 1, 2, 4, 4, 2, 5, 3, 4, 6, 6, 4, 7, 4, 5, 7, 7, 5, 8],
    positions: [
        0., 0., 0., 1., 0., 0., 2., 0., 0., 0., 1., 0., 1., 1., 0.5, 2., 1., 1., 0., 2., 0., 1.,
        2., 1., 2., 2., 2.,
    ],
    uv: [0., 0., 0.5, 0., 1., 0., 0., 0.5, 0.5, 0.5, 1., 0.5, 0., 1., 0.5, 1., 1., 1.],
    colors: [
        0, 0, 7, 255, 100, 0, 7, 254, 200, 0, 7, 253, 0, 100, 7, 254, 100, 100, 7, 253, 200, 100,
        7, 252, 0, 200, 7, 253, 100, 200, 7, 252, 200, 200, 7, 251,
    ],
};

const DRACO: &str = "KHR_draco_mesh_compression";

/// A file whose one primitive is in a stream of Draco alone.
fn draco(stream: &[u8]) -> File {
    let mut file = File::new();
    let view = file.view(stream);
    let attributes = [
        ("POSITION", 5126, "VEC3"),
        ("NORMAL", 5126, "VEC3"),
        ("TEXCOORD_0", 5126, "VEC2"),
        ("COLOR_0", 5121, "VEC4"),
    ];
    let mut ids = json!({});
    for (id, (name, component, kind)) in attributes.into_iter().enumerate() {
        let accessor = json!({ "componentType": component, "type": kind, "count": 9 });
        let accessor = file.push("accessors", accessor);
        file.root["accessors"][accessor]["normalized"] = json!(component == 5121);
        file.attribute(name, accessor);
        ids[name] = json!(id);
    }
    let indices = json!({ "componentType": 5121, "type": "SCALAR", "count": 24 });
    let indices = file.push("accessors", indices);
    let primitive = &mut file.root["meshes"][0]["primitives"][0];
    primitive["indices"] = json!(indices);
    primitive["extensions"] = json!({ DRACO: { "bufferView": view, "attributes": ids } });
    file.root["extensionsUsed"] = json!([DRACO]);
    file.root["extensionsRequired"] = json!([DRACO]);
    file
}

fn try_import(file: &File, limits: &ImportLimits) -> Result<Scene, SceneError> {
    let mut root = file.root.clone();
    root["buffers"] = json!([{ "byteLength": file.binary.len() }]);
    if root["bufferViews"].as_array().unwrap().iter().any(|view| view["buffer"] == json!(1)) {
        // One that has no bytes and is only there to be named.
        root["buffers"].as_array_mut().unwrap().push(json!({ "byteLength": 1 << 20 }));
    }
    import(&assemble(&root, &file.binary), &Resources::new(), limits)
}

fn refusal(file: &File) -> SceneError {
    match try_import(file, &ImportLimits::default()) {
        Ok(_) => panic!("it was taken"),
        Err(error) => error,
    }
}

#[test]
fn draco_is_decoded_as_by_the_reference() {
    for (stream, expected) in [(EDGEBREAKER, QUANTIZED), (VALENCE, QUANTIZED), (SEQUENTIAL, EXACT)]
    {
        let scene = try_import(&draco(&bytes(stream)), &ImportLimits::default()).unwrap();
        assert_eq!(scene.warnings, []);
        assert_eq!(scene.triangles.len(), 8);
        let vertices = scene.triangles.iter().flat_map(|triangle| triangle.vertices);
        for (vertex, point) in vertices.zip(expected.corners) {
            let vertex = &scene.vertices[vertex as usize];
            assert_eq!(vertex.position.to_array(), expected.positions[3 * point..][..3]);
            assert_eq!(vertex.uv[0].to_array(), expected.uv[2 * point..][..2]);
            let color = vertex.color.to_array().map(|channel| (channel * 255.0).round() as u8);
            assert_eq!(color, expected.colors[4 * point..][..3]);
            assert_eq!(vertex.normal, Vec3::Z);
        }
    }
}

#[test]
fn draco_beside_ordinary_accessors_and_for_two_primitives() {
    let mut file = draco(&bytes(EDGEBREAKER));
    // Texture coordinates that are not in the stream, and a second primitive of the same stream.
    let uv: Vec<f32> = (0..18).map(|value| value as f32).collect();
    let uv = file.floats(&uv, "VEC2", 2);
    file.attribute("TEXCOORD_0", uv);
    let primitive = &mut file.root["meshes"][0]["primitives"][0];
    primitive["extensions"][DRACO]["attributes"].as_object_mut().unwrap().remove("TEXCOORD_0");
    let copy = primitive.clone();
    file.root["meshes"][0]["primitives"] = json!([copy, copy]);
    let scene = try_import(&file, &ImportLimits::default()).unwrap();
    assert_eq!((scene.warnings.len(), scene.triangles.len()), (0, 16));
    let uv = |triangle: usize, corner: usize| {
        scene.vertices[scene.triangles[triangle].vertices[corner] as usize].uv[0].to_array()
    };
    assert_eq!((uv(0, 1), uv(8 + 2, 2)), ([2.0, 3.0], [10.0, 11.0]));

    // Where the stream is optional and everything is there without it, that is what is read.
    let mut both = square();
    let view = both.view(b"no stream");
    let primitive = &mut both.root["meshes"][0]["primitives"][0];
    primitive["extensions"] = json!({ DRACO: { "bufferView": view, "attributes": {} } });
    assert_eq!(try_import(&both, &ImportLimits::default()).unwrap().triangles.len(), 2);
}

#[test]
fn draco_that_does_not_keep_its_promise_is_warned_of_or_refused() {
    let stream = bytes(EDGEBREAKER);
    let with = |pointer: &str, value: Value| {
        let mut file = draco(&stream);
        *file.root.pointer_mut(pointer).unwrap() = value;
        file
    };
    let primitive = "/meshes/0/primitives/0";
    // A triangle fewer than promised, and vertices beyond it.
    for (pointer, count, what) in [
        ("/accessors/4/count", 27, "holds 8 triangles, but its accessors say 9"),
        ("/accessors/0/count", 12, "holds 9 vertices, but its accessors say 12"),
    ] {
        let scene = try_import(&with(pointer, json!(count)), &ImportLimits::default()).unwrap();
        assert_eq!(scene.triangles.len(), 8);
        assert!(scene.warnings[0].what.starts_with(what), "{:?}", scene.warnings);
    }
    let more = refusal(&with("/accessors/4/count", json!(21)));
    assert!(more.too_large && more.what.contains("8 faces"), "{more}");
    let few = ImportLimits { max_triangles: 7, ..ImportLimits::default() };
    assert!(try_import(&draco(&stream), &few).is_err_and(|error| error.too_large));
    for (place, value, what) in [
        ("extensions/KHR_draco_mesh_compression/bufferView", json!(9), "not the index"),
        ("extensions/KHR_draco_mesh_compression/bufferView", json!("x"), "expected"),
        ("extensions/KHR_draco_mesh_compression/attributes/NORMAL", json!(7), "whose id is 7"),
        ("extensions/KHR_draco_mesh_compression/attributes/POSITION", json!(2), "Vec2"),
    ] {
        let error = refusal(&with(&format!("{primitive}/{place}"), value));
        assert!(format!("{error}").contains(what), "{error}");
        assert!(error.at.starts_with("meshes[0].primitives[0]"), "{error}");
    }
    let mut points = draco(&stream);
    points.root["meshes"][0]["primitives"][0]["mode"] = json!(0);
    assert!(refusal(&points).what.contains("no triangles"));
}

#[test]
fn damaged_draco_is_refused() {
    for stream in [EDGEBREAKER, VALENCE, SEQUENTIAL].map(bytes) {
        for length in 1..stream.len() {
            let error = refusal(&draco(&stream[..length]));
            assert!(error.at.contains(DRACO), "{length}: {error}");
        }
        for place in 0..stream.len() {
            for value in [0, 0x7f, 0xff, stream[place] ^ 1] {
                let mut stream = stream.clone();
                stream[place] = value;
                // Much of it still is a mesh; whatever it is, the import ends.
                if let Err(error) = try_import(&draco(&stream), &ImportLimits::default()) {
                    assert!(!error.what.contains("gave up"), "{place} as {value}: {error}");
                }
            }
        }
    }
}

/// Streams and pictures with several bytes changed by chance: decoders refuse them or take them, and
/// none has to be caught.
#[test]
fn decoders_do_not_give_up() {
    const TRIES: usize = 4000;
    let mut state = 1u64;
    let mut random = |below: usize| {
        state =
            state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 33) as usize % below
    };
    type Make = fn(&[u8]) -> File;
    let streams = [EDGEBREAKER, VALENCE, SEQUENTIAL].map(|stream| (stream, draco as Make));
    let pictures = [ETC1S, LEVELS, ZSTANDARD, UASTC].map(|picture| (picture, ktx2 as Make));
    let limits =
        ImportLimits { max_texture_texels: 1 << 12, max_triangles: 100, ..ImportLimits::default() };
    let mut taken = 0;
    for (whole, file) in streams.into_iter().chain(pictures) {
        let whole = bytes(whole);
        for _ in 0..TRIES {
            let mut damaged = whole.clone();
            for _ in 0..1 + random(6) {
                let place = random(damaged.len());
                damaged[place] = random(256) as u8;
            }
            match try_import(&file(&damaged), &limits) {
                Ok(_) => taken += 1,
                Err(error) => assert!(!error.what.contains("gave up"), "{error}: {damaged:?}"),
            }
        }
    }
    assert!((100..6 * TRIES).contains(&taken), "{taken}");
}

/// Four positions of a square, each as a difference from the one before: a stream of meshopt in
/// version 0 by hand, whose 16-bit components have eight bytes an element.
fn meshopt(name: &str) -> File {
    let corners: [[u8; 8]; 4] =
        [[0; 8], [1, 0, 0, 0, 0, 0, 0, 0], [0, 0, 1, 0, 0, 0, 0, 0], [1, 0, 1, 0, 0, 0, 0, 0]];
    let mut stream = vec![0xa0];
    for byte in 0..8 {
        // One group, of plain bytes: twice the difference, less one where it is negative.
        stream.push(3);
        let mut before = 0u8;
        for corner in corners {
            let difference = corner[byte].wrapping_sub(before) as i8;
            stream.push((difference << 1 ^ difference >> 7) as u8);
            before = corner[byte];
        }
        stream.extend([0; 12]);
    }
    stream.extend([0; 32]);
    let mut file = File::new();
    let source = file.view(&stream);
    let object = json!({
        "buffer": 0, "byteOffset": file.root["bufferViews"][source]["byteOffset"],
        "byteLength": stream.len(), "byteStride": 8, "count": 4, "mode": "ATTRIBUTES",
    });
    let view = json!({
        "buffer": 1, "byteLength": 32, "byteStride": 8, "extensions": { name: object },
    });
    let view = file.push("bufferViews", view);
    let accessor = json!({ "bufferView": view, "componentType": 5123, "type": "VEC3", "count": 4 });
    let accessor = file.push("accessors", accessor);
    file.attribute("POSITION", accessor);
    file.root["meshes"][0]["primitives"][0]["mode"] = json!(5);
    file.root["extensionsRequired"] = json!([name, "KHR_mesh_quantization"]);
    file
}

#[test]
fn meshopt_views_are_read_and_judged() {
    for name in ["EXT_meshopt_compression", "KHR_meshopt_compression"] {
        let file = meshopt(name);
        let scene = try_import(&file, &ImportLimits::default()).unwrap();
        assert_eq!(scene.triangles.len(), 2);
        assert_eq!(scene.corners(&scene.triangles[0]), [Vec3::ZERO, Vec3::X, Vec3::Y]);
        for (member, value) in [
            ("mode", json!("POINTS")),
            ("mode", json!("TRIANGLES")),
            ("filter", json!("OCTAGONAL")),
            ("filter", json!("QUATERNION2")),
            ("byteStride", json!(6)),
            ("byteStride", json!(0)),
            ("byteStride", json!(4)),
            ("count", json!(5)),
            ("count", json!(-1)),
            ("count", json!(1u64 << 61)),
            ("byteOffset", json!(1)),
            ("byteLength", json!(u64::MAX)),
            ("byteLength", json!(7)),
            ("buffer", json!(1)),
            ("buffer", json!(7)),
        ] {
            let mut file = meshopt(name);
            file.root["bufferViews"][1]["extensions"][name][member] = value.clone();
            let error = refusal(&file);
            let at = format!("bufferViews[1].extensions.{name}");
            assert_eq!(error.at, at, "{member} as {value}: {error}");
        }
        // What comes out is bounded before there is room for it.
        let mut large = meshopt(name);
        large.root["bufferViews"][1]["byteLength"] = json!(1u64 << 40);
        large.root["bufferViews"][1]["extensions"][name]["count"] = json!(1u64 << 37);
        assert!(refusal(&large).too_large);
        // A buffer without bytes is one only while nothing is read from it.
        let mut plain = meshopt(name);
        plain.push("bufferViews", json!({ "buffer": 1, "byteLength": 4 }));
        assert_eq!(refusal(&plain).at, "buffers[1]");
    }
}

// A picture of 8 × 8 texels in KTX2 files: red grows to the right, green downwards, and the lower half
// is half transparent.
/// ETC1S under BasisLZ, with alpha.
const ETC1S: &str = "ab4b5458203230bb0d0a1a0a000000000100000008000000080000000000000000000000010000000100000001\
     000000680000003c000000a400000024000000c8000000000000009f0000000000000067010000000000000400\
     00000000000000000000000000003c0000000000000002003800a301020003030000080800000000000000003f\
     000000000000000000ffffffff40003f0f0000000000000000ffffffff1f0000004b5458777269746572004261\
     73697320556e6976657273616c20322e313000000600050033000000150000002f000000000000000000000000\
     00000002000000020000000200000010c044000000000000e200081005600000000876553145e5004c04000000\
     000020050e8029000200000020481a6943d712b60304a054ff07a052ff07a04affafaaaaaa525555550500c144\
     00000000000012e5bf4d013001400000000002b99c00111b0600008060713a0a01c00400000000000002080033\
     01eee4";
/// ETC1S of four levels, opaque.
const LEVELS: &str = "ab4b5458203230bb0d0a1a0a000000000100000008000000080000000000000000000000010000000400000001\
     000000b00000002c000000dc000000240000000001000000000000dd00000000000000e0010000000000000300\
     0000000000000000000000000000df0100000000000001000000000000000000000000000000de010000000000\
     0001000000000000000000000000000000dd01000000000000010000000000000000000000000000002c000000\
     0000000002002800a301020003030000080000000000000000003f000000000000000000ffffffff1f0000004b\
     545877726974657200426173697320556e6976657273616c20322e313000000700050036000000150000002e00\
     000000000000000000000000000003000000000000000000000000000000000000000100000000000000000000\
     000000000000000000010000000000000000000000000000000000000001000000000000000000000010c04400\
     0000000000e200081039400000401078d9047d042130009800000000000040140013000400000020d0896c5477\
     8412c02f2d04a04aff07a052ff07a054ffa7f2f7f7575555550500c144000000000000f25fed00980020000000\
     04805c380122240c00000083f6c00a01c0040000000000000208007e360a822801";
/// UASTC under Zstandard.
const ZSTANDARD: &str = "ab4b5458203230bb0d0a1a0a000000000100000008000000080000000000000000000000010000000100000002\
     000000680000002c000000940000002400000000000000000000000000000000000000b8000000000000004900\
     00000000000040000000000000002c0000000000000002002800a601020003030000100000000000000000007f\
     030000000000000000ffffffff1f0000004b545877726974657200426173697320556e6976657273616c20322e\
     3130000028b52ffd20400102005ba606000f30c0ff43c851d962ea73fbdb920601ff13c0ff43c851d962ea73fb\
     60ea8856007ffd331332547698badcfe40eac0567c7dfd3343c851d962ea73fb";
/// UASTC as it is.
const UASTC: &str = "ab4b5458203230bb0d0a1a0a000000000100000008000000080000000000000000000000010000000100000000\
     000000680000002c000000940000002400000000000000000000000000000000000000b8000000000000004000\
     00000000000040000000000000002c0000000000000002002800a601020003030000100000000000000000007f\
     030000000000000000ffffffff1f0000004b545877726974657200426173697320556e6976657273616c20322e\
     313000005ba606000f30c0ff43c851d962ea73fbdb920601ff13c0ff43c851d962ea73fb60ea8856007ffd3313\
     32547698badcfe40eac0567c7dfd3343c851d962ea73fb";
// The texels that the reference decoder finds in them.
const ETC1S_TEXELS: &str = "141467ff141467ff141467ff141467ff90145eff90145eff90145eff90145eff141467ff28287bff28287bff28\
     287bff90145effa42872ffa42872ffa42872ff28287bff3a3a8dff3a3a8dff4e4ea1ffb63a84ffb63a84ffb63a\
     84ffca4e98ff4e4ea1ff4e4ea1ff4e4ea1ff4e4ea1ffca4e98ffca4e98ffca4e98ffca4e98ff14906761149067\
     611490676114906761909067619090676190906761909067611490676128a47b6128a47b613ab68d6190906761\
     a4a47b61a4a47b61b6b68d613ab68d613ab68d613ab68d614ecaa161b6b68d61b6b68d61b6b68d61cacaa1614e\
     caa1614ecaa1614ecaa1614ecaa161cacaa161cacaa161cacaa161cacaa161";
const LEVELS_TEXELS: &str = "141467ff141467ff141467ff141467ff90145eff90145eff90145eff90145eff141467ff28287bff28287bff28\
     287bff90145effa42872ffa42872ffa42872ff28287bff3a3a8dff3a3a8dff4e4ea1ffb63a84ffb63a84ffb63a\
     84ffca4e98ff4e4ea1ff4e4ea1ff4e4ea1ff4e4ea1ffca4e98ffca4e98ffca4e98ffca4e98ff149067ff149067\
     ff149067ff149067ff909067ff909067ff909067ff909067ff149067ff28a47bff28a47bff3ab68dff909067ff\
     a4a47bffa4a47bffb6b68dff3ab68dff3ab68dff3ab68dff4ecaa1ffb6b68dffb6b68dffb6b68dffcacaa1ff4e\
     caa1ff4ecaa1ff4ecaa1ff4ecaa1ffcacaa1ffcacaa1ffcacaa1ffcacaa1ff";
const UASTC_TEXELS: &str = "000081ff1f0081ff400081ff600081ff810081ffa00081ffc00081ffdf0081ff001f81ff1f1f81ff401f81ff60\
     1f81ff811f81ffa01f81ffc01f81ffdf1f81ff004081ff1f4081ff404081ff604081ff814081ffa04081ffc040\
     81ffdf4081ff006081ff1f6081ff406081ff606081ff816081ffa06081ffc06081ffdf6081ff008383611f8383\
     61418383616183836183838361a1838361c1838361df83836100a183611fa1836141a1836161a1836183a18361\
     a1a18361c1a18361dfa1836100c183611fc1836141c1836161c1836183c18361a1c18361c1c18361dfc1836100\
     df83611fdf836141df836161df836183df8361a1df8361c1df8361dfdf8361";

/// A square with a texture that is there as KTX2 alone.
fn ktx2(picture: &[u8]) -> File {
    let mut file = square();
    let texture = file.image(picture);
    let source = file.root["textures"][texture].as_object_mut().unwrap().remove("source").unwrap();
    file.root["textures"][texture]["extensions"] =
        json!({ "KHR_texture_basisu": { "source": source } });
    let surface = json!({ "baseColorTexture": { "index": texture } });
    file.root["materials"] = json!([{ "pbrMetallicRoughness": surface }]);
    file.root["meshes"][0]["primitives"][0]["material"] = json!(0);
    file.root["extensionsRequired"] = json!(["KHR_texture_basisu"]);
    file
}

#[test]
fn ktx2_has_the_texels_of_the_reference() {
    for (picture, texels) in [
        (ETC1S, ETC1S_TEXELS),
        (LEVELS, LEVELS_TEXELS),
        (ZSTANDARD, UASTC_TEXELS),
        (UASTC, UASTC_TEXELS),
    ] {
        let scene = try_import(&ktx2(&bytes(picture)), &ImportLimits::default()).unwrap();
        let [texture] = &scene.textures[..] else { panic!("one texture") };
        assert_eq!((texture.width, texture.height), (8, 8));
        assert_eq!(texture.texels.as_flattened(), bytes(texels));
    }
}

#[test]
fn damaged_ktx2_is_refused() {
    let limits = ImportLimits { max_texture_texels: 63, ..ImportLimits::default() };
    for picture in [ETC1S, LEVELS, ZSTANDARD, UASTC].map(bytes) {
        let small = try_import(&ktx2(&picture), &limits);
        assert!(small.is_err_and(|error| error.too_large && error.at == "images[0]"));
        // Behind the first level come the data of others, which nobody reads.
        let first = u64::from_le_bytes(picture[80..88].try_into().unwrap()) as usize;
        for length in 0..=first {
            let error = refusal(&ktx2(&picture[..length]));
            assert_eq!(error.at, "images[0]", "{length}: {error}");
        }
        for place in 12..picture.len() {
            for value in [0, 1, 0x7f, 0xff, picture[place] ^ 1] {
                let mut picture = picture.clone();
                picture[place] = value;
                if let Err(error) = try_import(&ktx2(&picture), &ImportLimits::default()) {
                    assert!(
                        error.at.starts_with("images[0]") || error.at.starts_with("bufferViews"),
                        "{error}"
                    );
                }
            }
        }
        // Sides that no file of this size has texels for.
        for side in [20, 24] {
            let mut picture = picture.clone();
            picture[side..side + 4].copy_from_slice(&u32::MAX.to_le_bytes());
            assert_eq!(refusal(&ktx2(&picture)).at, "images[0]");
        }
        // Keys and values that end within what fills them up.
        let mut picture = picture.clone();
        picture[60] -= 1;
        let error = refusal(&ktx2(&picture)).to_string();
        assert!(error.contains("longer than it says"), "{error}");
    }
}

#[test]
fn the_better_source_of_a_texture_is_taken() {
    let mut file = ktx2(&bytes(UASTC));
    let white =
        image::DynamicImage::ImageRgb8(image::RgbImage::from_pixel(1, 1, image::Rgb([255; 3])));
    let plain = file.image(&encoded(image::ImageFormat::Png, &white));
    let source = file.root["textures"][plain]["source"].clone();
    file.root["textures"][0]["source"] = source;
    assert_eq!(file.root["textures"][0]["source"], json!(1));
    assert_eq!(try_import(&file, &ImportLimits::default()).unwrap().textures[0].width, 8);
    // AVIF is not read; the picture that all readers know is.
    file.root["textures"][0]["extensions"] = json!({ "EXT_texture_avif": { "source": 0 } });
    file.root["extensionsRequired"] = json!([]);
    assert_eq!(try_import(&file, &ImportLimits::default()).unwrap().textures[0].width, 1);
}
