//! A tree of leaves that are cut out by alpha.

use super::super::glb::{GlbWriter, Maps};
use super::super::mesh::{Mesh, Quad};
use super::super::texture::{hash, png};
use super::parts::{Chance, RealScene, daylight, matte, panel, seen_from};
use crate::radiometry::Rgb;
use crate::scene::{Alpha, Material};
use glam::{Affine3A, Vec2, Vec3};

/// Leaves of the tree as it is measured.
pub const LEAVES: u32 = 100_000;
/// Texels along a side of the leaf's texture.
const SIDE: u32 = 32;
/// Middle of the crown and its half axes, metres.
const MIDDLE: Vec3 = Vec3::new(0.0, 3.3, 0.0);
const REACH: Vec3 = Vec3::new(2.0, 1.6, 2.0);
/// Length and width of a leaf where there are [`LEAVES`], metres.
const LEAF: [f32; 2] = [0.07, 0.04];

/// A tree in the sun on a meadow: quads with a small picture of a leaf, cut out by its alpha, in a
/// crown 4 m wide. Where there are fewer, they are larger, so that they cover as much.
pub fn foliage(leaves: u32, seed: u32) -> RealScene {
    let mut writer = GlbWriter::default();
    let grass = matte(&mut writer, "meadow", [0.2, 0.26, 0.1]);
    let meadow = panel(Vec3::new(-10.0, 0.0, 10.0), 20.0 * Vec3::X, -20.0 * Vec3::Z);
    writer.body("meadow", &Mesh::quads([&meadow]), grass);
    let bark = matte(&mut writer, "bark", [0.25, 0.18, 0.12]);
    writer.body("trunk", &Mesh::drum(0.14, -0.2, 3.0, 0.02, 32), bark);
    let leaf = Material {
        alpha: Alpha::Mask { cutoff: 0.5 },
        double_sided: true,
        ..Material::lambertian("leaf", Rgb::ONE)
    };
    let color = Some(writer.texture(&leaf_picture()));
    let leaf = writer.mapped(&leaf, Maps { color, ..Maps::default() });
    writer.body("crown", &crown(leaves, seed), leaf);
    RealScene {
        name: "foliage".into(),
        why: "100,000 leaves cut out by alpha, in the sun",
        glb: seen_from(writer, [3.6, 1.7, 5.4], [0.0, 2.5, 0.0], 0.85),
        environment: daylight("48.1,11.6,2026-07-15T14:00:00Z"),
    }
}

fn crown(leaves: u32, seed: u32) -> Mesh {
    let mut chance = Chance::new(seed);
    let scale = (LEAVES as f32 / leaves.max(1) as f32).sqrt();
    let [length, width] = LEAF.map(|side| side * scale);
    let mut mesh = Mesh::default();
    for _ in 0..leaves {
        let center = MIDDLE + REACH * chance.in_ball();
        let along = chance.direction();
        let across = along.cross(chance.direction()).normalize_or(along.any_orthonormal_vector());
        let (u, v) = (width * across, length * along);
        let Quad { corners } = panel(center - 0.5 * (u + v), u, v);
        let first = mesh.positions.len() as u32;
        mesh.positions.extend(corners);
        // The stalk is at the lower edge of the picture.
        mesh.uvs.extend([[0.0, 1.0], [1.0, 1.0], [1.0, 0.0], [0.0, 0.0]].map(Vec2::from_array));
        mesh.triangles.push([first, first + 1, first + 2]);
        mesh.triangles.push([first, first + 2, first + 3]);
    }
    // Rounds the coordinates.
    mesh.moved(Affine3A::IDENTITY)
}

/// A green leaf with a lighter rib: two arcs from tip to stalk, all else with alpha 0.
fn leaf_picture() -> Vec<u8> {
    let half = SIDE as i32 / 2;
    let mut texels = Vec::with_capacity((SIDE * SIDE * 4) as usize);
    for y in 0..SIDE as i32 {
        for x in 0..SIDE as i32 {
            let (across, along) = ((2 * x + 1 - 2 * half).abs(), 2 * y + 1 - 2 * half);
            // Half the width, twice over, is a parabola of the place along the leaf.
            let reach = 2 * half * (4 * half * half - along * along) / (4 * half * half);
            let inside = across < reach;
            let tone = 70 + hash(x as u32, y as u32) % 20;
            let green = if across <= 1 { tone + 60 } else { tone + 25 };
            let color = [tone, green, tone / 2].map(|code| code as u8);
            texels.extend(color);
            texels.push(if inside { 255 } else { 0 });
        }
    }
    png(&texels, SIDE, image::ExtendedColorType::Rgba8)
}
