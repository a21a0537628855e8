//! What goes wrong with SQLite, in words that help whoever runs the server.

use crate::failpoints;
use crate::store::StoreError;

impl From<sqlx::Error> for StoreError {
    /// Names the troubles that an operator can mend.
    fn from(source: sqlx::Error) -> Self {
        match diagnose(&source) {
            Some((what, remedy)) => Self::Sick { what, remedy, source },
            None => Self::Database(source),
        }
    }
}

/// What an error of SQLite means for whoever runs the server, and what they can do.
fn diagnose(error: &sqlx::Error) -> Option<(&'static str, &'static str)> {
    let code = error.as_database_error()?.code()?.parse::<u32>().ok()?;
    // The primary codes of https://sqlite.org/rescode.html, the lowest byte.
    Some(match code & 0xff {
        3 | 14 => ("its file cannot be opened", "check the permissions of the data folder"),
        8 => ("its file cannot be written", "make the data folder writable for the server"),
        10 => ("the disk does not read or write", "check the disk and the space left on it"),
        11 => ("its file is damaged", "stop the server and restore the file from a backup"),
        13 => ("the disk is full", "free space under the data folder"),
        26 => ("its file is not a database", "stop the server and restore the file from a backup"),
        _ => return None,
    })
}

/// Where a test may make the store fail or die.
pub fn failpoint(point: &'static str, about: impl std::fmt::Debug) -> Result<(), StoreError> {
    failpoints::pass(point, || format!("{about:?}"))
        .map_err(|injected| StoreError::Database(sqlx::Error::Io(std::io::Error::other(injected))))
}
