//! The hemicube as a route among the others: the production rasteriser on a scene of polygons.

use super::{Polygon, Route, Unsuitable};
use crate::device::cpu::CpuDevice;
use crate::device::{Device, ShootingSettings};
use crate::hemicube::Shot;
use crate::patches::{PatchIndex, PatchedScene};
use crate::radiometry::Rgb;
use crate::sampling::frame;
use crate::scene::{Material, Scene, Triangle, Vertex};
use glam::Vec2;
use std::sync::Arc;

/// The mean over points of the first polygon of the delta form factors that see the second.
#[derive(Clone, Copy, Debug)]
pub struct Hemicubes {
    /// R, even.
    pub resolution: u32,
    /// Points on the first polygon.
    pub points: u32,
}

impl Route for Hemicubes {
    fn name(&self) -> String {
        format!("{} hemicubes, R = {}", self.points, self.resolution)
    }

    fn form_factor(
        &self,
        from: &Polygon,
        to: &Polygon,
        blockers: &[Polygon],
    ) -> Result<f64, Unsuitable> {
        let mut scene = Scene::default();
        scene.materials.push(Material::lambertian("one side", Rgb::ONE));
        add(&mut scene, from);
        let own = scene.triangles.len();
        add(&mut scene, to);
        let targets = own..scene.triangles.len();
        for blocker in blockers {
            add(&mut scene, blocker);
        }
        let triangles = scene.triangles.len();
        let scene = Arc::new(PatchedScene::new(Arc::new(scene), triangles));
        let failed = |error: crate::device::DeviceError| Unsuitable::Device(error.to_string());
        let mut device = CpuDevice::new(None).map_err(failed)?;
        let settings =
            ShootingSettings { resolution: self.resolution, ..ShootingSettings::default() };
        let mut shooting = device.begin(scene.clone(), &settings).map_err(failed)?;

        let sources =
            |patch: usize| scene.facets[scene.patches.facet[patch] as usize].source as usize;
        let shooters: Vec<usize> = (0..scene.patches.len()).filter(|p| sources(*p) < own).collect();
        let area: f32 = shooters.iter().map(|p| scene.patches.area[*p]).sum();
        let shots: Vec<Shot> = (0..self.points)
            .map(|k| {
                // Systematic over the polygon's patches, spread within each.
                let mut left = (k as f32 + 0.5) / self.points as f32 * area;
                let patch = *shooters
                    .iter()
                    .find(|p| {
                        left -= scene.patches.area[**p];
                        left < 0.0
                    })
                    .unwrap_or(&shooters[0]);
                let xi = (Vec2::new(0.754_877_7, 0.569_840_3) * (k as f32 + 0.5)).fract();
                let normal = scene.patches.normal[patch];
                let (tangent, bitangent) = frame(normal, k as f32);
                let position = scene.point_on_patch(PatchIndex(patch as u32), xi);
                Shot { position, tangent, bitangent, normal, ..Shot::default() }
            })
            .collect();
        let rows = shooting.form_factors(&shots).map_err(failed)?;
        let seen = |row: &Vec<f32>| -> f64 {
            let of_target = row.iter().enumerate().filter(|(p, _)| targets.contains(&sources(*p)));
            of_target.map(|(_, f)| f64::from(*f)).sum()
        };
        Ok(rows.iter().map(seen).sum::<f64>() / f64::from(self.points.max(1)))
    }
}

fn add(scene: &mut Scene, polygon: &Polygon) {
    let normal = polygon.normal().as_vec3();
    for triangle in polygon.triangles() {
        let first = scene.vertices.len() as u32;
        scene.vertices.extend(triangle.map(|corner| Vertex::new(corner.as_vec3(), normal)));
        scene.triangles.push(Triangle { vertices: [first, first + 1, first + 2], material: 0 });
    }
}
