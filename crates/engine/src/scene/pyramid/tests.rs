//! Means of textures against sums over their texels.

use super::*;
use crate::radiometry::Rgb;
use crate::random::Stream;
use crate::random::bits;
use crate::scene::part::Part;
use crate::scene::{Triangle, Vertex, Wrap};
use glam::Vec3;

/// A right triangle whose texture coordinates are its barycentric ones, of a material with one
/// texture as base colour and emission.
fn scene(texture: Texture, material: Material) -> Scene {
    let corners = [Vec3::ZERO, Vec3::X, Vec3::Y].map(|position| Vertex {
        uv: [Vec2::new(position.x, position.y); 2],
        ..Vertex::new(position, Vec3::Z)
    });
    let slot = TextureSlot::plain(0);
    let material = Material {
        base_color_texture: Some(slot),
        emission_texture: Some(slot),
        emission: Rgb::ONE,
        ..material
    };
    Scene {
        vertices: corners.into(),
        triangles: vec![Triangle { vertices: [0, 1, 2], material: 0 }],
        materials: vec![material],
        textures: vec![texture],
        ..Scene::default()
    }
}

fn random_texture(width: u32, height: u32) -> Texture {
    let texel = |at: u32| bits(3, Stream::Path, at.into()).to_le_bytes();
    Texture { width, height, texels: (0..width * height).map(texel).collect() }
}

/// Base colour over a square of that side in barycentric coordinates.
fn seen(scene: &Scene, pyramids: &Pyramids, at: Vec2, side: f32) -> Rgb {
    let part = Part { at, edges: [Vec2::X * side, Vec2::Y * side] };
    scene.appearance_over(pyramids, &scene.triangles[0], &part).base_color
}

fn mean_texel(texture: &Texture, weight: impl Fn(u8) -> f64) -> Rgb {
    let (mut sum, mut weights) = (glam::DVec4::ZERO, 0.0);
    for texel in &texture.texels {
        sum += Encoding::Srgb.decode(*texel).as_dvec4() * weight(texel[3]);
        weights += weight(texel[3]);
    }
    (sum / weights).truncate().as_vec3()
}

fn is_near(a: Rgb, b: Rgb, tolerance: f32) -> bool {
    (a - b).abs().max_element() < tolerance
}

/// A part as large as the texture sees its mean, in linear light, whatever the size of the
/// texture; and a mean of codes, or a sample in its middle, is none.
#[test]
fn the_whole_is_the_mean_of_all_texels() {
    for (width, height) in [(64, 64), (37, 21), (1, 19), (256, 3), (2, 2)] {
        let texture = random_texture(width, height);
        let expected = mean_texel(&texture, |_| 1.0);
        let scene = scene(texture, Material::default());
        let pyramids = Pyramids::new(&scene);
        for at in [Vec2::splat(0.5), Vec2::new(0.1, 0.8), Vec2::new(0.33, 0.2)] {
            let found = seen(&scene, &pyramids, at, 40.0);
            assert!(is_near(found, expected, 1e-3), "{width} × {height}: {found} {expected}");
            let point = scene.base_color(&scene.triangles[0], at.x, at.y);
            let codes = scene.textures[0].texels.iter().map(|texel| f64::from(texel[0]));
            let by_codes = codes.sum::<f64>() / f64::from(width * height) / 255.0;
            let by_codes = crate::scene::srgb_to_linear((by_codes * 255.0) as u8);
            assert!(!is_near(Rgb::splat(by_codes), expected, 1e-2) || width * height < 20);
            assert!(!is_near(point, expected, 1e-3) || width * height < 20, "{point}");
        }
    }
}

/// A part of 16 × 16 texels sees about their mean, and its neighbours not at all; a part of no size
/// sees what a sample sees.
#[test]
fn a_part_sees_what_it_covers() {
    let mut texture = random_texture(128, 128);
    // A dark half of the image, but for the noise.
    for (index, texel) in texture.texels.iter_mut().enumerate() {
        if index % 128 < 64 {
            texel.iter_mut().for_each(|code| *code /= 8);
        }
    }
    let scene = scene(texture, Material::default());
    let pyramids = Pyramids::new(&scene);
    let expected = |x: usize, y: usize| {
        let rows = (y - 8..y + 8).map(|y| &scene.textures[0].texels[y * 128 + x - 8..][..16]);
        let texels = rows.flatten().copied().collect();
        mean_texel(&Texture { width: 16, height: 16, texels }, |_| 1.0)
    };
    for (x, y) in [(30, 30), (90, 40), (40, 100)] {
        let at = Vec2::new(x as f32, y as f32) / 128.0;
        let found = seen(&scene, &pyramids, at, 16.0 / 128.0);
        let expected = expected(x, y);
        assert!((found / expected - 1.0).abs().max_element() < 0.12, "{found} {expected}");
        let [point, direct] =
            [seen(&scene, &pyramids, at, 0.0), scene.base_color(&scene.triangles[0], at.x, at.y)];
        assert!(is_near(point, direct, 1e-6), "{point} {direct}");
    }
}

/// A long part across stripes is their mean, one along a stripe is that stripe's.
#[test]
fn a_long_part_is_not_blurred_across() {
    let texel = |at: u32| if (at % 64 / 8).is_multiple_of(2) { [255; 4] } else { [0, 0, 0, 255] };
    let texels = (0..64 * 64).map(texel).collect();
    let scene = scene(Texture { width: 64, height: 64, texels }, Material::default());
    let pyramids = Pyramids::new(&scene);
    let over = |edges: [Vec2; 2]| {
        let part = Part { at: Vec2::new(4.0 / 64.0, 0.5), edges };
        scene.emission_over(&pyramids, &scene.triangles[0], &part)
    };
    let texel = 1.0 / 64.0;
    let along = over([Vec2::X * 2.0 * texel, Vec2::Y * 14.0 * texel]);
    assert!(is_near(along, Rgb::ONE, 1e-3), "{along}");
    let across = over([Vec2::X * 32.0 * texel, Vec2::Y * 3.0 * texel]);
    assert!(is_near(across, Rgb::splat(0.5), 0.05), "{across}");
    // The same aslant: edges need not be at right angles to each other.
    let aslant = over([Vec2::new(1.0, 15.0) * texel, Vec2::new(1.0, -15.0) * texel]);
    assert!(is_near(aslant, Rgb::ONE, 1e-3), "{aslant}");
}

/// What is cut out, or as far as it is blended out, gives no colour; in an opaque material alpha
/// means nothing.
#[test]
fn colour_counts_by_what_is_there_of_it() {
    let texture = random_texture(64, 64);
    let cutoff = 100.0 / 255.0;
    let cases: [(Alpha, &dyn Fn(u8) -> f64); 3] = [
        (Alpha::Opaque, &|_| 1.0),
        (Alpha::Blend, &|alpha| f64::from(alpha)),
        (Alpha::Mask { cutoff }, &|alpha| f64::from(u8::from(alpha >= 100))),
    ];
    for (alpha, weight) in cases {
        // Green only where alpha is high, so that the weights matter.
        let mut texture = texture.clone();
        texture.texels.iter_mut().for_each(|[_, green, _, alpha]| *green = *alpha);
        let expected = mean_texel(&texture, weight);
        let scene = scene(texture, Material { alpha, ..Material::default() });
        let found = seen(&scene, &Pyramids::new(&scene), Vec2::splat(0.4), 9.0);
        assert!(is_near(found, expected, 2e-3), "{alpha:?}: {found} {expected}");
    }
}

/// One bright texel of 65,536 is not rounded away.
#[test]
fn few_bright_texels_are_kept() {
    let mut texels = vec![[0, 0, 0, 255]; 256 * 256];
    texels[300] = [255; 4];
    let scene = scene(Texture { width: 256, height: 256, texels }, Material::default());
    let part = Part { at: Vec2::splat(0.3), edges: [Vec2::X, Vec2::Y] };
    let pyramids = Pyramids::new(&scene);
    let found = scene.emission_over(&pyramids, &scene.triangles[0], &part);
    assert!((found.x * 65_536.0 - 1.0).abs() < 1e-3, "{found}");
}

/// What is beyond all sense is read as a point, without a panic, and the memory is as said.
#[test]
fn any_part_can_be_asked_for() {
    let scene = scene(random_texture(33, 70), Material::default());
    let pyramids = Pyramids::new(&scene);
    for far in [1e-30, 1e30, f32::MAX, f32::INFINITY, f32::NAN] {
        for wrap in [Wrap::Repeat, Wrap::MirroredRepeat, Wrap::ClampToEdge] {
            let mut scene = scene.clone();
            scene.materials[0].base_color_texture.as_mut().expect("there").wrap = [wrap; 2];
            for at in [Vec2::splat(0.3), Vec2::splat(far)] {
                let found = seen(&scene, &pyramids, at, far);
                assert!(found.is_finite(), "{found}");
            }
        }
    }
    let bytes = pyramids.of[0][0].levels.iter().map(|level| level.texels.len() * 8).sum::<usize>();
    assert!(bytes > 0 && bytes as u64 <= Pyramids::needed_bytes(&scene), "{bytes}");
}

/// A part is as many texels long as it is in the texture, however it lies there; without a texture it is
/// none.
#[test]
fn parts_are_measured_in_texels() {
    let textured = scene(random_texture(64, 16), Material::default());
    let at = Vec2::splat(0.3);
    let cases = [
        ([Vec2::X * 0.125, Vec2::Y * 0.125], 8.0),
        ([Vec2::X * 0.01, Vec2::Y * 0.25], 4.0),
        ([Vec2::Y * 0.25, Vec2::X * 0.01], 4.0),
        ([Vec2::ZERO; 2], 0.0),
    ];
    for (edges, texels) in cases {
        let found = textured.texels_along(&textured.triangles[0], &Part { at, edges });
        assert!((found - texels).abs() < 1e-4, "{edges:?}: {found}");
    }
    let mut plain = scene(random_texture(64, 16), Material::default());
    plain.materials[0] = Material::default();
    let part = Part { at, edges: [Vec2::X, Vec2::Y] };
    assert_eq!(plain.texels_along(&plain.triangles[0], &part), 0.0);
}
