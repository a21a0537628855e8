//! Where the sun stands in the sky, from place and time.
//!
//! Source: Meeus, Astronomical Algorithms, 2nd ed.: the sun's coordinates at low accuracy (ch. 25),
//! sidereal time (ch. 12), horizontal coordinates (ch. 13). Within .01° between 1900 and 2100; UTC
//! stands for both UT and dynamical time, whose difference moves the sun by less than .001°.
//!
//! Refraction, which lifts the sun by .5° at the horizon and .03° at 30°, is left out, because the
//! model of the atmosphere has straight rays, too.

use super::place_and_time::PlaceAndTime;
use glam::Vec3;

/// Julian day of the epoch J2000.0.
const J2000: f64 = 2_451_545.0;
/// Days of a Julian century.
const DAYS_PER_CENTURY: f64 = 36_525.0;

/// The sun's place in the sky, without refraction.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SunPosition {
    /// Degrees above the horizon; negative at night.
    pub elevation: f64,
    /// Degrees from north by way of east, in [0, 360).
    pub azimuth: f64,
    /// Unit direction towards the sun; +Y up, +X east, −Z north.
    pub direction: Vec3,
}

/// The sun's place in the sky as seen from a place on Earth at a moment.
pub fn sun_position(at: &PlaceAndTime) -> SunPosition {
    let sun = Equatorial::of_sun(at.julian_day);
    let hour_angle = sidereal_time(at.julian_day) + at.longitude - sun.right_ascension;
    horizontal(hour_angle, sun.declination, at.latitude)
}

/// Place on the celestial sphere, relative to the Earth's equator.
struct Equatorial {
    /// Right ascension α in degrees.
    right_ascension: f64,
    /// Declination δ in degrees.
    declination: f64,
}

impl Equatorial {
    /// Apparent place of the sun (Meeus, ch. 25, "low accuracy").
    fn of_sun(julian_day: f64) -> Self {
        let t = (julian_day - J2000) / DAYS_PER_CENTURY;
        let mean_longitude = 280.466_46 + t * (36_000.769_83 + t * 0.000_303_2);
        let anomaly = (357.529_11 + t * (35_999.050_29 - t * 0.000_153_7)).to_radians();
        // Equation of the centre: what the orbit's ellipse adds to the mean longitude.
        let centre = (1.914_602 - t * (0.004_817 + t * 0.000_014)) * anomaly.sin()
            + (0.019_993 - t * 0.000_101) * (2.0 * anomaly).sin()
            + 0.000_289 * (3.0 * anomaly).sin();
        // Aberration, and nutation by the longitude of the moon's ascending node.
        let node = (125.04 - 1934.136 * t).to_radians();
        let longitude = (mean_longitude + centre - 0.005_69 - 0.004_78 * node.sin()).to_radians();
        let seconds = 21.448 - t * (46.8150 + t * (0.000_59 - t * 0.001_813));
        let obliquity = 23.0 + 26.0 / 60.0 + seconds / 3600.0 + 0.002_56 * node.cos();
        let (sin, cos) = obliquity.to_radians().sin_cos();
        Self {
            right_ascension: (cos * longitude.sin()).atan2(longitude.cos()).to_degrees(),
            declination: (sin * longitude.sin()).asin().to_degrees(),
        }
    }
}

/// Mean sidereal time at Greenwich in degrees (Meeus, eq. 12.4).
fn sidereal_time(julian_day: f64) -> f64 {
    let days = julian_day - J2000;
    let t = days / DAYS_PER_CENTURY;
    let degrees =
        280.460_618_37 + 360.985_647_366_29 * days + t * t * (0.000_387_933 - t / 38.71e6);
    degrees.rem_euclid(360.0)
}

/// Horizontal coordinates from hour angle, declination and latitude, all in degrees
/// (Meeus, eqs. 13.5 and 13.6; his azimuth counts from the south).
fn horizontal(hour_angle: f64, declination: f64, latitude: f64) -> SunPosition {
    let (sin_hour, cos_hour) = hour_angle.to_radians().sin_cos();
    let (sin_declination, cos_declination) = declination.to_radians().sin_cos();
    let (sin_latitude, cos_latitude) = latitude.to_radians().sin_cos();
    let east = -cos_declination * sin_hour;
    let north = sin_declination * cos_latitude - cos_declination * sin_latitude * cos_hour;
    let up = sin_declination * sin_latitude + cos_declination * cos_latitude * cos_hour;
    SunPosition {
        elevation: up.clamp(-1.0, 1.0).asin().to_degrees(),
        azimuth: east.atan2(north).to_degrees().rem_euclid(360.0),
        direction: Vec3::new(east as f32, up as f32, -north as f32).normalize(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(text: &str) -> SunPosition {
        sun_position(&text.parse().unwrap_or_else(|error| panic!("{error}")))
    }

    /// Meeus, example 25.a: 1992 October 13 at 0 h TD.
    #[test]
    fn sun_of_meeus_example_25a() {
        let sun = Equatorial::of_sun(2_448_908.5);
        assert!((sun.right_ascension.rem_euclid(360.0) - 198.380_83).abs() < 2e-5);
        assert!((sun.declination + 7.785_07).abs() < 2e-5);
    }

    /// Meeus, examples 12.a and 12.b: 13h 10m 46.3668s and 8h 34m 57.0896s.
    #[test]
    fn sidereal_time_of_meeus_examples_12() {
        let first = 15.0 * (13.0 + 10.0 / 60.0 + 46.3668 / 3600.0);
        let second = 15.0 * (8.0 + 34.0 / 60.0 + 57.0896 / 3600.0);
        assert!((sidereal_time(2_446_895.5) - first).abs() < 1e-6);
        assert!((sidereal_time(2_446_896.306_25) - second).abs() < 1e-6);
    }

    /// Meeus, example 13.b: altitude 15.1249°, azimuth 68.0337° west of south.
    #[test]
    fn horizontal_coordinates_of_meeus_example_13b() {
        let latitude = 38.0 + 55.0 / 60.0 + 17.0 / 3600.0;
        let declination = -(6.0 + 43.0 / 60.0 + 11.61 / 3600.0);
        let found = horizontal(64.352_133, declination, latitude);
        assert!((found.elevation - 15.1249).abs() < 1e-4, "{}", found.elevation);
        assert!((found.azimuth - 248.0337).abs() < 1e-4, "{}", found.azimuth);
    }

    /// The worked example of Reda and Andreas, Solar Position Algorithm (NREL/TP-560-34302, 2008):
    /// azimuth 194.34024°, elevation before refraction 39.87205°.
    #[test]
    fn worked_example_of_the_solar_position_algorithm() {
        let found = at("39.742476,-105.1786,2003-10-17T12:30:30-07:00");
        assert!((found.elevation - 39.872_05).abs() < 0.01, "{}", found.elevation);
        assert!((found.azimuth - 194.340_24).abs() < 0.01, "{}", found.azimuth);
    }

    /// At noon of solstices the sun stands 90° − |latitude ∓ 23.436°| high, 23.436° being the
    /// obliquity of the ecliptic in 2026; at the equinox, by the U.S. Naval Observatory 2026 March
    /// 20 at 14:46 UTC, it is on the pole's horizon.
    #[test]
    fn elevations_at_solstice_and_equinox() {
        let highest = |latitude: f64, date: &str| {
            let minutes = (0..1440).map(|minute| {
                let (hour, minute) = (minute / 60, minute % 60);
                at(&format!("{latitude},0,{date}T{hour:02}:{minute:02}:00Z"))
            });
            minutes.max_by(|a, b| a.elevation.total_cmp(&b.elevation)).expect("has minutes")
        };
        let tropic = highest(23.436, "2026-06-21");
        assert!(tropic.elevation > 89.9, "{}", tropic.elevation);
        let greenwich = highest(51.4779, "2026-06-21");
        assert!((greenwich.elevation - (90.0 - 51.4779 + 23.436)).abs() < 0.01);
        assert!((greenwich.azimuth - 180.0).abs() < 0.5);
        assert!(
            (highest(51.4779, "2026-12-21").elevation - (90.0 - 51.4779 - 23.436)).abs() < 0.01
        );
        assert!((highest(0.0, "2026-03-20").elevation - 90.0).abs() < 0.15);
        let pole = at("90,0,2026-03-20T14:46:00Z");
        assert!(pole.elevation.abs() < 0.01, "{}", pole.elevation);
    }

    /// +Y up, +X east, −Z north: the morning sun is in the east, the noon sun of the north's
    /// temperate zone in the south; angles and direction say the same.
    #[test]
    fn directions_are_in_the_scenes_axes() {
        let morning = at("48,0,2026-06-21T06:00:00Z");
        assert!(morning.direction.x > 0.8 && morning.azimuth < 90.0);
        let noon = at("48,0,2026-06-21T12:00:00Z");
        assert!(noon.direction.y > 0.9 && noon.direction.z > 0.3);
        for sun in [morning, noon, at("-48,120,2026-01-03T20:00:00Z")] {
            let (elevation, azimuth) = (sun.elevation.to_radians(), sun.azimuth.to_radians());
            let expected = Vec3::new(
                (elevation.cos() * azimuth.sin()) as f32,
                elevation.sin() as f32,
                (-elevation.cos() * azimuth.cos()) as f32,
            );
            assert!((sun.direction - expected).length() < 1e-6);
        }
    }
}
