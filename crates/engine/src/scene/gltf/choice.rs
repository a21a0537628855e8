//! How one of a file's animations or scenes is chosen: both are lists whose names are optional.

use super::document::clip;
use crate::scene::SceneError;

/// Most entries that a message lists.
const MAX_LISTED: usize = 20;

/// One of a list of the file.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Choice {
    /// By its place in the list, from 0.
    Index(u32),
    /// By its name; the first of several that share it.
    Name(String),
    /// By its name, or else by its place where the word is a number: a name goes first, so that
    /// what is called "2" can be chosen.
    Word(String),
}

impl Choice {
    /// The place of what is chosen; `one` says what it is, `list` where the file has all of them.
    pub(super) fn find(
        &self,
        list: &str,
        one: &str,
        names: &[Option<&str>],
    ) -> Result<usize, SceneError> {
        let named = |wanted: &str| names.iter().position(|name| *name == Some(wanted));
        let placed = |place: u32| Some(place as usize).filter(|place| *place < names.len());
        let found = match self {
            Self::Index(place) => placed(*place),
            Self::Name(name) => named(name),
            Self::Word(word) => named(word).or_else(|| placed(word.parse().ok()?)),
        };
        found.ok_or_else(|| {
            let asked = match self {
                Self::Index(place) => place.to_string(),
                Self::Name(name) | Self::Word(name) => format!("{:?}", clip(name)),
            };
            SceneError::malformed(
                list,
                format!("the file has no {one} {asked}; there are: {}", listed(names)),
                "choose one of these by its name or index, or none",
            )
        })
    }
}

/// What there is to choose from, in a message's words.
fn listed(names: &[Option<&str>]) -> String {
    let entry = |(place, name): (usize, &Option<&str>)| match name {
        Some(name) => format!("{place} {:?}", clip(name)),
        None => place.to_string(),
    };
    let mut entries: Vec<_> = names.iter().enumerate().take(MAX_LISTED).map(entry).collect();
    if names.len() > MAX_LISTED {
        entries.push("…".into());
    }
    if entries.is_empty() { "none".into() } else { entries.join(", ") }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_go_before_places_and_errors_list_what_there_is() {
        let names = [Some("walk"), None, Some("0"), Some("walk")];
        let find = |choice: Choice| choice.find("animations", "animation", &names);
        for (choice, place) in [
            (Choice::Index(1), 1),
            (Choice::Name("walk".into()), 0),
            (Choice::Word("walk".into()), 0),
            (Choice::Word("0".into()), 2),
            (Choice::Word("3".into()), 3),
        ] {
            assert_eq!(find(choice.clone()).unwrap(), place, "{choice:?}");
        }
        for (choice, asked) in [
            (Choice::Index(4), "4"),
            (Choice::Name("1".into()), "\"1\""),
            (Choice::Word("4".into()), "\"4\""),
            (Choice::Word("run".into()), "\"run\""),
        ] {
            let error = find(choice).unwrap_err();
            let there = r#"0 "walk", 1, 2 "0", 3 "walk""#;
            let what = format!("the file has no animation {asked}; there are: {there}");
            assert_eq!((error.at.as_str(), error.what), ("animations", what));
        }
        let error = Choice::Index(0).find("scenes", "scene", &[]).unwrap_err();
        assert!(error.what.ends_with("there are: none"), "{error}");
        let many = vec![None; 30];
        let error = Choice::Index(30).find("scenes", "scene", &many).unwrap_err();
        assert!(error.what.ends_with("18, 19, …"), "{error}");
    }
}
