//! Lights, alpha, tangents and the textures of materials, through whole files.

use super::{File, close, encoded, front, square};
use crate::scene::gltf::{ImportOptions, Resources, import_with};
use crate::scene::made::assemble;
use crate::scene::{Alpha, LightKind, Model, Scene, SceneError, Vertex, srgb_to_linear};
use glam::{Vec2, Vec3, Vec4};
use image::{DynamicImage, ImageFormat, Rgba, RgbaImage};
use serde_json::{Value, json};

/// A PNG of one row of texels.
fn row(texels: &[[u8; 4]]) -> Vec<u8> {
    let picture = RgbaImage::from_fn(texels.len() as u32, 1, |x, _| Rgba(texels[x as usize]));
    encoded(ImageFormat::Png, &DynamicImage::ImageRgba8(picture))
}

/// A square whose image, seen from the front, stands upright: u = x, v = 1 − y.
fn mapped_square() -> File {
    let mut file = square();
    let uv = file.floats(&[0., 1., 1., 1., 0., 0., 1., 0.], "VEC2", 2);
    file.attribute("TEXCOORD_0", uv);
    file.root["meshes"][0]["primitives"][0]["material"] = json!(0);
    file
}

fn bumpy(file: &mut File, extra: Value) {
    let texture = file.image(&row(&[[128, 128, 255, 255]]));
    let mut map = extra;
    map["index"] = json!(texture);
    file.root["materials"] = json!([{ "normalTexture": map }]);
}

fn has_tangent(scene: &Scene, expected: Vec4) {
    assert_eq!(scene.warnings, []);
    for Vertex { tangent, .. } in &scene.vertices {
        assert!(tangent.abs_diff_eq(expected, 1e-5), "{tangent}, not {expected}");
    }
}

#[test]
fn lights_stand_and_shine_as_their_nodes_do() {
    let mut file = square();
    file.root["extensions"] = json!({ "KHR_lights_punctual": { "lights": [
        { "type": "spot", "name": "lamp", "intensity": 40, "color": [1, 0.5, 0], "range": 7,
          "spot": { "innerConeAngle": 0.25, "outerConeAngle": 0.5 } },
        { "type": "directional", "intensity": 3 },
        { "type": "point" },
    ] } });
    let turn = (0.5f64).sqrt();
    let light = |index: usize| json!({ "KHR_lights_punctual": { "light": index } });
    // A quarter turn about X takes −Z to −Y or +Y; scale changes where things are only.
    file.root["nodes"] = json!([
        { "mesh": 0, "children": [1, 2, 3], "scale": [2, 2, 2], "translation": [0, 1, 0] },
        { "extensions": light(0), "rotation": [-turn, 0, 0, turn], "translation": [1, 1, 1] },
        { "extensions": light(1), "rotation": [turn, 0, 0, turn], "name": "sun" },
        { "extensions": light(2), "scale": [0, 0, 0] },
        { "extensions": light(2), "name": "in no scene" },
    ]);
    let scene = file.import();
    assert_eq!(scene.warnings, []);
    let [lamp, sun, bulb] = &scene.lights[..] else { panic!("{:?}", scene.lights) };
    assert_eq!(
        (lamp.name.as_str(), sun.name.as_str(), bulb.name.as_str()),
        ("lamp", "sun", "light 2")
    );
    assert_eq!(lamp.kind, LightKind::Spot { inner_cone: 0.25, outer_cone: 0.5 });
    assert!(close(lamp.position, Vec3::new(2.0, 3.0, 2.0)) && close(lamp.direction, Vec3::NEG_Y));
    assert!(close(lamp.intensity, Vec3::new(40.0, 20.0, 0.0)));
    assert_eq!((lamp.range, sun.range), (Some(7.0), None));
    assert_eq!((sun.kind, bulb.kind), (LightKind::Directional, LightKind::Point));
    assert!(close(sun.direction, Vec3::Y) && close(sun.intensity, Vec3::splat(3.0)));
    assert!(close(bulb.position, Vec3::Y) && close(bulb.intensity, Vec3::ONE));
}

#[test]
fn alpha_is_kept_only_where_it_leaves_holes() {
    let with = |opacity: f32, mode: &str, alphas: [u8; 2]| {
        let mut file = mapped_square();
        let texture = file.image(&row(&alphas.map(|alpha| [255, 255, 255, alpha])));
        let surface = json!({ "baseColorFactor": [1, 1, 1, opacity],
            "baseColorTexture": { "index": texture } });
        file.root["materials"] =
            json!([{ "alphaMode": mode, "alphaCutoff": 0.25, "pbrMetallicRoughness": surface }]);
        let scene = file.import();
        assert_eq!(scene.warnings, []);
        scene
    };
    let alpha = |scene: &Scene| scene.materials[0].alpha;
    assert_eq!(alpha(&with(1.0, "BLEND", [255, 254])), Alpha::Blend);
    assert_eq!(alpha(&with(1.0, "BLEND", [255, 255])), Alpha::Opaque);
    assert_eq!(alpha(&with(0.5, "BLEND", [255, 255])), Alpha::Blend);
    assert_eq!(alpha(&with(0.5, "OPAQUE", [0, 0])), Alpha::Opaque);
    assert_eq!(alpha(&with(1.0, "MASK", [255, 0])), Alpha::Mask { cutoff: 0.25 });
    assert_eq!(alpha(&with(0.5, "MASK", [255, 128])), Alpha::Opaque, "0.25 is at the cutoff");
    let scene = with(0.5, "BLEND", [255, 102]);
    assert!((scene.coverage(&scene.triangles[0], 0.75, 0.0) - 0.5 * 0.4).abs() < 1e-6);
    // And by the vertices alone.
    let mut file = mapped_square();
    let color = file.floats(&[1., 1., 1., 0.5].repeat(4), "VEC4", 4);
    file.attribute("COLOR_0", color);
    file.root["materials"] = json!([{ "alphaMode": "BLEND" }]);
    let scene = file.import();
    assert_eq!(alpha(&scene), Alpha::Blend);
    assert_eq!(scene.coverage(&scene.triangles[0], 0.3, 0.3), 0.5);
}

/// On an upright image of a flat square the tangent is where u grows, and the bitangent
/// w · N × T where v falls, upwards.
#[test]
fn computed_tangents_are_the_directions_of_the_image() {
    let mut file = mapped_square();
    bumpy(&mut file, json!({}));
    has_tangent(&file.import(), Vec4::new(1.0, 0.0, 0.0, 1.0));
    // Mirrored by the node: the front turns away from +Z when z is, and stays when x is.
    file.root["nodes"] = json!([{ "mesh": 0, "scale": [-1, 1, 1] }]);
    let scene = file.import();
    assert!(close(front(&scene), Vec3::Z));
    has_tangent(&scene, Vec4::new(-1.0, 0.0, 0.0, -1.0));
    file.root["nodes"] = json!([{ "mesh": 0, "scale": [3, 1, -2] }]);
    let scene = file.import();
    assert!(close(front(&scene), Vec3::NEG_Z));
    has_tangent(&scene, Vec4::new(1.0, 0.0, 0.0, -1.0));
    // Turned by a quarter on the texture: u' = v, v' = −u, so u' grows where y falls, v' falls
    // where x grows.
    let turned = json!({ "extensions": { "KHR_texture_transform": {
        "rotation": std::f64::consts::FRAC_PI_2, "offset": [0, 1] } } });
    let mut file = mapped_square();
    bumpy(&mut file, turned);
    has_tangent(&file.import(), Vec4::new(0.0, -1.0, 0.0, 1.0));
    // Mirrored on the texture.
    let mut file = mapped_square();
    bumpy(&mut file, json!({ "extensions": { "KHR_texture_transform": { "scale": [-1, 1] } } }));
    has_tangent(&file.import(), Vec4::new(-1.0, 0.0, 0.0, -1.0));
}

#[test]
fn vertices_are_split_where_the_image_is_mirrored() {
    let mut file = square();
    // u grows from the middle edge to both sides.
    let uv = file.floats(&[0., 0., 1., 1., 1., 1., 0., 0.], "VEC2", 2);
    let uv2 = file.floats(&[1., 0., 0., 0., 0., 1., 1., 0.], "VEC2", 2);
    file.attribute("TEXCOORD_0", uv);
    file.attribute("TEXCOORD_1", uv2);
    file.root["meshes"][0]["primitives"][0]["material"] = json!(0);
    bumpy(&mut file, json!({ "texCoord": 1 }));
    let scene = file.import();
    assert_eq!(scene.triangles.len(), 2);
    assert_eq!(scene.vertices.len(), 6, "the shared edge has two tangents at each end");
    let signs = scene.triangles.iter().map(|triangle| {
        let tangents = triangle.vertices.map(|v| scene.vertices[v as usize].tangent);
        assert!(tangents.iter().all(|tangent| *tangent == tangents[0]), "{tangents:?}");
        // By hand: on each triangle ∂P/∂u is along an axis or a diagonal in the plane.
        assert!((tangents[0].truncate().length() - 1.0).abs() < 1e-5 && tangents[0].z == 0.0);
        tangents[0].w
    });
    assert_eq!(signs.sum::<f32>(), 0.0, "one is mirrored, the other is not");
    for triangle in &scene.triangles {
        let [a, b, c] = triangle.vertices.map(|v| scene.vertices[v as usize]);
        let [d, e] = [b, c].map(|v| (v.position - a.position, v.uv[1] - a.uv[1]));
        let determinant = d.1.perp_dot(e.1);
        let along = (d.0 * e.1.y - e.0 * d.1.y) / determinant;
        let down = (e.0 * d.1.x - d.0 * e.1.x) / determinant;
        assert!(close(along.normalize(), a.tangent.truncate()), "{along} {}", a.tangent);
        let up = a.tangent.w * a.normal.cross(a.tangent.truncate());
        assert!(up.dot(-down) > 0.0, "{up} {down}");
    }
}

#[test]
fn given_tangents_are_used_and_broken_ones_replaced() {
    let mut file = mapped_square();
    bumpy(&mut file, json!({}));
    let normal = file.floats(&[0., 0., 1.].repeat(4), "VEC3", 3);
    file.attribute("NORMAL", normal);
    let slanted = file.floats(&[0., 2., 0.5, -1.].repeat(4), "VEC4", 4);
    file.attribute("TANGENT", slanted);
    has_tangent(&file.import(), Vec4::new(0.0, 1.0, 0.0, -1.0));
    let broken = [0., 1., 0., 1., 0., 1., 0., 1., 0., f32::NAN, 0., 1., 0., 1., 0., 1.];
    let broken = file.floats(&broken, "VEC4", 4);
    file.attribute("TANGENT", broken);
    let mut scene = file.import();
    assert_eq!(scene.warnings.remove(0).at, "meshes[0].primitives[0].attributes.TANGENT");
    has_tangent(&scene, Vec4::new(1.0, 0.0, 0.0, 1.0));
    // Without normals, the format says, tangents are not to be used.
    file.attribute("TANGENT", slanted);
    file.root["meshes"][0]["primitives"][0]["attributes"].as_object_mut().unwrap().remove("NORMAL");
    has_tangent(&file.import(), Vec4::new(1.0, 0.0, 0.0, 1.0));
    // Nor where no material asks for them.
    file.root["materials"] = json!([{}]);
    has_tangent(&file.import(), Vec4::ZERO);
}

/// All around a vertex that a hundred thousand triangles share, recursion would end the program.
#[test]
fn a_fan_too_wide_for_tangents_goes_without() {
    let mut file = mapped_square();
    bumpy(&mut file, json!({}));
    let count = 100_000;
    let around = (0..count).map(|i| (i as f32 / count as f32 * 6.0).sin_cos());
    let rim: Vec<f32> = around.flat_map(|(sin, cos)| [1e4 * cos, 1e4 * sin, 0.0]).collect();
    let positions = file.floats(&[&[0.0; 3][..], &rim].concat(), "VEC3", 3);
    let flat: Vec<f32> = rim.chunks(3).flat_map(|p| [p[0] * 1e-4, p[1] * 1e-4]).collect();
    let uv = file.floats(&[&[0.0; 2][..], &flat].concat(), "VEC2", 2);
    file.attribute("POSITION", positions);
    file.attribute("TEXCOORD_0", uv);
    file.root["meshes"][0]["primitives"][0]["mode"] = json!(6);
    let scene = file.import();
    assert!(scene.triangles.len() > 90_000, "{}", scene.triangles.len());
    let warned = scene.warnings.iter().any(|w| w.what.contains("too many triangles at one vertex"));
    assert!(warned, "{:?}", scene.warnings);
}

#[test]
fn every_slot_has_its_set_and_its_transform() {
    let mut file = mapped_square();
    let other = file.floats(&[0., 0., 1., 0., 0., 1., 1., 1.], "VEC2", 2);
    file.attribute("TEXCOORD_1", other);
    let texture = file.image(&row(&[[128, 64, 255, 32]]));
    // The transform's set overrides the reference's.
    let transform = json!({ "KHR_texture_transform":
        { "offset": [0.25, 0.5], "scale": [2, 3], "texCoord": 1 } });
    let info = json!({ "index": texture, "texCoord": 0, "extensions": transform });
    file.root["materials"] = json!([{
        "pbrMetallicRoughness": { "baseColorTexture": info, "metallicRoughnessTexture": info },
        "normalTexture": info, "emissiveTexture": info, "emissiveFactor": [1, 1, 1],
        "extensions": {
            "KHR_materials_specular": { "specularTexture": info, "specularColorTexture": info },
            "KHR_materials_transmission":
                { "transmissionFactor": 1, "transmissionTexture": info },
        },
    }]);
    let scene = file.import();
    let material = &scene.materials[0];
    let slots = [
        material.base_color_texture,
        material.metallic_roughness_texture,
        material.normal_map.map(|map| map.slot),
        material.emission_texture,
        material.specular_texture,
        material.specular_color_texture,
        material.transmission_texture,
    ];
    for slot in slots {
        let slot = slot.expect("it is read");
        assert_eq!((slot.uv_set, slot.texture), (1, 0));
        let at = slot.transformed(Vec2::new(1.0, 1.0));
        assert!(at.abs_diff_eq(Vec2::new(2.25, 3.5), 1e-6), "{at}");
    }
    let seen = scene.appearance(&scene.triangles[0], 0.3, 0.3);
    assert!((seen.base_color.x - srgb_to_linear(128)).abs() < 1e-6);
    assert!((seen.specular_color.y - srgb_to_linear(64)).abs() < 1e-6);
    assert!((seen.roughness - 64.0 / 255.0).abs() < 1e-6);
    assert!((seen.specular_factor - 32.0 / 255.0).abs() < 1e-6);
    assert!((seen.transmission - 128.0 / 255.0).abs() < 1e-6);
}

/// F0 and roughness are what the extension says, at each texel.
#[test]
fn specular_glossiness_keeps_its_reflection() {
    let mut file = mapped_square();
    let texture = file.image(&row(&[[255, 128, 0, 255], [255, 128, 0, 51]]));
    file.root["materials"] = json!([{
        "pbrMetallicRoughness": { "baseColorFactor": [0, 0, 0, 1], "metallicFactor": 1 },
        "extensions": { "KHR_materials_pbrSpecularGlossiness": {
            "diffuseFactor": [0.1, 0.2, 0.3, 0.5], "specularFactor": [0.5, 0.5, 1],
            "glossinessFactor": 0.8, "specularGlossinessTexture": { "index": texture },
        } },
    }]);
    let scene = file.import();
    let (material, triangle) = (&scene.materials[0], &scene.triangles[0]);
    assert_eq!(material.opacity, 0.5);
    for (u, alpha) in [(0.25, 1.0), (0.75, 0.2)] {
        let seen = scene.appearance(triangle, u, 0.0);
        assert_eq!(seen.metallic, 0.0);
        let roughness = 1.0 - 0.8 * alpha;
        assert!((seen.roughness - roughness).abs() <= 0.5 / 255.0, "{u}: {}", seen.roughness);
        assert!(close(seen.base_color, Vec3::new(0.1, 0.2, 0.3)));
        let f0 = Vec3::new(0.5, 0.5 * srgb_to_linear(128), 0.0);
        // ks = F0 + (F90 − F0)/21, F90 = 1.
        let expected = f0 + (Vec3::ONE - f0) / 21.0;
        let specular = material.reflectance(&seen).specular;
        assert!(specular.abs_diff_eq(expected, 1e-5), "{specular} {expected}");
    }
    let [warning] = &scene.warnings[..] else { panic!("{:?}", scene.warnings) };
    assert!(warning.at.ends_with("KHR_materials_pbrSpecularGlossiness"));
}

/// What lies on a surface is what factors and channels of textures say.
#[test]
fn layers_are_read_with_their_textures() {
    let mut file = mapped_square();
    let texture = file.image(&row(&[[128, 64, 255, 51]]));
    let info = json!({ "index": texture });
    file.root["materials"] = json!([{ "extensions": {
        "KHR_materials_clearcoat": {
            "clearcoatFactor": 0.8, "clearcoatTexture": info,
            "clearcoatRoughnessFactor": 0.6, "clearcoatRoughnessTexture": info,
            "clearcoatNormalTexture": { "index": texture, "scale": 0.5 },
        },
        "KHR_materials_sheen": {
            "sheenColorFactor": [1, 0.5, 0.25], "sheenColorTexture": info,
            "sheenRoughnessFactor": 0.9, "sheenRoughnessTexture": info,
        },
        "KHR_materials_anisotropy": {
            "anisotropyStrength": 0.5, "anisotropyRotation": 0.3, "anisotropyTexture": info,
        },
        "KHR_materials_iridescence": {
            "iridescenceFactor": 0.5, "iridescenceTexture": info, "iridescenceIor": 1.8,
            "iridescenceThicknessMinimum": 200, "iridescenceThicknessMaximum": 600,
            "iridescenceThicknessTexture": info,
        },
    } }]);
    let scene = file.import();
    assert_eq!(scene.warnings, []);
    let seen = scene.appearance(&scene.triangles[0], 0.3, 0.3).layers;
    let near = |a: f32, b: f32| assert!((a - b).abs() < 1e-6, "{a} is not {b}");
    near(seen.coat, 0.8 * 128.0 / 255.0);
    near(seen.coat_roughness, 0.6 * 64.0 / 255.0);
    near(seen.sheen_color.y, 0.5 * srgb_to_linear(64));
    near(seen.sheen_roughness, 0.9 * 0.2);
    let turned = (2.0 * Vec2::new(128.0, 64.0) / 255.0 - 1.0).to_angle() + 0.3;
    let expected = 0.5 * Vec2::from_angle(turned);
    assert!(seen.anisotropy.abs_diff_eq(expected, 1e-5), "{} {expected}", seen.anisotropy);
    near(seen.film, 0.5 * 128.0 / 255.0);
    near(seen.film_ior, 1.8);
    assert!((seen.film_thickness - (200.0 + 400.0 * 64.0 / 255.0)).abs() < 1e-3);
    // The map of the coat tilts the coat alone: by (128, 64)/255 · 2 − 1, halved, over blue's 1.
    let triangle = &scene.triangles[0];
    let tilt = 0.5 * (2.0 * Vec2::new(128.0, 64.0) / 255.0 - 1.0);
    let expected = tilt.extend(1.0).normalize();
    let found = scene.coat_normal(triangle, 0.3, 0.3).unwrap();
    assert!(found.abs_diff_eq(expected, 1e-5), "{found} {expected}");
    assert_eq!(scene.shading_normal(triangle, 0.3, 0.3), Some(Vec3::Z));
    // Nothing is there by default, and what is wrong is named.
    let of = |extensions: Value| {
        let mut file = mapped_square();
        file.root["materials"] = json!([{ "extensions": extensions }]);
        file.import()
    };
    let extensions = ["clearcoat", "sheen", "anisotropy", "iridescence", "dispersion"];
    let extensions = extensions.map(|name| format!("KHR_materials_{name}"));
    for name in &extensions {
        let scene = of(json!({ name: {} }));
        assert!(scene.materials[0].layering.is_none() && scene.warnings.is_empty(), "{name}");
    }
    let scene = of(json!({ "KHR_materials_clearcoat": { "clearcoatFactor": 1.5 } }));
    assert_eq!(scene.appearance(&scene.triangles[0], 0.3, 0.3).layers.coat, 1.0);
    let at = "materials[0].extensions.KHR_materials_clearcoat.clearcoatFactor";
    assert_eq!(scene.warnings[0].at, at);
    file.root["materials"] = json!([{ "extensions":
        { "KHR_materials_sheen": { "sheenColorFactor": [1, 1] } } }]);
    let error = variant(&file, None).unwrap_err();
    assert!(error.at.starts_with("materials[0].extensions.KHR_materials_sheen"), "{error}");
}

/// A brushed surface has its direction in space by the file's tangents, or by those of its texture
/// coordinates; without either it is told that it is not brushed.
#[test]
fn brushed_surfaces_have_tangents() {
    let brushed = || {
        let mut file = mapped_square();
        file.root["materials"] = json!([{ "extensions": { "KHR_materials_anisotropy":
            { "anisotropyStrength": 0.8, "anisotropyRotation": std::f64::consts::FRAC_PI_2 } } }]);
        file
    };
    let along = |scene: &Scene| {
        let seen = scene.appearance(&scene.triangles[0], 0.3, 0.3).layers.anisotropy;
        scene.in_tangents(&scene.triangles[0], Vec2::splat(0.3), seen)
    };
    let scene = brushed().import();
    assert_eq!(scene.warnings, []);
    // A quarter turn against the clock takes +X, where u grows, to +Y.
    assert!(close(along(&scene), 0.8 * Vec3::Y), "{}", along(&scene));
    let mut given = brushed();
    let normal = given.floats(&[0., 0., 1.].repeat(4), "VEC3", 3);
    given.attribute("NORMAL", normal);
    let tangent = given.floats(&[0., 1., 0., 1.].repeat(4), "VEC4", 4);
    given.attribute("TANGENT", tangent);
    let without_coordinates = |file: &mut File| {
        let attributes = &mut file.root["meshes"][0]["primitives"][0]["attributes"];
        attributes.as_object_mut().unwrap().remove("TEXCOORD_0");
    };
    without_coordinates(&mut given);
    let scene = given.import();
    assert_eq!(scene.warnings, []);
    assert!(close(along(&scene), -0.8 * Vec3::X), "{}", along(&scene));
    let mut without = brushed();
    without_coordinates(&mut without);
    let scene = without.import();
    assert!(scene.warnings[0].what.contains("anisotropy has no effect"), "{:?}", scene.warnings);
    assert_eq!(along(&scene), Vec3::ZERO);
}

#[test]
fn dispersion_is_that_of_a_body() {
    let with = |thickness: f32, dispersion: f32| {
        let mut file = mapped_square();
        file.root["materials"] = json!([{ "extensions": {
            "KHR_materials_transmission": { "transmissionFactor": 1 },
            "KHR_materials_volume": { "thicknessFactor": thickness },
            "KHR_materials_dispersion": { "dispersion": dispersion },
        } }]);
        file.import()
    };
    let scene = with(1.0, 0.36);
    assert_eq!((scene.materials[0].dispersion, scene.warnings), (0.36, vec![]));
    for (thickness, dispersion, expected) in [(0.0, 0.36, 0.0), (1.0, -1.0, 0.0)] {
        let scene = with(thickness, dispersion);
        assert_eq!(scene.materials[0].dispersion, expected);
        assert!(scene.warnings[0].at.contains("KHR_materials_dispersion"), "{:?}", scene.warnings);
    }
}

fn variant(file: &File, name: Option<&str>) -> Result<Scene, SceneError> {
    let mut root = file.root.clone();
    root["buffers"] = json!([{ "byteLength": file.binary.len() }]);
    let options = ImportOptions { variant: name.map(String::from), ..ImportOptions::default() };
    import_with(&assemble(&root, &file.binary), &Resources::new(), &options)
}

#[test]
fn variants_are_chosen_by_name() {
    let mut file = mapped_square();
    file.root["materials"] = json!([{ "name": "bare" }, { "name": "red" }, { "name": "blue" }]);
    let variants = json!([{ "name": "warm" }, { "name": "cold" }, { "name": "hot" }]);
    file.root["extensions"] = json!({ "KHR_materials_variants": { "variants": variants } });
    let mappings =
        json!([{ "material": 1, "variants": [0, 2] }, { "material": 2, "variants": [1] }]);
    file.root["meshes"][0]["primitives"][0]["extensions"] =
        json!({ "KHR_materials_variants": { "mappings": mappings } });
    for (name, material) in
        [(None, "bare"), (Some("warm"), "red"), (Some("cold"), "blue"), (Some("hot"), "red")]
    {
        let scene = variant(&file, name).unwrap();
        let shown = scene.triangles[0].material as usize;
        assert_eq!(scene.materials[shown].name, material, "{name:?}");
    }
    let error = variant(&file, Some("mild")).unwrap_err();
    assert!(
        error.what.contains(r#"no variant "mild"; there are: "warm", "cold", "hot""#),
        "{error}"
    );
    let error = variant(&square(), Some("mild")).unwrap_err();
    assert!(error.what.ends_with("there are: none"), "{error}");
}

#[test]
fn a_material_asks_for_phong_by_its_extras() {
    let mut file = mapped_square();
    file.root["materials"] =
        json!([{ "extras": { "phong": true } }, { "extras": { "phong": 1 } }, {}]);
    let models: Vec<_> = file.import().materials.iter().map(|material| material.model).collect();
    assert_eq!(models, [Model::Phong, Model::Ggx, Model::Ggx]);
}
