//! The description of the API, the pages, and the command line around them.

use hemilux_tests::server::{Server, program, repository};
use std::process::{Command, Output};

fn hemilux(arguments: &[&str]) -> Output {
    Command::new(program()).args(arguments).output().unwrap()
}

#[test]
fn the_committed_description_is_the_programs() {
    let printed = hemilux(&["openapi"]);
    assert!(printed.status.success());
    let committed = std::fs::read(repository().join("openapi.yaml")).unwrap();
    assert!(
        printed.stdout == committed,
        "openapi.yaml is out of date; run: hemilux openapi > openapi.yaml"
    );
    let server = Server::start();
    assert_eq!(server.get("/openapi.yaml").body, committed);
    assert!(String::from_utf8(committed).unwrap().starts_with("openapi: 3.1"));
}

#[test]
fn pages_and_probes_answer() {
    let server = Server::start().until_ready();
    for path in
        ["/", "/assets/app.js", "/assets/style.css", "/docs/", "/livez", "/readyz", "/metrics"]
    {
        let answer = server.get(path);
        assert_eq!(answer.status, 200, "{path}");
        assert!(!answer.body.is_empty(), "{path}");
    }
    let initializer = server.get("/docs/swagger-initializer.js").text();
    assert!(initializer.contains("/openapi.yaml"), "{initializer}");
    let devices = server.get("/v1/devices").json();
    let cpu = devices["devices"].as_array().unwrap().iter().find(|d| d["id"] == "cpu").unwrap();
    assert_eq!(cpu["in_pool"], true);
}

#[test]
fn the_command_line_renders_files_with_their_figures() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    let (png, exr, stats) = (path("a.png"), path("a.exr"), path("stats.json"));
    let done = hemilux(&[
        "render",
        "cornell",
        "-o",
        &png,
        "-o",
        &exr,
        "--size",
        "40x30",
        "--iterations",
        "12",
        "--device",
        "cpu",
        "--set",
        "patches=500",
        "--stats",
        &stats,
        "--exposure",
        "-1.5",
        "-q",
    ]);
    let said = String::from_utf8_lossy(&done.stderr).into_owned();
    assert!(done.status.success(), "{said}");
    assert_eq!(said, "", "quiet means quiet");
    for file in [&png, &exr] {
        let picture = image::open(file).unwrap();
        assert_eq!((picture.width(), picture.height()), (40, 30));
    }
    let stats: serde_json::Value = serde_json::from_slice(&std::fs::read(stats).unwrap()).unwrap();
    assert_eq!(stats["iterations"], 12);
    for figure in [
        "method",
        "plan",
        "shots",
        "light_source_selection_ratio",
        "seconds_total",
        "seconds_solve",
        "estimated_error",
        "patches",
        "triangles",
        "device",
        "warnings",
    ] {
        assert!(stats.get(figure).is_some(), "{figure} is missing");
    }
}

#[test]
fn wrong_usage_is_2_and_failure_is_1() {
    for (arguments, code) in [
        (&["render", "cornell"][..], 2),
        (&["render", "cornell", "-o", "a.jpg"], 2),
        (&["render", "cornell", "-o", "/tmp/a.png", "--size", "0x10"], 2),
        (&["render", "cornell", "-o", "/tmp/a.png", "--method", "magic"], 2),
        (&["render", "cornell", "-o", "/tmp/a.png", "--camera", "nobody"], 2),
        (&["render", "cornell", "-o", "/tmp/a.png", "--device", "abacus"], 2),
        (&["render", "no-such-file.glb", "-o", "/tmp/a.png"], 1),
        (&["render", "cornell", "-o", "/no/such/folder/a.png"], 1),
        (&["serve", "--devices", "abacus"], 2),
    ] {
        let done = hemilux(arguments);
        assert_eq!(done.status.code(), Some(code), "{arguments:?}");
        let said = String::from_utf8_lossy(&done.stderr).into_owned();
        assert!(!said.is_empty() && !said.contains("panicked"), "{arguments:?}: {said}");
    }
}
