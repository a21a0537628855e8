//! The life of jobs over HTTP, with real renders.

use hemilux_engine::device::cpu::CpuDevice;
use hemilux_engine::render::{Limits, Observer, Plan, RenderRequest};
use hemilux_engine::scene::Warning;
use hemilux_engine::scene::gltf::{ImportLimits, Resources, import};
use hemilux_engine::transport::render;
use hemilux_tests::server::{Event, PATIENCE, Server, program, scene};
use hemilux_tests::skips::skipped;
use serde_json::{Value, json};
use std::io::Cursor;
use std::time::{Duration, Instant};

/// A job of a fraction of a second.
fn quick() -> Value {
    json!({
        "scene": "cornell", "width": 32, "height": 24, "max_iterations": 16, "seed": 7,
        "options": {"patches": 500, "hemicube_resolution": 32}
    })
}

/// A job that runs until told otherwise, as far as these tests are concerned.
fn endless() -> Value {
    json!({
        "scene": "cornell", "width": 32, "height": 24, "time_budget_s": 600,
        "options": {"patches": 500}, "snapshots": {"every_s": 0.1, "formats": ["png", "exr"]}
    })
}

fn mean_of_exr(bytes: &[u8]) -> f32 {
    let picture = image::load(Cursor::new(bytes), image::ImageFormat::OpenExr).unwrap();
    assert_eq!((picture.width(), picture.height()), (32, 24));
    let values = picture.into_rgb32f().into_raw();
    values.iter().sum::<f32>() / values.len() as f32
}

#[test]
fn a_job_goes_from_scene_to_picture() {
    let server = Server::start();
    let stored = server.post_scene(&scene("cornell.glb"));
    assert_eq!(stored.status, 201, "{}", stored.text());
    let record = stored.json();
    assert_eq!(stored.header("location"), format!("/v1/scenes/{}", record["id"].as_str().unwrap()));
    assert!(record["triangles"].as_u64().unwrap() >= 30);
    assert!(record["lights"].as_u64().unwrap() >= 1);
    assert_eq!(record["cameras"][0]["index"], 0);
    let again = server.post_scene(&scene("cornell.glb"));
    assert_eq!((again.status, again.json()), (200, record.clone()));

    let mut wish = quick();
    wish["scene"] = record["id"].clone();
    // The selection ratio below is a figure of shots.
    wish["method"] = json!("stochastic");
    wish["labels"] = json!({"project": "atrium"});
    let answer = server.post("/v1/jobs", &wish);
    assert_eq!(answer.status, 202, "{}", answer.text());
    let id = answer.json()["id"].as_str().unwrap().to_owned();
    assert_eq!(answer.header("location"), format!("/v1/jobs/{id}"));

    let job = server.wait(&id);
    assert_eq!(job["state"], "succeeded", "{job}");
    assert_eq!(job["iterations"], 16);
    assert_eq!(job["stats"]["stopped"], "iterations");
    assert_eq!(job["attempts"], 1);
    assert_eq!(job["device"], "cpu");
    assert!(job["light_source_selection_ratio"].as_f64().unwrap() > 0.0);
    assert!(job["finished_at"].is_string() && job["plan"]["patches"].as_u64().unwrap() > 100);

    let exr = server.get(&format!("/v1/jobs/{id}/image.exr"));
    assert_eq!((exr.status, exr.header("content-type")), (200, "image/x-exr"));
    assert!(mean_of_exr(&exr.body) > 0.01);
    let png = server.get(&format!("/v1/jobs/{id}/image"));
    assert_eq!((png.status, png.header("content-type")), (200, "image/png"));
    let decoded = image::load_from_memory(&png.body).unwrap();
    assert_eq!((decoded.width(), decoded.height()), (32, 24));
    let by_accept =
        server.send("GET", &format!("/v1/jobs/{id}/image"), &[("accept", "image/x-exr")], b"");
    assert_eq!(by_accept.body, exr.body);

    let etag = exr.header("etag").to_owned();
    let path = format!("/v1/jobs/{id}/image.exr");
    assert_eq!(server.send("GET", &path, &[("if-none-match", &etag)], b"").status, 304);
    let immutable = server.get(job["result"][0]["url"].as_str().unwrap());
    assert_eq!(immutable.status, 200);
    assert!(immutable.header("cache-control").contains("immutable"));
    assert_eq!(immutable.body.len() as u64, job["result"][0]["size"].as_u64().unwrap());

    let found = server.get("/v1/jobs?label=project:atrium&state=succeeded").json();
    assert_eq!(found["jobs"].as_array().unwrap().len(), 1);
    let found = server.get("/v1/jobs?label=project:other").json();
    assert_eq!(found["jobs"].as_array().unwrap().len(), 0);

    let trace = server.get(&format!("/v1/jobs/{id}/trace")).json();
    let last = trace["points"].as_array().unwrap().last().unwrap().clone();
    assert_eq!(last["iterations"], 16);
    let csv = server.get(&format!("/v1/jobs/{id}/trace.csv"));
    assert!(csv.text().starts_with("seconds,iterations,shots,"));
    assert_eq!(csv.text().lines().count(), trace["points"].as_array().unwrap().len() + 1);

    let metrics = server.get("/metrics").text();
    assert!(metrics.contains("hemilux_jobs{state=\"succeeded\"} 1"), "{metrics}");
    assert!(metrics.contains("hemilux_iterations_total 16"), "{metrics}");
}

#[test]
fn the_same_seed_and_iterations_give_the_same_bits() {
    let server = Server::start();
    let mut fresh = quick();
    fresh["fresh"] = json!(true);
    let hashes: Vec<Value> = (0..2)
        .map(|_| server.wait(&server.submit(&fresh))["result"][1]["sha256"].clone())
        .collect();
    assert!(hashes[0].is_string());
    assert_eq!(hashes[0], hashes[1]);
    let mut other = quick();
    other["seed"] = json!(8);
    let other = server.wait(&server.submit(&other))["result"][1]["sha256"].clone();
    assert_ne!(hashes[0], other);
}

#[test]
fn a_scene_travels_with_its_job_and_its_resources() {
    let server = Server::start();
    let glb = scene("cornell.glb");
    // The same scene as .gltf and .bin: the two chunks of the .glb.
    let json_length = u32::from_le_bytes(glb[12..16].try_into().unwrap()) as usize;
    let mut document: Value = serde_json::from_slice(&glb[20..20 + json_length]).unwrap();
    document["buffers"][0]["uri"] = json!("data/scene.bin");
    let binary = &glb[20 + json_length + 8..];
    let mut body = Vec::new();
    let mut part = |disposition: &str, bytes: &[u8]| {
        body.extend(
            format!("--cut\r\ncontent-disposition: form-data; {disposition}\r\n\r\n").bytes(),
        );
        body.extend(bytes);
        body.extend(b"\r\n");
    };
    let mut wish = quick();
    wish.as_object_mut().unwrap().remove("scene");
    part("name=\"job\"", wish.to_string().as_bytes());
    part("name=\"scene\"; filename=\"a.gltf\"", document.to_string().as_bytes());
    part("name=\"data/scene.bin\"; filename=\"scene.bin\"", binary);
    body.extend(b"--cut--\r\n");
    let form = [("content-type", "multipart/form-data; boundary=cut")];
    let answer = server.send("POST", "/v1/jobs", &form, &body);
    assert_eq!(answer.status, 202, "{}", answer.text());
    let job = server.wait(answer.json()["id"].as_str().unwrap());
    assert_eq!(job["state"], "succeeded", "{job}");
    let stored = server.get(&format!("/v1/scenes/{}", job["scene"].as_str().unwrap())).json();
    assert_eq!(stored["format"], "bundle");
    // The picture is the one of the .glb.
    let same = server.wait(&server.submit(&quick()));
    assert_eq!(job["result"][1]["sha256"], same["result"][1]["sha256"]);
}

#[test]
fn a_stream_resumes_without_gap_or_repetition() {
    let server = Server::start();
    let mut wish = endless();
    wish["time_budget_s"] = json!(1.5);
    let id = server.submit(&wish);
    let path = format!("/v1/jobs/{id}/events");

    let mut seen: Vec<Event> = server.events(&path, &[]).take(4).collect();
    let after = seen.last().unwrap().id.to_string();
    seen.extend(server.events(&path, &[("last-event-id", &after)]).take(3));
    let after = seen.last().unwrap().id;
    seen.extend(server.events(&format!("{path}?after={after}"), &[]));

    let ids: Vec<u64> = seen.iter().map(|event| event.id).collect();
    assert_eq!(ids, (1..=ids.len() as u64).collect::<Vec<_>>());
    let names: Vec<&str> = seen.iter().map(|event| event.name.as_str()).collect();
    assert_eq!(names[..2], ["state", "state"]);
    assert!(names.contains(&"progress") && names.contains(&"snapshot"), "{names:?}");
    assert_eq!(names.iter().filter(|name| **name == "succeeded").count(), 1);
    assert_eq!(names.last(), Some(&"succeeded"));
    // A replay of everything is the same, and ends by itself.
    assert_eq!(server.events(&path, &[]).collect::<Vec<_>>(), seen);
    // Beyond the last event there is nothing, and no waiting.
    let beyond = ids.len() + 100;
    assert_eq!(server.events(&format!("{path}?after={beyond}"), &[]).count(), 0);
}

#[test]
fn a_snapshot_travels_in_its_event() {
    use base64::Engine;
    let server = Server::start();
    let id = server.submit(&endless());
    let path = format!("/v1/jobs/{id}/events?inline=exr");
    let snapshot = server.events(&path, &[]).find(|event| event.name == "snapshot").unwrap();
    let pictures = snapshot.data["pictures"].as_array().unwrap();
    let of = |format: &str| pictures.iter().find(|p| p["format"] == format).unwrap();
    assert!(of("png").get("base64").is_none());
    let engine = base64::engine::general_purpose::STANDARD;
    let inline = engine.decode(of("exr")["base64"].as_str().unwrap()).unwrap();
    assert!(mean_of_exr(&inline) > 0.0);
    let linked = server.get(of("exr")["url"].as_str().unwrap());
    assert_eq!(linked.body, inline);
    assert_eq!(of("exr")["size"].as_u64().unwrap(), inline.len() as u64);
}

#[test]
fn a_large_picture_stays_out_of_events_and_its_url_leads_to_it() {
    let server = Server::start();
    // Uncompressed, three floats a pixel are above 1 MiB.
    let mut wish = quick();
    (wish["width"], wish["height"]) = (json!(512), json!(512));
    let id = server.submit(&wish);
    let path = format!("/v1/jobs/{id}/events?inline=exr");
    let end = server.events(&path, &[]).last().unwrap();
    assert_eq!(end.name, "succeeded", "{}", end.data);
    let exr =
        end.data["pictures"].as_array().unwrap().iter().find(|p| p["format"] == "exr").unwrap();
    let size = exr["size"].as_u64().unwrap();
    assert!(size > 1 << 20, "{size}");
    assert!(exr.get("base64").is_none());
    assert_eq!(server.get(exr["url"].as_str().unwrap()).body.len() as u64, size);
    // The smaller file of the same picture does travel.
    let small = server.events(&format!("/v1/jobs/{id}/events?inline=png"), &[]).last().unwrap();
    let png =
        small.data["pictures"].as_array().unwrap().iter().find(|p| p["format"] == "png").unwrap();
    assert!(png["base64"].is_string() == (png["size"].as_u64() <= Some(1 << 20)));
}

#[test]
fn files_are_sent_whole_or_in_part() {
    let server = Server::start();
    let mut wish = quick();
    wish["method"] = json!("stochastic");
    let id = server.submit(&wish);
    server.wait(&id);
    for file in ["image.png", "image.exr", "solution.glb"] {
        let path = format!("/v1/jobs/{id}/{file}");
        let get = |headers: &[(&str, &str)]| server.send("GET", &path, headers, b"");
        let whole = get(&[("accept-encoding", "gzip")]);
        let size = whole.body.len();
        assert_eq!((whole.status, whole.header("accept-ranges")), (200, "bytes"), "{file}");
        assert_eq!(whole.header("content-length"), size.to_string(), "{file}");
        let etag = whole.header("etag").to_owned();
        let head = server.send("HEAD", &path, &[("range", "bytes=0-1")], b"");
        assert_eq!((head.status, head.header("content-length")), (200, &*size.to_string()));
        assert!(head.body.is_empty() && head.header("etag") == etag);
        let part = get(&[("range", "bytes=10-19")]);
        assert_eq!((part.status, &part.body[..]), (206, &whole.body[10..20]), "{file}");
        assert_eq!(part.header("content-range"), format!("bytes 10-19/{size}"));
        assert_eq!((part.header("content-length"), part.header("etag")), ("10", &*etag));
        let tail = get(&[("range", "bytes=-7"), ("if-range", &etag)]);
        assert_eq!((tail.status, &tail.body[..]), (206, &whole.body[size - 7..]), "{file}");
        for headers in [
            [("range", "bytes=0-1"), ("if-range", "\"another\"")],
            [("range", "bytes=0-1,4-5"), ("x-nothing", "")],
            [("range", "bytes=5-4"), ("x-nothing", "")],
        ] {
            let answer = get(&headers);
            assert_eq!((answer.status, answer.body.len()), (200, size), "{file} {headers:?}");
        }
        let beyond = get(&[("range", &format!("bytes={size}-"))]);
        beyond.problem(416);
        assert_eq!(beyond.header("content-range"), format!("bytes */{size}"));
        let held = get(&[("if-none-match", &etag), ("range", "bytes=0-1")]);
        assert_eq!((held.status, held.body.len()), (304, 0), "{file}");
    }
}

#[test]
fn cancel_and_delete_can_be_repeated_in_every_state() {
    let server = Server::start();
    let running = server.submit(&endless());
    server.wait_until(&running, |job| job["iterations"].as_u64() > Some(0));
    // One device: the second waits.
    let queued = server.submit(&quick());
    for id in [&queued, &running] {
        for _ in 0..2 {
            let answer = server.send("POST", &format!("/v1/jobs/{id}/cancel"), &[], b"");
            assert_eq!(answer.status, 200, "{}", answer.text());
        }
        let job = server.wait(id);
        assert_eq!(job["state"], "cancelled");
    }
    // The picture so far is kept.
    assert_eq!(server.get(&format!("/v1/jobs/{running}/image.png")).status, 200);
    server.get(&format!("/v1/jobs/{queued}/image.png")).problem(404);

    let done = server.submit(&quick());
    assert_eq!(server.wait(&done)["state"], "succeeded");
    let answer = server.send("POST", &format!("/v1/jobs/{done}/cancel"), &[], b"");
    assert_eq!(answer.json()["state"], "succeeded");

    let doomed = server.submit(&endless());
    let events = server.events(&format!("/v1/jobs/{doomed}/events"), &[]);
    server.wait_until(&doomed, |job| job["state"] == "running");
    for id in [&doomed, &doomed, &done, &running] {
        let answer = server.send("DELETE", &format!("/v1/jobs/{id}"), &[], b"");
        assert_eq!(answer.status, 204, "{}", answer.text());
        server.get(&format!("/v1/jobs/{id}")).problem(404);
        server.get(&format!("/v1/jobs/{id}/image.png")).problem(404);
    }
    // Whoever followed the deleted job hears of its end.
    assert_eq!(events.last().unwrap().name, "cancelled");
    // And the device is free for the next.
    assert_eq!(server.wait(&server.submit(&quick()))["state"], "succeeded");
}

#[test]
fn an_idempotency_key_names_one_job() {
    let server = Server::start();
    let post = |job: &Value, key: &str| {
        let headers = [("content-type", "application/json"), ("idempotency-key", key)];
        server.send("POST", "/v1/jobs", &headers, job.to_string().as_bytes())
    };
    let first = post(&quick(), "k1");
    let again = post(&quick(), "k1");
    assert_eq!((first.status, again.status), (202, 202));
    assert_eq!(first.json()["id"], again.json()["id"]);
    assert_eq!(again.header("idempotency-replayed"), "true");
    let mut other = quick();
    other["seed"] = json!(99);
    post(&other, "k1").problem(409);
    assert_ne!(post(&quick(), "k2").json()["id"], first.json()["id"]);
    assert_eq!(server.get("/v1/jobs").json()["jobs"].as_array().unwrap().len(), 2);
}

#[test]
fn lists_come_in_pages_and_priority_goes_first() {
    let server = Server::start();
    let blocker = server.submit(&endless());
    server.wait_until(&blocker, |job| job["state"] == "running");
    let ids: Vec<String> = [0, 5, -5]
        .iter()
        .map(|priority| {
            let mut wish = quick();
            wish["priority"] = json!(priority);
            server.submit(&wish)
        })
        .collect();
    let mut listed = Vec::new();
    let mut path = "/v1/jobs?limit=2&state=queued".to_owned();
    loop {
        let page = server.get(&path).json();
        listed.extend(page["jobs"].as_array().unwrap().iter().map(|j| j["id"].clone()));
        match page["next_cursor"].as_str() {
            Some(cursor) => path = format!("/v1/jobs?limit=2&state=queued&cursor={cursor}"),
            None => break,
        }
    }
    let newest_first: Vec<Value> = ids.iter().rev().map(|id| json!(id)).collect();
    assert_eq!(listed, newest_first);

    server.send("POST", &format!("/v1/jobs/{blocker}/cancel"), &[], b"");
    let started: Vec<String> =
        ids.iter().map(|id| server.wait(id)["started_at"].as_str().unwrap().to_owned()).collect();
    assert!(started[1] < started[0] && started[0] < started[2], "{started:?}");
}

#[test]
fn waiting_ends_with_the_job() {
    let server = Server::start();
    let id = server.submit(&quick());
    let job = server.get(&format!("/v1/jobs/{id}?wait=60")).json();
    assert_eq!(job["state"], "succeeded");
}

/// Hears the plan and wants nothing more.
#[derive(Default)]
struct Planner(Option<Plan>);

impl Observer for Planner {
    fn planned(&mut self, plan: &Plan, _warnings: &[Warning]) {
        self.0 = Some(plan.clone());
    }

    fn cancelled(&self) -> bool {
        true
    }
}

/// The plan of the engine alone, as JSON.
fn plan_of_the_engine(limits: Limits) -> Value {
    let file = scene("cornell.glb");
    let scene = import(&file, &Resources::new(), &ImportLimits::default()).unwrap();
    let request = RenderRequest {
        limits,
        seed: 0,
        ..RenderRequest::new(std::sync::Arc::new(scene), "hemilux", [32, 24])
    };
    let mut planner = Planner::default();
    render(&mut CpuDevice::new(None).unwrap(), &request, &mut planner).unwrap();
    serde_json::to_value(planner.0.unwrap()).unwrap()
}

/// The longest time of a server ends jobs; it has no part in how they are rendered.
#[test]
fn the_same_request_has_the_same_plan_whatever_the_longest_time_and_on_the_command_line() {
    let servers = ["60", "3600"].map(|most| Server::start_with(&["--max-seconds", most]));
    let mut patches = std::collections::BTreeSet::new();
    for (seconds, iterations, target_error) in [
        (None, None, None),
        (None, None, Some(0.03)),
        (None, None, Some(0.02)),
        (None, Some(2), None),
        (None, Some(20), None),
        (Some(0.5), None, None),
        (Some(20.0), None, None),
        (None, Some(2), Some(0.03)),
        (Some(1.5), Some(2), None),
        (Some(0.5), None, Some(0.01)),
    ] {
        let wish = json!({
            "scene": "cornell", "method": "hemilux", "width": 32, "height": 24, "fresh": true,
            "time_budget_s": seconds, "max_iterations": iterations, "target_error": target_error
        });
        let limits = Limits { seconds, iterations, target_error, ..Limits::default() };
        let alone = plan_of_the_engine(limits);
        for server in &servers {
            let id = server.submit(&wish);
            let planned = server.wait_until(&id, |job| !job["plan"].is_null());
            assert_eq!(planned["plan"], alone, "{wish}");
            server.send("POST", &format!("/v1/jobs/{id}/cancel"), &[], b"");
            server.wait(&id);
        }
        patches.insert(alone["patches"].as_u64());
    }
    assert!(patches.len() > 2, "the limits that are asked for do decide: {patches:?}");
    assert_eq!(
        plan_of_the_engine(Limits::default()),
        plan_of_the_engine(Limits::seconds(10.0)),
        "10 s are the default of whoever asks"
    );

    let folder = tempfile::tempdir().unwrap();
    let stats = folder.path().join("stats.json");
    let output = folder.path().join("picture.png");
    let done = std::process::Command::new(program())
        .args(["render", "cornell", "--size", "32x24", "--method", "hemilux", "--device", "cpu"])
        .args(["--target-error", "0.3", "--iterations", "2", "--quiet", "--output"])
        .arg(output)
        .arg("--stats")
        .arg(&stats)
        .status();
    assert!(done.unwrap().success());
    let stats: Value = serde_json::from_slice(&std::fs::read(stats).unwrap()).unwrap();
    let wish = json!({"scene": "cornell", "method": "hemilux", "width": 32, "height": 24,
                      "target_error": 0.3, "max_iterations": 2});
    let job = servers[0].wait(&servers[0].submit(&wish));
    assert_eq!(job["plan"], stats["plan"]);
}

#[test]
fn the_longest_time_of_the_server_ends_a_job_and_says_so() {
    let server = Server::start_with(&["--max-seconds", "0.5"]);
    for wish in [
        json!({"scene": "cornell", "width": 16, "height": 16, "max_iterations": 1_000_000_000_u64}),
        json!({"scene": "cornell", "width": 16, "height": 16}),
    ] {
        let job = server.wait(&server.submit(&wish));
        assert_eq!(
            (&job["state"], &job["stats"]["stopped"]),
            (&json!("succeeded"), &json!("server_limit"))
        );
    }
    let asked = json!({"scene": "cornell", "width": 16, "height": 16, "time_budget_s": 0.3});
    let job = server.wait(&server.submit(&asked));
    assert_eq!(job["stats"]["stopped"], "time_budget");
}

#[test]
fn the_budget_of_threads_is_kept_and_shows_in_no_picture() {
    let mut pictures = std::collections::BTreeSet::new();
    for (threads, said) in [("1", "native CPU, 1 thread"), ("3", "native CPU, 3 threads")] {
        for isolation in ["process", "thread"] {
            let server = Server::start_with(&["--threads", threads, "--isolation", isolation]);
            let jobs = ["hemilux", "stochastic", "ray-traced"].map(|method| {
                let mut wish = json!({
                    "scene": "cornell", "width": 24, "height": 24, "max_iterations": 3, "seed": 5,
                    "method": method
                });
                if method == "stochastic" {
                    wish["options"] = json!({"patches": 500, "hemicube_resolution": 32});
                }
                server.wait(&server.submit(&wish))
            });
            for job in &jobs {
                let device = job["stats"]["device"].as_str().unwrap();
                assert!(
                    device.starts_with(said) && !device.starts_with("native CPU, 1 threads"),
                    "{job}"
                );
            }
            pictures
                .insert(jobs.map(|job| job["result"][1]["sha256"].as_str().unwrap().to_owned()));
        }
    }
    assert_eq!(pictures.len(), 1, "{pictures:?}");
}

/// Waits until every device of the server's pool is open and has nothing to do; the server is ready
/// as soon as one is.
fn until_all_devices_are_idle(server: &Server) {
    let deadline = Instant::now() + PATIENCE;
    loop {
        let list = server.get("/v1/devices").json();
        let devices = list["devices"].as_array().unwrap();
        let mut pool = devices.iter().filter(|device| device["in_pool"] == true);
        if pool.all(|device| device["status"] == "idle") {
            return;
        }
        assert!(Instant::now() < deadline, "not every device is idle: {list}");
        std::thread::sleep(Duration::from_millis(50));
    }
}

/// Each device has its share, and a job whose method does not use its GPU says what it used.
#[test]
fn devices_share_the_threads_and_stats_name_what_computed() {
    let listed = std::process::Command::new(program()).arg("devices").output().unwrap();
    if !String::from_utf8_lossy(&listed.stdout).lines().any(|line| line.starts_with("0 ")) {
        skipped("there is no GPU, not even a software one");
        return;
    }
    let server = Server::start_with(&["--devices", "0", "--threads", "3"]);
    until_all_devices_are_idle(&server);
    let job = |method: &str| {
        json!({"scene": "cornell", "width": 16, "height": 16, "time_budget_s": 2.0,
               "method": method})
    };
    // Keeps the first device busy, so that the others run on the second.
    let mut seen = std::collections::BTreeMap::new();
    for method in ["hemilux", "ray-traced", "stochastic"] {
        let both = [(); 2].map(|()| server.submit(&job(method)));
        for id in both {
            let job = server.wait(&id);
            let computed = job["stats"]["device"].as_str().unwrap().to_owned();
            seen.entry((job["device"].as_str().unwrap().to_owned(), method)).or_insert(computed);
        }
    }
    let computed = |device: &str, method: &'static str| {
        let key = (device.to_owned(), method);
        seen.get(&key).unwrap_or_else(|| panic!("{key:?} is not in {seen:?}")).clone()
    };
    for method in ["hemilux", "ray-traced"] {
        assert!(computed("cpu", method).starts_with("native CPU, 2 threads"), "{seen:?}");
        assert!(computed("0", method).starts_with("native CPU, 1 thread "), "{seen:?}");
    }
    assert!(!computed("0", "stochastic").contains("native CPU"), "{seen:?}");
}
