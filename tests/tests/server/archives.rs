//! Scenes in zip archives and folders.

use hemilux_engine::scene::made::assemble;
use hemilux_tests::malformed::triangle;
use hemilux_tests::server::{Server, program};
use serde_json::json;
use std::path::Path;
use std::process::Command;
use tempfile::TempDir;

/// The checksum of zip archives, bit by bit.
fn crc32(bytes: &[u8]) -> u32 {
    !bytes.iter().fold(!0, |crc, byte| {
        (0..8).fold(crc ^ u32::from(*byte), |crc, _| {
            crc >> 1 ^ (0xedb8_8320 & (crc & 1).wrapping_neg())
        })
    })
}

/// An archive of files as they are; what its directory says of their sizes may be `claimed`.
fn archive(files: &[(&str, &[u8])], claimed: Option<u32>) -> Vec<u8> {
    let (mut bytes, mut directory) = (Vec::new(), Vec::new());
    for (name, contents) in files {
        let (header, size) = (bytes.len() as u32, contents.len() as u32);
        // What is deflated may have another size than it says.
        let method = if claimed.is_some() { 8 } else { 0 };
        let mut common = vec![20, 0, 0, 8, method, 0, 0, 0, 0, 0];
        for number in [crc32(contents), size, claimed.unwrap_or(size), name.len() as u32] {
            common.extend(number.to_le_bytes());
        }
        bytes.extend(*b"PK\x03\x04");
        bytes.extend(&common);
        bytes.extend(name.bytes().chain(contents.iter().copied()));
        directory.extend(*b"PK\x01\x02\x14\0");
        directory.extend(common);
        directory.extend([0; 10]);
        directory.extend(header.to_le_bytes());
        directory.extend(name.bytes());
    }
    let (begin, size) = (bytes.len() as u32, directory.len() as u32);
    bytes.extend(directory);
    bytes.extend(*b"PK\x05\x06\0\0\0\0");
    bytes.extend([files.len() as u8, 0, files.len() as u8, 0]);
    bytes.extend(size.to_le_bytes());
    bytes.extend(begin.to_le_bytes());
    bytes.extend([0, 0]);
    bytes
}

/// A triangle as text with its bytes in a file whose name is in two scripts.
fn scene() -> (Vec<u8>, Vec<u8>) {
    let (mut root, binary) = triangle();
    root["buffers"][0]["uri"] = json!("daten/дом%20家.bin");
    (root.to_string().into_bytes(), binary)
}

const ZIP: [(&str, &str); 1] = [("content-type", "application/zip")];

#[test]
fn an_archive_is_the_scene_in_it() {
    let server = Server::start();
    let (main, binary) = scene();
    let files =
        [("haus/szene.gltf", &main[..]), ("haus/daten/дом 家.bin", &binary), ("readme.txt", b"")];
    let bytes = archive(&files, None);
    let answer = server.send("POST", "/v1/scenes?name=Haus", &ZIP, &bytes);
    assert_eq!(answer.status, 201, "{}", answer.text());
    let record = answer.json();
    assert_eq!((&record["format"], &record["triangles"]), (&json!("bundle"), &json!(1)));
    // The same files, one by one.
    let name = "content-disposition: form-data; name=";
    let mut form = format!("--x\r\n{name}\"scene\"\r\n\r\n").into_bytes();
    form.extend(&main);
    form.extend(format!("\r\n--x\r\n{name}\"daten/дом 家.bin\"\r\n\r\n").bytes());
    form.extend(&binary);
    form.extend(b"\r\n--x--\r\n");
    let kind = [("content-type", "multipart/form-data; boundary=x")];
    let again = server.send("POST", "/v1/scenes", &kind, &form);
    assert_eq!((again.status, &again.json()["id"]), (200, &record["id"]), "{}", again.text());

    // A .glb alone is the .glb, whatever the archive is said to be.
    let (root, binary) = triangle();
    let glb = assemble(&root, &binary);
    let bytes = archive(&[("a/b/c.glb", &glb)], None);
    let octets = [("content-type", "application/octet-stream")];
    let packed = server.send("POST", "/v1/scenes", &octets, &bytes);
    assert_eq!(packed.status, 201, "{}", packed.text());
    let plain = server.post_scene(&glb);
    assert_eq!((plain.status, &plain.json()["id"]), (200, &packed.json()["id"]));

    // A job brings its scene along as an archive.
    let job = json!({"width": 8, "height": 8, "max_iterations": 2, "options": {"patches": 100}});
    let mut form =
        format!("--x\r\n{name}\"job\"\r\n\r\n{job}\r\n--x\r\n{name}\"c.zip\"\r\n\r\n").into_bytes();
    form.extend(&bytes);
    let part = form.clone();
    form.extend(b"\r\n--x--\r\n");
    let answer = server.send("POST", "/v1/jobs", &kind, &form);
    assert_eq!(answer.status, 202, "{}", answer.text());
    let job = server.wait(answer.json()["id"].as_str().unwrap());
    assert_eq!((&job["state"], &job["scene"]), (&json!("succeeded"), &packed.json()["id"]));
    // Its files are all that there is.
    let mut form = part;
    form.extend(format!("\r\n--x\r\n{name}\"more.bin\"\r\n\r\n1\r\n--x--\r\n").bytes());
    let problem = server.send("POST", "/v1/jobs", &kind, &form).problem(422);
    assert!(problem["detail"].as_str().unwrap().contains("more.bin"), "{problem}");
}

#[test]
fn hostile_archives_are_refused_with_a_reason() {
    let mut server = Server::start_with(&["--max-upload-mb", "1"]);
    let (main, binary) = scene();
    let whole = archive(&[("s.gltf", &main), ("daten/дом 家.bin", &binary)], None);
    for (bytes, status, what) in [
        (archive(&[("s.gltf", &main), ("../x", b"")], None), 422, "leaves the folder"),
        (archive(&[("s.gltf", &main), ("/x", b"")], None), 422, "absolute"),
        (archive(&[("s.gltf", &main), ("t.glb", b"")], None), 422, "s.gltf, t.glb"),
        (archive(&[("s.gltf", &main)], None), 422, "not among the files"),
        (archive(&[("s.gltf", b"\x03\0")], Some(600_000)), 422, "fewer bytes"),
        (archive(&[("s.gltf", b"\x03\0"), ("b", b"\x03\0")], Some(600_000)), 413, "once unpacked"),
        (whole[..whole.len() - 1].to_vec(), 422, "no directory"),
    ] {
        let problem = server.send("POST", "/v1/scenes", &ZIP, &bytes).problem(status);
        assert!(problem["detail"].as_str().unwrap().contains(what), "{what}: {problem}");
    }
    assert!(server.is_alive());
    assert_eq!(server.send("POST", "/v1/scenes", &ZIP, &whole).status, 201);
}

#[test]
fn the_command_line_takes_archives_and_folders() {
    let folder = TempDir::new().unwrap();
    let inside = folder.path().join("haus/daten");
    std::fs::create_dir_all(&inside).unwrap();
    let (main, binary) = scene();
    let file = folder.path().join("haus/szene.gltf");
    std::fs::write(&file, &main).unwrap();
    std::fs::write(inside.join("дом 家.bin"), &binary).unwrap();
    let packed = folder.path().join("haus.zip");
    let files = [("x/szene.gltf", &main[..]), ("x/daten/дом 家.bin", &binary)];
    std::fs::write(&packed, archive(&files, None)).unwrap();
    let render = |scene: &Path| {
        let picture = folder.path().join("out.png");
        let mut command = Command::new(program());
        command.args(["render", "--size", "16x16", "--iterations", "2", "--device", "cpu", "-q"]);
        let output = command.arg(scene).arg("-o").arg(&picture).output().unwrap();
        let words = String::from_utf8_lossy(&output.stderr).into_owned();
        output.status.success().then(|| std::fs::read(&picture).unwrap()).ok_or(words)
    };
    let expected = render(&file).unwrap();
    assert_eq!(render(&packed).as_ref(), Ok(&expected));
    assert_eq!(render(&folder.path().join("haus")).as_ref(), Ok(&expected));
    // The folder above has one scene as well, but an empty one has none.
    assert_eq!(render(folder.path()).as_ref(), Ok(&expected));
    // A binary file may name files beside it, too.
    let binary_file = folder.path().join("haus/szene.glb");
    let root = serde_json::from_slice(&main).unwrap();
    std::fs::write(&binary_file, assemble(&root, &[])).unwrap();
    assert_eq!(render(&binary_file).as_ref(), Ok(&expected));
    let empty = TempDir::new().unwrap();
    let words = render(empty.path()).unwrap_err();
    assert!(words.contains("no .gltf and no .glb"), "{words}");
}
