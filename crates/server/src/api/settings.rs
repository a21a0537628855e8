//! The settings of the methods, as the API's description, the dashboard and the command line list
//! them.

use serde::Serialize;
use utoipa::openapi::schema::{ObjectBuilder, OneOfBuilder, Schema, Type};

/// A setting of a method.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Setting {
    /// The method.
    pub method: &'static str,
    /// What it is called within the method.
    pub name: &'static str,
    /// Its default value, as text.
    pub default: &'static str,
    /// Its values other than words.
    #[serde(flatten)]
    pub values: Values,
    /// The words among its values.
    pub words: Vec<&'static str>,
    /// All of that in words.
    pub range: String,
    /// What its numbers count or measure; empty where it has none.
    pub unit: &'static str,
    /// What it does.
    pub meaning: &'static str,
    /// Whether the API takes it; the command line takes the others, too.
    #[serde(skip)]
    pub public: bool,
}

/// Values of a setting other than words.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
#[serde(tag = "values", rename_all = "snake_case")]
pub enum Values {
    /// Whole numbers in a range.
    Whole {
        /// The least.
        low: u64,
        /// The greatest.
        high: u64,
        /// Their step.
        step: u64,
    },
    /// Numbers in a range.
    Number {
        /// The least.
        low: f64,
        /// The greatest.
        high: f64,
    },
    /// True and false.
    Switch,
    /// None.
    Words,
}

impl Setting {
    /// Its values in the API's description.
    pub fn schema(&self) -> Schema {
        let description = match self.values {
            Values::Switch | Values::Words => format!("{}.", self.meaning),
            _ => format!("{}; {}; in {}.", self.meaning, self.range, self.unit),
        };
        let words = |builder: ObjectBuilder| {
            builder.schema_type(Type::String).enum_values(Some(self.words.iter().copied()))
        };
        let numbers = match self.values {
            Values::Whole { low, high, step } => {
                let whole = ObjectBuilder::new().schema_type(Type::Integer);
                let whole = whole.minimum(Some(low as f64)).maximum(Some(high as f64));
                whole.multiple_of((step > 1).then_some(step as f64))
            }
            Values::Number { low, high } => {
                let number = ObjectBuilder::new().schema_type(Type::Number);
                number.minimum(Some(low)).maximum(Some(high))
            }
            Values::Switch => ObjectBuilder::new().schema_type(Type::Boolean),
            Values::Words => words(ObjectBuilder::new()),
        };
        let default = Some(self.default_value());
        if self.words.is_empty() || self.values == Values::Words {
            return numbers.description(Some(description)).default(default).build().into();
        }
        let either = OneOfBuilder::new().item(numbers).item(words(ObjectBuilder::new()));
        either.description(Some(description)).default(default).build().into()
    }

    /// Its default as JSON.
    fn default_value(&self) -> serde_json::Value {
        match (self.values, self.default) {
            (_, word) if self.words.contains(&word) => word.into(),
            (_, text) => serde_json::from_str(text).unwrap_or_else(|_| text.into()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    fn setting(default: &'static str, values: Values, words: &[&'static str]) -> Setting {
        Setting {
            method: "made-up",
            name: "rays",
            default,
            values,
            words: words.to_vec(),
            range: "a range".into(),
            unit: "rays",
            meaning: "rays of something",
            public: true,
        }
    }

    #[test]
    fn schemas_say_the_types_of_values() {
        let schema = |setting: Setting| serde_json::to_value(setting.schema()).unwrap();
        let whole = schema(setting("64", Values::Whole { low: 4, high: 128, step: 2 }, &[]));
        assert_eq!(
            whole,
            json!({"type": "integer", "minimum": 4, "maximum": 128, "multipleOf": 2, "default": 64,
                   "description": "rays of something; a range; in rays."})
        );
        let switch = schema(setting("true", Values::Switch, &[]));
        assert_eq!((&switch["type"], &switch["default"]), (&json!("boolean"), &json!(true)));
        let words = schema(setting("a", Values::Words, &["a", "b"]));
        assert_eq!((&words["type"], &words["enum"]), (&json!("string"), &json!(["a", "b"])));
        let either = schema(setting("auto", Values::Whole { low: 1, high: 9, step: 1 }, &["auto"]));
        assert_eq!(
            (&either["oneOf"][1]["enum"], &either["default"]),
            (&json!(["auto"]), &json!("auto"))
        );
        let number = schema(setting("0.3", Values::Number { low: 0.0, high: 1.0 }, &[]));
        assert_eq!((&number["type"], &number["default"]), (&json!("number"), &json!(0.3)));
    }
}
