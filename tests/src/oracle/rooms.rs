//! Small scenes of up to about 200 patches whose solution is found densely.

use crate::twins::Builder;
use glam::Vec3;
use hemilux_engine::patches::PatchedScene;
use hemilux_engine::radiometry::Rgb;
use hemilux_engine::scene::Material;
use std::sync::Arc;

const X: Vec3 = Vec3::X;
const Y: Vec3 = Vec3::Y;
const Z: Vec3 = Vec3::Z;

/// A closed room with a coloured wall and a light in the ceiling.
pub fn closed() -> Arc<PatchedScene> {
    let mut builder = Builder::default();
    builder.room(Rgb::new(0.6, 0.1, 0.1));
    builder.cut(150)
}

/// The same with a block that floats.
pub fn with_block() -> Arc<PatchedScene> {
    let mut builder = Builder::default();
    builder.room(Rgb::new(0.1, 0.1, 0.6));
    let white = builder.material(Material::lambertian("white", Rgb::splat(0.75)));
    builder.block(Vec3::new(0.45, 0.4, 0.5), Vec3::new(0.4, 0.3, 0.3), 0.4, white);
    builder.cut(180)
}

/// Five walls of albedo .7 around a cube, the wall at z = 1 missing; a ninth of the ceiling
/// shines.
pub fn open() -> Arc<PatchedScene> {
    let mut builder = Builder::default();
    let grey = builder.material(Material::lambertian("grey", Rgb::splat(0.7)));
    let light = builder.material(Material {
        emission: Rgb::new(10.0, 8.0, 5.0),
        ..Material::lambertian("light", Rgb::splat(0.7))
    });
    builder.grid(Vec3::ZERO, [Z, X], 1, |_, _| grey);
    builder.grid(Y, [X, Z], 3, |i, j| if (i, j) == (1, 1) { light } else { grey });
    builder.grid(Vec3::ZERO, [X, Y], 1, |_, _| grey);
    builder.grid(Vec3::ZERO, [Y, Z], 1, |_, _| grey);
    builder.grid(X, [Z, Y], 1, |_, _| grey);
    builder.cut(150)
}

/// Two rooms that share a doorway in a two-sided wall; the light is in the first.
pub fn two_rooms() -> Arc<PatchedScene> {
    let mut builder = Builder::default();
    let grey = builder.material(Material::lambertian("grey", Rgb::new(0.7, 0.6, 0.5)));
    let screen = builder.material(Material {
        double_sided: true,
        ..Material::lambertian("screen", Rgb::new(0.5, 0.7, 0.5))
    });
    let light = builder.material(Material {
        emission: Rgb::splat(20.0),
        ..Material::lambertian("light", Rgb::splat(0.2))
    });
    let long = 2.0 * X;
    builder.grid(Vec3::ZERO, [Z, long], 1, |_, _| grey);
    builder.grid(Y, [long, Z], 4, |i, j| if (i, j) == (0, 1) { light } else { grey });
    builder.grid(Vec3::ZERO, [long, Y], 1, |_, _| grey);
    builder.grid(Z, [Y, long], 1, |_, _| grey);
    builder.grid(Vec3::ZERO, [Y, Z], 1, |_, _| grey);
    builder.grid(long, [Z, Y], 1, |_, _| grey);
    // The wall at x = 1 leaves z > .6 open.
    builder.grid(X, [Y, 0.6 * Z], 1, |_, _| screen);
    builder.cut(200)
}

/// Three faces of a corner, one patch each: two shine, one does not.
pub fn corner() -> Arc<PatchedScene> {
    let mut builder = Builder::default();
    let face = |builder: &mut Builder, corners, albedo: Rgb, emission: Rgb| {
        let material = Material { emission, ..Material::lambertian("face", albedo) };
        let material = builder.material(material);
        builder.triangle(corners, material);
    };
    let o = Vec3::ZERO;
    face(&mut builder, [o, X, 2.0 * Y], Rgb::new(0.9, 0.5, 0.2), Rgb::new(1.0, 2.0, 3.0));
    face(&mut builder, [o, 2.0 * Y, Z], Rgb::splat(0.6), Rgb::splat(0.5));
    face(&mut builder, [o, Z, X], Rgb::new(0.3, 0.8, 0.8), Rgb::ZERO);
    builder.cut(1)
}
