//! Messages about the end of jobs: once they are due they arrive, signed, and again if need be.

use hemilux_tests::keys::{With, keys};
use hemilux_tests::server::{PATIENCE, Server};
use serde_json::{Value, json};
use std::io::{BufRead, BufReader, Read, Write};
use std::net::TcpListener;
use std::sync::mpsc::{Receiver, RecvTimeoutError, channel};
use std::time::{Duration, Instant};
use tempfile::TempDir;

const SECRET: &str = "0123456789abcdef";

/// A message as it arrived.
#[derive(Clone, Debug)]
struct Message {
    path: String,
    headers: Vec<(String, String)>,
    body: String,
}

impl Message {
    fn header(&self, name: &str) -> &str {
        self.headers.iter().find(|(n, _)| n == name).map_or("", |(_, value)| value)
    }

    fn json(&self) -> Value {
        serde_json::from_str(&self.body).unwrap()
    }
}

/// A receiver that gives these answers, the last one for ever, and passes on what it gets.
fn receiver(answers: &'static [&'static str]) -> (String, Receiver<Message>) {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let url = format!("http://{}", listener.local_addr().unwrap());
    let (pass_on, messages) = channel();
    std::thread::spawn(move || {
        for (number, stream) in listener.incoming().enumerate() {
            let mut stream = BufReader::new(stream.unwrap());
            let mut line = String::new();
            stream.read_line(&mut line).unwrap();
            let path = line.split(' ').nth(1).unwrap_or("").to_owned();
            let mut headers = Vec::new();
            loop {
                let mut line = String::new();
                stream.read_line(&mut line).unwrap();
                let Some((name, value)) = line.trim_end().split_once(": ") else { break };
                headers.push((name.to_ascii_lowercase(), value.to_owned()));
            }
            let length = headers.iter().find(|(name, _)| name == "content-length");
            let length: usize = length.map_or(0, |(_, value)| value.parse().unwrap());
            let mut body = vec![0; length];
            stream.read_exact(&mut body).unwrap();
            let answer = answers[number.min(answers.len() - 1)];
            let head = format!("HTTP/1.1 {answer}\r\ncontent-length: 0\r\n\r\n");
            stream.get_mut().write_all(head.as_bytes()).unwrap();
            let body = String::from_utf8(body).unwrap();
            if pass_on.send(Message { path, headers, body }).is_err() {
                return;
            }
        }
    });
    (url, messages)
}

fn wish(webhook: &Value) -> Value {
    json!({"scene": "cornell", "width": 16, "height": 16, "max_iterations": 2,
           "options": {"patches": 200}, "method": "stochastic", "webhook": webhook})
}

const ALLOW: [&str; 2] = ["--webhook-allow", "127.0.0.0/8"];

fn delivery(server: &Server, job: &str, wished: impl Fn(&Value) -> bool) -> Value {
    let deadline = Instant::now() + PATIENCE;
    loop {
        let list = server.get(&format!("/v1/jobs/{job}/webhooks")).json();
        let found = list["deliveries"].as_array().unwrap().iter().find(|one| wished(one)).cloned();
        if let Some(found) = found {
            return found;
        }
        assert!(Instant::now() < deadline, "it never got there: {list}");
        std::thread::sleep(Duration::from_millis(50));
    }
}

#[test]
fn the_end_of_a_job_is_told_signed_and_told_again_where_that_failed() {
    let (url, messages) = receiver(&["500 No", "204 Thanks"]);
    let server = Server::start_with(&ALLOW);
    let job = server.submit(&wish(&json!({"url": format!("{url}/a?b=c"), "secret": SECRET})));
    let shown = server.wait(&job);
    assert_eq!(shown["request"]["webhook"]["url"], format!("{url}/a?b=c"));
    assert!(!shown.to_string().contains(SECRET), "{shown}");

    let first = messages.recv_timeout(PATIENCE).unwrap();
    assert_eq!(first.path, "/a?b=c");
    assert_eq!(first.header("content-type"), "application/json");
    let body = first.json();
    assert_eq!((&body["event"], &body["job"]), (&json!("succeeded"), &json!(job)));
    assert_eq!(body["url"], format!("/v1/jobs/{job}"));
    assert_eq!(body["id"], first.header("hemilux-webhook-id"));
    verify(&first);
    let pending = delivery(&server, &job, |one| one["attempts"] == 1);
    assert_eq!(pending["state"], "pending");
    assert!(pending["last_answer"].as_str().unwrap().starts_with("500"), "{pending}");

    // The same message again, after the first pause.
    let second = messages.recv_timeout(PATIENCE).unwrap();
    assert_eq!(second.body, first.body);
    verify(&second);
    let delivered = delivery(&server, &job, |one| one["state"] == "delivered");
    assert_eq!((&delivered["attempts"], &delivered["next_attempt_at"]), (&json!(2), &Value::Null));
    assert_eq!(
        messages.recv_timeout(Duration::from_secs(1)).unwrap_err(),
        RecvTimeoutError::Timeout
    );
    let metrics = server.get("/metrics").text();
    for line in ["webhooks_total{outcome=\"delivered\"} 1", "webhooks_total{outcome=\"failed\"} 1"]
    {
        assert!(metrics.contains(&format!("hemilux_{line}")), "{metrics}");
    }
}

/// Checks a signature as docs/operations.md says a receiver should: with another program.
fn verify(message: &Message) {
    let header = message.header("hemilux-webhook-signature");
    let (time, sum) = header.split_once(',').unwrap();
    let (time, sum) = (time.strip_prefix("t=").unwrap(), sum.strip_prefix("v1=").unwrap());
    let age = now_s() - time.parse::<i64>().unwrap();
    assert!((0..60).contains(&age), "{age}");
    let expected =
        hemilux::webhooks::send::signature(SECRET, time.parse().unwrap(), message.body.as_bytes());
    assert_eq!(expected, format!("t={time},v1={sum}"));
}

fn now_s() -> i64 {
    let now = std::time::SystemTime::now().duration_since(std::time::UNIX_EPOCH).unwrap();
    i64::try_from(now.as_secs()).unwrap()
}

#[test]
fn every_way_to_end_is_told_and_only_what_was_asked_for() {
    let (url, messages) = receiver(&["200 OK"]);
    let server = Server::start_with(&ALLOW);
    let mut endless = wish(&json!({"url": url}));
    endless["max_iterations"] = Value::Null;
    endless["time_budget_s"] = json!(600);
    let ends = |job: &str| {
        let message = messages.recv_timeout(PATIENCE).unwrap().json();
        assert_eq!(message["job"], job);
        message["event"].clone()
    };
    let running = server.submit(&endless);
    server.wait_until(&running, |job| job["state"] == "running");
    let waiting = server.submit(&endless);
    server.send("POST", &format!("/v1/jobs/{waiting}/cancel"), &[], b"");
    assert_eq!(ends(&waiting), "cancelled", "a queued job");
    server.send("POST", &format!("/v1/jobs/{running}/cancel"), &[], b"");
    assert_eq!(ends(&running), "cancelled", "a running job");
    let deleted = server.submit(&endless);
    server.send("DELETE", &format!("/v1/jobs/{deleted}"), &[], b"");
    assert_eq!(ends(&deleted), "cancelled", "a deleted job");
    // A job that asks for other endings is silent.
    let silent = server.submit(&wish(&json!({"url": url, "events": ["failed"]})));
    server.wait(&silent);
    assert!(messages.recv_timeout(Duration::from_millis(1500)).is_err());
    let list = server.get(&format!("/v1/jobs/{silent}/webhooks")).json();
    assert_eq!(list, json!({"deliveries": []}));
}

#[test]
fn messages_outlive_the_server() {
    let folder = TempDir::new().unwrap();
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let url = format!("http://{}", listener.local_addr().unwrap());
    let server = Server::start_in(folder.path(), &ALLOW);
    let job = server.submit(&wish(&json!({"url": url, "secret": SECRET})));
    server.wait(&job);
    // Nobody answers; the server dies with the message under way.
    let (stuck, _) = listener.accept().unwrap();
    server.kill();
    drop(stuck);
    let server = Server::start_in(folder.path(), &ALLOW);
    let waits = delivery(&server, &job, |one| one["state"] == "pending");
    assert_eq!(waits["attempts"], 0, "what was not noted does not count: {waits}");
    assert_eq!(waits["event"], "succeeded");
}

#[test]
fn doors_inside_are_not_knocked_at() {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    listener.set_nonblocking(true).unwrap();
    let port = listener.local_addr().unwrap().port();
    let server = Server::start();
    // An address is refused at once; a name only when it is looked up.
    for host in ["127.0.0.1", "[::ffff:127.0.0.1]"] {
        let webhook = json!({"url": format!("http://{host}:{port}/")});
        let problem = server.post("/v1/jobs", &wish(&webhook)).problem(422);
        assert_eq!(problem["errors"][0]["field"], "webhook.url", "{problem}");
    }
    let job = server.submit(&wish(&json!({"url": format!("http://localhost:{port}/")})));
    server.wait(&job);
    let refused = delivery(&server, &job, |one| one["attempts"] == 1);
    let why = refused["last_answer"].as_str().unwrap();
    assert!(why.contains("not public"), "{why}");
    assert!(listener.accept().is_err(), "somebody knocked");
    for (webhook, field) in [
        (json!({"url": "ftp://example.org/"}), "webhook.url"),
        (json!({"url": "http://user:pass@example.org/"}), "webhook.url"),
        (json!({"url": "https://example.org/", "events": []}), "webhook.events"),
        (json!({"url": "https://example.org/", "secret": "short"}), "webhook.secret"),
        (json!({"url": "https://example.org/", "events": ["started"]}), "webhook.events[0]"),
        (json!({"secret": SECRET}), "webhook.url"),
    ] {
        let problem = server.post("/v1/jobs", &wish(&webhook)).problem(422);
        assert_eq!(problem["errors"][0]["field"], field, "{problem}");
    }
}

/// What a name means may change: here the operator allows it.
#[test]
fn a_private_answer_once_is_not_for_ever() {
    let (url, messages) = receiver(&["200 OK"]);
    let url = url.replace("127.0.0.1", "localhost");
    let folder = TempDir::new().unwrap();
    let server = Server::start_in(folder.path(), &[]);
    let job = server.submit(&wish(&json!({"url": url})));
    server.wait(&job);
    let pending = delivery(&server, &job, |one| one["attempts"] == 1);
    assert_eq!(pending["state"], "pending", "{pending}");
    assert!(messages.try_recv().is_err(), "somebody knocked");
    server.terminate();
    let server = Server::start_in(folder.path(), &["--webhook-allow", "127.0.0.0/8,::1"]);
    assert_eq!(messages.recv_timeout(PATIENCE).unwrap().json()["job"], job);
    delivery(&server, &job, |one| one["state"] == "delivered");
}

/// A receiver that takes connections and never says a word; how many it has taken.
fn black_hole() -> (String, std::sync::Arc<std::sync::Mutex<Vec<std::net::TcpStream>>>) {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let url = format!("http://{}", listener.local_addr().unwrap());
    let held = std::sync::Arc::default();
    let taken: std::sync::Arc<std::sync::Mutex<Vec<_>>> = std::sync::Arc::clone(&held);
    std::thread::spawn(move || {
        listener.incoming().for_each(|stream| taken.lock().unwrap().extend(stream));
    });
    (url, held)
}

/// A job that ends before it begins, with a message about it.
fn cancelled(who: &With<'_>, webhook: &Value) -> String {
    let mut endless = wish(webhook);
    endless["max_iterations"] = Value::Null;
    endless["time_budget_s"] = json!(600);
    let job = who.submit(&endless);
    assert_eq!(who.send("POST", &format!("/v1/jobs/{job}/cancel"), &[], b"").status, 200);
    job
}

#[test]
fn a_receiver_that_never_answers_delays_no_other() {
    let folder = TempDir::new().unwrap();
    let [ann, bob] = ["ann", "bob"].map(|name| keys(folder.path(), &["add", name]));
    let arguments = ["--max-webhooks-pending-each", "30", ALLOW[0], ALLOW[1]];
    let server = Server::start_in(folder.path(), &arguments);
    let (ann, bob) = (With(&server, &ann), With(&server, &bob));
    let (hole, held) = black_hole();
    let stuck: Vec<String> = (0..50).map(|_| cancelled(&ann, &json!({"url": hole}))).collect();
    let deadline = Instant::now() + PATIENCE;
    while held.lock().unwrap().is_empty() {
        assert!(Instant::now() < deadline, "nothing was sent to the silent receiver");
        std::thread::sleep(Duration::from_millis(20));
    }
    // Less than one message to the silent receiver takes: another caller's, and another receiver
    // of the same caller.
    let (good, messages) = receiver(&["200 OK"]);
    for who in [&bob, &ann] {
        let begun = Instant::now();
        let job = cancelled(who, &json!({"url": good}));
        let message = messages.recv_timeout(Duration::from_secs(9)).expect("it is not held up");
        assert_eq!(message.json()["job"], job);
        assert!(begun.elapsed() < Duration::from_secs(9), "{:?}", begun.elapsed());
    }
    assert!(held.lock().unwrap().len() <= 8, "only a few wait for the same receiver");
    // Over the bound the oldest are given up, and say so.
    let given_up = || {
        stuck.iter().find_map(|job| {
            let path = format!("/v1/jobs/{job}/webhooks");
            let list = ann.get(&path).json();
            let told = list["deliveries"].get(0).filter(|told| told["state"] == "given_up");
            told.map(|told| told["last_answer"].as_str().unwrap().to_owned())
        })
    };
    let deadline = Instant::now() + PATIENCE;
    let why = loop {
        if let Some(why) = given_up() {
            break why;
        }
        assert!(Instant::now() < deadline, "nothing was given up");
        std::thread::sleep(Duration::from_millis(50));
    };
    assert!(why.contains("--max-webhooks-pending-each"), "{why}");
    let metrics = server.get("/metrics").text();
    assert!(metrics.contains("hemilux_webhooks_total{outcome=\"over_limit\"}"), "{metrics}");
}

#[test]
fn a_redirect_is_no_delivery_and_is_not_followed() {
    let (inside, knocks) = receiver(&["200 OK"]);
    let answer: &'static str = format!("302 Found\r\nlocation: {inside}").leak();
    let answers: &'static [&'static str] = vec![answer, "410 Gone"].leak();
    let (url, messages) = receiver(answers);
    let server = Server::start_with(&ALLOW);
    let job = server.submit(&wish(&json!({"url": url})));
    messages.recv_timeout(PATIENCE).unwrap();
    let pending = delivery(&server, &job, |one| one["attempts"] == 1);
    assert_eq!(pending["state"], "pending");
    // The receiver may say that it is gone for good.
    messages.recv_timeout(PATIENCE).unwrap();
    delivery(&server, &job, |one| one["state"] == "given_up" && one["attempts"] == 2);
    assert!(knocks.try_recv().is_err(), "the redirect was followed");
}

#[test]
fn a_key_may_have_a_webhook_for_all_its_jobs() {
    let (url, messages) = receiver(&["200 OK"]);
    let (other_url, other_messages) = receiver(&["200 OK"]);
    let folder = TempDir::new().unwrap();
    let secret = folder.path().join("secret");
    std::fs::write(&secret, format!("{SECRET}\n")).unwrap();
    let data = folder.path().join("data");
    let secret = secret.to_str().unwrap();
    let key = keys(&data, &["add", "told", "--webhook", &url, "--webhook-secret-file", secret]);
    let server = Server::start_in(&data, &ALLOW);
    let who = With(&server, &key);
    let mut plain = wish(&Value::Null);
    plain.as_object_mut().unwrap().remove("webhook");
    let job = who.submit(&plain);
    let message = messages.recv_timeout(PATIENCE).unwrap();
    assert_eq!(message.json()["job"], job);
    verify(&message);
    // A job's own webhook goes first.
    let job = who.submit(&wish(&json!({"url": other_url})));
    assert_eq!(other_messages.recv_timeout(PATIENCE).unwrap().json()["job"], job);
    assert!(messages.try_recv().is_err());
}
