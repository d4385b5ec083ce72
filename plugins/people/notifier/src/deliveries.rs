//! Tests of whole deliveries: to receivers on loopback, and to receivers that are not ours.

#[path = "../../../../tests/support/left_out.rs"]
mod left_out;

mod foreign;

use std::path::Path;
use std::sync::Arc;
use std::time::Duration;

use base64::Engine as _;
use base64::engine::general_purpose::{STANDARD, URL_SAFE_NO_PAD};
use ring::agreement::{ECDH_P256, EphemeralPrivateKey};
use ring::hmac;
use ring::rand::SystemRandom;
use rustls::ServerConfig;
use rustls::pki_types::pem::PemObject as _;
use rustls::pki_types::{CertificateDer, PrivateKeyDer};
use serde_json::Value;
use tokio_rustls::TlsAcceptor;

use crate::address::ReceiverAddress;
use crate::channel_secret::ChannelSecret;
use crate::notice::{Notice, NoticeDelivery, NoticeKind};
use crate::ntfy::NtfyTopic;
use crate::receiver::TestReceiver;
use crate::send_failure::SendFailure;
use crate::sentences::NoticeForm;
use crate::trust::ReceiverTrust;
use crate::web_push::WebPush;
use crate::web_push::push_store::{PushKeys, PushStore, PushSubscription};
use crate::webhook::Webhook;

const SECRET: &str = "whsec_MfKQ9r8GKYqrTwjUPD8ILPZIo2LaLaSw";

fn form() -> NoticeForm {
    let page = Some("https://hall:8443".to_owned());
    NoticeForm { ecosystem: "lab".to_owned(), page, is_discreet: false }
}

fn delivery() -> NoticeDelivery {
    let notice = Notice::new(NoticeKind::Stop, "9f", 1).with_text("fire älarm");
    let agents = vec![acl::AgentId::new("ann").expect("a name")];
    let notice = notice.with_agents(agents);
    NoticeDelivery { id: notice.id.clone(), notices: vec![notice] }
}

fn address(scheme: &str, port: u16, path: &str) -> ReceiverAddress {
    ReceiverAddress::parse(&format!("{scheme}://127.0.0.1:{port}{path}")).expect("an address")
}

fn webhook(port: u16, scheme: &str, trust: ReceiverTrust) -> Webhook {
    let address = address(scheme, port, "/hook?a=b");
    Webhook::new(address, trust, &ChannelSecret::of(SECRET)).expect("a webhook")
}

fn is_later(outcome: Result<(), SendFailure>) -> Option<Duration> {
    match outcome {
        Err(SendFailure::Later { pause, .. }) => pause,
        outcome => panic!("it may arrive later: {outcome:?}"),
    }
}

#[tokio::test]
async fn a_webhook_gets_signed_json_and_its_pauses_are_heard() {
    let mut receiver = TestReceiver::start(&[503, 400], None).await;
    let webhook = webhook(receiver.port, "http", ReceiverTrust::Machine);
    assert_eq!(is_later(webhook.send(&delivery(), &form()).await), Some(Duration::from_secs(7)));
    let refused = webhook.send(&delivery(), &form()).await;
    assert!(matches!(refused, Err(SendFailure::Never(_))), "{refused:?}");
    webhook.send(&delivery(), &form()).await.expect("taken");
    let (first, _, last) = (receiver.next().await, receiver.next().await, receiver.next().await);
    assert_eq!(last.path, "/hook?a=b");
    let header = |name: &str| last.headers[name].to_str().expect("text").to_owned();
    assert_eq!(header("webhook-id"), delivery().id);
    assert_eq!(header("webhook-id"), first.headers["webhook-id"].to_str().expect("text"));
    let signed = format!("{}.{}.", header("webhook-id"), header("webhook-timestamp"));
    let signed = [signed.as_bytes(), &last.body];
    let key = STANDARD.decode(SECRET.trim_start_matches("whsec_")).expect("base64");
    let signature = header("webhook-signature");
    let signature = STANDARD.decode(signature.trim_start_matches("v1,")).expect("base64");
    let key = hmac::Key::new(hmac::HMAC_SHA256, &key);
    hmac::verify(&key, &signed.concat(), &signature).expect("the signature holds");
    let told: Value = serde_json::from_slice(&last.body).expect("JSON");
    assert_eq!(told["text"], "ann stops everything: fire älarm");
    assert_eq!(told["notices"][0]["kind"], "stop");
    assert_eq!(told["link"], "https://hall:8443/");
}

#[tokio::test]
async fn a_receiver_that_is_away_or_silent_is_tried_later() {
    let listener = std::net::TcpListener::bind("127.0.0.1:0").expect("a port");
    let port = listener.local_addr().expect("an address").port();
    drop(listener);
    is_later(webhook(port, "http", ReceiverTrust::Machine).send(&delivery(), &form()).await);
    // A listener that accepts nothing: the time limit ends the request.
    let listener = std::net::TcpListener::bind("127.0.0.1:0").expect("a port");
    let port = listener.local_addr().expect("an address").port();
    tokio::time::pause();
    let silent = webhook(port, "http", ReceiverTrust::Machine);
    is_later(silent.send(&delivery(), &form()).await);
}

/// Writes the certificate of an authority, and a server's for 127.0.0.1 with its key.
fn server_files(ca: &Path, certificate: &Path, private: &Path) {
    let mut authority = rcgen::CertificateParams::new(Vec::<String>::new()).expect("parameters");
    authority.is_ca = rcgen::IsCa::Ca(rcgen::BasicConstraints::Unconstrained);
    let key = rcgen::KeyPair::generate().expect("a key");
    let own = authority.self_signed(&key).expect("a certificate");
    std::fs::write(ca, own.pem()).expect("a file");
    let issuer = rcgen::Issuer::new(authority, key);
    let names = vec!["127.0.0.1".to_owned()];
    let server = rcgen::CertificateParams::new(names).expect("parameters");
    let key = rcgen::KeyPair::generate().expect("a key");
    let signed = server.signed_by(&key, &issuer).expect("a certificate");
    std::fs::write(certificate, signed.pem()).expect("a file");
    std::fs::write(private, key.serialize_pem()).expect("a file");
}

/// Returns a server's TLS for 127.0.0.1, and writes the certificate of its authority.
fn tls(ca: &Path) -> TlsAcceptor {
    let [certificate, key] = ["cert", "key"].map(|end| ca.with_extension(end));
    server_files(ca, &certificate, &key);
    let certificate = CertificateDer::from_pem_file(certificate).expect("a certificate");
    let key = PrivateKeyDer::from_pem_file(key).expect("a key");
    let provider = Arc::new(rustls::crypto::ring::default_provider());
    let config = ServerConfig::builder_with_provider(provider)
        .with_safe_default_protocol_versions()
        .expect("versions")
        .with_no_client_auth()
        .with_single_cert(vec![certificate], key)
        .expect("a certificate");
    TlsAcceptor::from(Arc::new(config))
}

#[tokio::test]
async fn a_certificate_of_the_named_authority_is_needed() {
    let folder = tempfile::tempdir().expect("a folder");
    let (right, wrong) = (folder.path().join("right.pem"), folder.path().join("wrong.pem"));
    let mut receiver = TestReceiver::start(&[], Some(tls(&right))).await;
    drop(tls(&wrong));
    for trust in [ReceiverTrust::Machine, ReceiverTrust::File(wrong)] {
        let outcome = webhook(receiver.port, "https", trust).send(&delivery(), &form()).await;
        assert!(matches!(outcome, Err(SendFailure::Later { .. })), "{outcome:?}");
    }
    assert!(receiver.arrived().is_none(), "nothing was sent to a stranger");
    let webhook = webhook(receiver.port, "https", ReceiverTrust::File(right));
    webhook.send(&delivery(), &form()).await.expect("taken");
    receiver.next().await;
}

#[tokio::test]
async fn a_topic_gets_json_with_the_token_in_a_header() {
    let mut receiver = TestReceiver::start(&[], None).await;
    let address = address("http", receiver.port, "/building");
    let token = Some(ChannelSecret::of("tk_1"));
    let topic = NtfyTopic::new(address, ReceiverTrust::Machine, token, None).expect("a topic");
    topic.send(&delivery(), &form()).await.expect("taken");
    let request = receiver.next().await;
    assert_eq!(request.path, "/");
    assert_eq!(request.headers["authorization"], "Bearer tk_1");
    let told: Value = serde_json::from_slice(&request.body).expect("JSON");
    assert_eq!((&told["topic"], &told["priority"]), (&"building".into(), &5.into()));
    assert_eq!(told["click"], "https://hall:8443/");
}

/// Returns a subscription at a push service on loopback.
fn subscription(port: u16, path: &str, public: String, auth: String) -> PushSubscription {
    let endpoint = format!("http://127.0.0.1:{port}{path}");
    PushSubscription { endpoint, keys: PushKeys { p256dh: public, auth }, person: "ann".into() }
}

fn browser_key() -> String {
    let key = EphemeralPrivateKey::generate(&ECDH_P256, &SystemRandom::new()).expect("a key");
    URL_SAFE_NO_PAD.encode(key.compute_public_key().expect("a key"))
}

fn push(folder: &Path, port: u16) -> Arc<WebPush> {
    let services = vec![format!("http://127.0.0.1:{port}")];
    let contact = "mailto:a@b.example".to_owned();
    Arc::new(WebPush::new(folder.to_owned(), contact, services, ReceiverTrust::Machine))
}

#[tokio::test]
async fn subscriptions_that_have_ended_are_dropped_and_only_failures_are_repeated() {
    let folder = tempfile::tempdir().expect("a folder");
    let agent = acl::AgentId::new("notifier").expect("a name");
    let inside = PushStore::folder_of(folder.path(), &agent);
    // One at a time, so that each browser gets the answer of its turn.
    let mut receiver = TestReceiver::start(&[410], None).await;
    let push = push(&inside, receiver.port);
    push.prepare().expect("made");
    let store = PushStore::open(folder.path(), &agent).expect("made");
    let auth = || "BTBZMqHH6r4Tts7J_aSIgg".to_owned();
    let gone = subscription(receiver.port, "/gone", browser_key(), auth());
    store.subscribe(gone).expect("taken");
    push.send(&delivery(), &form()).await.expect("nobody is left");
    assert_eq!(receiver.next().await.path, "/gone");
    assert!(store.subscriptions().expect("read").is_empty());

    let mut receiver = TestReceiver::start(&[429], None).await;
    let push = self::push(&inside, receiver.port);
    for path in ["/one", "/two"] {
        let browser = subscription(receiver.port, path, browser_key(), auth());
        push.prepare().expect("its service is known now");
        let store = PushStore::open(folder.path(), &agent).expect("made");
        store.subscribe(browser).expect("taken");
    }
    let pause = is_later(push.send(&delivery(), &form()).await);
    assert_eq!(pause, Some(Duration::from_secs(7)));
    push.send(&delivery(), &form()).await.expect("taken");
    let mut paths = Vec::new();
    for _ in 0..3 {
        let request = receiver.next().await;
        assert_eq!(request.headers["content-encoding"], "aes128gcm");
        assert_eq!(request.headers["ttl"], "86400");
        assert_eq!(request.headers["urgency"], "high");
        assert_eq!(request.headers["topic"], delivery().id.as_str());
        paths.push(request.path);
    }
    assert!(receiver.arrived().is_none(), "each browser has it once");
    paths.sort();
    paths.dedup();
    assert_eq!(paths, ["/one", "/two"]);
}
