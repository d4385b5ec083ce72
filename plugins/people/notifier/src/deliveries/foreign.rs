//! Receivers that are not ours: a mail server in Python (aiosmtpd), the library of Standard
//! Webhooks, and a decryption of push messages by http_ece.

use std::io::{BufRead as _, BufReader, Write as _};
use std::path::Path;
use std::process::{Child, ChildStdin, Command, Stdio};
use std::sync::mpsc::{self, Receiver};

use serde_json::{Value, json};

use super::left_out::left_out;
use super::*;
use crate::mail::{MailRelay, MailSecurity};
use crate::receiver::PATIENCE;

const NEEDS: &str = "it needs aiosmtpd, http_ece and standardwebhooks for python3: pip install \
                     aiosmtpd==1.4.6 http_ece==1.2.1 standardwebhooks==1.1.0";

/// A running `peer.py`. It ends with this value.
struct Peer {
    child: Child,
    input: Option<ChildStdin>,
    lines: Receiver<String>,
}

impl Drop for Peer {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

impl Peer {
    /// Starts the peer, if its libraries are there.
    fn start(arguments: &[&str]) -> Option<Peer> {
        let script = "import aiosmtpd, http_ece, standardwebhooks";
        let mut python = Command::new("python3");
        let found = python.args(["-c", script]).stderr(Stdio::null()).status();
        if !found.is_ok_and(|found| found.success()) {
            left_out(NEEDS);
            return None;
        }
        let program = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/peer.py");
        let mut command = Command::new("python3");
        command.arg(program).args(arguments).stdin(Stdio::piped()).stdout(Stdio::piped());
        let mut child = command.spawn().expect("Python is there");
        let (input, output) = (child.stdin.take(), child.stdout.take().expect("piped"));
        let (tell, lines) = mpsc::channel();
        std::thread::spawn(move || {
            for line in BufReader::new(output).lines().map_while(Result::ok) {
                if tell.send(line).is_err() {
                    return;
                }
            }
        });
        Some(Peer { child, input, lines })
    }

    fn say(&mut self, value: &Value) {
        let input = self.input.as_mut().expect("piped");
        writeln!(input, "{value}").expect("it reads");
    }

    fn hear(&self) -> Value {
        let line = self.lines.recv_timeout(PATIENCE).expect("it speaks in time");
        serde_json::from_str(&line).expect("JSON")
    }
}

fn relay(port: u16, security: MailSecurity, trust: ReceiverTrust) -> MailRelay {
    let to = ["Ann <ann@home.example>".to_owned(), "bob@home.example".to_owned()];
    let host = ("127.0.0.1".to_owned(), port);
    let people = ("hall@building.example", to.as_slice());
    MailRelay::new(host, (security, trust), None, people).expect("a relay")
}

#[tokio::test]
async fn a_mail_server_takes_the_message() {
    let Some(peer) = Peer::start(&["smtp"]) else { return };
    let port = u16::try_from(peer.hear()["port"].as_u64().expect("a port")).expect("a port");
    let relay = relay(port, MailSecurity::None, ReceiverTrust::Machine);
    relay.send(&delivery(), &form()).await.expect("taken");
    let got = peer.hear();
    assert_eq!(got["from"], "hall@building.example");
    assert_eq!(got["to"], json!(["ann@home.example", "bob@home.example"]));
    let text = got["text"].as_str().expect("text");
    assert!(text.contains("Subject: [lab] Stop"), "{text}");
    assert!(text.contains("https://hall:8443/"), "{text}");
}

#[tokio::test]
async fn a_mail_server_with_starttls_is_used_encrypted_and_by_a_known_certificate_only() {
    let folder = tempfile::tempdir().expect("a folder");
    let [ca, certificate, key] = ["ca.pem", "cert.pem", "key.pem"].map(|it| folder.path().join(it));
    server_files(&ca, &certificate, &key);
    let arguments = ["smtp", &certificate.display().to_string(), &key.display().to_string()];
    let Some(peer) = Peer::start(&arguments) else { return };
    let port = u16::try_from(peer.hear()["port"].as_u64().expect("a port")).expect("a port");
    let stranger = relay(port, MailSecurity::Starttls, ReceiverTrust::Machine);
    is_later(stranger.send(&delivery(), &form()).await);
    let known = relay(port, MailSecurity::Starttls, ReceiverTrust::File(ca));
    known.send(&delivery(), &form()).await.expect("taken");
    assert_eq!(peer.hear()["encrypted"], true);
}

#[tokio::test]
async fn a_library_of_standard_webhooks_accepts_the_signature() {
    let Some(mut peer) = Peer::start(&["webhook", SECRET]) else { return };
    let mut receiver = TestReceiver::start(&[], None).await;
    let webhook = webhook(receiver.port, "http", ReceiverTrust::Machine);
    webhook.send(&delivery(), &form()).await.expect("taken");
    let request = receiver.next().await;
    let header = |name: &str| request.headers[name].to_str().expect("text").to_owned();
    let names = ["webhook-id", "webhook-timestamp", "webhook-signature"];
    let headers: serde_json::Map<_, _> =
        names.iter().map(|name| ((*name).to_owned(), header(name).into())).collect();
    let body = String::from_utf8(request.body.to_vec()).expect("text");
    peer.say(&json!({ "headers": headers, "body": body }));
    assert_eq!(peer.hear(), json!({ "verified": true }));
}

#[tokio::test]
async fn a_browser_decrypts_a_push_message_and_a_push_service_accepts_its_proof() {
    let Some(mut peer) = Peer::start(&["push"]) else { return };
    let keys = peer.hear();
    let text = |name: &str| keys[name].as_str().expect("text").to_owned();
    let folder = tempfile::tempdir().expect("a folder");
    let agent = acl::AgentId::new("notifier").expect("a name");
    let mut receiver = TestReceiver::start(&[], None).await;
    let push = push(&PushStore::folder_of(folder.path(), &agent), receiver.port);
    push.prepare().expect("made");
    let store = PushStore::open(folder.path(), &agent).expect("made");
    let browser = subscription(receiver.port, "/a", text("p256dh"), text("auth"));
    store.subscribe(browser).expect("taken");
    push.send(&delivery(), &form()).await.expect("taken");
    let request = receiver.next().await;
    let authorization = request.headers["authorization"].to_str().expect("text");
    assert!(authorization.ends_with(store.public_key()), "the key that browsers subscribe for");
    let body = URL_SAFE_NO_PAD.encode(&request.body);
    peer.say(&json!({ "authorization": authorization, "body": body }));
    let told = peer.hear();
    assert_eq!(told["content"]["text"], "ann stops everything: fire älarm");
    assert_eq!(told["content"]["link"], "https://hall:8443/");
    assert_eq!(told["claims"]["aud"], format!("http://127.0.0.1:{}", receiver.port));
    assert_eq!(told["claims"]["sub"], "mailto:a@b.example");
}
