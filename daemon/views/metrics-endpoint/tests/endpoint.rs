//! The listener with real sockets: TLS for those who have a certificate, and bounds for everyone.

use std::fs;
use std::net::{Ipv4Addr, SocketAddr};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use metrics_endpoint::{Health, MetricFamily, MetricsListener, MetricsSource, TlsFiles, TlsServer};
use rcgen::{BasicConstraints, CertificateParams, CertifiedIssuer, DnType, IsCa, KeyPair};
use rustls::{ClientConfig, RootCertStore};
use rustls_pki_types::pem::PemObject as _;
use rustls_pki_types::{CertificateDer, PrivateKeyDer, ServerName};
use tokio::io::{AsyncRead, AsyncReadExt as _, AsyncWrite, AsyncWriteExt as _};
use tokio::net::TcpStream;
use tokio::task::JoinHandle;
use tokio::time::timeout;
use tokio_rustls::TlsConnector;

const PATIENCE: Duration = Duration::from_secs(30);
const REQUEST: &[u8] = b"GET /metrics HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n\r\n";

struct Patient;

impl MetricsSource for Patient {
    fn metrics(&self) -> Vec<MetricFamily> {
        vec![MetricFamily::counter("x_total", "Something.").with(7.0)]
    }

    fn health(&self) -> Health {
        Health { problems: vec!["it is ill".to_owned()] }
    }
}

/// A listener that is served until this value is dropped.
struct Served {
    address: SocketAddr,
    task: JoinHandle<()>,
}

impl Served {
    async fn new(tls: Option<TlsServer>) -> Served {
        let any = SocketAddr::from((Ipv4Addr::LOCALHOST, 0));
        let listener = MetricsListener::bind(any, tls).await.expect("a free port");
        let address = listener.address().expect("a socket");
        Served { address, task: tokio::spawn(listener.serve(Arc::new(Patient))) }
    }

    async fn connect(&self) -> TcpStream {
        TcpStream::connect(self.address).await.expect("it listens")
    }
}

impl Drop for Served {
    fn drop(&mut self) {
        self.task.abort();
    }
}

/// Sends a request and returns all that is answered; empty if the connection is closed.
async fn exchange(mut stream: impl AsyncRead + AsyncWrite + Unpin, request: &[u8]) -> String {
    let mut bytes = Vec::new();
    let asked = async {
        stream.write_all(request).await?;
        stream.read_to_end(&mut bytes).await
    };
    // An error is a closed connection; what came before it counts.
    let _ = timeout(PATIENCE, asked).await.expect("it ends in time");
    String::from_utf8_lossy(&bytes).into_owned()
}

/// An authority, and the certificates that it has issued, in a folder.
struct Keys {
    folder: tempfile::TempDir,
    authority: CertifiedIssuer<'static, KeyPair>,
}

impl Keys {
    fn new() -> Keys {
        let mut params = CertificateParams::default();
        params.is_ca = IsCa::Ca(BasicConstraints::Unconstrained);
        params.distinguished_name.push(DnType::CommonName, "authority");
        let key = KeyPair::generate().expect("a key");
        let authority = CertifiedIssuer::self_signed(params, key).expect("a certificate");
        let folder = tempfile::tempdir().expect("a folder");
        fs::write(folder.path().join("authority.pem"), authority.pem()).expect("written");
        Keys { folder, authority }
    }

    /// Issues a certificate for `name`.
    fn issue(&self, name: &str) -> TlsFiles {
        let key = KeyPair::generate().expect("a key");
        let params = CertificateParams::new(vec![name.to_owned()]).expect("a name");
        let certificate = params.signed_by(&key, &self.authority).expect("a certificate");
        let path = |end: &str| -> PathBuf { self.folder.path().join(format!("{name}.{end}")) };
        fs::write(path("key"), key.serialize_pem()).expect("written");
        fs::write(path("pem"), certificate.pem()).expect("written");
        let authority = self.folder.path().join("authority.pem");
        TlsFiles { key: path("key"), certificate: path("pem"), authority }
    }
}

fn read(path: &Path) -> CertificateDer<'static> {
    CertificateDer::from_pem_file(path).expect("a certificate")
}

/// Asks over TLS, with the certificate of `own` or with none, and trusts `server`'s authority.
async fn ask_encrypted(served: &Served, server: &TlsFiles, own: Option<&TlsFiles>) -> String {
    let mut roots = RootCertStore::empty();
    roots.add(read(&server.authority)).expect("an authority");
    let provider = Arc::new(rustls::crypto::ring::default_provider());
    let builder = ClientConfig::builder_with_provider(provider);
    let builder = builder.with_safe_default_protocol_versions().expect("versions");
    let builder = builder.with_root_certificates(roots);
    let config = match own {
        None => builder.with_no_client_auth(),
        Some(files) => {
            let key = PrivateKeyDer::from_pem_file(&files.key).expect("a key");
            builder.with_client_auth_cert(vec![read(&files.certificate)], key).expect("they fit")
        }
    };
    let name = ServerName::try_from("pi").expect("a name");
    let connector = TlsConnector::from(Arc::new(config));
    match connector.connect(name, served.connect().await).await {
        Ok(stream) => exchange(stream, REQUEST).await,
        Err(_) => String::new(),
    }
}

#[tokio::test]
async fn only_who_has_a_certificate_of_the_authority_is_answered() {
    let (keys, others) = (Keys::new(), Keys::new());
    let server = keys.issue("pi");
    let is_revoked = Arc::new(AtomicBool::new(false));
    let asked = Arc::clone(&is_revoked);
    let tls = TlsServer::new(&server, move |_| asked.load(Ordering::Relaxed)).expect("it fits");
    let served = Served::new(Some(tls)).await;

    let (own, stranger) = (keys.issue("prometheus"), others.issue("prometheus"));
    let answer = ask_encrypted(&served, &server, Some(&own)).await;
    assert!(
        answer.starts_with("HTTP/1.1 200 OK\r\n") && answer.ends_with("x_total 7\n"),
        "{answer}"
    );
    assert_eq!(ask_encrypted(&served, &server, None).await, "", "without a certificate");
    let answer = ask_encrypted(&served, &server, Some(&stranger)).await;
    assert_eq!(answer, "", "with one of another authority");
    assert!(!exchange(served.connect().await, REQUEST).await.contains("HTTP"), "without TLS");
    is_revoked.store(true, Ordering::Relaxed);
    assert_eq!(ask_encrypted(&served, &server, Some(&own)).await, "", "with a revoked one");
}

#[tokio::test]
async fn files_that_do_not_fit_are_named() {
    let keys = Keys::new();
    let good = keys.issue("pi");
    let missing = TlsFiles { key: keys.folder.path().join("none.key"), ..good.clone() };
    let error = TlsServer::new(&missing, |_| false).expect_err("there is no key").to_string();
    assert!(error.contains("none.key: there is no private key"), "{error}");
    let other = TlsFiles { key: keys.issue("other").key, ..good.clone() };
    assert!(TlsServer::new(&other, |_| false).is_err(), "the key of another certificate");
    let torn = TlsFiles { certificate: good.key.clone(), ..good };
    let error = TlsServer::new(&torn, |_| false).expect_err("no certificate").to_string();
    assert!(error.contains("pi.key"), "{error}");
}

#[tokio::test]
async fn a_new_client_takes_the_place_of_the_oldest() {
    let served = Served::new(None).await;
    let mut first = served.connect().await;
    first.write_all(b"GET /met").await.expect("it is connected");
    let mut others = Vec::new();
    for _ in 0..64 {
        others.push(served.connect().await);
    }
    let answer = exchange(served.connect().await, REQUEST).await;
    assert!(answer.starts_with("HTTP/1.1 200 OK\r\n"), "{answer}");
    let rest = exchange(&mut first, b"rics HTTP/1.1\r\nHost: localhost\r\n\r\n").await;
    assert_eq!(rest, "", "its connection is closed");
}

#[tokio::test(start_paused = true)]
async fn a_client_that_sends_no_head_is_disconnected() {
    let served = Served::new(None).await;
    let mut silent = served.connect().await;
    silent.write_all(b"GET /metrics HTTP/1.1\r\nHost: ").await.expect("it is connected");
    let mut bytes = Vec::new();
    let ended = timeout(PATIENCE, silent.read_to_end(&mut bytes)).await;
    assert!(ended.is_ok(), "within ten seconds of simulated time");
    assert!(!String::from_utf8_lossy(&bytes).contains("200 OK"));
}

#[tokio::test]
async fn one_connection_serves_several_requests() {
    let served = Served::new(None).await;
    let mut requests = Vec::new();
    for path in ["/healthz", "/nothing"] {
        requests.extend(format!("GET {path} HTTP/1.1\r\nHost: [::1]:1\r\n\r\n").into_bytes());
    }
    requests.extend_from_slice(REQUEST);
    let answers = exchange(served.connect().await, &requests).await;
    for part in ["HTTP/1.1 503 ", "it is ill\n", "HTTP/1.1 404 ", "x_total 7\n"] {
        assert!(answers.contains(part), "{part}: {answers}");
    }
}
