//! What bounds connections, open files and uploads.

use hemilux_tests::load::raise_own_limit;
use hemilux_tests::server::{PATIENCE, Server, scene, try_send};
use std::io::{Read, Write};
use std::net::TcpStream;
use std::time::{Duration, Instant};

/// An open connection that has been answered, so that it is certainly accepted.
fn connection(server: &Server) -> Option<TcpStream> {
    let mut stream = TcpStream::connect(&server.address).ok()?;
    stream.set_read_timeout(Some(PATIENCE)).unwrap();
    stream.write_all(b"GET /livez HTTP/1.1\r\nhost: localhost\r\n\r\n").ok()?;
    let mut head = [0; 12];
    stream.read_exact(&mut head).ok()?;
    (&head == b"HTTP/1.1 200").then_some(stream)
}

#[test]
fn connections_too_many_are_closed_at_once_and_places_come_back() {
    let server = Server::start_with(&["--max-connections", "8", "--max-connections-each", "5"]);
    let mut open: Vec<_> = (0..5).map(|_| connection(&server).expect("a place")).collect();
    let begun = Instant::now();
    for _ in 0..20 {
        assert!(connection(&server).is_none(), "the address has more places than five");
    }
    assert!(begun.elapsed() < PATIENCE / 2, "refused connections wait");
    open.pop();
    let deadline = Instant::now() + PATIENCE;
    let again = loop {
        match connection(&server) {
            Some(stream) => break stream,
            None => assert!(Instant::now() < deadline, "the place does not come back"),
        }
    };
    drop((open, again));
    let deadline = Instant::now() + PATIENCE;
    while connection(&server).is_none() {
        assert!(Instant::now() < deadline, "places do not come back");
    }
    let deadline = Instant::now() + PATIENCE;
    let text = loop {
        if let Ok(answer) = try_send(&server.address, ("GET", "/metrics"), &[], b"") {
            break answer.text();
        }
        assert!(Instant::now() < deadline, "there is no place to ask for the metrics");
        std::thread::sleep(Duration::from_millis(10));
    };
    let name = "hemilux_refused_connections_total{limit=\"address\"} ";
    let refused = text.lines().find_map(|line| line.strip_prefix(name)).expect("it is counted");
    assert!(refused.parse::<u64>().unwrap() >= 20, "{refused}");
}

#[test]
fn the_server_raises_its_own_limit_on_files_and_hands_none_of_them_on() {
    raise_own_limit();
    let server = Server::start_with_soft_limit(64, &[]).until_ready();
    let open: Vec<_> = (0..150).map(|_| connection(&server).expect("a file")).collect();
    for child in server.children() {
        let files = std::fs::read_dir(format!("/proc/{child}/fd")).expect("it runs");
        let files = files.filter_map(|file| std::fs::read_link(file.ok()?.path()).ok());
        let sockets = files.filter(|file| file.to_string_lossy().starts_with("socket:")).count();
        assert_eq!(sockets, 0, "a child holds connections of the server");
    }
    drop(open);
}

#[test]
fn uploads_end_in_time_and_only_so_many_are_open() {
    let server = Server::start_with(&["--upload-seconds", "6", "--max-uploads", "1"]);
    let mut slow = TcpStream::connect(&server.address).unwrap();
    slow.set_read_timeout(Some(PATIENCE)).unwrap();
    let head = "POST /v1/scenes HTTP/1.1\r\nhost: localhost\r\ncontent-type: model/gltf-binary\r\ncontent-length: 1000000\r\nexpect: 100-continue\r\n\r\n";
    slow.write_all(head.as_bytes()).unwrap();
    // The server asks for the body once the upload has its turn.
    let mut go_on = [0; 25];
    slow.read_exact(&mut go_on).unwrap();
    assert_eq!(&go_on, b"HTTP/1.1 100 Continue\r\n\r\n");
    let furnace = scene("furnace.glb");
    let refused = server.post_scene(&furnace);
    // Bytes come again and again, so that it is never silent.
    let mut other = slow.try_clone().unwrap();
    let dripping = std::thread::spawn(move || {
        while other.write_all(b"x").is_ok() {
            std::thread::sleep(Duration::from_millis(100));
        }
    });
    assert!(!refused.header("retry-after").is_empty());
    assert_eq!(refused.problem(503)["limit"], "uploads");
    let mut answer = String::new();
    // The connection may be reset once it was answered.
    let _ = slow.read_to_string(&mut answer);
    assert!(answer.starts_with("HTTP/1.1 408"), "{answer}");
    assert!(answer.contains("within 6 seconds"), "{answer}");
    drop(slow);
    let _ = dripping.join();
    let deadline = Instant::now() + PATIENCE;
    while !matches!(server.post_scene(&furnace).status, 200 | 201) {
        assert!(Instant::now() < deadline, "the turn does not come back");
    }
}
