//! Warnings of one import.

use crate::scene::Warning;

/// Most warnings that a scene carries; a last one counts the rest.
pub const MAX_WARNINGS: usize = 200;

/// Warnings of one import, bounded in number.
#[derive(Default)]
pub struct Warnings {
    list: Vec<Warning>,
    left_out: usize,
}

impl Warnings {
    /// Adds a warning of `what` is lost `at` a place in the file.
    pub fn push(&mut self, at: impl Into<String>, what: impl Into<String>) {
        if self.list.len() < MAX_WARNINGS {
            self.list.push(Warning::new(at, what));
        } else {
            self.left_out += 1;
        }
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
        self.left_out += part.left_out;
    }

    /// All of them.
    pub fn finish(mut self) -> Vec<Warning> {
        if self.left_out > 0 {
            let what = format!("{} more warnings are left out", self.left_out);
            self.list.push(Warning::new("file", what));
        }
        self.list
    }
}
