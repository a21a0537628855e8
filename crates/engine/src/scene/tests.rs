//! What a scene says of the points of its triangles.

use super::*;

/// A unit right triangle in z = 0 whose texture coordinates are its own x and y, seen by a
/// material.
fn triangle(material: Material, textures: Vec<Texture>) -> Scene {
    let vertices = [Vec3::ZERO, Vec3::X, Vec3::Y].map(|position| Vertex {
        uv: [Vec2::new(position.x, position.y); 2],
        tangent: Vec4::new(1.0, 0.0, 0.0, 1.0),
        ..Vertex::new(position, Vec3::Z)
    });
    Scene {
        vertices: vertices.into(),
        triangles: vec![Triangle { vertices: [0, 1, 2], material: 0 }],
        materials: vec![material],
        textures,
        ..Scene::default()
    }
}

fn uniform(texel: [u8; 4]) -> Texture {
    Texture { width: 1, height: 1, texels: vec![texel] }
}

#[test]
fn textures_enter_the_appearance_by_their_channels() {
    let material = Material {
        metallic: 0.5,
        roughness: 0.5,
        metallic_roughness_texture: Some(TextureSlot::data(0)),
        specular_texture: Some(TextureSlot::data(0)),
        specular_color_texture: Some(TextureSlot::plain(0)),
        transmission: 0.8,
        transmission_texture: Some(TextureSlot::data(0)),
        ..Material::default()
    };
    let scene = triangle(material, vec![uniform([51, 102, 153, 204])]);
    let seen = scene.appearance(&scene.triangles[0], 0.2, 0.3);
    let near = |a: f32, b: f32| assert!((a - b).abs() < 1e-6, "{a} is not {b}");
    near(seen.roughness, 0.5 * 0.4);
    near(seen.metallic, 0.5 * 0.6);
    near(seen.specular_factor, 0.8);
    near(seen.specular_color.y, srgb_to_linear(102));
    near(seen.transmission, 0.8 * 0.2);
    let scene = triangle(Material::default(), Vec::new());
    let (material, seen) = (&scene.materials[0], scene.appearance(&scene.triangles[0], 0.2, 0.3));
    assert_eq!(seen, material.appearance(Rgb::ONE));
}

#[test]
fn what_passes_is_share_times_colour_of_what_is_no_metal() {
    let translucency = Translucency {
        share: 0.5,
        share_texture: Some(TextureSlot::data(0)),
        color: Rgb::new(1.0, 0.5, 0.25),
        color_texture: Some(TextureSlot::plain(0)),
    };
    let material = Material {
        metallic: 0.25,
        translucency: Some(Box::new(translucency)),
        ..Material::default()
    };
    let scene = triangle(material, vec![uniform([51, 102, 153, 204])]);
    let seen = scene.appearance(&scene.triangles[0], 0.2, 0.3);
    assert!((seen.translucency - 0.5 * 0.8).abs() < 1e-6);
    let texel = Rgb::new(srgb_to_linear(51), srgb_to_linear(102), srgb_to_linear(153));
    let expected = texel * translucency.color * (0.4 * 0.75);
    let passed = scene.passed(&scene.triangles[0], 0.2, 0.3);
    assert!(passed.abs_diff_eq(expected, 1e-6), "{passed} {expected}");
}

#[test]
fn coverage_is_factor_times_texture_times_vertex_alpha() {
    let blended = Material {
        alpha: Alpha::Blend,
        opacity: 0.5,
        base_color_texture: Some(TextureSlot::plain(0)),
        ..Material::default()
    };
    let mut scene = triangle(blended, vec![uniform([9, 9, 9, 204])]);
    scene.vertices[1].alpha = 0.0;
    let at = |scene: &Scene, u: f32| scene.coverage(&scene.triangles[0], u, 0.1);
    assert!((at(&scene, 0.25) - 0.5 * 0.8 * 0.75).abs() < 1e-6);
    scene.materials[0].alpha = Alpha::Mask { cutoff: 0.2 };
    assert_eq!((at(&scene, 0.4), at(&scene, 0.6)), (1.0, 0.0));
    scene.materials[0].alpha = Alpha::Opaque;
    assert_eq!(at(&scene, 0.6), 1.0);
}

/// By hand: the texel (255, 128, 128) is the tilt (1, ε, ε) with ε = 1/255.
#[test]
fn a_normal_map_tilts_along_the_tangent_frame() {
    let slot = TextureSlot::data(0);
    let mapped =
        |scale| Material { normal_map: Some(NormalMap { slot, scale }), ..Material::default() };
    let normal = |scene: &Scene| scene.shading_normal(&scene.triangles[0], 0.3, 0.3).unwrap();
    let flat = triangle(mapped(1.0), vec![uniform([128, 128, 255, 255])]);
    assert!(normal(&flat).distance(Vec3::Z) < 0.01);
    let small = 1.0 / 255.0;
    let tilted = |x: f32, y: f32, z: f32| Vec3::new(x, y, z).normalize();
    let mut right = triangle(mapped(0.5), vec![uniform([255, 128, 191, 255])]);
    let expected = tilted(0.5, 0.5 * small, 2.0 * 191.0 / 255.0 - 1.0);
    assert!(normal(&right).distance(expected) < 1e-5, "{}", normal(&right));
    // The tangent is turned to +Y; with the sign −1 the bitangent is +X instead of −X.
    for (sign, x) in [(1.0, -0.5 * small), (-1.0, 0.5 * small)] {
        for vertex in &mut right.vertices {
            vertex.tangent = Vec4::new(0.0, 1.0, 0.0, sign);
        }
        let expected = tilted(x, 0.5, 2.0 * 191.0 / 255.0 - 1.0);
        assert!(normal(&right).distance(expected) < 1e-5, "{sign}: {}", normal(&right));
    }
    // Without tangents and without a map it is the interpolated normal.
    for vertex in &mut right.vertices {
        vertex.tangent = Vec4::ZERO;
    }
    assert_eq!(normal(&right), Vec3::Z);
    right.vertices[0].normal = Vec3::NEG_Z;
    let halfway = right.shading_normal(&right.triangles[0], 0.25, 0.25);
    assert_eq!(halfway, None, "normals that cancel each other out");
}

#[test]
fn unlit_materials_reflect_nothing() {
    let unlit = Material { unlit: true, ..Material::default() };
    let reflectance = unlit.reflectance(&unlit.appearance(Rgb::ONE));
    assert_eq!((reflectance.diffuse, reflectance.specular), (Rgb::ZERO, Rgb::ZERO));
}
