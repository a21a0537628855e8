//! Daylight: the sun and the clear sky as light sources, from the sun's direction alone.
//!
//! [`PlaceAndTime`] is read from `LAT,LON,TIME`, [`sun_position()`] gives the sun's direction there,
//! [`daylight`] the light. All light is photometric: lux and cd/m² folded into linear Rec. 709 RGB,
//! so that a white of luminance Y has R = G = B = Y.

mod atmosphere;
mod columns;
mod multiple_scattering;
mod place_and_time;
mod sky;
mod spectrum;
mod sun_position;

pub use place_and_time::PlaceAndTime;
pub use sun_position::{SunPosition, sun_position};

use crate::radiometry::Rgb;
use atmosphere::{Atmosphere, GROUND_ALBEDO, GROUND_RADIUS};
use columns::Columns;
use glam::Vec3;
use multiple_scattering::MultipleScattering;
use sky::SkyModel;
use spectrum::{Sunlight, into_gamut};
use std::f64::consts::{FRAC_PI_2, PI, TAU};

/// Texels of a sky map around the horizon.
pub const SKY_WIDTH: usize = 256;
/// Texels of a sky map from straight up to straight down; even, so that the horizon is an edge.
pub const SKY_HEIGHT: usize = 128;

/// The light of the sun and of a clear sky at the ground.
#[derive(Clone, Debug, PartialEq)]
pub struct Daylight {
    /// Unit direction towards the sun; +Y up.
    pub sun_direction: Vec3,
    /// Illuminance in lux by the sun on a plane that faces it, on the ground, at the Earth's mean
    /// distance (3.4 % more in January, less in July). Fades while the disc sets, 0 when it is
    /// down.
    pub sun_irradiance: Rgb,
    /// The sky without the sun's disc, and the ground.
    pub sky: SkyMap,
}

/// Radiance from all directions, in cd/m².
///
/// A texel's value is that at its centre. Column: (atan2(z, x)/2π + ½)·width; the first row is
/// straight up, the last straight down. The lower half is a diffuse ground of albedo .3.
#[derive(Clone, Debug, PartialEq)]
pub struct SkyMap {
    /// Number of columns.
    pub width: usize,
    /// Number of rows.
    pub height: usize,
    /// Row by row from straight up.
    pub texels: Vec<Rgb>,
}

impl SkyMap {
    /// Unit direction of a texel's centre.
    pub fn direction(&self, row: usize, column: usize) -> Vec3 {
        let azimuth = ((column as f64 + 0.5) / self.width as f64 - 0.5) * TAU;
        sky::direction(elevation(row, self.height), azimuth).as_vec3()
    }

    /// Illuminance in lux by the upper half of the map on the level ground.
    pub fn horizontal_irradiance(&self) -> Rgb {
        let upper = self.texels.chunks_exact(self.width).take(self.height / 2);
        upper
            .enumerate()
            .map(|(row, texels)| {
                // ∫ cosθ sinθ dθ dφ over a texel, θ from straight up.
                let edge = |row: usize| {
                    let angle = (row as f64 - 0.5).max(0.0) * PI / (self.height - 1) as f64;
                    angle.sin().powi(2) / 2.0
                };
                let weight = (edge(row + 1) - edge(row)) * TAU / self.width as f64;
                texels.iter().sum::<Rgb>() * weight as f32
            })
            .sum()
    }
}

/// Elevation in radians of the centre of a row.
fn elevation(row: usize, height: usize) -> f64 {
    FRAC_PI_2 - row as f64 * PI / (height - 1) as f64
}

/// The light of the sun and of a clear sky for a direction towards the sun (+Y up), which need not
/// have unit length; a direction without length or with values that are not finite counts as
/// straight up. Deterministic; changes continuously with the direction.
pub fn daylight(sun_direction: Vec3) -> Daylight {
    let sun_direction = sun_direction.normalize_or(Vec3::Y);
    let sun = sun_direction.as_dvec3().normalize();
    let sun_elevation = sun.y.clamp(-1.0, 1.0).asin();
    let (atmosphere, columns, sunlight) = (Atmosphere::clear(), Columns::new(), Sunlight::new());
    let multiple = MultipleScattering::new(&atmosphere, &columns, sun_elevation);
    let model = SkyModel {
        atmosphere: &atmosphere,
        columns: &columns,
        multiple: &multiple,
        sunlight: &sunlight,
    };
    let texels: Vec<Rgb> = (0..SKY_HEIGHT / 2)
        .flat_map(|row| model.row(elevation(row, SKY_HEIGHT), SKY_WIDTH, sun))
        .collect();
    let arriving = columns.sunlight(&atmosphere, GROUND_RADIUS, sun_elevation);
    let sun_irradiance = into_gamut(sunlight.filtered(&arriving));
    let mut sky = SkyMap { width: SKY_WIDTH, height: SKY_HEIGHT, texels };
    let on_ground = sky.horizontal_irradiance() + sun_irradiance * sun_direction.y.max(0.0);
    let ground = on_ground * (GROUND_ALBEDO / std::f32::consts::PI);
    sky.texels.resize(SKY_WIDTH * SKY_HEIGHT, ground);
    Daylight { sun_direction, sun_irradiance, sky }
}

#[cfg(test)]
mod tests {
    use super::*;
    use spectrum::luminance;

    /// Daylight with the sun at an elevation and an azimuth from +X towards +Z, in degrees.
    fn at(elevation: f64, azimuth: f64) -> Daylight {
        daylight(sky::direction(elevation.to_radians(), azimuth.to_radians()).as_vec3())
    }

    /// Published illuminances of clear days (IES; Darula and Kittler): direct normal 85 to 105 klx,
    /// sky on the level ground 10 to 20 klx. Twilight (Explanatory Supplement to the Astronomical
    /// Almanac, 1992): about 450 lx at sunset, 3.4 lx at the end of civil twilight; here within a
    /// factor of two, since refraction is left out.
    #[test]
    fn illuminances_are_the_published_ones() {
        for elevation in [45.0, 50.0, 60.0] {
            let day = at(elevation, 30.0);
            let sun = luminance(day.sun_irradiance);
            let sky = luminance(day.sky.horizontal_irradiance());
            assert!((85_000.0..105_000.0).contains(&sun), "{elevation}: {sun}");
            assert!((10_000.0..20_000.0).contains(&sky), "{elevation}: {sky}");
        }
        let sunset = luminance(at(-0.83, 0.0).sky.horizontal_irradiance());
        assert!((225.0..900.0).contains(&sunset), "{sunset}");
        let civil = luminance(at(-6.0, 0.0).sky.horizontal_irradiance());
        assert!((1.7..6.8).contains(&civil), "{civil}");
    }

    #[test]
    fn skies_have_their_colors() {
        let noon = at(60.0, 0.0);
        let zenith = noon.sky.texels[0];
        assert!(zenith.z > 1.3 * zenith.x && zenith.y > zenith.x, "{zenith}");
        let [high, low] = [at(60.0, 0.0), at(1.0, 0.0)].map(|day| day.sun_irradiance);
        assert!(low.x > 3.0 * low.z && low.x > 2.0 * low.y, "{low}");
        assert!(high.x < 2.0 * high.z, "{high}");
        // At sunset the horizon is red below the sun, whose azimuth lies at the map's middle.
        let dusk = at(-1.0, 0.0);
        let horizon = dusk.sky.texels[(SKY_HEIGHT / 2 - 1) * SKY_WIDTH + SKY_WIDTH / 2];
        assert!(horizon.x > 1.5 * horizon.z, "{horizon}");
    }

    #[test]
    fn light_is_finite_and_fades_into_night() {
        let mut last = f32::INFINITY;
        for elevation in [90.0, 20.0, 1.0, 0.0, -0.2, -3.0, -10.0, -18.0, -40.0, -90.0] {
            let day = at(elevation, 200.0);
            assert_eq!(day.sky.texels.len(), SKY_WIDTH * SKY_HEIGHT);
            let mut values = day.sky.texels.iter().chain([&day.sun_irradiance]);
            assert!(values.all(|value| value.is_finite() && value.min_element() >= 0.0));
            let sky = luminance(day.sky.horizontal_irradiance());
            assert!(sky <= last, "{elevation}: {sky} > {last}");
            last = sky;
            assert_eq!(day.sun_irradiance == Rgb::ZERO, elevation < -0.27, "{elevation}");
        }
        assert!(last < 1e-6);
    }

    /// Texels at mirrored azimuths to both sides of the sun are alike; turned with the sun, the
    /// energy stays.
    #[test]
    fn sky_is_symmetric_about_the_sun() {
        let day = at(25.0, 0.0);
        for row in day.sky.texels.chunks_exact(SKY_WIDTH) {
            for column in 0..SKY_WIDTH / 2 {
                let [left, right] = [row[column], row[SKY_WIDTH - 1 - column]];
                assert!((left - right).abs().max_element() <= 1e-3 * left.max_element());
            }
        }
        let turned = at(25.0, 77.0).sky.horizontal_irradiance();
        let difference = (turned - day.sky.horizontal_irradiance()).abs().max_element();
        assert!(difference < 1e-3 * turned.max_element(), "{difference}");
    }

    /// Small turns of the sun change all values by little, also where it rises and passes straight
    /// over.
    #[test]
    fn changes_continuously_with_the_direction() {
        for elevation in [89.99, 45.0, 0.26, 0.0, -0.27, -5.0] {
            let [a, b] = [at(elevation, 10.0), at(elevation + 0.002, 10.002)];
            let largest = a.sky.texels.iter().map(|texel| texel.max_element()).fold(0.0, f32::max);
            let sky = a.sky.texels.iter().zip(&b.sky.texels);
            let change = sky.map(|(a, b)| (*a - *b).abs().max_element()).fold(0.0, f32::max);
            assert!(change < 0.01 * largest, "{elevation}: {change} of {largest}");
            let change = (a.sun_irradiance - b.sun_irradiance).abs().max_element();
            let scale = a.sun_irradiance.max_element() + 1.0;
            assert!(change < 0.05 * scale, "{elevation}: {change} of {scale}");
        }
    }

    /// The texels' directions are those of the map's definition; the brightest texel is the one
    /// that looks towards the sun.
    #[test]
    fn map_is_oriented_as_it_says() {
        let day = at(30.0, 120.0);
        let upper = &day.sky.texels[..SKY_WIDTH * SKY_HEIGHT / 2];
        let brightest = (0..upper.len())
            .max_by(|a, b| luminance(upper[*a]).total_cmp(&luminance(upper[*b])))
            .expect("has texels");
        let direction = day.sky.direction(brightest / SKY_WIDTH, brightest % SKY_WIDTH);
        assert!(direction.dot(day.sun_direction) > 0.999, "{direction}");
        let u = direction.z.atan2(direction.x) / std::f32::consts::TAU + 0.5;
        assert_eq!((u * SKY_WIDTH as f32) as usize, brightest % SKY_WIDTH);
        assert!(day.sky.direction(0, 5).y > 0.999);
    }

    /// A uniform sky of radiance L gives E = πL; the ground reflects .3 of sky and sun.
    #[test]
    fn ground_is_lit_by_sky_and_sun() {
        let mut day = at(40.0, 0.0);
        let sky = day.sky.horizontal_irradiance();
        let expected =
            (sky + day.sun_irradiance * day.sun_direction.y) * 0.3 / std::f32::consts::PI;
        for texel in &day.sky.texels[SKY_WIDTH * SKY_HEIGHT / 2..] {
            assert!((*texel - expected).abs().max_element() < 1e-3 * expected.max_element());
        }
        day.sky.texels.fill(Rgb::ONE);
        let uniform = day.sky.horizontal_irradiance();
        assert!((uniform - std::f32::consts::PI).abs().max_element() < 1e-3, "{uniform}");
    }

    #[test]
    fn any_direction_is_accepted() {
        let up = daylight(Vec3::Y);
        for odd in [Vec3::ZERO, Vec3::NAN, Vec3::INFINITY, Vec3::Y * 1e-30] {
            assert_eq!(daylight(odd), up);
        }
        assert_eq!(daylight(Vec3::new(3.0, 4.0, 0.0)), daylight(Vec3::new(0.6, 0.8, 0.0)));
    }
}
