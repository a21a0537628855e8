//! The real program as a server, and a client small enough to trust: HTTP/1.1 over a plain
//! socket, one connection a request.

use serde_json::Value;
use std::io::{self, BufRead, BufReader, Read, Seek, Write};
use std::net::TcpStream;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Output, Stdio};
use std::sync::OnceLock;
use std::time::{Duration, Instant};
use tempfile::TempDir;

/// Longest wait for anything in these tests.
pub const PATIENCE: Duration = Duration::from_secs(60);

/// The `hemilux` program of this build profile, built first where it is not up to date.
pub fn program() -> &'static Path {
    static PROGRAM: OnceLock<PathBuf> = OnceLock::new();
    PROGRAM.get_or_init(|| {
        let test = std::env::current_exe().expect("a test has a path");
        // Tests lie in <profile>/deps, programs that use these helpers in <profile>.
        let folder = test.parent().expect("a program lies in a folder");
        let outer = folder.parent().filter(|_| folder.ends_with("deps"));
        let folder = outer.unwrap_or(folder).to_owned();
        let cargo = std::env::var_os("CARGO").unwrap_or_else(|| "cargo".into());
        // Of the whole workspace, as scripts/test builds it: packages by themselves have their
        // dependencies with fewer features, which would be a second build.
        let mut build = Command::new(cargo);
        build.args(["build", "--quiet", "--workspace", "--bin", "hemilux"]);
        if folder.ends_with("release") {
            build.arg("--release");
        }
        // What cargo tells a test about its own package is about no other one: build scripts that
        // look at it would run again, here and with the next build outside of a test.
        let about =
            |name: &str| name.starts_with("CARGO_PKG_") || name.starts_with("CARGO_MANIFEST_");
        for (name, _) in std::env::vars_os() {
            if name == "OUT_DIR" || name.to_str().is_some_and(about) {
                build.env_remove(name);
            }
        }
        let built = build.current_dir(repository()).status().expect("cargo runs");
        assert!(built.success(), "the program does not build");
        folder.join("hemilux")
    })
}

/// The repository's root.
pub fn repository() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).parent().expect("tests/ has a parent").to_owned()
}

/// A scene of the repository.
pub fn scene(name: &str) -> Vec<u8> {
    std::fs::read(repository().join("scenes").join(name)).expect("the scene is there")
}

/// A running server; killed when dropped.
pub struct Server {
    /// `None` where whoever started it ends it.
    child: Option<Child>,
    id: u32,
    /// `host:port`.
    pub address: String,
    _folder: Option<TempDir>,
}

impl Server {
    /// A server on a folder of its own.
    pub fn start() -> Self {
        Self::start_with(&[])
    }

    /// A server on a folder of its own, with further arguments.
    pub fn start_with(arguments: &[&str]) -> Self {
        let folder = TempDir::new().expect("a temporary folder");
        let mut server = Self::start_in(folder.path(), arguments);
        server._folder = Some(folder);
        server
    }

    /// A server on that data folder.
    pub fn start_in(folder: &Path, arguments: &[&str]) -> Self {
        Self::start_with_environment(folder, arguments, &[])
    }

    /// A server on that data folder with further arguments and environment variables.
    pub fn start_with_environment(
        folder: &Path,
        arguments: &[&str],
        environment: &[(&str, &str)],
    ) -> Self {
        Self::spawn(serve_command(folder, arguments).envs(environment.iter().copied()))
    }

    /// A server on a folder of its own whose soft limit on open files is `limit` when it starts, as
    /// on most systems, whatever that of this process is.
    pub fn start_with_soft_limit(limit: u32, arguments: &[&str]) -> Self {
        let folder = TempDir::new().expect("a temporary folder");
        let inner = serve_command(folder.path(), arguments);
        let mut command = Command::new("sh");
        command.arg("-c").arg(format!("ulimit -Sn {limit}; exec \"$0\" \"$@\""));
        command.arg(inner.get_program()).args(inner.get_args());
        let mut server = Self::spawn(&mut command);
        server._folder = Some(folder);
        server
    }

    /// A server that `command` starts; it must print where it listens, as `hemilux serve` does.
    pub fn spawn(command: &mut Command) -> Self {
        Self::try_spawn(command)
            .unwrap_or_else(|said| panic!("the server ends before it listens; it said: {said}"))
    }

    /// A server that `command` starts.
    ///
    /// # Errors
    /// What it wrote to standard error, where it ends before it listens.
    pub fn try_spawn(command: &mut Command) -> Result<Self, String> {
        let mut log = tempfile::tempfile().expect("a temporary file");
        let mut child = command
            .stdout(Stdio::piped())
            .stderr(log.try_clone().expect("a file can be opened twice"))
            .spawn()
            .expect("the server starts");
        let mut line = String::new();
        let output = child.stdout.take().expect("stdout is piped");
        BufReader::new(output).read_line(&mut line).expect("its output can be read");
        let Some(address) = line.trim().strip_prefix("http://") else {
            child.kill().expect("it can be killed");
            child.wait().expect("it ends");
            let mut said = String::new();
            log.rewind().expect("a file can be read again");
            log.read_to_string(&mut said).expect("what it said is text");
            return Err(said);
        };
        let address = address.to_owned();
        Ok(Self { id: child.id(), child: Some(child), address, _folder: None })
    }

    /// A server that somebody else started and will end.
    pub fn attach(address: &str, id: u32) -> Self {
        Self { child: None, id, address: address.to_owned(), _folder: None }
    }

    fn child(&mut self) -> &mut Child {
        self.child.as_mut().expect("the server was started here")
    }

    /// Kills it at once, as a crash or the kernel would.
    pub fn kill(mut self) {
        self.child().kill().expect("it can be killed");
        self.child().wait().expect("it ends");
    }

    /// Asks it to end (SIGTERM); how long that took.
    pub fn terminate(mut self) -> Duration {
        let began = Instant::now();
        let sent = Command::new("kill").arg(self.id.to_string()).status();
        assert!(sent.expect("kill runs").success());
        let status = self.child().wait().expect("it ends");
        assert!(status.success(), "{status}");
        began.elapsed()
    }

    /// Waits until it can run jobs; it takes them before that.
    pub fn until_ready(self) -> Self {
        let deadline = Instant::now() + PATIENCE;
        while self.get("/readyz").status != 200 {
            assert!(Instant::now() < deadline, "the server is never ready");
            std::thread::sleep(Duration::from_millis(10));
        }
        self
    }

    /// The processes that it started and that still run.
    pub fn children(&self) -> Vec<u32> {
        let server = self.id;
        let threads = std::fs::read_dir(format!("/proc/{server}/task"));
        threads
            .into_iter()
            .flatten()
            .filter_map(|thread| std::fs::read_to_string(thread.ok()?.path().join("children")).ok())
            .flat_map(|pids| {
                pids.split_whitespace().filter_map(|p| p.parse().ok()).collect::<Vec<_>>()
            })
            .collect()
    }

    /// Its process id.
    pub fn pid(&self) -> u32 {
        self.id
    }

    /// Whether the process still runs.
    pub fn is_alive(&mut self) -> bool {
        matches!(self.child().try_wait(), Ok(None))
    }

    /// Sends a request and reads the whole answer.
    pub fn send(&self, method: &str, path: &str, headers: &[(&str, &str)], body: &[u8]) -> Answer {
        let (status, headers, mut body) = self.open(method, path, headers, body);
        let mut bytes = Vec::new();
        body.read_to_end(&mut bytes).expect("the body arrives");
        Answer { status, headers, body: bytes }
    }

    /// GET.
    pub fn get(&self, path: &str) -> Answer {
        self.send("GET", path, &[], b"")
    }

    /// POST of JSON.
    pub fn post(&self, path: &str, body: &Value) -> Answer {
        let body = body.to_string();
        self.send("POST", path, &[("content-type", "application/json")], body.as_bytes())
    }

    /// POST of a scene file.
    pub fn post_scene(&self, bytes: &[u8]) -> Answer {
        self.send("POST", "/v1/scenes", &[("content-type", "model/gltf-binary")], bytes)
    }

    /// Accepts a job or fails the test; its id.
    pub fn submit(&self, job: &Value) -> String {
        let answer = self.post("/v1/jobs", job);
        assert_eq!(answer.status, 202, "{}", answer.text());
        answer.json()["id"].as_str().expect("a job has an id").to_owned()
    }

    /// Waits until the job has ended.
    pub fn wait(&self, job: &str) -> Value {
        self.wait_at_most(PATIENCE, job)
    }

    /// Waits so long until the job has ended.
    pub fn wait_at_most(&self, patience: Duration, job: &str) -> Value {
        let has_ended = |job: &Value| {
            matches!(job["state"].as_str(), Some("succeeded" | "failed" | "cancelled"))
        };
        self.poll(job, Instant::now() + patience, has_ended)
    }

    /// Waits until the job is as wished.
    pub fn wait_until(&self, job: &str, wished: impl Fn(&Value) -> bool) -> Value {
        self.poll(job, Instant::now() + PATIENCE, wished)
    }

    fn poll(&self, job: &str, deadline: Instant, wished: impl Fn(&Value) -> bool) -> Value {
        loop {
            let answer = self.get(&format!("/v1/jobs/{job}"));
            assert_eq!(answer.status, 200, "{}", answer.text());
            let record = answer.json();
            if wished(&record) {
                return record;
            }
            assert!(Instant::now() < deadline, "the job never got there: {record}");
            std::thread::sleep(Duration::from_millis(20));
        }
    }

    /// Opens an event stream.
    pub fn events(&self, path: &str, headers: &[(&str, &str)]) -> Events {
        let (status, headers, body) = self.open("GET", path, headers, b"");
        assert_eq!(status, 200);
        assert!(headers.iter().any(|(n, v)| n == "content-type" && v.starts_with("text/event")));
        Events { lines: BufReader::new(body) }
    }

    /// The headers of an event stream's answer.
    pub fn events_head(&self, path: &str) -> Vec<(String, String)> {
        self.open("GET", path, &[], b"").1
    }

    fn open(&self, method: &str, path: &str, headers: &[(&str, &str)], body: &[u8]) -> Head {
        request(&self.address, method, path, headers, body).expect("the server answers")
    }
}

/// Sends a request to a server that may go away at any time.
///
/// # Errors
/// Where it does.
pub fn try_send(
    address: &str,
    (method, path): (&str, &str),
    headers: &[(&str, &str)],
    body: &[u8],
) -> io::Result<Answer> {
    let (status, headers, mut body) = request(address, method, path, headers, body)?;
    let mut bytes = Vec::new();
    body.read_to_end(&mut bytes)?;
    Ok(Answer { status, headers, body: bytes })
}

/// Opens an event stream of a server that may go away at any time; what it answers if there is
/// no stream.
///
/// # Errors
/// Where it does.
pub fn try_events(
    address: &str,
    path: &str,
    headers: &[(&str, &str)],
) -> io::Result<Result<Events, u16>> {
    let (status, _, body) = request(address, "GET", path, headers, b"")?;
    Ok(if status == 200 { Ok(Events { lines: BufReader::new(body) }) } else { Err(status) })
}

type Head = (u16, Vec<(String, String)>, Body);

fn request(
    address: &str,
    method: &str,
    path: &str,
    headers: &[(&str, &str)],
    body: &[u8],
) -> io::Result<Head> {
    let mut stream = TcpStream::connect(address)?;
    stream.set_read_timeout(Some(PATIENCE))?;
    let mut request = format!("{method} {path} HTTP/1.1\r\nconnection: close\r\n");
    if !headers.iter().any(|(name, _)| name.eq_ignore_ascii_case("host")) {
        request += &format!("host: {address}\r\n");
    }
    for (name, value) in headers {
        request += &format!("{name}: {value}\r\n");
    }
    request += &format!("content-length: {}\r\n\r\n", body.len());
    stream.write_all(request.as_bytes())?;
    // The server may answer, and close, before a refused body is all sent.
    let _ = stream.write_all(body);
    read_head(BufReader::new(stream))
}

impl Drop for Server {
    fn drop(&mut self) {
        if let Some(child) = &mut self.child {
            let _ = child.kill();
            let _ = child.wait();
        }
    }
}

/// Runs a server that is expected to end by itself.
pub fn serve_and_fail(folder: &Path, arguments: &[&str]) -> Output {
    serve_command(folder, arguments).output().expect("the program runs")
}

/// The command that starts a server on a free port with the CPU device.
pub fn serve_command(folder: &Path, arguments: &[&str]) -> Command {
    let mut command = Command::new(program());
    command.arg("serve").arg("--data-dir").arg(folder).args(["--devices", "cpu"]);
    if !arguments.contains(&"--listen") {
        command.args(["--listen", "127.0.0.1:0"]);
    }
    command.args(arguments);
    command
}

/// An answer.
#[derive(Debug)]
pub struct Answer {
    /// Status code.
    pub status: u16,
    /// Headers, names in lower case.
    pub headers: Vec<(String, String)>,
    /// The body.
    pub body: Vec<u8>,
}

impl Answer {
    /// A header's value; empty where there is none.
    pub fn header(&self, name: &str) -> &str {
        self.headers.iter().find(|(n, _)| n == name).map_or("", |(_, value)| value)
    }

    /// The body as text.
    pub fn text(&self) -> String {
        String::from_utf8_lossy(&self.body).into_owned()
    }

    /// The body as JSON.
    pub fn json(&self) -> Value {
        serde_json::from_slice(&self.body).unwrap_or_else(|_| panic!("no JSON: {}", self.text()))
    }

    /// Checks that this is a whole problem document with that status.
    pub fn problem(&self, status: u16) -> Value {
        assert_eq!(self.status, status, "{}", self.text());
        assert_eq!(self.header("content-type"), "application/problem+json");
        let document = self.json();
        assert_eq!(document["status"], status);
        for member in ["type", "title", "detail", "instance"] {
            assert!(document[member].as_str().is_some_and(|s| !s.is_empty()), "{document}");
        }
        document
    }
}

/// One server-sent event.
#[derive(Clone, Debug, PartialEq)]
pub struct Event {
    /// Its id.
    pub id: u64,
    /// Its name.
    pub name: String,
    /// Its data.
    pub data: Value,
}

/// A stream of events; ends where the server ends it.
pub struct Events {
    lines: BufReader<Body>,
}

impl Iterator for Events {
    type Item = Event;

    fn next(&mut self) -> Option<Event> {
        let (mut id, mut name, mut data) = (None, String::new(), String::new());
        loop {
            let mut line = String::new();
            if self.lines.read_line(&mut line).ok()? == 0 {
                return None;
            }
            match line.trim_end().split_once(": ") {
                Some(("id", value)) => id = value.parse().ok(),
                Some(("event", value)) => name = value.into(),
                Some(("data", value)) => data += value,
                _ if line.trim_end().is_empty() && id.is_some() => {
                    let data = serde_json::from_str(&data).expect("events carry JSON");
                    return Some(Event { id: id?, name, data });
                }
                _ => {}
            }
        }
    }
}

/// A body, its framing undone.
pub struct Body {
    stream: BufReader<TcpStream>,
    chunked: bool,
    /// Bytes left in the present chunk, or in the body.
    left: u64,
}

impl Read for Body {
    fn read(&mut self, buffer: &mut [u8]) -> std::io::Result<usize> {
        if self.left == 0 && self.chunked {
            let mut line = String::new();
            self.stream.read_line(&mut line)?;
            let size = line.trim();
            self.left = u64::from_str_radix(size, 16).map_err(std::io::Error::other)?;
            self.chunked = self.left > 0;
        }
        let wanted = buffer.len().min(usize::try_from(self.left).unwrap_or(usize::MAX));
        let got = self.stream.read(&mut buffer[..wanted])?;
        self.left -= got as u64;
        if self.left == 0 && self.chunked {
            self.stream.read_exact(&mut [0; 2])?;
        }
        Ok(got)
    }
}

fn read_head(mut stream: BufReader<TcpStream>) -> io::Result<Head> {
    let mut line = String::new();
    stream.read_line(&mut line)?;
    let status = line.split(' ').nth(1).and_then(|code| code.parse().ok());
    let status = status.ok_or_else(|| io::Error::other(format!("no status in {line:?}")))?;
    let mut headers = Vec::new();
    loop {
        let mut line = String::new();
        stream.read_line(&mut line)?;
        match line.trim_end().split_once(':') {
            Some((name, value)) => headers.push((name.to_ascii_lowercase(), value.trim().into())),
            None => break,
        }
    }
    let header = |name| headers.iter().find(|(n, _)| n == name).map(|(_, v): &(_, String)| v);
    let chunked = header("transfer-encoding").is_some_and(|value| value == "chunked");
    let left = header("content-length").and_then(|value| value.parse().ok()).unwrap_or(0);
    Ok((status, headers, Body { stream, chunked, left }))
}
