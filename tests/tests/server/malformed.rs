//! Broken, hostile and odd scenes, sent to a running server.

use hemilux_engine::scene::made::assemble;
use hemilux_tests::bombs;
use hemilux_tests::load::peak_mib;
use hemilux_tests::malformed::{Expect, cases, triangle};
use hemilux_tests::server::{PATIENCE, Server, scene};
use serde_json::{Value, json};
use tempfile::TempDir;

#[test]
fn every_malformed_scene_gets_a_clear_answer_or_a_picture() {
    let mut server = Server::start();
    for (name, bytes, expect) in cases() {
        let answer = server.post_scene(&bytes);
        match expect {
            Expect::Refused { at_contains, what_contains, too_large } => {
                let problem = answer.problem(if too_large { 413 } else { 422 });
                let detail = problem["detail"].as_str().unwrap();
                assert!(detail.contains(at_contains), "{name}: {detail}");
                assert!(detail.contains(what_contains), "{name}: {detail}");
            }
            Expect::Accepted { warning_contains } => {
                assert!(matches!(answer.status, 200 | 201), "{name}: {}", answer.text());
                let record = answer.json();
                let warnings = record["warnings"].to_string();
                assert_eq!(warning_contains.is_empty(), warnings == "[]", "{name}: {warnings}");
                let job = server.wait(&server.submit(&json!({
                    "scene": record["id"], "width": 8, "height": 8, "max_iterations": 2,
                    "options": {"patches": 100, "hemicube_resolution": 16}
                })));
                assert_eq!(job["state"], "succeeded", "{name}: {job}");
            }
        }
        assert!(server.is_alive(), "{name} ended the server");
    }
    assert_eq!(server.get("/readyz").status, 200);
}

/// A job whose bits are determined.
fn determined(iterations: u64) -> Value {
    json!({"scene": "cornell", "method": "stochastic", "width": 32, "height": 32, "seed": 5,
           "max_iterations": iterations, "fresh": true, "options": {"patches": 2000}})
}

fn picture(server: &Server, job: &Value) -> Vec<u8> {
    let path = format!("/v1/jobs/{}/image.exr", job["id"].as_str().unwrap());
    let answer = server.get(&path);
    assert_eq!(answer.status, 200, "{}", answer.text());
    answer.body
}

#[test]
fn bombs_are_refused_and_neither_the_server_nor_a_running_job_notices() {
    // Before the job begins: they take longer to make than to refuse.
    let bombs = [
        ("four pictures of 64 M texels", bombs::textures(4)),
        ("nested 200,000 deep", bombs::nesting(200_000)),
        ("a list of 100 MB", bombs::list(100_000_000)),
    ];
    let mut server = Server::start();
    // It runs until it is told to stop, so for as long as bombs come.
    let running = server.submit(&determined(1_000_000_000));
    server.wait_until(&running, |job| job["state"] == "running");
    for (name, bomb) in &bombs {
        let answer = server.post_scene(bomb);
        assert!(matches!(answer.status, 413 | 422), "{name}: {}", answer.text());
        let problem = answer.problem(answer.status);
        assert!(problem["detail"].as_str().unwrap().len() > 40, "{name}: {problem}");
        println!("{name}: {problem}");
        assert!(server.is_alive(), "{name} ended the server");
    }
    let peak = peak_mib(server.pid());
    assert!(peak < 200.0, "the server took {peak} MiB");
    assert_eq!(server.get(&format!("/v1/jobs/{running}")).json()["state"], "running");
    assert_eq!(server.send("POST", &format!("/v1/jobs/{running}/cancel"), &[], b"").status, 200);
    let disturbed = server.wait(&running);
    assert_eq!(
        (&disturbed["state"], &disturbed["attempts"]),
        (&json!("cancelled"), &json!(1)),
        "{disturbed}"
    );
    // Its picture is that of a job which nobody disturbs and which ends after as many iterations.
    let iterations = disturbed["iterations"].as_u64().filter(|&done| done > 0).expect("work");
    let again = server.submit(&determined(iterations));
    let undisturbed = server.wait_at_most(10 * PATIENCE, &again);
    assert_eq!(
        (&undisturbed["state"], &undisturbed["iterations"]),
        (&json!("succeeded"), &json!(iterations)),
        "{undisturbed}"
    );
    assert!(picture(&server, &disturbed) == picture(&server, &undisturbed));
}

#[test]
fn an_import_that_dies_hangs_or_takes_all_memory_refuses_its_scene_only() {
    let ends = [
        ("abort", "signal 6", "validator"),
        ("overflow", "signal 6", "validator"),
        ("exhaust", "512 MiB", "--import-memory-mb"),
        ("sleep:60000", "2 seconds", "--import-seconds"),
    ];
    for (action, told, to_do) in ends {
        let folder = TempDir::new().unwrap();
        let environment = [("HEMILUX_FAILPOINTS", &*format!("import={action}"))];
        let seconds = if action.starts_with("sleep") { "2" } else { "60" };
        let bounds = ["--import-seconds", seconds, "--import-memory-mb", "512"];
        let server = Server::start_with_environment(folder.path(), &bounds, &environment);
        let problem = server.post_scene(&scene("furnace.glb")).problem(422);
        let detail = problem["detail"].as_str().unwrap();
        assert!(detail.contains(told) && detail.contains(to_do), "{action}: {detail}");
        assert_eq!(server.get("/v1/scenes").json()["scenes"], json!([]), "{action}");
        // Scenes of the program's own are not imported there.
        server.wait(&server.submit(&determined(1)));
    }
}

#[test]
fn large_uploads_are_never_in_the_servers_memory() {
    let server = Server::start().until_ready();
    let before = peak_mib(server.pid());
    let (mut root, mut binary) = triangle();
    binary.resize(150 << 20, 0);
    root["buffers"][0]["byteLength"] = json!(binary.len());
    let file = assemble(&root, &binary);
    let answer = server.post_scene(&file);
    assert_eq!(answer.status, 201, "{}", answer.text());
    // The second time its file is checked.
    assert_eq!(server.post_scene(&file).status, 200);
    let name = "content-disposition: form-data; name=";
    let mut form = format!("--x\r\n{name}\"scene\"\r\n\r\n").into_bytes();
    root["buffers"][0]["uri"] = json!("big.bin");
    form.extend(root.to_string().bytes());
    form.extend(format!("\r\n--x\r\n{name}\"big.bin\"\r\n\r\n").bytes());
    form.extend(&binary);
    form.extend(b"\r\n--x--\r\n");
    let kind = [("content-type", "multipart/form-data; boundary=x")];
    let answer = server.send("POST", "/v1/scenes", &kind, &form);
    assert_eq!(answer.status, 201, "{}", answer.text());
    assert_eq!(answer.json()["format"], "bundle");
    let growth = peak_mib(server.pid()) - before;
    assert!(growth < 60.0, "the server grew by {growth} MiB");
}
