//! Tests of opening a session, and of the errors when it cannot be opened.

use substrate_zenoh::{Config, SessionMode};

use crate::daemon::{Daemon, HERE, config, ear};

async fn refusal(change: impl FnOnce(&mut Config)) -> String {
    let mut config = config("a");
    change(&mut config);
    let opened = config.open(ear("a").0).await;
    opened.err().expect("a configuration that cannot work").to_string()
}

#[tokio::test(flavor = "multi_thread")]
async fn locators_can_be_connected_to() {
    let folder = tempfile::tempdir().expect("a folder");
    let socket = format!("unixsock-stream/{}", folder.path().join("a.sock").display());
    let a = Daemon::open("a", |config| {
        config.listen = vec![HERE.to_owned(), socket.clone()];
        config.zid = Some("a1".to_owned());
    })
    .await;
    assert_eq!(a.substrate.zid(), "a1");
    let locators = a.substrate.locators();
    assert!(locators.contains(&socket), "{locators:?}");
    assert!(!locators.contains(&HERE.to_owned()) && locators.len() == 2, "{locators:?}");
    for locator in locators {
        let mut client = Daemon::open("client", |config| {
            config.mode = SessionMode::Client;
            config.connect = vec![locator];
        })
        .await;
        client.request("client", "x", "heard");
        client.hear("to x request: heard").await;
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn errors_name_the_endpoint_and_the_remedy() {
    let plain = refusal(|config| config.listen = vec!["tcp/[::]:7447".to_owned()]).await;
    assert!(plain.contains("`tcp/[::]:7447`") && plain.contains("`tls/[::]:7447`"), "{plain}");

    let a = Daemon::listening("a").await;
    let taken = a.substrate.locators();
    let error = refusal(|config| config.listen = taken.clone()).await;
    let port = taken[0].rsplit_once(':').expect("a port").1;
    let by = format!("port {port} is taken by process {} (`", std::process::id());
    assert!(error.contains(&taken[0]) && error.contains(&by), "{error}");

    let nobody = "unixsock-stream//nowhere/a.sock".to_owned();
    let error = refusal(|config| {
        config.mode = SessionMode::Client;
        config.connect = vec![nobody.clone()];
    })
    .await;
    assert!(error.contains(&nobody), "{error}");
}

/// One ecosystem file for all machines names every daemon, including the one that reads it.
#[tokio::test(flavor = "multi_thread")]
async fn a_daemon_does_not_connect_to_itself() {
    let free = std::net::TcpListener::bind("127.0.0.1:0").expect("a port");
    let port = free.local_addr().expect("an address").port();
    drop(free);
    let others = Daemon::listening("b").await;
    let own = [format!("tcp/127.0.0.1:{port}"), format!("tcp/localhost:{port}")];
    let mut a = Daemon::open("a", |config| {
        config.listen = vec![own[0].clone()];
        config.connect = own.iter().cloned().chain(others.substrate.locators()).collect();
        config.zenoh = serde_json::json!({ "connect": { "endpoints": [own[0]] } });
    })
    .await;
    // The daemon still connects to the others.
    let _lamp = others.announce("lamp");
    a.hear("joined lamp@b").await;
}
