//! Broken, hostile and odd scenes, sent to a running server.

use hemilux_tests::malformed::{Expect, cases};
use hemilux_tests::server::Server;
use serde_json::json;

#[test]
fn every_malformed_scene_gets_a_clear_answer_or_a_picture() {
    let mut server = Server::start();
    for (name, bytes, expect) in cases() {
        let answer = server.post_scene(&bytes);
        match expect {
            Expect::Refused { at_contains, what_contains, too_large } => {
                let problem = answer.problem(if too_large { 413 } else { 422 });
                let detail = problem["detail"].as_str().unwrap();
                assert!(detail.contains(at_contains), "{name}: {detail}");
                assert!(detail.contains(what_contains), "{name}: {detail}");
            }
            Expect::Accepted { warning_contains } => {
                assert!(matches!(answer.status, 200 | 201), "{name}: {}", answer.text());
                let record = answer.json();
                let warnings = record["warnings"].to_string();
                assert_eq!(warning_contains.is_empty(), warnings == "[]", "{name}: {warnings}");
                let job = server.wait(&server.submit(&json!({
                    "scene": record["id"], "width": 8, "height": 8, "max_iterations": 2,
                    "options": {"patches": 100, "hemicube_resolution": 16}
                })));
                assert_eq!(job["state"], "succeeded", "{name}: {job}");
            }
        }
        assert!(server.is_alive(), "{name} ended the server");
    }
    assert_eq!(server.get("/readyz").status, 200);
}
