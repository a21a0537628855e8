//! Backups that are taken while jobs are sent and rendered and the server is killed again and
//! again: each, restored, is a service that has lost nothing that it knows of.

use hemilux_tests::server::{PATIENCE, Server, program, try_send};
use serde_json::{Value, json};
use std::path::Path;
use std::process::{Command, Output};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Mutex, RwLock};
use std::time::{Duration, Instant};
use tempfile::TempDir;

/// Jobs, each with a seed of its own.
const JOBS: u64 = 8;
/// Kills of the server.
const KILLS: usize = 5;
/// Backups that are restored.
const RESTORED: usize = 3;
/// Checkpoints as often as can be: they are what changes while a backup is taken.
const SERVE: [&str; 2] = ["--checkpoint-every-s", "0.05"];

fn wish(seed: u64) -> Value {
    json!({
        "scene": "cornell", "method": "stochastic", "width": 24, "height": 24,
        "max_iterations": 300, "seed": seed, "options": {"patches": 500, "hemicube_resolution": 32}
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

#[test]
fn backups_taken_under_load_and_kills_lose_nothing() {
    let server = Server::start();
    let undisturbed: Vec<_> = (0..JOBS).map(|seed| server.submit(&wish(seed))).collect();
    let undisturbed: Vec<_> = undisturbed.iter().map(|id| hashes(&server.wait(id))).collect();
    server.terminate();

    let folder = TempDir::new().unwrap();
    let data = folder.path().join("data");
    let first = Server::start_in(&data, &SERVE);
    let address = RwLock::new(first.address.clone());
    let (ended, taken) = (AtomicBool::new(false), Mutex::new(Vec::new()));
    std::thread::scope(|scope| {
        scope.spawn(|| (0..JOBS).for_each(|seed| submit(&address, seed)));
        scope.spawn(|| {
            for number in 0.. {
                let backup = folder.path().join(format!("backup-{number}"));
                let output = command("backup", &backup, &data);
                assert!(output.status.success(), "{}", told(&output));
                taken.lock().unwrap().push(backup);
                if ended.load(Ordering::Relaxed) {
                    return;
                }
            }
        });
        let mut server = first;
        for kill in 0..KILLS {
            let backups = taken.lock().unwrap().len();
            let deadline = Instant::now() + PATIENCE;
            // Something happens between two kills: a backup at least begins and ends.
            while taken.lock().unwrap().len() < backups + 1 + kill % 2 {
                assert!(Instant::now() < deadline, "no backup is taken");
                std::thread::sleep(Duration::from_millis(20));
            }
            server.kill();
            server = Server::start_in(&data, &SERVE);
            address.write().unwrap().clone_from(&server.address);
        }
        let deadline = Instant::now() + PATIENCE;
        while jobs(&server).iter().filter(|job| job["state"] == "succeeded").count() < JOBS as usize
        {
            assert!(Instant::now() < deadline, "the jobs are never done: {:?}", jobs(&server));
            std::thread::sleep(Duration::from_millis(50));
        }
        ended.store(true, Ordering::Relaxed);
        jobs(&server).iter().for_each(|job| is_right(&server, job, &undisturbed));
    });

    let taken = taken.into_inner().unwrap();
    let (mut done_before, mut done_after) = (0, 0);
    for number in 0..RESTORED {
        let backup = &taken[(number + 1) * (taken.len() - 1) / (RESTORED + 1)];
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
        // Nothing that a record names was left behind, and nothing else is there.
        assert!(server.get("/metrics").text().contains("hemilux_orphans_left 0"));
        server.terminate();
    }
    println!(
        "{} backups; in {RESTORED} of them {done_before} jobs were done, {done_after} went on",
        taken.len()
    );
    assert!(done_before > 0 && done_after > 0, "the backups show nothing");
    // Restored over a folder that is in use, or has been used, it would destroy what is there.
    let refused = command("restore", &taken[0], &data);
    assert_eq!(refused.status.code(), Some(1));
    assert!(told(&refused).contains("is not empty"), "{}", told(&refused));
}

/// Sends a job until a server has taken it; under its key it is made once.
fn submit(address: &RwLock<String>, seed: u64) {
    let key = format!("backup-{seed}");
    let headers = [("content-type", "application/json"), ("idempotency-key", key.as_str())];
    let body = wish(seed).to_string();
    let deadline = Instant::now() + PATIENCE;
    loop {
        let address = address.read().unwrap().clone();
        let answer = try_send(&address, ("POST", "/v1/jobs"), &headers, body.as_bytes());
        if answer.is_ok_and(|answer| answer.status == 202) {
            return;
        }
        assert!(Instant::now() < deadline, "no server takes job {seed}");
        std::thread::sleep(Duration::from_millis(20));
    }
}
