//! The conformance suite on database files, and what only an embedded store has: old data
//! folders, clocks that jump, files that are damaged.

use super::time::CLOCK_JUMP_MS;
use super::*;
use crate::job_state::JobState;
use crate::store::Meta;
use crate::store::conformance::fixture::{ASKING, Home};
use crate::store::conformance::suite;
use sqlx::sqlite::{SqliteConnectOptions, SqlitePoolOptions};
use std::borrow::Cow;
use std::path::Path;
use std::sync::Arc;
use std::time::Duration;
use tempfile::TempDir;

/// A folder for a database.
pub(crate) struct Folder(TempDir);

impl Folder {
    pub(crate) fn new() -> Self {
        Self(TempDir::new().unwrap())
    }

    pub(crate) fn file(&self) -> std::path::PathBuf {
        self.0.path().join("db")
    }
}

#[async_trait]
impl Home for Folder {
    async fn open(&self) -> Arc<dyn Store> {
        Arc::new(SqliteStore::open(&self.file()).await.unwrap())
    }
}

suite!(Folder::new());

/// A database as the first release left it: its own migration, and its own rows.
pub(crate) async fn first_release(file: &Path) {
    let options = SqliteConnectOptions::new().filename(file).create_if_missing(true);
    let pool = SqlitePoolOptions::new().max_connections(1).connect_with(options).await.unwrap();
    let all = &tables::MIGRATIONS;
    let first: Vec<_> = all.iter().take(1).cloned().collect();
    let first = sqlx::migrate::Migrator {
        migrations: Cow::Owned(first),
        ..sqlx::migrate!("src/store/migrations")
    };
    first.run(&pool).await.unwrap();
    sqlx::raw_sql(include_str!("first_release.sql")).execute(&pool).await.unwrap();
    pool.close().await;
}

#[tokio::test]
async fn a_folder_of_the_first_release_opens_with_all_its_jobs() {
    let folder = Folder::new();
    first_release(&folder.file()).await;
    let store = folder.open().await;
    let filter = JobFilter { limit: 10, ..JobFilter::default() };
    let jobs = store.jobs(&filter).await.unwrap();
    let states: Vec<_> = jobs.iter().rev().map(|job| job.state).collect();
    use JobState::{Cancelled, Failed, Queued, Running, Succeeded};
    assert_eq!(states, [Succeeded, Failed, Cancelled, Running, Queued]);
    let done = jobs.last().unwrap();
    assert_eq!(done.result.as_ref().unwrap()[0].sha256, "aa");
    assert_eq!(done.stats.as_ref().unwrap().figures.iterations, 16);
    let picture = store.picture(done.id, "aa", PictureFormat::Png).await.unwrap();
    assert_eq!(picture.unwrap().size, 3);
    // What was there is counted from now on.
    assert_eq!(done.bytes, 3);
    assert_eq!(store.payer_bytes("").await.unwrap(), jobs.iter().map(|job| job.bytes).sum::<u64>());
    assert_eq!(store.events(done.id, 0, 10).await.unwrap().len(), 4);
    assert_eq!(store.scene("cornell-hash").await.unwrap().unwrap().triangles, 34);
    // What ran goes on, and the key of the waiting one still finds it.
    assert_eq!(store.recover().await.unwrap(), [jobs[1].id]);
    let (claim, job) = store.claim(&ASKING).await.unwrap().unwrap();
    assert_eq!((job.id, job.attempts), (jobs[1].id, 2));
    store.finish(claim, Outcome::of(Succeeded)).await.unwrap();
    let (claim, job) = store.claim(&ASKING).await.unwrap().unwrap();
    assert_eq!(job.id, jobs[0].id);
    store.finish(claim, Outcome::of(Succeeded)).await.unwrap();
    store.close().await;
    // And opens again.
    assert_eq!(folder.open().await.jobs(&filter).await.unwrap().len(), 5);
}

#[tokio::test]
async fn a_folder_of_a_later_release_is_refused() {
    let folder = Folder::new();
    let store = SqliteStore::open(&folder.file()).await.unwrap();
    let later = "INSERT INTO _sqlx_migrations (version, description, success, checksum,
                 execution_time) VALUES (9999, 'later', 1, x'00', 0)";
    sqlx::query(later).execute(&store.writer).await.unwrap();
    store.close().await;
    let error = SqliteStore::open(&folder.file()).await.err().unwrap().to_string();
    assert!(error.contains("9999"), "{error}");
}

#[tokio::test]
async fn a_closed_store_leaves_an_empty_log_whoever_else_has_the_file_open() {
    let folder = Folder::new();
    let store = SqliteStore::open(&folder.file()).await.unwrap();
    let log = folder.file().with_file_name("db-wal");
    assert!(std::fs::metadata(&log).unwrap().len() > 0, "nothing was written to the log");
    let other = SqliteConnectOptions::new().filename(folder.file());
    let other = SqlitePoolOptions::new().connect_with(other).await.unwrap();
    sqlx::query("SELECT count(*) FROM jobs").execute(&other).await.unwrap();
    store.close().await;
    assert_eq!(std::fs::metadata(&log).unwrap().len(), 0);
    other.close().await;
}

#[tokio::test]
async fn what_is_no_database_is_named() {
    let folder = Folder::new();
    std::fs::write(folder.file(), vec![b'x'; 8192]).unwrap();
    let error = SqliteStore::open(&folder.file()).await.err().unwrap();
    let text = error.to_string();
    assert!(text.contains("not a database") && text.contains("backup"), "{text}");
}

/// However long the queue of one payer, a claim asks the index once for each payer.
#[tokio::test]
async fn a_claim_from_a_long_queue_is_quick() {
    let folder = Folder::new();
    first_release(&folder.file()).await;
    let store = SqliteStore::open(&folder.file()).await.unwrap();
    let many = "INSERT INTO jobs (id, scene_id, state, priority, created_ms, request_hash, request,
                                  billed_to, max_running, place)
                WITH RECURSIVE n (i) AS (SELECT 1 UNION ALL SELECT i + 1 FROM n WHERE i < 100000)
                SELECT printf('01936f3e-8a51-7c3e-b1a4-%012x', i), scene_id, 'queued', 0, 0, '',
                       request, iif(i % 10000, 'many', 'few ' || i), iif(i % 2, 3, NULL), 10 + i
                FROM n, (SELECT scene_id, request FROM jobs WHERE state = 'queued')";
    sqlx::query(many).execute(&store.writer).await.unwrap();
    let mut took = Vec::new();
    for _ in 0..30 {
        // The choice alone: how long a commit takes is the disk's affair.
        let mut transaction = store.begin().await.unwrap();
        let began = std::time::Instant::now();
        let chosen = claims::next(&mut transaction, &ASKING).await.unwrap();
        took.push(began.elapsed());
        assert!(chosen.is_some(), "jobs wait");
        transaction.commit().await.unwrap();
    }
    took.sort_unstable();
    println!("claims took {:?} to {:?}, half of them less than {:?}", took[0], took[29], took[15]);
    // The machine may be busy with other things; a look at every job takes far longer than this.
    assert!(took[5] < Duration::from_millis(5), "{took:?}");
}

/// A job with very many events is forgotten in short writes, and not kept for ever where the clock
/// that it was deleted by was ahead.
#[tokio::test]
async fn many_events_are_purged_a_few_at_a_time() {
    let folder = Folder::new();
    first_release(&folder.file()).await;
    let store = SqliteStore::open(&folder.file()).await.unwrap();
    let filter = JobFilter { limit: 10, ..JobFilter::default() };
    let job = store.jobs(&filter).await.unwrap().pop().unwrap();
    let events =
        "WITH RECURSIVE n (seq) AS (SELECT 1000 UNION ALL SELECT seq + 1 FROM n LIMIT 20000)
                  INSERT INTO events (job_id, seq, kind, at_ms, data)
                  SELECT ?, seq, 'progress', 0, '{}' FROM n";
    sqlx::query(events).bind(job.id.to_string()).execute(&store.writer).await.unwrap();
    CLOCK_JUMP_MS.set(400 * 86_400_000);
    store.delete(job.id).await.unwrap();
    CLOCK_JUMP_MS.set(0);
    let purged = store.purge(0);
    let others = async {
        // Whoever wants to write in between gets a turn.
        let mut turns = 0;
        loop {
            store.keep_fact("turn", &turns.to_string()).await.unwrap();
            let row = sqlx::query("SELECT count(*) AS events FROM events WHERE seq >= 1000");
            let left: i64 = row.fetch_one(&store.reader).await.unwrap().get("events");
            if left == 0 {
                return turns;
            }
            turns += 1;
        }
    };
    let (purged, turns) = tokio::join!(purged, others);
    assert_eq!(purged.unwrap(), [job.id]);
    assert!(turns >= 10, "{turns}");
    assert_eq!(store.purge(0).await.unwrap(), Vec::<Uuid>::new());
}

/// Commands beside a running server of an older version leave its tables as they are.
#[tokio::test]
async fn tables_of_another_version_are_not_touched_by_commands() {
    let folder = Folder::new();
    let missing = SqliteStore::open_as_it_is(&folder.file()).await;
    assert!(missing.is_err() && !folder.file().exists());
    first_release(&folder.file()).await;
    let before = std::fs::read(folder.file()).unwrap();
    let error = SqliteStore::open_as_it_is(&folder.file()).await.err().unwrap().to_string();
    assert!(
        error.contains("version 1 of the tables") && error.contains("start the server"),
        "{error}"
    );
    assert_eq!(std::fs::read(folder.file()).unwrap()[100..], before[100..]);
    folder.open().await.close().await;
    SqliteStore::open_as_it_is(&folder.file()).await.unwrap().close().await;
}

/// A clock that was a year ahead for a while neither holds messages back nor uses up their tries.
#[tokio::test]
async fn messages_outlive_jumps_of_the_clock() {
    use crate::store::Outbox;
    use crate::store::outbox::Attempt;
    let folder = Folder::new();
    let store = SqliteStore::open(&folder.file()).await.unwrap();
    let message = "INSERT INTO outbox (job_id, owner, event, url, created_ms, next_ms)
                   VALUES (?, '', 'succeeded', 'https://example.org', 0, 0)";
    sqlx::query(message).bind(Uuid::now_v7().to_string()).execute(&store.writer).await.unwrap();
    let (lease, pause) = (Duration::from_secs(30), Duration::from_secs(3600));
    let due = async || {
        let lanes = store.due_lanes(1).await.unwrap();
        store.take(&lanes, lease).await.unwrap()
    };
    let sent = async |message: crate::store::outbox::DueMessage| {
        store.sent(message.id, Attempt::RetryIn(pause), "away").await.unwrap();
    };
    sent(due().await.pop().unwrap()).await;
    assert!(due().await.is_empty());
    CLOCK_JUMP_MS.set(400 * 86_400_000);
    // It is tried once too early, and then it waits as ever.
    sent(due().await.pop().unwrap()).await;
    assert!(due().await.is_empty());
    CLOCK_JUMP_MS.set(0);
    let message = due().await.pop().expect("it does not wait for a year");
    assert_eq!(message.attempts, 2);
    assert!(due().await.is_empty());
    sent(message).await;
    assert!(due().await.is_empty());
}

#[tokio::test]
async fn jobs_are_counted_without_reading_them() {
    let folder = Folder::new();
    let store = SqliteStore::open(&folder.file()).await.unwrap();
    let explain = format!("EXPLAIN QUERY PLAN {}", jobs::COUNTS);
    let plan = sqlx::query(sqlx::AssertSqlSafe(explain)).fetch_all(&store.reader).await.unwrap();
    let steps: Vec<String> = plan.iter().map(|row| row.get("detail")).collect();
    let on_jobs: Vec<_> = steps.iter().filter(|step| step.contains(" jobs ")).collect();
    assert_eq!(on_jobs.len(), 2, "{steps:?}");
    assert!(on_jobs[0].contains("COVERING INDEX jobs_by_state"), "{steps:?}");
    assert!(on_jobs[1].contains("INDEX jobs_deleted"), "{steps:?}");
}
