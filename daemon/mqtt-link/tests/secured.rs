//! A real broker that speaks TLS and wants a password.

use std::fs;
use std::net::{Ipv4Addr, TcpListener};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::Duration;

use mqtt_link::{Broker, Connection};
use rcgen::{BasicConstraints, CertificateParams, IsCa, Issuer, KeyPair};
use tempfile::TempDir;
use tokio::sync::watch;

const MOSQUITTO: &str = "/usr/sbin/mosquitto";
const PATIENCE: Duration = Duration::from_secs(20);

/// The broker's process, its port and its files; it ends with the test.
struct Secured {
    child: Child,
    port: u16,
    folder: TempDir,
}

impl Secured {
    fn start() -> Secured {
        let folder = tempfile::tempdir().expect("a folder");
        let file = |name: &str| folder.path().join(name).display().to_string();
        certify(folder.path());
        fs::write(file("password"), "hunter2\n").expect("a file");
        fs::write(file("users"), "").expect("a file");
        let status = Command::new("mosquitto_passwd")
            .args(["-b", &file("users"), "gateway", "hunter2"])
            .status()
            .expect("it comes with the broker");
        assert!(status.success());
        let port = TcpListener::bind((Ipv4Addr::LOCALHOST, 0)).and_then(|free| free.local_addr());
        let port = port.expect("a free port").port();
        let config = format!(
            "user root\nlistener {port} 127.0.0.1\nallow_anonymous false\npassword_file {}\n\
             certfile {}\nkeyfile {}\n",
            file("users"),
            file("broker.pem"),
            file("broker.key")
        );
        fs::write(file("broker.conf"), config).expect("a file");
        let child = Command::new(MOSQUITTO)
            .args(["-c", &file("broker.conf")])
            .stderr(Stdio::null())
            .stdout(Stdio::null())
            .spawn()
            .expect("it is installed");
        Secured { child, port, folder }
    }

    fn file(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    fn trouble(&self, password: &str, ca: &str) -> (watch::Receiver<Option<String>>, impl Sized) {
        let name = format!("mqtts://localhost:{}", self.port);
        let (password, ca) = (Some(self.file(password)), Some(self.file(ca)));
        let broker = Broker::new(Some(&name), Some("gateway".to_owned()), password, ca);
        let connection = Connection::to(&broker.expect("it is right"));
        (connection.trouble(), connection)
    }
}

impl Drop for Secured {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// Writes an authority, what it has signed for the broker, and an authority of somebody else.
fn certify(folder: &Path) {
    let write = |name: &str, text: String| fs::write(folder.join(name), text).expect("a file");
    let authority = |name: &str| {
        let mut params = CertificateParams::new(Vec::new()).expect("no names");
        params.is_ca = IsCa::Ca(BasicConstraints::Unconstrained);
        let key = KeyPair::generate().expect("a key");
        write(name, params.self_signed(&key).expect("signed").pem());
        Issuer::new(params, key)
    };
    let ours = authority("ca.pem");
    authority("other.pem");
    let key = KeyPair::generate().expect("a key");
    let params = CertificateParams::new(vec!["localhost".to_owned()]).expect("a name");
    write("broker.pem", params.signed_by(&key, &ours).expect("signed").pem());
    write("broker.key", key.serialize_pem());
}

async fn until(
    trouble: &mut watch::Receiver<Option<String>>,
    is_so: impl Fn(&Option<String>) -> bool,
) {
    let waited = tokio::time::timeout(PATIENCE, trouble.wait_for(is_so)).await.map(drop);
    assert!(waited.is_ok(), "{:?}", *trouble.borrow());
}

#[tokio::test]
async fn a_broker_with_a_password_and_tls_lets_in_who_shows_both() {
    if !Path::new(MOSQUITTO).exists() {
        assert!(std::env::var_os("CI").is_none(), "mosquitto is missing");
        eprintln!("NOT TESTED: apt-get install mosquitto mosquitto-clients");
        return;
    }
    let broker = Secured::start();
    let (mut trouble, _connection) = broker.trouble("password", "ca.pem");
    until(&mut trouble, Option::is_none).await;

    fs::write(broker.file("wrong"), "hunter3").expect("a file");
    let (mut trouble, _wrong) = broker.trouble("wrong", "ca.pem");
    let refused = "BadUserNamePassword";
    let is_refused = |said: &Option<String>| {
        said.as_ref().is_some_and(|said| said.contains(refused) || said.contains("NotAuthorized"))
    };
    until(&mut trouble, is_refused).await;

    let (mut trouble, _stranger) = broker.trouble("password", "other.pem");
    let is_unknown = |said: &Option<String>| {
        said.as_ref().is_some_and(|said| said.contains("invalid peer certificate"))
    };
    until(&mut trouble, is_unknown).await;

    // A file that is missing is said, and it goes on as soon as it is there.
    let (mut trouble, _late) = broker.trouble("late", "ca.pem");
    let is_missing = |said: &Option<String>| {
        said.as_ref().is_some_and(|said| said.contains("/late: No such file"))
    };
    until(&mut trouble, is_missing).await;
    fs::copy(broker.file("password"), broker.file("late")).expect("a file");
    until(&mut trouble, Option::is_none).await;
}
