//! Disks that are full, folders that cannot be written, files that are damaged: a clear error, and
//! everything back as it was once it is mended.

use hemilux_tests::server::{PATIENCE, Server, scene, serve_and_fail, serve_command};
use hemilux_tests::small_disk::SmallDisk;
use serde_json::{Value, json};
use std::fs;
use std::os::unix::fs::{PermissionsExt, symlink};
use std::os::unix::process::CommandExt;
use std::path::Path;
use std::process::Command;
use std::time::{Duration, Instant};
use tempfile::TempDir;

fn job(seed: u64) -> Value {
    json!({
        "scene": "cornell", "method": "stochastic", "width": 16, "height": 16,
        "max_iterations": 20, "seed": seed, "options": {"patches": 300, "hemicube_resolution": 32}
    })
}

/// A data folder on which a job has been done, and its record.
fn used(folder: &Path) -> Value {
    let server = Server::start_in(folder, &[]);
    let record = server.wait(&server.submit(&job(1)));
    assert_eq!(record["state"], "succeeded");
    // In order, so that the whole database is in its file.
    server.terminate();
    record
}

fn refuses_to_start(folder: &Path, told: &[&str]) {
    let output = serve_and_fail(folder, &[]);
    let message = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_eq!(output.status.code(), Some(1), "{message}");
    let told = told.iter().chain([&"hemilux.sqlite"]).all(|part| message.contains(part));
    assert!(told && !message.contains("panicked"), "{message}");
}

/// Whether the job of [`used`] is there with its pictures, and another one can be done.
fn is_whole(server: &Server, record: &Value) {
    let there = server.get(&format!("/v1/jobs/{}", record["id"].as_str().unwrap())).json();
    assert_eq!(there["result"], record["result"], "{there}");
    for picture in record["result"].as_array().unwrap() {
        assert_eq!(server.get(picture["url"].as_str().unwrap()).status, 200);
    }
    let mut another = job(2);
    another["fresh"] = json!(true);
    assert_eq!(server.wait(&server.submit(&another))["state"], "succeeded");
}

/// A server whose data folder is a small disk of its own. Where the system allows none, `None`.
fn on_a_small_disk(folder: &Path, mib: u32, min_free_mb: &str) -> Option<(Server, SmallDisk)> {
    let disk = SmallDisk::mount(folder, mib)?;
    let serve = serve_command(folder, &["--min-free-mb", min_free_mb]);
    Some((Server::spawn(&mut disk.enter(&serve)), disk))
}

/// Ends a trouble of a server.
type Mend = Box<dyn Fn(&Server)>;

#[test]
fn a_full_disk_is_told_and_nothing_is_lost() {
    let folder = TempDir::new().unwrap();
    let (server, mend): (Server, Mend) = match on_a_small_disk(folder.path(), 3, "0") {
        Some((server, disk)) => {
            let record = server.wait(&server.submit(&job(1)));
            assert_eq!(record["state"], "succeeded");
            disk.fill_but(0);
            (server, Box::new(move |_| disk.free()))
        }
        None => {
            // No file may be written past 1 KiB, and the signal about it is ignored: writes fail.
            println!("no mount namespaces here: a limit on file sizes stands for the full disk");
            let serve = serve_command(folder.path(), &[]);
            let limit = "trap '' XFSZ; exec \"$0\" \"$@\"";
            let mut command = Command::new("sh");
            command.args(["-c", limit]).arg(serve.get_program()).args(serve.get_args());
            let server = Server::spawn(&mut command);
            assert_eq!(server.wait(&server.submit(&job(1)))["state"], "succeeded");
            let set = |server: &Server, limit: &str| {
                let pid = server.pid().to_string();
                let set = Command::new("prlimit").args(["--pid", &pid, limit]).status();
                assert!(set.unwrap().success());
            };
            set(&server, "--fsize=1024:unlimited");
            (server, Box::new(move |server| set(server, "--fsize=unlimited:unlimited")))
        }
    };
    // What fits into what the database has already is taken; then it says no.
    let mut taken = Vec::new();
    let refused = loop {
        let answer = server.post("/v1/jobs", &job(100 + taken.len() as u64));
        if answer.status != 202 {
            break answer;
        }
        taken.push(answer.json()["id"].as_str().unwrap().to_owned());
        assert!(taken.len() < 2000, "the disk is not full");
    };
    let problem = refused.problem(503);
    assert_ne!(refused.header("retry-after"), "");
    let detail = problem["detail"].as_str().unwrap();
    assert!(detail.contains("disk"), "{detail}");
    let upload = server.post_scene(&[vec![b' '; 200 << 10], scene("cornell.glb")].concat());
    assert!(upload.problem(503)["detail"].as_str().unwrap().contains("disk"));
    assert_eq!(server.get("/v1/jobs").status, 200, "what is there can be read");

    mend(&server);
    for id in &taken {
        let record = server.wait(id);
        assert_eq!(record["state"], "succeeded", "{record}");
        assert_eq!(server.get(record["result"][1]["url"].as_str().unwrap()).status, 200);
    }
    assert_eq!(server.wait(&server.submit(&job(3)))["state"], "succeeded");
    let jobs = server.get("/v1/jobs?limit=200").json()["jobs"].as_array().unwrap().len();
    assert_eq!(jobs, (taken.len() + 2).min(200));
}

/// For root nothing is read-only; a server that may not write everywhere is another user's.
fn unprivileged(command: &mut Command, program: &Path) -> Command {
    let is_root = fs::metadata("/proc/self").is_ok_and(|own| {
        use std::os::unix::fs::MetadataExt;
        own.uid() == 0
    });
    let mut unprivileged = Command::new(program);
    unprivileged.args(command.get_args());
    if is_root {
        unprivileged.uid(65_534).gid(65_534);
    }
    unprivileged
}

#[test]
fn a_folder_that_cannot_be_written_is_named_and_works_once_it_can() {
    let root = TempDir::new().unwrap();
    let set = |path: &Path, mode| fs::set_permissions(path, fs::Permissions::from_mode(mode));
    set(root.path(), 0o777).unwrap();
    // A copy that any user can reach.
    let program = root.path().join("hemilux");
    fs::copy(hemilux_tests::server::program(), &program).unwrap();
    let data = root.path().join("data");
    fs::create_dir(&data).unwrap();

    set(&data, 0o555).unwrap();
    let output = unprivileged(&mut serve_command(&data, &[]), &program).output().unwrap();
    let message = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_eq!(output.status.code(), Some(1), "{message}");
    assert!(message.contains("data folder") && message.contains("Permission"), "{message}");

    set(&data, 0o777).unwrap();
    let server = Server::spawn(&mut unprivileged(&mut serve_command(&data, &[]), &program));
    let first = server.wait(&server.submit(&job(1)));
    assert_eq!(first["state"], "succeeded");
    // While it runs, the folder of pictures stops taking files: the job waits for it.
    let (pictures, away) = (data.join("artifacts/jobs"), data.join("artifacts/away"));
    fs::rename(&pictures, &away).unwrap();
    symlink("jobs", &pictures).unwrap();
    let id = server.submit(&job(2));
    server.wait_until(&id, |job| job["iterations"].as_u64() > Some(0));
    std::thread::sleep(Duration::from_millis(300));
    assert_eq!(server.get(&format!("/v1/jobs/{id}")).json()["state"], "running");
    fs::remove_file(&pictures).unwrap();
    fs::rename(&away, &pictures).unwrap();
    let record = server.wait(&id);
    assert_eq!((&record["state"], &record["attempts"]), (&json!("succeeded"), &json!(1)));
    is_whole(&server, &first);
}

#[test]
fn a_damaged_database_is_named_and_a_restored_one_is_whole() {
    let folder = TempDir::new().unwrap();
    let record = used(folder.path());
    let file = folder.path().join("hemilux.sqlite");
    let sound = fs::read(&file).unwrap();

    let mut headless = sound.clone();
    headless[..100].fill(0x5a);
    fs::write(&file, headless).unwrap();
    refuses_to_start(folder.path(), &["not a database", "restore the file from a backup"]);

    // The tables are there, what is in them is not.
    let mut holed = sound.clone();
    holed[3 * 4096..].fill(0x5a);
    fs::write(&file, holed).unwrap();
    refuses_to_start(folder.path(), &["damaged", "restore the file from a backup"]);

    fs::write(&file, sound).unwrap();
    is_whole(&Server::start_in(folder.path(), &[]), &record);
}

#[test]
fn a_damaged_or_missing_picture_is_named_and_a_restored_one_is_served() {
    let folder = TempDir::new().unwrap();
    let record = used(folder.path());
    let server = Server::start_in(folder.path(), &[]);
    let (id, hash) = (record["id"].as_str().unwrap(), record["result"][1]["sha256"].as_str());
    let name = format!("jobs/{id}/{}.exr", hash.unwrap());
    let file = folder.path().join("artifacts").join(&name);
    let sound = fs::read(&file).unwrap();
    let path = format!("/v1/jobs/{id}/image.exr");

    fs::write(&file, &sound[..sound.len() / 2]).unwrap();
    let problem = server.get(&path).problem(500);
    let detail = problem["detail"].as_str().unwrap();
    assert!(detail.contains(&name) && detail.contains("backup"), "{detail}");
    assert_eq!(server.get(&format!("/v1/jobs/{id}/image.png")).status, 200);
    fs::remove_file(&file).unwrap();
    let problem = server.get(&path).problem(404);
    assert!(problem["detail"].as_str().unwrap().contains("not there any more"), "{problem}");

    fs::write(&file, sound).unwrap();
    is_whole(&server, &record);

    // The baked light is a file like the others.
    let path = format!("/v1/jobs/{id}/solution.glb");
    let whole = server.get(&path);
    assert_eq!(whole.status, 200);
    let folder = folder.path().join("artifacts/jobs").join(id);
    let names = fs::read_dir(&folder).unwrap().map(|entry| entry.unwrap().path());
    let file = names.into_iter().find(|path| path.extension().is_some_and(|e| e == "glb")).unwrap();
    let mut damaged = whole.body.clone();
    damaged[40] ^= 1;
    damaged.push(0);
    fs::write(&file, &damaged).unwrap();
    let problem = server.get(&path).problem(500);
    let detail = problem["detail"].as_str().unwrap();
    assert!(detail.contains(".glb") && detail.contains("backup"), "{detail}");
    fs::write(&file, &whole.body).unwrap();
    assert_eq!(server.get(&path).body, whole.body);
}

#[test]
fn a_truncated_scene_fails_its_job_clearly_and_is_mended_by_sending_it_again() {
    let folder = TempDir::new().unwrap();
    let server = Server::start_in(folder.path(), &[]);
    let glb = scene("cornell.glb");
    let id = server.post_scene(&glb).json()["id"].as_str().unwrap().to_owned();
    let wish = || {
        let mut wish = job(1);
        wish["scene"] = json!(id);
        wish
    };
    let file = folder.path().join("artifacts/scenes").join(&id);
    for damage in [Some(&glb[..glb.len() / 2]), None] {
        match damage {
            Some(part) => fs::write(&file, part).unwrap(),
            None => fs::remove_file(&file).unwrap(),
        }
        let record = server.wait(&server.submit(&wish()));
        assert_eq!((&record["state"], &record["attempts"]), (&json!("failed"), &json!(1)));
        assert_eq!(record["error"]["code"], "scene", "{record}");
        let detail = record["error"]["detail"].as_str().unwrap();
        assert!(detail.contains(&id) && detail.contains("send the scene again"), "{detail}");
        assert_eq!(server.post_scene(&glb).status, 200);
        assert_eq!(fs::read(&file).unwrap(), glb);
    }
    let record = server.wait(&server.submit(&wish()));
    assert_eq!(record["state"], "succeeded", "{record}");
}

#[test]
fn a_storage_that_does_not_answer_makes_jobs_wait() {
    let folder = TempDir::new().unwrap();
    let server = Server::start_in(folder.path(), &[]);
    let (scenes, away) =
        (folder.path().join("artifacts/scenes"), folder.path().join("artifacts/away"));
    assert_eq!(server.wait(&server.submit(&job(1)))["state"], "succeeded");
    let glb = scene("cornell.glb");
    let id = server.post_scene(&glb).json()["id"].as_str().unwrap().to_owned();
    fs::rename(&scenes, &away).unwrap();
    symlink("scenes", &scenes).unwrap();
    let mut wish = job(5);
    wish["scene"] = json!(id);
    let job = server.submit(&wish);
    let path = format!("/v1/jobs/{job}/events");
    let waited = server
        .events(&path, &[])
        .find(|event| event.data["state"] == "queued" && event.data["reason"].is_string());
    assert!(waited.is_some(), "it was not put back");
    fs::remove_file(&scenes).unwrap();
    fs::rename(&away, &scenes).unwrap();
    let record = server.wait(&job);
    assert_eq!((&record["state"], &record["attempts"]), (&json!("succeeded"), &json!(1)));
}

/// While less is free than the server keeps free, jobs that wait go on waiting, and the one that
/// runs ends.
#[test]
fn no_job_is_begun_while_the_disk_is_short() {
    let folder = TempDir::new().unwrap();
    let rules = folder.path().join("failpoints");
    fs::write(&rules, "").unwrap();
    let data = folder.path().join("data");
    fs::create_dir(&data).unwrap();
    let (server, disk) = match on_a_small_disk(&data, 12, "4") {
        Some((server, disk)) => (server, Some(disk)),
        None => {
            println!("no mount namespaces here: a failpoint stands for the short disk");
            let variable = format!("@{}", rules.display());
            let environment = [("HEMILUX_FAILPOINTS", variable.as_str())];
            (Server::start_with_environment(&data, &[], &environment), None)
        }
    };
    let running = server.submit(&json!({
        "scene": "cornell", "width": 16, "height": 16, "time_budget_s": 600, "method": "stochastic",
        "options": {"patches": 300, "hemicube_resolution": 32}
    }));
    server.wait_until(&running, |job| job["iterations"].as_u64() > Some(0));
    let waiting = [1, 2, 3].map(|seed| server.submit(&job(seed)));
    match &disk {
        Some(disk) => disk.fill_but(2 << 20),
        None => fs::write(&rules, "disk=error").unwrap(),
    }
    // The server looks once a second.
    let deadline = Instant::now() + PATIENCE;
    while server.post("/v1/jobs", &job(4)).status != 503 {
        assert!(Instant::now() < deadline, "the server takes jobs though the disk is short");
        std::thread::sleep(Duration::from_millis(50));
    }
    assert_eq!(server.send("POST", &format!("/v1/jobs/{running}/cancel"), &[], b"").status, 200);
    assert_eq!(server.wait(&running)["state"], "cancelled");
    let idle = |server: &Server| server.get("/v1/devices").text().contains("\"idle\"");
    for _ in 0..30 {
        std::thread::sleep(Duration::from_millis(50));
        for id in &waiting {
            let record = server.get(&format!("/v1/jobs/{id}")).json();
            assert_eq!((&record["state"], &record["attempts"]), (&json!("queued"), &json!(0)));
        }
        assert!(idle(&server), "the device waits");
    }
    match &disk {
        Some(disk) => disk.free(),
        None => fs::write(&rules, "").unwrap(),
    }
    for id in &waiting {
        let record = server.wait(id);
        assert_eq!((&record["state"], &record["attempts"]), (&json!("succeeded"), &json!(1)));
    }
}

/// Pictures find no room for longer than all the tries together, again and again: their jobs are
/// put back, uncounted, and go on from what they knew.
#[test]
fn jobs_whose_pictures_find_no_room_are_never_given_up() {
    let folder = TempDir::new().unwrap();
    let rules = folder.path().join("failpoints");
    let data = folder.path().join("data");
    let quick = "record-pause=last:2;retry-pause=last:2";
    // Which of the files of a job are pictures shows by their ends.
    fs::write(&rules, format!("artifact(.png)=error;artifact(.exr)=error;{quick}")).unwrap();
    let variable = format!("@{}", rules.display());
    let environment = [("HEMILUX_FAILPOINTS", variable.as_str())];
    let server = Server::start_with_environment(&data, &[], &environment);
    let ids = [1, 2].map(|seed| server.submit(&job(seed)));
    let put_back = |id: &String| {
        let path = format!("/v1/jobs/{id}/events");
        let events = server.events(&path, &[]).filter(|event| {
            let reason = event.data["reason"].as_str().unwrap_or_default();
            reason.contains("could not be kept")
        });
        // More often than a job may fail.
        events.take(6).count()
    };
    for id in &ids {
        assert_eq!(put_back(id), 6);
        let record = server.get(&format!("/v1/jobs/{id}")).json();
        assert!(record["attempts"].as_u64() <= Some(1), "{record}");
    }
    fs::write(&rules, quick).unwrap();
    for id in &ids {
        let record = server.wait(id);
        assert_eq!((&record["state"], &record["attempts"]), (&json!("succeeded"), &json!(1)));
        let reasons = record["plan"]["reasons"].to_string();
        assert!(reasons.contains("goes on after 20"), "the work was kept: {reasons}");
    }
}
