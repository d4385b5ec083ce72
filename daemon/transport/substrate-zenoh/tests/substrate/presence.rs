//! Tests of the presence of agents.

use acl::Incarnation;
use substrate::{Resource, Substrate as _};

use crate::daemon::{Daemon, agent};

#[tokio::test(flavor = "multi_thread")]
async fn presence_reaches_all_daemons_and_the_own_one() {
    let mut a = Daemon::listening("a").await;
    let mut b = Daemon::linked("b", &a).await;
    let token = a.announce("robot");
    for daemon in [&mut a, &mut b] {
        daemon.hear("joined robot@a").await;
    }
    drop(token);
    for daemon in [&mut a, &mut b] {
        assert_eq!(daemon.hear("left robot@a").await, ["left robot@a"], "and only once");
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn a_late_daemon_sees_the_present_agents() {
    let a = Daemon::listening("a").await;
    let b = Daemon::linked("b", &a).await;
    let _tokens = [a.announce("robot"), b.announce("sensor")];
    let mut late = Daemon::linked("late", &b).await;
    late.hear("joined sensor@b").await;
    let mut later = Daemon::linked("later", &b).await;
    later.hear("joined robot@a").await;
}

#[tokio::test(flavor = "multi_thread")]
async fn a_present_agent_can_be_reached() {
    let mut a = Daemon::listening("a").await;
    let _token = a.announce("robot");
    a.hear("joined robot@a").await;
    // A token can come before its route only while both routers have just started. All of them stay
    // open, because one that opens right after another has left may miss the declarations there
    // are.
    let mut all = Vec::new();
    for name in ["b", "c", "d", "e", "f"] {
        let mut young = Daemon::linked(name, &a).await;
        young.hear("joined robot@a").await;
        young.request("a", "robot", name);
        assert_eq!(young.ask(Some("a"), Resource::State, None).await, ["a state -"]);
        a.hear(&format!("to robot request: {name}")).await;
        all.push(young);
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn hundreds_of_tokens_do_not_hang() {
    // Zenoh's default channel holds 256.
    let a = Daemon::listening("a").await;
    let _tokens: Vec<_> = (0..400).map(|number| a.announce(&format!("agent-{number}"))).collect();
    let mut late = Daemon::client("late", &a).await;
    let mut router = Daemon::linked("router", &a).await;
    for daemon in [&mut late, &mut router] {
        let mut joined = std::collections::BTreeSet::new();
        while joined.len() < 400 {
            joined.extend(daemon.hear_any().await);
        }
        assert!(joined.iter().all(|line| line.starts_with("joined agent-")), "{joined:?}");
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn the_agents_of_a_lost_daemon_leave() {
    let mut a = Daemon::listening("a").await;
    let b = Daemon::linked("b", &a).await;
    let tokens = [b.announce("robot"), b.announce("sensor")];
    let mut joined = [a.hear_any().await, a.hear_any().await].concat();
    joined.sort();
    assert_eq!(joined, ["joined robot@b", "joined sensor@b"]);
    drop(b);
    let mut left = [a.hear_any().await, a.hear_any().await].concat();
    left.sort();
    assert_eq!(left, ["left robot@b", "left sensor@b"]);
    // The tokens outlived their session; dropping them must do nothing.
    drop(tokens);
}

#[tokio::test(flavor = "multi_thread")]
async fn a_brief_absence_is_passed_on_in_order() {
    let mut a = Daemon::listening("a").await;
    let b = Daemon::linked("b", &a).await;
    let token = b.announce("robot");
    a.hear("joined robot@b").await;
    drop(token);
    let _token = b.announce("robot");
    assert_eq!(a.hear("joined robot@b").await, ["left robot@b", "joined robot@b"]);
    let second = b.substrate.announce(&agent("robot"), Incarnation(2)).expect("open");
    assert_eq!(a.hear("joined robot@b").await, ["joined robot@b"], "two lives at once");
    drop(second);
    a.hear("left robot@b").await;
}
