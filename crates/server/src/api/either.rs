//! Reading fields that may be of several kinds. By hand: what serde derives for them forgets which
//! part was wrong, and a client is to hear which.

use super::environment::{MapOfSky, SkyRequest};
use super::jobs::{CameraRequest, ExplicitCamera, OptionValue};
use super::parts::PartRequest;
use super::shown::BackgroundRequest;
use serde::de::value::{MapAccessDeserializer, SeqAccessDeserializer};
use serde::de::{Deserialize, Deserializer, Error, MapAccess, SeqAccess, Unexpected, Visitor};
use std::fmt;

/// What a camera may be, for errors.
const A_CAMERA: &str =
    "the index of a camera, the name of one, or an object with eye, target and yfov_degrees";
/// What names a part of a file, for errors.
const A_PART: &str = "the index of one in the file, or the name of one";
/// What a sky may be, for errors.
const A_SKY: &str =
    "\"none\", \"studio\", an array of three radiances, or an object with the id of an environment";

/// What a background may be, for errors.
const A_BACKGROUND: &str = "\"sky\", \"transparent\", or an array of three radiances";

fn index<E: Error>(number: u64) -> Result<u32, E> {
    let unfit = |_| E::invalid_value(Unexpected::Unsigned(number), &"an index below 4294967296");
    number.try_into().map_err(unfit)
}

fn signed_index<E: Error>(number: i64) -> Result<u32, E> {
    let unfit = |_| E::invalid_value(Unexpected::Signed(number), &"an index from 0 on");
    u64::try_from(number).map_err(unfit).and_then(index)
}

impl<'de> Deserialize<'de> for PartRequest {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        deserializer.deserialize_any(PartVisitor)
    }
}

struct PartVisitor;

impl Visitor<'_> for PartVisitor {
    type Value = PartRequest;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(A_PART)
    }

    fn visit_u64<E: Error>(self, number: u64) -> Result<Self::Value, E> {
        index(number).map(PartRequest::Index)
    }

    fn visit_i64<E: Error>(self, number: i64) -> Result<Self::Value, E> {
        signed_index(number).map(PartRequest::Index)
    }

    fn visit_str<E: Error>(self, name: &str) -> Result<Self::Value, E> {
        Ok(PartRequest::Name(name.to_owned()))
    }

    fn visit_string<E: Error>(self, name: String) -> Result<Self::Value, E> {
        Ok(PartRequest::Name(name))
    }
}

impl<'de> Deserialize<'de> for CameraRequest {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        deserializer.deserialize_any(CameraVisitor)
    }
}

struct CameraVisitor;

impl<'de> Visitor<'de> for CameraVisitor {
    type Value = CameraRequest;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(A_CAMERA)
    }

    fn visit_u64<E: Error>(self, number: u64) -> Result<Self::Value, E> {
        index(number).map(CameraRequest::Index)
    }

    fn visit_i64<E: Error>(self, number: i64) -> Result<Self::Value, E> {
        signed_index(number).map(CameraRequest::Index)
    }

    fn visit_str<E: Error>(self, name: &str) -> Result<Self::Value, E> {
        Ok(CameraRequest::Name(name.to_owned()))
    }

    fn visit_string<E: Error>(self, name: String) -> Result<Self::Value, E> {
        Ok(CameraRequest::Name(name))
    }

    fn visit_map<A: MapAccess<'de>>(self, fields: A) -> Result<Self::Value, A::Error> {
        ExplicitCamera::deserialize(MapAccessDeserializer::new(fields)).map(CameraRequest::Explicit)
    }
}

impl<'de> Deserialize<'de> for SkyRequest {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        deserializer.deserialize_any(SkyVisitor)
    }
}

struct SkyVisitor;

impl<'de> Visitor<'de> for SkyVisitor {
    type Value = SkyRequest;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(A_SKY)
    }

    fn visit_str<E: Error>(self, word: &str) -> Result<Self::Value, E> {
        let known = [SkyRequest::None, SkyRequest::Studio];
        let sky = known.into_iter().find(|sky| sky.word() == Some(word));
        sky.ok_or_else(|| E::invalid_value(Unexpected::Str(word), &A_SKY))
    }

    fn visit_seq<A: SeqAccess<'de>>(self, items: A) -> Result<Self::Value, A::Error> {
        <[f32; 3]>::deserialize(SeqAccessDeserializer::new(items)).map(SkyRequest::Uniform)
    }

    fn visit_map<A: MapAccess<'de>>(self, fields: A) -> Result<Self::Value, A::Error> {
        let map = MapOfSky::deserialize(MapAccessDeserializer::new(fields))?;
        Ok(SkyRequest::Map(map.environment))
    }
}

impl<'de> Deserialize<'de> for BackgroundRequest {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        deserializer.deserialize_any(BackgroundVisitor)
    }
}

struct BackgroundVisitor;

impl<'de> Visitor<'de> for BackgroundVisitor {
    type Value = BackgroundRequest;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(A_BACKGROUND)
    }

    fn visit_str<E: Error>(self, word: &str) -> Result<Self::Value, E> {
        let known = [BackgroundRequest::Sky, BackgroundRequest::Transparent];
        let background = known.into_iter().find(|background| background.word() == Some(word));
        background.ok_or_else(|| E::invalid_value(Unexpected::Str(word), &A_BACKGROUND))
    }

    fn visit_seq<A: SeqAccess<'de>>(self, items: A) -> Result<Self::Value, A::Error> {
        let radiance = <[f32; 3]>::deserialize(SeqAccessDeserializer::new(items));
        radiance.map(BackgroundRequest::Colour)
    }
}

impl<'de> Deserialize<'de> for OptionValue {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        deserializer.deserialize_any(OptionVisitor)
    }
}

struct OptionVisitor;

impl Visitor<'_> for OptionVisitor {
    type Value = OptionValue;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("a number, true, false or a word")
    }

    fn visit_bool<E: Error>(self, value: bool) -> Result<Self::Value, E> {
        Ok(OptionValue::Switch(value))
    }

    fn visit_u64<E: Error>(self, value: u64) -> Result<Self::Value, E> {
        Ok(OptionValue::Number(value.into()))
    }

    fn visit_i64<E: Error>(self, value: i64) -> Result<Self::Value, E> {
        Ok(OptionValue::Number(value.into()))
    }

    fn visit_f64<E: Error>(self, value: f64) -> Result<Self::Value, E> {
        let number = serde_json::Number::from_f64(value).map(OptionValue::Number);
        number.ok_or_else(|| E::invalid_value(Unexpected::Float(value), &"a finite number"))
    }

    fn visit_str<E: Error>(self, value: &str) -> Result<Self::Value, E> {
        Ok(OptionValue::Word(value.to_owned()))
    }

    fn visit_string<E: Error>(self, value: String) -> Result<Self::Value, E> {
        Ok(OptionValue::Word(value))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::{Value, json};

    #[test]
    fn every_kind_is_read_and_written_back() {
        let camera = json!({"eye": [0.5, 0.5, 2.0], "target": [0.0, 0.0, 0.0],
                            "up": [0.0, 1.0, 0.0], "yfov_degrees": 40.0});
        for value in [json!(0), json!(u32::MAX), json!("front"), json!(""), camera] {
            let read: CameraRequest = serde_json::from_value(value.clone()).unwrap();
            assert_eq!(serde_json::to_value(read).unwrap(), value);
            let read: CameraRequest = serde_json::from_str(&value.to_string()).unwrap();
            assert_eq!(serde_json::to_value(read).unwrap(), value);
        }
        for value in [json!(0), json!(u32::MAX), json!("walk"), json!("")] {
            let read: PartRequest = serde_json::from_str(&value.to_string()).unwrap();
            assert_eq!(serde_json::to_value(read).unwrap(), value);
        }
        for value in
            [json!("none"), json!("studio"), json!([0.5, 1.0, 2.0]), json!({"environment": "ab"})]
        {
            let read: SkyRequest = serde_json::from_str(&value.to_string()).unwrap();
            assert_eq!(serde_json::to_value(read).unwrap(), value);
        }
        for value in [json!("sky"), json!("transparent"), json!([0.5, 1.0, 2.0])] {
            let read: BackgroundRequest = serde_json::from_str(&value.to_string()).unwrap();
            assert_eq!(serde_json::to_value(read).unwrap(), value);
        }
        for value in [json!(true), json!(3), json!(-3), json!(0.25), json!("auto")] {
            let read: OptionValue = serde_json::from_str(&value.to_string()).unwrap();
            assert_eq!(serde_json::to_value(read).unwrap(), value);
        }
    }

    #[test]
    fn errors_say_what_would_be_right() {
        let camera =
            |value: Value| serde_json::from_value::<CameraRequest>(value).unwrap_err().to_string();
        for value in [json!(true), json!([1]), json!(1.5)] {
            assert!(camera(value.clone()).contains(A_CAMERA), "{value}");
        }
        assert!(camera(json!(-1)).contains("an index from 0 on"));
        assert!(camera(json!(1_u64 << 32)).contains("below 4294967296"));
        assert!(camera(json!({"eye": [0, 0, 0]})).contains("missing field `target`"));
        assert!(camera(json!({"fov": 1})).contains("unknown field `fov`, expected one of `eye`"));
        for value in [json!(true), json!([1]), json!(1.5), json!({}), json!(null)] {
            let error = serde_json::from_value::<PartRequest>(value).unwrap_err().to_string();
            assert!(error.contains(A_PART), "{error}");
        }
        let error = serde_json::from_value::<PartRequest>(json!(-1)).unwrap_err().to_string();
        assert!(error.contains("an index from 0 on"), "{error}");
        let sky = |value: Value| serde_json::from_value::<SkyRequest>(value).unwrap_err();
        for value in [json!(null), json!("blue"), json!(1)] {
            assert!(sky(value.clone()).to_string().contains(A_SKY), "{value}");
        }
        assert!(sky(json!({})).to_string().contains("missing field `environment`"));
        assert!(sky(json!([1, 2])).to_string().contains("array of length 3"));
        for value in [json!(null), json!("blue"), json!(1), json!({})] {
            let error = serde_json::from_value::<BackgroundRequest>(value).unwrap_err().to_string();
            assert!(error.contains(A_BACKGROUND), "{error}");
        }
        for value in [json!(null), json!([1]), json!({})] {
            let error = serde_json::from_value::<OptionValue>(value).unwrap_err().to_string();
            assert!(error.contains("a number, true, false or a word"), "{error}");
        }
    }
}
