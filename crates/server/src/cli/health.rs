//! `hemilux health`: asks a running server whether it can take jobs, for container engines whose
//! images hold no other HTTP client.

use super::process::{Failure, print};
use clap::Args;
use std::io::{Read, Write};
use std::net::{TcpStream, ToSocketAddrs};
use std::time::Duration;

/// Longest wait for the connection, and for each piece of the answer.
const PATIENCE: Duration = Duration::from_secs(3);
/// Most bytes of an answer that are read.
const MAX_ANSWER_BYTES: u64 = 64 << 10;

/// Arguments of `hemilux health`.
#[derive(Args)]
pub struct Arguments {
    /// The server, as it prints itself at its start.
    #[arg(
        long,
        env = "HEMILUX_URL",
        default_value = "http://127.0.0.1:8080",
        value_name = "http://HOST:PORT"
    )]
    url: String,
}

/// Succeeds where the server answers that it is ready.
pub fn run(arguments: &Arguments) -> Result<(), Failure> {
    let authority = authority(&arguments.url).map_err(Failure::usage)?;
    let (status, body) = get(authority, "/readyz")
        .map_err(|error| Failure::failed(format!("{}: {error}", arguments.url)))?;
    let body = body.trim();
    if status == 200 {
        return print(&format!("{body}\n"));
    }
    Err(Failure::failed(format!("{} answers {status}: {body}", arguments.url)))
}

/// Host and port of an `http://` URL without a path.
fn authority(url: &str) -> Result<&str, String> {
    let rest =
        url.trim().strip_prefix("http://").map(|rest| rest.strip_suffix('/').unwrap_or(rest));
    let is_authority = |rest: &&str| {
        rest.rsplit_once(':').is_some_and(|(host, port)| {
            !host.is_empty() && port.parse::<u16>().is_ok() && !host.contains(['/', '?', '#', '@'])
        })
    };
    rest.filter(is_authority).ok_or_else(|| format!("--url {url:?} must read http://HOST:PORT"))
}

/// Status and body of a GET request.
fn get(authority: &str, path: &str) -> std::io::Result<(u16, String)> {
    let mut failure = std::io::Error::other("the name has no address");
    let connected = authority.to_socket_addrs()?.find_map(|address| {
        TcpStream::connect_timeout(&address, PATIENCE).map_err(|error| failure = error).ok()
    });
    let Some(mut stream) = connected else { return Err(failure) };
    stream.set_read_timeout(Some(PATIENCE))?;
    stream.set_write_timeout(Some(PATIENCE))?;
    // HTTP/1.0: the answer ends where the connection does.
    let request = format!("GET {path} HTTP/1.0\r\nHost: {authority}\r\n\r\n");
    stream.write_all(request.as_bytes())?;
    let mut answer = Vec::new();
    stream.take(MAX_ANSWER_BYTES).read_to_end(&mut answer)?;
    let answer = String::from_utf8_lossy(&answer);
    let no_http = || std::io::Error::other("what answers there speaks no HTTP");
    let (head, body) = answer.split_once("\r\n\r\n").ok_or_else(no_http)?;
    let status = head.strip_prefix("HTTP/1.").and_then(|rest| rest.get(2..5)?.parse().ok());
    Ok((status.ok_or_else(no_http)?, body.to_owned()))
}

#[cfg(test)]
mod tests {
    use super::{authority, get};
    use std::io::{Read, Write};
    use std::net::TcpListener;

    #[test]
    fn a_url_is_host_and_port() {
        assert_eq!(authority("http://127.0.0.1:8080"), Ok("127.0.0.1:8080"));
        assert_eq!(authority("http://[::1]:80/\n"), Ok("[::1]:80"));
        for wrong in [
            "",
            "127.0.0.1:80",
            "https://a:1",
            "http://a",
            "http://:1",
            "http://a:x",
            "http://a:1/b",
        ] {
            assert!(authority(wrong).is_err(), "{wrong:?}");
        }
    }

    /// What `get` makes of a server that answers with these bytes.
    fn answered_with(answer: &'static str) -> std::io::Result<(u16, String)> {
        let listener = TcpListener::bind("127.0.0.1:0")?;
        let address = listener.local_addr()?.to_string();
        let server = std::thread::spawn(move || -> std::io::Result<String> {
            let (mut stream, _) = listener.accept()?;
            // All of the request: an answer while more arrives would reset the connection.
            let mut request = Vec::new();
            while !request.ends_with(b"\r\n\r\n") {
                let mut byte = [0];
                stream.read_exact(&mut byte)?;
                request.extend(byte);
            }
            stream.write_all(answer.as_bytes())?;
            Ok(String::from_utf8_lossy(&request).into_owned())
        });
        let got = get(&address, "/readyz");
        let request = server.join().expect("the server ends")?;
        assert!(request.starts_with("GET /readyz HTTP/1.0\r\n"), "{request:?}");
        got
    }

    #[test]
    fn an_answer_is_status_and_body() {
        let ready = answered_with("HTTP/1.0 200 OK\r\na: b\r\n\r\n{}").expect("an answer");
        assert_eq!(ready, (200, "{}".to_owned()));
        let busy = answered_with("HTTP/1.1 503 No\r\n\r\n").expect("an answer");
        assert_eq!(busy, (503, String::new()));
    }

    #[test]
    fn something_else_is_refused() {
        for answer in ["", "SSH-2.0\r\n\r\n", "HTTP/1.1\r\n\r\n", "HTTP/1.1 200 OK\r\n"] {
            assert!(answered_with(answer).is_err(), "{answer:?}");
        }
    }

    #[test]
    fn nobody_there_is_an_error() {
        let address = {
            let listener = TcpListener::bind("127.0.0.1:0").expect("a port");
            listener.local_addr().expect("an address").to_string()
        };
        assert!(get(&address, "/readyz").is_err());
    }
}
