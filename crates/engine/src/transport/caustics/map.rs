//! The illumination map (Arvo 1986): what lands on diffuse surfaces, spread over the grid points
//! around it and divided by the area that each stands for.

use super::charts::Charts;
use crate::checkpoint::{CheckpointError, Reader, Writer};
use crate::radiometry::Rgb;
use crate::surface::Surface;
use crate::transport::ray_traced::{Caustics, Mapped};
use glam::DVec3;
use rayon::prelude::*;

/// More than any run comes to.
const MOST_SHOWERS: u64 = 1 << 40;

/// Power that landed at a point of a surface.
#[derive(Clone, Copy, Debug)]
pub struct PowerDeposit {
    /// Index into [`crate::scene::Scene::triangles`].
    pub triangle: u32,
    /// Which side.
    pub back: bool,
    /// Barycentric (u, v).
    pub at: [f32; 2],
    /// W.
    pub power: Rgb,
}

/// The map: light of all showers so far, in two independent halves, so that their difference tells
/// how far off their mean may be.
pub struct Map {
    charts: Charts,
    /// Sums of power, W, by halves of the showers.
    power: [Vec<Rgb>; 2],
    showers: [u64; 2],
    /// What is read: mean over the showers.
    read: Vec<Mapped>,
    /// Power of all that landed, W: in showers that ended, and in the one under way.
    landed: [DVec3; 2],
}

/// Mean power of the showers in a map.
#[derive(Clone, Copy, Debug)]
pub struct Flux {
    /// Of all that landed, W.
    pub landed: DVec3,
    /// ΣE·A over the map, W.
    pub mapped: DVec3,
}

impl Map {
    /// A map without light.
    pub fn new(charts: Charts) -> Self {
        let dark = vec![Rgb::ZERO; charts.len()];
        Self {
            power: [dark.clone(), dark],
            showers: [0; 2],
            read: vec![Mapped::default(); charts.len()],
            landed: [DVec3::ZERO; 2],
            charts,
        }
    }

    /// Number of values.
    pub fn len(&self) -> usize {
        self.read.len()
    }

    /// Adds light to the shower that is under way.
    pub fn deposit(&mut self, deposits: &[PowerDeposit]) {
        let half = &mut self.power[self.half()];
        for PowerDeposit { triangle, back, at, power } in deposits {
            let Some(shares) = self.charts.shares(*triangle, *back, *at) else { continue };
            for (value, share) in shares {
                half[value as usize] += *power * share;
            }
            self.landed[1] += power.as_dvec3();
        }
    }

    /// Writes it.
    pub fn save(&self, to: &mut Writer) {
        to.value(self.showers);
        to.value(self.landed);
        for half in &self.power {
            to.slice(half);
        }
        // In the middle of a shower there is power that is not to be read yet.
        let under_way = self.landed[1] != DVec3::ZERO;
        to.slice(if under_way { &self.read[..] } else { &[] });
    }

    /// Takes what [`Map::save`] wrote of the same charts.
    pub fn restore(&mut self, from: &mut Reader<'_>) -> Result<(), CheckpointError> {
        self.showers = from.value()?;
        self.landed = from.value()?;
        for half in &mut self.power {
            from.replace(half)?;
        }
        if self.showers[1] > self.showers[0] || self.showers[0] > MOST_SHOWERS {
            return Err(CheckpointError::damaged("there can't be that many showers"));
        }
        let read: Vec<Mapped> = from.slice()?;
        if read.len() == self.read.len() {
            self.read = read;
        } else if !read.is_empty() {
            return Err(CheckpointError::damaged("its map is not of this scene"));
        } else if self.showers() > 0 {
            self.average();
        }
        Ok(())
    }

    /// Ends a shower: from now on, its light is in what is read.
    pub fn finish_shower(&mut self) {
        let half = self.half();
        self.charts.gather(&mut self.power[half]);
        self.showers[half] += 1;
        self.landed = [self.landed[0] + self.landed[1], DVec3::ZERO];
        self.average();
    }

    /// Makes the showers what is read.
    fn average(&mut self) {
        let [first, second] = self.showers.map(|count| count as f32);
        let count = first + second;
        // The means A/a and B/b of the halves differ by σ²(1/a + 1/b), their mean by σ²/(a + b)
        // from the truth.
        let [by_first, by_second] = match second > 0.0 {
            true => [(second / first).sqrt(), -(first / second).sqrt()],
            false => [0.0; 2],
        };
        let [first, second] = &self.power;
        self.read
            .par_iter_mut()
            .zip(self.charts.areas())
            .zip(first.par_iter().zip(second))
            .filter(|((_, area), _)| **area > 0.0)
            .for_each(|((read, area), (first, second))| {
                let share = 1.0 / (*area * count);
                read.irradiance = (*first + *second) * share;
                read.scatter = (*first * by_first + *second * by_second) * share;
            });
        self.charts.spread(&mut self.read);
    }

    /// What landed in a shower, and what the map says that there is.
    pub fn flux(&self) -> Flux {
        let values = self.read.iter().zip(self.charts.areas());
        let mapped = values.map(|(read, area)| read.irradiance.as_dvec3() * f64::from(*area)).sum();
        Flux { landed: self.landed[0] / self.showers().max(1) as f64, mapped }
    }

    /// Showers in what is read.
    pub fn showers(&self) -> u64 {
        self.showers[0] + self.showers[1]
    }

    /// The half that the next shower goes to.
    fn half(&self) -> usize {
        usize::from(self.showers[1] < self.showers[0])
    }
}

impl Caustics for Map {
    fn irradiance(&self, surface: &Surface) -> Mapped {
        self.at(surface.triangle, surface.back, surface.at)
    }
}

impl Map {
    /// What it says of a side of a triangle at barycentric (u, v).
    pub fn at(&self, triangle: u32, back: bool, at: [f32; 2]) -> Mapped {
        let Some(shares) = self.charts.shares(triangle, back, at) else {
            return Mapped::default();
        };
        let mut sum = Mapped::default();
        for (value, share) in shares {
            sum = sum + self.read[value as usize] * share;
        }
        sum
    }
}

impl std::ops::Add for Mapped {
    type Output = Self;

    fn add(self, other: Self) -> Self {
        Self {
            irradiance: self.irradiance + other.irradiance,
            scatter: self.scatter + other.scatter,
        }
    }
}

impl std::ops::Mul<f32> for Mapped {
    type Output = Self;

    fn mul(self, factor: f32) -> Self {
        Self { irradiance: self.irradiance * factor, scatter: self.scatter * factor }
    }
}
