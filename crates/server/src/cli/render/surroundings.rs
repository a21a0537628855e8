//! Sky and sun on the command line.

use crate::cli::files::read_file;
use crate::cli::process::Failure;
use clap::{ArgGroup, Args};
use hemilux_engine::radiometry::Rgb;
use hemilux_engine::scene::daylight::PlaceAndTime;
use hemilux_engine::scene::environment::{Environment, PlacedMap, SUN_RADIUS, Sky, Sun};
use hemilux_engine::scene::sky_map::SkyMap;
use std::path::Path;
use std::sync::Arc;

/// What surrounds the scene.
#[derive(Args)]
#[command(group(ArgGroup::new("any_sky").args(["sky", "sun_at"]).multiple(true)))]
pub struct Surroundings {
    /// The sky: the same radiance from everywhere, an equirectangular map (.exr or .hdr), `none` or
    /// a neutral `studio`. Without sky and sun: none where lights of the scene's own light it, else the studio.
    #[arg(long, value_name = "R,G,B|FILE|none|studio", allow_hyphen_values = true)]
    sky: Option<String>,
    /// Turns the sky about the vertical, anticlockwise seen from above; that of --sun-at with its
    /// sun.
    #[arg(long, value_name = "DEGREES", requires = "any_sky", allow_hyphen_values = true, value_parser = parse_finite, default_value_t = 0.0)]
    sky_rotation: f32,
    /// Multiplies the sky's radiance.
    #[arg(long, value_name = "FACTOR", requires = "any_sky", value_parser = parse_factor, default_value_t = 1.0)]
    sky_scale: f32,
    /// The sun: where it is seen, and its irradiance on a plane that faces it.
    #[arg(long, value_name = "X,Y,Z:R,G,B", allow_hyphen_values = true, value_parser = parse_sun)]
    sun: Option<Sun>,
    /// Sun and clear sky of a place and a moment: degrees north and east, and a time by RFC 3339 as
    /// 2026-06-21T12:00:00Z; +X is east, -Z north. With --sky, the sun alone. Light is in lux.
    #[arg(long, value_name = "LAT,LON,TIME", allow_hyphen_values = true, conflicts_with = "sun")]
    sun_at: Option<PlaceAndTime>,
    /// Radius of the scene's point and spot lights: with one, shadows have soft edges. Without a
    /// sky beside it there is none.
    #[arg(long, value_name = "METRES", value_parser = parse_factor)]
    light_radius: Option<f32>,
}

impl Surroundings {
    /// Whether light comes from the day of a place, in lux.
    pub fn has_day(&self) -> bool {
        self.sun_at.is_some()
    }

    /// What is asked for; `None` where nothing is said.
    ///
    /// # Errors
    /// A [`Failure`] where a map can't be read, or where numbers mean nothing.
    pub fn read(&self) -> Result<Option<Arc<Environment>>, Failure> {
        let says_nothing = self.sky.is_none() && self.sun.is_none() && self.sun_at.is_none();
        if says_nothing && self.light_radius.is_none() {
            return Ok(None);
        }
        let light_radius = self.light_radius.unwrap_or_default();
        let day = self.sun_at.as_ref().map(Environment::of_daylight).transpose();
        let day = day.map_err(Failure::failed)?;
        let placed = |around: Environment| {
            around.placed(self.sky_rotation.to_radians(), Rgb::splat(self.sky_scale))
        };
        let around = match self.sky.as_deref() {
            None => placed(day.unwrap_or_default()),
            Some(word) => {
                let sky = placed(Environment { sky: sky(word)?, ..Environment::default() }).sky;
                Environment { sky, sun: day.and_then(|day| day.sun), ..Environment::default() }
            }
        };
        let environment = Environment { sun: self.sun.or(around.sun), light_radius, ..around };
        environment.check().map_err(Failure::usage)?;
        Ok(Some(Arc::new(environment)))
    }
}

/// The sky that a word stands for, or the map in the file of that name.
fn sky(word: &str) -> Result<Sky, Failure> {
    match word {
        "none" => return Ok(Sky::None),
        "studio" => return Ok(Environment::studio().sky),
        _ => {}
    }
    if let Ok(radiance) = parse_three(word) {
        return Ok(Sky::Uniform(radiance));
    }
    let bytes = read_file(Path::new(word)).map_err(|error| {
        let hint = "--sky takes none, studio, three radiances R,G,B, or an .exr or .hdr file";
        Failure::failed(format!("cannot read {word}: {error}; {hint}"))
    })?;
    let map = SkyMap::decode(&bytes);
    let map = map.map_err(|error| Failure::failed(format!("{word}: {error}")))?;
    Ok(Sky::Map(PlacedMap { map: Arc::new(map), rotation: 0.0, scale: Rgb::ONE }))
}

/// Three numbers with commas between them.
pub(super) fn parse_three(text: &str) -> Result<Rgb, String> {
    let wrong = || "must read like 1,0.5,-2".to_owned();
    let numbers: Vec<f32> = text
        .split(',')
        .map(|word| parse_finite(word.trim()))
        .collect::<Result<_, _>>()
        .map_err(|_| wrong())?;
    <[f32; 3]>::try_from(numbers).map(Rgb::from_array).map_err(|_| wrong())
}

fn parse_finite(text: &str) -> Result<f32, String> {
    match text.parse::<f32>() {
        Ok(x) if x.is_finite() => Ok(x),
        _ => Err("must be a number".into()),
    }
}

fn parse_factor(text: &str) -> Result<f32, String> {
    match text.parse::<f32>() {
        Ok(x) if x.is_finite() && x >= 0.0 => Ok(x),
        _ => Err("must be a number of at least 0".into()),
    }
}

fn parse_sun(text: &str) -> Result<Sun, String> {
    let wrong = "must read like 0.3,1,0.2:3,3,3, a direction and an irradiance";
    let (direction, irradiance) = text.split_once(':').ok_or(wrong)?;
    let [direction, irradiance] = [direction, irradiance].map(parse_three);
    let sun =
        Sun::towards(direction.map_err(|_| wrong)?, irradiance.map_err(|_| wrong)?, SUN_RADIUS);
    let alone = Environment { sky: Sky::None, sun: Some(sun), ..Environment::default() };
    alone.check().map(|()| sun).map_err(|error| error.to_string())
}

#[cfg(test)]
mod tests {
    use super::*;
    use clap::Parser;
    use hemilux_engine::image::Picture;

    #[derive(Parser)]
    struct Command {
        #[command(flatten)]
        surroundings: Surroundings,
    }

    fn read(words: &[&str]) -> Result<Option<Arc<Environment>>, String> {
        let words = ["hemilux"].iter().chain(words);
        let command = Command::try_parse_from(words).map_err(|error| error.to_string())?;
        command.surroundings.read().map_err(|failure| failure.message)
    }

    #[test]
    fn skies_and_suns_are_what_was_written() {
        assert!(read(&[]).unwrap().is_none());
        assert!(read(&["--sky", "none"]).unwrap().unwrap().is_dark());
        let uniform = read(&["--sky", "1,0.5,2", "--sky-scale", "2"]).unwrap().unwrap();
        assert_eq!(uniform.radiance(Rgb::Y), Rgb::new(2.0, 1.0, 4.0));
        let sun = read(&["--sun", "-3,4,0:3,2,1"]).unwrap().unwrap();
        assert!(matches!(sun.sky, Sky::None));
        let expected = Sun::towards(Rgb::new(-0.6, 0.8, 0.0), Rgb::new(3.0, 2.0, 1.0), SUN_RADIUS);
        assert_eq!(sun.sun, Some(expected));
        let soft = read(&["--light-radius", "0.25"]).unwrap().unwrap();
        assert!(soft.is_dark() && soft.light_radius == 0.25);
        let studio = read(&["--sky", "studio", "--sky-rotation", "-90"]).unwrap().unwrap();
        let Sky::Map(placed) = &studio.sky else { panic!("a map") };
        assert_eq!(placed.rotation, -std::f32::consts::FRAC_PI_2);
    }

    #[test]
    fn the_sun_of_a_place_comes_with_its_sky_unless_another_is_named() {
        let noon = "48.1,11.6,2026-06-21T11:15:00Z";
        let day = read(&["--sun-at", noon, "--sky-scale", "0.5"]).unwrap().unwrap();
        let model = Environment::of_daylight(&noon.parse().unwrap()).unwrap();
        assert_eq!(day.sun, model.sun);
        assert_eq!(day.radiance(Rgb::Y), model.radiance(Rgb::Y) * 0.5);
        let under_white = read(&["--sun-at", noon, "--sky", "1,1,1"]).unwrap().unwrap();
        assert_eq!((under_white.sun, under_white.radiance(Rgb::Y)), (model.sun, Rgb::ONE));
        let night = read(&["--sun-at", "-33.9,151.2,2026-06-21T14:00:00Z"]).unwrap().unwrap();
        assert!(night.sun.is_none());
        assert!(night.radiance(Rgb::Y).max_element() < 1e-3, "{}", night.radiance(Rgb::Y));
    }

    #[test]
    fn files_are_read_and_refused_by_name() {
        let folder = tempfile::tempdir().unwrap();
        let [good, bad] = ["good.exr", "bad.hdr"].map(|name| folder.path().join(name));
        let pixels = vec![Rgb::new(1.0, 2.0, 3.0); 8];
        let picture = Picture::new(4, 2, pixels);
        std::fs::write(&good, picture.to_exr().unwrap()).unwrap();
        std::fs::write(&bad, "no sky").unwrap();
        let sky = read(&["--sky", good.to_str().unwrap(), "--sky-scale", "0.5"]).unwrap().unwrap();
        assert!((sky.radiance(Rgb::X) - Rgb::new(0.5, 1.0, 1.5)).length() < 1e-5);
        let error = read(&["--sky", bad.to_str().unwrap()]).unwrap_err();
        assert!(error.contains("bad.hdr") && error.contains("OpenEXR"), "{error}");
        let error = read(&["--sky", "nowhere.exr"]).unwrap_err();
        assert!(error.contains("nowhere.exr") && error.contains("studio"), "{error}");
    }

    #[test]
    fn what_means_nothing_is_refused() {
        for words in [
            &["--sky", "-1,0,0"][..],
            &["--sky", "1,2"],
            &["--sun", "0,0,0:1,1,1"],
            &["--sun", "0,1,0"],
            &["--sun", "0,1,0:1,-1,1"],
            &["--sun", "0,1,nan:1,1,1"],
            &["--sky-scale", "2"],
            &["--sun-at", "91,0,2026-06-21T12:00:00Z"],
            &["--sun-at", "48,11,noon"],
            &["--sun-at", "48,11,2026-06-21T12:00:00Z", "--sun", "0,1,0:1,1,1"],
            &["--light-radius", "-1"],
            &["--light-radius", "1e9"],
            &["--sky", "studio", "--sky-scale", "-2"],
            &["--sky", "studio", "--sky-rotation", "inf"],
        ] {
            assert!(read(words).is_err(), "{words:?}");
        }
    }
}
