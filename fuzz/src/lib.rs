//! The real service inside the fuzzing process, and one connection to it; files for decoders.

pub mod compressed;

use clap::Parser;
use hemilux::config::Config;
use std::io::{Read, Write};
use std::net::{SocketAddr, TcpStream};
use std::sync::OnceLock;
use std::sync::mpsc::channel;
use std::time::Duration;
use tokio_util::sync::CancellationToken;

#[derive(Parser)]
struct Arguments {
    #[command(flatten)]
    config: Config,
}

/// The address of the service, started at the first call. Its queue takes nothing, so no job runs.
fn address() -> SocketAddr {
    static ADDRESS: OnceLock<SocketAddr> = OnceLock::new();
    *ADDRESS.get_or_init(|| {
        // The fuzzing process itself has no importer to start.
        let program = std::env::var_os("HEMILUX_PROGRAM").expect("HEMILUX_PROGRAM is set");
        hemilux::worker::use_program(program.into());
        let folder = tempfile::tempdir().expect("a temporary folder").keep();
        let arguments = Arguments::parse_from([
            "serve".as_ref(),
            "--listen=127.0.0.1:0".as_ref(),
            "--devices=cpu".as_ref(),
            "--max-queued=0".as_ref(),
            "--max-upload-mb=1".as_ref(),
            "--max-triangles=10000".as_ref(),
            "--keep-days=0.0001".as_ref(),
            "--min-free-mb=0".as_ref(),
            "--data-dir".as_ref(),
            folder.as_os_str(),
        ]);
        let (listens, where_it_is) = channel();
        std::thread::spawn(move || {
            let runtime = tokio::runtime::Builder::new_multi_thread()
                .worker_threads(1)
                .enable_all()
                .build()
                .expect("a runtime");
            let stop = CancellationToken::new();
            let ready = move |address| {
                let _ = listens.send(address);
            };
            if let Err(error) =
                runtime.block_on(hemilux::service::serve(arguments.config, stop, ready))
            {
                eprintln!("the service ended: {error}");
                std::process::abort();
            }
        });
        where_it_is.recv().expect("the service listens")
    })
}

/// Sends a request and checks that the answer is none of the server's faults.
///
/// # Panics
/// Where the server answers 5xx, or not at all.
pub fn post(path: &str, content_type: &str, body: &[u8]) {
    let address = address();
    let mut stream = TcpStream::connect(address).expect("the service listens");
    stream.set_read_timeout(Some(Duration::from_secs(20))).expect("timeouts can be set");
    let head = format!(
        "POST {path} HTTP/1.1\r\nhost: {address}\r\ncontent-type: {content_type}\r\ncontent-length: {}\r\nconnection: close\r\n\r\n",
        body.len()
    );
    stream.write_all(head.as_bytes()).expect("the head can be sent");
    // The server may answer, and close, before a refused body is all sent.
    let _ = stream.write_all(body);
    let mut answer = Vec::new();
    let _ = stream.read_to_end(&mut answer);
    let status = answer.get(9..12).unwrap_or(b"???");
    assert!(matches!(status.first(), Some(b'2'..=b'4')), "{}", String::from_utf8_lossy(&answer));
    assert!(
        status[0] != b'4' || String::from_utf8_lossy(&answer).contains("application/problem+json"),
        "an error without a problem document"
    );
}
