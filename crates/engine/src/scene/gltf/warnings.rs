//! Warnings of one import.

use crate::scene::Warning;
use std::collections::HashMap;

/// Most warnings that a scene carries; a last one counts the rest.
pub const MAX_WARNINGS: usize = 200;

/// How often the same is said, each time of another place; of more there is only the number.
pub const MAX_ALIKE: usize = 3;

/// Warnings of one import, bounded in number.
#[derive(Default)]
pub struct Warnings {
    list: Vec<Warning>,
    /// By what is said: how often, and where in the list the last of them is.
    alike: HashMap<String, (usize, usize)>,
    left_out: usize,
}

impl Warnings {
    /// Adds a warning of `what` is lost `at` a place in the file.
    pub fn push(&mut self, at: impl Into<String>, what: impl Into<String>) {
        let what = what.into();
        let is_full = self.list.len() >= MAX_WARNINGS;
        let place = self.list.len();
        match self.alike.get_mut(&what) {
            Some((count, _)) if *count >= MAX_ALIKE => {
                *count += 1;
                return;
            }
            _ if is_full => {
                self.left_out += 1;
                return;
            }
            Some((count, last)) => (*count, *last) = (*count + 1, place),
            None => {
                self.alike.insert(what.clone(), (1, place));
            }
        }
        self.list.push(Warning::new(at, what));
    }

    /// These, or where there are none, the others.
    pub fn or(self, others: Self) -> Self {
        if self.list.is_empty() { others } else { self }
    }

    /// Adds those of a part of the import.
    pub fn append(&mut self, part: Self) {
        for Warning { at, what } in part.list {
            self.push(at, what);
        }
        // What it only counted is at more places than it lists.
        for (what, (count, _)) in part.alike {
            let more = count.saturating_sub(MAX_ALIKE);
            match self.alike.get_mut(&what) {
                Some((count, _)) => *count += more,
                None => self.left_out += more,
            }
        }
        self.left_out += part.left_out;
    }

    /// All of them.
    pub fn finish(mut self) -> Vec<Warning> {
        for (count, last) in self.alike.into_values() {
            let more = count.saturating_sub(MAX_ALIKE);
            if more > 0 {
                let what = &mut self.list[last].what;
                let places = if more == 1 { "place" } else { "places" };
                *what = format!("{what} (the same at {more} more {places})");
            }
        }
        if self.left_out > 0 {
            let what = format!("{} more warnings are left out", self.left_out);
            self.list.push(Warning::new("file", what));
        }
        self.list
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn said(warnings: Warnings) -> Vec<(String, String)> {
        warnings.finish().into_iter().map(|Warning { at, what }| (at, what)).collect()
    }

    fn pair(at: &str, what: &str) -> (String, String) {
        (at.to_owned(), what.to_owned())
    }

    #[test]
    fn the_same_is_said_thrice_and_then_counted() {
        let mut warnings = Warnings::default();
        for place in 0..5 {
            warnings.push(format!("a{place}"), "is lost");
            if place < 3 {
                warnings.push(format!("b{place}"), "is approximated");
            }
        }
        let mut part = Warnings::default();
        for place in 0..7 {
            part.push(format!("c{place}"), "is lost");
        }
        warnings.append(part);
        let expected = [
            pair("a0", "is lost"),
            pair("b0", "is approximated"),
            pair("a1", "is lost"),
            pair("b1", "is approximated"),
            pair("a2", "is lost (the same at 9 more places)"),
            pair("b2", "is approximated"),
        ];
        assert_eq!(said(warnings), expected);
    }

    #[test]
    fn one_more_place_is_one() {
        let mut warnings = Warnings::default();
        (0..=MAX_ALIKE).for_each(|place| warnings.push(format!("a{place}"), "is lost"));
        let last = warnings.finish().pop().expect("warnings");
        assert_eq!(last.what, "is lost (the same at 1 more place)");
    }
}
