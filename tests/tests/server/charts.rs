//! Charts and traces of jobs.

use hemilux_tests::server::{Answer, Server};
use serde_json::{Value, json};

/// A job that has error estimates soon and a target that it does not reach.
fn estimating() -> Value {
    json!({
        "scene": "cornell", "method": "stochastic", "width": 32, "height": 32,
        "time_budget_s": 2, "target_error": 0.001,
        "options": {"patches": 500, "hemicube_resolution": 64}
    })
}

fn path(job: &str, what: &str) -> String {
    format!("/v1/jobs/{job}/{what}")
}

/// Vertical centres of the circles of a chart.
fn circle_heights(svg: &str) -> Vec<f64> {
    let circles = svg.lines().filter(|line| line.starts_with("<circle"));
    let center = |line: &str| line.split("cy=\"").nth(1)?.split('"').next()?.parse().ok();
    circles.map(|line| center(line).expect("a circle has a centre")).collect()
}

fn revalidated(server: &Server, path: &str, etag: &str) -> Answer {
    server.send("GET", path, &[("if-none-match", etag)], b"")
}

#[test]
fn the_chart_draws_the_estimates_of_the_trace_and_the_target() {
    let server = Server::start();
    let job = server.submit(&estimating());
    assert_eq!(server.wait(&job)["state"], "succeeded");
    let trace = server.get(&path(&job, "trace")).json();
    let errors: Vec<f64> = trace["points"]
        .as_array()
        .unwrap()
        .iter()
        .filter_map(|point| point["estimated_error"].as_f64())
        .collect();
    assert!((2..=40).contains(&errors.len()), "{trace}");

    let chart = server.get(&path(&job, "chart.svg"));
    assert_eq!((chart.status, chart.header("content-type")), (200, "image/svg+xml"));
    assert_eq!(chart.header("cache-control"), "no-cache");
    let svg = chart.text();
    assert!(svg.starts_with("<svg ") && svg.trim_end().ends_with("</svg>"));
    for words in ["stochastic: estimated error", "target 0.1 %", "seconds of solving"] {
        assert!(svg.lines().any(|line| line.trim() == words), "{words} is missing");
    }
    // One marker an estimate; a larger error is drawn higher.
    let heights = circle_heights(&svg);
    assert_eq!(heights.len(), errors.len());
    for (pair, drawn) in errors.windows(2).zip(heights.windows(2)) {
        let (error, height) = (pair[1] / pair[0], drawn[1] - drawn[0]);
        assert!(height.abs() <= 1.0 || (error > 1.0) == (height < 0.0), "{pair:?} {drawn:?}");
    }

    let etag = chart.header("etag").to_owned();
    assert!(etag.starts_with("W/\""), "the same text may travel compressed: {etag}");
    let again = revalidated(&server, &path(&job, "chart.svg"), &etag);
    assert_eq!((again.status, again.body.len(), again.header("etag")), (304, 0, etag.as_str()));
    assert_eq!(revalidated(&server, &path(&job, "chart.svg"), "\"other\"").status, 200);
}

#[test]
fn the_trace_comes_as_json_and_csv() {
    let server = Server::start();
    let job = server.submit(&estimating());
    server.wait(&job);
    let json = server.get(&path(&job, "trace"));
    assert_eq!((json.status, json.header("content-type")), (200, "application/json"));
    assert_eq!(json.header("vary").to_ascii_lowercase().matches("accept").count(), 1);
    assert_eq!(server.get(&path(&job, "trace.json")).body, json.body);
    let csv = server.get(&path(&job, "trace.csv"));
    assert_eq!((csv.status, csv.header("content-type")), (200, "text/csv; charset=utf-8"));
    let accepted = server.send("GET", &path(&job, "trace"), &[("accept", "text/csv")], b"");
    assert_eq!(accepted.body, csv.body);
    assert_ne!(json.header("etag"), csv.header("etag"));
    for (what, answer) in [("trace.json", &json), ("trace.csv", &csv)] {
        assert_eq!(revalidated(&server, &path(&job, what), answer.header("etag")).status, 304);
    }

    // The same numbers in both.
    let text = csv.text();
    let mut lines = text.lines();
    let header: Vec<&str> = lines.next().unwrap().split(',').collect();
    let points = json.json()["points"].as_array().unwrap().clone();
    assert_eq!(lines.clone().count(), points.len());
    for (line, point) in lines.zip(&points) {
        for (name, cell) in header.iter().zip(line.split(',')) {
            assert_eq!(cell.parse::<f64>().ok(), point[*name].as_f64(), "{name}");
        }
    }
}

#[test]
fn a_job_without_estimates_has_a_chart_that_says_so() {
    let server = Server::start();
    let job = server.submit(&json!({
        "scene": "cornell", "width": 16, "height": 16, "max_iterations": 2,
        "method": "progressive", "options": {"patches": 100, "hemicube_resolution": 32}
    }));
    assert_eq!(server.wait(&job)["state"], "succeeded");
    let ended = server.get(&path(&job, "chart.svg"));
    assert_eq!(ended.status, 200);
    assert!(ended.text().contains("the job ended without an error estimate"), "{}", ended.text());
    assert!(!ended.text().contains("<circle"));

    // The only device is busy, so the next one waits.
    let busy = server.submit(&json!({"scene": "cornell", "time_budget_s": 600}));
    server.wait_until(&busy, |job| job["state"] == "running");
    let queued = server.submit(&json!({"scene": "cornell", "target_error": 0.05}));
    let waiting = server.get(&path(&queued, "chart.svg"));
    assert!(waiting.text().contains("waiting for a device"), "{}", waiting.text());
    let trace = server.get(&path(&queued, "trace")).json();
    assert_eq!(trace, json!({"job": queued, "points": []}));
}

#[test]
fn jobs_that_are_not_there_are_problems() {
    let server = Server::start();
    let unknown = "01936f3e-8a51-7c3e-b1a4-6f2d7a7b6c01";
    for job in [unknown, "no-id"] {
        for what in ["chart.svg", "trace", "trace.json", "trace.csv"] {
            let answer = server.get(&path(job, what));
            assert_eq!(answer.status, 404, "{job} {what}");
            assert_eq!(answer.header("content-type"), "application/problem+json");
            assert_eq!(answer.json()["type"], "urn:hemilux:problem:not-found");
        }
    }
}
