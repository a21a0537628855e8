//! Identical jobs share one result and stay jobs of their own; callers who sent the same scene share
//! its file and learn nothing of each other.

use hemilux_tests::keys::{With, keys};
use hemilux_tests::server::{Server, scene};
use serde_json::{Value, json};
use tempfile::TempDir;

fn job(iterations: u64) -> Value {
    json!({
        "scene": "cornell", "method": "stochastic", "width": 16, "height": 16,
        "max_iterations": iterations, "seed": 3,
        "options": {"patches": 300, "hemicube_resolution": 32}
    })
}

fn with(mut job: Value, field: &str, value: Value) -> Value {
    job[field] = value;
    job
}

fn picture(server: &Server, job: &Value) -> Vec<u8> {
    let answer = server.get(job["result"][1]["url"].as_str().unwrap());
    assert_eq!(answer.status, 200, "{}", answer.text());
    answer.body
}

#[test]
fn a_result_is_shared_where_it_is_determined() {
    let server = Server::start();
    let first = server.wait(&server.submit(&job(20)));
    assert_eq!(first["result_of"], Value::Null);
    let labelled = with(with(job(20), "labels", json!({"again": "yes"})), "priority", json!(5));
    let second = server.wait(&server.submit(&labelled));
    assert_eq!(second["result_of"], first["id"], "{second}");
    assert_eq!(second["state"], "succeeded");
    assert_eq!(second["stats"]["iterations"], 20);
    assert_eq!(second["plan"], first["plan"]);
    assert_eq!(second["result"][1]["sha256"], first["result"][1]["sha256"]);
    assert_ne!(second["result"][1]["url"], first["result"][1]["url"]);
    let trace = |job: &Value| {
        let trace = server.get(&format!("/v1/jobs/{}/trace", job["id"].as_str().unwrap()));
        trace.json()["points"].clone()
    };
    assert_eq!(trace(&second), trace(&first));
    let path = format!("/v1/jobs/{}/events", second["id"].as_str().unwrap());
    let events: Vec<_> = server.events(&path, &[]).collect();
    let last = events.last().unwrap();
    assert_eq!((last.name.as_str(), &last.data["pictures"]), ("succeeded", &second["result"]));
    assert!(last.data["reason"].as_str().unwrap().contains(first["id"].as_str().unwrap()));
    let metrics = server.get("/metrics").text();
    assert!(metrics.contains("hemilux_iterations_total 20"), "the work was done once: {metrics}");

    // The files of one do not go with the other.
    let pixels = picture(&server, &first);
    server.send("DELETE", &format!("/v1/jobs/{}", first["id"].as_str().unwrap()), &[], b"");
    assert_eq!(picture(&server, &second), pixels);

    for (other, why) in [
        (with(job(20), "fresh", json!(true)), "asked to be rendered"),
        (with(job(20), "seed", json!(4)), "another seed"),
        (with(job(20), "time_budget_s", json!(60)), "depends on the clock"),
        (with(job(20), "snapshots", json!({"every_s": 1})), "wants to see it happen"),
    ] {
        let other = server.wait(&server.submit(&other));
        assert_eq!(
            (&other["state"], &other["result_of"]),
            (&json!("succeeded"), &json!(null)),
            "{why}"
        );
    }
}

/// What is shared goes by what determines the picture, not by how it was written.
#[test]
fn a_job_in_other_words_shares_and_another_limit_does_not() {
    let server = Server::start();
    server.wait(&server.submit(&job(20)));
    let shares = |other: Value| {
        let other = server.wait(&server.submit(&other));
        assert_eq!(other["state"], "succeeded", "{other}");
        !other["result_of"].is_null()
    };
    let mut spelled_out = job(20);
    spelled_out["options"] = json!({
        "stochastic.patches": 300, "hemicube_resolution": 32.0, "shots_per_iteration": 8, "first_shot": false
    });
    assert!(shares(spelled_out), "the same in other words");
    assert!(shares(with(job(20), "camera", json!(0))), "the first camera is the default");
    assert!(!shares(with(job(20), "target_error", json!(1e-9))), "another limit");
    let mut sampled = job(20);
    sampled["options"]["pixel_samples"] = json!(9);
    assert!(!shares(sampled), "another setting");
}

#[test]
fn followers_wait_for_the_running_one_and_go_on_without_it() {
    let server = Server::start();
    // Long enough to be caught running, on any machine.
    let [leader, cancelled, follower] = [0; 3].map(|_| server.submit(&job(1_000_000)));
    server.wait_until(&leader, |job| job["iterations"].as_u64() > Some(0));
    assert_eq!(server.get(&format!("/v1/jobs/{follower}")).json()["state"], "queued");
    // One's cancel is not the other's.
    server.send("POST", &format!("/v1/jobs/{cancelled}/cancel"), &[], b"");
    assert_eq!(server.wait(&cancelled)["state"], "cancelled");
    assert_eq!(server.get(&format!("/v1/jobs/{leader}")).json()["state"], "running");
    server.send("POST", &format!("/v1/jobs/{leader}/cancel"), &[], b"");
    assert_eq!(server.wait(&leader)["state"], "cancelled");
    // What was cancelled is no result to share: the follower runs for itself.
    let running = server.wait_until(&follower, |job| job["iterations"].as_u64() > Some(0));
    assert_eq!(running["state"], "running");
    server.send("POST", &format!("/v1/jobs/{follower}/cancel"), &[], b"");
    assert_eq!(server.wait(&follower)["state"], "cancelled");
}

#[test]
fn a_result_that_is_damaged_is_rendered_again() {
    let folder = TempDir::new().unwrap();
    let server = Server::start_in(folder.path(), &[]);
    let first = server.wait(&server.submit(&job(20)));
    let (id, hash) = (&first["id"], &first["result"][1]["sha256"]);
    let file = format!("artifacts/jobs/{}/{}.exr", id.as_str().unwrap(), hash.as_str().unwrap());
    std::fs::write(folder.path().join(file), b"damaged").unwrap();
    let second = server.wait(&server.submit(&job(20)));
    assert_eq!((&second["state"], &second["result_of"]), (&json!("succeeded"), &json!(null)));
    assert_eq!(&second["result"][1]["sha256"], hash);
    assert!(picture(&server, &second).len() > 100);
}

#[test]
fn scenes_that_others_sent_too_are_each_ones_own() {
    let folder = TempDir::new().unwrap();
    let (ann, bob, admin) = (
        keys(folder.path(), &["add", "ann"]),
        keys(folder.path(), &["add", "bob", "--max-scenes-mb", "1"]),
        keys(folder.path(), &["add", "boss", "--scope", "admin"]),
    );
    let server = Server::start_in(folder.path(), &[]);
    let [ann, bob, admin] = [&ann, &bob, &admin].map(|key| With(&server, key));
    let upload = |who: &With<'_>, file: &str, name: &str| {
        let path = format!("/v1/scenes?name={name}");
        who.send("POST", &path, &[("content-type", "model/gltf-binary")], &scene(file))
    };
    let first = upload(&ann, "cornell_phong.glb", "Secret%20Villa%1b.glb");
    assert_eq!(first.status, 201, "{}", first.text());
    assert_eq!(first.json()["name"], "Secret Villa.glb");
    let id = first.json()["id"].as_str().unwrap().to_owned();
    let path = format!("/v1/scenes/{id}");
    let before = ann.get(&path).json()["created_at"].as_str().unwrap().to_owned();
    std::thread::sleep(std::time::Duration::from_millis(20));

    // The same bytes from another: a first upload, under their own time and name.
    let second = upload(&bob, "cornell_phong.glb", "");
    assert_eq!(second.status, 201, "{}", second.text());
    assert!(second.json()["created_at"].as_str().unwrap() > before.as_str(), "{}", second.text());
    let name = second.json()["name"].clone();
    assert_ne!(name, "Secret Villa.glb");
    assert_eq!(bob.get(&path).json()["name"], name);
    assert_eq!(ann.get(&path).json()["created_at"], before.as_str());
    assert_eq!(ann.get(&path).json()["name"], "Secret Villa.glb");

    // A place in one's own list; the place of a scene that is another's, or nobody's, is a place
    // like any other, and what is none is an error and not an end.
    upload(&ann, "corridor.glb", "hall.glb");
    let page = ann.get("/v1/scenes?limit=1").json();
    assert_eq!(page["scenes"][0]["name"], "hall.glb", "{page}");
    let cursor = page["next_cursor"].as_str().unwrap().to_owned();
    let newest = page["scenes"][0]["id"].as_str().unwrap().to_owned();
    let next = |who: &With<'_>, cursor: &str| {
        let list = who.get(&format!("/v1/scenes?cursor={cursor}")).json()["scenes"].clone();
        list.as_array().unwrap().iter().map(|one| one["id"].clone()).collect::<Vec<_>>()
    };
    assert_eq!(next(&ann, &cursor), [json!(id)]);
    let made_up = cursor.replace(&newest, &"0".repeat(64));
    assert_eq!(next(&bob, &cursor), next(&bob, &made_up));
    assert_eq!(ann.send("DELETE", &format!("/v1/scenes/{newest}"), &[], b"").status, 204);
    assert_eq!(next(&ann, &cursor), [json!(id)], "its scene is gone, the place is not");
    for wrong in [id.as_str(), "", ".", "1.2", "x"] {
        let problem = ann.get(&format!("/v1/scenes?cursor={wrong}")).problem(400);
        assert!(problem["detail"].as_str().unwrap().contains("start again"), "{problem}");
    }

    // Who lets go of a scene leaves it to the others and to the jobs that name it.
    let mut wish = job(2);
    wish["scene"] = json!(id);
    let accepted = ann.post("/v1/jobs", &wish).json();
    assert_eq!(accepted["scene_name"], "Secret Villa.glb", "{accepted}");
    let job = accepted["id"].as_str().unwrap().to_owned();
    let end = |who: &With<'_>| who.send("DELETE", &path, &[], b"").status;
    assert_eq!([end(&ann), end(&ann)], [204, 204]);
    ann.get(&path).problem(404);
    ann.post("/v1/jobs", &wish).problem(404);
    assert_eq!(bob.get(&path).status, 200);
    assert_eq!(ann.get(&format!("/v1/jobs/{job}?wait=60")).json()["state"], "succeeded");
    assert_eq!(end(&bob), 204);
    admin.get(&path).problem(404);
    let file = folder.path().join(format!("artifacts/scenes/{id}"));
    let is_kept = || {
        std::fs::read_dir(file.parent().unwrap())
            .unwrap()
            .any(|entry| entry.unwrap().file_name().to_string_lossy().starts_with(&id))
    };
    assert!(is_kept(), "the job names it");
    // One that no job names goes at once, with what it counted.
    let third = upload(&bob, "ring.glb", "ring.glb").json();
    let ring = third["id"].as_str().unwrap();
    assert_eq!(bob.send("DELETE", &format!("/v1/scenes/{ring}"), &[], b"").status, 204);
    let files = std::fs::read_dir(file.parent().unwrap()).unwrap();
    let names: Vec<_> = files.map(|f| f.unwrap().file_name().into_string().unwrap()).collect();
    assert!(!names.iter().any(|name| name.starts_with(ring)), "{names:?}");
    assert_eq!(bob.count("/v1/scenes", "scenes"), 0);
}
