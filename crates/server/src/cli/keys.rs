//! `hemilux keys`: makes, lists and ends API keys, beside a running server or without one.

use super::process::{self, Failure, print};
use crate::access;
use crate::api::keys::{KeyLimits, KeyRecord, Scope};
use crate::api::webhooks::{Ending, WebhookTarget};
use crate::data_folder::{self, FolderError};
use crate::store::StoreError;
use crate::store::keys::Keys;
use crate::store::sqlite::SqliteStore;
use clap::{Args, Subcommand};
use jiff::{SignedDuration, Timestamp};
use std::fmt::Write;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

/// Longest name of a key.
const MAX_NAME_CHARS: usize = 64;

/// How long a server that is just starting may take to make or to bring up to date its tables.
const START_PATIENCE: Duration = Duration::from_secs(3);

/// Arguments of `hemilux keys`.
#[derive(Args)]
pub struct Arguments {
    /// The server's data folder.
    #[arg(long, env = "HEMILUX_DATA_DIR", default_value = "./hemilux-data", global = true)]
    data_dir: PathBuf,
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
    /// Make a key and print it: the only time that it is shown.
    Add(Box<New>),
    /// List all keys, with what they may do and when they were last used.
    List,
    /// End a key now; what it made stays.
    Revoke {
        /// The key's id or name.
        key: String,
    },
}

#[derive(Args)]
struct New {
    /// What to call it.
    name: String,
    /// What it may do: read (its own things), submit (send, cancel, delete), priority (send
    /// jobs of a priority above 0), admin (all of it, of everyone).
    #[arg(long, value_delimiter = ',', default_value = "read,submit")]
    scope: Vec<Scope>,
    /// Days until it ends by itself.
    #[arg(long, value_parser = clap::value_parser!(u32).range(1..=36_500))]
    expires_days: Option<u32>,
    /// Requests a second.
    #[arg(long)]
    rate_limit: Option<f64>,
    /// Jobs that may wait.
    #[arg(long)]
    max_queued: Option<u64>,
    /// Jobs that may run at the same time.
    #[arg(long, value_parser = clap::value_parser!(u64).range(1..))]
    max_running: Option<u64>,
    /// MiB of scenes and environments.
    #[arg(long, value_parser = clap::value_parser!(u64).range(..=1 << 40))]
    max_scenes_mb: Option<u64>,
    /// MiB of pictures and solutions of its jobs.
    #[arg(long, value_parser = clap::value_parser!(u64).range(..=1 << 40))]
    max_stored_mb: Option<u64>,
    /// MiB of its jobs that may be pinned.
    #[arg(long, value_parser = clap::value_parser!(u64).range(..=1 << 40))]
    max_pinned_mb: Option<u64>,
    /// Tell this address when a job of the key ends, unless the job names another.
    #[arg(long)]
    webhook: Option<String>,
    /// File whose first line signs the messages to --webhook.
    #[arg(long, requires = "webhook")]
    webhook_secret_file: Option<PathBuf>,
}

/// Runs the command.
pub fn run(arguments: Arguments) -> Result<(), Failure> {
    process::keep_files_private();
    let runtime = process::runtime()?;
    runtime.block_on(async {
        let path = arguments.data_dir.join(data_folder::DATABASE);
        if !matches!(arguments.command, Command::Add(_)) && !path.exists() {
            let folder = arguments.data_dir.display();
            return Err(Failure::failed(format!("{folder} is no data folder of hemilux")));
        }
        let store = open(&arguments.data_dir, &path).await?;
        let done = match arguments.command {
            Command::Add(new) => add(&store, *new).await,
            Command::List => list(&store).await,
            Command::Revoke { key } => match store.revoke_key(&key).await {
                Ok(true) => Ok(()),
                Ok(false) => Err(Failure::failed(format!("no good key is called {key:?}"))),
                Err(error) => Err(Failure::failed(error)),
            },
        };
        crate::store::Store::close(&store).await;
        done
    })
}

/// The store of a data folder, made where there is none. Where a server is just starting on the
/// folder, it makes the database or brings it up to date: that takes a moment.
async fn open(folder: &Path, database: &Path) -> Result<SqliteStore, Failure> {
    std::fs::create_dir_all(folder).map_err(Failure::failed)?;
    let deadline = Instant::now() + START_PATIENCE;
    loop {
        let trouble = if database.exists() {
            // A server of an earlier version may be running on it.
            match SqliteStore::open_as_it_is(database).await {
                Ok(store) => return Ok(store),
                Err(error @ StoreError::OtherVersion { .. }) => Failure::failed(error),
                Err(error) => return Err(Failure::failed(error)),
            }
        } else {
            match data_folder::lock(folder) {
                Ok(_lock) if database.exists() => continue,
                Ok(_lock) => {
                    let (store, _) =
                        data_folder::open(folder, false).await.map_err(Failure::failed)?;
                    return Ok(store);
                }
                Err(error @ FolderError::InUse(_)) => Failure::failed(error),
                Err(error) => return Err(Failure::failed(error)),
            }
        };
        if Instant::now() >= deadline {
            return Err(trouble);
        }
        tokio::time::sleep(Duration::from_millis(100)).await;
    }
}

async fn add(store: &SqliteStore, new: New) -> Result<(), Failure> {
    let name = new.name.trim().to_owned();
    let is_fit = |c: char| !c.is_control();
    if name.is_empty() || name.chars().count() > MAX_NAME_CHARS || !name.chars().all(is_fit) {
        return Err(Failure::usage("a key's name has 1 to 64 visible characters"));
    }
    if new.rate_limit.is_some_and(|rate| !(rate > 0.0 && rate <= 1e6)) {
        return Err(Failure::usage("--rate-limit must be above 0 and at most 1000000"));
    }
    let mut scopes = new.scope.clone();
    scopes.dedup();
    let now = Timestamp::now();
    let days = |days: u32| now + SignedDuration::from_hours(24 * i64::from(days));
    let record = KeyRecord {
        id: access::new_id().map_err(Failure::failed)?,
        name,
        scopes,
        limits: KeyLimits {
            requests_per_s: new.rate_limit,
            jobs_queued: new.max_queued,
            jobs_running: new.max_running,
            scene_bytes: new.max_scenes_mb.map(|mb| mb << 20),
            stored_bytes: new.max_stored_mb.map(|mb| mb << 20),
            pinned_bytes: new.max_pinned_mb.map(|mb| mb << 20),
        },
        webhook: webhook(&new)?,
        created_at: now,
        expires_at: new.expires_days.map(days),
        revoked_at: None,
        last_used_at: None,
    };
    let key = access::new_key().map_err(Failure::failed)?;
    if !store.add_key(&record, &access::hash(&key)).await.map_err(Failure::failed)? {
        return Err(Failure::failed(format!("there is a key called {:?} already", record.name)));
    }
    eprintln!("{} ({}); keep the key, it is not shown again:", record.id, record.name);
    print(&format!("{key}\n"))
}

fn webhook(new: &New) -> Result<Option<WebhookTarget>, Failure> {
    let Some(url) = new.webhook.clone() else { return Ok(None) };
    let secret = match &new.webhook_secret_file {
        Some(path) => {
            let text = std::fs::read_to_string(path)
                .map_err(|error| Failure::failed(format!("{}: {error}", path.display())))?;
            Some(text.lines().next().unwrap_or("").to_owned())
        }
        None => None,
    };
    let target = WebhookTarget { url, events: Ending::ALL.to_vec(), secret };
    match target.problems("webhook").first() {
        Some(error) => Err(Failure::usage(format!("{}: {}", error.field, error.detail))),
        None => Ok(Some(target)),
    }
}

async fn list(store: &SqliteStore) -> Result<(), Failure> {
    let keys = store.keys().await.map_err(Failure::failed)?;
    let now = Timestamp::now();
    let mut text = String::new();
    for key in keys {
        let scopes: Vec<_> = key.scopes.iter().map(|scope| scope.as_str()).collect();
        let state = match (&key.revoked_at, &key.expires_at) {
            (Some(at), _) => format!("revoked {at:.0}"),
            (None, Some(end)) if *end <= now => format!("expired {end:.0}"),
            (None, Some(end)) => format!("good until {end:.0}"),
            (None, None) => "good".into(),
        };
        let used = key.last_used_at.map_or("never used".into(), |at| format!("used {at:.0}"));
        let _ = writeln!(
            text,
            "{}  {}  {}  {state}  {used}{}",
            key.id,
            key.name,
            scopes.join(","),
            limits(&key)
        );
    }
    print(&text)
}

fn limits(key: &KeyRecord) -> String {
    let KeyLimits {
        requests_per_s,
        jobs_queued,
        jobs_running,
        scene_bytes,
        stored_bytes,
        pinned_bytes,
    } = key.limits;
    let parts = [
        requests_per_s.map(|rate| format!("{rate} requests/s")),
        jobs_queued.map(|jobs| format!("{jobs} queued")),
        jobs_running.map(|jobs| format!("{jobs} running")),
        scene_bytes.map(|bytes| format!("{} MiB of scenes", bytes >> 20)),
        stored_bytes.map(|bytes| format!("{} MiB of pictures and solutions", bytes >> 20)),
        pinned_bytes.map(|bytes| format!("{} MiB pinned", bytes >> 20)),
        key.webhook.as_ref().map(|webhook| format!("tells {}", webhook.url)),
    ];
    parts.into_iter().flatten().fold(String::new(), |text, part| text + "  " + &part)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::store::sqlite::tests::first_release;
    use clap::Parser;
    use std::path::Path;

    #[derive(Parser)]
    struct Program {
        #[command(flatten)]
        keys: Arguments,
    }

    fn keys(folder: &Path, words: &[&str]) -> Result<(), Failure> {
        let folder = folder.display().to_string();
        let line = ["keys", "--data-dir", &folder].into_iter().chain(words.iter().copied());
        run(Program::parse_from(line).keys)
    }

    /// A server of an older version runs on the folder, and its tables stay as it knows them.
    #[test]
    fn the_tables_of_an_older_server_are_left_alone() {
        let folder = tempfile::tempdir().unwrap();
        let database = folder.path().join("hemilux.sqlite");
        let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build().unwrap();
        runtime.block_on(first_release(&database));
        for words in [&["list"][..], &["add", "studio"], &["revoke", "studio"]] {
            let refused = keys(folder.path(), words).unwrap_err();
            let told = ["version 1 of the tables", "start the server of this program's version"];
            assert!(told.iter().all(|told| refused.message.contains(told)), "{}", refused.message);
        }
        // The server of this version brings them up to date.
        let opened = runtime.block_on(crate::data_folder::open(folder.path(), false));
        let (store, _) = opened.unwrap();
        keys(folder.path(), &["add", "studio"]).unwrap();
        keys(folder.path(), &["list"]).unwrap();
        runtime.block_on(crate::store::Store::close(&store));
    }

    #[test]
    fn keys_can_be_made_before_the_first_start_but_not_beside_files_without_a_database() {
        let folder = tempfile::tempdir().unwrap();
        let missing = keys(folder.path(), &["list"]).unwrap_err();
        assert!(missing.message.contains("no data folder"), "{}", missing.message);
        keys(folder.path(), &["add", "studio"]).unwrap();
        keys(folder.path(), &["list"]).unwrap();
        std::fs::remove_file(folder.path().join("hemilux.sqlite")).unwrap();
        let refused = keys(folder.path(), &["add", "studio"]).unwrap_err();
        assert!(refused.message.contains("do not belong together"), "{}", refused.message);
    }
}
