//! Backups that are taken while jobs are sent and rendered and the server is killed again and
//! again: each, restored, is a service that has lost nothing that it knows of.

use hemilux_tests::server::{Answer, PATIENCE, Server, program, try_send};
use serde_json::{Value, json};
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Mutex, RwLock};
use std::time::{Duration, Instant};
use tempfile::TempDir;

/// Different jobs, each with a seed of its own; they are sent again and again.
const SEEDS: u64 = 8;
/// Jobs that wait or run at any time while backups are taken.
const UNFINISHED: usize = 4;
/// Kills of the server.
const KILLS: usize = 5;
/// Backups that are restored.
const RESTORED: usize = 3;
/// Checkpoints as often as can be: they are what changes while a backup is taken.
const SERVE: [&str; 2] = ["--checkpoint-every-s", "0.05"];

fn wish(seed: u64) -> Value {
    json!({
        "scene": "cornell", "method": "stochastic", "width": 24, "height": 24,
        "max_iterations": 300, "seed": seed, "fresh": true,
        "options": {"patches": 500, "hemicube_resolution": 32}
    })
}

fn hashes(job: &Value) -> Vec<Value> {
    let files = job["result"].as_array().unwrap_or_else(|| panic!("no result: {job}"));
    files.iter().map(|file| file["sha256"].clone()).collect()
}

fn command(name: &str, folder: &Path, data: &Path) -> Output {
    let mut command = Command::new(program());
    command.arg(name).arg(folder).arg("--data-dir").arg(data);
    command.output().expect("the program runs")
}

fn told(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

fn jobs(server: &Server) -> Vec<Value> {
    server.get("/v1/jobs?limit=200").json()["jobs"].as_array().expect("a list").clone()
}

/// The job's pictures are all there and whole, and those of a run that nobody disturbed.
fn is_right(server: &Server, job: &Value, undisturbed: &[Vec<Value>]) {
    let seed = job["request"]["seed"].as_u64().expect("a seed") as usize;
    assert_eq!(hashes(job), undisturbed[seed], "{job}");
    for picture in job["result"].as_array().expect("pictures") {
        // The server compares the content with its hash.
        assert_eq!(server.get(picture["url"].as_str().expect("a path")).status, 200, "{job}");
    }
}

/// The jobs of a list that have succeeded.
fn done(jobs: &[Value]) -> usize {
    jobs.iter().filter(|job| job["state"] == "succeeded").count()
}

/// The files below a folder, by their paths from there.
fn files(folder: &Path) -> BTreeSet<PathBuf> {
    let (mut folders, mut files) = (vec![folder.to_owned()], BTreeSet::new());
    while let Some(next) = folders.pop() {
        for entry in std::fs::read_dir(next).unwrap() {
            let path = entry.unwrap().path();
            if path.is_dir() {
                folders.push(path);
            } else {
                files.insert(path.strip_prefix(folder).unwrap().to_owned());
            }
        }
    }
    files
}

/// The files that the records of a server name, all of whose jobs have ended.
fn named(server: &Server) -> BTreeSet<PathBuf> {
    let text = |value: &Value| value.as_str().expect("a text").to_owned();
    let mut named = BTreeSet::from(["store-id".into()]);
    for job in jobs(server) {
        let job = text(&job["id"]);
        let manifest = server.get(&format!("/v1/jobs/{job}/manifest")).json();
        named.insert(format!("scenes/{}", text(&manifest["scene"]["sha256"])).into());
        for picture in manifest["pictures"].as_array().expect("pictures") {
            let (hash, format) = (text(&picture["sha256"]), text(&picture["format"]));
            named.insert(format!("jobs/{job}/{hash}.{format}").into());
        }
        let solution = &manifest["solution"];
        for file in [&solution["file"], &solution["baked"]["file"]] {
            named.insert(format!("jobs/{job}/{}", text(file)).into());
        }
    }
    named
}

/// Nothing that a record names was left behind, and nothing else is there, in quarantine either.
fn has_the_files_it_names(server: &Server, data: &Path) {
    let deadline = Instant::now() + PATIENCE;
    // The last checkpoints may be on their way still.
    loop {
        let (named, there) = (named(server), files(&data.join("artifacts")));
        if named == there {
            return;
        }
        let missing: Vec<_> = named.difference(&there).collect();
        let unnamed: Vec<_> = there.difference(&named).collect();
        assert!(Instant::now() < deadline, "missing: {missing:?}, named by nothing: {unnamed:?}");
        std::thread::sleep(Duration::from_millis(50));
    }
}

/// A server that is killed again and again, and what is done beside it.
struct Stage<'a> {
    data: &'a Path,
    /// Where the present server listens.
    address: RwLock<String>,
    /// Backups in the order in which they were taken.
    backups: Mutex<Vec<PathBuf>>,
    /// Set when there are enough backups, and where the test fails.
    over: AtomicBool,
}

/// Sets [`Stage::over`] when it is dropped, also by a panic: the threads that run until then would
/// run for ever.
struct Ending<'a>(&'a Stage<'a>);

impl Drop for Ending<'_> {
    fn drop(&mut self) {
        self.0.over.store(true, Ordering::Relaxed);
    }
}

impl Stage<'_> {
    fn is_over(&self) -> bool {
        self.over.load(Ordering::Relaxed)
    }

    fn backups(&self) -> Vec<PathBuf> {
        self.backups.lock().unwrap().clone()
    }

    /// Takes one backup after the other.
    fn take_backups(&self, folder: &Path) {
        let mut number = 0;
        while !self.is_over() {
            let backup = folder.join(format!("backup-{number}"));
            let output = command("backup", &backup, self.data);
            assert!(output.status.success(), "{}", told(&output));
            self.backups.lock().unwrap().push(backup);
            number += 1;
        }
    }

    /// Sends jobs, so that some are unfinished at any time, however long a backup takes.
    fn send_jobs(&self) {
        let mut number = 0;
        while !self.is_over() {
            let unfinished = self.count("queued").zip(self.count("running"));
            if unfinished.is_some_and(|(queued, running)| queued + running < UNFINISHED) {
                self.submit(number);
                number += 1;
            } else {
                std::thread::sleep(Duration::from_millis(10));
            }
        }
    }

    /// How many jobs are in a state, if a server answers.
    fn count(&self, state: &str) -> Option<usize> {
        let path = format!("/v1/jobs?limit=200&state={state}");
        let answer = self.ask("GET", &path, &[], b"").filter(|answer| answer.status == 200)?;
        // An answer that broke off is no answer.
        let list: Value = serde_json::from_slice(&answer.body).ok()?;
        list["jobs"].as_array().map(Vec::len)
    }

    /// Sends a job until a server has taken it; under its key it is made once.
    fn submit(&self, number: u64) {
        let key = format!("backup-{number}");
        let headers = [("content-type", "application/json"), ("idempotency-key", key.as_str())];
        let body = wish(number % SEEDS).to_string();
        let deadline = Instant::now() + PATIENCE;
        while !self.is_over() {
            let answer = self.ask("POST", "/v1/jobs", &headers, body.as_bytes());
            if answer.is_some_and(|answer| answer.status == 202) {
                return;
            }
            assert!(Instant::now() < deadline, "no server takes job {number}");
        }
    }

    /// Asks the present server, which may be killed at any time; then there is no answer.
    fn ask(
        &self,
        method: &str,
        path: &str,
        headers: &[(&str, &str)],
        body: &[u8],
    ) -> Option<Answer> {
        let address = self.address.read().unwrap().clone();
        let answer = try_send(&address, (method, path), headers, body);
        if answer.is_err() {
            std::thread::sleep(Duration::from_millis(20));
        }
        answer.ok()
    }

    /// Waits until that many backups more have been taken.
    fn wait_for_backups(&self, more: usize) {
        let wanted = self.backups().len() + more;
        let deadline = Instant::now() + PATIENCE;
        while self.backups().len() < wanted {
            assert!(Instant::now() < deadline, "no backup is taken");
            std::thread::sleep(Duration::from_millis(20));
        }
    }

    /// Kills the server again and again; the last one.
    fn kill(&self, mut server: Server) -> Server {
        for kill in 0..KILLS {
            // Something happens between two kills: a backup at least begins and ends.
            self.wait_for_backups(1 + kill % 2);
            server.kill();
            server = Server::start_in(self.data, &SERVE);
            self.address.write().unwrap().clone_from(&server.address);
        }
        server
    }
}

/// Waits until that many jobs are done.
fn wait_until_done(server: &Server, wanted: usize) {
    let deadline = Instant::now() + PATIENCE;
    while done(&jobs(server)) < wanted {
        assert!(Instant::now() < deadline, "the jobs are never done: {:?}", jobs(server));
        std::thread::sleep(Duration::from_millis(20));
    }
}

#[test]
fn backups_taken_under_load_and_kills_lose_nothing() {
    let server = Server::start();
    let undisturbed: Vec<_> = (0..SEEDS).map(|seed| server.submit(&wish(seed))).collect();
    let undisturbed: Vec<_> = undisturbed.iter().map(|id| hashes(&server.wait(id))).collect();
    server.terminate();

    let folder = TempDir::new().unwrap();
    let data = folder.path().join("data");
    let first = Server::start_in(&data, &SERVE);
    let stage = Stage {
        data: &data,
        address: RwLock::new(first.address.clone()),
        backups: Mutex::default(),
        over: AtomicBool::new(false),
    };
    // Backups in which some jobs are done and others are not, however slow the disk is: those that
    // begin after some are done and end before the last one is sent.
    let telling = std::thread::scope(|scope| {
        let _ending = Ending(&stage);
        scope.spawn(|| stage.send_jobs());
        scope.spawn(|| stage.take_backups(folder.path()));
        wait_until_done(&first, UNFINISHED);
        // The next one may have begun before.
        let begun = stage.backups().len() + 1;
        let server = stage.kill(first);
        let telling = stage.backups().split_off(begun);
        stage.over.store(true, Ordering::Relaxed);
        for job in jobs(&server) {
            let job = server.wait(job["id"].as_str().expect("an id"));
            is_right(&server, &job, &undisturbed);
        }
        telling
    });

    let (mut done_before, mut done_after) = (0, 0);
    for number in 0..RESTORED {
        let backup = &telling[number * (telling.len() - 1) / (RESTORED - 1)];
        let restored = folder.path().join(format!("restored-{number}"));
        let output = command("restore", backup, &restored);
        assert!(output.status.success(), "{}", told(&output));
        let server = Server::start_in(&restored, &SERVE);
        for job in jobs(&server) {
            if job["state"] == "succeeded" {
                done_before += 1;
                is_right(&server, &job, &undisturbed);
            } else {
                done_after += 1;
                let id = job["id"].as_str().expect("an id");
                is_right(&server, &server.wait(id), &undisturbed);
            }
        }
        has_the_files_it_names(&server, &restored);
        server.terminate();
    }
    println!(
        "{} backups, {} of them telling; in those restored {done_before} jobs were done, \
         {done_after} went on",
        stage.backups().len(),
        telling.len()
    );
    assert!(done_before > 0 && done_after > 0, "the backups show nothing");
    // Restored over a folder that is in use, or has been used, it would destroy what is there.
    let refused = command("restore", &telling[0], &data);
    assert_eq!(refused.status.code(), Some(1));
    assert!(told(&refused).contains("is not empty"), "{}", told(&refused));
}
