//! Cells against sums over texels in double precision.

use super::*;
use crate::random::{Stream, bits};
use crate::scene::{Encoding, Material, Scene, Texture, TextureSlot, Triangle, Vertex, Wrap};
use glam::{DVec3, Vec3};
use std::sync::Arc;

const LIMITS: CellLimits = CellLimits { most: 256, least_difference: 1e-3, fine: 0.5, dim: 1e-4 };

fn cells_of(scene: &Scene, limits: CellLimits) -> EmissionCells {
    EmissionCells::new(&World::new(Arc::new(scene.clone())), limits)
}

/// Rectangles of two triangles in a row, each showing all of the texture, of one side.
fn screens(count: u32, texture: Texture, slot: TextureSlot) -> Scene {
    let mut scene = Scene {
        materials: vec![Material {
            emission: Rgb::new(3.0, 2.0, 1.0),
            emission_texture: Some(slot),
            ..Material::default()
        }],
        textures: vec![texture],
        ..Scene::default()
    };
    for screen in 0..count {
        let first = scene.vertices.len() as u32;
        for uv in [Vec2::ZERO, Vec2::X, Vec2::ONE, Vec2::Y] {
            let position = Vec3::new(uv.x + 1.5 * screen as f32, uv.y, 0.0);
            scene.vertices.push(Vertex { uv: [uv; 2], ..Vertex::new(position, Vec3::Z) });
        }
        for vertices in [[first, first + 1, first + 2], [first, first + 2, first + 3]] {
            scene.triangles.push(Triangle { vertices, material: 0 });
        }
    }
    scene
}

/// A pattern of random texels, of which one in eight is bright if `sparse`, else one in two.
fn pattern(side: u32, sparse: bool) -> Texture {
    let texel = |at: u32| {
        let random = bits(11, Stream::Path, at.into());
        let [red, green, blue, _] = random.to_le_bytes();
        let lit = random >> 24 & if sparse { 7 } else { 1 } == 0;
        if lit { [red, green, blue, 255] } else { [0, 0, 0, 255] }
    };
    Texture { width: side, height: side, texels: (0..side * side).map(texel).collect() }
}

/// Σ radiance × area of the cells, in m².
fn power(scene: &Scene, cells: &EmissionCells) -> DVec3 {
    let area = |triangle: u32| {
        let [a, b, c] = scene.corners(&scene.triangles[triangle as usize]).map(|p| p.as_dvec3());
        0.5 * (b - a).cross(c - a).length()
    };
    let of = |cell: &EmissionCell| {
        cell.radiance.as_dvec3() * f64::from(cell.share) * area(cell.triangle)
    };
    cells.cells.iter().map(of).sum()
}

fn exact(scene: &Scene) -> DVec3 {
    let texture = &scene.textures[0];
    let sum: DVec3 = texture
        .texels
        .iter()
        .map(|texel| Encoding::Srgb.decode(*texel).truncate().as_dvec3())
        .sum();
    let mean = sum / texture.texels.len() as f64;
    mean * scene.materials[0].emission.as_dvec3() * (scene.triangles.len() / 2) as f64
}

fn off(found: DVec3, expected: DVec3) -> f64 {
    (found / expected - 1.0).abs().max_element()
}

/// The power of all cells is that of all texels to a thousandth, as coarsely or finely as they are
/// divided; a sample in the middle of each triangle is far off.
#[test]
fn cells_emit_what_their_texels_emit() {
    for (side, sparse, nearest) in [
        (64, false, false),
        (64, false, true),
        (61, false, false),
        (64, true, true),
        (256, true, false),
    ] {
        let slot = TextureSlot { nearest, wrap: [Wrap::Repeat; 2], ..TextureSlot::plain(0) };
        let scene = screens(9, pattern(side, sparse), slot);
        let expected = exact(&scene);
        for most in [18, 256, 20_000] {
            let limits = CellLimits { most, least_difference: 1e-6, dim: 0.0, ..LIMITS };
            let cells = cells_of(&scene, limits);
            let found = power(&scene, &cells);
            let error = off(found, expected);
            println!("{side} {sparse} {nearest}, {} cells: {error:.5}", cells.cells.len());
            assert!(error < 1e-3, "{found} {expected}");
            assert!(cells.cells.len() <= most);
        }
        let middle = |triangle: &Triangle| scene.emission(triangle, 1.0 / 3.0, 1.0 / 3.0);
        let samples: DVec3 = scene.triangles.iter().map(|t| middle(t).as_dvec3() * 0.5).sum();
        assert!(off(samples, expected) > 0.02, "{samples} {expected}");
    }
}

/// Where a place is found, the cell contains it, and its radiance is the mean of what is there.
#[test]
fn places_are_found_in_their_cells() {
    let scene = screens(1, pattern(16, false), TextureSlot::plain(0));
    let limits = CellLimits { most: 2000, least_difference: 0.0, fine: 1.0, dim: 0.0 };
    let cells = cells_of(&scene, limits);
    assert!(cells.cells.len() > 500);
    let mut sums = vec![(Rgb::ZERO, 0.0); cells.cells.len()];
    const SIDE: u32 = 256;
    for (triangle, [x, y]) in
        (0..2u32).flat_map(|t| (0..SIDE * SIDE).map(move |k| (t, [k % SIDE, k / SIDE])))
    {
        let [u, v] = [x, y].map(|k| (k as f32 + 0.4) / SIDE as f32);
        if u + v > 1.0 {
            continue;
        }
        let value = scene.emission(&scene.triangles[triangle as usize], u, v);
        let Some(cell) = cells.find(triangle, [u, v]) else {
            assert!(value.max_element() < 1e-6, "{value} in the dark");
            continue;
        };
        let EmissionCell { triangle: own, corners: [a, b, c], .. } = cells.cells[cell];
        assert_eq!(own, triangle);
        let turn = |p: Vec2, q: Vec2| (q - p).perp_dot(Vec2::new(u, v) - p);
        assert!(turn(a, b).min(turn(b, c)).min(turn(c, a)) > -1e-6);
        sums[cell].0 += value;
        sums[cell].1 += 1.0;
    }
    for (cell, (sum, count)) in cells.cells.iter().zip(sums) {
        let error = (sum / count - cell.radiance).abs().max_element();
        assert!(error < 0.2 * 3.0, "{error} of {} {count}", cell.radiance);
    }
}

/// One bright corner of an otherwise black texture: a handful of cells, all of them there.
#[test]
fn black_is_free_and_evenness_is_one_cell() {
    let mut texels = vec![[0, 0, 0, 255]; 128 * 128];
    (0..16).for_each(|y| texels[y * 128..][..16].fill([255; 4]));
    let corner = Texture { width: 128, height: 128, texels };
    let slot = TextureSlot { wrap: [Wrap::ClampToEdge; 2], ..TextureSlot::plain(0) };
    let scene = screens(1, corner, slot);
    let cells = cells_of(&scene, LIMITS);
    println!("{} cells", cells.cells.len());
    assert!(cells.cells.len() < 100 && off(power(&scene, &cells), exact(&scene)) < 1e-3);
    let inside = |corner: &Vec2, cell: &EmissionCell| {
        let uv = [Vec2::ZERO, Vec2::X, Vec2::ONE, Vec2::Y];
        let [_, b, c] = [0, 1, 2].map(|k| uv[if cell.triangle == 0 { k } else { [0, 2, 3][k] }]);
        (b * corner.x + c * corner.y).max_element() <= 32.0 / 128.0
    };
    assert!(cells.cells.iter().all(|cell| cell.corners.iter().all(|at| inside(at, cell))));
    let even = screens(9, Texture { width: 4, height: 4, texels: vec![[200; 4]; 16] }, slot);
    let cells = cells_of(&even, LIMITS);
    assert!(cells.cells.len() == 18 && cells.cells.iter().all(|cell| cell.is_even));
    let black = screens(9, Texture { width: 4, height: 4, texels: vec![[0; 4]; 16] }, slot);
    assert!(cells_of(&black, LIMITS).cells.is_empty());
}

/// Triangles that hardly shine are no lights where others do.
#[test]
fn the_dimmest_are_left_out() {
    let mut scene = screens(3, pattern(32, false), TextureSlot::plain(0));
    let dim = Material { emission: Rgb::splat(1e-5), ..scene.materials[0].clone() };
    scene.materials.push(dim);
    scene.triangles[2].material = 1;
    let cells = cells_of(&scene, LIMITS);
    assert!(cells.find(2, [0.3, 0.3]).is_none());
    assert!(cells.cells.iter().all(|cell| cell.triangle != 2));
    let kept = cells_of(&scene, CellLimits { dim: 0.0, ..LIMITS });
    assert!(kept.cells.iter().any(|cell| cell.triangle == 2));
}
