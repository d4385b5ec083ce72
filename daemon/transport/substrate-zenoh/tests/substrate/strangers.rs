//! Tests of messages, tokens and queries of plain Zenoh clients, and of what such clients receive.

use substrate::Resource;
use zenoh::query::Query;
use zenoh::{Session, Wait};

use crate::daemon::{DEADLINE, Daemon, ecosystem};

/// Opens a plain Zenoh client, as any tool would do.
async fn stranger(daemon: &Daemon) -> Session {
    let mut config = zenoh::Config::default();
    let endpoints = serde_json::to_string(&daemon.substrate.locators()).expect("strings");
    for (key, value) in [
        ("mode", "\"client\""),
        ("scouting/multicast/enabled", "false"),
        ("connect/endpoints", &endpoints),
    ] {
        config.insert_json5(key, value).expect("a setting of Zenoh's");
    }
    zenoh::open(config).await.expect("the daemon listens")
}

#[tokio::test(flavor = "multi_thread")]
async fn a_tool_receives_everything_even_within_one_daemon() {
    let mut a = Daemon::listening("a").await;
    let stranger = stranger(&a).await;
    let everything = stranger.declare_subscriber("althing/**").await.expect("open");
    // Messages that the stranger sends from now on come after its subscription.
    stranger.put("althing/office/in/a/x/inform", "ready").await.expect("open");
    a.hear("to x inform: ready").await;

    a.request("a", "x", "go");
    a.request("b", "y", "come");
    for key in ["in/a/x/inform", "in/a/x/request", "in/b/y/request"] {
        let sample = tokio::time::timeout(DEADLINE, everything.recv_async()).await;
        let sample = sample.expect("in time").expect("open");
        assert_eq!(sample.key_expr().as_str(), format!("althing/office/{key}"));
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn garbage_neither_panics_nor_confuses() {
    let mut a = Daemon::listening("a").await;
    let stranger = stranger(&a).await;
    let mut tokens = Vec::new();
    for garbage in
        ["alive/a", "alive/a/x/one", "alive/A/x/1", "alive/a/x/01", "alive/a/x/1/02", "session/a"]
    {
        let key = format!("althing/office/{garbage}");
        tokens.push(stranger.liveliness().declare_token(key).await.expect("open"));
    }
    for garbage in
        ["in/a/x/shout", "in/a/X/request", "in/a", "in/a/*/request", "all/cfp", "model/a"]
    {
        let key = format!("althing/office/{garbage}");
        stranger.put(key, [0xff, 0x00]).await.expect("open");
    }
    stranger.delete("althing/office/in/a/x/request").await.expect("open");
    for garbage in ["at/a/state?agent=X", "at/a/secrets", "model/a/x/y", "at/a"] {
        let replies = stranger.get(format!("althing/office/{garbage}")).await.expect("open");
        let reply = tokio::time::timeout(DEADLINE, replies.recv_async()).await.expect("in time");
        assert!(reply.is_err(), "{garbage}: {reply:?}");
    }
    stranger.put("althing/office/in/a/x/inform", "sense").await.expect("open");
    assert_eq!(a.hear("to x inform: sense").await, ["to x inform: sense"]);
}

#[tokio::test(flavor = "multi_thread")]
async fn a_token_of_a_silent_daemon_has_no_effect() {
    let mut a = Daemon::listening("a").await;
    let mut b = Daemon::linked("b", &a).await;
    let stranger = stranger(&a).await;
    let liveliness = stranger.liveliness();
    let _ghost = liveliness.declare_token("althing/office/alive/ghost/x/1").await.expect("open");
    let _token = liveliness.declare_token("althing/office/alive/s/x/1").await.expect("open");
    let answer = |query: Query| query.reply(query.key_expr(), "").wait().expect("open");
    let answering = stranger.declare_queryable("althing/office/at/s/reach").callback(answer);
    let answering = answering.await.expect("open");
    // An answer to a probe that lists no agents confirms all tokens of its daemon.
    for daemon in [&mut a, &mut b] {
        assert_eq!(daemon.hear("joined x@s").await, ["joined x@s"]);
    }
    // The daemon may be silent for a lease (four seconds).
    answering.undeclare().await.expect("open");
    for daemon in [&mut a, &mut b] {
        assert_eq!(daemon.hear("left x@s").await, ["left x@s"]);
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn a_wildcard_asks_for_several_resources() {
    let a = Daemon::listening("a").await;
    let _token = a.announce("x");
    let stranger = stranger(&a).await;
    let all = Resource::ALL.len();
    for (selector, expected) in [("at/**", all), ("model/**", 1), ("*/a/*", all + 1)] {
        let replies = stranger.get(format!("althing/office/{selector}")).await.expect("open");
        let mut keys = std::collections::BTreeSet::new();
        while let Ok(reply) =
            tokio::time::timeout(DEADLINE, replies.recv_async()).await.expect("in time")
        {
            keys.insert(reply.into_result().expect("an answer").key_expr().to_string());
        }
        assert_eq!(keys.len(), expected, "{keys:?}");
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn two_ecosystems_on_one_router_are_separate() {
    let mut a = Daemon::listening("a").await;
    let connect = a.substrate.locators();
    let mut b = Daemon::open("b", |config| {
        config.ecosystem = ecosystem("home");
        config.connect = connect;
    })
    .await;
    let mut c = Daemon::linked("c", &a).await;
    let _tokens = [b.announce("x"), c.announce("x"), a.announce("x")];
    assert_eq!(a.ask(Some("b"), Resource::State, None).await, [""; 0]);
    b.hear("joined x@b").await;
    b.request("a", "x", "from home");
    b.request("b", "x", "at home");
    c.hear("joined x@a").await;
    c.request("b", "x", "to home");
    c.request("a", "x", "in the office");
    let heard = a.hear("to x request: in the office").await;
    assert!(heard.iter().all(|line| !line.contains("home") && !line.contains("@b")), "{heard:?}");
    assert_eq!(b.hear("to x request: at home").await, ["to x request: at home"]);
}
