//! Broken, hostile and odd scene files: each is refused or taken as it must be, and none panics.

use glam::Vec4;
use hemilux_engine::scene::gltf::{
    Choice, ImportLimits, ImportOptions, Resources, import, import_with,
};
use hemilux_engine::scene::{LightKind, Scene, SceneError, Triangle, made};
use hemilux_tests::malformed::{Expect, cases, triangle, with_motion};
use serde_json::{Value, json};
use std::panic::{AssertUnwindSafe, catch_unwind};

fn import_bytes(bytes: &[u8]) -> Result<Scene, SceneError> {
    import(bytes, &Resources::new(), &ImportLimits::default())
}

/// As the first animation has it at half a second.
fn import_moving(bytes: &[u8]) -> Result<Scene, SceneError> {
    let animation = Some(Choice::Index(0));
    let options = ImportOptions { animation, time: 0.5, ..ImportOptions::default() };
    import_with(bytes, &Resources::new(), &options)
}

#[test]
fn every_malformed_file_meets_its_expectation() {
    let cases = cases();
    assert!(cases.len() >= 50, "{} cases", cases.len());
    println!("{} cases", cases.len());
    let mut failures = Vec::new();
    for (name, bytes, expect) in cases {
        let outcome = import_bytes(&bytes);
        let met = match (&outcome, expect) {
            (Err(error), Expect::Refused { at_contains, what_contains, too_large }) => {
                error.at.contains(at_contains)
                    && error.what.contains(what_contains)
                    && error.too_large == too_large
                    && !error.fix.is_empty()
            }
            (Ok(scene), Expect::Accepted { warning_contains: "" }) => scene.warnings.is_empty(),
            (Ok(scene), Expect::Accepted { warning_contains }) => scene
                .warnings
                .iter()
                .any(|w| format!("{}: {}", w.at, w.what).contains(warning_contains)),
            _ => false,
        };
        if let Ok(scene) = &outcome {
            check_valid(scene);
        }
        if !met {
            let outcome = outcome.map(|scene| scene.warnings);
            failures.push(format!("{name}: expected {expect:?}, got {outcome:?}"));
        }
    }
    assert!(failures.is_empty(), "\n{}", failures.join("\n"));
}

/// What [`Scene`] promises of itself.
fn check_valid(scene: &Scene) {
    let scene = &scene.flattened();
    for vertex in &scene.vertices {
        assert!(vertex.position.is_finite() && vertex.color.is_finite());
        assert!(vertex.uv.iter().all(|uv| uv.is_finite()));
        assert!((vertex.normal.length() - 1.0).abs() < 1e-3);
    }
    for triangle in &scene.triangles {
        assert!((triangle.material as usize) < scene.materials.len());
        let [a, b, c] = scene.corners(triangle);
        let front = (b - a).as_dvec3().cross((c - a).as_dvec3());
        assert!(front.length() > 0.0);
        for index in triangle.vertices {
            let normal = scene.vertices[index as usize].normal.as_dvec3();
            assert!(normal.dot(front) > 0.0, "a shading normal behind its triangle");
        }
        let color = scene.base_color(triangle, 0.3, 0.3);
        assert!(color.is_finite() && color.min_element() >= 0.0);
        let emission = scene.emission(triangle, 0.3, 0.3);
        assert!(emission.is_finite() && emission.min_element() >= 0.0);
        check_point(scene, triangle);
    }
    for light in &scene.lights {
        assert!(light.position.is_finite() && light.intensity.is_finite());
        assert!(light.intensity.min_element() >= 0.0);
        assert!((light.direction.length() - 1.0).abs() < 1e-3);
        if let LightKind::Spot { inner_cone, outer_cone } = light.kind {
            assert!(0.0 <= inner_cone && inner_cone < outer_cone);
            assert!(outer_cone <= std::f32::consts::FRAC_PI_2);
        }
        assert!(light.range.is_none_or(|range| range > 0.0 && range.is_finite()));
    }
    for material in &scene.materials {
        let reflectance = material.reflectance(&material.appearance(material.base_color));
        let albedo = reflectance.diffuse + reflectance.specular;
        assert!(albedo.max_element() <= 1.0 + 1e-6 && albedo.min_element() >= 0.0);
        assert!(reflectance.exponent.is_finite());
    }
    for texture in &scene.textures {
        assert_eq!(texture.texels.len(), texture.width as usize * texture.height as usize);
    }
    for camera in &scene.cameras {
        assert!(camera.to_world.is_finite());
        assert!((camera.to_world.determinant() - 1.0).abs() < 1e-3);
    }
}

/// What it promises of a point of a triangle.
fn check_point(scene: &Scene, triangle: &Triangle) {
    let seen = scene.appearance(triangle, 0.3, 0.3);
    for share in [seen.metallic, seen.roughness, seen.specular_factor, seen.transmission] {
        assert!((0.0..=1.0).contains(&share), "{seen:?}");
    }
    assert!(seen.specular_color.is_finite() && seen.specular_color.min_element() >= 0.0);
    assert!((0.0..=1.0).contains(&scene.coverage(triangle, 0.3, 0.3)));
    if let Some(normal) = scene.shading_normal(triangle, 0.3, 0.3) {
        assert!((normal.length() - 1.0).abs() < 1e-3, "{normal}");
    }
    for index in triangle.vertices {
        let tangent = scene.vertices[index as usize].tangent;
        let length = tangent.truncate().length();
        assert!(tangent == Vec4::ZERO || ((length - 1.0).abs() < 1e-3 && tangent.w.abs() == 1.0));
    }
}

/// A small generator (xorshift64*), so that a failure can be repeated.
struct Dice(u64);

impl Dice {
    fn roll(&mut self, below: usize) -> usize {
        self.0 ^= self.0 >> 12;
        self.0 ^= self.0 << 25;
        self.0 ^= self.0 >> 27;
        (self.0.wrapping_mul(0x2545_f491_4f6c_dd1d) >> 33) as usize % below
    }
}

/// A file that goes through as many branches of the import as will fit into a few kilobytes.
fn rich() -> (Value, Vec<u8>) {
    let (mut root, mut binary) = triangle();
    root["extensionsUsed"] = json!(["KHR_materials_ior", "EXT_unknown"]);
    root["extensionsRequired"] = json!(["KHR_mesh_quantization", "KHR_texture_transform"]);
    root["scenes"] = json!([{ "nodes": [0, 1, 2] }, { "nodes": [] }]);
    root["nodes"] = json!([
        { "mesh": 0, "rotation": [0, 0.6, 0, 0.8], "scale": [1, -1, 2], "children": [3] },
        { "camera": 0, "translation": [0, 0, 3], "name": "eye" },
        { "camera": 1, "matrix": [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 4, 5, 6, 1] },
        { "mesh": 1, "extensions": { "KHR_lights_punctual": { "light": 0 } } },
    ]);
    let lights = json!([
        { "type": "spot", "spot": { "innerConeAngle": 0.2, "outerConeAngle": 0.7 }, "range": 4,
          "color": [1, 0.5, 0], "intensity": 20, "name": "spot" },
        { "type": "directional" },
    ]);
    root["extensions"] = json!({
        "KHR_lights_punctual": { "lights": lights },
        "KHR_materials_variants": { "variants": [{ "name": "red" }] },
    });
    let orthographic = json!({ "type": "orthographic", "orthographic":
        { "ymag": 2, "xmag": 2, "znear": 0, "zfar": 9 } });
    root["cameras"].as_array_mut().unwrap().push(orthographic);
    root["samplers"] = json!([{ "wrapS": 33071, "wrapT": 33648, "magFilter": 9728 }]);
    root["textures"] = json!([{ "source": 0, "sampler": 0 }, { "source": 0 }]);
    root["accessors"].as_array_mut().unwrap().extend([
        json!({ "bufferView": 1, "componentType": 5120, "count": 2, "type": "VEC3", "normalized": true }),
        json!({ "componentType": 5126, "count": 3, "type": "VEC3", "sparse": {
            "count": 3, "indices": { "bufferView": 1, "componentType": 5123 },
            "values": { "bufferView": 0 },
        } }),
        json!({ "bufferView": 2, "componentType": 5126, "count": 3, "type": "VEC2", "byteOffset": 0 }),
        json!({ "bufferView": 0, "componentType": 5121, "count": 3, "type": "VEC4", "normalized": true }),
    ]);
    root["meshes"] = json!([
        { "primitives": [
            { "attributes": { "POSITION": 0, "TEXCOORD_0": 2, "COLOR_0": 6 }, "indices": 1, "material": 0,
              "extensions": { "KHR_materials_variants": { "mappings": [{ "material": 1, "variants": [0] }] } } },
            { "attributes": { "POSITION": 4, "NORMAL": 0, "TEXCOORD_1": 5 }, "mode": 5, "material": 1 },
        ] },
        { "primitives": [{ "attributes": { "POSITION": 0, "TEXCOORD_0": 2 }, "mode": 6, "material": 2,
            "targets": [{}] }] },
    ]);
    root["materials"] = json!([
        { "name": "lamp", "pbrMetallicRoughness": {
            "baseColorTexture": { "index": 0, "extensions": { "KHR_texture_transform": {
                "offset": [0.5, 0], "rotation": 1, "scale": [2, 3], "texCoord": 0 } } },
            "metallicRoughnessTexture": { "index": 1 } },
          "emissiveFactor": [1, 1, 1], "emissiveTexture": { "index": 1, "texCoord": 1 },
          "extensions": { "KHR_materials_emissive_strength": { "emissiveStrength": 30 } } },
        { "doubleSided": true, "alphaMode": "MASK", "normalTexture": { "index": 0 },
          "extensions": { "KHR_materials_ior": { "ior": 1.8 },
            "KHR_materials_clearcoat": { "clearcoatFactor": 0.5, "clearcoatTexture": { "index": 1 },
              "clearcoatRoughnessFactor": 0.2, "clearcoatNormalTexture": { "index": 0 } },
            "KHR_materials_sheen": { "sheenColorFactor": [1, 0.5, 0], "sheenRoughnessFactor": 0.5,
              "sheenColorTexture": { "index": 0 }, "sheenRoughnessTexture": { "index": 1 } },
            "KHR_materials_specular": { "specularFactor": 0.5, "specularColorFactor": [1, 0.5, 2],
              "specularTexture": { "index": 1 }, "specularColorTexture": { "index": 0 } },
            "KHR_materials_transmission":
              { "transmissionFactor": 0.5, "transmissionTexture": { "index": 1 } } } },
        { "extras": { "phong": true }, "alphaMode": "BLEND",
          "normalTexture": { "index": 1, "scale": 0.5, "extensions": {
            "KHR_texture_transform": { "rotation": 1 } } },
          "extensions": { "KHR_materials_pbrSpecularGlossiness": {
            "diffuseFactor": [1, 0.5, 0, 0.5], "glossinessFactor": 0.7,
            "diffuseTexture": { "index": 0 }, "specularGlossinessTexture": { "index": 1 } } } },
    ]);
    with_motion(&mut root, &mut binary);
    (root, binary)
}

/// Runs one case; a panic names the seed that repeats it.
fn survive(bytes: &[u8], seed: u64, accepted: &mut usize) {
    let outcome = catch_unwind(AssertUnwindSafe(|| {
        if let Ok(scene) = import_moving(bytes) {
            check_valid(&scene);
        }
        import_bytes(bytes).inspect(check_valid).is_ok()
    }));
    match outcome {
        Ok(taken) => *accepted += usize::from(taken),
        Err(_) => panic!("seed {seed} panics"),
    }
}

#[test]
fn flipped_bytes_never_panic() {
    let (root, binary) = rich();
    let files = [made::assemble(&root, &binary), made::cornell()];
    for file in &files {
        check_valid(&import_bytes(file).unwrap());
    }
    check_valid(&import_moving(&files[0]).unwrap());
    let mut accepted = 0;
    for seed in 1..=6000u64 {
        let mut dice = Dice(seed.wrapping_mul(0x9e37_79b9_7f4a_7c15));
        let mut bytes = files[dice.roll(files.len())].clone();
        for _ in 0..=dice.roll(6) {
            let place = dice.roll(bytes.len());
            bytes[place] = match dice.roll(4) {
                0 => dice.roll(256) as u8,
                1 => bytes[place] ^ (1 << dice.roll(8)),
                2 => b"0123456789-.eE\"{}[],:"[dice.roll(21)],
                _ => [0, 0xff, 0x7f, 0x80][dice.roll(4)],
            };
        }
        if dice.roll(10) == 0 {
            bytes.truncate(dice.roll(bytes.len()));
        }
        survive(&bytes, seed, &mut accepted);
    }
    println!("{accepted} of 6000 were still taken");
    assert!((100..5900).contains(&accepted), "{accepted} taken: the mutations test nothing");
}

/// Number of values in a JSON tree.
fn size(value: &Value) -> usize {
    1 + match value {
        Value::Array(list) => list.iter().map(size).sum(),
        Value::Object(map) => map.values().map(size).sum(),
        _ => 0,
    }
}

/// The `place`-th value of a tree, depth first.
fn nth(value: &mut Value, place: usize) -> Option<&mut Value> {
    if place == 0 {
        return Some(value);
    }
    let mut rest = place - 1;
    let children: Vec<&mut Value> = match value {
        Value::Array(list) => list.iter_mut().collect(),
        Value::Object(map) => map.values_mut().collect(),
        _ => Vec::new(),
    };
    for child in children {
        let count = size(child);
        if rest < count {
            return nth(child, rest);
        }
        rest -= count;
    }
    None
}

#[test]
fn odd_json_values_never_panic() {
    let (root, binary) = rich();
    let odd = [
        json!(-1),
        json!(0),
        json!(1),
        json!(2),
        json!(3),
        json!(7),
        json!(0.5),
        json!(-1e300),
        json!(1e300),
        json!(1e-300),
        json!(255),
        json!(65536),
        json!(u32::MAX),
        json!(u64::MAX),
        json!(9_007_199_254_740_993u64),
        json!(5121),
        json!(5126),
        json!(null),
        json!(true),
        json!(""),
        json!("VEC4"),
        json!("MAT3"),
        json!("%ff"),
        json!("data:;base64,AAAA"),
        json!([]),
        json!({}),
        json!([0]),
        json!([1e300, -1e300, 1e300]),
        json!({ "index": 0 }),
    ];
    let places = size(&root);
    let mut accepted = 0;
    for seed in 1..=6000u64 {
        let mut dice = Dice(seed.wrapping_mul(0x9e37_79b9_7f4a_7c15));
        let mut root = root.clone();
        for _ in 0..=dice.roll(2) {
            let value = odd[dice.roll(odd.len())].clone();
            if let Some(place) = nth(&mut root, 1 + dice.roll(places - 1)) {
                *place = value;
            }
        }
        survive(&made::assemble(&root, &binary), seed, &mut accepted);
    }
    println!("{accepted} of 6000 were still taken");
    assert!((100..5900).contains(&accepted), "{accepted} taken: the mutations test nothing");
}

#[test]
fn broken_pictures_never_panic() {
    use image::ImageFormat::{Jpeg, Png, WebP};
    let texels =
        image::RgbImage::from_fn(24, 24, |x, y| image::Rgb([x as u8 * 9, y as u8 * 9, 77]));
    let mut accepted = 0;
    for seed in 1..=3000u64 {
        let mut dice = Dice(seed.wrapping_mul(0x9e37_79b9_7f4a_7c15));
        let mut picture = std::io::Cursor::new(Vec::new());
        texels.write_to(&mut picture, [Png, Jpeg, WebP][seed as usize % 3]).unwrap();
        let mut picture = picture.into_inner();
        for _ in 0..dice.roll(4) {
            let place = dice.roll(picture.len());
            picture[place] = dice.roll(256) as u8;
        }
        let (mut root, mut binary) = triangle();
        binary.truncate(68);
        binary.extend_from_slice(&picture);
        root["bufferViews"][3]["byteLength"] = json!(picture.len());
        root["buffers"][0]["byteLength"] = json!(binary.len());
        survive(&made::assemble(&root, &binary), seed, &mut accepted);
    }
    println!("{accepted} of 3000 were still taken");
    assert!((750..2990).contains(&accepted), "{accepted} taken: the mutations test nothing");
}
