//! What a server keeps of jobs: checkpoints that survive its death, more budget, other views, the
//! record of a result, baked light.

use hemilux::artifacts::sha256_hex;
use hemilux_engine::scene::gltf::{ImportLimits, Resources, import};
use hemilux_tests::server::{PATIENCE, Server};
use serde_json::{Value, json};
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};
use tempfile::TempDir;

fn job(iterations: u64) -> Value {
    json!({
        "scene": "cornell", "method": "stochastic", "width": 48, "height": 48,
        "max_iterations": iterations, "seed": 7, "fresh": true,
        "options": { "patches": 1500, "hemicube_resolution": 64 },
    })
}

/// Checkpoints of a job, in the data folder.
fn checkpoints(folder: &Path, job: &str) -> Vec<PathBuf> {
    let files = std::fs::read_dir(folder.join("artifacts/jobs").join(job));
    let paths = files.into_iter().flatten().flatten().map(|entry| entry.path());
    paths.filter(|path| path.extension().is_some_and(|ending| ending == "checkpoint")).collect()
}

/// Waits until a first checkpoint of a job was replaced by a second, so that one is on record.
fn wait_for_two_checkpoints(folder: &Path, job: &str) {
    let deadline = Instant::now() + PATIENCE;
    let mut seen = BTreeSet::new();
    while seen.len() < 2 {
        seen.extend(checkpoints(folder, job));
        assert!(Instant::now() < deadline, "no checkpoints were written");
        std::thread::sleep(Duration::from_millis(5));
    }
}

fn exr(server: &Server, job: &str) -> Vec<u8> {
    let answer = server.get(&format!("/v1/jobs/{job}/image.exr"));
    assert_eq!(answer.status, 200, "{}", answer.text());
    answer.body
}

fn reasons(job: &Value) -> String {
    job["plan"]["reasons"].to_string()
}

/// kill -9 in the middle: the next process goes on from the last checkpoint, to the same bits.
#[test]
fn a_killed_job_goes_on_from_its_checkpoint() {
    let folder = TempDir::new().expect("a folder");
    let arguments = ["--checkpoint-every-s", "0.2"];
    let server = Server::start_in(folder.path(), &arguments);
    let long = job(6000);
    let id = server.submit(&long);
    wait_for_two_checkpoints(folder.path(), &id);
    let before = server.get(&format!("/v1/jobs/{id}")).json();
    assert_eq!(before["state"], "running", "it was killed too late: {before}");
    server.kill();

    let server = Server::start_in(folder.path(), &arguments);
    let after = server.wait(&id);
    assert_eq!(after["state"], "succeeded", "{after}");
    assert!(reasons(&after).contains("goes on after"), "{}", reasons(&after));
    assert_eq!(after["stats"]["iterations"], 6000);
    let undisturbed = server.submit(&long);
    let reference = server.wait(&undisturbed);
    assert!(!reasons(&reference).contains("goes on"), "{}", reasons(&reference));
    assert!(exr(&server, &id) == exr(&server, &undisturbed), "not the same bits");
    assert_eq!(after["stats"]["shots"], reference["stats"]["shots"]);
    assert_eq!(checkpoints(folder.path(), &id).len(), 1, "one is kept, the last");
}

/// Death between a checkpoint's file and its record, and between that and the removal of the file
/// before: the next process goes on from what is recorded, to the same bits, and tidies up.
#[test]
fn death_at_a_checkpoint_loses_nothing() {
    let arguments = ["--checkpoint-every-s", "0.2"];
    let long = job(6000);
    let mut pictures = Vec::new();
    for point in ["checkpoint", "checkpoint-kept"] {
        let folder = TempDir::new().expect("a folder");
        let rules = folder.path().join("failpoints");
        std::fs::write(&rules, "").expect("rules");
        let from_file = format!("@{}", rules.display());
        let data = folder.path().join("data");
        let environment = [("HEMILUX_FAILPOINTS", from_file.as_str())];
        let mut first = Server::start_with_environment(&data, &arguments, &environment);
        let id = first.submit(&long);
        wait_for_two_checkpoints(&data, &id);
        std::fs::write(&rules, format!("{point}=abort")).expect("rules");
        let deadline = Instant::now() + PATIENCE;
        while first.is_alive() {
            assert!(Instant::now() < deadline, "{point} was never passed");
            std::thread::sleep(Duration::from_millis(5));
        }
        assert_eq!(checkpoints(&data, &id).len(), 2, "{point}: the file before is still there");

        let server = Server::start_in(&data, &arguments);
        let after = server.wait(&id);
        assert_eq!(after["state"], "succeeded", "{point}: {after}");
        assert!(reasons(&after).contains("goes on after"), "{point}: {}", reasons(&after));
        assert_eq!(checkpoints(&data, &id).len(), 1, "{point}: one is kept, the last");
        pictures.push(exr(&server, &id));
        if pictures.len() == 1 {
            let undisturbed = server.submit(&long);
            server.wait(&undisturbed);
            pictures.push(exr(&server, &undisturbed));
        }
    }
    assert!(pictures.iter().all(|picture| *picture == pictures[0]), "not the same bits");
}

#[test]
fn an_ended_job_can_be_given_more_budget() {
    let folder = TempDir::new().expect("a folder");
    let server = Server::start_in(folder.path(), &[]);
    let id = server.submit(&job(40));
    let extend = |limits: &Value| server.post(&format!("/v1/jobs/{id}/extend"), limits);
    let ended = server.wait(&id);
    assert_eq!(ended["stats"]["iterations"], 40);
    for (limits, field) in [
        (json!({}), "time_budget_s"),
        (json!({ "max_iterations": 40 }), "max_iterations"),
        (json!({ "time_budget_s": 1e-6 }), "time_budget_s"),
        (json!({ "target_error": 0.99 }), "target_error"),
        (json!({ "max_iterations": 0 }), "max_iterations"),
        (json!({ "time_budget_s": 1e6 }), "time_budget_s"),
    ] {
        let problem = extend(&limits).problem(422);
        assert_eq!(problem["errors"][0]["field"], field, "{problem}");
    }
    extend(&json!({ "iterations": 5 })).problem(422);
    let nobody = "/v1/jobs/00000000-0000-7000-8000-000000000000/extend";
    server.post(nobody, &json!({ "max_iterations": 5 })).problem(404);

    let answer = extend(&json!({ "max_iterations": 100 }));
    assert_eq!(answer.status, 202, "{}", answer.text());
    assert_eq!(answer.json()["state"], "queued");
    let extended = server.wait(&id);
    assert_eq!(
        (&extended["state"], &extended["stats"]["iterations"]),
        (&json!("succeeded"), &json!(100))
    );
    assert_eq!(extended["request"]["max_iterations"], 100);
    assert!(reasons(&extended).contains("goes on after 40"), "{}", reasons(&extended));
    let seconds = |job: &Value| job["stats"]["seconds_solve"].as_f64().expect("seconds");
    assert!(seconds(&extended) > seconds(&ended), "time adds up");
    let whole = server.submit(&job(100));
    server.wait(&whole);
    assert!(exr(&server, &id) == exr(&server, &whole), "as if it had never stopped");

    // One story, told from the start: ids only grow, the stream ends at the last end.
    let events: Vec<_> = server.events(&format!("/v1/jobs/{id}/events"), &[]).collect();
    assert!(events.windows(2).all(|two| two[0].id < two[1].id));
    let states: Vec<&str> =
        events.iter().filter_map(|event| event.data["state"].as_str()).collect();
    let once = ["queued", "running", "succeeded"];
    assert_eq!(states, [once, once].concat());

    // What was damaged since is seen, said, and begun again.
    let file = checkpoints(folder.path(), &id).pop().expect("a solution");
    let mut bytes = std::fs::read(&file).expect("it can be read");
    let middle = bytes.len() / 2;
    bytes[middle] ^= 1;
    std::fs::write(&file, bytes).expect("it can be written");
    assert_eq!(extend(&json!({ "max_iterations": 120 })).status, 202);
    let again = server.wait(&id);
    assert_eq!(again["stats"]["iterations"], 120, "{again}");
    assert!(again["warnings"].to_string().contains("damaged"), "{}", again["warnings"]);
    assert!(!reasons(&again).contains("goes on"));

    // A cancelled one goes on, too.
    let cancelled = server.submit(&job(1_000_000));
    server.wait_until(&cancelled, |job| job["iterations"].as_u64() > Some(20));
    server.post(&format!("/v1/jobs/{cancelled}/cancel"), &json!({}));
    let done = server.wait(&cancelled)["stats"]["iterations"].as_u64().expect("iterations");
    let limits = json!({ "max_iterations": done + 10 });
    assert_eq!(server.post(&format!("/v1/jobs/{cancelled}/extend"), &limits).status, 202);
    let more = server.wait(&cancelled);
    assert_eq!(
        (&more["state"], &more["stats"]["iterations"]),
        (&json!("succeeded"), &json!(done + 10))
    );
}

/// A server with failpoints that a file holds, so that they can change while it runs.
fn with_failpoints(folder: &Path, arguments: &[&str]) -> (Server, PathBuf) {
    let rules = folder.join("failpoints");
    if !rules.exists() {
        std::fs::write(&rules, "").expect("rules");
    }
    let from_file = format!("@{}", rules.display());
    let environment = [("HEMILUX_FAILPOINTS", from_file.as_str())];
    let data = folder.join("data");
    (Server::start_with_environment(&data, arguments, &environment), rules)
}

/// A checkpoint that cannot be read for now is waited for: the job does not begin afresh, and what
/// is kept is not overwritten.
#[test]
fn a_checkpoint_that_does_not_answer_is_waited_for() {
    let folder = TempDir::new().expect("a folder");
    let arguments = ["--checkpoint-every-s", "0.2"];
    let (server, rules) = with_failpoints(folder.path(), &arguments);
    let data = folder.path().join("data");
    let id = server.submit(&job(6000));
    wait_for_two_checkpoints(&data, &id);
    server.kill();
    std::fs::write(&rules, "kept-read=error;retry-pause=last:20").expect("rules");
    let (server, _) = with_failpoints(folder.path(), &arguments);
    let kept = checkpoints(&data, &id);
    let put_back = server.events(&format!("/v1/jobs/{id}/events"), &[]).filter(|event| {
        event.data["reason"].as_str().is_some_and(|reason| reason.contains("kept-read"))
    });
    assert_eq!(put_back.take(2).count(), 2);
    let now = checkpoints(&data, &id);
    assert!(!now.is_empty() && now.iter().all(|file| kept.contains(file)), "{kept:?}, {now:?}");
    std::fs::write(&rules, "").expect("rules");
    let after = server.wait(&id);
    assert_eq!((&after["state"], &after["attempts"]), (&json!("succeeded"), &json!(1)), "{after}");
    assert!(reasons(&after).contains("goes on after"), "{}", reasons(&after));
    assert_eq!(after["warnings"], json!([]), "{after}");
}

#[test]
fn an_extension_that_fails_keeps_the_result_and_can_be_tried_again() {
    let folder = TempDir::new().expect("a folder");
    let (server, rules) = with_failpoints(folder.path(), &[]);
    let id = server.submit(&job(40));
    let ended = server.wait(&id);
    let picture = exr(&server, &id);
    let extend =
        || server.post(&format!("/v1/jobs/{id}/extend"), &json!({ "max_iterations": 100 }));
    std::fs::write(&rules, "render=panic").expect("rules");
    let queued = extend();
    assert_eq!(queued.status, 202, "{}", queued.text());
    assert_eq!(queued.json()["result"], ended["result"], "it stays while the job waits");
    let failed = server.wait(&id);
    assert_eq!((&failed["state"], &failed["error"]["code"]), (&json!("failed"), &json!("panic")));
    assert_eq!((&failed["result"], &failed["stats"]), (&ended["result"], &ended["stats"]));
    assert!(exr(&server, &id) == picture, "the last good picture");
    std::fs::write(&rules, "").expect("rules");
    assert_eq!(extend().status, 202);
    let extended = server.wait(&id);
    assert_eq!(extended["stats"]["iterations"], 100, "{extended}");
    assert!(reasons(&extended).contains("goes on after 40"), "{}", reasons(&extended));
    assert_ne!(extended["result"], ended["result"]);
}

#[test]
fn other_views_begin_with_a_solution_and_outlive_it() {
    let folder = TempDir::new().expect("a folder");
    let server = Server::start_in(folder.path(), &[]);
    let id = server.submit(&job(400));
    server.wait(&id);
    let views = format!("/v1/jobs/{id}/views");
    let camera =
        json!({ "eye": [0.2, 0.3, 0.7], "target": [0.3, 0.25, -0.5], "yfov_degrees": 50.0 });
    server.post(&views, &json!({ "camera": "nobody" })).problem(422);
    // Views are checked as other jobs are.
    for (change, field) in [
        (json!({ "up": [0.1, -0.05, -1.2] }), "camera.up"),
        (json!({ "yfov_degrees": 0.0001 }), "camera.yfov_degrees"),
        (json!({ "target": [0.2, 0.3, 0.7] }), "camera.target"),
        (json!({ "fov": 50 }), "camera.fov"),
    ] {
        let mut wrong = camera.clone();
        wrong.as_object_mut().expect("an object").extend(change.as_object().unwrap().clone());
        let problem = server.post(&views, &json!({ "camera": wrong })).problem(422);
        assert_eq!(problem["errors"][0]["field"], field, "{problem}");
    }
    server.post(&views, &json!({ "seed": 1 })).problem(422);
    server.post("/v1/jobs", &json!({ "scene": "cornell", "view_of": id })).problem(422);
    let view = json!({ "camera": camera, "width": 40, "height": 30, "max_iterations": 1 });
    let answer = server.post(&views, &view);
    assert_eq!(answer.status, 202, "{}", answer.text());
    let accepted = answer.json();
    let other = accepted["id"].as_str().expect("an id").to_owned();
    assert_ne!(other, id);
    assert_eq!(accepted["request"]["view_of"], json!(id));
    assert_eq!(
        (&accepted["request"]["width"], &accepted["request"]["seed"]),
        (&json!(40), &json!(7))
    );
    assert_eq!(server.send("DELETE", &format!("/v1/jobs/{id}"), &[], b"").status, 204);
    let done = server.wait(&other);
    assert_eq!(done["state"], "succeeded", "{done}");
    assert!(reasons(&done).contains("another picture of the scene"), "{}", reasons(&done));
    assert_eq!(done["stats"]["iterations"], 1);
    // Of that one there can be views and more, although what it began with is gone.
    let second = server.post(&format!("/v1/jobs/{other}/views"), &json!({ "max_iterations": 1 }));
    assert_eq!(second.status, 202, "{}", second.text());
    let second = server.wait(second.json()["id"].as_str().expect("an id"));
    assert_eq!(second["state"], "succeeded");
    let more = server.post(&format!("/v1/jobs/{other}/extend"), &json!({ "max_iterations": 3 }));
    assert_eq!(more.status, 202, "{}", more.text());
    assert_eq!(server.wait(&other)["stats"]["iterations"], 3);
    server.post(&views, &view).problem(404);
}

#[test]
fn results_have_manifests_and_baked_light() {
    let server = Server::start();
    let id = server.submit(&job(30));
    let ended = server.wait(&id);
    let manifest = server.get(&format!("/v1/jobs/{id}/manifest")).json();
    assert_eq!(manifest["scene"]["sha256"], ended["scene"]);
    assert_eq!(manifest["request"], ended["request"]);
    assert_eq!((&manifest["request"]["seed"], &manifest["device"]), (&json!(7), &json!("cpu")));
    assert_eq!(manifest["version"], env!("CARGO_PKG_VERSION"));
    assert_eq!(manifest["solution"]["iterations"], 30);
    let pictures = manifest["pictures"].as_array().expect("pictures");
    assert_eq!(pictures.len(), 2);
    for picture in pictures {
        let bytes = server.get(picture["url"].as_str().expect("a path")).body;
        assert_eq!(picture["sha256"], sha256_hex(&bytes));
    }
    let path = format!("/v1/jobs/{id}/solution.glb");
    let baked = server.get(&path);
    assert_eq!((baked.status, baked.header("content-type")), (200, "model/gltf-binary"));
    assert_eq!(manifest["solution"]["baked"]["sha256"], sha256_hex(&baked.body));
    let scene = import(&baked.body, &Resources::new(), &ImportLimits::default()).expect("valid");
    assert_eq!(scene.triangles.len() as u64, ended["stats"]["patches"].as_u64().expect("patches"));
    let lit = scene.vertices.iter().filter(|vertex| vertex.color.max_element() > 0.01).count();
    assert!(2 * lit > scene.vertices.len(), "{lit} of {} are lit", scene.vertices.len());
    let etag = baked.header("etag").to_owned();
    assert_eq!(server.send("GET", &path, &[("if-none-match", &etag)], b"").status, 304);

    // Rays leave no light on patches; and a server may keep nothing.
    let rays = server.submit(&json!({
        "scene": "cornell", "method": "ray-traced", "width": 16, "height": 16, "max_iterations": 1,
    }));
    assert_eq!(server.wait(&rays)["state"], "succeeded");
    server.get(&format!("/v1/jobs/{rays}/solution.glb")).problem(404);
    let frugal = Server::start_with(&["--keep-solutions-mb", "0", "--checkpoint-every-s", "0.05"]);
    let id = frugal.submit(&job(1500));
    frugal.wait(&id);
    let more = frugal.post(&format!("/v1/jobs/{id}/extend"), &json!({ "max_iterations": 2000 }));
    assert!(more.problem(409)["detail"].to_string().contains("keep-solutions-mb"));
    frugal.post(&format!("/v1/jobs/{id}/views"), &json!({})).problem(409);
    frugal.get(&format!("/v1/jobs/{id}/solution.glb")).problem(404);
    assert_eq!(frugal.get(&format!("/v1/jobs/{id}/manifest")).json()["solution"], Value::Null);
}
