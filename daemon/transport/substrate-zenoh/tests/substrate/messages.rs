//! Tests of messages to one agent and to all, and of heartbeats.

use acl::Performative;
use bytes::Bytes;
use substrate::{SendError, Subject, Substrate as _};

use crate::daemon::{Daemon, agent};

/// Opens two daemons that each see the other's agent.
async fn pair() -> (Daemon, Daemon) {
    let mut a = Daemon::listening("a").await;
    let mut b = Daemon::linked("b", &a).await;
    meet(&mut a, &mut b).await;
    (a, b)
}

/// Makes each daemon see an agent of the other. The tokens are leaked, so that the agents stay
/// present.
async fn meet(a: &mut Daemon, b: &mut Daemon) {
    for (from, to) in [(&*a, "x"), (&*b, "y")] {
        std::mem::forget(from.announce(to));
    }
    a.hear(&format!("joined y@{}", b.name)).await;
    b.hear(&format!("joined x@{}", a.name)).await;
}

#[tokio::test(flavor = "multi_thread")]
async fn a_message_to_one_reaches_its_daemon_alone() {
    let (mut a, mut b) = pair().await;
    a.request("b", "y", "go");
    assert_eq!(b.hear("to y request: go").await, ["to y request: go"]);
    b.send("a", "x", Subject::Receipt, "m1");
    assert_eq!(a.hear("to x receipt: m1").await, ["to x receipt: m1"]);
    // A daemon may send to itself: agents of one daemon converse in the same way.
    a.request("a", "x", "stay");
    assert_eq!(a.hear("to x request: stay").await, ["to x request: stay"]);
}

#[tokio::test(flavor = "multi_thread")]
async fn broadcasts_and_heartbeats_reach_all_daemons_and_the_sender() {
    let (mut a, mut b) = pair().await;
    let text = |text: &'static str| Bytes::from_static(text.as_bytes());
    a.substrate.broadcast(&agent("x"), Performative::Cfp, text("who can?")).expect("open");
    a.substrate.broadcast_state(&agent("x"), text("(define)")).expect("open");
    for daemon in [&mut a, &mut b] {
        daemon.hear("all x cfp: who can?").await;
        daemon.hear("beat x: (define)").await;
    }
    let beats = [r#"{"sender":"x"}"#, r#"{"sender":"z"}"#, "no message"];
    let beats = ["x", "z", "w"].into_iter().zip(beats).map(|(who, said)| (agent(who), text(said)));
    a.substrate.broadcast_heartbeats(beats.collect()).expect("open");
    for daemon in [&mut a, &mut b] {
        let heard = daemon.hear(r#"beat z: {"sender":"z"}"#).await;
        assert_eq!(heard, [r#"beat x: {"sender":"x"}"#, r#"beat z: {"sender":"z"}"#]);
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn messages_of_one_sender_stay_in_order() {
    let (a, mut b) = pair().await;
    for number in 0..100 {
        a.request("b", "y", &number.to_string());
    }
    let heard = b.hear("to y request: 99").await;
    let expected: Vec<String> = (0..100).map(|number| format!("to y request: {number}")).collect();
    assert_eq!(heard, expected);
}

#[tokio::test(flavor = "multi_thread")]
async fn routers_relay() {
    let mut a = Daemon::listening("a").await;
    let middle = Daemon::linked("middle", &a).await;
    let mut c = Daemon::linked("c", &middle).await;
    meet(&mut a, &mut c).await;
    a.request("c", "y", "far");
    assert_eq!(c.hear("to y request: far").await, ["to y request: far"]);
    c.request("a", "x", "back");
    a.hear("to x request: back").await;
}

#[tokio::test(flavor = "multi_thread")]
async fn a_client_works_like_other_daemons() {
    let mut a = Daemon::listening("a").await;
    let mut b = Daemon::client("b", &a).await;
    b.request("a", "x", "at once");
    a.hear("to x request: at once").await;
    meet(&mut a, &mut b).await;
    a.request("b", "y", "go");
    b.hear("to y request: go").await;
    let _token = b.announce("z");
    b.hear("joined z@b").await;
    drop(b);
    a.hear("left y@b").await;
}

#[tokio::test(flavor = "multi_thread")]
async fn a_long_message_arrives_whole() {
    let (a, mut b) = pair().await;
    // The message is longer than one batch of 64 KiB, so Zenoh fragments it.
    let long = "model ".repeat(100_000);
    a.request("b", "y", &long);
    b.hear(&format!("to y request: {long}")).await;
}

#[tokio::test(flavor = "multi_thread")]
async fn a_closed_substrate_returns_an_error() {
    let (a, mut b) = pair().await;
    a.request("b", "y", "last");
    a.substrate.close().await;
    b.hear("left x@a").await;
    let closed = Err(SendError::Closed);
    assert_eq!(a.substrate.broadcast_state(&agent("x"), Bytes::new()), closed);
    let announced = a.substrate.announce(&agent("x"), acl::Incarnation(2));
    assert_eq!(announced.map(drop), closed);
    assert_eq!(a.ask(None, substrate::Resource::State, None).await, [""; 0]);
}
