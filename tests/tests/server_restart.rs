//! What survives the end of the process.

use hemilux_tests::server::{Server, serve_and_fail};
use serde_json::json;
use std::time::Duration;
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
    for (id, attempts) in [(&running, 2), (&waiting, 1)] {
        let job = server.wait(id);
        assert_eq!(job["state"], "succeeded", "{job}");
        assert_eq!(job["attempts"], attempts, "{job}");
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
