//! API keys: what one may do, how much of it, and what the store knows about it.

use super::webhooks::WebhookTarget;
use jiff::Timestamp;
use serde::{Deserialize, Serialize};

/// What a key may do.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, clap::ValueEnum)]
#[serde(rename_all = "snake_case")]
pub enum Scope {
    /// Read its own jobs, scenes and pictures.
    Read,
    /// Send scenes and jobs; cancel, pin and delete its own.
    Submit,
    /// Send jobs of a priority above 0, which start before those of others.
    Priority,
    /// All of that, with the jobs and scenes of everyone.
    Admin,
}

impl Scope {
    /// The name on the command line and in answers.
    pub fn as_str(self) -> &'static str {
        match self {
            Self::Read => "read",
            Self::Submit => "submit",
            Self::Priority => "priority",
            Self::Admin => "admin",
        }
    }
}

/// Quotas of one key, or of one address where there are no keys. `None` is whatever the server's
/// own setting says; that may be no limit.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct KeyLimits {
    /// Requests a second, averaged over two seconds.
    pub requests_per_s: Option<f64>,
    /// Jobs that may wait.
    pub jobs_queued: Option<u64>,
    /// Jobs that may run at the same time; more wait.
    pub jobs_running: Option<u64>,
    /// Bytes of scenes that it has sent, each counted once.
    pub scene_bytes: Option<u64>,
    /// Bytes of pictures and solutions of its jobs; beyond it no new jobs are taken.
    pub stored_bytes: Option<u64>,
    /// Bytes of its jobs that may be pinned.
    pub pinned_bytes: Option<u64>,
}

impl KeyLimits {
    /// These, with what they leave open taken from `defaults`.
    pub fn or(self, defaults: Self) -> Self {
        Self {
            requests_per_s: self.requests_per_s.or(defaults.requests_per_s),
            jobs_queued: self.jobs_queued.or(defaults.jobs_queued),
            jobs_running: self.jobs_running.or(defaults.jobs_running),
            scene_bytes: self.scene_bytes.or(defaults.scene_bytes),
            stored_bytes: self.stored_bytes.or(defaults.stored_bytes),
            pinned_bytes: self.pinned_bytes.or(defaults.pinned_bytes),
        }
    }
}

/// A key as the store knows it. The key itself is nowhere.
#[derive(Clone, Debug, PartialEq)]
pub struct KeyRecord {
    /// Names the key in lists, logs and as the owner of jobs; not secret.
    pub id: String,
    /// What the operator calls it; unique among keys that are not revoked.
    pub name: String,
    /// What it may do.
    pub scopes: Vec<Scope>,
    /// Its own quotas.
    pub limits: KeyLimits,
    /// Who is told when a job of this key ends, unless the job names its own.
    pub webhook: Option<WebhookTarget>,
    /// When it was made.
    pub created_at: Timestamp,
    /// When it ends by itself.
    pub expires_at: Option<Timestamp>,
    /// When it was ended.
    pub revoked_at: Option<Timestamp>,
    /// When it last opened the door, give or take a minute.
    pub last_used_at: Option<Timestamp>,
}

impl KeyRecord {
    /// Whether it opens the door at `now`.
    pub fn is_good(&self, now: Timestamp) -> bool {
        self.revoked_at.is_none() && self.expires_at.is_none_or(|end| now < end)
    }

    /// Whether it may do what `scope` stands for.
    pub fn may(&self, scope: Scope) -> bool {
        self.scopes.contains(&scope) || self.scopes.contains(&Scope::Admin)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use jiff::ToSpan;

    fn key(scopes: &[Scope]) -> KeyRecord {
        KeyRecord {
            id: "k".into(),
            name: "n".into(),
            scopes: scopes.to_vec(),
            limits: KeyLimits::default(),
            webhook: None,
            created_at: Timestamp::UNIX_EPOCH,
            expires_at: None,
            revoked_at: None,
            last_used_at: None,
        }
    }

    #[test]
    fn admin_is_all_and_the_others_are_themselves() {
        let all = [Scope::Read, Scope::Submit, Scope::Priority, Scope::Admin];
        for scope in all {
            assert!(key(&[Scope::Admin]).may(scope));
            for other in all.into_iter().filter(|other| *other != scope) {
                assert_eq!(key(&[scope]).may(other), scope == Scope::Admin);
            }
        }
    }

    #[test]
    fn a_key_ends_on_its_date_or_when_revoked() {
        let end = Timestamp::UNIX_EPOCH + 1.hour();
        let short = KeyRecord { expires_at: Some(end), ..key(&[]) };
        assert!(short.is_good(Timestamp::UNIX_EPOCH) && !short.is_good(end));
        let gone = KeyRecord { revoked_at: Some(end), ..key(&[]) };
        assert!(!gone.is_good(Timestamp::UNIX_EPOCH));
        assert!(key(&[]).is_good(end));
    }

    #[test]
    fn own_limits_win_over_defaults() {
        let own = KeyLimits { jobs_queued: Some(3), ..KeyLimits::default() };
        let defaults = KeyLimits { jobs_queued: Some(9), jobs_running: Some(2), ..own };
        let limits = own.or(defaults);
        assert_eq!((limits.jobs_queued, limits.jobs_running), (Some(3), Some(2)));
    }
}
