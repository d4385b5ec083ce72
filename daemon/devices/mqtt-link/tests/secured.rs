//! Tests with a real broker that uses TLS and requires a password.

#[path = "../../../../tests/support/broker.rs"]
#[allow(dead_code, reason = "what other tests need of a broker besides")]
mod broker;

use std::fs;
use std::path::Path;
use std::process::Command;
use std::time::Duration;

use broker::Broker;
use mqtt_link::BrokerConnection;
use rcgen::{BasicConstraints, CertificateParams, IsCa, Issuer, KeyPair};
use tokio::sync::watch;

const PATIENCE: Duration = Duration::from_secs(20);

/// Starts a broker with TLS and a password; returns `None` if the broker is not installed.
fn secured() -> Option<Broker> {
    let folder = tempfile::tempdir().expect("a folder");
    let file = |name: &str| folder.path().join(name).display().to_string();
    certify(folder.path());
    fs::write(file("password"), "hunter2\n").expect("a file");
    fs::write(file("users"), "").expect("a file");
    let settings = format!(
        "user root\nallow_anonymous false\npassword_file {}\ncertfile {}\nkeyfile {}\n",
        file("users"),
        file("broker.pem"),
        file("broker.key")
    );
    let entered = Command::new("mosquitto_passwd")
        .args(["-b", &file("users"), "gateway", "hunter2"])
        .status()
        .is_ok_and(|status| status.success());
    let broker = Broker::start_in(folder, &settings)?;
    assert!(entered, "the program for passwords comes with the broker");
    Some(broker)
}

/// Connects to the broker with this password and this trusted authority. Returns a receiver for the
/// reason why there is no connection, and the connection.
fn trouble(
    broker: &Broker,
    password: &str,
    ca: &str,
) -> (watch::Receiver<Option<String>>, impl Sized + use<>) {
    let name = format!("mqtts://localhost:{}", broker.port());
    let (password, ca) = (Some(broker.file(password)), Some(broker.file(ca)));
    let broker = mqtt_link::Broker::new(Some(&name), Some("gateway".to_owned()), password, ca);
    let connection = BrokerConnection::shared(&broker.expect("it is right"), "test");
    (connection.problem(), connection)
}

/// Writes the certificates of an authority, of the broker (signed by that authority), and of
/// another authority.
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
async fn a_secured_broker_accepts_only_the_right_password_and_authority() {
    let Some(broker) = secured() else { return };
    let (mut said, _connection) = trouble(&broker, "password", "ca.pem");
    until(&mut said, Option::is_none).await;

    fs::write(broker.file("wrong"), "hunter3").expect("a file");
    let (mut said, _wrong) = trouble(&broker, "wrong", "ca.pem");
    let refused = "BadUserNamePassword";
    let is_refused = |said: &Option<String>| {
        said.as_ref().is_some_and(|said| said.contains(refused) || said.contains("NotAuthorized"))
    };
    until(&mut said, is_refused).await;

    let (mut said, _stranger) = trouble(&broker, "password", "other.pem");
    let is_unknown = |said: &Option<String>| {
        said.as_ref().is_some_and(|said| said.contains("invalid peer certificate"))
    };
    until(&mut said, is_unknown).await;

    // A missing file is reported, and the connection is made as soon as the file exists.
    let (mut said, _late) = trouble(&broker, "late", "ca.pem");
    let is_missing = |said: &Option<String>| {
        said.as_ref().is_some_and(|said| said.contains("/late: No such file"))
    };
    until(&mut said, is_missing).await;
    fs::copy(broker.file("password"), broker.file("late")).expect("a file");
    until(&mut said, Option::is_none).await;
}
