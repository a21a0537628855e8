//! When two requests are the same one, for `Idempotency-Key`.
//!
//! The hash is over what the request says beyond the defaults, in one fixed form. So a repetition
//! matches whatever it spells out, and it still matches after an upgrade that gave requests another
//! field: a field at its default is not in the form. Earlier releases hashed all fields as they
//! were stored; their hashes are still recognised.

use super::jobs::JobRequest;
use crate::hash::sha256_hex;
use serde_json::{Map, Number, Value};
use std::collections::BTreeMap;

/// Names the form; a change of it gets another number, and this one goes on being recognised.
const FORM: &str = "v1:";
/// Objects in a request whose fields have defaults of their own. (In `options` and `labels` the
/// names are the client's.)
const NESTED: [&str; 4] = ["camera", "environment", "snapshots", "webhook"];
/// What tells requests under the same `Idempotency-Key` apart.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct RequestHash {
    /// What is stored with the job.
    pub now: String,
    /// What earlier releases stored with the same request.
    pub former: String,
}

impl RequestHash {
    /// The hashes of a request.
    ///
    /// # Errors
    /// Where the request does not serialise.
    pub fn of(job: &JobRequest) -> Result<Self, serde_json::Error> {
        let whole = canonical(job)?;
        // Fields that came later are left out of this where they have their defaults; where they
        // do not, no earlier release has stored the like.
        let former = sha256_hex(&serde_json::to_vec(job)?);
        let mut text = String::new();
        write(&mut text, &Value::Object(whole));
        Ok(Self { now: format!("{FORM}{}", sha256_hex(text.as_bytes())), former })
    }

    /// Whether `stored` is the hash of the same request.
    pub fn matches(&self, stored: &str) -> bool {
        self.now == stored || self.former == stored
    }
}

/// What a request says: without the fields that might as well be left out.
fn canonical(job: &JobRequest) -> Result<Map<String, Value>, serde_json::Error> {
    let Value::Object(mut whole) = serde_json::to_value(job)? else { return Ok(Map::new()) };
    // As it reads back: secrets are never written.
    let same: JobRequest = serde_json::from_value(Value::Object(whole.clone()))?;
    let means_the_same = |whole: &Map<String, Value>| {
        let read = serde_json::from_value::<JobRequest>(Value::Object(whole.clone()));
        read.is_ok_and(|read| read == same)
    };
    let names: Vec<String> = whole.keys().cloned().collect();
    for name in names {
        let mut without = whole.clone();
        without.remove(&name);
        if means_the_same(&without) {
            whole = without;
        }
    }
    for outer in NESTED {
        let inner = whole.get(outer).and_then(Value::as_object);
        let names: Vec<String> = inner.into_iter().flat_map(Map::keys).cloned().collect();
        for name in names {
            let mut without = whole.clone();
            without.get_mut(outer).and_then(Value::as_object_mut).map(|inner| inner.remove(&name));
            if means_the_same(&without) {
                whole = without;
            }
        }
    }
    Ok(whole)
}

/// Writes a value in the one form: names in order, numbers alike however they were spelt.
fn write(text: &mut String, value: &Value) {
    match value {
        Value::Object(members) => {
            let members: BTreeMap<_, _> = members.iter().collect();
            text.push('{');
            for (name, value) in members {
                text.push_str(&Value::from(name.as_str()).to_string());
                text.push(':');
                write(text, value);
                text.push(',');
            }
            text.push('}');
        }
        Value::Array(items) => {
            text.push('[');
            for item in items {
                write(text, item);
                text.push(',');
            }
            text.push(']');
        }
        Value::Number(number) => text.push_str(&plain(number)),
        other => text.push_str(&other.to_string()),
    }
}

/// 1, 1.0 and 1e0 are the same number.
fn plain(number: &Number) -> String {
    const EXACT: f64 = 9_007_199_254_740_992.0;
    match number.as_f64() {
        Some(x) if !number.is_i64() && !number.is_u64() && x.fract() == 0.0 && x.abs() < EXACT => {
            (x as i64).to_string()
        }
        _ => number.to_string(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    fn hash(request: Value) -> RequestHash {
        RequestHash::of(&serde_json::from_value(request).unwrap()).unwrap()
    }

    fn form(request: Value) -> String {
        let mut text = String::new();
        let job = serde_json::from_value(request).unwrap();
        write(&mut text, &Value::Object(canonical(&job).unwrap()));
        text
    }

    /// A fixed request has a fixed hash: who changes this breaks repetitions across an upgrade,
    /// and has to keep the former form beside the new one.
    #[test]
    fn the_form_and_its_hash_stay_as_they_are() {
        let request = json!({
            "scene": "cornell", "width": 64, "height": 512, "time_budget_s": 1.5, "priority": 0,
            "options": {"patches": 2e2, "word": "x"}, "labels": {"b": "1", "a": "2"},
            "camera": {"eye": [0, 0, 2], "target": [0, 0.5, 0], "yfov_degrees": 40,
                       "up": [0, 1, 0]},
            "snapshots": {"every_s": 2.0, "formats": ["png"]},
            "webhook": {"url": "https://example.org/", "secret": "0123456789abcdef"},
        });
        assert_eq!(
            form(request.clone()),
            r#"{"camera":{"eye":[0,0,2,],"target":[0,0.5,0,],"yfov_degrees":40,},"labels":{"a":"2","b":"1",},"options":{"patches":200,"word":"x",},"scene":"cornell","snapshots":{"every_s":2,},"time_budget_s":1.5,"webhook":{"url":"https://example.org/",},"width":64,}"#
        );
        assert_eq!(
            hash(request).now,
            "v1:e0f03dade0ddec0b04ef966f6c40efdfdd9c6c3683c5d2eb9672d8caf468b40d"
        );
        assert_eq!(form(json!({})), "{}");
    }

    /// As the release before this form hashed it: the JSON is what it stored. Where this fails since
    /// requests have another field, have that left out where it is at its default.
    #[test]
    fn hashes_of_earlier_releases_are_recognised() {
        let stored = r#"{"scene":"cornell","method":"auto","camera":null,"width":64,"height":64,"target_error":null,"time_budget_s":1.0,"max_iterations":null,"seed":0,"snapshots":null,"options":{},"priority":0,"labels":{},"webhook":null}"#;
        let hash = hash(json!({"scene": "cornell", "width": 64, "height": 64, "time_budget_s": 1}));
        assert!(hash.matches(&sha256_hex(stored.as_bytes())), "{hash:?}");
        assert!(hash.matches(&hash.now.clone()) && !hash.matches("") && !hash.matches("v1:"));
    }

    #[test]
    fn what_is_spelt_differently_is_the_same_and_what_differs_is_not() {
        let plain = hash(json!({"scene": "cornell", "time_budget_s": 1}));
        for same in [
            json!({"time_budget_s": 1.0, "scene": "cornell"}),
            json!({"scene": "cornell", "time_budget_s": 1e0, "width": 512, "seed": 0,
                   "method": "auto", "camera": null, "labels": {}, "fresh": false}),
        ] {
            assert_eq!(hash(same).now, plain.now);
        }
        for other in [
            json!({"scene": "cornell", "time_budget_s": 1.5}),
            json!({"scene": "cornell", "time_budget_s": 1, "width": 511}),
            json!({"scene": "cornell", "time_budget_s": 1, "labels": {"a": ""}}),
            json!({"scene": "cornell", "time_budget_s": 1, "options": {"patches": 1}}),
            json!({"scene": "cornell", "time_budget_s": 1, "camera": 0}),
            json!({"scene": "cornell", "time_budget_s": 1, "webhook": {"url": "http://a.b/"}}),
        ] {
            assert_ne!(hash(other.clone()).now, plain.now, "{other}");
        }
    }
}
