//! Imports of whole files.

mod broken_motion;
mod compressed;
mod extended;
mod motion;
mod sharing;
mod surfaces;

use super::warnings::MAX_WARNINGS;
use super::*;
use crate::scene::made::assemble;
use crate::scene::{COAT_MEAN, Projection, Warning, Wrap};
use glam::{Vec2, Vec3};
use serde_json::{Value, json};
use std::f64::consts::FRAC_PI_2;

fn import_bytes(bytes: &[u8]) -> Result<Scene, SceneError> {
    import(bytes, &Resources::new(), &ImportLimits::default())
}

/// Builds a file piece by piece; every attribute is a buffer view of its own.
struct File {
    root: Value,
    binary: Vec<u8>,
}

impl File {
    fn new() -> Self {
        let root = json!({
            "asset": { "version": "2.0" }, "scenes": [{ "nodes": [0] }], "nodes": [{ "mesh": 0 }],
            "meshes": [{ "primitives": [{ "attributes": {} }] }], "materials": [{}],
            "accessors": [], "bufferViews": [], "images": [], "textures": [],
        });
        Self { root, binary: Vec::new() }
    }

    fn push(&mut self, list: &str, value: Value) -> usize {
        let list = self.root[list].as_array_mut().unwrap();
        list.push(value);
        list.len() - 1
    }

    fn view(&mut self, bytes: &[u8]) -> usize {
        let offset = self.binary.len();
        self.binary.extend_from_slice(bytes);
        let view = json!({ "buffer": 0, "byteOffset": offset, "byteLength": bytes.len() });
        self.push("bufferViews", view)
    }

    fn accessor(&mut self, bytes: &[u8], component: u32, kind: &str, count: usize) -> usize {
        let view = self.view(bytes);
        self.push(
            "accessors",
            json!({ "bufferView": view, "componentType": component, "type": kind, "count": count }),
        )
    }

    fn floats(&mut self, values: &[f32], kind: &str, width: usize) -> usize {
        let bytes: Vec<u8> = values.iter().flat_map(|x| x.to_le_bytes()).collect();
        self.accessor(&bytes, 5126, kind, values.len() / width)
    }

    fn attribute(&mut self, name: &str, accessor: usize) -> &mut Self {
        self.root["meshes"][0]["primitives"][0]["attributes"][name] = json!(accessor);
        self
    }

    fn image(&mut self, bytes: &[u8]) -> usize {
        let view = self.view(bytes);
        let image = self.push("images", json!({ "bufferView": view }));
        self.push("textures", json!({ "source": image }))
    }

    fn glb(&self) -> Vec<u8> {
        let mut root = self.root.clone();
        root["buffers"] = json!([{ "byteLength": self.binary.len() }]);
        assemble(&root, &self.binary)
    }

    fn import(&self) -> Scene {
        import_bytes(&self.glb()).unwrap()
    }
}

/// A unit square in z = 0 that faces +Z, by its corners in strip order.
fn square() -> File {
    let mut file = File::new();
    let corners = [0., 0., 0., 1., 0., 0., 0., 1., 0., 1., 1., 0.];
    let position = file.floats(&corners, "VEC3", 3);
    file.attribute("POSITION", position);
    file.root["meshes"][0]["primitives"][0]["mode"] = json!(5);
    file
}

/// Area-weighted mean of the geometric normals.
fn front(scene: &Scene) -> Vec3 {
    let normals = scene.triangles.iter().map(|triangle| {
        let [a, b, c] = scene.corners(triangle);
        (b - a).cross(c - a)
    });
    normals.sum::<Vec3>().normalize()
}

fn close(a: Vec3, b: Vec3) -> bool {
    a.abs_diff_eq(b, 1e-5)
}

#[test]
fn lists_strips_and_fans_face_the_same_way() {
    let strip = square();
    for (mode, order) in
        [(5, vec![0u8, 1, 2, 3]), (6, vec![0, 1, 3, 2]), (4, vec![0, 1, 2, 2, 1, 3]), (5, vec![])]
    {
        let mut file = File { root: strip.root.clone(), binary: strip.binary.clone() };
        let primitive = "/meshes/0/primitives/0";
        if !order.is_empty() {
            let indices = file.accessor(&order, 5121, "SCALAR", order.len());
            file.root.pointer_mut(primitive).unwrap()["indices"] = json!(indices);
        }
        file.root.pointer_mut(primitive).unwrap()["mode"] = json!(mode);
        let scene = file.import();
        assert_eq!(scene.triangles.len(), 2, "mode {mode}");
        for triangle in &scene.triangles {
            let [a, b, c] = scene.corners(triangle);
            assert!(close((b - a).cross(c - a), Vec3::Z), "mode {mode}");
        }
    }
}

#[test]
fn transforms_keep_fronts_and_normals() {
    let mut file = square();
    let slanted = Vec3::new(0.6, 0.0, 0.8);
    let normal = file.floats(&slanted.to_array().repeat(4), "VEC3", 3);
    file.attribute("NORMAL", normal);
    let turn = (0.5f64).sqrt();
    // A quarter turn about +X takes +Z to −Y; the child is mirrored in z, then in x.
    let node = |extra: Value| {
        let mut parent = json!({ "children": [1], "rotation": [turn, 0, 0, turn] });
        parent["translation"] = json!([0, 0, 5]);
        let mut child = extra;
        child["mesh"] = json!(0);
        json!([parent, child])
    };
    for (child, expected_front, expected_normal) in [
        (json!({}), Vec3::NEG_Y, Vec3::new(0.6, -0.8, 0.0)),
        (json!({ "scale": [1, 1, -1] }), Vec3::Y, Vec3::new(0.6, 0.8, 0.0)),
        (json!({ "scale": [-1, 1, 1] }), Vec3::NEG_Y, Vec3::new(-0.6, -0.8, 0.0)),
        // Stretched twofold along x, the normal leans less that way: (0.3, 0.8) normalised.
        (
            json!({ "matrix": [2, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1] }),
            Vec3::NEG_Y,
            Vec3::new(0.3, -0.8, 0.0).normalize(),
        ),
    ] {
        file.root["nodes"] = node(child.clone());
        let scene = file.import();
        assert!(close(front(&scene), expected_front), "{child}: {}", front(&scene));
        let normal = scene.vertices[0].normal;
        assert!(close(normal, expected_normal), "{child}: {normal}");
        assert!(scene.vertices.iter().all(|v| (v.position.z - 5.0).abs() <= 1.0));
        assert_eq!(scene.vertices.len(), 4, "smooth corners are shared");
    }
}

#[test]
fn a_normal_behind_its_triangle_gives_way_to_the_flat_one() {
    let mut file = square();
    let normals = [0., 0., -1., 0., 0., 1., 0., 0., 0., f32::NAN, 0., 1.];
    let normal = file.floats(&normals, "VEC3", 3);
    file.attribute("NORMAL", normal);
    let scene = file.import();
    assert!(scene.vertices.iter().all(|vertex| close(vertex.normal, Vec3::Z)));
    let warned = |w: &Warning| w.at == "meshes[0].primitives[0].attributes.NORMAL";
    assert!(scene.warnings.iter().any(warned), "{:?}", scene.warnings);
}

#[test]
fn a_mesh_stands_wherever_a_node_names_it() {
    let mut file = square();
    file.root["nodes"] = json!([
        { "children": [1, 2] }, { "mesh": 0, "translation": [10, 0, 0] }, { "mesh": 0 },
        { "mesh": 0, "translation": [99, 0, 0] },
    ]);
    let scene = file.import();
    assert_eq!(scene.triangles.len(), 4);
    let (low, high) = scene.bounds().unwrap();
    assert_eq!((low, high), (Vec3::ZERO, Vec3::new(11.0, 1.0, 0.0)), "node 3 is in no scene");
    let limits = ImportLimits { max_triangles: 3, ..ImportLimits::default() };
    let mut root = file.root.clone();
    root["buffers"] = json!([{ "byteLength": file.binary.len() }]);
    let error = import(&assemble(&root, &file.binary), &Resources::new(), &limits).unwrap_err();
    assert!(error.too_large && error.what.contains("4 triangles"), "{error}");
}

#[test]
fn integers_strides_and_sparse_values_decode() {
    let mut file = File::new();
    // Positions as normalised 16-bit integers, eight bytes apart.
    let shorts: [[i16; 4]; 4] =
        [[0, 0, 0, 9], [32767, 0, 0, 9], [0, 32767, 0, 9], [-32768, 0, 0, 9]];
    let bytes: Vec<u8> = shorts.iter().flatten().flat_map(|x| x.to_le_bytes()).collect();
    let position = file.accessor(&bytes, 5122, "VEC3", 4);
    file.root["bufferViews"][0]["byteStride"] = json!(8);
    file.root["accessors"][position]["normalized"] = json!(true);
    let color = file.accessor(&[255, 0, 51, 7].repeat(4), 5121, "VEC4", 4);
    file.root["accessors"][color]["normalized"] = json!(true);
    let uv = file.accessor(&[255, 0].repeat(4), 5121, "VEC2", 4);
    file.root["accessors"][uv]["normalized"] = json!(true);
    // The second corner of the list is replaced by the fourth, the third by the second.
    let indices = file.accessor(&[0, 0, 0], 5121, "SCALAR", 3);
    let (places, values) = (file.view(&[1, 2]), file.view(&[1, 2]));
    file.root["accessors"][indices]["sparse"] = json!({
        "count": 2,
        "indices": { "bufferView": places, "componentType": 5121 },
        "values": { "bufferView": values },
    });
    file.attribute("POSITION", position);
    file.attribute("COLOR_0", color);
    file.attribute("TEXCOORD_1", uv);
    file.root["meshes"][0]["primitives"][0]["indices"] = json!(indices);
    let scene = file.import();
    assert_eq!(scene.corners(&scene.triangles[0]), [Vec3::ZERO, Vec3::X, Vec3::Y]);
    let vertex = scene.vertices[0];
    assert!(close(vertex.color, Vec3::new(1.0, 0.0, 0.2)));
    assert_eq!(vertex.uv, [Vec2::ZERO, Vec2::new(1.0, 0.0)]);
}

#[test]
fn materials_follow_the_extensions() {
    let mut file = square();
    file.root["meshes"][0]["primitives"][0]["material"] = json!(0);
    file.root["materials"] = json!([
        {
            "name": "glaze", "doubleSided": true,
            "pbrMetallicRoughness":
                { "baseColorFactor": [0.1, 0.2, 0.3, 0.5], "metallicFactor": 0.25, "roughnessFactor": 0.5 },
            "emissiveFactor": [1, 0.5, 0],
            "occlusionTexture": { "index": 7 },
            "extensions": {
                "KHR_materials_emissive_strength": { "emissiveStrength": 8 },
                "KHR_materials_ior": { "ior": 2.5 },
                "KHR_materials_specular": { "specularFactor": 0.5, "specularColorFactor": [1, 0.5, 0.25] },
                "KHR_materials_clearcoat": { "clearcoatFactor": 1 },
            },
        },
        { "extensions": { "KHR_materials_unlit": {} }, "emissiveFactor": [1, 1, 1] },
    ]);
    let scene = file.import();
    let glaze = &scene.materials[0];
    assert_eq!((glaze.name.as_str(), glaze.double_sided), ("glaze", true));
    assert!(close(glaze.base_color, Vec3::new(0.1, 0.2, 0.3)));
    assert_eq!((glaze.metallic, glaze.roughness, glaze.ior), (0.25, 0.5, 2.5));
    assert_eq!(glaze.specular_factor, 0.5);
    assert!(close(glaze.specular_color, Vec3::new(1.0, 0.5, 0.25)));
    assert!(close(glaze.emission, Vec3::new(8.0, 4.0, 0.0) * (1.0 - COAT_MEAN)));
    let unlit = &scene.materials[1];
    assert!(unlit.unlit && !unlit.emits() && !glaze.unlit);
    let at: Vec<_> = scene.warnings.iter().map(|warning| warning.at.as_str()).collect();
    assert_eq!(
        at,
        ["materials[0].occlusionTexture", "materials[0].extensions.KHR_materials_clearcoat",]
    );
}

#[test]
fn clear_materials_say_what_is_behind_them() {
    let mut file = square();
    file.root["meshes"][0]["primitives"][0]["material"] = json!(0);
    let smooth = json!({ "metallicFactor": 0, "roughnessFactor": 0 });
    file.root["materials"] = json!([
        {
            "pbrMetallicRoughness": smooth,
            "extensions": {
                "KHR_materials_transmission": { "transmissionFactor": 0.75 },
                "KHR_materials_volume": {
                    "thicknessFactor": 0.1, "attenuationDistance": 2, "attenuationColor": [1, 0.5, 0],
                },
            },
        },
        {
            "pbrMetallicRoughness": smooth,
            "extensions": {
                "KHR_materials_transmission": { "transmissionFactor": 1.5 },
                "KHR_materials_volume": { "attenuationDistance": -1 },
            },
        },
        {
            "pbrMetallicRoughness": { "metallicFactor": 0.5 },
            "extensions": { "KHR_materials_transmission": { "transmissionFactor": 1 } },
        },
        { "extensions": { "KHR_materials_volume": { "thicknessFactor": 1 } } },
    ]);
    let scene = file.import();
    let [body, sheet, rough, opaque] = &scene.materials[..] else { panic!("four materials") };
    assert_eq!((body.transmission, body.clear_share()), (0.75, 0.75));
    let volume = body.volume.expect("it is filled");
    assert_eq!(volume.attenuation_color, Vec3::new(1.0, 0.5, 0.0));
    assert_eq!(volume.attenuation_distance, 2.0);
    assert_eq!((sheet.transmission, sheet.volume), (1.0, None));
    assert_eq!(rough.clear_share(), 0.5);
    assert!(rough.casts_caustics());
    assert_eq!((opaque.clear_share(), opaque.volume), (0.0, None));
    assert!(!opaque.casts_caustics());
    let at = scene.warnings.iter().map(|warning| warning.at.as_str());
    let at: Vec<_> = at.filter(|at| at.starts_with("materials[")).collect();
    assert_eq!(
        at,
        [
            "materials[1].extensions.KHR_materials_transmission.transmissionFactor",
            "materials[1].extensions.KHR_materials_volume.attenuationDistance",
            "materials[3].extensions.KHR_materials_volume",
        ]
    );
}

/// What lets light through diffusely has two sides.
#[test]
fn diffuse_transmission_is_read() {
    let mut file = square();
    file.root["meshes"][0]["primitives"][0]["material"] = json!(0);
    let extended = |extensions| json!({ "extensions": extensions });
    file.root["materials"] = json!([
        extended(json!({ "KHR_materials_diffuse_transmission": {
            "diffuseTransmissionFactor": 0.75, "diffuseTransmissionColorFactor": [1, 0.5, 0],
        } })),
        extended(json!({ "KHR_materials_diffuse_transmission": {} })),
        extended(json!({
            "KHR_materials_diffuse_transmission": { "diffuseTransmissionFactor": 2 },
            "KHR_materials_volume": { "thicknessFactor": 1 },
        })),
        extended(json!({
            "KHR_materials_diffuse_transmission": { "diffuseTransmissionFactor": 1 },
            "KHR_materials_unlit": {},
        })),
    ]);
    let scene = file.import();
    let [leaf, opaque, body, unlit] = &scene.materials[..] else { panic!("four materials") };
    let translucency = leaf.translucency.as_ref().expect("it is translucent");
    assert_eq!((translucency.share, translucency.color), (0.75, Vec3::new(1.0, 0.5, 0.0)));
    assert!(leaf.double_sided && leaf.is_translucent());
    assert!(!opaque.double_sided && !opaque.is_translucent() && !unlit.is_translucent());
    let translucency = body.translucency.as_ref().expect("it is translucent");
    assert_eq!((translucency.share, translucency.color), (1.0, Vec3::ONE));
    let at = scene.warnings.iter().map(|warning| warning.at.as_str());
    let at: Vec<_> = at.filter(|at| at.starts_with("materials[")).collect();
    assert_eq!(
        at,
        [
            "materials[2].extensions.KHR_materials_diffuse_transmission.diffuseTransmissionFactor",
            "materials[2].extensions.KHR_materials_diffuse_transmission",
        ]
    );
}

fn encoded(format: image::ImageFormat, picture: &image::DynamicImage) -> Vec<u8> {
    let mut out = std::io::Cursor::new(Vec::new());
    picture.write_to(&mut out, format).unwrap();
    out.into_inner()
}

#[test]
fn textures_decode_and_transform() {
    use image::{DynamicImage, GrayAlphaImage, ImageBuffer, ImageFormat, LumaA, Rgb as Texel};
    let mut file = square();
    let uv = file.floats(&[0., 0., 1., 0., 0., 1., 1., 1.], "VEC2", 2);
    file.attribute("TEXCOORD_0", uv);
    file.root["meshes"][0]["primitives"][0]["material"] = json!(0);
    // Left black, right white, 16 bits a channel.
    let wide = ImageBuffer::from_fn(2, 1, |x, _| Texel([x as u16 * 0xffff; 3]));
    let color = file.image(&encoded(ImageFormat::Png, &DynamicImage::ImageRgb16(wide)));
    // Roughness in G and metallic in B.
    let data = ImageBuffer::from_fn(2, 1, |x, _| Texel([9u8, 100 + 55 * x as u8, 51]));
    let data = file.image(&encoded(ImageFormat::WebP, &DynamicImage::ImageRgb8(data)));
    let grey = GrayAlphaImage::from_pixel(3, 3, LumaA([188, 0]));
    let grey = file.image(&encoded(ImageFormat::Png, &DynamicImage::ImageLumaA8(grey)));
    let sampler = json!({ "wrapS": 33071, "wrapT": 33071, "magFilter": 9728 });
    file.root["samplers"] = json!([sampler]);
    file.root["textures"][color]["sampler"] = json!(0);
    // Twice as many copies along u, then a quarter turn, then a shift: u' = v, v' = 1 − 2u.
    let transform = json!({ "rotation": FRAC_PI_2, "offset": [0, 1], "scale": [2, 1] });
    file.root["materials"] = json!([{
        "pbrMetallicRoughness": {
            "baseColorTexture":
                { "index": color, "extensions": { "KHR_texture_transform": transform } },
            "metallicRoughnessTexture": { "index": data },
            "roughnessFactor": 0.5,
        },
        "emissiveFactor": [1, 1, 1],
        "emissiveTexture": { "index": grey },
    }]);
    let scene = file.import();
    let material = &scene.materials[0];
    assert_eq!((material.roughness, material.metallic), (0.5, 1.0));
    let typical = material.typical(material.base_color);
    assert!((typical.roughness - 0.25).abs() < 1e-3, "{}", typical.roughness);
    assert!((typical.metallic - 0.2).abs() < 1e-6);
    // The middles of the texels: u = ¼ and u = ¾.
    for (u, green) in [(0.25, 100.0), (0.75, 155.0)] {
        let seen = scene.appearance(&scene.triangles[0], u, 0.0);
        assert!((seen.roughness - 0.5 * green / 255.0).abs() < 1e-5, "{u}: {}", seen.roughness);
        assert!((seen.metallic - 0.2).abs() < 1e-6);
    }
    let slot = material.base_color_texture.unwrap();
    assert_eq!((slot.wrap, slot.nearest), ([Wrap::ClampToEdge; 2], true));
    let mapped = slot.linear * Vec2::new(0.25, 0.75) + slot.offset;
    assert!(mapped.abs_diff_eq(Vec2::new(0.75, 0.5), 1e-6), "{mapped}");
    // The first triangle's corners are (0,0), (1,0), (0,1): dark where v is small.
    let triangle = &scene.triangles[0];
    assert!(close(scene.base_color(triangle, 0.5, 0.1), Vec3::ZERO));
    assert!(close(scene.base_color(triangle, 0.1, 0.8), Vec3::ONE));
    assert!((scene.emission(triangle, 0.3, 0.3).x - 0.503).abs() < 2e-3, "sRGB 188 is 0.503");
    assert_eq!(scene.warnings, []);
}

#[test]
fn jpeg_decodes_and_texel_limits_hold() {
    let mut file = square();
    let picture = image::RgbImage::from_pixel(16, 16, image::Rgb([200, 100, 50]));
    let jpeg = encoded(image::ImageFormat::Jpeg, &image::DynamicImage::ImageRgb8(picture));
    let texture = file.image(&jpeg);
    let surface = json!({ "baseColorTexture": { "index": texture } });
    file.root["materials"] = json!([{ "pbrMetallicRoughness": surface }]);
    let texel = file.import().textures[0].texels[0];
    for (code, expected) in texel.into_iter().zip([200u8, 100, 50, 255]) {
        assert!(code.abs_diff(expected) < 6, "{texel:?}");
    }
    let mut root = file.root.clone();
    root["buffers"] = json!([{ "byteLength": file.binary.len() }]);
    let bytes = assemble(&root, &file.binary);
    for limits in [
        ImportLimits { max_texture_texels: 255, ..ImportLimits::default() },
        ImportLimits { max_total_texels: 255, ..ImportLimits::default() },
    ] {
        let error = import(&bytes, &Resources::new(), &limits).unwrap_err();
        assert!(error.too_large && error.at == "images[0]", "{error}");
    }
}

#[test]
fn cameras_stand_in_node_order_without_scale() {
    let mut file = square();
    file.root["cameras"] = json!([
        { "type": "perspective", "name": "lens", "perspective": { "yfov": 0.5, "znear": 0.1 } },
        { "type": "orthographic", "orthographic": { "ymag": 3, "xmag": 3, "znear": 0, "zfar": 9 } },
    ]);
    let turn = (0.5f64).sqrt();
    file.root["nodes"] = json!([
        { "mesh": 0, "children": [2, 1] },
        { "camera": 1, "name": "plan", "scale": [2, 2, 2], "rotation": [-turn, 0, 0, turn],
          "translation": [0, 7, 0] },
        { "camera": 0 },
    ]);
    let scene = file.import();
    let [plan, lens] = &scene.cameras[..] else { panic!("{:?}", scene.cameras) };
    assert_eq!((plan.name.as_str(), lens.name.as_str()), ("plan", "lens"));
    assert_eq!(plan.projection, Projection::Orthographic { ymag: 3.0 });
    assert_eq!(lens.projection, Projection::Perspective { yfov: 0.5 });
    // Looks straight down with −Z up in the picture.
    assert!(close(plan.to_world.transform_vector3(Vec3::NEG_Z), Vec3::NEG_Y));
    assert!(close(plan.to_world.transform_vector3(Vec3::Y), Vec3::NEG_Z));
    assert!(close(plan.to_world.transform_point3(Vec3::ZERO), Vec3::new(0.0, 7.0, 0.0)));
}

#[test]
fn gltf_takes_its_buffers_from_the_upload() {
    let file = square();
    let mut root = file.root.clone();
    let size = file.binary.len();
    root["buffers"] = json!([{ "byteLength": size, "uri": "parts/a%20mesh.bin" }]);
    let text = root.to_string().into_bytes();
    let error = import_bytes(&text).unwrap_err();
    assert!(error.at == "buffers[0].uri" && error.what.contains("parts/a mesh.bin"), "{error}");
    let resources = Resources::from([("parts/a mesh.bin".to_owned(), file.binary.clone())]);
    let scene = import(&text, &resources, &ImportLimits::default()).unwrap();
    assert_eq!(scene.triangles.len(), 2);
    let packed = base64::Engine::encode(&base64::prelude::BASE64_STANDARD, &file.binary);
    let uri = format!("data:application/octet-stream;base64,{packed}");
    root["buffers"] = json!([{ "byteLength": size, "uri": uri }]);
    assert_eq!(import_bytes(root.to_string().as_bytes()).unwrap().triangles.len(), 2);
}

#[test]
fn warnings_are_bounded() {
    let mut file = square();
    // Each is another one: the same would be counted.
    let turned = |node: u32| json!({ "rotation": [0, 0, 0, 2.0 + 0.01 * f64::from(node)] });
    let nodes: Vec<Value> = (0..5000).map(turned).collect();
    file.root["nodes"].as_array_mut().unwrap().extend(nodes);
    let warnings = file.import().warnings;
    assert_eq!(warnings.len(), MAX_WARNINGS + 1);
    assert!(warnings[MAX_WARNINGS].what.starts_with("4800 more"), "{:?}", warnings[MAX_WARNINGS]);
}

#[test]
fn what_the_format_allows_and_the_crate_does_not_is_taken() {
    let mut file = square();
    // A scene without nodes, whole numbers with a fraction, an animation of a pointer, nulls.
    file.root["scenes"] = json!([{ "nodes": [0.0] }, { "name": "empty" }]);
    file.root["scene"] = json!(null);
    file.root["accessors"][0]["count"] = json!(4.0);
    let channel = json!({ "sampler": 0, "target": { "path": "pointer" } });
    file.root["animations"] =
        json!([{ "channels": [channel], "samplers": [{ "input": 0, "output": 0 }] }]);
    let scene = file.import();
    assert_eq!(scene.triangles.len(), 2);
    let at: Vec<_> = scene.warnings.iter().map(|warning| warning.at.as_str()).collect();
    assert_eq!(at, ["animations", "scenes"]);
    file.root["scene"] = json!(1);
    assert!(file.import().triangles.is_empty());
}

#[test]
fn indices_beyond_32_bits_are_not_cut_off() {
    let mut file = square();
    file.root["nodes"][0]["mesh"] = json!(1u64 << 32);
    let bytes = assemble(&file.root, &file.binary);
    let error = import_bytes(&bytes).unwrap_err();
    assert_eq!(error.at, "nodes[0].mesh", "{error}");
}

#[test]
fn validation_copies_no_bounds() {
    // Validated as they are, the bounds would be copied for each primitive: 10¹⁰ numbers.
    let mut file = square();
    file.root["accessors"][0]["min"] = json!(vec![0; 200_000]);
    let primitive = file.root["meshes"][0]["primitives"][0].clone();
    file.root["meshes"][0]["primitives"] = json!(vec![primitive; 50_000]);
    let start = std::time::Instant::now();
    assert_eq!(file.import().triangles.len(), 100_000);
    assert!(start.elapsed().as_secs() < 20, "{:?}", start.elapsed());
}
