//! What a job's picture shows beside the surfaces, and what its numbers are.

use super::environment::EnvironmentRequest;
use serde::{Deserialize, Serialize};
use utoipa::openapi::schema::{ArrayBuilder, ObjectBuilder, OneOfBuilder, Type};
use utoipa::openapi::{RefOr, Schema};
use utoipa::{PartialSchema, ToSchema};

/// Largest radiance of a background.
const MOST_RADIANCE: f32 = 1e12;

/// What the camera sees beside the surfaces; light is the same with any.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum BackgroundRequest {
    /// The sky and the sun.
    #[default]
    Sky,
    /// Nothing: PNG and EXR have an alpha channel.
    Transparent,
    /// Linear RGB radiance.
    Colour([f32; 3]),
}

impl BackgroundRequest {
    /// The word for it, where there is one.
    pub(super) fn word(self) -> Option<&'static str> {
        match self {
            Self::Sky => Some("sky"),
            Self::Transparent => Some("transparent"),
            Self::Colour(_) => None,
        }
    }

    /// Whether it is what requests have that say nothing of it.
    pub fn is_default(&self) -> bool {
        *self == Self::default()
    }

    /// Tells what is beyond the API's limits.
    pub(super) fn problems(self, wrong: &mut impl FnMut(&str, String)) {
        if let Self::Colour(radiance) = self
            && !radiance.into_iter().all(|x| (0.0..=MOST_RADIANCE).contains(&x))
        {
            wrong("background", format!("must be three numbers from 0 to {MOST_RADIANCE:e}"));
        }
    }
}

impl Serialize for BackgroundRequest {
    fn serialize<S: serde::Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        match self {
            Self::Colour(radiance) => radiance.serialize(serializer),
            other => serializer.serialize_str(other.word().unwrap_or_default()),
        }
    }
}

impl PartialSchema for BackgroundRequest {
    fn schema() -> RefOr<Schema> {
        let words = ObjectBuilder::new()
            .schema_type(Type::String)
            .enum_values(Some([Self::Sky, Self::Transparent].into_iter().filter_map(Self::word)));
        let amount = ObjectBuilder::new()
            .schema_type(Type::Number)
            .minimum(Some(0))
            .maximum(Some(1_000_000_000_000_u64));
        let radiance = ArrayBuilder::new().items(amount).min_items(Some(3)).max_items(Some(3));
        OneOfBuilder::new()
            .description(Some(
                "What the camera sees beside the surfaces: the `sky` with its sun, nothing \
                 (`transparent`: PNG and EXR get an alpha channel, the share of the pixel that \
                 surfaces cover, straight in PNG and premultiplied in EXR), or a linear RGB \
                 radiance. Light, mirrors and glass are the same with any.",
            ))
            .item(words)
            .item(radiance)
            .into()
    }
}

impl ToSchema for BackgroundRequest {}

/// What the numbers of a scene, and so of the EXR, are; nothing is converted.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum UnitsRequest {
    /// Candela, lux and cd/m², as glTF has it; the EXR's header has `whiteLuminance` 1.
    #[default]
    Photometric,
    /// W/sr, W/m² and W/(m² sr); the EXR's header has no `whiteLuminance`.
    Radiometric,
}

impl UnitsRequest {
    /// Whether it is what requests have that say nothing of it.
    pub fn is_default(&self) -> bool {
        *self == Self::default()
    }

    /// Tells where light comes in other units.
    pub(super) fn problems(
        self,
        environment: Option<&EnvironmentRequest>,
        wrong: &mut impl FnMut(&str, String),
    ) {
        let has_day = environment.is_some_and(|around| around.sun_at.is_some());
        if has_day && self == Self::Radiometric {
            wrong("units", "environment.sun_at gives light in lux, which is photometric".into());
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    #[test]
    fn what_is_no_radiance_and_units_that_differ_are_named() {
        let fields = |background: BackgroundRequest, units: UnitsRequest, around| {
            let around: EnvironmentRequest = serde_json::from_value(around).unwrap();
            let mut fields = Vec::new();
            let mut wrong = |field: &str, _| fields.push(field.to_owned());
            background.problems(&mut wrong);
            units.problems(Some(&around), &mut wrong);
            fields
        };
        let (sky, photometric) = Default::default();
        assert!(fields(sky, photometric, json!({})).is_empty());
        assert!(fields(sky, UnitsRequest::Radiometric, json!({})).is_empty());
        for bad in [[-1.0, 0.0, 0.0], [f32::NAN; 3], [1e13, 0.0, 0.0]] {
            let colour = BackgroundRequest::Colour(bad);
            assert_eq!(fields(colour, photometric, json!({})), ["background"]);
        }
        let day =
            json!({"sun_at": {"latitude": 48, "longitude": 11, "time": "2026-06-21T12:00:00Z"}});
        assert!(fields(sky, photometric, day.clone()).is_empty());
        assert_eq!(fields(sky, UnitsRequest::Radiometric, day), ["units"]);
    }
}
