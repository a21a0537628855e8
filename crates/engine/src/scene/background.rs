//! What a camera sees beside the surfaces. It gives no light.

use super::SceneError;
use super::environment::Environment;
use super::sky_map::MAX_SKY_RADIANCE;
use crate::radiometry::Rgb;
use glam::Vec3;

/// What a camera sees where no surface is in front of it, not even one that lets light through.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum Background {
    /// The sky and the sun.
    #[default]
    Sky,
    /// Nothing: the picture tells by its alpha which share of a pixel surfaces cover.
    Transparent,
    /// The same linear RGB radiance everywhere.
    Colour(Rgb),
}

impl Background {
    /// Radiance towards the camera from the unit `direction`.
    pub fn radiance(self, environment: &Environment, direction: Vec3) -> Rgb {
        match self {
            Self::Sky => environment.background(direction),
            Self::Transparent => Rgb::ZERO,
            Self::Colour(radiance) => radiance,
        }
    }

    /// Whether it is black in every direction.
    pub fn is_black(self, environment: &Environment) -> bool {
        match self {
            Self::Sky => environment.is_dark(),
            Self::Transparent => true,
            Self::Colour(radiance) => radiance == Rgb::ZERO,
        }
    }

    /// Whether pictures before it have an alpha channel.
    pub fn is_transparent(self) -> bool {
        self == Self::Transparent
    }

    /// Numbers that tell backgrounds apart, bit for bit; none for the sky.
    pub fn key(self) -> Vec<u32> {
        match self {
            Self::Sky => Vec::new(),
            Self::Transparent => vec![0],
            Self::Colour(radiance) => radiance.to_array().map(f32::to_bits).to_vec(),
        }
    }

    /// Whether its numbers mean something.
    ///
    /// # Errors
    /// [`SceneError`] at `background` where a colour is no amount of light.
    pub fn check(self) -> Result<(), SceneError> {
        match self {
            Self::Colour(radiance)
                if !radiance.to_array().iter().all(|x| (0.0..=MAX_SKY_RADIANCE).contains(x)) =>
            {
                let what =
                    format!("({}, {}, {}) is no radiance", radiance.x, radiance.y, radiance.z);
                let fix = format!("give three numbers from 0 to {MAX_SKY_RADIANCE:e}");
                Err(SceneError::malformed("background", what, fix))
            }
            _ => Ok(()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::environment::Sky;

    #[test]
    fn each_shows_its_own() {
        let around = Environment { sky: Sky::Uniform(Rgb::Y), ..Environment::default() };
        let colour = Background::Colour(Rgb::X);
        let seen = |background: Background| background.radiance(&around, Vec3::Z);
        assert_eq!(
            [Background::Sky, Background::Transparent, colour].map(seen),
            [Rgb::Y, Rgb::ZERO, Rgb::X]
        );
        let is_black = |background: Background| background.is_black(&Environment::none());
        assert_eq!(
            [Background::Sky, Background::Transparent, colour].map(is_black),
            [true, true, false]
        );
        assert!(!Background::Sky.is_black(&around));
        assert!(Background::Colour(Rgb::ZERO).is_black(&around));
    }

    #[test]
    fn colours_that_are_none_are_refused_and_all_others_told_apart() {
        for bad in [Rgb::new(-1.0, 0.0, 0.0), Rgb::NAN, Rgb::INFINITY] {
            assert_eq!(Background::Colour(bad).check().unwrap_err().at, "background");
        }
        let all = [
            Background::Sky,
            Background::Transparent,
            Background::Colour(Rgb::ZERO),
            Background::Colour(Rgb::X),
        ];
        assert!(all.iter().all(|background| background.check().is_ok()));
        let keys: std::collections::BTreeSet<_> = all.map(Background::key).into();
        assert_eq!(keys.len(), all.len());
    }
}
