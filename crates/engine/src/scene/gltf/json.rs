//! Path-aware reading of the JSON part: every refusal names the member it is about.

use crate::scene::SceneError;
use serde_json::{Map, Value};

/// What a sender can do about a file that breaks the format.
pub(super) const FIX_FILE: &str = "check the file with a glTF validator and export it again";

/// Longest piece of the file that a message or a name repeats, in characters.
const MAX_QUOTED_CHARS: usize = 100;

/// Most memory that the parsed JSON may take, bytes.
const MAX_PARSED_BYTES: usize = 512 << 20;

/// A JSON object and its place in the file.
#[derive(Clone)]
pub(super) struct Object<'a> {
    map: &'a Map<String, Value>,
    /// Path of the object; empty for the root.
    pub at: String,
}

/// A malformed input, to be mended by exporting the file again.
pub(super) fn malformed(at: impl Into<String>, what: impl Into<String>) -> SceneError {
    SceneError::malformed(at, what, FIX_FILE)
}

/// `text` shortened for messages and names.
pub(super) fn clip(text: &str) -> String {
    match text.char_indices().nth(MAX_QUOTED_CHARS) {
        Some((end, _)) => format!("{}…", &text[..end]),
        None => text.to_owned(),
    }
}

/// Parses the JSON part, refusing what would take too much memory before parsing it.
pub(super) fn parse(text: &[u8]) -> Result<Value, SceneError> {
    // An upper bound on what the parsed tree takes: a map allocates whole B-tree nodes and a list
    // at least four elements, so a hostile file could otherwise grow a hundredfold.
    let estimate = text.iter().fold(text.len(), |sum, byte| {
        sum.saturating_add(match byte {
            b'{' => 640,
            b':' | b'[' => 128,
            b',' => 64,
            _ => 0,
        })
    });
    if estimate > MAX_PARSED_BYTES {
        return Err(SceneError::too_large(
            "JSON",
            format!(
                "the JSON part may need {estimate} bytes once parsed; {MAX_PARSED_BYTES} are allowed"
            ),
            "send fewer nodes, meshes and accessors, or merge them",
        ));
    }
    serde_json::from_slice(text).map_err(|error| {
        malformed(
            format!("JSON, line {}, column {}", error.line(), error.column()),
            format!("not valid JSON: {}", clip(&error.to_string())),
        )
    })
}

impl<'a> Object<'a> {
    /// The root object.
    pub fn root(value: &'a Value) -> Result<Self, SceneError> {
        match value {
            Value::Object(map) => Ok(Self { map, at: String::new() }),
            _ => Err(malformed("JSON", "the root is not an object")),
        }
    }

    /// Path of a member.
    pub fn path(&self, key: &str) -> String {
        if self.at.is_empty() { key.to_owned() } else { format!("{}.{key}", self.at) }
    }

    fn get(&self, key: &str) -> Option<&'a Value> {
        self.map.get(key).filter(|value| !value.is_null())
    }

    /// Whether the member is there.
    pub fn has(&self, key: &str) -> bool {
        self.get(key).is_some()
    }

    fn wrong_type(&self, key: &str, expected: &str) -> SceneError {
        malformed(self.path(key), format!("expected {expected}"))
    }

    /// The refusal of a member that must be there.
    pub fn missing(&self, key: &str) -> SceneError {
        malformed(self.path(key), "is missing")
    }

    /// A member that is an object.
    pub fn object(&self, key: &str) -> Result<Option<Object<'a>>, SceneError> {
        match self.get(key) {
            None => Ok(None),
            Some(Value::Object(map)) => Ok(Some(Object { map, at: self.path(key) })),
            Some(_) => Err(self.wrong_type(key, "an object")),
        }
    }

    /// A member that is a list; empty when it is absent.
    fn list(&self, key: &str) -> Result<&'a [Value], SceneError> {
        match self.get(key) {
            None => Ok(&[]),
            Some(Value::Array(items)) => Ok(items),
            Some(_) => Err(self.wrong_type(key, "an array")),
        }
    }

    /// Length of a list; 0 when it is absent.
    pub fn count(&self, key: &str) -> Result<usize, SceneError> {
        Ok(self.list(key)?.len())
    }

    /// A list of objects; empty when it is absent.
    pub fn objects(&self, key: &str) -> Result<Vec<Object<'a>>, SceneError> {
        let path = self.path(key);
        self.list(key)?
            .iter()
            .enumerate()
            .map(|(index, item)| match item {
                Value::Object(map) => Ok(Object { map, at: format!("{path}[{index}]") }),
                _ => Err(malformed(format!("{path}[{index}]"), "expected an object")),
            })
            .collect()
    }

    /// A list of strings; empty when it is absent.
    pub fn strings(&self, key: &str) -> Result<Vec<&'a str>, SceneError> {
        self.list(key)?
            .iter()
            .enumerate()
            .map(|(index, item)| {
                item.as_str().ok_or_else(|| {
                    malformed(format!("{}[{index}]", self.path(key)), "expected a string")
                })
            })
            .collect()
    }

    /// A string.
    pub fn string(&self, key: &str) -> Result<Option<&'a str>, SceneError> {
        match self.get(key) {
            None => Ok(None),
            Some(Value::String(text)) => Ok(Some(text)),
            Some(_) => Err(self.wrong_type(key, "a string")),
        }
    }

    /// The object's `name`, shortened; `None` when it is absent or empty.
    pub fn name(&self) -> Result<Option<String>, SceneError> {
        Ok(self.string("name")?.filter(|name| !name.is_empty()).map(clip))
    }

    /// A boolean; `false` when it is absent.
    pub fn flag(&self, key: &str) -> Result<bool, SceneError> {
        match self.get(key) {
            None => Ok(false),
            Some(Value::Bool(value)) => Ok(*value),
            Some(_) => Err(self.wrong_type(key, "true or false")),
        }
    }

    /// A whole number ≥ 0.
    pub fn integer(&self, key: &str) -> Result<Option<u64>, SceneError> {
        let Some(value) = self.get(key) else { return Ok(None) };
        whole(value)
            .map(Some)
            .ok_or_else(|| self.wrong_type(key, "a whole number that is not negative"))
    }

    /// An index into a list of `count` things called `what`.
    pub fn index(&self, key: &str, count: usize, what: &str) -> Result<Option<usize>, SceneError> {
        match self.integer(key)? {
            None => Ok(None),
            Some(index) if index < count as u64 => Ok(Some(index as usize)),
            Some(index) => {
                Err(malformed(self.path(key), format!("{index}, but there are {count} {what}")))
            }
        }
    }

    /// A list of indices into a list of `count` things called `what`.
    pub fn indices(&self, key: &str, count: usize, what: &str) -> Result<Vec<usize>, SceneError> {
        self.list(key)?
            .iter()
            .enumerate()
            .map(|(place, item)| match whole(item) {
                Some(index) if index < count as u64 => Ok(index as usize),
                Some(index) => Err(malformed(
                    format!("{}[{place}]", self.path(key)),
                    format!("{index}, but there are {count} {what}"),
                )),
                None => Err(malformed(
                    format!("{}[{place}]", self.path(key)),
                    "expected a whole number that is not negative",
                )),
            })
            .collect()
    }

    /// A number.
    pub fn number(&self, key: &str) -> Result<Option<f64>, SceneError> {
        let Some(value) = self.get(key) else { return Ok(None) };
        value.as_f64().map(Some).ok_or_else(|| self.wrong_type(key, "a number"))
    }

    /// A list of exactly `N` numbers.
    pub fn numbers<const N: usize>(&self, key: &str) -> Result<Option<[f64; N]>, SceneError> {
        if !self.has(key) {
            return Ok(None);
        }
        let items = self.list(key)?;
        let mut numbers = [0.0; N];
        if items.len() != N {
            return Err(self.wrong_type(key, &format!("{N} numbers")));
        }
        for (number, item) in numbers.iter_mut().zip(items) {
            *number = item.as_f64().ok_or_else(|| self.wrong_type(key, &format!("{N} numbers")))?;
        }
        Ok(Some(numbers))
    }

    /// The object of an extension.
    pub fn extension(&self, name: &str) -> Result<Option<Object<'a>>, SceneError> {
        match self.object("extensions")? {
            Some(extensions) => extensions.object(name),
            None => Ok(None),
        }
    }
}

/// A whole number ≥ 0; exporters that write `4.0` are understood.
fn whole(value: &Value) -> Option<u64> {
    value.as_u64().or_else(|| {
        let number = value.as_f64()?;
        ((0.0..=9e15).contains(&number) && number.fract() == 0.0).then_some(number as u64)
    })
}
