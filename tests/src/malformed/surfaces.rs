//! Broken lights, materials and pictures.

use super::Expect::Refused;
use super::{Cases, accepted, png, png_claiming, refused, too_large};
use serde_json::{Value, json};

/// Lights without extent.
pub(super) fn lights(cases: &mut Cases) {
    let node = json!({ "KHR_lights_punctual": { "light": 0 } });
    let at = "nodes[0].extensions.KHR_lights_punctual.light";
    let missing = refused(at, "0, but there are 0 lights");
    cases.set("light that is not there", "/nodes/0/extensions", node.clone(), missing);
    let mut light = |name, light: Value, expect| {
        cases.edit(name, expect, |root, _| {
            root["nodes"][0]["extensions"] = node.clone();
            root["extensions"] = json!({ "KHR_lights_punctual": { "lights": [light] } });
        });
    };
    let spot = |inner: f64, outer: f64| {
        let spot = json!({ "innerConeAngle": inner, "outerConeAngle": outer });
        json!({ "type": "spot", "spot": spot })
    };
    light("point light", json!({ "type": "point", "intensity": 40, "range": 9 }), accepted(""));
    light("directional light", json!({ "type": "directional" }), accepted(""));
    light("spot light", spot(0.1, 0.5), accepted(""));
    let unknown = accepted("lights[0].type: is not a kind of light that is known");
    light("light of unknown kind", json!({ "type": "lava" }), unknown);
    let dark = json!({ "type": "point", "intensity": -1 });
    light("light of negative intensity", dark, refused("lights[0].intensity", "negative"));
    let bright = json!({ "type": "point", "intensity": 1e300 });
    light("light of intensity 10³⁰⁰", bright, refused("lights[0].intensity", "not finite"));
    let bright = json!({ "type": "point", "intensity": 1e20 });
    light("light of intensity 10²⁰", bright, accepted("lights[0]: is brighter than"));
    let color = json!({ "type": "point", "color": [1, -1, 1] });
    light("light of negative colour", color, refused("lights[0].color", "negative"));
    let near = json!({ "type": "point", "range": 0 });
    light("light of range 0", near, refused("lights[0].range", "not a distance"));
    light("spot without a cone", json!({ "type": "spot" }), refused("lights[0].spot", "missing"));
    let outer = "lights[0].spot.outerConeAngle";
    light("spot of more than a half space", spot(0.0, 1.6), refused(outer, "not in (0, π/2]"));
    light("spot of outer angle 0", spot(0.0, 0.0), refused(outer, "not in (0, π/2]"));
    let inner = "lights[0].spot.innerConeAngle";
    light("spot with the cones swapped", spot(0.6, 0.5), refused(inner, "is not in [0, 0.5)"));
    light("spot with a negative cone", spot(-0.1, 0.5), refused(inner, "is not in [0, 0.5)"));
    let hard = accepted("innerConeAngle: is as large as");
    light("spot with a hard edge", spot(0.5, 0.5), hard);
    cases.edit("light squashed flat", accepted("nodes[0]: its light is left out"), |root, _| {
        root["nodes"][0] = json!({ "scale": [0, 0, 0], "extensions": node });
        let lights = json!([{ "type": "directional" }]);
        root["extensions"] = json!({ "KHR_lights_punctual": { "lights": lights } });
    });
}

/// Extensions of materials that name what is not there, and tangents that are none.
pub(super) fn material_extensions(cases: &mut Cases) {
    let none = |member: &str| json!({ member: { "index": 3 } });
    for (name, extension, member) in [
        ("specular texture out of range", "KHR_materials_specular", "specularTexture"),
        ("specular colours out of range", "KHR_materials_specular", "specularColorTexture"),
        ("transmission out of range", "KHR_materials_transmission", "transmissionTexture"),
        (
            "glossiness out of range",
            "KHR_materials_pbrSpecularGlossiness",
            "specularGlossinessTexture",
        ),
    ] {
        let expect = Refused {
            at_contains: member,
            what_contains: "3, but there are 1 textures",
            too_large: false,
        };
        cases.set(name, "/materials/0/extensions", json!({ extension: none(member) }), expect);
    }
    let normals = "/materials/0/normalTexture";
    let texture = refused("normalTexture.index", "there are 1 textures");
    cases.set("normal map out of range", normals, json!({ "index": 1 }), texture);
    cases.set("normal map", normals, json!({ "index": 0, "scale": 2 }), accepted(""));
    let steep = json!({ "index": 0, "scale": 1e300 });
    cases.set("normal map of scale 10³⁰⁰", normals, steep, accepted("normalTexture.scale: inf"));
    let turned = json!({ "index": 0, "extensions": { "KHR_texture_transform": { "scale": 1 } } });
    let transform = refused("normalTexture.extensions.KHR_texture_transform", "invalid type");
    cases.set("normal map scaled by a number", normals, turned, transform);
    cases.edit("normal map without coordinates", accepted("has no effect"), |root, _| {
        root["materials"][0] = json!({ "normalTexture": { "index": 0, "texCoord": 1 } });
    });
    let zero = json!({ "componentType": 5126, "count": 3, "type": "VEC4" });
    let tangents = |root: &mut Value| {
        root["materials"][0]["normalTexture"] = json!({ "index": 0 });
        root["accessors"].as_array_mut().expect("a list").push(zero.clone());
        let attributes = &mut root["meshes"][0]["primitives"][0]["attributes"];
        attributes["NORMAL"] = json!(0);
        attributes["TANGENT"] = json!(3);
    };
    let anew = accepted("attributes.TANGENT: has tangents that are zero");
    cases.edit("tangents of length 0", anew, |root, _| tangents(root));
    cases.edit("tangents of three numbers", refused("TANGENT", "is Vec3"), |root, _| {
        tangents(root);
        root["accessors"][3]["type"] = json!("VEC3");
    });
    let mapping = |material: u32, variant: u32| {
        let mapping = json!({ "material": material, "variants": [variant] });
        json!({ "KHR_materials_variants": { "mappings": [mapping] } })
    };
    let primitive = "/meshes/0/primitives/0/extensions";
    let material = refused("mappings[0].material", "5, but there are 1 materials");
    cases.set("variant of no material", primitive, mapping(5, 0), material);
    let variant = refused("mappings[0].variants", "0, but there are 0 variants");
    cases.set("mapping of no variant", primitive, mapping(0, 0), variant);
}

/// Numbers, modes and references of materials.
pub(super) fn materials(cases: &mut Cases) {
    let surface = "/materials/0/pbrMetallicRoughness";
    let of = |member: &str| format!("{surface}/{member}");
    let negative = accepted("baseColorFactor: -5e0 is outside 0…1");
    cases.set("negative base colour", &of("baseColorFactor"), json!([-5, 1, 1, 1]), negative);
    let rough = accepted("roughnessFactor: 7e0 is outside 0…1");
    cases.set("roughness 7", &of("roughnessFactor"), json!(7), rough);
    let metal = accepted("metallicFactor: inf is outside 0…1");
    cases.set("metallic 10³⁰⁰", &of("metallicFactor"), json!(1e300), metal);
    let three = refused("baseColorFactor", "an array of length 4");
    cases.set("base colour of three", &of("baseColorFactor"), json!([1, 1, 1]), three);
    let emission = accepted("emissiveFactor: is above 1");
    cases.set("emission 50", "/materials/0/emissiveFactor", json!([50, 50, 50]), emission);
    cases.set("blended surface", "/materials/0/alphaMode", json!("BLEND"), accepted(""));
    cases.edit("negative cutoff", accepted("alphaCutoff: -1e0 is outside"), |root, _| {
        root["materials"][0]["alphaMode"] = json!("MASK");
        root["materials"][0]["alphaCutoff"] = json!(-1);
    });
    let alpha = refused("materials[0].alphaMode", "\"GHOST\" is not a value");
    cases.set("unknown alpha mode", "/materials/0/alphaMode", json!("GHOST"), alpha);
    let ior = json!({ "KHR_materials_ior": { "ior": -1 } });
    let clamped = accepted("KHR_materials_ior.ior: -1e0 is outside");
    cases.set("index of refraction −1", "/materials/0/extensions", ior, clamped);
    let texture = refused("baseColorTexture.index", "there are 1 textures");
    cases.set("texture out of range", &of("baseColorTexture/index"), json!(5), texture);
    let source = refused("textures[0].source", "there are 1 images");
    cases.set("image out of range", "/textures/0/source", json!(5), source);
    cases.set(
        "texture without a source",
        "/textures/0",
        json!({}),
        accepted("textures[0]: has no PNG"),
    );
    let set = accepted("texCoord: texture coordinate set 9 is ignored");
    cases.set("texture coordinate set 9", &of("baseColorTexture/texCoord"), json!(9), set);
    cases.edit("sampler out of range", refused("textures[0].sampler", "0 samplers"), |root, _| {
        root["textures"][0]["sampler"] = json!(0);
    });
}

/// Pictures that are broken or too large.
pub(super) fn images(cases: &mut Cases) {
    let broken = refused("images[0]", "cannot be decoded");
    let whole = png(8, 8, image::ExtendedColorType::Rgb8, &[7; 192]);
    cases.image("image cut short", &whole[..whole.len() / 2], broken);
    let mut flipped = whole.clone();
    flipped[45] ^= 0x55;
    cases.image("image with a wrong checksum", &flipped, broken);
    cases.image("image of text", b"not a picture", refused("images[0]", "is not a PNG"));
    cases.image("empty image", b"", refused("images[0]", "is not a PNG"));
    let bomb = too_large("images[0]", "60000 × 60000 texels");
    cases.image("image of 60,000 × 60,000", &png_claiming(60_000, 60_000), bomb);
    cases.image(
        "image of 2³¹−1 × 2³¹−1",
        &png_claiming(0x7fff_ffff, 0x7fff_ffff),
        Refused { at_contains: "images[0]", what_contains: "", too_large: true },
    );
    cases.image("image without width", &png_claiming(0, 5), refused("images[0]", ""));
    let gone = accepted("images[0].uri: \"wall.png\" is not among the files");
    cases.set("image that did not come along", "/images/0", json!({ "uri": "wall.png" }), gone);
    let uri = refused("images[0].uri", "leaves the folder");
    cases.set("image URI ../", "/images/0", json!({ "uri": "../../secret.png" }), uri);
}
