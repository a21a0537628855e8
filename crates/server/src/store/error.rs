//! What goes wrong with a store.

use crate::job_state::Refusal;
use uuid::Uuid;

/// Why the store could not do it.
#[derive(Debug, thiserror::Error)]
pub enum StoreError {
    /// The database refused or is unreachable.
    #[error("database: {0}")]
    Database(sqlx::Error),
    /// The database, or what lies under it, is out of order: what, and what to do about it.
    #[error("database: {what}; {remedy} ({source})")]
    Sick {
        /// What is wrong.
        what: &'static str,
        /// What an operator can do.
        remedy: &'static str,
        /// What the database said.
        source: sqlx::Error,
    },
    /// The database could not be brought to this version's tables.
    #[error("database migration: {0}")]
    Migration(sqlx::migrate::MigrateError),
    /// The tables are those of another version of the program, and this caller must not change them.
    #[error(
        "the database has the tables of another version of hemilux (version {version} of the tables, this program has {own}); {}",
        if version < own {
            "start the server of this program's version on the data folder first, which brings them up to date, or use the program of the version that serves it"
        } else {
            "use the program of the version that serves it"
        }
    )]
    OtherVersion {
        /// Version of the tables.
        version: i64,
        /// Version that this program has.
        own: i64,
    },
    /// A stored record does not read back.
    #[error("stored {what} does not read back: {reason}")]
    Corrupt {
        /// Which record.
        what: String,
        /// What is wrong with it.
        reason: String,
    },
    /// The writer's claim on the job is over: it was deleted, or another worker has it.
    #[error("the claim on job {0} is over")]
    ClaimLost(Uuid),
    /// The state machine forbids it; a fault of the caller.
    #[error("job {job}: {refusal}")]
    Illegal {
        /// The job.
        job: Uuid,
        /// Why not.
        refusal: Refusal,
    },
}

impl StoreError {
    /// Whether trying again cannot help: what is stored does not read back.
    pub fn is_lasting(&self) -> bool {
        matches!(self, Self::Corrupt { .. })
    }
}

impl From<sqlx::migrate::MigrateError> for StoreError {
    fn from(error: sqlx::migrate::MigrateError) -> Self {
        match error {
            sqlx::migrate::MigrateError::Execute(source) => source.into(),
            other => Self::Migration(other),
        }
    }
}
