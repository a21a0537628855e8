//! Why checkpoints are refused.

/// Why a checkpoint can't be used. The job can always begin from the start instead.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum CheckpointError {
    /// The bytes are not what was written.
    #[error("the checkpoint is damaged: {what}")]
    Damaged {
        /// What is wrong with them.
        what: String,
    },
    /// It is in another format than the program reads, because another version wrote it.
    #[error("the checkpoint is in {found}; this program reads {here}")]
    Version {
        /// What it is in.
        found: String,
        /// What is read here.
        here: String,
    },
    /// It is of another job.
    #[error("the checkpoint belongs to {what}")]
    Foreign {
        /// To what.
        what: String,
    },
}

impl CheckpointError {
    /// Bytes that are not what was written.
    pub fn damaged(what: impl Into<String>) -> Self {
        Self::Damaged { what: what.into() }
    }

    /// A checkpoint of something else.
    pub fn foreign(what: impl Into<String>) -> Self {
        Self::Foreign { what: what.into() }
    }
}
