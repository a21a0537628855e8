//! What a job does to itself, it does to no other: panics, aborts, stack overflows, memory, lost
//! devices and hangs, brought about at failpoints of the real program.

use hemilux::worker::needed_bytes;
use hemilux_tests::load::peak_mib;
use hemilux_tests::server::{PATIENCE, Server};
use serde_json::{Value, json};
use std::time::{Duration, Instant};
use tempfile::TempDir;

fn job(seed: u64) -> Value {
    json!({
        "scene": "cornell", "method": "stochastic", "width": 16, "height": 16,
        "max_iterations": 20, "seed": seed, "options": {"patches": 300, "hemicube_resolution": 32}
    })
}

fn server(folder: &TempDir, arguments: &[&str], failpoints: &str) -> Server {
    let environment = [("HEMILUX_FAILPOINTS", failpoints)];
    Server::start_with_environment(folder.path(), arguments, &environment)
}

fn cpu(server: &Server) -> Value {
    let devices = server.get("/v1/devices").json();
    let devices = devices["devices"].as_array().unwrap();
    devices.iter().find(|device| device["id"] == "cpu").unwrap().clone()
}

/// Runs a good job, one that does `action` in its first attempt, and another good one; the
/// second's record.
fn disturbed(arguments: &[&str], action: &str) -> (Server, TempDir, Value) {
    let folder = TempDir::new().unwrap();
    let server = server(&folder, arguments, &format!("render(seed 666, attempt 1)={action}"));
    let jobs = [1, 666, 2].map(|seed| server.submit(&job(seed)));
    let [before, hit, after] = jobs.map(|id| server.wait(&id));
    for good in [before, after] {
        assert_eq!((&good["state"], &good["attempts"]), (&json!("succeeded"), &json!(1)), "{good}");
    }
    (server, folder, hit)
}

#[test]
fn a_process_that_dies_costs_its_job_one_attempt_and_others_nothing() {
    let faults: [(&[&str], &str, &str); 3] = [
        (&[], "abort", "signal 6"),
        (&[], "overflow", "signal 6"),
        (&["--job-memory-mb", "2048"], "exhaust", "signal 6"),
    ];
    for (arguments, action, told) in faults {
        let (server, _folder, hit) = disturbed(arguments, action);
        assert_eq!((&hit["state"], &hit["attempts"]), (&json!("succeeded"), &json!(2)), "{hit}");
        let path = format!("/v1/jobs/{}/events", hit["id"].as_str().unwrap());
        let reasons: Vec<_> = server
            .events(&path, &[])
            .filter_map(|event| event.data["reason"].as_str().map(str::to_owned))
            .collect();
        assert!(reasons.len() == 1 && reasons[0].contains(told), "{action}: {reasons:?}");
        let device = cpu(&server);
        assert_eq!((&device["restarts"], &device["status"]), (&json!(1), &json!("idle")));
        assert!(device["last_fault"].as_str().unwrap().contains(told), "{device}");
    }
}

#[test]
fn a_lost_device_is_opened_again_and_a_panic_fails_its_job_in_both_isolations() {
    for isolation in ["process", "thread"] {
        let (server, _folder, hit) = disturbed(&["--isolation", isolation], "error");
        assert_eq!((&hit["state"], &hit["attempts"]), (&json!("succeeded"), &json!(2)), "{hit}");
        assert_eq!(cpu(&server)["restarts"], 1);
        assert_eq!(server.children().len(), usize::from(isolation == "process"));

        let (server, _folder, hit) = disturbed(&["--isolation", isolation], "panic");
        assert_eq!((&hit["state"], &hit["error"]["code"]), (&json!("failed"), &json!("panic")));
        assert!(hit["error"]["detail"].as_str().unwrap().contains("failpoint render"), "{hit}");
        assert_eq!(cpu(&server)["restarts"], 1);
    }
}

#[test]
fn a_poisoned_job_is_given_up_and_says_what_happened_each_time() {
    let folder = TempDir::new().unwrap();
    let server = server(&folder, &[], "render(seed 666)=abort");
    let [poisoned, good] = [666, 1].map(|seed| server.submit(&job(seed)));
    let record = server.wait(&poisoned);
    assert_eq!((&record["state"], &record["attempts"]), (&json!("failed"), &json!(5)), "{record}");
    assert_eq!(record["error"]["code"], "poisoned");
    let detail = record["error"]["detail"].as_str().unwrap();
    for attempt in 1..=5 {
        assert!(detail.contains(&format!("attempt {attempt}: ")), "{detail}");
    }
    assert_eq!(detail.matches("signal 6").count(), 5, "{detail}");
    assert_eq!(server.wait(&good)["state"], "succeeded");
}

#[test]
fn a_job_that_failed_pauses_and_others_go_on() {
    let folder = TempDir::new().unwrap();
    let rules = "render(seed 666)=error;retry-pause=last:3600000";
    let server = server(&folder, &[], rules);
    let failing = server.submit(&job(666));
    server.wait_until(&failing, |job| job["state"] == "queued" && job["attempts"] == 1);
    for seed in 1..=3 {
        assert_eq!(server.wait(&server.submit(&job(seed)))["state"], "succeeded");
    }
    let paused = server.get(&format!("/v1/jobs/{failing}")).json();
    assert_eq!((&paused["state"], &paused["attempts"]), (&json!("queued"), &json!(1)));
    // A cancel ends it at once.
    let answer = server.send("POST", &format!("/v1/jobs/{failing}/cancel"), &[], b"");
    assert_eq!((answer.status, &answer.json()["state"]), (200, &json!("cancelled")));
}

#[test]
fn silence_is_ended_and_counted_in_both_isolations() {
    for isolation in ["process", "thread"] {
        let arguments = ["--isolation", isolation, "--no-progress-s", "1"];
        let (server, _folder, hit) = disturbed(&arguments, "sleep:30000");
        assert_eq!((&hit["state"], &hit["attempts"]), (&json!("succeeded"), &json!(2)), "{hit}");
        assert!(cpu(&server)["last_fault"].as_str().unwrap().contains("no progress for 1 s"));
    }
}

#[test]
fn cancel_reaches_a_job_that_does_not_answer() {
    let folder = TempDir::new().unwrap();
    let server = server(&folder, &["--cancel-grace-s", "0.5"], "render(seed 666)=sleep:60000");
    let id = server.submit(&job(666));
    server.wait_until(&id, |job| job["state"] == "running");
    let began = Instant::now();
    assert_eq!(server.send("POST", &format!("/v1/jobs/{id}/cancel"), &[], b"").status, 200);
    let record = server.wait(&id);
    assert_eq!((&record["state"], &record["attempts"]), (&json!("cancelled"), &json!(1)));
    assert!(began.elapsed() < Duration::from_secs(10), "{:?}", began.elapsed());
    let next = server.submit(&job(1));
    assert_eq!(server.wait(&next)["state"], "succeeded");
}

#[test]
fn shutdown_hands_back_a_job_that_does_not_answer_and_leaves_no_process() {
    let folder = TempDir::new().unwrap();
    let first = server(&folder, &[], "render(seed 666)=sleep:60000");
    let id = first.submit(&job(666));
    first.wait_until(&id, |job| job["state"] == "running");
    let children = first.children();
    assert_eq!(children.len(), 1);
    assert!(first.terminate() < Duration::from_secs(10));
    assert!(!std::path::Path::new(&format!("/proc/{}", children[0])).exists());
    let second = Server::start_in(folder.path(), &[]);
    let record = second.wait(&id);
    assert_eq!((&record["state"], &record["attempts"]), (&json!("succeeded"), &json!(1)));
}

#[test]
fn a_process_that_dies_while_idle_costs_nothing() {
    let server = Server::start();
    assert_eq!(server.wait(&server.submit(&job(1)))["state"], "succeeded");
    let [child] = server.children()[..] else { panic!("one process") };
    let killed = std::process::Command::new("kill").args(["-9", &child.to_string()]).status();
    assert!(killed.unwrap().success());
    let deadline = Instant::now() + PATIENCE;
    while server.children().contains(&child) && Instant::now() < deadline {
        // It stays a zombie until its worker looks; before it is one, its pipes may still be open.
        let stat = std::fs::read_to_string(format!("/proc/{child}/stat")).unwrap_or_default();
        if stat.rsplit(") ").next().is_none_or(|rest| rest.is_empty() || rest.starts_with('Z')) {
            break;
        }
        std::thread::sleep(Duration::from_millis(10));
    }
    let record = server.wait(&server.submit(&job(2)));
    assert_eq!((&record["state"], &record["attempts"]), (&json!("succeeded"), &json!(1)));
    let fault = cpu(&server)["last_fault"].as_str().unwrap().to_owned();
    assert!(fault.contains("signal 9"), "{fault}");
}

/// The server dies at each point where something was just promised or is about to be.
#[test]
fn jobs_survive_the_server_dying_at_any_step() {
    let points = [
        "created",
        "claim",
        "claimed",
        "report",
        "artifact",
        "artifact-kept",
        "finish",
        "finished",
        // A failed attempt is put back.
        "render(attempt 1)=error;release",
    ];
    for point in points {
        let folder = TempDir::new().unwrap();
        let rules = folder.path().join("failpoints");
        std::fs::write(&rules, "").unwrap();
        let from_file = format!("@{}", rules.display());
        let data = folder.path().join("data");
        let environment = [("HEMILUX_FAILPOINTS", from_file.as_str())];
        let mut first = Server::start_with_environment(&data, &[], &environment);
        let done = first.wait(&first.submit(&job(1)));
        std::fs::write(&rules, format!("{point}=abort")).unwrap();
        let key = [("content-type", "application/json"), ("idempotency-key", "again")];
        let body = job(2).to_string();
        let send = |address: &str| {
            hemilux_tests::server::try_send(address, ("POST", "/v1/jobs"), &key, body.as_bytes())
        };
        // The answer may not come: that is what the key is for.
        let _ = send(&first.address);
        let deadline = Instant::now() + PATIENCE;
        while first.is_alive() {
            assert!(Instant::now() < deadline, "{point} was never passed");
            std::thread::sleep(Duration::from_millis(5));
        }
        std::fs::write(&rules, "").unwrap();
        let second = Server::start_with_environment(&data, &[], &environment);
        let id = send(&second.address).unwrap().json()["id"].as_str().unwrap().to_owned();
        let record = second.wait(&id);
        assert_eq!(record["state"], "succeeded", "{point}: {record}");
        let all = second.get("/v1/jobs").json()["jobs"].as_array().unwrap().len();
        assert_eq!(all, 2, "{point}: a job was lost or doubled");
        let events: Vec<_> = second.events(&format!("/v1/jobs/{id}/events"), &[]).collect();
        let ends = events.iter().filter(|event| event.name == "succeeded").count();
        assert_eq!(ends, 1, "{point}: {events:?}");
        let before = second.wait(done["id"].as_str().unwrap());
        assert_eq!(before["result"], done["result"], "{point}");
    }
}

/// The most memory that the only process of a fresh server's device takes for a job, and what the
/// job's method says that it needs; bytes.
fn taken_and_said(wish: &Value) -> (f64, f64) {
    let server = Server::start().until_ready();
    let device = server.children();
    let readiness = |process: u32| {
        let text = std::fs::read_to_string(format!("/proc/{process}/oom_score_adj")).unwrap();
        text.trim().parse::<i32>().unwrap()
    };
    assert!(readiness(device[0]) >= 500.max(readiness(server.pid())));
    let record = server.wait(&server.submit(wish));
    assert_eq!(record["state"], "succeeded", "{record}");
    assert_eq!(server.children(), device, "the process was started again");
    let scene = server.get(&format!("/v1/scenes/{}", record["request"]["scene"].as_str().unwrap()));
    let triangles = scene.json()["triangles"].as_u64().unwrap();
    let said = needed_bytes(&serde_json::from_value(wish.clone()).unwrap(), triangles).unwrap();
    (peak_mib(device[0]) * f64::from(1 << 20), said as f64)
}

#[test]
fn a_devices_process_takes_what_its_method_says_and_goes_before_the_server() {
    for (method, side, patches) in [("stochastic", 16, 60_000), ("gauss-seidel", 16, 3000)] {
        let wish = json!({"scene": "cornell", "method": method, "width": side, "height": side,
                          "max_iterations": 1, "options": {"patches": patches}});
        let (taken, said) = taken_and_said(&wish);
        assert!(
            said < 2.0 * taken && taken < 2.0 * said,
            "{method}, {side} pixels, {patches} patches: took {taken:.3e}, said {said:.3e} bytes"
        );
    }
}
