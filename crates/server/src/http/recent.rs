//! What the database said last, kept for probes.

use super::fresh::Fresh;
use crate::store::JobCounts;
use std::sync::Arc;

/// What the database said last to probes.
pub struct Recent {
    /// Whether it can be read and written.
    pub database: Arc<Fresh<()>>,
    /// Jobs by state, and messages to webhooks still to be delivered.
    pub figures: Arc<Fresh<(JobCounts, u64)>>,
}

impl Default for Recent {
    fn default() -> Self {
        Self { database: Arc::default(), figures: Arc::new(Fresh::costly()) }
    }
}
