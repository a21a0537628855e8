//! What a scene's file offers to choose from beside cameras and materials: the animations and the
//! scenes in it.

use serde::{Deserialize, Serialize};
use utoipa::openapi::schema::{ObjectBuilder, OneOfBuilder, Type};
use utoipa::openapi::{RefOr, Schema};
use utoipa::{PartialSchema, ToSchema};

/// Longest name of an animation or a scene in a request, characters.
pub(super) const MAX_PART_CHARS: usize = 1024;
/// Most entries that a message lists.
const MAX_LISTED: usize = 32;

/// One of a list in the file.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
#[serde(untagged)]
pub enum PartRequest {
    /// By position in the file.
    Index(u32),
    /// By name; the first of several that share it.
    Name(String),
}

impl PartialSchema for PartRequest {
    fn schema() -> RefOr<Schema> {
        let index = ObjectBuilder::new()
            .schema_type(Type::Integer)
            .minimum(Some(0))
            .maximum(Some(u32::MAX));
        let name = ObjectBuilder::new().schema_type(Type::String).max_length(Some(MAX_PART_CHARS));
        OneOfBuilder::new()
            .description(Some("Index of one in the file, or its name."))
            .item(index)
            .item(name)
            .into()
    }
}

impl ToSchema for PartRequest {}

/// An animation that a job can name.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct AnimationName {
    /// Position in the file.
    pub index: u32,
    /// Name in the file; `null` where it has none.
    #[schema(required, example = "walk")]
    pub name: Option<String>,
    /// When its last key is, seconds; from then on nothing moves.
    pub seconds: f32,
}

/// A scene of the file that a job can name.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct SceneName {
    /// Position in the file.
    pub index: u32,
    /// Name in the file; `null` where it has none.
    #[schema(required, example = "night")]
    pub name: Option<String>,
}

impl PartRequest {
    /// Where in the file what is asked for is; `None` where it is not.
    pub(super) fn position(&self, names: &[Option<&str>]) -> Option<u32> {
        match self {
            Self::Index(index) => Some(*index).filter(|index| (*index as usize) < names.len()),
            Self::Name(wanted) => {
                let found = names.iter().position(|name| *name == Some(wanted));
                found.map(|index| index as u32)
            }
        }
    }

    /// Whether a file has what is asked for, which is a `what`; the message if not.
    pub(super) fn problem(&self, what: &str, names: &[Option<&str>]) -> Option<String> {
        if self.position(names).is_some() {
            return None;
        }
        let asked = match self {
            Self::Index(index) => format!("index {index}, but"),
            Self::Name(name) => format!("no {what} named {name:?};"),
        };
        let listed: Vec<_> = names.iter().zip(0..).take(MAX_LISTED).collect();
        let listed = listed.iter().map(|(name, index)| match name {
            Some(name) => format!("{index} {name:?}"),
            None => index.to_string(),
        });
        let listed = listed.collect::<Vec<_>>().join(", ");
        Some(format!("{asked} the file has {} of them: [{listed}]", names.len()))
    }
}
