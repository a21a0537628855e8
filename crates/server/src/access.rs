//! Who is asking: keys and how they are made, recognised and limited.
//!
//! A key is 256 random bits with a prefix that secret scanners can find. Only its SHA-256 is
//! stored, and keys are looked up by that hash. A slow password hash would add nothing: there is no
//! guessing 256 bits. Nor would a comparison in constant time: what the index compares is the hash
//! of what the caller sent, and the time tells at most how many leading bits of one hash agree with
//! another, which says nothing about the key, since nobody can aim at a hash.

use crate::api::keys::{KeyLimits, KeyRecord, Scope};
use crate::hash::sha256_hex;
use crate::store::scenes::Viewer;
use base64::Engine;
use std::collections::HashMap;
use std::net::{IpAddr, Ipv6Addr};
use std::sync::{Mutex, PoisonError};
use std::time::{Duration, Instant};

/// How every key begins.
pub const PREFIX: &str = "hmx_";
/// Random bytes of a key.
const KEY_BYTES: usize = 32;
/// Random bytes of a key's id.
const ID_BYTES: usize = 6;

/// A fresh key. Shown once; [`hash`] is what is kept.
///
/// # Errors
/// Where the system has no randomness to give.
pub fn new_key() -> Result<String, getrandom::Error> {
    let mut bytes = [0; KEY_BYTES];
    getrandom::fill(&mut bytes)?;
    let text = base64::engine::general_purpose::URL_SAFE_NO_PAD.encode(bytes);
    Ok(format!("{PREFIX}{text}"))
}

/// A fresh id for a key.
///
/// # Errors
/// Where the system has no randomness to give.
pub fn new_id() -> Result<String, getrandom::Error> {
    let mut bytes = [0; ID_BYTES];
    getrandom::fill(&mut bytes)?;
    Ok(format!("key-{}", crate::hash::hex(&bytes)))
}

/// What is stored of a key and looked up: SHA-256 of all of it, in hex.
pub fn hash(key: &str) -> String {
    sha256_hex(key.as_bytes())
}

/// How exactly it is known when a key was last used.
const USE_INTERVAL: Duration = Duration::from_secs(60);

/// When keys were last noted as used, so that not every request writes.
#[derive(Default)]
pub struct KeyUses(Mutex<HashMap<String, Instant>>);

impl KeyUses {
    /// Whether a use of that key is worth noting now. There are as many entries as good keys.
    pub fn is_news(&self, id: &str) -> bool {
        let mut uses = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        let is_news = uses.get(id).is_none_or(|at| at.elapsed() >= USE_INTERVAL);
        if is_news {
            uses.insert(id.to_owned(), Instant::now());
        }
        is_news
    }
}

/// Whoever sent a request.
#[derive(Clone, Debug)]
pub struct Caller {
    key: Option<KeyRecord>,
    billed_to: String,
    /// The quotas in force.
    pub limits: KeyLimits,
}

impl Caller {
    /// The holder of a key.
    pub fn with_key(key: KeyRecord, defaults: KeyLimits) -> Self {
        Self { limits: key.limits.or(defaults), billed_to: key.id.clone(), key: Some(key) }
    }

    /// Somebody, where no key is needed; quotas, if there are any, go by the address.
    pub fn without_key(address: Option<IpAddr>, limits: KeyLimits) -> Self {
        let counted = limits != KeyLimits::default();
        let billed_to = match address {
            Some(address) if counted => format!("address {}", counted_as(address)),
            _ => String::new(),
        };
        Self { key: None, billed_to, limits }
    }

    /// The key, if there is one.
    pub fn key(&self) -> Option<&KeyRecord> {
        self.key.as_ref()
    }

    /// The owner of what this caller makes: the key's id, or nobody.
    pub fn owner(&self) -> &str {
        self.key.as_ref().map_or("", |key| &key.id)
    }

    /// Under which name quotas are counted.
    pub fn billed_to(&self) -> &str {
        &self.billed_to
    }

    /// As whom this caller looks at scenes.
    pub fn viewer(&self) -> Viewer<'_> {
        Viewer { holder: &self.billed_to, sees_all: self.sees_all() }
    }

    /// Whether this caller may see what belongs to others.
    pub fn sees_all(&self) -> bool {
        self.key.as_ref().is_none_or(|key| key.may(Scope::Admin))
    }

    /// Whether this caller may do what `scope` stands for.
    pub fn may(&self, scope: Scope) -> bool {
        self.key.as_ref().is_none_or(|key| key.may(scope))
    }
}

/// Under which name requests from an address are counted. Of IPv6 it is the network of 64 bits,
/// which is the least that anyone is given: each address in it would otherwise be another caller.
pub fn counted_as(address: IpAddr) -> String {
    match address.to_canonical() {
        IpAddr::V4(address) => address.to_string(),
        IpAddr::V6(address) => {
            let network = Ipv6Addr::from_bits(address.to_bits() >> 64 << 64);
            format!("{network}/64")
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn keys_are_256_random_bits_behind_a_prefix() {
        let (a, b) = (new_key().unwrap(), new_key().unwrap());
        assert_ne!(a, b);
        for key in [a, b] {
            let text = key.strip_prefix(PREFIX).unwrap();
            let bytes = base64::engine::general_purpose::URL_SAFE_NO_PAD.decode(text).unwrap();
            assert_eq!(8 * bytes.len(), 256);
            assert_eq!(hash(&key).len(), 64);
            assert!(!hash(&key).contains(text));
        }
    }

    #[test]
    fn addresses_count_only_where_there_are_quotas() {
        let address = "::ffff:10.0.0.1".parse().ok();
        assert_eq!(Caller::without_key(address, KeyLimits::default()).billed_to(), "");
        let limits = KeyLimits { jobs_queued: Some(1), ..KeyLimits::default() };
        let caller = Caller::without_key(address, limits);
        assert_eq!(caller.billed_to(), "address 10.0.0.1");
        let network = |address: &str| {
            Caller::without_key(address.parse().ok(), limits).billed_to().to_owned()
        };
        // Who has one IPv6 address has 2^64 of them.
        assert_eq!(network("2001:db8:1:2::1"), "address 2001:db8:1:2::/64");
        assert_eq!(network("2001:db8:1:2:ffff::9"), network("2001:db8:1:2::1"));
        assert_ne!(network("2001:db8:1:3::1"), network("2001:db8:1:2::1"));
        assert!(caller.sees_all() && caller.may(Scope::Submit) && caller.owner().is_empty());
    }
}
