//! What surrounds a scene: a sky, infinitely far away, and a sun.

use super::SceneError;
use super::daylight::{PlaceAndTime, daylight, sun_position};
use super::sky_map::{MAX_SKY_RADIANCE, SkyMap};
use crate::radiometry::Rgb;
use glam::{Vec2, Vec3};
use std::f32::consts::PI;
use std::sync::Arc;

/// Angular radius of the sun as seen from the earth, radians: half of .533°.
pub const SUN_RADIUS: f32 = 0.00465;
/// Largest angular radius of a sun, radians (a diameter of 20°): what is larger is a sky.
pub const MAX_SUN_RADIUS: f32 = 0.174_532_92;

/// Largest radius of point and spot lights, metres.
pub const MAX_LIGHT_RADIUS: f32 = 1e6;

/// What surrounds a scene. The default gives no light.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Environment {
    /// Light from all around.
    pub sky: Sky,
    /// Light from one direction.
    pub sun: Option<Sun>,
    /// Radius of the scene's point and spot lights, metres, 0 … [`MAX_LIGHT_RADIUS`]. With 0 they
    /// are points; else a small sphere stands for each that is as bright and is not to be seen, so
    /// that shadows have soft edges.
    pub light_radius: f32,
}

/// Light from all around, of surfaces infinitely far away.
#[derive(Clone, Debug, Default, PartialEq)]
pub enum Sky {
    /// Black.
    #[default]
    None,
    /// The same radiance from everywhere.
    Uniform(Rgb),
    /// Radiance by direction.
    Map(PlacedMap),
}

/// A map of the sky, as it is placed about a scene.
#[derive(Clone, Debug, PartialEq)]
pub struct PlacedMap {
    /// Radiance by direction.
    pub map: Arc<SkyMap>,
    /// How far it is turned about +Y, radians, anticlockwise seen from above.
    pub rotation: f32,
    /// What its radiance is multiplied by, ≥ 0.
    pub scale: Rgb,
}

/// A disk of uniform radiance, infinitely far away.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sun {
    /// Unit vector towards its middle.
    pub direction: Vec3,
    /// Irradiance on a plane that faces it, ≥ 0.
    pub irradiance: Rgb,
    /// Radians, 0 … [`MAX_SUN_RADIUS`]; the real one's is [`SUN_RADIUS`]. With 0, all light comes
    /// from exactly one direction, and the disk is not to be seen.
    pub angular_radius: f32,
}

impl Environment {
    /// Darkness.
    pub fn none() -> Self {
        Self::default()
    }

    /// A neutral studio: dim below, brighter above, and a large soft light high to the front left
    /// of what looks along −Z. Its mean radiance is 1.
    pub fn studio() -> Self {
        Self {
            sky: Sky::Map(PlacedMap {
                map: Arc::new(studio_map()),
                rotation: 0.0,
                scale: Rgb::ONE,
            }),
            ..Self::default()
        }
    }

    /// The clear sky and the sun of a place on Earth at a moment: the model of [`daylight`], in lux
    /// and cd/m², with +X east and −Z north. Once the sun is down there is none, and the sky is
    /// that of dusk or night.
    ///
    /// # Errors
    /// Those of [`SkyMap::new`], which the model gives no cause for.
    pub fn of_daylight(at: &PlaceAndTime) -> Result<Self, SceneError> {
        let day = daylight(sun_position(at).direction);
        let (width, height) = (day.sky.width as u32, day.sky.height as u32);
        let map = Arc::new(SkyMap::new(width, height, day.sky.texels)?);
        let sun = Sun::towards(day.sun_direction, day.sun_irradiance, SUN_RADIUS);
        Ok(Self {
            sky: Sky::Map(PlacedMap { map, rotation: 0.0, scale: Rgb::ONE }),
            sun: Some(sun).filter(|sun| sun.irradiance != Rgb::ZERO),
            ..Self::default()
        })
    }

    /// The same, turned as a whole about +Y by an angle in radians, anticlockwise seen from above,
    /// and the sky's radiance, not the sun's, multiplied by `scale`. (A uniform sky looks the same
    /// however it is turned.)
    pub fn placed(self, rotation: f32, scale: Rgb) -> Self {
        let sky = match self.sky {
            Sky::None => Sky::None,
            Sky::Uniform(radiance) => Sky::Uniform(radiance * scale),
            Sky::Map(placed) => Sky::Map(PlacedMap {
                rotation: placed.rotation + rotation,
                scale: placed.scale * scale,
                ..placed
            }),
        };
        let turn = |sun: Sun| match rotation == 0.0 {
            true => sun,
            false => {
                Sun::towards(turned(sun.direction, rotation), sun.irradiance, sun.angular_radius)
            }
        };
        Self { sky, sun: self.sun.map(turn), ..self }
    }

    /// Radiance of the sky from a unit direction, without the sun's disk.
    pub fn radiance(&self, direction: Vec3) -> Rgb {
        match &self.sky {
            Sky::None => Rgb::ZERO,
            Sky::Uniform(radiance) => *radiance,
            Sky::Map(placed) => placed.radiance(direction),
        }
    }

    /// Radiance from a unit direction, with the sun's disk.
    pub fn background(&self, direction: Vec3) -> Rgb {
        let sun = self.sun.filter(|sun| sun.covers(direction));
        self.radiance(direction) + sun.map_or(Rgb::ZERO, |sun| sun.radiance())
    }

    /// Whether no light at all comes from it.
    pub fn is_dark(&self) -> bool {
        let sky_is_dark = match &self.sky {
            Sky::None => true,
            Sky::Uniform(radiance) => *radiance == Rgb::ZERO,
            Sky::Map(placed) => placed.is_dark(),
        };
        sky_is_dark && self.sun.is_none_or(|sun| sun.irradiance == Rgb::ZERO)
    }

    /// Whether all its numbers mean something.
    ///
    /// # Errors
    /// [`SceneError`] names the first that does not, as `environment.sun.direction`.
    pub fn check(&self) -> Result<(), SceneError> {
        let amount = |at: &str, x: Rgb| match x.to_array().into_iter().all(is_amount) {
            true => Ok(()),
            false => {
                let what = format!("({}, {}, {}) is no amount of light", x.x, x.y, x.z);
                let fix = format!("give three numbers from 0 to {MAX_SKY_RADIANCE:e}");
                Err(SceneError::malformed(format!("environment.{at}"), what, fix))
            }
        };
        match &self.sky {
            Sky::None => {}
            Sky::Uniform(radiance) => amount("sky", *radiance)?,
            Sky::Map(PlacedMap { rotation, scale, .. }) => {
                amount("scale", *scale)?;
                if !rotation.is_finite() {
                    let (at, fix) = ("environment.rotation", "give an angle");
                    return Err(SceneError::malformed(at, format!("{rotation} is no angle"), fix));
                }
            }
        }
        if !(0.0..=MAX_LIGHT_RADIUS).contains(&self.light_radius) {
            return Err(SceneError::malformed(
                "environment.light_radius",
                format!("is {} m", self.light_radius),
                format!("give a radius from 0 to {MAX_LIGHT_RADIUS:e} metres"),
            ));
        }
        let Some(Sun { direction, irradiance, angular_radius }) = self.sun else { return Ok(()) };
        amount("sun.irradiance", irradiance)?;
        if !direction.is_normalized() {
            let what = "has no direction".to_owned();
            let fix = "give three finite numbers, not all zero, that point towards the sun";
            return Err(SceneError::malformed("environment.sun.direction", what, fix));
        }
        if !(0.0..=MAX_SUN_RADIUS).contains(&angular_radius) {
            let degrees = angular_radius.to_degrees();
            return Err(SceneError::malformed(
                "environment.sun",
                format!("has an angular radius of {degrees}°"),
                "give a diameter from 0° to 20°; what is larger is a sky",
            ));
        }
        Ok(())
    }

    /// Gives all that makes the environment what it is to `digest`, piece by piece. Darkness gives
    /// nothing.
    pub fn digest_into(&self, digest: &mut impl FnMut(&[u8])) {
        match &self.sky {
            Sky::None => {}
            Sky::Uniform(radiance) => {
                digest(b"uniform sky");
                digest(bytemuck::bytes_of(radiance));
            }
            Sky::Map(PlacedMap { map, rotation, scale }) => {
                digest(b"map of a sky");
                digest(&rotation.to_le_bytes());
                digest(bytemuck::bytes_of(scale));
                map.digest_into(digest);
            }
        }
        if let Some(Sun { direction, irradiance, angular_radius }) = &self.sun {
            digest(b"sun");
            digest(bytemuck::bytes_of(direction));
            digest(bytemuck::bytes_of(irradiance));
            digest(&angular_radius.to_le_bytes());
        }
        if self.light_radius > 0.0 {
            digest(b"radius of lights");
            digest(&self.light_radius.to_le_bytes());
        }
    }
}

fn is_amount(x: f32) -> bool {
    (0.0..=MAX_SKY_RADIANCE).contains(&x)
}

impl PlacedMap {
    /// Radiance from a unit direction.
    pub fn radiance(&self, direction: Vec3) -> Rgb {
        self.scale * self.map.radiance(turned(direction, -self.rotation))
    }

    /// Whether no light at all comes from it.
    fn is_dark(&self) -> bool {
        self.map.texels().iter().all(|texel| self.scale * *texel == Rgb::ZERO)
    }
}

/// A direction turned about +Y by an angle in radians, anticlockwise seen from above.
pub fn turned(direction: Vec3, angle: f32) -> Vec3 {
    if angle == 0.0 {
        return direction;
    }
    let (sin, cos) = angle.sin_cos();
    let Vec3 { x, y, z } = direction;
    Vec3::new(cos * x + sin * z, y, cos * z - sin * x)
}

impl Sun {
    /// A sun in a direction of any length other than zero.
    pub fn towards(direction: Vec3, irradiance: Rgb, angular_radius: f32) -> Self {
        // In double precision: squares of single ones may leave its range.
        let direction = direction.as_dvec3().normalize_or_zero().as_vec3();
        Self { direction, irradiance, angular_radius }
    }

    /// Radiance of the disk: irradiance over π sin²r, the cosine-weighted solid angle of a disk of
    /// angular radius r that is faced. Zero for a sun without a disk.
    pub fn radiance(&self) -> Rgb {
        let sine = self.angular_radius.sin();
        if sine > 0.0 { self.irradiance / (PI * sine * sine) } else { Rgb::ZERO }
    }

    /// About the mean radiance of the disk over directions about a unit vector: a parallelogram of such sides, blurred
    /// by such an angle besides. Disk and parallelogram together are taken for an ellipse of the same second moments,
    /// so that nothing is lost of the light as long as the sides are small, and that of a single direction is exact.
    pub fn mean_over(&self, direction: Vec3, (sides, blur): ([Vec3; 2], f32)) -> Rgb {
        let off = self.direction - direction;
        if self.angular_radius <= 0.0 || off.length_squared() > 1.0 {
            return Rgb::ZERO;
        }
        let (across, down) = direction.any_orthonormal_pair();
        let flat = |vector: Vec3| Vec2::new(across.dot(vector), down.dot(vector)).as_dvec2();
        let (off, [one, other]) = (flat(off), sides.map(flat));
        // Second moments of a disk of radius r are r²/4, those of a square 1/12.
        let round = 0.25 * f64::from(self.angular_radius.sin().powi(2) + 0.25 * blur * blur);
        let xx = round + (one.x * one.x + other.x * other.x) / 12.0;
        let yy = round + (one.y * one.y + other.y * other.y) / 12.0;
        let xy = (one.x * one.y + other.x * other.y) / 12.0;
        let determinant = xx * yy - xy * xy;
        let far = yy * off.x * off.x - 2.0 * xy * off.x * off.y + xx * off.y * off.y;
        if !(determinant > 0.0 && far <= 4.0 * determinant) {
            return Rgb::ZERO;
        }
        self.irradiance / (4.0 * PI * determinant.sqrt() as f32)
    }

    /// Whether a unit direction meets the disk.
    pub fn covers(&self, direction: Vec3) -> bool {
        // By the chord instead of the cosine, which can't tell angles this small apart.
        let chord = 2.0 * (0.5 * self.angular_radius).sin();
        self.angular_radius > 0.0 && (direction - self.direction).length_squared() <= chord * chord
    }
}

/// The studio's map: small, since it is smooth.
fn studio_map() -> SkyMap {
    const SIZE: [u32; 2] = [128, 64];
    let key = Vec3::new(-0.5, 0.75, 0.6).normalize();
    let radiance = |direction: Vec3| {
        let above = 0.5 + 0.5 * direction.y;
        let fill = 0.3 + 0.9 * above * above;
        // A bell about the middle of the light, about 25° to where it has half its height.
        Rgb::splat(fill + 6.0 * (7.0 * (direction.dot(key) - 1.0)).exp())
    };
    let built = |scale: f32| SkyMap::from_fn(SIZE[0], SIZE[1], |d| radiance(d) * scale);
    let raw = built(1.0).expect("positive radiances");
    built(raw.mean().x.recip()).expect("positive radiances")
}

#[cfg(test)]
mod tests {
    use super::*;

    fn bytes(environment: &Environment) -> Vec<u8> {
        let mut all = Vec::new();
        environment.digest_into(&mut |piece| all.extend_from_slice(piece));
        all
    }

    fn with_sun(sun: Sun) -> Environment {
        Environment {
            sky: Sky::Uniform(Rgb::new(0.1, 0.2, 0.3)),
            sun: Some(sun),
            ..Environment::default()
        }
    }

    const SUN: Sun =
        Sun { direction: Vec3::Y, irradiance: Rgb::new(3.0, 2.0, 1.0), angular_radius: SUN_RADIUS };

    /// Nothing is lost of the light of parallelograms that are small, that of a single direction is exact, and huge ones
    /// give numbers.
    #[test]
    fn a_sun_over_parallelograms_shines_as_much() {
        const STEPS: u32 = 800;
        let sun = Sun::towards(Vec3::new(0.3, 0.8, -0.4), SUN.irradiance, SUN_RADIUS);
        let (across, down) = sun.direction.any_orthonormal_pair();
        for (sides, blur) in [
            ([Vec3::ZERO; 2], 0.0),
            ([Vec3::ZERO; 2], 0.1),
            ([across * 0.1, down * 0.05], 0.0),
            ([across * 0.1, across * 0.08 + down * 0.02], 0.03),
        ] {
            let reach = 2.5 * (SUN_RADIUS + blur + sides[0].length() + sides[1].length());
            let at = |k: u32| reach * ((k as f32 + 0.5) / STEPS as f32 - 0.5);
            let row = |y: u32| -> Rgb {
                let direction =
                    |x: u32| (sun.direction + at(x) * across + at(y) * down).normalize();
                (0..STEPS).map(|x| sun.mean_over(direction(x), (sides, blur))).sum()
            };
            let all = (0..STEPS).map(row).sum::<Rgb>() * (reach / STEPS as f32).powi(2);
            let off = (all / sun.irradiance - Rgb::ONE).abs().max_element();
            assert!(off < 0.03, "{sides:?} {blur}: off by {off}");
        }
        let middle = sun.mean_over(sun.direction, ([Vec3::ZERO; 2], 0.0));
        assert!((middle / sun.radiance() - Rgb::ONE).abs().max_element() < 1e-4, "{middle}");
        let huge = [across * f32::MAX, down];
        assert!(sun.mean_over(sun.direction, (huge, 0.0)).is_finite());
        let dot = Sun { angular_radius: 0.0, ..sun };
        assert_eq!(dot.mean_over(sun.direction, ([across, down], 0.0)), Rgb::ZERO);
    }

    #[test]
    fn darkness_is_dark() {
        assert!(Environment::none().is_dark() && bytes(&Environment::none()).is_empty());
        let map = Arc::new(SkyMap::new(1, 1, vec![Rgb::X]).unwrap());
        let placed = |scale| Sky::Map(PlacedMap { map: map.clone(), rotation: 0.0, scale });
        assert!(Environment { sky: placed(Rgb::Y), ..Environment::default() }.is_dark());
        assert!(!Environment { sky: placed(Rgb::X), ..Environment::default() }.is_dark());
        assert!(!with_sun(SUN).is_dark() && !Environment::studio().is_dark());
        let out = Sun { irradiance: Rgb::ZERO, ..SUN };
        assert!(Environment { sky: Sky::None, sun: Some(out), ..Environment::default() }.is_dark());
    }

    #[test]
    fn the_studio_is_neutral_bright_above_and_of_mean_one() {
        let studio = Environment::studio();
        let Sky::Map(placed) = &studio.sky else { panic!("a map") };
        assert!((placed.map.mean() - Rgb::ONE).length() < 1e-4);
        let key = studio.radiance(Vec3::new(-0.5, 0.75, 0.6).normalize()).x;
        let (up, down) = (studio.radiance(Vec3::Y).x, studio.radiance(Vec3::NEG_Y).x);
        assert!(key > 2.0 * up && up > 2.0 * down && down > 0.1, "{key} {up} {down}");
        assert!(placed.map.texels().iter().all(|t| t.x == t.y && t.y == t.z));
    }

    /// Munich at noon of a summer day: the sun is high in the south (+Z), as bright as published; at
    /// midnight there is none, and the sky is next to black.
    #[test]
    fn daylight_has_a_sun_by_day_and_none_by_night() {
        let at = |time: &str| {
            let place = format!("48.1,11.6,{time}").parse().expect("a place and a time");
            Environment::of_daylight(&place).unwrap()
        };
        let (noon, midnight) = (at("2026-06-21T11:15:00Z"), at("2026-06-21T23:15:00Z"));
        assert_eq!((noon.check(), midnight.check()), (Ok(()), Ok(())));
        let sun = noon.sun.expect("shines");
        assert!(sun.direction.y > 0.85 && sun.direction.z > 0.3, "{}", sun.direction);
        assert!(sun.irradiance.min_element() > 5e4, "{}", sun.irradiance);
        assert!(midnight.sun.is_none());
        let (day, night) = (noon.radiance(Vec3::Y), midnight.radiance(Vec3::Y));
        assert!(night.max_element() < 1e-4 * day.min_element(), "{day} {night}");
    }

    #[test]
    fn placing_turns_sky_and_sun_together_and_scales_the_sky() {
        let map = SkyMap::from_fn(64, 32, |d| Rgb::new(1.0 + d.x, 1.0, 1.0 + d.z)).unwrap();
        let sky = Sky::Map(PlacedMap { map: Arc::new(map), rotation: 0.3, scale: Rgb::ONE });
        let sun = Sun::towards(Vec3::new(1.0, 1.0, 0.5), Rgb::ONE, SUN_RADIUS);
        let before = Environment { sky, sun: Some(sun), ..Environment::default() };
        let after = before.clone().placed(0.7, Rgb::splat(2.0));
        let turned_sun = after.sun.unwrap();
        assert!((turned_sun.direction - turned(sun.direction, 0.7)).length() < 1e-6);
        assert_eq!(turned_sun.irradiance, sun.irradiance);
        for direction in [Vec3::X, Vec3::Z, sun.direction] {
            let seen = after.radiance(turned(direction, 0.7));
            assert!((seen - 2.0 * before.radiance(direction)).length() < 1e-4, "{direction}");
        }
        let uniform = Environment { sky: Sky::Uniform(Rgb::ONE), ..Environment::default() };
        assert_eq!(uniform.placed(1.0, Rgb::splat(3.0)).radiance(Vec3::Y), Rgb::splat(3.0));
    }

    #[test]
    fn maps_turn_about_the_vertical() {
        let map = Arc::new(SkyMap::from_fn(64, 32, |d| d + Vec3::ONE).unwrap());
        let placed = PlacedMap { map, rotation: 0.5 * PI, scale: Rgb::splat(2.0) };
        // A quarter turn takes +Z to +X and +X to −Z.
        let environment = Environment { sky: Sky::Map(placed), ..Environment::default() };
        let from_x = environment.radiance(Vec3::X);
        assert!((from_x - 2.0 * (Vec3::Z + Vec3::ONE)).length() < 0.02, "{from_x}");
        let from_minus_z = environment.radiance(Vec3::NEG_Z);
        assert!((from_minus_z - 2.0 * (Vec3::X + Vec3::ONE)).length() < 0.02, "{from_minus_z}");
    }

    #[test]
    fn the_sun_is_in_the_background_alone() {
        let environment = with_sun(SUN);
        let at = |angle: f32| Vec3::new(angle.sin(), angle.cos(), 0.0);
        assert_eq!(environment.radiance(Vec3::Y), Rgb::new(0.1, 0.2, 0.3));
        assert_eq!(environment.background(at(0.0047)), environment.radiance(at(0.0047)));
        let inside = environment.background(at(0.0046)) - environment.radiance(Vec3::Y);
        // ∫ L cosθ over the disk is the irradiance.
        let solid_angle = PI * SUN_RADIUS.sin().powi(2);
        assert!((inside * solid_angle - SUN.irradiance).length() < 1e-3);
        let point = with_sun(Sun { angular_radius: 0.0, ..SUN });
        assert_eq!(point.background(Vec3::Y), point.radiance(Vec3::Y));
    }

    #[test]
    fn numbers_that_mean_nothing_are_refused_by_name() {
        let refused = |environment: Environment| environment.check().map_err(|error| error.at);
        let sun = |sun| refused(with_sun(sun)).unwrap_err();
        assert_eq!(refused(with_sun(SUN)), Ok(()));
        assert_eq!(refused(Environment::studio()), Ok(()));
        assert_eq!(sun(Sun { angular_radius: 0.2, ..SUN }), "environment.sun");
        assert_eq!(sun(Sun { angular_radius: f32::NAN, ..SUN }), "environment.sun");
        assert_eq!(sun(Sun { irradiance: -Rgb::X, ..SUN }), "environment.sun.irradiance");
        for direction in [Vec3::ZERO, Vec3::NAN, Vec3::new(f32::INFINITY, 0.0, 0.0)] {
            let sun_there = Sun::towards(direction, Rgb::ONE, SUN_RADIUS);
            assert_eq!(sun(sun_there), "environment.sun.direction", "{direction}");
        }
        for direction in [Vec3::splat(1e-30), Vec3::splat(-1e30), Vec3::Z] {
            let sun_there = Sun::towards(direction, Rgb::ONE, SUN_RADIUS);
            assert_eq!(refused(with_sun(sun_there)), Ok(()), "{direction}");
        }
        for light_radius in [-0.1, f32::NAN, f32::INFINITY] {
            let soft = Environment { light_radius, ..with_sun(SUN) };
            assert_eq!(refused(soft).unwrap_err(), "environment.light_radius");
        }
        let sky = Sky::Uniform(Rgb::new(0.0, f32::NAN, 1.0));
        assert_eq!(
            refused(Environment { sky, ..Environment::default() }).unwrap_err(),
            "environment.sky"
        );
    }

    #[test]
    fn whatever_differs_has_another_digest() {
        let base = with_sun(SUN);
        let mut others = vec![Environment::none(), Environment::studio()];
        others.push(Environment { sun: None, ..base.clone() });
        others.push(with_sun(Sun { angular_radius: 0.0, ..SUN }));
        others.push(Environment { light_radius: 0.1, ..base.clone() });
        others.push(with_sun(Sun { direction: Vec3::X, ..SUN }));
        others.push(with_sun(Sun { irradiance: Rgb::ONE, ..SUN }));
        let mut turned = Environment::studio();
        if let Sky::Map(placed) = &mut turned.sky {
            placed.rotation = 1.0;
        }
        others.push(turned);
        others.push(base);
        let all: std::collections::BTreeSet<_> = others.iter().map(bytes).collect();
        assert_eq!(all.len(), others.len());
    }
}
