//! What the server says to requests that it cannot meet.

use hemilux_tests::server::{Server, scene};
use serde_json::{Value, json};
use std::io::Write;
use std::process::{Command, Stdio};
use tempfile::TempDir;

#[test]
fn every_error_is_a_problem_document() {
    let server = Server::start_with(&["--max-upload-mb", "1"]);
    let nobody = "01936f3e-8a51-7c3e-b1a4-6f2d7a7b6c01";
    for (method, path, status) in [
        ("GET", "/nowhere", 404),
        ("GET", "/v1/jobs/not-an-id", 404),
        ("GET", &format!("/v1/jobs/{nobody}"), 404),
        ("GET", &format!("/v1/jobs/{nobody}/events"), 404),
        ("GET", &format!("/v1/jobs/{nobody}/image"), 404),
        ("GET", &format!("/v1/jobs/{nobody}/trace.csv"), 404),
        ("GET", &format!("/v1/jobs/{nobody}/snapshots/..%2f..%2flock"), 404),
        ("POST", &format!("/v1/jobs/{nobody}/cancel"), 404),
        ("GET", "/v1/scenes/nothing", 404),
        ("PUT", "/v1/jobs", 405),
        ("POST", "/v1/jobs", 415),
        ("POST", "/v1/scenes", 415),
        ("GET", "/v1/jobs?limit=0", 400),
        ("GET", "/v1/jobs?limit=many", 400),
        ("GET", "/v1/jobs?state=asleep", 400),
        ("GET", "/v1/jobs?cursor=x", 400),
        ("GET", "/v1/jobs?label=x", 400),
    ] {
        let problem = server.send(method, path, &[], b"").problem(status);
        assert_eq!(problem["instance"], path.split('?').next().unwrap(), "{method} {path}");
    }
    assert_ne!(server.send("PUT", "/v1/jobs", &[], b"").header("allow"), "");
    let too_much = vec![0; (1 << 20) + 1];
    server.post_scene(&too_much).problem(413);
    server.post_scene(b"").problem(422);
    server.post_scene(b"this is no scene").problem(422);
    let empty = server.get("/v1/scenes").json();
    assert_eq!(empty["scenes"], json!([]), "refused uploads are not kept");
    let form = [("content-type", "multipart/form-data; boundary=x")];
    server.send("POST", "/v1/scenes", &form, b"--x\r\nbroken").problem(400);
    server.send("POST", "/v1/scenes", &form, b"--x--\r\n").problem(422);
    let json_type = [("content-type", "application/json")];
    server.send("POST", "/v1/jobs", &json_type, b"{").problem(400);
    server.send("POST", "/v1/jobs", &json_type, &vec![b' '; 300 << 10]).problem(413);
    let key = [("content-type", "application/json"), ("idempotency-key", "")];
    server.send("POST", "/v1/jobs", &key, b"{}").problem(400);
}

#[test]
fn forms_may_have_many_parts_and_large_ones() {
    let server = Server::start_with(&["--max-upload-mb", "64"]);
    let form = [("content-type", "multipart/form-data; boundary=x")];
    let head = |name: &str| format!("--x\r\ncontent-disposition: form-data; name=\"{name}\"\r\n");
    let mut many = String::new();
    for part in 0..129 {
        many += &format!("{}\r\nx\r\n", head(&format!("part{part}")));
    }
    many += "--x--\r\n";
    let problem = server.send("POST", "/v1/scenes", &form, many.as_bytes()).problem(413);
    assert!(problem["detail"].as_str().unwrap().contains("128 parts"), "{problem}");
    // Small parts, then one far larger than what may be held.
    let mut body = Vec::new();
    for part in 0..100 {
        body.extend_from_slice(format!("{}\r\nx\r\n", head(&format!("part{part}"))).as_bytes());
    }
    body.extend_from_slice((head("large.bin") + "\r\n").as_bytes());
    body.resize(body.len() + (32 << 20), 7);
    body.extend_from_slice(format!("\r\n{}\r\n", head("scene")).as_bytes());
    body.extend_from_slice(&scene("cornell.glb"));
    body.extend_from_slice(b"\r\n--x--\r\n");
    let stored = server.send("POST", "/v1/scenes", &form, &body);
    assert_eq!(stored.status, 201, "{}", stored.text());
}

fn gunzip(bytes: &[u8]) -> Vec<u8> {
    let pipe = || Stdio::piped();
    let mut gzip =
        Command::new("gzip").arg("-dc").stdin(pipe()).stdout(pipe()).spawn().expect("gzip runs");
    gzip.stdin.take().unwrap().write_all(bytes).unwrap();
    let output = gzip.wait_with_output().unwrap();
    assert!(output.status.success(), "not gzip: {:?}", String::from_utf8_lossy(bytes));
    output.stdout
}

#[test]
fn an_error_can_be_read_where_compression_is_offered() {
    let server = Server::start();
    for path in ["/v1/scenes/%ff", "/nowhere"] {
        let mut answer = server.send("GET", path, &[("accept-encoding", "gzip")], b"");
        if answer.header("content-encoding") == "gzip" {
            answer.body = gunzip(&answer.body);
        }
        let problem = answer.problem(answer.status);
        assert_eq!(problem["instance"], path);
        assert!(problem["detail"].as_str().unwrap().is_ascii(), "{problem}");
    }
}

#[test]
fn every_limit_names_its_field() {
    let server = Server::start_with(&["--max-side", "256", "--max-seconds", "5"]);
    let answer = |change: Value| {
        let mut job = json!({"scene": "cornell"});
        job.as_object_mut().unwrap().extend(change.as_object().unwrap().clone());
        server.post("/v1/jobs", &job)
    };
    for (change, field) in [
        (json!({"width": 0}), "width"),
        (json!({"width": 257, "height": 8}), "width"),
        (json!({"height": -1}), "height"),
        (json!({"height": 1.5}), "height"),
        (json!({"time_budget_s": 5.1}), "time_budget_s"),
        (json!({"target_error": 2}), "target_error"),
        (json!({"method": "magic"}), "method"),
        (json!({"camera": 99}), "camera"),
        (json!({"camera": "nobody"}), "camera"),
        (json!({"options": {"patches": 3_000_000}}), "options.patches"),
        (json!({"options": {"hemicube_resolution": 33}}), "options.hemicube_resolution"),
        (json!({"options": {"colour": "blue"}}), "options.colour"),
        (json!({"snapshots": {"every_s": 0}}), "snapshots.every_s"),
        (json!({"surprise": 1}), "surprise"),
    ] {
        let mut change = change;
        if change.get("width").is_none() {
            change["width"] = json!(64);
        }
        if change.get("height").is_none() {
            change["height"] = json!(64);
        }
        let problem = answer(change.clone()).problem(422);
        assert_eq!(problem["errors"][0]["field"], field, "{change}: {problem}");
    }
    answer(json!({"scene": "0".repeat(64), "width": 8, "height": 8})).problem(404);
    let missing = server.post("/v1/jobs", &json!({"width": 8, "height": 8})).problem(422);
    assert_eq!(missing["errors"][0]["field"], "scene");
}

#[test]
fn a_full_queue_says_when_to_come_back_and_still_takes_cancels() {
    let server = Server::start_with(&["--max-queued", "1"]);
    let long = json!({"scene": "cornell", "width": 16, "height": 16, "time_budget_s": 60});
    let running = server.submit(&long);
    server.wait_until(&running, |job| job["state"] == "running");
    let queued = server.submit(&long);
    let refused = server.post("/v1/jobs", &long);
    refused.problem(429);
    assert!(refused.header("retry-after").parse::<u32>().unwrap() > 0);
    let cancelled = server.send("POST", &format!("/v1/jobs/{queued}/cancel"), &[], b"");
    assert_eq!(cancelled.json()["state"], "cancelled");
    assert_eq!(server.post("/v1/jobs", &long).status, 202);
}

#[test]
fn pages_of_other_sites_are_kept_out() {
    let server = Server::start();
    let own = server.address.clone();
    let port = own.rsplit(':').next().unwrap().to_owned();
    let post = |headers: &[(&str, &str)]| server.send("POST", "/v1/jobs", headers, b"{}");
    // What a page can have its browser send: forms and texts, from elsewhere.
    for kind in ["application/json", "text/plain", "multipart/form-data; boundary=x"] {
        for (name, value) in [
            ("sec-fetch-site", "cross-site"),
            ("sec-fetch-site", "same-site"),
            ("origin", "http://127.0.0.1:1"),
            ("origin", &*format!("http://localhost:{port}")),
            ("origin", "null"),
            ("origin", "https://evil.example"),
        ] {
            let problem = post(&[(name, value), ("content-type", kind)]).problem(403);
            assert!(problem["detail"].as_str().unwrap().contains("--cors-origin"), "{problem}");
        }
    }
    let own_page = [
        ("origin", &*format!("http://{own}")),
        ("sec-fetch-site", "same-origin"),
        ("content-type", "application/json"),
    ];
    post(&own_page).problem(422);
    assert_eq!(server.get("/v1/jobs").status, 200);
}

#[test]
fn without_keys_only_names_that_are_allowed_lead_to_the_server() {
    let folder = TempDir::new().unwrap();
    let everywhere = ["--listen", "0.0.0.0:0", "--allow-remote"];
    for arguments in [&["--listen", "127.0.0.1:0"][..], &everywhere] {
        let server = Server::start_in(folder.path(), arguments);
        for path in ["/", "/v1/jobs", "/docs/", "/openapi.yaml", "/metrics", "/assets/app.js"] {
            let rebound = [("host", "rebound.example")];
            let problem = server.send("GET", path, &rebound, b"").problem(403);
            let detail = problem["detail"].as_str().unwrap();
            assert!(detail.contains("--allowed-host") && detail.contains("keys add"), "{detail}");
            for host in ["localhost", "10.1.2.3:80", "[::1]"] {
                let answer = server.send("GET", path, &[("host", host)], b"");
                assert_eq!(answer.status, 200, "{path} {host}");
            }
        }
        // Probes come by any name.
        assert_eq!(server.send("GET", "/livez", &[("host", "rebound.example")], b"").status, 200);
    }
}

#[test]
fn behind_a_tls_proxy_on_this_machine_nothing_has_to_be_opened() {
    let through_proxy = [
        ("host", "render.example.org"),
        ("origin", "https://render.example.org"),
        ("sec-fetch-site", "same-origin"),
        ("x-forwarded-proto", "https"),
        ("content-type", "application/json"),
    ];
    let job = json!({"scene": "cornell", "width": 8, "height": 8, "max_iterations": 1});
    let job = job.to_string();
    let named = Server::start_with(&["--allowed-host", "render.example.org,other.example.org"]);
    let answer = named.send("POST", "/v1/jobs", &through_proxy, job.as_bytes());
    assert_eq!(answer.status, 202, "{}", answer.text());
    // With keys any name will do, but a page of another origin still gets nothing done.
    let closed = Server::start_with(&["--require-keys"]);
    closed.send("POST", "/v1/jobs", &through_proxy, job.as_bytes()).problem(401);
    let foreign = [through_proxy[0], ("origin", "https://evil.example"), through_proxy[4]];
    closed.send("POST", "/v1/jobs", &foreign, job.as_bytes()).problem(403);
}

#[test]
fn a_truncated_scene_never_takes_the_server_down() {
    let mut server = Server::start();
    let whole = scene("cornell.glb");
    for cut in (0..whole.len()).step_by(whole.len() / 40) {
        let answer = server.post_scene(&whole[..cut]);
        answer.problem(422);
    }
    assert!(server.is_alive());
}
