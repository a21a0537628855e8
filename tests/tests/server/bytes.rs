//! No job fills the disk, and no caller's results go for another's.

use hemilux_tests::keys::{With, keys};
use hemilux_tests::server::{Event, Events, PATIENCE, Server};
use serde_json::{Value, json};
use std::collections::BTreeSet;
use std::path::Path;
use std::time::Instant;
use tempfile::TempDir;

/// A job that takes snapshots as fast as it may until it is cancelled.
fn eager(side: u32) -> Value {
    json!({
        "scene": "cornell", "method": "stochastic", "width": side, "height": side,
        "time_budget_s": 600, "options": {"patches": 200, "hemicube_resolution": 32},
        "snapshots": {"every_s": 0.1, "formats": ["png", "exr"]}
    })
}

fn quick(side: u32, seed: u64) -> Value {
    json!({"scene": "cornell", "width": side, "height": side, "max_iterations": 2, "seed": seed,
           "options": {"patches": 200}, "method": "stochastic"})
}

/// Names and bytes of a job's files.
fn files(folder: &Path, job: &str) -> Vec<(String, u64)> {
    let listed = std::fs::read_dir(folder.join("artifacts/jobs").join(job));
    listed
        .into_iter()
        .flatten()
        .filter_map(|entry| {
            let entry = entry.ok()?;
            Some((entry.file_name().into_string().ok()?, entry.metadata().ok()?.len()))
        })
        .collect()
}

fn cancel(server: &Server, job: &str) -> Value {
    server.send("POST", &format!("/v1/jobs/{job}/cancel"), &[], b"");
    server.wait(job)
}

/// The next notice of a stream.
fn next_notice(events: &mut Events) -> Value {
    let notice = events.find(|event| event.name == "notice");
    notice.expect("a notice comes before the stream ends").data
}

#[test]
fn snapshots_stay_within_their_share_and_the_picture_is_kept() {
    const SHARE: u64 = 1 << 20;
    let folder = TempDir::new().unwrap();
    // Nothing but pictures is stored.
    let arguments = ["--max-job-mb", "1", "--checkpoint-every-s", "0", "--keep-solutions-mb", "0"];
    let server = Server::start_in(folder.path(), &arguments);
    let job = server.submit(&eager(192));
    let path = format!("/v1/jobs/{job}/events");
    let (mut thinned, mut most) = (0, 0);
    for event in server.events(&path, &[]) {
        let stored = server.get(&format!("/v1/jobs/{job}")).json()["bytes"].as_u64().unwrap();
        most = most.max(stored);
        assert!(stored <= SHARE, "{stored}");
        if event.name == "notice" {
            assert_eq!(event.data["what"], "snapshots_thinned", "{:?}", event.data);
            assert!(event.data["detail"].as_str().unwrap().contains("1 MiB"), "{:?}", event.data);
            assert!(event.data["removed"].as_u64() > Some(0));
            thinned += 1;
        }
        if thinned == 3 {
            break;
        }
    }
    assert_eq!(thinned, 3, "the stream ended");
    assert!(most > SHARE / 3, "the share is used: {most}");
    let ended = cancel(&server, &job);
    assert_eq!(ended["state"], "cancelled");
    // What events name is there, and nothing else is.
    let mut named = BTreeSet::new();
    let mut left = 0;
    for event in server.events(&path, &[]) {
        left += u32::from(event.name == "snapshot");
        for picture in event.data["pictures"].as_array().into_iter().flatten() {
            assert_eq!(server.get(picture["url"].as_str().unwrap()).status, 200);
            let (hash, format) = (picture["sha256"].as_str(), picture["format"].as_str());
            named.insert(format!("{}.{}", hash.unwrap(), format.unwrap()));
        }
    }
    assert!(left >= 2, "{left} snapshots are left");
    // A checkpoint that the job was ended with goes when its record has.
    let there = || -> BTreeSet<String> {
        files(folder.path(), &job).into_iter().map(|(name, _)| name).collect()
    };
    let begun = Instant::now();
    while there() != named && begun.elapsed() < PATIENCE {
        std::thread::sleep(std::time::Duration::from_millis(20));
    }
    assert_eq!(there(), named);
    assert_eq!(ended["result"].as_array().unwrap().len(), 2);

    // One that is too large for the share alone is left out, and the job goes on to its picture.
    let large = server.submit(&eager(512));
    let notice = next_notice(&mut server.events(&format!("/v1/jobs/{large}/events"), &[]));
    assert_eq!(notice["what"], "snapshots_paused", "{notice}");
    assert!(notice["detail"].as_str().unwrap().contains("--max-job-mb"), "{notice}");
    assert_eq!(files(folder.path(), &large), []);
    assert_eq!(cancel(&server, &large)["result"].as_array().unwrap().len(), 2);
}

#[test]
fn a_short_disk_keeps_no_snapshots_until_there_is_room() {
    let folder = TempDir::new().unwrap();
    let rules = folder.path().join("failpoints");
    std::fs::write(&rules, "").unwrap();
    let from = format!("@{}", rules.display());
    let data = folder.path().join("data");
    let server =
        Server::start_with_environment(&data, &[], &[("HEMILUX_FAILPOINTS", from.as_str())]);
    let job = server.submit(&eager(16));
    let path = format!("/v1/jobs/{job}/events");
    let mut events = server.events(&path, &[]);
    let mut next = |name: &str| events.find(|event| event.name == name).expect("it comes");
    next("snapshot");
    std::fs::write(&rules, "disk=error").unwrap();
    let notice = next("notice");
    assert_eq!(notice.data["what"], "snapshots_paused", "{notice:?}");
    assert!(notice.data["detail"].as_str().unwrap().contains("MiB free"), "{notice:?}");
    std::fs::write(&rules, "").unwrap();
    let snapshot = next("snapshot");
    std::fs::write(&rules, "disk=error").unwrap();
    let again = next("notice");
    assert!(notice.id < snapshot.id && snapshot.id < again.id);
    assert_eq!(again.data["what"], "snapshots_paused", "a new spell is told anew");
    let ended = cancel(&server, &job);
    assert_eq!(
        (&ended["state"], ended["result"].as_array().unwrap().len()),
        (&json!("cancelled"), 2)
    );
    let paused = |event: &Event| event.name == "notice";
    assert_eq!(server.events(&path, &[]).filter(paused).count(), 2, "each spell is told once");
}

fn done(who: &With<'_>, job: &Value) -> String {
    let id = who.submit(job);
    let ended = who.get(&format!("/v1/jobs/{id}?wait=60")).json();
    assert_eq!(ended["state"], "succeeded", "{ended}");
    id
}

#[test]
fn room_is_made_by_who_stores_most_and_solutions_count() {
    let folder = TempDir::new().unwrap();
    let [much, little] = ["much", "little"].map(|name| keys(folder.path(), &["add", name]));
    let server = Server::start_in(folder.path(), &[]);
    let only = done(&With(&server, &little), &quick(16, 0));
    let who = With(&server, &much);
    let many: Vec<_> = (0..10).map(|seed| done(&who, &quick(16, seed))).collect();
    let bytes =
        |who: &With<'_>, id: &str| who.get(&format!("/v1/jobs/{id}")).json()["bytes"].as_u64();
    let each = bytes(&who, &many[0]).unwrap();
    let manifest = who.get(&format!("/v1/jobs/{}/manifest", many[0])).json();
    let sizes =
        manifest["pictures"].as_array().unwrap().iter().map(|p| p["size"].as_u64().unwrap());
    let solution = &manifest["solution"];
    let kept = [&solution["size"], &solution["baked"]["size"]].map(|size| size.as_u64().unwrap());
    assert_eq!(each, sizes.sum::<u64>() + kept.iter().sum::<u64>());
    let on_disk = files(folder.path(), &many[0]).iter().map(|(_, size)| size).sum::<u64>();
    assert_eq!(each, on_disk);
    let scene = std::fs::read_dir(folder.path().join("artifacts/scenes")).unwrap();
    let scene: u64 = scene.map(|entry| entry.unwrap().metadata().unwrap().len()).sum();
    server.terminate();

    // Room for about half of it.
    let gb = ((scene + 6 * each) as f64 / f64::from(1 << 30)).to_string();
    let server = Server::start_in(folder.path(), &["--keep-gb", &gb]);
    let is_there = |key: &str, id: &str| bytes(&With(&server, key), id).is_some();
    let left = || many.iter().filter(|id| is_there(&much, id)).count();
    let deadline = Instant::now() + PATIENCE;
    while left() > 5 {
        assert!(Instant::now() < deadline, "{} are left", left());
        std::thread::sleep(std::time::Duration::from_millis(50));
    }
    assert!(left() >= 4, "{} are left", left());
    assert!(is_there(&little, &only), "the oldest job of all, but not of who stores most");
    let gone: Vec<_> = many.iter().map(|id| is_there(&much, id)).collect();
    assert!(gone.is_sorted(), "the oldest go first: {gone:?}");
}

#[test]
fn stored_and_pinned_bytes_have_quotas() {
    let folder = TempDir::new().unwrap();
    let limits = ["--max-stored-mb", "1", "--max-pinned-mb", "0"];
    let key = keys(folder.path(), &[&["add", "small"], &limits[..]].concat());
    let server = Server::start_in(folder.path(), &["--keep-solutions-mb", "0"]);
    let who = With(&server, &key);
    let mut jobs = vec![done(&who, &quick(200, 0))];
    let refused = loop {
        let answer = who.post("/v1/jobs", &quick(200, jobs.len() as u64));
        if answer.status != 202 {
            break answer;
        }
        let id = answer.json()["id"].as_str().unwrap().to_owned();
        who.get(&format!("/v1/jobs/{id}?wait=60"));
        jobs.push(id);
        assert!(jobs.len() < 50, "the quota is never reached");
    };
    let problem = refused.problem(429);
    assert_eq!(problem["limit"], "stored_bytes", "{problem}");
    assert!(!refused.header("retry-after").is_empty());
    let pin = format!("/v1/jobs/{}/pin", jobs[0]);
    assert_eq!(who.send("POST", &pin, &[], b"").problem(429)["limit"], "pinned_bytes");
    // What is deleted makes room at once.
    let first = format!("/v1/jobs/{}", jobs.remove(0));
    assert_eq!(who.send("DELETE", &first, &[], b"").status, 204);
    jobs.push(done(&who, &quick(200, 99)));
    let metrics = server.get("/metrics").text();
    for limit in ["stored_bytes", "pinned_bytes"] {
        assert!(metrics.contains(&format!("hemilux_refusals_total{{limit=\"{limit}\"}} 1")));
    }
    // Nor are snapshots kept beyond it.
    let mut wish = eager(200);
    wish["max_iterations"] = json!(1_000_000_000_u64);
    for job in &jobs[1..] {
        who.send("DELETE", &format!("/v1/jobs/{job}"), &[], b"");
    }
    let id = who.submit(&wish);
    let bearer = format!("Bearer {key}");
    let mut events =
        server.events(&format!("/v1/jobs/{id}/events"), &[("authorization", bearer.as_str())]);
    let notice = next_notice(&mut events);
    assert_eq!(notice["what"], "snapshots_paused", "{notice}");
    assert!(notice["detail"].as_str().unwrap().contains("caller"), "{notice}");
    who.send("POST", &format!("/v1/jobs/{id}/cancel"), &[], b"");
    let last = events.last().unwrap();
    assert_eq!(
        (last.name.as_str(), last.data["pictures"].as_array().unwrap().len()),
        ("cancelled", 2)
    );
    drop(server);

    // With a limit for all that is kept, half of it may be pinned.
    let server = Server::start_with(&["--keep-gb", "0.001", "--keep-solutions-mb", "0"]);
    let mut pinned = 0;
    loop {
        let job = server.wait(&server.submit(&quick(200, pinned)));
        let path = format!("/v1/jobs/{}/pin", job["id"].as_str().unwrap());
        let answer = server.send("POST", &path, &[], b"");
        if answer.status != 200 {
            assert_eq!(answer.problem(429)["limit"], "pinned_bytes");
            assert!((pinned + 1) * job["bytes"].as_u64().unwrap() > 500_000);
            break;
        }
        pinned += 1;
        assert!(pinned < 20, "as much as one likes may be pinned");
    }
    assert!(pinned >= 1);
}
