//! API keys of the real program: made as an operator makes them, sent as a client sends them.

use crate::server::{Answer, Server, program};
use serde_json::Value;
use std::path::Path;
use std::process::Command;

/// Runs `hemilux keys` and gives what it printed.
pub fn keys(folder: &Path, arguments: &[&str]) -> String {
    let done = Command::new(program())
        .arg("keys")
        .arg("--data-dir")
        .arg(folder)
        .args(arguments)
        .output()
        .unwrap();
    let said = String::from_utf8_lossy(&done.stderr);
    assert!(done.status.success(), "{arguments:?}: {said}");
    String::from_utf8(done.stdout).unwrap().trim().to_owned()
}

/// Sends requests with a key.
pub struct With<'a>(pub &'a Server, pub &'a str);

impl With<'_> {
    /// Sends a request and reads the whole answer.
    pub fn send(&self, method: &str, path: &str, headers: &[(&str, &str)], body: &[u8]) -> Answer {
        let bearer = format!("Bearer {}", self.1);
        let mut all = vec![("authorization", bearer.as_str())];
        all.extend(headers);
        self.0.send(method, path, &all, body)
    }

    /// GET.
    pub fn get(&self, path: &str) -> Answer {
        self.send("GET", path, &[], b"")
    }

    /// POST of JSON.
    pub fn post(&self, path: &str, body: &Value) -> Answer {
        let json = [("content-type", "application/json")];
        self.send("POST", path, &json, body.to_string().as_bytes())
    }

    /// Accepts a job or fails the test; its id.
    pub fn submit(&self, job: &Value) -> String {
        let answer = self.post("/v1/jobs", job);
        assert_eq!(answer.status, 202, "{}", answer.text());
        answer.json()["id"].as_str().unwrap().to_owned()
    }

    /// How many things a list has.
    pub fn count(&self, path: &str, list: &str) -> usize {
        self.get(path).json()[list].as_array().unwrap().len()
    }
}
