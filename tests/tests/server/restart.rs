//! What survives the end of the process.

use hemilux_tests::server::{PATIENCE, Server, serve_and_fail};
use serde_json::{Value, json};
use std::collections::BTreeSet;
use std::path::Path;
use std::time::{Duration, Instant};
use tempfile::TempDir;

#[test]
fn a_job_outlives_kill_9() {
    let folder = TempDir::new().unwrap();
    let server = Server::start_in(folder.path(), &[]);
    let wish = json!({
        "scene": "cornell", "width": 32, "height": 32, "time_budget_s": 2,
        "options": {"patches": 500}
    });
    let running = server.submit(&wish);
    let waiting = server.submit(&wish);
    server.wait_until(&running, |job| job["iterations"].as_u64() > Some(0));
    server.kill();

    let server = Server::start_in(folder.path(), &[]);
    for (id, interruptions) in [(&running, 1), (&waiting, 0)] {
        let job = server.wait(id);
        assert_eq!(job["state"], "succeeded", "{job}");
        assert_eq!(job["attempts"], 1, "{job}");
        assert_eq!(job["interruptions"], interruptions, "{job}");
        assert_eq!(server.get(&format!("/v1/jobs/{id}/image.exr")).status, 200);
    }
    let events: Vec<_> = server.events(&format!("/v1/jobs/{running}/events"), &[]).collect();
    assert!(events.windows(2).all(|pair| pair[0].id < pair[1].id));
    let states: Vec<_> = events
        .iter()
        .filter(|event| event.data.get("state").is_some())
        .map(|event| event.data["state"].as_str().unwrap())
        .collect();
    assert_eq!(states, ["queued", "running", "queued", "running", "succeeded"]);
    // The trace is that of the attempt that made the picture.
    let trace = server.get(&format!("/v1/jobs/{running}/trace")).json();
    let seconds: Vec<f64> = trace["points"]
        .as_array()
        .unwrap()
        .iter()
        .map(|point| point["seconds"].as_f64().unwrap())
        .collect();
    assert!(seconds.is_sorted(), "{seconds:?}");
}

/// The names of a job's checkpoints.
fn checkpoints(folder: &Path, job: &str) -> BTreeSet<String> {
    let files = std::fs::read_dir(folder.join("artifacts/jobs").join(job));
    let names = files.into_iter().flatten().flatten().map(|file| file.file_name());
    let names = names.map(|name| name.to_string_lossy().into_owned());
    names.filter(|name| name.ends_with(".checkpoint")).collect()
}

/// The server dies more often than a job may fail, while it runs a job in a process of its own. The
/// job is not given up; and though checkpoints are an hour apart, it gets on in every life.
#[test]
fn a_job_outlives_any_number_of_deaths_and_gets_on() {
    const DEATHS: usize = 23;
    let folder = TempDir::new().unwrap();
    let arguments = ["--checkpoint-every-s", "3600"];
    let mut server = Server::start_in(folder.path(), &arguments);
    let id = server.submit(&json!({
        "scene": "cornell", "width": 24, "height": 24, "method": "stochastic",
        "max_iterations": 1_000_000_000, "options": {"patches": 300, "hemicube_resolution": 32}
    }));
    let works = |job: &Value| job["state"] == "running" && job["iterations"].as_u64() > Some(0);
    for death in 0..DEATHS {
        let known = checkpoints(folder.path(), &id);
        let running = server.wait_until(&id, works);
        assert_eq!(running["interruptions"], death, "{running}");
        let deadline = Instant::now() + PATIENCE;
        // From the third interruption on it hurries to a first checkpoint.
        while death >= 3 && checkpoints(folder.path(), &id).is_subset(&known) {
            assert!(Instant::now() < deadline, "no checkpoint in life {death}");
            std::thread::sleep(Duration::from_millis(5));
        }
        server.kill();
        server = Server::start_in(folder.path(), &arguments);
    }
    let last = server.wait_until(&id, works);
    assert!(last["plan"]["reasons"].to_string().contains("goes on after"), "{last}");
    assert_eq!(server.send("POST", &format!("/v1/jobs/{id}/cancel"), &[], b"").status, 200);
    let job = server.wait(&id);
    assert_eq!((&job["state"], &job["attempts"]), (&json!("cancelled"), &json!(1)), "{job}");
    assert_eq!(job["interruptions"], DEATHS, "{job}");
}

#[test]
fn an_orderly_end_is_quick_and_costs_no_attempt() {
    let folder = TempDir::new().unwrap();
    let server = Server::start_in(folder.path(), &[]);
    let id = server.submit(&json!({
        "scene": "cornell", "width": 32, "height": 32, "time_budget_s": 600
    }));
    server.wait_until(&id, |job| job["iterations"].as_u64() > Some(0));
    let mut events = server.events(&format!("/v1/jobs/{id}/events"), &[]);
    assert!(events.next().is_some());
    let took = server.terminate();
    assert!(took < Duration::from_secs(10), "{took:?}");
    // The stream has ended rather than hung.
    events.for_each(drop);

    let server = Server::start_in(folder.path(), &[]);
    let job = server.wait_until(&id, |job| job["state"] == "running");
    assert_eq!(job["attempts"], 1, "{job}");
}

#[test]
fn one_data_folder_has_one_server() {
    let folder = TempDir::new().unwrap();
    let first = Server::start_in(folder.path(), &[]);
    let second = serve_and_fail(folder.path(), &[]);
    assert_eq!(second.status.code(), Some(1));
    let message = String::from_utf8_lossy(&second.stderr).into_owned();
    assert!(message.contains("in use by another hemilux process"), "{message}");
    assert_eq!(first.get("/livez").status, 200);
    // A dead server does not hold the folder.
    first.kill();
    Server::start_in(folder.path(), &[]).until_ready();
}

#[test]
fn other_machines_are_let_in_only_on_purpose() {
    let folder = TempDir::new().unwrap();
    let refused = serve_and_fail(folder.path(), &["--listen", "0.0.0.0:0"]);
    assert_eq!(refused.status.code(), Some(2));
    let message = String::from_utf8_lossy(&refused.stderr).into_owned();
    assert!(message.contains("--allow-remote"), "{message}");
}

fn quick() -> Value {
    json!({
        "scene": "cornell", "method": "stochastic", "width": 16, "height": 16,
        "max_iterations": 4, "fresh": true,
        "options": {"patches": 300, "hemicube_resolution": 32}
    })
}

/// All files below a folder.
fn files(folder: &Path) -> Vec<String> {
    let mut found = Vec::new();
    for entry in std::fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            found.extend(files(&path));
        } else {
            found.push(path.display().to_string());
        }
    }
    found.sort_unstable();
    found
}

#[test]
fn a_start_without_its_database_is_refused_and_costs_no_file() {
    let folder = TempDir::new().unwrap();
    let server = Server::start_in(folder.path(), &[]);
    let jobs: Vec<_> = (0..8).map(|_| server.submit(&quick())).collect();
    let records: Vec<_> = jobs.iter().map(|job| server.wait(job)).collect();
    server.terminate();
    let before = files(&folder.path().join("artifacts"));
    assert!(before.len() > 16, "{before:?}");
    let (database, aside) = (folder.path().join("hemilux.sqlite"), folder.path().join("aside"));
    let is_refused = || {
        let refused = serve_and_fail(folder.path(), &[]);
        let message = String::from_utf8_lossy(&refused.stderr).into_owned();
        assert_eq!(refused.status.code(), Some(1), "{message}");
        for told in ["do not belong together", "Put back the hemilux.sqlite", "--adopt-files"] {
            assert!(message.contains(told), "{message}");
        }
        assert_eq!(files(&folder.path().join("artifacts")), before);
    };
    std::fs::rename(&database, &aside).unwrap();
    is_refused();
    // Another service's database, with things in it, is no better.
    let other = TempDir::new().unwrap();
    let server = Server::start_in(other.path(), &[]);
    server.wait(&server.submit(&quick()));
    server.terminate();
    std::fs::copy(other.path().join("hemilux.sqlite"), &database).unwrap();
    is_refused();
    // Whoever insists loses nothing either: so many files stay where they are.
    let server = Server::start_in(folder.path(), &["--adopt-files"]);
    let deadline = Instant::now() + PATIENCE;
    while server.get("/metrics").text().contains("hemilux_orphans_left 0\n") {
        assert!(Instant::now() < deadline, "the sweep finds nothing");
        std::thread::sleep(Duration::from_millis(20));
    }
    assert_eq!(files(&folder.path().join("artifacts")).len(), before.len());
    server.terminate();
    // Told to, it moves them into quarantine, from where the right database has them back.
    let server = Server::start_in(folder.path(), &["--sweep-large"]);
    let deadline = Instant::now() + PATIENCE;
    while files(&folder.path().join("artifacts/jobs")).iter().any(|file| file.contains(&jobs[0])) {
        assert!(Instant::now() < deadline, "nothing goes into quarantine");
        std::thread::sleep(Duration::from_millis(20));
    }
    server.terminate();
    std::fs::rename(&aside, &database).unwrap();
    let server = Server::start_in(folder.path(), &["--adopt-files"]);
    for record in &records {
        for picture in record["result"].as_array().unwrap() {
            let deadline = Instant::now() + PATIENCE;
            while server.get(picture["url"].as_str().unwrap()).status != 200 {
                assert!(Instant::now() < deadline, "a picture never came back: {picture}");
                std::thread::sleep(Duration::from_millis(20));
            }
        }
    }
}

#[test]
fn a_service_listens_and_works_before_its_files_are_looked_through() {
    let folder = TempDir::new().unwrap();
    let server = Server::start_in(folder.path(), &[]);
    let job = server.submit(&quick());
    server.wait(&job);
    server.terminate();
    let orphan = folder.path().join(format!("artifacts/jobs/{job}/{}.png", "ab".repeat(32)));
    std::fs::write(&orphan, b"no record").unwrap();
    let half = folder.path().join("artifacts/jobs/half.png#1");
    std::fs::write(&half, b"half").unwrap();
    // The sweep takes longer than this test is patient.
    let rules = folder.path().join("rules");
    std::fs::write(&rules, "sweep=sleep:600000").unwrap();
    let rules = format!("@{}", rules.display());
    let held = [("HEMILUX_FAILPOINTS", rules.as_str())];
    let server = Server::start_with_environment(folder.path(), &[], &held).until_ready();
    assert_eq!(server.wait(&server.submit(&quick()))["state"], "succeeded");
    assert!(orphan.exists() && half.exists());
    server.kill();
    // It comes, all the same.
    let server = Server::start_in(folder.path(), &[]);
    let deadline = Instant::now() + PATIENCE;
    while orphan.exists() || half.exists() {
        assert!(Instant::now() < deadline, "no sweep comes");
        std::thread::sleep(Duration::from_millis(20));
    }
    assert_eq!(server.get(&format!("/v1/jobs/{job}/image.exr")).status, 200);
    let kept = files(&folder.path().join("artifacts/quarantine"));
    assert!(kept.len() == 1 && kept[0].ends_with(".png"), "{kept:?}");
}

#[test]
fn a_clock_that_is_a_year_ahead_removes_nothing() {
    let folder = TempDir::new().unwrap();
    let server = Server::start_in(folder.path(), &[]);
    let job = server.submit(&quick());
    server.wait(&job);
    // It notes the time as it runs.
    server.terminate();
    let ahead = [("HEMILUX_FAILPOINTS", "clock=jump:31536000")];
    let doubted = |server: &Server| {
        let text = server.get("/metrics").text();
        let line = text.lines().find_map(|line| line.strip_prefix("hemilux_clock_doubted "));
        line.expect("the metric is there").to_owned()
    };
    let keep = ["--keep-days", "30", "--quarantine-days", "30"];
    let server = Server::start_with_environment(folder.path(), &keep, &ahead);
    let deadline = Instant::now() + PATIENCE;
    // Said after what has expired was looked for.
    while doubted(&server) != "1" {
        assert!(Instant::now() < deadline, "the clock is not doubted");
        std::thread::sleep(Duration::from_millis(20));
    }
    assert_eq!(server.get(&format!("/v1/jobs/{job}/image.exr")).status, 200);
    server.terminate();
    // Where the operator says that the clock is right, the job goes.
    let keep = [&keep[..], &["--clock-grace-hours", "0"]].concat();
    let server = Server::start_with_environment(folder.path(), &keep, &ahead);
    let deadline = Instant::now() + PATIENCE;
    while server.get(&format!("/v1/jobs/{job}")).status != 404 {
        assert!(Instant::now() < deadline, "the job never went");
        std::thread::sleep(Duration::from_millis(20));
    }
    assert_eq!(doubted(&server), "0");
}
