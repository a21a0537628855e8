//! What surrounds a scene and what of its file it shows: the sun of a place and a moment, stored
//! maps of skies, variants, animations, the scenes of a file.

use hemilux_engine::image::Picture;
use hemilux_engine::radiometry::Rgb;
use hemilux_engine::scene::made::assemble;
use hemilux_tests::keys::{With, keys};
use hemilux_tests::malformed::triangle;
use hemilux_tests::server::{Answer, Server, program};
use serde_json::{Value, json};
use std::io::Cursor;
use std::path::Path;
use std::process::Command;

/// A shining triangle that is red, or in the variant `green` green.
fn two_colours() -> Vec<u8> {
    let (mut root, binary) = triangle();
    root["materials"][0]["emissiveFactor"] = json!([1, 0, 0]);
    let mut green = root["materials"][0].clone();
    green["emissiveFactor"] = json!([0, 1, 0]);
    root["materials"].as_array_mut().unwrap().push(green);
    root["extensionsUsed"] = json!(["KHR_materials_variants"]);
    root["extensions"] =
        json!({"KHR_materials_variants": {"variants": [{"name": "red"}, {"name": "green"}]}});
    let mappings = json!([{"material": 1, "variants": [1]}]);
    root["meshes"][0]["primitives"][0]["extensions"] =
        json!({"KHR_materials_variants": {"mappings": mappings}});
    assemble(&root, &binary)
}

fn of_exr(bytes: &[u8]) -> [f32; 3] {
    let picture = image::load(Cursor::new(bytes), image::ImageFormat::OpenExr).unwrap();
    let pixels = picture.into_rgb32f();
    let count = pixels.pixels().len() as f32;
    [0, 1, 2].map(|channel| pixels.pixels().map(|pixel| pixel[channel]).sum::<f32>() / count)
}

/// The mean colour of a job's picture, once it has succeeded.
fn mean(server: &Server, job: &Value) -> [f32; 3] {
    assert_eq!(job["state"], "succeeded", "{job}");
    let answer = server.get(&format!("/v1/jobs/{}/image.exr", job["id"].as_str().unwrap()));
    assert_eq!(answer.status, 200, "{}", answer.text());
    of_exr(&answer.body)
}

fn small(scene: &str, field: &str, value: Value) -> Value {
    let mut job = json!({"scene": scene, "width": 24, "height": 24, "max_iterations": 4});
    job[field] = value;
    job
}

#[test]
fn a_variant_is_chosen_by_name_and_is_another_job() {
    let server = Server::start();
    let stored = server.post_scene(&two_colours()).json();
    assert_eq!(stored["variants"], json!(["red", "green"]), "{stored}");
    let id = stored["id"].as_str().unwrap();
    let plain = server.wait(&server.submit(&small(id, "variant", json!("red"))));
    let green = server.wait(&server.submit(&small(id, "variant", json!("green"))));
    assert_eq!(green["result_of"], Value::Null, "another picture");
    assert_eq!(green["request"]["variant"], "green");
    let ([r0, g0, _], [r1, g1, _]) = (mean(&server, &plain), mean(&server, &green));
    assert!(r0 > 0.01 && g0 < 1e-4 && g1 > 0.01 && r1 < 1e-4, "{r0} {g0} {r1} {g1}");
    let refused = server.post("/v1/jobs", &small(id, "variant", json!("blue"))).problem(422);
    assert_eq!(refused["errors"][0]["field"], "variant");
    let detail = refused["errors"][0]["detail"].as_str().unwrap();
    assert!(detail.contains("\"red\", \"green\""), "{detail}");
    let none = server.post("/v1/jobs", &small("cornell", "variant", json!("red"))).problem(422);
    assert_eq!(none["errors"][0]["field"], "variant");
}

/// The mean colour of a small picture of a file by the command line, or what that said.
fn rendered(glb: &Path, more: &[&str]) -> Result<[f32; 3], String> {
    let exr = glb.with_extension("exr");
    let mut command = Command::new(program());
    command.arg("render").arg(glb).arg("-o").arg(&exr).args(["--size", "24x24", "-q"]);
    let done = command.args(["--iterations", "4", "--device", "cpu"]).args(more).output();
    let done = done.unwrap();
    let said = String::from_utf8_lossy(&done.stderr).into_owned();
    if done.status.success() { Ok(of_exr(&std::fs::read(&exr).unwrap())) } else { Err(said) }
}

#[test]
fn the_command_line_shows_a_variant_and_a_day() {
    let folder = tempfile::tempdir().unwrap();
    let glb = folder.path().join("two.glb");
    std::fs::write(&glb, two_colours()).unwrap();
    let render = |more: &[&str]| rendered(&glb, more);
    let [red, green, _] = render(&["--variant", "green"]).unwrap();
    assert!(green > 0.01 && red < 1e-4, "{red} {green}");
    let refused = render(&["--variant", "blue"]).unwrap_err();
    assert!(refused.contains("\"red\"") && refused.contains("\"green\""), "{refused}");
    let [red, _, blue] = render(&["--sun-at", "48.1,11.6,2026-06-21T12:00:00Z"]).unwrap();
    assert!(red > 100.0 && blue > red, "a clear sky is blue, and light is in lux: {red} {blue}");
}

/// A shining triangle that an animation moves out of the camera's sight within a second, and
/// another scene, where it is nine times as large and stays.
fn passing_by() -> Vec<u8> {
    let (mut root, mut binary) = triangle();
    root["nodes"].as_array_mut().unwrap().push(json!({"mesh": 0, "scale": [9, 9, 9]}));
    root["scenes"].as_array_mut().unwrap().push(json!({"name": "close", "nodes": [1, 2]}));
    binary.resize(binary.len().next_multiple_of(4), 0);
    let begin = binary.len();
    for x in [0.0f32, 1.0, 0.0, 0.0, 0.0, 50.0, 0.0, 0.0] {
        binary.extend(x.to_le_bytes());
    }
    root["buffers"][0]["byteLength"] = json!(binary.len());
    let views = root["bufferViews"].as_array_mut().unwrap();
    views.push(json!({"buffer": 0, "byteOffset": begin, "byteLength": 8}));
    views.push(json!({"buffer": 0, "byteOffset": begin + 8, "byteLength": 24}));
    let accessors = root["accessors"].as_array_mut().unwrap();
    accessors.push(json!({"bufferView": 4, "componentType": 5126, "count": 2, "type": "SCALAR"}));
    accessors.push(json!({"bufferView": 5, "componentType": 5126, "count": 2, "type": "VEC3"}));
    let channel = json!({"sampler": 0, "target": {"node": 0, "path": "translation"}});
    let sampler = json!({"input": 3, "output": 4});
    root["animations"] = json!([{"name": "leave", "channels": [channel], "samplers": [sampler]}]);
    assemble(&root, &binary)
}

#[test]
fn an_animation_and_a_scene_of_the_file_are_chosen_and_are_other_jobs() {
    let server = Server::start();
    let stored = server.post_scene(&passing_by()).json();
    let leave = json!([{"index": 0, "name": "leave", "seconds": 1.0}]);
    assert_eq!(stored["animations"], leave, "{stored}");
    let scenes = json!([{"index": 0, "name": null}, {"index": 1, "name": "close"}]);
    assert_eq!(stored["gltf_scenes"], scenes, "{stored}");
    let id = stored["id"].as_str().unwrap();
    let job = |parts: Value| {
        let mut job = small(id, "animation", json!("leave"));
        let members = job.as_object_mut().unwrap();
        members.extend(parts.as_object().unwrap().clone());
        members.retain(|_, value| !value.is_null());
        job
    };
    let run = |parts: Value| server.wait(&server.submit(&job(parts)));
    let begin = run(json!({}));
    let same = run(json!({"animation": 0, "time": 0}));
    assert_eq!(same["result_of"], begin["id"], "the same in other words");
    let end = run(json!({"time": 1.0}));
    assert_eq!((&end["result_of"], &end["request"]["time"]), (&Value::Null, &json!(1.0)));
    let close = run(json!({"animation": null, "gltf_scene": "close"}));
    assert_eq!(close["result_of"], Value::Null);
    let [[begin, ..], [end, ..], [close, ..]] =
        [&begin, &end, &close].map(|job| mean(&server, job));
    assert!(begin > 0.01 && end < 1e-4 && close > 2.0 * begin, "{begin} {end} {close}");
    for (parts, field, text) in [
        (json!({"animation": "stay"}), "animation", "1 of them: [0 \"leave\"]"),
        (json!({"animation": 1}), "animation", "index 1, but the file has 1 of them"),
        (json!({"gltf_scene": "far"}), "gltf_scene", "[0, 1 \"close\"]"),
        (json!({"time": -1}), "time", "not negative"),
        (json!({"animation": null, "time": 1}), "time", "choose one as `animation`"),
    ] {
        let refused = server.post("/v1/jobs", &job(parts)).problem(422);
        assert_eq!(refused["errors"][0]["field"], field, "{refused}");
        let detail = refused["errors"][0]["detail"].as_str().unwrap();
        assert!(detail.contains(text), "{detail}");
    }
}

#[test]
fn the_command_line_shows_a_moment_of_an_animation() {
    let folder = tempfile::tempdir().unwrap();
    let glb = folder.path().join("leave.glb");
    std::fs::write(&glb, passing_by()).unwrap();
    let render = |more: &[&str]| rendered(&glb, more);
    let rest = render(&[]).unwrap()[0];
    let end = render(&["--animation", "0", "--time", "1"]).unwrap()[0];
    let close = render(&["--scene", "close"]).unwrap()[0];
    assert!(rest > 0.01 && end < 1e-4 && close > 2.0 * rest, "{rest} {end} {close}");
    let refused = render(&["--animation", "stay"]).unwrap_err();
    assert!(refused.contains("no animation \"stay\"; there are: 0 \"leave\""), "{refused}");
    let refused = render(&["--scene", "2"]).unwrap_err();
    assert!(refused.contains("no scene \"2\"; there are: 0, 1 \"close\""), "{refused}");
}

#[test]
fn the_sun_of_a_place_and_a_moment_lights_a_job() {
    let server = Server::start();
    let id = server.post_scene(&two_colours()).json()["id"].as_str().unwrap().to_owned();
    let at = |time: &str| {
        let at = json!({"latitude": 48.1, "longitude": 11.6, "time": time});
        small(&id, "environment", json!({"sun_at": at}))
    };
    let noon = server.wait(&server.submit(&at("2026-06-21T12:00:00Z")));
    let same = server.wait(&server.submit(&at("2026-06-21T14:00:00+02:00")));
    assert_eq!(same["result_of"], noon["id"], "the same moment in other words");
    let night = server.wait(&server.submit(&at("2026-06-21T23:00:00Z")));
    assert_eq!(night["result_of"], Value::Null);
    let ([_, _, day], [_, _, dark]) = (mean(&server, &noon), mean(&server, &night));
    assert!(day > 100.0 && dark < 0.1, "{day} {dark}");
    let mut nowhere = at("2026-06-21T12:00:00Z");
    nowhere["environment"]["sun_at"]["latitude"] = json!(91);
    let problem = server.post("/v1/jobs", &nowhere).problem(422);
    assert_eq!(problem["errors"][0]["field"], "environment.sun_at.latitude");
    let problem = server.post("/v1/jobs", &at("noon")).problem(422);
    assert_eq!(problem["errors"][0]["field"], "environment.sun_at.time");
}

/// A map of one colour, OpenEXR.
fn sky(colour: Rgb) -> Vec<u8> {
    Picture::new(4, 2, vec![colour; 8]).to_exr().unwrap()
}

fn send_sky(server: &Server, path: &str, bytes: &[u8]) -> Answer {
    server.send("POST", path, &[("content-type", "image/x-exr")], bytes)
}

fn under(scene: &str, map: &str) -> Value {
    small(scene, "environment", json!({"sky": {"environment": map}, "scale": 3.0}))
}

#[test]
fn a_stored_map_lights_jobs_and_stays_for_them() {
    let folder = tempfile::tempdir().unwrap();
    let server = Server::start_in(folder.path(), &[]);
    let bytes = sky(Rgb::new(0.0, 0.5, 1.0));
    let stored = send_sky(&server, "/v1/environments?name=blue.exr", &bytes);
    assert_eq!(stored.status, 201, "{}", stored.text());
    let map = stored.json();
    let id = map["id"].as_str().unwrap();
    assert_eq!(stored.header("location"), format!("/v1/environments/{id}"));
    assert_eq!((&map["format"], &map["name"]), (&json!("exr"), &json!("blue.exr")));
    assert_eq!((&map["width"], &map["height"]), (&json!(4), &json!(2)));
    assert!((map["mean"][1].as_f64().unwrap() - 0.5).abs() < 1e-3, "{map}");
    let again = send_sky(&server, "/v1/environments", &bytes);
    assert_eq!((again.status, again.json()), (200, map.clone()));
    assert_eq!(server.get(&format!("/v1/environments/{id}")).json(), map);
    assert_eq!(server.get("/v1/environments").json()["environments"], json!([map]));
    // It is no scene, however it is asked for.
    assert_eq!(server.get("/v1/scenes").json()["scenes"], json!([]));
    server.get(&format!("/v1/scenes/{id}")).problem(404);
    server.post("/v1/jobs", &json!({"scene": id})).problem(404);
    assert_eq!(server.send("DELETE", &format!("/v1/scenes/{id}"), &[], b"").status, 204);
    assert_eq!(server.get(&format!("/v1/environments/{id}")).status, 200);

    let scene = server.post_scene(&two_colours()).json()["id"].as_str().unwrap().to_owned();
    let job = server.wait(&server.submit(&under(&scene, id)));
    let [_, green, blue] = mean(&server, &job);
    assert!((blue - 3.0).abs() < 0.5 && (green - 1.5).abs() < 0.3, "{green} {blue}");
    assert_eq!(job["request"]["environment"]["sky"], json!({"environment": id}));
    let twin = server.wait(&server.submit(&under(&scene, id)));
    assert_eq!(twin["result_of"], job["id"]);

    // Let go of, it is nobody's, but its file stays as long as a job names it.
    let file = folder.path().join("artifacts/scenes").join(id);
    assert_eq!(server.send("DELETE", &format!("/v1/environments/{id}"), &[], b"").status, 204);
    server.get(&format!("/v1/environments/{id}")).problem(404);
    assert!(file.exists());
    let unknown = server.post("/v1/jobs", &under(&scene, id)).problem(404);
    assert_eq!(unknown["errors"][0]["field"], "environment.sky");
    let view = json!({"max_iterations": 6, "width": 16, "height": 16});
    let path = format!("/v1/jobs/{}/views", job["id"].as_str().unwrap());
    let view = server.post(&path, &view);
    assert_eq!(view.status, 202, "{}", view.text());
    let view = server.wait(view.json()["id"].as_str().unwrap());
    assert!(mean(&server, &view)[2] > 2.0);
}

#[test]
fn what_is_no_map_is_refused_and_not_kept() {
    let server = Server::start_with(&["--max-upload-mb", "1"]);
    let mut negative = sky(Rgb::ONE);
    let length = negative.len();
    negative.truncate(length - 9);
    let scene = two_colours();
    for (bytes, what) in [
        (&b""[..], "empty"),
        (b"no sky", "OpenEXR"),
        (&negative, "decoded"),
        (&scene, "OpenEXR"),
        (&sky(Rgb::new(-1.0, 0.0, 0.0)), "radiance"),
    ] {
        let problem = send_sky(&server, "/v1/environments", bytes).problem(422);
        assert_eq!(problem["type"], "urn:hemilux:problem:bad-environment");
        let detail = problem["detail"].as_str().unwrap();
        assert!(detail.contains(what), "{detail}");
    }
    send_sky(&server, "/v1/environments", &vec![0; (1 << 20) + 1]).problem(413);
    let text = [("content-type", "text/plain")];
    server.send("POST", "/v1/environments", &text, b"x").problem(415);
    let map = sky(Rgb::ONE);
    server.post_scene(&map).problem(422);
    assert_eq!(server.get("/v1/environments").json()["environments"], json!([]));
    let sky = |sky: Value| json!({"scene": "cornell", "environment": {"sky": sky}});
    for wrong in [json!({}), json!({"environment": 3}), json!({"map": "x"})] {
        let problem = server.post("/v1/jobs", &sky(wrong)).problem(422);
        let field = problem["errors"][0]["field"].as_str().unwrap();
        assert!(field.starts_with("environment.sky"), "{field}");
    }
}

#[test]
fn maps_are_each_callers_own() {
    let folder = tempfile::tempdir().unwrap();
    let (ann, bob) = (
        keys(folder.path(), &["add", "ann"]),
        keys(folder.path(), &["add", "bob", "--max-scenes-mb", "1"]),
    );
    let server = Server::start_in(folder.path(), &[]);
    let [ann, bob] = [&ann, &bob].map(|key| With(&server, key));
    let send = |who: &With<'_>, bytes: &[u8]| {
        who.send("POST", "/v1/environments", &[("content-type", "image/x-exr")], bytes)
    };
    let bytes = sky(Rgb::new(0.1, 0.2, 0.3));
    let first = send(&ann, &bytes);
    assert_eq!(first.status, 201, "{}", first.text());
    let id = first.json()["id"].as_str().unwrap().to_owned();
    let path = format!("/v1/environments/{id}");
    bob.get(&path).problem(404);
    bob.post("/v1/jobs", &under("cornell", &id)).problem(404);
    assert_eq!(bob.send("DELETE", &path, &[], b"").status, 204);
    assert_eq!(ann.get(&path).status, 200);
    assert_eq!(send(&bob, &bytes).status, 201, "it tells nothing of who else sent the bytes");
    assert_eq!(ann.send("DELETE", &path, &[], b"").status, 204);
    ann.get(&path).problem(404);
    assert_eq!(bob.get(&path).status, 200);
    let pixels = (0..400 * 400).map(|i: u32| {
        let noise = i.wrapping_mul(2_654_435_761) as f32 / u32::MAX as f32;
        Rgb::new(noise, noise.sqrt(), noise.exp())
    });
    let large = Picture::new(400, 400, pixels.collect()).to_exr().unwrap();
    assert!(large.len() > 1 << 20);
    let full = send(&bob, &large).problem(429);
    assert_eq!(full["limit"], "scene_bytes");
}

/// The two files of a finished job.
fn files(server: &Server, job: &Value) -> [Vec<u8>; 2] {
    assert_eq!(job["state"], "succeeded", "{job}");
    ["png", "exr"].map(|ending| {
        let path = format!("/v1/jobs/{}/image.{ending}", job["id"].as_str().unwrap());
        server.get(&path).body
    })
}

fn has(file: &[u8], word: &str) -> bool {
    file.windows(word.len()).any(|bytes| bytes == word.as_bytes())
}

#[test]
fn a_background_is_in_the_files_and_makes_another_job() {
    let server = Server::start();
    let id = server.post_scene(&two_colours()).json()["id"].as_str().unwrap().to_owned();
    let done =
        |background: Value| server.wait(&server.submit(&small(&id, "background", background)));
    let plain = server.wait(&server.submit(&small(&id, "seed", json!(0))));
    assert_eq!(done(json!("sky"))["result_of"], plain["id"], "the default, spelt out");
    let (transparent, green) = (done(json!("transparent")), done(json!([0, 1, 0])));
    let again = done(json!([0.0, 1.0, 0.0]));
    assert_eq!([&transparent["result_of"], &green["result_of"]], [&Value::Null; 2]);
    assert_eq!(again["result_of"], green["id"]);
    assert_eq!(transparent["request"]["background"], "transparent");
    let load = |bytes: &[u8], format| image::load(Cursor::new(bytes), format).unwrap();
    let [png, exr] = files(&server, &transparent);
    let [png, exr] = [load(&png, image::ImageFormat::Png), load(&exr, image::ImageFormat::OpenExr)];
    assert!(png.color().has_alpha() && exr.color().has_alpha());
    let alpha: Vec<_> = exr.to_rgba32f().pixels().map(|pixel| pixel[3]).collect();
    assert!(alpha.contains(&0.0) && alpha.contains(&1.0), "{alpha:?}");
    let codes: Vec<_> = png.to_rgba8().pixels().map(|pixel| f32::from(pixel[3])).collect();
    assert!(alpha.iter().zip(codes).all(|(alpha, code)| (255.0 * alpha - code).abs() <= 0.5));
    for job in [&plain, &green] {
        let [png, exr] = files(&server, job);
        assert!(!load(&png, image::ImageFormat::Png).color().has_alpha());
        assert!(!load(&exr, image::ImageFormat::OpenExr).color().has_alpha());
    }
    assert!(mean(&server, &green)[1] > mean(&server, &plain)[1] + 0.1);
    for (field, value) in [
        ("background", json!([0, -1, 0])),
        ("background", json!("blue")),
        ("background", json!([1, 2])),
        ("units", json!("lumen")),
    ] {
        let problem = server.post("/v1/jobs", &small(&id, field, value)).problem(422);
        assert_eq!(problem["errors"][0]["field"], field, "{problem}");
    }
}

#[test]
fn the_header_of_the_exr_says_what_its_numbers_are() {
    let server = Server::start();
    let id = server.post_scene(&two_colours()).json()["id"].as_str().unwrap().to_owned();
    let done = |units: &str| server.wait(&server.submit(&small(&id, "units", json!(units))));
    let (photometric, radiometric) = (done("photometric"), done("radiometric"));
    assert_eq!(radiometric["result_of"], Value::Null, "another file");
    let [_, nits] = files(&server, &photometric);
    assert!(has(&nits, "whiteLuminance") && has(&nits, "cd/m^2") && !has(&nits, "W/(m^2 sr)"));
    let [_, watts] = files(&server, &radiometric);
    assert!(!has(&watts, "whiteLuminance") && has(&watts, "W/(m^2 sr)"));
    assert_eq!(mean(&server, &photometric), mean(&server, &radiometric), "nothing is converted");
    let at = json!({"latitude": 48.1, "longitude": 11.6, "time": "2026-06-21T12:00:00Z"});
    let mut day = small(&id, "environment", json!({"sun_at": at}));
    day["units"] = json!("radiometric");
    let problem = server.post("/v1/jobs", &day).problem(422);
    assert_eq!(problem["errors"][0]["field"], "units");
}

#[test]
fn the_command_line_has_backgrounds_and_units() {
    let folder = tempfile::tempdir().unwrap();
    let (glb, exr) = (folder.path().join("two.glb"), folder.path().join("out.exr"));
    std::fs::write(&glb, two_colours()).unwrap();
    let render = |more: &[&str]| {
        let mut command = Command::new(program());
        command.arg("render").arg(&glb).arg("-o").arg(&exr).args(["--size", "24x24", "-q"]);
        let done = command.args(["--iterations", "2", "--device", "cpu"]).args(more).output();
        let done = done.unwrap();
        let said = String::from_utf8_lossy(&done.stderr).into_owned();
        if done.status.success() { Ok(std::fs::read(&exr).unwrap()) } else { Err(said) }
    };
    let plain = render(&[]).unwrap();
    assert!(has(&plain, "whiteLuminance") && Picture::from_exr(&plain).unwrap().alpha.is_none());
    let other = render(&["--background", "transparent", "--units", "radiometric"]).unwrap();
    assert!(!has(&other, "whiteLuminance") && Picture::from_exr(&other).unwrap().alpha.is_some());
    let blue = Picture::from_exr(&render(&["--background", "0,0,7"]).unwrap()).unwrap();
    assert!(blue.pixels.contains(&Rgb::new(0.0, 0.0, 7.0)));
    for wrong in [
        &["--background", "blue"][..],
        &["--background", "-1,0,0"],
        &["--units", "lumen"],
        &["--units", "radiometric", "--sun-at", "48.1,11.6,2026-06-21T12:00:00Z"],
    ] {
        assert!(render(wrong).is_err(), "{wrong:?}");
    }
}
