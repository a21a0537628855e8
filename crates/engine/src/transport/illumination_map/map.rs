//! The illumination map (Arvo 1986): what lands on diffuse surfaces, spread over the grid points
//! around it and divided by the area that each stands for.

use super::charts::Charts;
use crate::radiometry::Rgb;
use crate::transport::ray_traced::{Caustics, Surface};
use glam::DVec3;
use std::sync::Arc;

/// Power that landed at a point of a surface.
#[derive(Clone, Copy, Debug)]
pub struct Landing {
    /// Index into [`crate::scene::Scene::triangles`].
    pub triangle: u32,
    /// Which side.
    pub back: bool,
    /// Barycentric (u, v).
    pub at: [f32; 2],
    /// W.
    pub power: Rgb,
}

/// The map.
pub struct Map {
    charts: Arc<Charts>,
    /// W while light is shot, then W/m².
    values: Vec<Rgb>,
}

/// What is in a map.
#[derive(Clone, Copy, Debug, Default)]
pub struct Flux {
    /// Power of all that landed, W.
    pub landed: DVec3,
    /// ΣE·A over the map, W.
    pub mapped: DVec3,
}

impl Map {
    /// A map without light.
    pub fn new(charts: Arc<Charts>) -> Self {
        Self { values: vec![Rgb::ZERO; charts.len()], charts }
    }

    /// Number of values.
    pub fn len(&self) -> usize {
        self.values.len()
    }

    /// Forgets everything, for new light.
    pub fn clear(&mut self) {
        self.values.fill(Rgb::ZERO);
    }

    /// Adds light; its power.
    pub fn deposit(&mut self, landings: &[Landing]) -> DVec3 {
        let mut landed = DVec3::ZERO;
        for Landing { triangle, back, at, power } in landings {
            let Some(shares) = self.charts.shares(*triangle, *back, *at) else { continue };
            for (value, share) in shares {
                self.values[value as usize] += *power * share;
            }
            landed += power.as_dvec3();
        }
        landed
    }

    /// Turns power into irradiance; ΣE·A.
    pub fn finish(&mut self) -> DVec3 {
        self.charts.gather(&mut self.values);
        let mut mapped = DVec3::ZERO;
        for (value, area) in self.values.iter_mut().zip(self.charts.areas()) {
            if *area > 0.0 {
                *value /= *area;
                mapped += value.as_dvec3() * f64::from(*area);
            }
        }
        self.charts.spread(&mut self.values);
        mapped
    }
}

impl Caustics for Map {
    fn irradiance(&self, surface: &Surface) -> Rgb {
        let shares = self.charts.shares(surface.triangle, surface.back, surface.at);
        shares.map_or(Rgb::ZERO, |shares| {
            shares.iter().map(|(value, share)| self.values[*value as usize] * *share).sum()
        })
    }
}

impl std::ops::AddAssign for Flux {
    fn add_assign(&mut self, other: Self) {
        self.landed += other.landed;
        self.mapped += other.mapped;
    }
}
