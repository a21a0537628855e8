//! What surrounds a job's scene, as clients ask for it.

use super::instant;
use jiff::Timestamp;
use jiff::tz::TimeZone;
use serde::{Deserialize, Serialize};
use utoipa::openapi::schema::{ArrayBuilder, ObjectBuilder, OneOfBuilder, Type};
use utoipa::openapi::{Ref, RefOr, Schema};
use utoipa::{PartialSchema, ToSchema};

/// Largest amount of light in a request: radiance or irradiance, or factor of one.
const MOST_LIGHT: f32 = 1e12;
/// Largest radius of a light, metres.
const MOST_RADIUS: f32 = 1e6;
/// Largest turn of a sky, degrees.
const MOST_TURN: f32 = 1e6;
/// Largest diameter of a sun, degrees.
const MOST_DIAMETER: f32 = 20.0;

/// Sky and sun about the scene.
#[derive(Clone, Debug, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct EnvironmentRequest {
    /// Light from all around. Without it black, or the sky of `sun_at`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schema(nullable = false)]
    pub sky: Option<SkyRequest>,
    /// How far the sky is turned about the vertical, anticlockwise seen from above; where the sky is
    /// that of `sun_at`, its sun turns with it.
    #[serde(default)]
    #[schema(minimum = -1e6, maximum = 1e6, default = 0.0)]
    pub rotation_degrees: f32,
    /// What the sky's radiance is multiplied by.
    #[serde(default = "one")]
    #[schema(minimum = 0, maximum = 1e12, default = 1.0)]
    pub scale: f32,
    /// Light from one direction.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schema(nullable = false)]
    pub sun: Option<SunRequest>,
    /// The sun of a place and a moment, instead of `sun`, and where `sky` is left out the clear sky
    /// of that moment, too.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schema(nullable = false)]
    pub sun_at: Option<SunAtRequest>,
    /// Radius of the scene's point and spot lights, metres: with one, shadows have soft edges. The
    /// light is as bright as without, and its sphere is not to be seen.
    #[serde(default)]
    #[schema(minimum = 0, maximum = 1e6, default = 0.0)]
    pub light_radius: f32,
}

/// Requests that mean the same are equal: a sky that is left out is black where there is no
/// `sun_at`.
impl PartialEq for EnvironmentRequest {
    fn eq(&self, other: &Self) -> bool {
        let meant = |one: &Self| match (&one.sky, &one.sun_at) {
            (None, None) => Some(SkyRequest::None),
            (sky, _) => sky.clone(),
        };
        let rest =
            |one: &Self| (one.rotation_degrees, one.scale, one.sun, one.sun_at, one.light_radius);
        meant(self) == meant(other) && rest(self) == rest(other)
    }
}

fn one() -> f32 {
    1.0
}

/// A sky: black, a neutral studio, the same radiance from everywhere, or a stored map.
#[derive(Clone, Debug, PartialEq)]
pub enum SkyRequest {
    /// Black.
    None,
    /// A neutral studio: dim below, brighter above, a large soft light; mean radiance 1.
    Studio,
    /// Linear RGB radiance.
    Uniform([f32; 3]),
    /// The stored map of that id.
    Map(String),
}

/// A stored map as a sky.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct MapOfSky {
    /// Id of a stored map (`POST /v1/environments`).
    #[schema(
        pattern = "^[0-9a-f]{64}$",
        example = "5feceb66ffc86f38d952786c6d696c79c2dbc239dd4e91b46729d73a27fb57e9"
    )]
    pub environment: String,
}

impl SkyRequest {
    /// The word for the sky, where there is one.
    pub(super) fn word(&self) -> Option<&'static str> {
        match self {
            Self::None => Some("none"),
            Self::Studio => Some("studio"),
            Self::Uniform(_) | Self::Map(_) => None,
        }
    }
}

impl Serialize for SkyRequest {
    fn serialize<S: serde::Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        match self {
            Self::Uniform(radiance) => radiance.serialize(serializer),
            Self::Map(id) => MapOfSky { environment: id.clone() }.serialize(serializer),
            sky => serializer.serialize_str(sky.word().unwrap_or_default()),
        }
    }
}

impl PartialSchema for SkyRequest {
    fn schema() -> RefOr<Schema> {
        let words = [Self::None, Self::Studio];
        let words = ObjectBuilder::new()
            .schema_type(Type::String)
            .enum_values(Some(words.iter().filter_map(Self::word)));
        let amount = ObjectBuilder::new()
            .schema_type(Type::Number)
            .minimum(Some(0))
            .maximum(Some(1_000_000_000_000_u64));
        let radiance = ArrayBuilder::new().items(amount).min_items(Some(3)).max_items(Some(3));
        OneOfBuilder::new()
            .description(Some(
                "Black (`none`), a neutral `studio` of mean radiance 1, the same \
                 linear RGB radiance from everywhere, or a stored map.",
            ))
            .item(words)
            .item(radiance)
            .item(Ref::from_schema_name("MapOfSky"))
            .into()
    }
}

impl ToSchema for SkyRequest {}

/// A disk of uniform radiance, infinitely far away.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct SunRequest {
    /// Where it is seen: a vector of any length but zero; +Y is up.
    #[schema(example = json!([0.3, 0.8, 0.5]))]
    pub direction: [f32; 3],
    /// Linear RGB irradiance on a plane that faces it.
    #[schema(example = json!([3.0, 2.9, 2.7]))]
    pub irradiance: [f32; 3],
    /// What it looks like from the scene; 0 makes shadows without a soft edge.
    #[serde(default = "diameter_of_the_sun")]
    #[schema(minimum = 0, maximum = 20, default = 0.533)]
    pub angular_diameter_degrees: f32,
}

fn diameter_of_the_sun() -> f32 {
    0.533
}

/// A place on Earth and a moment, from which the daylight model takes sun and clear sky, in lux and
/// cd/m²; +X is east and −Z north. When the sun is down there is none, and the sky is that of dusk
/// or night.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct SunAtRequest {
    /// Degrees, north positive.
    #[schema(minimum = -90, maximum = 90, example = 48.1)]
    pub latitude: f64,
    /// Degrees, east positive.
    #[schema(minimum = -180, maximum = 180, example = 11.6)]
    pub longitude: f64,
    /// The moment, by RFC 3339.
    #[schema(value_type = String, format = DateTime, example = "2026-06-21T12:00:00Z")]
    #[serde(serialize_with = "instant::serialize")]
    pub time: Timestamp,
}

impl EnvironmentRequest {
    /// The id of the stored map that the sky is, if it is one.
    pub fn map(&self) -> Option<&str> {
        match &self.sky {
            Some(SkyRequest::Map(id)) => Some(id),
            _ => None,
        }
    }

    /// Tells what is beyond the API's limits, field by field.
    pub(super) fn problems(&self, wrong: &mut impl FnMut(&str, String)) {
        let mut amounts = |field: &str, three: [f32; 3]| {
            if !three.into_iter().all(|x| (0.0..=MOST_LIGHT).contains(&x)) {
                wrong(field, format!("must be three numbers from 0 to {MOST_LIGHT:e}"));
            }
        };
        if let Some(SkyRequest::Uniform(radiance)) = self.sky {
            amounts("environment.sky", radiance);
        }
        if let Some(sun) = self.sun {
            amounts("environment.sun.irradiance", sun.irradiance);
        }
        let mut within = |field: &str, x: f32, least: f32, most: f32| {
            if !(least..=most).contains(&x) {
                let detail = format!("must be between {least} and {most}, is {x}");
                wrong(&format!("environment.{field}"), detail);
            }
        };
        within("rotation_degrees", self.rotation_degrees, -MOST_TURN, MOST_TURN);
        within("scale", self.scale, 0.0, MOST_LIGHT);
        within("light_radius", self.light_radius, 0.0, MOST_RADIUS);
        if let Some(sun) = self.sun {
            let diameter = sun.angular_diameter_degrees;
            within("sun.angular_diameter_degrees", diameter, 0.0, MOST_DIAMETER);
        }
        let Some(at) = self.sun_at else { return };
        if self.sun.is_some() {
            wrong("environment.sun_at", "names the sun, and so does sun; leave one out".into());
        }
        for (field, degrees, most) in
            [("latitude", at.latitude, 90.0), ("longitude", at.longitude, 180.0)]
        {
            if !(-most..=most).contains(&degrees) {
                let detail = format!("must be between -{most} and {most}, is {degrees}");
                wrong(&format!("environment.sun_at.{field}"), detail);
            }
        }
        if !(0..=9999).contains(&at.time.to_zoned(TimeZone::UTC).year()) {
            let detail = "must be of the years 0000 to 9999".to_owned();
            wrong("environment.sun_at.time", detail);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::{Value, json};

    fn read(text: Value) -> EnvironmentRequest {
        serde_json::from_value(text).unwrap()
    }

    fn fields(request: Value) -> Vec<String> {
        let mut fields = Vec::new();
        read(request).problems(&mut |field, _| fields.push(field.to_owned()));
        fields
    }

    fn noon(latitude: f64, longitude: f64, time: &str) -> Value {
        json!({"latitude": latitude, "longitude": longitude, "time": time})
    }

    #[test]
    fn what_means_the_same_is_equal() {
        assert_eq!(read(json!({})), read(json!({"sky": "none"})));
        let at = noon(48.0, 11.0, "2026-06-21T12:00:00Z");
        let same = noon(48.0, 11.0, "2026-06-21T14:00:00.000+02:00");
        assert_eq!(read(json!({"sun_at": at})), read(json!({"sun_at": same})));
        // Without a sky, the moment's own.
        assert_ne!(read(json!({"sun_at": at})), read(json!({"sun_at": at, "sky": "none"})));
        let text = serde_json::to_value(read(json!({"sun_at": same}))).unwrap();
        assert_eq!(text["sun_at"]["time"], "2026-06-21T12:00:00.000Z");
        assert_eq!(read(text), read(json!({"sun_at": at})));
    }

    #[test]
    fn lights_have_a_radius_of_at_least_nothing() {
        assert!(fields(json!({"light_radius": 0.25})).is_empty());
        assert_eq!(fields(json!({"light_radius": -0.25})), ["environment.light_radius"]);
        assert_ne!(read(json!({})), read(json!({"light_radius": 0.25})));
    }

    #[test]
    fn places_and_moments_that_are_none_are_named() {
        let time = "2026-06-21T12:00:00Z";
        assert!(fields(json!({"sun_at": noon(-90.0, 180.0, time)})).is_empty());
        for (at, field) in [
            (noon(90.5, 0.0, time), "latitude"),
            (noon(0.0, -181.0, time), "longitude"),
            (noon(0.0, 0.0, "-000001-06-21T12:00:00Z"), "time"),
        ] {
            assert_eq!(fields(json!({"sun_at": at})), [format!("environment.sun_at.{field}")]);
        }
        let sun = json!({"direction": [0, 1, 0], "irradiance": [1, 1, 1]});
        let twice = json!({"sun": sun, "sun_at": noon(0.0, 0.0, time)});
        assert_eq!(fields(twice), ["environment.sun_at"]);
        for time in ["", "noon", "2026-06-21", "2026-06-21T12:00:00"] {
            let read = serde_json::from_value::<EnvironmentRequest>(
                json!({"sun_at": noon(0.0, 0.0, time)}),
            );
            assert!(read.is_err(), "{time}");
        }
    }
}
