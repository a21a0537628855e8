//! What the server refuses before it hurts, how waiting and streams behave, what can be traced.

use hemilux_tests::keys::{With, keys};
use hemilux_tests::load::{peak_mib, resident_mib};
use hemilux_tests::server::{PATIENCE, Server, program, repository, scene};
use serde_json::{Value, json};
use std::collections::BTreeSet;
use std::io::{BufRead, BufReader, Read, Write};
use std::net::TcpStream;
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};
use tempfile::TempDir;

fn quick() -> Value {
    json!({"scene": "cornell", "width": 16, "height": 16, "max_iterations": 2,
           "options": {"patches": 200}, "method": "stochastic"})
}

#[test]
fn a_nearly_full_disk_takes_nothing_new_and_gives_what_there_is() {
    let folder = TempDir::new().unwrap();
    let server = Server::start_in(folder.path(), &[]);
    let id = server.submit(&quick());
    server.wait(&id);
    server.terminate();
    // No disk has so much free.
    let server = Server::start_in(folder.path(), &["--min-free-mb", "1000000000000"]);
    for answer in [server.post("/v1/jobs", &quick()), server.post_scene(&scene("cornell.glb"))] {
        let problem = answer.problem(503);
        assert_eq!(problem["limit"], "disk", "{problem}");
        assert!(problem["detail"].as_str().unwrap().contains("MiB free"), "{problem}");
        assert!(!answer.header("retry-after").is_empty());
    }
    for tail in ["", "/image.png", "/events"] {
        assert_eq!(server.get(&format!("/v1/jobs/{id}{tail}")).status, 200, "{tail}");
    }
    assert_eq!(server.send("POST", &format!("/v1/jobs/{id}/cancel"), &[], b"").status, 200);
    assert_eq!(server.send("DELETE", &format!("/v1/jobs/{id}"), &[], b"").status, 204);
    assert!(server.get("/metrics").text().contains("hemilux_refusals_total{limit=\"disk\"} 2"));
}

#[test]
fn a_job_that_can_never_fit_is_refused_by_name() {
    let server = Server::start_with(&["--max-job-memory-mb", "64"]);
    let methods = [
        "hemilux",
        "ray-traced",
        "illumination-map",
        "stochastic",
        "monte-carlo",
        "progressive",
        "gauss-seidel",
        "auto",
    ];
    for (method, side) in
        methods.map(|method| (method, 2048)).into_iter().chain([("gauss-seidel", 8)])
    {
        let wish = json!({"scene": "cornell", "width": side, "height": side, "method": method,
                          "max_iterations": 1});
        let problem = server.post("/v1/jobs", &wish).problem(422);
        assert_eq!(problem["limit"], "memory", "{problem}");
        let detail = problem["detail"].as_str().unwrap();
        assert!(detail.contains(method) && detail.contains("64 MiB"), "{detail}");
    }
    server.wait(&server.submit(&quick()));
}

#[test]
fn waiting_for_a_change_ends_with_the_change() {
    let server = Server::start();
    let endless = json!({"scene": "cornell", "width": 16, "height": 16, "time_budget_s": 600});
    let blocker = server.submit(&endless);
    server.wait_until(&blocker, |job| job["state"] == "running");
    let id = server.submit(&endless);
    let change = |id: &str, wait: &str| {
        server.get(&format!("/v1/jobs/{id}?wait={wait}&until=change")).json()["state"].clone()
    };
    let begun = Instant::now();
    assert_eq!(change(&id, "0.5"), "queued", "nothing changed");
    assert!(begun.elapsed() >= Duration::from_millis(500));
    let waited = std::thread::scope(|scope| {
        let waiting = scope.spawn(|| {
            let begun = Instant::now();
            (change(&id, "60"), begun.elapsed())
        });
        std::thread::sleep(Duration::from_millis(300));
        server.send("POST", &format!("/v1/jobs/{blocker}/cancel"), &[], b"");
        waiting.join().unwrap()
    });
    assert_eq!(waited.0, "running");
    assert!(waited.1 < Duration::from_secs(20), "{:?}", waited.1);
    assert_eq!(change(&blocker, "60"), "cancelled", "an end is there already");
    for wrong in ["wait=61", "wait=-1", "wait=x", "until=never"] {
        server.get(&format!("/v1/jobs/{id}?{wrong}")).problem(400);
    }
    // Shutdown does not wait for the waiting.
    let path = format!("/v1/jobs/{id}?wait=60&until=change");
    let mut idle = open(&server, &path);
    std::thread::sleep(Duration::from_millis(100));
    let took = server.terminate();
    assert!(took < Duration::from_secs(8), "{took:?}");
    let mut answer = String::new();
    let _ = idle.read_to_string(&mut answer);
}

/// A connection that has sent a request and read nothing.
fn open(server: &Server, path: &str) -> TcpStream {
    let mut stream = TcpStream::connect(&server.address).unwrap();
    stream.set_read_timeout(Some(PATIENCE)).unwrap();
    write!(stream, "GET {path} HTTP/1.1\r\nhost: {}\r\n\r\n", server.address).unwrap();
    stream
}

#[test]
fn clients_that_read_nothing_hold_neither_memory_nor_the_end() {
    let server = Server::start();
    let wish = json!({"scene": "cornell", "width": 280, "height": 280, "time_budget_s": 600,
                      "method": "stochastic", "options": {"patches": 300},
                      "snapshots": {"every_s": 0.1, "formats": ["exr"]}});
    let id = server.submit(&wish);
    let path = format!("/v1/jobs/{id}/events");
    let head = server.events_head(&path);
    assert!(head.iter().any(|(n, v)| n == "x-accel-buffering" && v == "no"), "{head:?}");
    assert!(head.iter().any(|(n, v)| n == "cache-control" && v.contains("no-cache")), "{head:?}");
    let mut reader = server.events(&path, &[]);
    let snapshots = |reader: &mut dyn Iterator<Item = hemilux_tests::server::Event>, n| {
        reader.filter(|event| event.name == "snapshot").take(n).for_each(drop);
    };
    snapshots(&mut reader, 2);
    let before = resident_mib(server.pid());
    // Each snapshot is nearly a megabyte; what none of these takes must not pile up.
    let deaf: Vec<_> = (0..40).map(|_| open(&server, &format!("{path}?inline=exr"))).collect();
    // Others are half-open: a request that never ends, a head that never comes.
    let mut half = TcpStream::connect(&server.address).unwrap();
    half.write_all(b"POST /v1/jobs HTTP/1.1\r\nhost: 127.0.0.1\r\ncontent-le").unwrap();
    let mut stuck = TcpStream::connect(&server.address).unwrap();
    stuck
        .write_all(b"POST /v1/scenes HTTP/1.1\r\nhost: 127.0.0.1\r\ncontent-type: model/gltf-binary\r\ncontent-length: 1000\r\n\r\nx")
        .unwrap();
    snapshots(&mut reader, 6);
    let grown = resident_mib(server.pid()) - before;
    println!("40 clients that read nothing: {grown:.0} MiB more");
    // A picture's event and the buffers of the connection, for each; not six pictures.
    assert!(grown < 40.0 * 4.0, "{grown} MiB");
    // The server goes on meanwhile, and ends in time.
    assert_eq!(server.get("/livez").status, 200);
    let took = server.terminate();
    assert!(took < Duration::from_secs(10), "{took:?}");
    drop((deaf, half, stuck));
}

/// A number from the environment: the full size of a test that is shorter where nobody asks.
fn setting(name: &str, default: u64) -> u64 {
    std::env::var(name).ok().and_then(|value| value.parse().ok()).unwrap_or(default)
}

/// From its making on, a picture takes none of the server's memory. 100 readers of one of 16 million
/// pixels:
/// `HEMILUX_SLOW_READERS=100 HEMILUX_SLOW_READERS_SIDE=4096`.
#[test]
fn slow_readers_of_a_large_picture_hold_no_memory() {
    let readers = setting("HEMILUX_SLOW_READERS", 60);
    let side = setting("HEMILUX_SLOW_READERS_SIDE", 2048);
    let server = Server::start();
    let wish = json!({"scene": "cornell", "width": side, "height": side, "max_iterations": 1,
                      "method": "stochastic", "options": {"patches": 200, "pixel_samples": 1}});
    let id = server.submit(&wish);
    let path = format!("/v1/jobs/{id}");
    let record = server.wait_at_most(10 * PATIENCE, &id);
    assert_eq!(record["state"], "succeeded", "{record}");
    let size = record["result"][1]["size"].as_u64().unwrap();
    // Otherwise whole pictures would be within the limit, too.
    assert!(size * readers > 400 << 20, "{size} bytes");
    let mut slow: Vec<TcpStream> =
        (0..readers).map(|_| open(&server, &format!("{path}/image.exr"))).collect();
    for reader in &mut slow {
        let mut start = [0; 1024];
        reader.read_exact(&mut start).unwrap();
        assert!(start.starts_with(b"HTTP/1.1 200 "), "{}", String::from_utf8_lossy(&start));
    }
    // All of them are in the middle of it, and another one gets all of it.
    let whole = server.get(&format!("{path}/image.exr"));
    assert_eq!((whole.status, whole.body.len() as u64), (200, size));
    let peak = peak_mib(server.pid());
    println!("{readers} slow readers of {} MiB: {peak:.0} MiB at most", size >> 20);
    assert!(peak < 300.0, "{peak} MiB");
    // Who goes on gets what is left; the head of the answer is in the first kilobyte.
    let mut rest = Vec::new();
    slow.remove(0).take(size - 1024).read_to_end(&mut rest).unwrap();
    assert!(rest.len() as u64 == size - 1024 && whole.body.windows(64).any(|w| w == &rest[..64]));
}

#[test]
fn requests_can_be_traced_from_the_client_to_the_job() {
    let folder = TempDir::new().unwrap();
    let mut child = Command::new(program())
        .args(["serve", "--listen", "127.0.0.1:0", "--devices", "cpu", "--log-format", "json"])
        .arg("--data-dir")
        .arg(folder.path())
        .env("RUST_LOG", "hemilux=debug")
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    let mut line = String::new();
    BufReader::new(child.stdout.take().unwrap()).read_line(&mut line).unwrap();
    let server = Server::attach(line.trim().strip_prefix("http://").unwrap(), child.id());
    let trace = "0af7651916cd43dd8448eb211c80319c";
    let headers = [
        ("content-type", "application/json"),
        ("x-request-id", "mine-1"),
        ("traceparent", &format!("00-{trace}-b7ad6b7169203331-01")),
    ];
    let accepted = server.send("POST", "/v1/jobs", &headers, quick().to_string().as_bytes());
    assert_eq!((accepted.status, accepted.header("x-request-id")), (202, "mine-1"));
    let id = accepted.json()["id"].as_str().unwrap().to_owned();
    server.wait(&id);
    // A problem names its request; made-up ids differ.
    let missing = server.send("GET", "/v1/jobs/none", &[("x-request-id", "mine-2")], b"");
    assert_eq!(missing.problem(404)["request_id"], "mine-2");
    let (one, two) = (server.get("/v1/jobs/none"), server.get("/v1/jobs/none"));
    assert_eq!(one.problem(404)["request_id"], one.header("x-request-id"));
    assert_ne!(one.header("x-request-id"), two.header("x-request-id"));
    assert!(Command::new("kill").arg(child.id().to_string()).status().unwrap().success());
    let mut log = String::new();
    child.stderr.take().unwrap().read_to_string(&mut log).unwrap();
    assert!(child.wait().unwrap().success());
    let lines: Vec<Value> = log
        .lines()
        .map(|line| serde_json::from_str(line).unwrap_or_else(|_| panic!("no JSON: {line}")))
        .collect();
    let span =
        |name: &str, member: &str, value: &str| {
            lines.iter().filter_map(|line| line["spans"].as_array()).flatten().any(|span| {
                span["name"] == name && span[member] == value && span["trace_id"] == trace
            })
        };
    assert!(span("request", "id", "mine-1"), "{log}");
    assert!(span("job", "id", &id), "{log}");
}

/// The metrics that a text of OpenMetrics declares, by the names that queries use.
fn exported(text: &str) -> BTreeSet<String> {
    let declared = text.lines().filter_map(|line| line.strip_prefix("# TYPE "));
    let names = declared.filter_map(|line| line.split_once(' ')).flat_map(|(name, kind)| {
        let endings: &[&str] = match kind {
            "counter" => &["_total"],
            "histogram" => &["_bucket", "_sum", "_count"],
            "info" => &["_info"],
            _ => &[""],
        };
        endings.iter().map(move |ending| format!("{name}{ending}"))
    });
    names.collect()
}

/// The metrics that a text names.
fn named(text: &str) -> BTreeSet<String> {
    let is_part = |c: char| c.is_ascii_alphanumeric() || c == '_';
    text.split(|c: char| !is_part(c))
        .filter(|word| word.starts_with("hemilux_"))
        .map(str::to_owned)
        .collect()
}

#[test]
fn the_grafana_dashboard_and_the_server_know_the_same_metrics() {
    let server = Server::start();
    // Routes appear with their first request.
    assert_eq!(server.get("/livez").status, 200);
    let exported = exported(&server.get("/metrics").text());
    assert!(exported.len() > 25, "{exported:?}");
    let text = std::fs::read_to_string(repository().join("docs/grafana.json")).unwrap();
    let dashboard: Value = serde_json::from_str(&text).unwrap();
    let panels = dashboard["panels"].as_array().unwrap();
    assert!(panels.len() >= 10);
    let queries: String = panels
        .iter()
        .flat_map(|panel| panel["targets"].as_array().into_iter().flatten())
        .map(|target| format!("{}\n", target["expr"].as_str().unwrap()))
        .collect();
    let shown = named(&queries);
    let unknown: Vec<_> = shown.difference(&exported).collect();
    assert!(
        unknown.is_empty(),
        "the dashboard asks for what the server does not export: {unknown:?}"
    );
    // And what is exported is shown, or written about.
    let written = std::fs::read_to_string(repository().join("docs/operations.md")).unwrap();
    let base = |name: &String| {
        ["_total", "_bucket", "_sum", "_count", "_info"]
            .iter()
            .fold(name.clone(), |name, end| name.trim_end_matches(end).to_owned())
    };
    for name in exported.iter().map(base).collect::<BTreeSet<_>>() {
        assert!(written.contains(&name), "docs/operations.md leaves {name} out");
    }
    // The comparison itself finds a name that is not there.
    assert!(!exported.is_superset(&named("rate(hemilux_nonsense_total[5m])")));
}

#[test]
fn the_audit_log_says_who_did_what() {
    let folder = TempDir::new().unwrap();
    let (ann, bob) = (
        keys(folder.path(), &["add", "ann"]),
        keys(folder.path(), &["add", "bob\"} {", "--scope", "read"]),
    );
    let file = folder.path().join("audit.log");
    let server = Server::start_in(folder.path(), &["--audit-file", file.to_str().unwrap()]);
    let secrets = [ann.clone(), bob.clone(), "0123456789abcdef".to_owned()];
    let (ann, bob) = (With(&server, &ann), With(&server, &bob));
    let lines = || -> Vec<Value> {
        let text = std::fs::read_to_string(&file).unwrap();
        text.lines().map(|line| serde_json::from_str(line).unwrap()).collect()
    };
    let last = |action: &str| -> Value {
        let line = lines().pop().unwrap();
        assert_eq!(line["action"], action, "{line}");
        assert_eq!(line["target"], "audit");
        line
    };
    let mut wish = quick();
    wish["labels"] = json!({"a\nb": "{\"action\": \"job.delete\"}\n"});
    wish["webhook"] = json!({"url": "https://example.invalid/", "secret": secrets[2]});
    let headers = [("content-type", "application/json"), ("x-request-id", "the-first-one")];
    let answer = ann.send("POST", "/v1/jobs", &headers, wish.to_string().as_bytes());
    let job = answer.json()["id"].as_str().unwrap().to_owned();
    let made = last("job.create");
    assert_eq!((&made["status"], &made["key_name"]), (&json!(202), &json!("ann")), "{made}");
    assert_eq!(made["made"], format!("/v1/jobs/{job}"));
    assert_eq!(
        (&made["request_id"], &made["address"]),
        (&json!("the-first-one"), &json!("127.0.0.1"))
    );
    assert_eq!(made["bytes_sent"], wish.to_string().len());
    let ann_id = made["key"].clone();
    assert!(ann_id.as_str().unwrap().starts_with("key-"), "{made}");

    let done = ann.get(&format!("/v1/jobs/{job}?wait=60")).json();
    assert_eq!(done["state"], "succeeded", "{done}");
    let picture = ann.get(&format!("/v1/jobs/{job}/image.png"));
    let taken = last("picture.download");
    assert_eq!((&taken["job"], &taken["key"]), (&json!(job), &ann_id));
    assert_eq!(taken["bytes_asked"], picture.body.len(), "{taken}");
    // What is refused is in it with its status, and whose key it was.
    bob.post("/v1/jobs", &wish).problem(403);
    let refused = last("job.create");
    assert_eq!((&refused["status"], &refused["key_name"]), (&json!(403), &json!("bob\"} {")));
    assert_ne!(refused["key"], ann_id);
    server.post("/v1/jobs", &wish).problem(401);
    let unknown = last("job.create");
    assert_eq!((&unknown["status"], &unknown["key"]), (&json!(401), &Value::Null));
    for (method, tail, action) in [
        ("POST", "/pin", "job.pin"),
        ("DELETE", "/pin", "job.unpin"),
        ("POST", "/cancel", "job.cancel"),
        ("DELETE", "", "job.delete"),
    ] {
        ann.send(method, &format!("/v1/jobs/{job}{tail}"), &[], b"");
        assert_eq!(last(action)["job"], job.as_str());
    }
    let glb = scene("furnace.glb");
    let named = "/v1/scenes?name=x%0A%7B%22action%22";
    let sent = ann.send("POST", named, &[("content-type", "model/gltf-binary")], &glb).json();
    let id = sent["id"].as_str().unwrap();
    let stored = last("scene.create");
    assert_eq!(stored["made"], format!("/v1/scenes/{id}"));
    assert_eq!(stored["bytes_sent"], glb.len());
    ann.send("DELETE", &format!("/v1/scenes/{id}"), &[], b"");
    assert_eq!(last("scene.delete")["scene"], id);
    let before = lines().len();
    assert_eq!(ann.get("/v1/jobs").status, 200);
    assert_eq!(lines().len(), before, "reading lists is no deed");
    let text = std::fs::read_to_string(&file).unwrap();
    for secret in &secrets {
        assert!(!text.contains(secret), "a secret is in the audit log");
    }
    // The file may be moved away at any time.
    std::fs::rename(&file, folder.path().join("audit.log.1")).unwrap();
    ann.send("DELETE", &format!("/v1/jobs/{job}"), &[], b"");
    assert_eq!(lines().len(), 1);
    drop(server);
    let off = ["--audit", "off", "--audit-file", file.to_str().unwrap()];
    let server = Server::start_in(folder.path(), &off);
    With(&server, &secrets[0]).send("DELETE", &format!("/v1/jobs/{job}"), &[], b"");
    assert_eq!(lines().len(), 1);
}

#[test]
fn what_the_server_writes_is_for_its_own_user() {
    use std::os::unix::fs::PermissionsExt;
    let folder = TempDir::new().unwrap();
    let data = folder.path().join("data");
    let key = keys(&data, &["add", "k"]);
    let server = Server::start_in(&data, &[]);
    let who = With(&server, &key);
    let job = who.submit(&quick());
    assert_eq!(who.get(&format!("/v1/jobs/{job}?wait=60")).json()["state"], "succeeded");
    let mut paths = vec![data];
    let mut seen = 0;
    while let Some(path) = paths.pop() {
        let Ok(about) = std::fs::metadata(&path) else { continue };
        let mode = about.permissions().mode();
        assert_eq!(mode & 0o077, 0, "{}: {mode:o}", path.display());
        seen += 1;
        if about.is_dir() {
            paths.extend(std::fs::read_dir(&path).unwrap().map(|entry| entry.unwrap().path()));
        }
    }
    assert!(seen > 8, "database, lock, scene, pictures; only {seen} were there");
}

#[test]
fn what_expires_goes_and_what_is_pinned_stays() {
    let folder = TempDir::new().unwrap();
    let server = Server::start_in(folder.path(), &[]);
    let (old, kept) = (server.submit(&quick()), server.submit(&quick()));
    for id in [&old, &kept] {
        assert_eq!(server.wait(id)["pinned"], false);
    }
    let pinned = server.send("POST", &format!("/v1/jobs/{kept}/pin"), &[], b"");
    assert_eq!((pinned.status, pinned.json()["pinned"].clone()), (200, json!(true)));
    server.terminate();
    std::thread::sleep(Duration::from_millis(20));
    // A hundredth of a second.
    let server = Server::start_in(folder.path(), &["--keep-days", "0.0000001"]);
    let deadline = Instant::now() + PATIENCE;
    while server.get(&format!("/v1/jobs/{old}")).status != 404 {
        assert!(Instant::now() < deadline, "the old job never went");
        std::thread::sleep(Duration::from_millis(50));
    }
    assert_eq!(server.get(&format!("/v1/jobs/{kept}/image.png")).status, 200);
    assert!(server.get("/metrics").text().contains("hemilux_collected_total{kind=\"job\"} 1"));
    let unpinned = server.send("DELETE", &format!("/v1/jobs/{kept}/pin"), &[], b"");
    assert_eq!(unpinned.json()["pinned"], false);
    server.send("POST", "/v1/jobs/nothing/pin", &[], b"").problem(404);
}
