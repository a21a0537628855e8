//! Scenes that a device keeps for its next jobs.

use hemilux_tests::server::{Server, scene};
use serde_json::{Value, json};

const CAMERAS: [[f64; 3]; 2] = [[0.0, 1.0, 3.5], [0.4, 1.2, 3.2]];

/// A job on a scene, seen by one of the cameras.
fn job(scene: &str, camera: usize) -> Value {
    json!({
        "scene": scene, "method": "hemilux", "width": 40, "height": 32, "max_iterations": 2,
        "seed": 5, "fresh": true,
        "camera": { "eye": CAMERAS[camera], "target": [0.0, 1.0, 0.0], "yfov_degrees": 40.0 },
    })
}

/// Does a job; its picture, and whether the scene was there.
fn done(server: &Server, job: &Value) -> (Vec<u8>, bool) {
    let id = server.submit(job);
    let ended = server.wait(&id);
    assert_eq!(ended["state"], "succeeded", "{ended}");
    let kept = &ended["stats"]["diagnostics"]["scene_kept"];
    let image = server.get(&format!("/v1/jobs/{id}/image.exr"));
    assert_eq!(image.status, 200, "{}", image.text());
    (image.body, kept.as_f64().expect("a number") == 1.0)
}

#[test]
fn another_view_of_a_scene_finds_it_there_and_shows_the_same() {
    let server = Server::start();
    let (first, was_there) = done(&server, &job("cornell", 0));
    assert!(!was_there, "nothing can be there at first");
    let (second, was_there) = done(&server, &job("cornell", 1));
    assert!(was_there, "the scene of the job before is not there");
    let (again, was_there) = done(&server, &job("cornell", 0));
    assert!(was_there);
    assert!(again == first && second != first, "the pictures are not those of their cameras");
    let fresh = Server::start();
    let (expected, was_there) = done(&fresh, &job("cornell", 1));
    assert!(!was_there);
    assert!(second == expected, "a kept scene gives other bits");
}

#[test]
fn scenes_are_told_apart_and_none_is_kept_where_none_may_be() {
    let server = Server::start();
    done(&server, &job("cornell", 0));
    let posted = server.post_scene(&scene("cornell_phong.glb"));
    let other = posted.json()["id"].as_str().expect("an id").to_owned();
    assert!(!done(&server, &job(&other, 0)).1, "another scene was taken for it");
    assert!(done(&server, &job("cornell", 0)).1, "two small scenes fit");
    let frugal = Server::start_with(&["--keep-scenes-mb", "0"]);
    for _ in 0..2 {
        assert!(!done(&frugal, &job("cornell", 0)).1);
    }
}
