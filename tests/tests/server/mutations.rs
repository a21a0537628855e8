//! Bodies near valid ones: whatever comes, the answer is a job or a problem document, and the
//! server goes on. `HEMILUX_MUTATION_SECONDS` makes it longer; `scripts/fuzz` looks deeper.

use hemilux_tests::mutate::Mutator;
use hemilux_tests::server::{Server, repository};
use serde_json::{Value, json};
use std::time::{Duration, Instant};

fn seeds(target: &str) -> Vec<Vec<u8>> {
    let folder = repository().join("fuzz/seeds").join(target);
    let mut paths: Vec<_> =
        std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path()).collect();
    paths.sort();
    paths.into_iter().map(|path| std::fs::read(path).unwrap()).collect()
}

#[test]
fn whatever_is_posted_is_answered_in_order() {
    // Whole seconds for each kind of body.
    let seconds = std::env::var("HEMILUX_MUTATION_SECONDS").ok().and_then(|s| s.parse().ok());
    let patience = Duration::from_secs(seconds.unwrap_or(2));
    // The queue takes nothing, so no job runs.
    let mut server = Server::start_with(&["--max-queued", "0", "--max-upload-mb", "1"]);
    for (target, path, content_type) in [
        ("job", "/v1/jobs", "application/json"),
        ("multipart", "/v1/jobs", "multipart/form-data; boundary=x"),
        ("scene", "/v1/scenes", "model/gltf-binary"),
    ] {
        let seeds = seeds(target);
        let mut mutator = Mutator::new(1);
        let begun = Instant::now();
        let (mut posts, mut statuses) = (0_u64, std::collections::BTreeMap::<u16, u64>::new());
        // Longer where a busy machine answers few in that time.
        let has_seen_enough = |posts, statuses: usize| posts > 2000 || statuses >= 2 && posts > 20;
        while begun.elapsed() < patience || !has_seen_enough(posts, statuses.len()) {
            let body = mutator.mutant(&seeds);
            let answer = server.send("POST", path, &[("content-type", content_type)], &body);
            *statuses.entry(answer.status).or_default() += 1;
            posts += 1;
            let shown = || String::from_utf8_lossy(&body).into_owned();
            assert!(answer.status < 500, "{}: {}", answer.text(), shown());
            if answer.status >= 400 {
                answer.problem(answer.status);
            }
        }
        println!("{target}: {posts} posts in {:.0} s: {statuses:?}", begun.elapsed().as_secs_f64());
        assert!(posts > 20);
        // Near enough to get past the first check, and far enough not to pass.
        assert!(statuses.len() >= 2, "{statuses:?}");
    }
    assert!(server.is_alive());
    assert_eq!(server.get("/readyz").status, 200);
}

/// Every field of `value`, as a path of names and positions.
fn paths(value: &Value, at: &[String], found: &mut Vec<Vec<String>>) {
    let children: Vec<(String, &Value)> = match value {
        Value::Object(fields) => fields.iter().map(|(name, v)| (name.clone(), v)).collect(),
        Value::Array(items) => items.iter().enumerate().map(|(i, v)| (i.to_string(), v)).collect(),
        _ => Vec::new(),
    };
    for (name, child) in children {
        let path = [at, &[name]].concat();
        found.push(path.clone());
        paths(child, &path, found);
    }
}

/// Puts `change` where `path` leads, or takes what is there away.
fn mutated(job: &Value, path: &[String], change: Option<&Value>) -> Value {
    let mut job = job.clone();
    let (last, parents) = path.split_last().unwrap();
    let parent = parents.iter().fold(&mut job, |value, name| match value {
        Value::Array(items) => &mut items[name.parse::<usize>().unwrap()],
        value => &mut value[name.as_str()],
    });
    match (parent, change) {
        (Value::Array(items), Some(change)) => {
            items[last.parse::<usize>().unwrap()] = change.clone();
        }
        (Value::Array(items), None) => drop(items.remove(last.parse().unwrap())),
        (parent, Some(change)) => parent[last.as_str()] = change.clone(),
        (parent, None) => drop(parent.as_object_mut().unwrap().remove(last)),
    }
    job
}

/// A path as errors write it.
fn written(path: &[String]) -> String {
    path.iter().fold(String::new(), |text, name| {
        if name.parse::<usize>().is_ok() {
            format!("{text}[{name}]")
        } else if text.is_empty() {
            name.clone()
        } else {
            format!("{text}.{name}")
        }
    })
}

/// Whether an error at `field` tells the sender of a change at `path` where to look: at the place
/// itself, at what it is part of, or, where it fits no more, at another part of the same thing.
fn tells(field: &str, path: &[String]) -> bool {
    let first = field.split(['.', '[']).next();
    first == Some(path[0].as_str()) || path[0] == "height" && field == "width"
}

#[test]
fn whatever_is_wrong_with_a_job_its_field_is_named() {
    // What is right is refused for want of a place, so that no job runs.
    let server = Server::start_with(&["--max-queued", "0"]);
    let with_camera = json!({
        "scene": "cornell", "method": "stochastic", "width": 32, "height": 24,
        "target_error": 0.1, "time_budget_s": 1.5, "max_iterations": 3, "seed": 7,
        "camera": {"eye": [0.5, 0.5, 2.0], "target": [0.5, 0.5, 0.0], "up": [0.0, 1.0, 0.0],
                   "yfov_degrees": 40.0},
        "environment": {"sky": [0.5, 1.0, 2.0], "rotation_degrees": 10.0, "scale": 2.0,
                        "sun": {"direction": [0.3, 0.8, 0.5], "irradiance": [3.0, 2.9, 2.7],
                                "angular_diameter_degrees": 0.5}},
        "snapshots": {"every_s": 1.0, "formats": ["png", "exr"]},
        "options": {"patches": 500, "first_shot": true, "hemicube_faces": "all"},
        "priority": 0, "fresh": true, "labels": {"project": "atrium"},
        "webhook": {"url": "https://example.org/a", "events": ["failed"],
                    "secret": "0123456789abcdef"},
    });
    let job = |camera: Value| {
        let mut job = with_camera.clone();
        job["camera"] = camera;
        job
    };
    let jobs = [with_camera.clone(), job(json!(0)), job(json!("camera"))];
    let wrong = [
        json!(null),
        json!(true),
        json!(-1),
        json!(1.5),
        json!(1e30),
        json!(1e-4),
        json!(""),
        json!("x"),
        json!("\u{0}"),
        json!([]),
        json!([1, 2]),
        json!({}),
        json!({"fov": 1}),
        json!(18_446_744_073_709_551_615_u64),
    ];
    let (mut refused, mut exact) = (0, 0);
    for job in &jobs {
        server.post("/v1/jobs", job).problem(429);
        let mut all = Vec::new();
        paths(job, &[], &mut all);
        for path in &all {
            for change in wrong.iter().map(Some).chain([None]) {
                let body = mutated(job, path, change);
                let answer = server.post("/v1/jobs", &body);
                if answer.status == 429 {
                    continue;
                }
                let problem = answer.problem(answer.status);
                let place = written(path);
                let shown = || format!("{place} = {change:?}: {problem}");
                assert!(matches!(answer.status, 404 | 422), "{}", shown());
                let errors = problem["errors"].as_array().unwrap_or_else(|| panic!("{}", shown()));
                let fields = errors.iter().map(|error| error["field"].as_str().unwrap());
                let fields: Vec<_> = fields.collect();
                assert!(!fields.is_empty() && fields.iter().all(|f| tells(f, path)), "{}", shown());
                assert!(!problem.to_string().contains("untagged"), "{}", shown());
                refused += 1;
                exact += u32::from(fields.contains(&place.as_str()));
            }
        }
    }
    println!("{refused} refused, {exact} of them at the very place");
    assert!(refused > 500 && exact > refused * 3 / 4, "{exact} of {refused}");
    // What the engine alone knows to be wrong, and what a client is told of it.
    for (change, field, told) in [
        (json!({"up": [0, 0, 1]}), "camera.up", "parallel"),
        (json!({"up": [0, 0, 0]}), "camera.up", "zero"),
        (json!({"target": [0.5, 0.5, 2.000_000_01]}), "camera.target", "camera.eye"),
        (json!({"yfov_degrees": 0.0005}), "camera.yfov_degrees", "0.001"),
        (json!({"fov": 40}), "camera.fov", "expected one of"),
        (json!({"target": null}), "camera.target", "null"),
        (json!({"eye": [0, 0]}), "camera.eye", "array of length 3"),
    ] {
        let mut body = with_camera.clone();
        let camera = body["camera"].as_object_mut().unwrap();
        camera.extend(change.as_object().unwrap().clone());
        let problem = server.post("/v1/jobs", &body).problem(422);
        assert_eq!(problem["errors"][0]["field"], field, "{problem}");
        let detail = problem["errors"][0]["detail"].as_str().unwrap();
        assert!(detail.contains(told), "{problem}");
    }
    let missing = mutated(&with_camera, &["camera".into(), "target".into()], None);
    let problem = server.post("/v1/jobs", &missing).problem(422);
    assert_eq!(problem["errors"][0]["field"], "camera.target", "{problem}");
    // The rule itself refuses an error at another field.
    assert!(!tells("width", &["camera".into()]) && !tells(".", &["camera".into()]));
}
