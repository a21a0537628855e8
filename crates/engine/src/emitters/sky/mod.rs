//! The sky as a light: directions by what they give to a surface of a certain normal, and what all
//! of them give together.
//!
//! A direction is drawn in three steps: a coarse cell of the sky by its light times about its cosine
//! to the normal (tabulated for groups of similar normals), a fine cell in it by its light, and a
//! direction in that, uniform in solid angle. The first step is what makes the product of light and
//! cosine come out, the second finds a sun that is painted into a map.

mod cells;
mod cube;
mod grid;
mod irradiance;
mod normals;
mod picks;

use crate::radiometry::Rgb;
use crate::scene::environment::{Environment, Sky, turned};
use crate::scene::sky_map::SkyMap;
use cells::{COLUMNS, Cells, MOST_COLUMNS, MOST_ROWS};
use glam::Vec3;
use irradiance::Irradiance;
use normals::Normals;

/// The sky of an environment as a light.
pub struct SkyLight {
    /// What shines, its sun left out.
    environment: Environment,
    /// How far the tables are turned about +Y, radians.
    rotation: f32,
    cells: Cells,
    normals: Normals,
    irradiance: Irradiance,
}

impl SkyLight {
    /// The tables for an environment's sky; `None` where it is dark. For a map of 256 × 128 it takes
    /// about 60 ms of one core.
    pub fn new(environment: &Environment) -> Option<Self> {
        let environment = Environment { sky: environment.sky.clone(), ..Environment::default() };
        if environment.is_dark() {
            return None;
        }
        let uniform;
        let (map, scale, rotation) = match &environment.sky {
            Sky::None => return None,
            Sky::Uniform(radiance) => {
                uniform = SkyMap::new(1, 1, vec![Rgb::ONE]).ok()?;
                (&uniform, *radiance, 0.0)
            }
            Sky::Map(placed) => (&*placed.map, placed.scale, placed.rotation),
        };
        let (cells, moments) = Cells::new(map, scale);
        let normals = Normals::new(&cells);
        let irradiance = Irradiance::new(&cells, moments);
        Some(Self { environment, rotation, cells, normals, irradiance })
    }

    /// Most bytes that the tables of an environment's sky take.
    pub fn needed_bytes(environment: &Environment) -> u64 {
        let [width, height] = match &environment.sky {
            Sky::None => return 0,
            Sky::Uniform(_) => [1, 1],
            Sky::Map(placed) => [placed.map.width(), placed.map.height()].map(|x| x as usize),
        };
        let columns = (2 * cells::PARTS[0]).max(width.min(MOST_COLUMNS));
        let rows = (2 * cells::PARTS[1]).max(height.min(MOST_ROWS));
        let sums = (columns * rows + COLUMNS * rows + COLUMNS * cells::ROWS) * size_of::<f32>();
        (sums + normals::BYTES + irradiance::BYTES) as u64
    }

    /// Radiance from a unit direction.
    pub fn radiance(&self, direction: Vec3) -> Rgb {
        self.environment.radiance(direction)
    }

    /// A unit direction for a surface with a unit normal, and its density, 1/sr: about in proportion
    /// to luminance × max(cosθ, 0), above zero wherever that is. Some directions are a little below
    /// the horizon and give nothing. The density is 0 where no direction gives anything.
    pub fn sample(&self, normal: Vec3, xi: [f32; 2]) -> (Vec3, f32) {
        let turned_normal = turned(normal, -self.rotation);
        let Some((coarse, rest)) = self.normals.pick(turned_normal, xi) else {
            return (normal, 0.0);
        };
        let (direction, place) = self.cells.sample(coarse, rest);
        let density = self.normals.probability(turned_normal, coarse) * self.cells.density(place);
        let placed = turned(direction, self.rotation);
        if self.cells.place(turned(placed, -self.rotation)) == place {
            return (placed, density);
        }
        // Rounding took it over the cell's edge.
        (turned(self.cells.middle(place), self.rotation), density)
    }

    /// Density of [`SkyLight::sample`], 1/sr, for a unit direction.
    pub fn pdf(&self, normal: Vec3, direction: Vec3) -> f32 {
        let [normal, direction] = [normal, direction].map(|v| turned(v, -self.rotation));
        let place = self.cells.place(direction);
        self.normals.probability(normal, self.cells.coarse(place)) * self.cells.density(place)
    }

    /// Irradiance of a surface with a unit normal without occluders, ∫ L max(cosθ, 0) dω.
    pub fn unoccluded(&self, normal: Vec3) -> Rgb {
        self.irradiance.at(turned(normal, -self.rotation))
    }

    /// Bytes that the tables take.
    #[cfg(test)]
    pub fn bytes(&self) -> u64 {
        (self.cells.bytes() + normals::BYTES + self.irradiance.bytes()) as u64
    }
}

#[cfg(test)]
mod tests;
