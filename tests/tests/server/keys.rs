//! API keys: who gets in, who sees what, and what the limits of a caller do.

use hemilux_tests::keys::{With, keys};
use hemilux_tests::server::{Answer, Server, scene, serve_and_fail, serve_command};
use serde_json::{Value, json};
use std::io::{BufRead, BufReader};
use std::path::Path;
use std::process::Stdio;
use tempfile::TempDir;

fn quick() -> Value {
    json!({"scene": "cornell", "width": 16, "height": 16, "max_iterations": 2,
           "options": {"patches": 200}, "method": "stochastic"})
}

fn endless() -> Value {
    json!({"scene": "cornell", "width": 16, "height": 16, "time_budget_s": 600})
}

#[test]
fn with_the_first_key_the_api_is_closed_and_revoking_closes_it_to_the_key() {
    let folder = TempDir::new().unwrap();
    let server = Server::start_in(folder.path(), &[]);
    assert_eq!(server.get("/v1/jobs").status, 200, "no key, nothing asked for");

    // While the server runs.
    let key = keys(folder.path(), &["add", "first"]);
    assert!(key.starts_with("hmx_"), "{key}");
    let refused = server.get("/v1/jobs");
    refused.problem(401);
    assert!(refused.header("www-authenticate").starts_with("Bearer"), "{refused:?}");
    for open in ["/livez", "/readyz", "/openapi.yaml", "/metrics", "/", "/assets/app.js"] {
        assert_eq!(server.get(open).status, 200, "{open}");
    }
    for wrong in ["hmx_wrong", "", &key[..key.len() - 1], &key.to_uppercase()] {
        With(&server, wrong).get("/v1/jobs").problem(401);
    }
    server.send("GET", "/v1/jobs", &[("authorization", "Basic Og==")], b"").problem(401);
    let mine = With(&server, &key);
    assert_eq!(mine.get("/v1/jobs").status, 200);
    assert_eq!(mine.get("/v1/devices").status, 200);

    // Rotation: the new one works before the old one ends, and no restart is needed.
    let next = keys(folder.path(), &["add", "second", "--expires-days", "30"]);
    assert_eq!(With(&server, &next).get("/v1/jobs").status, 200);
    keys(folder.path(), &["revoke", "first"]);
    mine.get("/v1/jobs").problem(401);
    assert_eq!(With(&server, &next).get("/v1/jobs").status, 200);
    // Ending the last one does not open the door again.
    keys(folder.path(), &["revoke", "second"]);
    server.get("/v1/jobs").problem(401);

    let listed = keys(folder.path(), &["list"]);
    assert!(listed.contains("first") && listed.contains("revoked"), "{listed}");
    assert!(listed.contains("used 2"), "{listed}");
    // The key is nowhere in the data folder.
    drop(server);
    for entry in std::fs::read_dir(folder.path()).unwrap() {
        let path = entry.unwrap().path();
        if path.is_file() {
            let bytes = std::fs::read(&path).unwrap();
            let secret = key.trim_start_matches("hmx_").as_bytes();
            let found = bytes.windows(secret.len()).any(|window| window == secret);
            assert!(!found, "{}", path.display());
        }
    }
}

#[test]
fn everyone_sees_only_their_own() {
    let folder = TempDir::new().unwrap();
    let (ann, bob, admin, reader) = (
        keys(folder.path(), &["add", "ann"]),
        keys(folder.path(), &["add", "bob"]),
        keys(folder.path(), &["add", "boss", "--scope", "admin"]),
        keys(folder.path(), &["add", "reader", "--scope", "read"]),
    );
    let server = Server::start_in(folder.path(), &[]);
    let (ann, bob) = (With(&server, &ann), With(&server, &bob));
    let (admin, reader) = (With(&server, &admin), With(&server, &reader));

    // A scene belongs to whoever sent it; the same bytes may belong to several.
    let glb = scene("cornell_phong.glb");
    let upload = |who: &With<'_>| {
        who.send("POST", "/v1/scenes", &[("content-type", "model/gltf-binary")], &glb)
    };
    let id = upload(&ann).json()["id"].as_str().unwrap().to_owned();
    let path = format!("/v1/scenes/{id}");
    assert_eq!((ann.get(&path).status, bob.count("/v1/scenes", "scenes")), (200, 0));
    bob.get(&path).problem(404);
    let mut wish = quick();
    wish["scene"] = json!(id);
    bob.post("/v1/jobs", &wish).problem(404);
    assert_eq!(upload(&bob).status, 201, "it tells nothing of who else sent the bytes");
    assert_eq!(upload(&bob).status, 200);
    assert_eq!((bob.get(&path).status, bob.count("/v1/scenes", "scenes")), (200, 1));

    let job = ann.submit(&wish);
    let done = ann.get(&format!("/v1/jobs/{job}?wait=60")).json();
    assert_eq!(done["state"], "succeeded", "{done}");
    let picture = done["result"][0]["url"].as_str().unwrap();
    let unknown = format!("/v1/jobs/{}", uuid_like(&job));
    for tail in
        ["", "/events", "/image", "/image.png", "/image.exr", "/chart.svg", "/trace", "/webhooks"]
    {
        assert_eq!(ann.get(&format!("/v1/jobs/{job}{tail}")).status, 200, "{tail}");
        assert_eq!(admin.get(&format!("/v1/jobs/{job}{tail}")).status, 200, "{tail}");
        // To the letter what a job that is not there answers.
        let foreign = bob.get(&format!("/v1/jobs/{job}{tail}")).problem(404);
        let nothing = bob.get(&format!("{unknown}{tail}")).problem(404);
        for member in ["type", "title", "detail", "status"] {
            assert_eq!(foreign[member], nothing[member], "{tail}");
        }
    }
    bob.get(picture).problem(404);
    let cached = ann.get(picture);
    assert!(cached.header("cache-control").starts_with("private"), "{cached:?}");
    for (method, tail, status) in [("POST", "/cancel", 404), ("POST", "/pin", 404)] {
        bob.send(method, &format!("/v1/jobs/{job}{tail}"), &[], b"").problem(status);
    }
    // Deleting answers alike whether there is something or not, and leaves others' jobs alone.
    assert_eq!(bob.send("DELETE", &format!("/v1/jobs/{job}"), &[], b"").status, 204);
    assert_eq!(ann.get(&format!("/v1/jobs/{job}")).status, 200);
    assert_eq!((ann.count("/v1/jobs", "jobs"), bob.count("/v1/jobs", "jobs")), (1, 0));
    assert_eq!(admin.count("/v1/jobs", "jobs"), 1);
    assert_eq!(admin.count("/v1/scenes", "scenes"), 1);

    // Scopes.
    assert_eq!(reader.get("/v1/jobs").status, 200);
    let refused = reader.post("/v1/jobs", &quick()).problem(403);
    assert!(refused["type"].as_str().unwrap().ends_with("insufficient-scope"), "{refused}");
    reader.send("DELETE", &format!("/v1/jobs/{job}"), &[], b"").problem(403);

    // Idempotency keys are each one's own.
    let keyed = |who: &With<'_>| {
        let headers = [("content-type", "application/json"), ("idempotency-key", "same")];
        let answer = who.send("POST", "/v1/jobs", &headers, quick().to_string().as_bytes());
        assert_eq!(answer.status, 202, "{}", answer.text());
        answer.json()["id"].clone()
    };
    let (first, again, other) = (keyed(&ann), keyed(&ann), keyed(&bob));
    assert_eq!(first, again);
    assert_ne!(first, other);

    assert_eq!(admin.send("DELETE", &format!("/v1/jobs/{job}"), &[], b"").status, 204);
    ann.get(&format!("/v1/jobs/{job}")).problem(404);
}

/// Another id of the same shape.
fn uuid_like(id: &str) -> String {
    let last = if id.ends_with('0') { "1" } else { "0" };
    format!("{}{last}", &id[..id.len() - 1])
}

#[test]
fn limits_are_each_ones_own_and_ends_are_always_let_through() {
    let folder = TempDir::new().unwrap();
    let (small, other) = (
        keys(
            folder.path(),
            &["add", "small", "--max-queued", "1", "--max-running", "1", "--max-scenes-mb", "0"],
        ),
        keys(folder.path(), &["add", "other"]),
    );
    let slow = keys(folder.path(), &["add", "slow", "--rate-limit", "0.5"]);
    let server = Server::start_in(folder.path(), &[]);
    let (small, other) = (With(&server, &small), With(&server, &other));

    let refused = small.post("/v1/jobs", &quick());
    assert_eq!(refused.problem(429)["limit"], "scene_bytes");
    // The other one has room, and its scene is not the small one's.
    let running = other.submit(&endless());
    server_wait(&other, &running, "running");
    // Who sees that a device is busy does not learn with what.
    let on_device = |who: &With<'_>| {
        let devices = who.get("/v1/devices").json()["devices"].clone();
        devices.as_array().unwrap().iter().any(|device| device["job"] == running.as_str())
    };
    assert_eq!((on_device(&other), on_device(&small)), (true, false));
    let waiting = other.submit(&quick());
    let waiting_too = other.submit(&quick());
    assert_ne!(waiting, waiting_too);
    for id in [&running, &waiting, &waiting_too] {
        assert_eq!(other.send("POST", &format!("/v1/jobs/{id}/cancel"), &[], b"").status, 200);
    }

    let slow = With(&server, &slow);
    let job = slow.submit(&endless());
    let answers: Vec<Answer> = (0..8).map(|_| slow.get("/v1/jobs")).collect();
    let refused = answers.iter().find(|answer| answer.status == 429).expect("the rate is limited");
    assert_eq!(refused.problem(429)["limit"], "requests_per_second");
    let wait: u32 = refused.header("retry-after").parse().unwrap();
    assert!((1..=2).contains(&wait), "{wait}");
    slow.get("/v1/jobs").problem(429);
    // Over every limit, ending is let through.
    assert_eq!(slow.send("POST", &format!("/v1/jobs/{job}/cancel"), &[], b"").status, 200);
    assert_eq!(slow.send("DELETE", &format!("/v1/jobs/{job}"), &[], b"").status, 204);
    // Others are not concerned.
    assert_eq!(other.get("/v1/jobs").status, 200);
    let text = server.get("/metrics").text();
    for limit in ["requests_per_second", "scene_bytes"] {
        assert!(text.contains(&format!("hemilux_refusals_total{{limit=\"{limit}\"}}")), "{text}");
    }
}

fn server_wait(who: &With<'_>, job: &str, state: &str) {
    for _ in 0..600 {
        if who.get(&format!("/v1/jobs/{job}")).json()["state"] == state {
            return;
        }
        std::thread::sleep(std::time::Duration::from_millis(50));
    }
    panic!("{job} never was {state}");
}

#[test]
fn many_jobs_of_one_key_do_not_keep_another_waiting() {
    let folder = TempDir::new().unwrap();
    let (many, few) = (keys(folder.path(), &["add", "many"]), keys(folder.path(), &["add", "few"]));
    let server = Server::start_in(folder.path(), &["--max-queued", "2000"]);
    let (many, few) = (With(&server, &many), With(&server, &few));
    let first = many.submit(&endless());
    server_wait(&many, &first, "running");
    let queued: Vec<_> = (0..100).map(|_| many.submit(&quick())).collect();
    let other = few.submit(&quick());
    assert_eq!(many.post(&format!("/v1/jobs/{first}/cancel"), &json!({})).status, 200);
    server_wait(&few, &other, "succeeded");
    let started = |who: &With<'_>, id: &str| {
        let job = who.get(&format!("/v1/jobs/{id}")).json();
        job["started_at"].as_str().map(str::to_owned)
    };
    let other_started = started(&few, &other).unwrap();
    for id in queued.iter().filter_map(|id| started(&many, id)) {
        assert!(other_started <= id, "the other key's job starts next: {other_started}, {id}");
    }
}

#[test]
fn queued_and_running_jobs_are_counted_by_caller() {
    let folder = TempDir::new().unwrap();
    let (busy, other) = (keys(folder.path(), &["add", "busy"]), keys(folder.path(), &["add", "b"]));
    let arguments = ["--max-queued-each", "2", "--max-running-each", "1", "--rate-limit", "0"];
    let server = Server::start_in(folder.path(), &arguments);
    let (busy, other) = (With(&server, &busy), With(&server, &other));
    let first = busy.submit(&endless());
    server_wait(&busy, &first, "running");
    busy.submit(&quick());
    busy.submit(&quick());
    let refused = busy.post("/v1/jobs", &quick());
    assert_eq!(refused.problem(429)["limit"], "jobs_queued");
    assert!(!refused.header("retry-after").is_empty());
    // A full queue of one is not another's.
    other.submit(&quick());
    assert_eq!(busy.send("POST", &format!("/v1/jobs/{first}/cancel"), &[], b"").status, 200);
}

#[test]
fn a_priority_above_0_needs_its_scope() {
    let folder = TempDir::new().unwrap();
    let (plain, vip, admin) = (
        keys(folder.path(), &["add", "plain"]),
        keys(folder.path(), &["add", "vip", "--scope", "read,submit,priority"]),
        keys(folder.path(), &["add", "boss", "--scope", "admin"]),
    );
    let server = Server::start_in(folder.path(), &[]);
    let [plain, vip, admin] = [&plain, &vip, &admin].map(|key| With(&server, key));
    let with_priority = |priority: i32| {
        let mut job = quick();
        job["priority"] = json!(priority);
        job
    };
    let refused = plain.post("/v1/jobs", &with_priority(1)).problem(403);
    assert!(refused["detail"].as_str().unwrap().contains("\"priority\""), "{refused}");
    for (who, priority) in [(&plain, 0), (&plain, -5), (&vip, 1), (&admin, 100)] {
        who.submit(&with_priority(priority));
    }
    // Nor by way of a view.
    let job = plain.submit(&quick());
    let done = plain.get(&format!("/v1/jobs/{job}?wait=60")).json();
    assert_eq!(done["state"], "succeeded", "{done}");
    let view = json!({"max_iterations": 1, "priority": 3});
    plain.post(&format!("/v1/jobs/{job}/views"), &view).problem(403);
    assert!(keys(folder.path(), &["list"]).contains("read,submit,priority"));
}

#[test]
fn an_extension_counts_as_a_job_that_waits() {
    let folder = TempDir::new().unwrap();
    let (busy, other) = (
        keys(folder.path(), &["add", "busy", "--max-queued", "1"]),
        keys(folder.path(), &["add", "other"]),
    );
    let server = Server::start_in(folder.path(), &[]);
    let (busy, other) = (With(&server, &busy), With(&server, &other));
    let job = busy.submit(&quick());
    let done = busy.get(&format!("/v1/jobs/{job}?wait=60")).json();
    assert_eq!(done["state"], "succeeded", "{done}");
    let running = other.submit(&endless());
    server_wait(&other, &running, "running");
    let waiting = busy.submit(&quick());
    let extend = || busy.post(&format!("/v1/jobs/{job}/extend"), &json!({"max_iterations": 9}));
    assert_eq!(extend().problem(429)["limit"], "jobs_queued");
    assert_eq!(busy.get(&format!("/v1/jobs/{job}")).json()["state"], "succeeded");
    assert_eq!(busy.send("DELETE", &format!("/v1/jobs/{waiting}"), &[], b"").status, 204);
    let extended = extend();
    assert_eq!(extended.status, 202, "{}", extended.text());
}

#[test]
fn what_goes_on_under_a_key_ends_with_it() {
    let folder = TempDir::new().unwrap();
    let (ended, kept) =
        (keys(folder.path(), &["add", "ended"]), keys(folder.path(), &["add", "kept"]));
    let server = Server::start_in(folder.path(), &[]);
    let bearer = format!("Bearer {ended}");
    let (ended, kept) = (With(&server, &ended), With(&server, &kept));
    let (job, other) = (ended.submit(&endless()), kept.submit(&endless()));
    server_wait(&ended, &job, "running");
    let begun = std::time::Instant::now();
    std::thread::scope(|scope| {
        let path = format!("/v1/jobs/{job}/events");
        let stream = server.events(&path, &[("authorization", &bearer)]);
        let followed = scope.spawn(|| stream.last().unwrap());
        let waited = scope.spawn(|| ended.get(&format!("/v1/jobs/{job}?wait=60")));
        let waited_on = scope.spawn(|| kept.get(&format!("/v1/jobs/{other}?wait=8")));
        // Both are open, and the key is good until another process ends it.
        std::thread::sleep(std::time::Duration::from_millis(1500));
        assert!(!followed.is_finished() && !waited.is_finished());
        keys(folder.path(), &["revoke", "ended"]);
        let last = followed.join().unwrap();
        assert!(!["succeeded", "failed", "cancelled"].contains(&last.name.as_str()), "{last:?}");
        waited.join().unwrap().problem(401);
        assert!(begun.elapsed() < std::time::Duration::from_secs(40), "{:?}", begun.elapsed());
        assert_eq!(waited_on.join().unwrap().status, 200, "another key is not concerned");
    });
}

#[test]
fn beyond_loopback_there_must_be_keys_or_the_will_to_do_without() {
    let folder = TempDir::new().unwrap();
    let refused = serve_and_fail(folder.path(), &["--listen", "0.0.0.0:0"]);
    assert_eq!(refused.status.code(), Some(2));
    let said = String::from_utf8_lossy(&refused.stderr).into_owned();
    assert!(said.contains("hemilux keys add") && said.contains("--allow-remote"), "{said}");
    for arguments in [["--require-keys"], ["--allow-remote"]] {
        let all = ["--listen", "0.0.0.0:0", arguments[0]];
        let server = Server::start_in(folder.path(), &all);
        let port = server.address.rsplit(':').next().unwrap().to_owned();
        let open = arguments[0] == "--allow-remote";
        let host = format!("localhost:{port}");
        let answer = server.send("GET", "/v1/jobs", &[("host", &host)], b"");
        assert_eq!(answer.status, if open { 200 } else { 401 });
        server.terminate();
    }
    let key = keys(folder.path(), &["add", "k"]);
    let server = Server::start_in(folder.path(), &["--listen", "0.0.0.0:0"]);
    server.get("/v1/jobs").problem(401);
    assert_eq!(With(&server, &key).get("/v1/jobs").status, 200);
}

#[test]
fn pages_of_invited_origins_get_in_and_others_do_not() {
    let server = Server::start_with(&["--cors-origin", "https://app.example.org"]);
    let preflight = |origin: &str| {
        let headers = [
            ("origin", origin),
            ("access-control-request-method", "POST"),
            ("access-control-request-headers", "authorization,content-type"),
        ];
        server.send("OPTIONS", "/v1/jobs", &headers, b"")
    };
    let invited = preflight("https://app.example.org");
    assert_eq!(invited.status, 200, "{}", invited.text());
    assert_eq!(invited.header("access-control-allow-origin"), "https://app.example.org");
    assert!(invited.header("access-control-allow-headers").contains("authorization"));
    assert_eq!(preflight("https://evil.example.org").header("access-control-allow-origin"), "");
    let post = |origin: &str| {
        let headers = [
            ("origin", origin),
            ("sec-fetch-site", "cross-site"),
            ("content-type", "application/json"),
        ];
        server.send("POST", "/v1/jobs", &headers, quick().to_string().as_bytes())
    };
    let answer = post("https://app.example.org");
    assert_eq!(answer.status, 202, "{}", answer.text());
    assert_eq!(answer.header("access-control-allow-origin"), "https://app.example.org");
    post("https://evil.example.org").problem(403);
}

#[test]
fn metrics_can_be_closed_too() {
    let folder = TempDir::new().unwrap();
    let key = keys(folder.path(), &["add", "k", "--scope", "read"]);
    let server = Server::start_in(folder.path(), &["--metrics-need-key"]);
    server.get("/metrics").problem(401);
    assert_eq!(With(&server, &key).get("/metrics").status, 200);
}

#[test]
fn a_server_without_its_first_key_says_how_to_make_it() {
    let folder = TempDir::new().unwrap();
    let begins = |folder: &Path| {
        let log = folder.join("log");
        let errors = std::fs::File::create(&log).unwrap();
        let mut child = serve_command(folder, &["--require-keys"])
            .stdout(Stdio::piped())
            .stderr(errors)
            .spawn()
            .unwrap();
        // It listens once it says where.
        let mut line = String::new();
        BufReader::new(child.stdout.take().unwrap()).read_line(&mut line).unwrap();
        child.kill().unwrap();
        child.wait().unwrap();
        std::fs::read_to_string(&log).unwrap()
    };
    let told = format!("hemilux keys --data-dir {} add NAME", folder.path().display());
    let log = begins(folder.path());
    assert_eq!(log.lines().filter(|line| line.contains(&told)).count(), 1, "{log}");
    keys(folder.path(), &["add", "k"]);
    let log = begins(folder.path());
    assert!(!log.contains(&told), "{log}");
}
