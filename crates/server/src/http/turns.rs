//! How many uploads come in at the same time: each holds a connection, files and disk for as long
//! as it takes, so there must not be any number of them, and no caller may have them all.

use super::App;
use super::problem::Problem;
use crate::access::Caller;
use std::collections::HashMap;
use std::sync::{Arc, Mutex, PoisonError};

/// Which limit leaves no room for an upload.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Full {
    /// That of the server.
    All,
    /// That of the caller.
    Own,
}

#[derive(Default)]
struct Open {
    all: u64,
    by_caller: HashMap<String, u64>,
}

/// The uploads that are open, counted.
#[derive(Clone)]
pub struct Turns {
    open: Arc<Mutex<Open>>,
    most: u64,
    most_each: u64,
}

/// The right to one upload, until dropped.
pub struct Turn {
    turns: Turns,
    caller: String,
}

impl Turns {
    /// None open; so many may be, and so many of one caller.
    pub fn new(most: u64, most_each: u64) -> Self {
        Self { open: Arc::default(), most, most_each }
    }

    /// A turn for that caller; an empty name stands for everyone together.
    fn begin(&self, caller: &str) -> Result<Turn, Full> {
        let mut open = self.open.lock().unwrap_or_else(PoisonError::into_inner);
        if open.all >= self.most {
            return Err(Full::All);
        }
        if !caller.is_empty() {
            let own = open.by_caller.entry(caller.to_owned()).or_default();
            if *own >= self.most_each {
                return Err(Full::Own);
            }
            *own += 1;
        }
        open.all += 1;
        drop(open);
        Ok(Turn { turns: self.clone(), caller: caller.to_owned() })
    }
}

impl Drop for Turn {
    fn drop(&mut self) {
        let mut open = self.turns.open.lock().unwrap_or_else(PoisonError::into_inner);
        open.all -= 1;
        if let Some(own) = open.by_caller.get_mut(&self.caller) {
            *own -= 1;
            if *own == 0 {
                open.by_caller.remove(&self.caller);
            }
        }
    }
}

/// A turn at uploading for `caller`, or when to come back.
pub fn begin(app: &App, caller: &Caller) -> Result<Turn, Problem> {
    app.uploads.begin(caller.billed_to()).map_err(|full| {
        app.metrics.count_refusal("uploads");
        let Turns { most, most_each, .. } = app.uploads;
        match full {
            Full::All => Problem::uploads_full(format!(
                "{most} uploads are open, which is the server's limit"
            )),
            Full::Own => {
                let detail =
                    format!("{most_each} uploads of this caller are open, which is its limit");
                Problem::over_limit("uploads", detail, 5.0)
            }
        }
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn turns_end_and_nobody_has_them_all() {
        let turns = Turns::new(3, 2);
        let first = turns.begin("a").ok();
        let second = turns.begin("a").ok();
        assert!(first.is_some() && second.is_some());
        assert_eq!(turns.begin("a").err(), Some(Full::Own));
        let third = turns.begin("b").ok();
        assert!(third.is_some());
        assert_eq!(turns.begin("c").err(), Some(Full::All));
        drop(first);
        assert!(turns.begin("a").is_ok());
        drop((second, third));
        let open = turns.open.lock().unwrap();
        assert_eq!((open.all, open.by_caller.len()), (0, 0));
    }

    #[test]
    fn callers_that_are_not_told_apart_share_the_whole() {
        let turns = Turns::new(3, 1);
        let held: Vec<_> = (0..3).map(|_| turns.begin("")).collect();
        assert!(held.iter().all(Result::is_ok));
        assert_eq!(turns.begin("").err(), Some(Full::All));
    }
}
