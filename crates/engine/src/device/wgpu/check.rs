//! Whether an adapter draws hemicubes right, found when it is opened.
//!
//! Drivers differ in what they do with triangles that go on behind the eye, as walls beside a
//! shooter do, and one that loses such triangles loses their light: pictures come out too dark
//! with nothing else to tell. In a closed room every pixel of a hemicube sees a wall and form
//! factors sum to 1, whatever the room; so a few shots in one show whether anything is lost.

use crate::device::{ShootingSettings, ShotTrace};
use crate::hemicube::{Shot, item};
use crate::patches::PatchedScene;
use crate::sampling::frame;
use crate::scene::{Material, Scene, Triangle, Vertex};
use glam::{Vec2, Vec3};
use std::sync::Arc;

/// R of the shots.
const RESOLUTION: u32 = 64;
/// Share of the pixels that may see nothing, between two walls by rounding.
const EMPTY: f64 = 1e-3;
/// How far the sum of form factors may be from 1.
const LOST: f64 = 2e-3;

/// Settings of the shots of [`shots`].
pub fn settings() -> ShootingSettings {
    ShootingSettings {
        resolution: RESOLUTION,
        shots_per_iteration: 6,
        ..ShootingSettings::default()
    }
}

/// The cube around (0, 0, 0) … (1, 1, 1) seen from inside, two triangles a wall. Its walls stand
/// exactly on the planes of the shooters' hemicubes, where a driver has most to go wrong.
pub fn room() -> Arc<PatchedScene> {
    let (x, y, z) = (Vec3::X, Vec3::Y, Vec3::Z);
    let walls = [
        (Vec3::ZERO, z, x),
        (y, x, z),
        (Vec3::ZERO, x, y),
        (z, y, x),
        (Vec3::ZERO, y, z),
        (x, z, y),
    ];
    let mut scene = Scene { materials: vec![Material::default()], ..Scene::default() };
    for (origin, a, b) in walls {
        let first = scene.vertices.len() as u32;
        let corners = [origin, origin + a, origin + a + b, origin + b];
        let normal = a.cross(b);
        scene.vertices.extend(corners.map(|position| Vertex::new(position, normal)));
        for [p, q, r] in [[0, 1, 2], [0, 2, 3]] {
            let vertices = [first + p, first + q, first + r];
            scene.triangles.push(Triangle { vertices, material: 0 });
        }
    }
    Arc::new(PatchedScene::new(Arc::new(scene), 12))
}

/// A shot from each wall, near its middle and near its edges, turned in different ways.
pub fn shots() -> Vec<Shot> {
    let inward = [Vec3::X, Vec3::Y, Vec3::Z, Vec3::NEG_X, Vec3::NEG_Y, Vec3::NEG_Z];
    let shot = |(normal, k): (Vec3, f32)| {
        // The plane that looks inward along −x, −y or −z lies at 1.
        let wall = Vec3::select(normal.cmplt(Vec3::ZERO), Vec3::ONE, Vec3::ZERO);
        let across = Vec3::new(0.5, 0.03 + 0.15 * k, 0.97 - 0.13 * k);
        let position = Vec3::select(normal.cmpeq(Vec3::ZERO), across, wall);
        let (tangent, bitangent) = frame(normal, 0.9 * k);
        let jitter = Vec2::splat(0.15 * k - 0.4);
        Shot { position, tangent, bitangent, normal, jitter, ..Shot::default() }
    };
    inward.into_iter().zip((0..6).map(|k: u8| f32::from(k))).map(shot).collect()
}

/// Says what is lost in traces of [`shots`] in [`room`].
///
/// # Errors
/// A sentence with the shares of pixels and of light that are lacking.
pub fn judge(traces: &[ShotTrace]) -> Result<(), String> {
    for (index, trace) in traces.iter().enumerate() {
        let empty = trace.items.iter().filter(|code| **code == item::EMPTY).count();
        let empty = empty as f64 / trace.items.len() as f64;
        let sum: f64 = trace.form_factor.iter().map(|share| f64::from(*share)).sum();
        if !(empty <= EMPTY && (sum - 1.0).abs() <= LOST) {
            return Err(format!(
                "it draws hemicubes wrong: in a closed room, {:.1} % of the pixels of shot {index} \
                 see nothing, and its form factors sum to {sum:.4} instead of 1; use the device \
                 `cpu`, or another driver",
                100.0 * empty
            ));
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::device::Device;
    use crate::device::cpu::CpuDevice;

    #[test]
    fn the_check_passes_what_is_right_and_sees_lost_triangles() {
        let mut cpu = CpuDevice::new(None).expect("threads");
        let mut shooting = cpu.begin(room(), &settings()).expect("begins");
        assert_eq!(judge(&shooting.trace(&shots()).expect("traces")), Ok(()));

        // Of the wall that a pixel in the middle sees, every item is lost.
        let mut traces = shooting.trace(&shots()).expect("traces");
        let lost = traces[3].items[traces[3].items.len() / 6];
        assert_ne!(lost, item::EMPTY);
        traces[3].items.iter_mut().filter(|code| **code == lost).for_each(|code| *code = 0);
        assert!(judge(&traces).expect_err("a wall is lost").contains("shot 3"));

        // Half a per cent of the light is lost.
        let mut traces = shooting.trace(&shots()).expect("traces");
        traces[5].form_factor.iter_mut().for_each(|share| *share *= 0.995);
        assert!(judge(&traces).expect_err("light is lost").contains("0.995"));
    }
}
