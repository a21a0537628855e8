//! What an import says about its input: warnings and errors.

use serde::Serialize;

/// Something of the input that the picture will not show as authored.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Warning {
    /// Where: a path into the file (`materials[3].normalTexture`) or a stage of the job.
    pub at: String,
    /// What was approximated or ignored, and how to avoid it.
    pub what: String,
}

impl Warning {
    /// A warning about `at`.
    pub fn new(at: impl Into<String>, what: impl Into<String>) -> Self {
        Self { at: at.into(), what: what.into() }
    }
}

/// Why a scene cannot be used: where, what, and what to do about it.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{at}: {what}; {fix}")]
pub struct SceneError {
    /// Where: a path into the file, or the file itself.
    pub at: String,
    /// What is wrong.
    pub what: String,
    /// What the sender can do.
    pub fix: String,
    /// Whether the input is well formed but exceeds a limit.
    pub too_large: bool,
}

impl SceneError {
    /// A malformed input.
    pub fn malformed(
        at: impl Into<String>,
        what: impl Into<String>,
        fix: impl Into<String>,
    ) -> Self {
        Self { at: at.into(), what: what.into(), fix: fix.into(), too_large: false }
    }

    /// An input over a limit.
    pub fn too_large(
        at: impl Into<String>,
        what: impl Into<String>,
        fix: impl Into<String>,
    ) -> Self {
        Self { at: at.into(), what: what.into(), fix: fix.into(), too_large: true }
    }
}
