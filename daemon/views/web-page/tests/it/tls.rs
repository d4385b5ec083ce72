//! TLS: only encrypted requests, cookies for this host only, and a renewed certificate.

use std::fs;
use std::path::Path;
use std::sync::Arc;
use std::time::Duration;

use rcgen::{CertificateParams, KeyPair};
use rustls::{ClientConfig, RootCertStore};
use rustls_pki_types::pem::PemObject as _;
use rustls_pki_types::{CertificateDer, ServerName};
use tokio::io::AsyncWriteExt as _;
use tokio_rustls::TlsConnector;
use web_page::{PageOptions, PageTls, PageTlsFiles};

use crate::served::{Answer, PASSWORD, Served, read_answer, request};

/// Writes a certificate for `pi`, and its key.
fn issue(folder: &Path) -> PageTlsFiles {
    let key = KeyPair::generate().expect("a key");
    let params = CertificateParams::new(vec!["pi".to_owned()]).expect("a name");
    let certificate = params.self_signed(&key).expect("a certificate");
    let files = PageTlsFiles { certificate: folder.join("pi.pem"), key: folder.join("pi.key") };
    fs::write(&files.certificate, certificate.pem()).expect("written");
    fs::write(&files.key, key.serialize_pem()).expect("written");
    files
}

/// Asks over TLS, and trusts one certificate only; `None` if there is no connection.
async fn ask(
    served: &Served,
    trusted: &Path,
    line: &str,
    headers: &str,
    body: &str,
) -> Option<Answer> {
    let mut roots = RootCertStore::empty();
    roots.add(CertificateDer::from_pem_file(trusted).expect("a certificate")).expect("a root");
    let provider = Arc::new(rustls::crypto::ring::default_provider());
    let builder = ClientConfig::builder_with_provider(provider);
    let builder = builder.with_safe_default_protocol_versions().expect("versions");
    let config = builder.with_root_certificates(roots).with_no_client_auth();
    let name = ServerName::try_from("pi").expect("a name");
    let stream = served.connect().await;
    let mut stream = TlsConnector::from(Arc::new(config)).connect(name, stream).await.ok()?;
    stream.write_all(request(line, "pi", headers, body).as_bytes()).await.ok()?;
    Some(read_answer(&mut stream).await)
}

#[tokio::test]
async fn a_page_over_tls_signs_people_in_for_this_host_only() {
    let folder = tempfile::tempdir().expect("a folder");
    let files = issue(folder.path());
    let tls = PageTls::open(files.clone()).expect("the files fit");
    let options = PageOptions { names: vec!["pi".to_owned()], ..PageOptions::default() };
    let served = Served::with(options, Some(tls)).await;
    let headers = "Origin: https://pi\r\nContent-Type: application/json\r\n";
    let body = serde_json::json!({ "name": "ada", "password": PASSWORD }).to_string();
    let answer = ask(&served, &files.certificate, "POST /api/sign-in", headers, &body).await;
    let answer = answer.expect("an answer");
    assert_eq!(answer.status, 200, "{answer:?}");
    let cookie = answer.header("set-cookie").expect("a cookie");
    assert!(
        cookie.starts_with("__Host-althing-made-up-pi-0=")
            && cookie.ends_with("; SameSite=Strict; Secure")
    );
    assert!(answer.header("strict-transport-security").is_some());
    let plain = headers.replace("https", "http");
    let answer = ask(&served, &files.certificate, "POST /api/sign-in", &plain, &body).await;
    assert_eq!(answer.expect("an answer").status, 403, "a page without TLS is another origin");
    assert_eq!(served.ask("GET /", "", "").await.status, 0, "nothing is answered without TLS");
}

#[tokio::test]
async fn a_renewed_certificate_is_used_without_a_restart() {
    let folder = tempfile::tempdir().expect("a folder");
    let files = issue(folder.path());
    let former = folder.path().join("former.pem");
    fs::copy(&files.certificate, &former).expect("copied");
    let tls = PageTls::open(files.clone()).expect("the files fit");
    let options = PageOptions { names: vec!["pi".to_owned()], ..PageOptions::default() };
    let served = Served::with(options, Some(tls)).await;
    assert!(ask(&served, &former, "GET /", "", "").await.is_some());
    issue(folder.path());
    // Nothing tells when the files were read.
    let mut looks = tokio::time::interval(Duration::from_millis(200));
    let renewed = async {
        while ask(&served, &files.certificate, "GET /", "", "").await.is_none() {
            looks.tick().await;
        }
    };
    tokio::time::timeout(crate::served::PATIENCE, renewed).await.expect("it is used in time");
}

#[test]
fn files_that_do_not_fit_are_named() {
    let folder = tempfile::tempdir().expect("a folder");
    let good = issue(folder.path());
    let missing = PageTlsFiles { key: folder.path().join("none.key"), ..good.clone() };
    let error = PageTls::open(missing).expect_err("there is no key").to_string();
    assert!(error.contains("none.key: there is no private key"), "{error}");
    let torn = PageTlsFiles { certificate: good.key.clone(), key: good.key.clone() };
    let error = PageTls::open(torn).expect_err("no certificate").to_string();
    assert!(error.contains("pi.key"), "{error}");
    let other = tempfile::tempdir().expect("a folder");
    let mixed = PageTlsFiles { key: issue(other.path()).key, ..good };
    assert!(PageTls::open(mixed).is_err(), "the key of another certificate");
}
