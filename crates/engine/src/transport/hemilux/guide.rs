//! Where gather rays had better go: small patches that reflect much more than most, the inside of
//! a lampshade say, are met by few rays all over the hemisphere. Some rays are aimed at them.

use super::light_tree::{Glow, LightTree};
use super::links::{Links, PatchPoints};
use crate::patches::PatchedScene;
use crate::transport::ray_traced::surface::World;
use glam::Vec3;
use std::collections::HashMap;

/// A patch is bright that reflects so many times as much as all do on average.
const BRIGHT: f32 = 8.0;
/// Share of all reflected power that bright patches must have to be worth aiming at.
const WORTH: f32 = 0.06;

/// Farther than so many radii of a patch it is not met by many rays.
const APART: f32 = 4.0;

/// The bright patches.
pub struct Guide {
    tree: LightTree,
    patches: Vec<u32>,
    /// Which of them a patch is.
    number: HashMap<u32, u32>,
    /// One over their areas, ray units.
    per_area: Vec<f32>,
    points: Vec<PatchPoints>,
}

/// A direction towards a bright patch.
pub struct Aim {
    /// Unit vector.
    pub direction: Vec3,
    /// The patch.
    pub patch: u32,
}

impl Guide {
    /// Of the patches' radiosities and albedos, each as one number; `None` where none is worth
    /// aiming at.
    pub fn new(
        world: &World,
        scene: &PatchedScene,
        links: &Links,
        radiosity: &[f32],
        albedo: &[f32],
    ) -> Option<Self> {
        let area = &scene.patches.area;
        let all: f32 = area.iter().sum();
        let power: f32 = area.iter().zip(radiosity).map(|(area, own)| area * own).sum();
        let limit = BRIGHT * power / all;
        let bright = |patch: &u32| radiosity[*patch as usize] > limit;
        let mut patches: Vec<u32> = (0..area.len() as u32).filter(bright).collect();
        let own = |patch: &u32| area[*patch as usize] * radiosity[*patch as usize];
        if patches.iter().map(own).sum::<f32>() <= WORTH * power {
            return None;
        }
        // What others get of it, by the links: the gap between a lamp and the ceiling may be as
        // bright as it will, and what is near is met without being aimed at.
        let mut received = vec![0.0; area.len()];
        for patch in 0..area.len() as u32 {
            let index = patch as usize;
            let met = links.of(index).filter(|link| radiosity.get(*link as usize) > Some(&limit));
            let met: Vec<u32> = met.collect();
            if met.is_empty() || albedo[index] <= 0.0 {
                continue;
            }
            let each = area[index] / links.of(index).count() as f32;
            let (from, _) = PatchPoints::new(world, scene, patch).ball();
            for link in met {
                let (center, radius) = PatchPoints::new(world, scene, link).ball();
                if from.distance(center) > APART * radius {
                    received[link as usize] += each * radiosity[link as usize];
                }
            }
        }
        patches.retain(|patch| received[*patch as usize] > 0.0);
        let theirs: f32 = patches.iter().map(|patch| received[*patch as usize].min(own(patch))).sum();
        if theirs.is_nan() || theirs <= WORTH * power {
            return None;
        }
        let points: Vec<PatchPoints> =
            patches.iter().map(|patch| PatchPoints::new(world, scene, *patch)).collect();
        let glow = |(points, patch): (&PatchPoints, &u32)| {
            let (center, radius) = points.ball();
            Glow {
                center,
                radius,
                power: received[*patch as usize].min(own(patch)),
                normal: points.normal(),
                two_sided: false,
            }
        };
        let glows: Vec<Glow> = points.iter().zip(&patches).map(glow).collect();
        Some(Self {
            tree: LightTree::new(&glows),
            number: patches.iter().copied().zip(0..).collect(),
            per_area: points.iter().map(|points| 1.0 / points.area()).collect(),
            patches,
            points,
        })
    }

    /// Aims from a surface at `point` with unit `normal`, by three uniform numbers; `None` where
    /// that has missed.
    pub fn aim(&self, point: Vec3, normal: Vec3, xi: Vec3) -> Option<Aim> {
        let (pick, _) = self.tree.pick(point, normal, xi.x)?;
        let direction = (self.points[pick].point([xi.y, xi.z]).0 - point).normalize_or_zero();
        let above = normal.dot(direction) > 0.0;
        above.then_some(Aim { direction, patch: self.patches[pick] })
    }

    /// Density per solid angle at which [`Guide::aim`] picks a place of a patch, `distance` away,
    /// where the ray to it makes an angle with that `cosine` to the patch's normal; zero for those
    /// that are not bright.
    pub fn density(
        &self,
        point: Vec3,
        normal: Vec3,
        patch: u32,
        distance: f32,
        cosine: f32,
    ) -> f32 {
        let Some(number) = self.number.get(&patch) else { return 0.0 };
        let number = *number as usize;
        let probability = self.tree.probability(number, point, normal);
        probability * distance * distance * self.per_area[number] / cosine.abs().max(1e-6)
    }
}
