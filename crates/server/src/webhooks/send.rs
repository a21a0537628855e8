//! One message to one receiver: looked up, checked, connected to exactly what was checked, signed,
//! sent. No redirects, no second look-up in between, no connection that outlives the message.

use crate::api::webhooks::{WebhookMessage, host_and_port};
use crate::hash::hex;
use crate::networks::{Network, may_receive};
use axum::http::{Request, StatusCode, Uri, header};
use bytes::Bytes;
use hmac::{Hmac, KeyInit, Mac};
use http_body_util::Full;
use hyper_util::rt::TokioIo;
use jiff::Timestamp;
use sha2::Sha256;
use std::net::{IpAddr, SocketAddr, ToSocketAddrs};
use std::sync::Arc;
use std::time::Duration;
use tokio::io::{AsyncRead, AsyncWrite};
use tokio::net::TcpStream;
use tokio::sync::Semaphore;
use tokio_rustls::TlsConnector;
use tokio_rustls::rustls::pki_types::ServerName;
use tokio_rustls::rustls::{ClientConfig, RootCertStore};

/// The header with the message's id.
pub const ID: &str = "hemilux-webhook-id";
/// The header with the time and the signature.
pub const SIGNATURE: &str = "hemilux-webhook-signature";
/// How long a receiver has, from the look-up to its answer.
const PATIENCE: Duration = Duration::from_secs(10);

/// Look-ups of names at the same time: each may hold a thread of those that files and imports need, too.
const LOOK_UPS_AT_ONCE: usize = 64;

/// What came of sending a message.
#[derive(Debug)]
pub enum Sent {
    /// The receiver's answer.
    Answered(StatusCode),
    /// It was not reached, or did not answer; why.
    Failed(String),
    /// It may not be reached; why.
    Refused(String),
}

/// Sends messages.
pub struct Sender {
    /// Look-ups at the same time.
    look_ups: Arc<Semaphore>,
    allowed: Vec<Network>,
    tls: TlsConnector,
}

impl Sender {
    /// A sender that reaches public addresses and the `allowed` networks.
    ///
    /// # Errors
    /// Where the TLS library offers none of its own protocols.
    pub fn new(allowed: Vec<Network>) -> Result<Self, tokio_rustls::rustls::Error> {
        let roots = RootCertStore { roots: webpki_roots::TLS_SERVER_ROOTS.to_vec() };
        let provider = Arc::new(tokio_rustls::rustls::crypto::ring::default_provider());
        let tls = ClientConfig::builder_with_provider(provider)
            .with_safe_default_protocol_versions()?
            .with_root_certificates(roots)
            .with_no_client_auth();
        let look_ups = Arc::new(Semaphore::new(LOOK_UPS_AT_ONCE));
        Ok(Self { look_ups, allowed, tls: TlsConnector::from(Arc::new(tls)) })
    }

    /// Sends a message, signed where there is a secret.
    pub async fn send(&self, url: &str, secret: Option<&str>, message: &WebhookMessage) -> Sent {
        match tokio::time::timeout(PATIENCE, self.try_send(url, secret, message)).await {
            Ok(sent) => sent,
            Err(_) => Sent::Failed(format!("no answer within {} s", PATIENCE.as_secs())),
        }
    }

    async fn try_send(&self, url: &str, secret: Option<&str>, message: &WebhookMessage) -> Sent {
        let parsed = host_and_port(url).zip(url.parse::<Uri>().ok());
        let Some(((host, port), uri)) = parsed else {
            return Sent::Refused("the address is no web address".into());
        };
        let address = match self.look_up(&host, port).await {
            Ok(address) => address,
            Err(sent) => return sent,
        };
        let stream = match TcpStream::connect(address).await {
            Ok(stream) => stream,
            Err(error) => return Sent::Failed(format!("cannot connect: {error}")),
        };
        let request = match request(&uri, secret, message, Timestamp::now()) {
            Ok(request) => request,
            Err(error) => return Sent::Refused(error),
        };
        let answer = if uri.scheme_str() == Some("https") {
            let Ok(name) = ServerName::try_from(host) else {
                return Sent::Refused("the host is no name that a certificate can have".into());
            };
            match self.tls.connect(name, stream).await {
                Ok(stream) => exchange(stream, request).await,
                Err(error) => return Sent::Failed(format!("no TLS: {error}")),
            }
        } else {
            exchange(stream, request).await
        };
        match answer {
            Ok(status) => Sent::Answered(status),
            Err(error) => Sent::Failed(format!("no answer: {error}")),
        }
    }

    /// An address of the host that may be connected to.
    async fn look_up(&self, host: &str, port: u16) -> Result<SocketAddr, Sent> {
        let failed = |error: &dyn std::fmt::Display| {
            Sent::Failed(format!("cannot look the host up: {error}"))
        };
        let place = self.look_ups.clone().acquire_owned().await.map_err(|error| failed(&error))?;
        let name = host.to_owned();
        // The system's look-up takes a thread for as long as it likes, longer than anyone waits here.
        let found = tokio::task::spawn_blocking(move || {
            let _place = place;
            (name.as_str(), port).to_socket_addrs().map(Iterator::collect::<Vec<_>>)
        });
        let found = found.await.map_err(|error| failed(&error))?.map_err(|error| failed(&error))?;
        choose(host, &found, &self.allowed)
    }
}

/// Which of the addresses that were found for `host` to connect to. An address that is written in
/// the URL stays what it is, so it is refused for good where it may not receive; a name may have
/// been looked up wrongly or answered from inside once, and is looked up again the next time.
fn choose(host: &str, found: &[SocketAddr], allowed: &[Network]) -> Result<SocketAddr, Sent> {
    // Which address it is stays inside: a client could map the network with it.
    let inside = "the host's address is not public and not in --webhook-allow";
    match found.iter().find(|at| may_receive(at.ip(), allowed)) {
        Some(at) => Ok(*at),
        None if found.is_empty() => Err(Sent::Failed("the host has no address".into())),
        None if host.parse::<IpAddr>().is_ok() => Err(Sent::Refused(inside.into())),
        None => Err(Sent::Failed(inside.into())),
    }
}

/// The request that carries a message.
fn request(
    uri: &Uri,
    secret: Option<&str>,
    message: &WebhookMessage,
    now: Timestamp,
) -> Result<Request<Full<Bytes>>, String> {
    let body = serde_json::to_vec(message).map_err(|error| error.to_string())?;
    let path = uri.path_and_query().map_or("/", |path| path.as_str());
    let authority = uri.authority().map_or("", |authority| authority.as_str());
    let mut request = Request::post(path)
        .header(header::HOST, authority)
        .header(header::CONTENT_TYPE, "application/json")
        .header(header::USER_AGENT, concat!("hemilux/", env!("CARGO_PKG_VERSION")))
        .header(header::CONNECTION, "close")
        .header(ID, &message.id);
    if let Some(secret) = secret {
        request = request.header(SIGNATURE, signature(secret, now.as_second(), &body));
    }
    request.body(Full::new(body.into())).map_err(|error| error.to_string())
}

/// `t=SECONDS,v1=HEX`: HMAC-SHA256 with the secret over the seconds since 1970, a dot, the body.
pub fn signature(secret: &str, seconds: i64, body: &[u8]) -> String {
    let mut mac =
        Hmac::<Sha256>::new_from_slice(secret.as_bytes()).expect("HMAC takes keys of any length");
    mac.update(seconds.to_string().as_bytes());
    mac.update(b".");
    mac.update(body);
    format!("t={seconds},v1={}", hex(&mac.finalize().into_bytes()))
}

async fn exchange(
    stream: impl AsyncRead + AsyncWrite + Send + Unpin + 'static,
    request: Request<Full<Bytes>>,
) -> Result<StatusCode, hyper::Error> {
    let (mut sender, connection) = hyper::client::conn::http1::Builder::new()
        .max_buf_size(16 << 10)
        .handshake(TokioIo::new(stream))
        .await?;
    let answer = sender.send_request(request);
    tokio::pin!(connection, answer);
    // The connection ends with the answer's head; whatever body it has is not read.
    tokio::select! {
        answered = &mut answer => answered.map(|answer| answer.status()),
        ended = &mut connection => {
            ended?;
            answer.await.map(|answer| answer.status())
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::api::webhooks::Ending;

    #[test]
    fn the_signature_is_hmac_sha256_over_time_and_body() {
        // As `printf '%s' '1700000000.{}' | openssl dgst -sha256 -hmac 0123456789abcdef` has it.
        let signed = signature("0123456789abcdef", 1_700_000_000, b"{}");
        assert_eq!(signed, SIGNED);
    }

    const SIGNED: &str =
        "t=1700000000,v1=e4f8e2ecae2295b2ddb2f0b5584c8275e226c0ebe9b3b819e70156bb67122e3e";

    #[tokio::test]
    async fn inside_addresses_are_not_reached_unless_allowed() {
        let listener = tokio::net::TcpListener::bind("127.0.0.1:0").await.unwrap();
        let address = listener.local_addr().unwrap();
        let message = WebhookMessage {
            id: "m".into(),
            event: Ending::Succeeded,
            job: uuid::Uuid::nil(),
            ended_at: Timestamp::UNIX_EPOCH,
            url: "/v1/jobs/x".into(),
        };
        let closed = Sender::new(Vec::new()).unwrap();
        // In every spelling that the system's resolver understands.
        for host in ["127.0.0.1", "localhost", "[::ffff:127.0.0.1]", "2130706433", "0x7f.1"] {
            let url = format!("http://{host}:{}/", address.port());
            let sent = closed.send(&url, None, &message).await;
            assert!(!matches!(sent, Sent::Answered(_)), "{host}: {sent:?}");
            let is_literal = host == "127.0.0.1" || host.starts_with('[');
            assert_eq!(matches!(sent, Sent::Refused(_)), is_literal, "{host}: {sent:?}");
        }
        let nobody = tokio::time::timeout(Duration::from_millis(50), listener.accept()).await;
        assert!(nobody.is_err(), "somebody connected");
    }

    #[test]
    fn a_private_answer_for_a_name_is_no_last_word() {
        let (inside, outside) = (socket("10.0.0.7:443"), socket("1.1.1.1:443"));
        let failed = |found: &[SocketAddr]| {
            matches!(choose("hooks.example.org", found, &[]), Err(Sent::Failed(_)))
        };
        // The same name, looked up three times.
        assert!(failed(&[inside]) && failed(&[]));
        assert_eq!(choose("hooks.example.org", &[inside, outside], &[]).unwrap(), outside);
        // An address in the URL will never be another.
        assert!(matches!(choose("10.0.0.7", &[inside], &[]), Err(Sent::Refused(_))));
        let allowed = ["10.0.0.0/8".parse().unwrap()];
        assert_eq!(choose("10.0.0.7", &[inside], &allowed).unwrap(), inside);
    }

    fn socket(text: &str) -> SocketAddr {
        text.parse().unwrap()
    }
}
