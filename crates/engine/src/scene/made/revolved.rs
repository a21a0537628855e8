//! Surfaces of revolution for tests.

use crate::scene::{Material, Scene, Triangle, Vertex};
use glam::Vec3;
use std::f32::consts::{PI, TAU};

/// A surface of revolution about the y axis: a profile of radii and heights, whose right side is the
/// front, in so many slices.
pub fn revolved(profile: &[[f32; 2]], slices: u32, material: Material) -> Scene {
    let mut scene = Scene { materials: vec![material], ..Scene::default() };
    for [radius, height] in profile {
        for slice in 0..slices {
            let (sin, cos) = (TAU * slice as f32 / slices as f32).sin_cos();
            let at = Vec3::new(radius * cos, *height, radius * sin);
            scene.vertices.push(Vertex::new(at, at.with_y(0.0).normalize_or(Vec3::Y)));
        }
    }
    for ring in 0..profile.len() as u32 - 1 {
        for slice in 0..slices {
            let [a, b] = [slice, (slice + 1) % slices].map(|column| ring * slices + column);
            let [c, d] = [a + slices, b + slices];
            let both = [[a, c, b], [b, c, d]].map(|vertices| Triangle { vertices, material: 0 });
            scene.triangles.extend(both);
        }
    }
    scene
}

/// A closed ball of radius 1 in so many slices and half as many rings, whose inside is the front.
pub fn hollow_ball(slices: u32, material: Material) -> Scene {
    let rings = slices / 2;
    let place = |ring: u32| (PI * ring as f32 / rings as f32).sin_cos().into();
    let profile: Vec<[f32; 2]> = (0..=rings).map(place).collect();
    let mut ball = revolved(&profile, slices, material);
    for vertex in &mut ball.vertices {
        vertex.normal = -vertex.position.normalize();
    }
    ball
}

/// The same whose outside is the front.
pub fn ball(slices: u32, material: Material) -> Scene {
    let mut ball = hollow_ball(slices, material);
    for vertex in &mut ball.vertices {
        vertex.normal = -vertex.normal;
    }
    for triangle in &mut ball.triangles {
        triangle.vertices.swap(1, 2);
    }
    ball
}
