//! Which files were found to have the content that they should: a file is hashed once for as long as
//! it keeps its size and its time, not once a request.

use object_store::ObjectMeta;
use object_store::path::Path as Key;
use std::collections::{HashMap, VecDeque};
use std::sync::{Arc, Mutex, PoisonError};
use tokio::sync::Semaphore;

/// Files that are hashed at the same time.
pub(super) const HASHINGS_AT_ONCE: usize = 2;
/// Files that are remembered as sound; beyond it those that were hashed first are hashed again.
const REMEMBERED: usize = 16_384;

/// What a file looked like when its content was found to be what it should be.
#[derive(Clone, PartialEq)]
pub(super) struct Stamp {
    size: u64,
    modified: i64,
    /// Which file it is and when it changed, as finely as the storage knows.
    tag: Option<String>,
}

impl Stamp {
    /// What it looks like now.
    pub(super) fn of(meta: &ObjectMeta) -> Self {
        let modified = meta.last_modified.timestamp_micros();
        Self { size: meta.size, modified, tag: meta.e_tag.clone() }
    }
}

#[derive(Default)]
struct Remembered {
    stamps: HashMap<Key, Stamp>,
    /// The same files, those that were hashed first in front.
    order: VecDeque<Key>,
}

/// Which files this process has found to be sound.
pub(super) struct VerifiedFiles {
    remembered: Mutex<Remembered>,
    /// Turns at hashing a file.
    pub(super) turns: Arc<Semaphore>,
}

impl Default for VerifiedFiles {
    fn default() -> Self {
        let turns = Arc::new(Semaphore::new(HASHINGS_AT_ONCE));
        Self { remembered: Mutex::default(), turns }
    }
}

impl VerifiedFiles {
    /// Whether a file that looks like this was found to be sound.
    pub(super) fn knows(&self, key: &Key, stamp: &Stamp) -> bool {
        let remembered = self.remembered.lock().unwrap_or_else(PoisonError::into_inner);
        remembered.stamps.get(key) == Some(stamp)
    }

    /// Notes that a file that looks like this is sound.
    pub(super) fn remember(&self, key: Key, stamp: Stamp) {
        let mut remembered = self.remembered.lock().unwrap_or_else(PoisonError::into_inner);
        if remembered.stamps.insert(key.clone(), stamp).is_none() {
            remembered.order.push_back(key);
        }
        while remembered.order.len() > REMEMBERED {
            if let Some(oldest) = remembered.order.pop_front() {
                remembered.stamps.remove(&oldest);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_so_many_files_are_remembered() {
        let sound = VerifiedFiles::default();
        let stamp = Stamp { size: 1, modified: 2, tag: None };
        let key = |i: usize| Key::from(format!("jobs/{i}"));
        for i in 0..REMEMBERED + 10 {
            sound.remember(key(i), stamp.clone());
            sound.remember(key(i), stamp.clone());
        }
        let remembered = sound.remembered.lock().unwrap();
        assert_eq!((remembered.stamps.len(), remembered.order.len()), (REMEMBERED, REMEMBERED));
        assert!(
            !remembered.stamps.contains_key(&key(9)) && remembered.stamps.contains_key(&key(10))
        );
    }
}
