//! Tests of questions and answers between daemons.

use std::time::Instant;

use substrate::Resource;

use crate::daemon::{DEADLINE, Daemon};

/// Opens two daemons with one agent each, and waits until both know each other.
async fn pair() -> (Daemon, Daemon) {
    let mut a = Daemon::listening("a").await;
    let mut b = Daemon::linked("b", &a).await;
    for token in [a.announce("x"), b.announce("y")] {
        std::mem::forget(token);
    }
    a.hear("joined y@b").await;
    b.hear("joined x@a").await;
    (a, b)
}

#[tokio::test(flavor = "multi_thread")]
async fn a_query_goes_to_one_daemon_or_to_all() {
    let (a, _b) = pair().await;
    let check = async |daemon, resource, agent, expected: &[&str]| {
        assert_eq!(a.ask(daemon, resource, agent).await, expected, "{daemon:?} {resource:?}");
    };
    check(Some("b"), Resource::State, None, &["b state -"]).await;
    check(Some("a"), Resource::Domain, None, &["a domain -"]).await;
    check(None, Resource::Directory, None, &["a directory -", "b directory -"]).await;
    check(Some("b"), Resource::Goals, Some("y"), &["b goals y"]).await;
}

#[tokio::test(flavor = "multi_thread")]
async fn models_are_queried_by_agent_or_all_at_once() {
    let (a, b) = pair().await;
    std::mem::forget(b.announce("z"));
    let check = async |daemon, agent, expected: &[&str]| {
        assert_eq!(b.ask(daemon, Resource::Model, agent).await, expected, "{daemon:?} {agent:?}");
    };
    check(Some("b"), Some("z"), &["b model z"]).await;
    check(None, Some("x"), &["a model x"]).await;
    check(Some("b"), None, &["b model y", "b model z"]).await;
    check(None, None, &["a model x", "b model y", "b model z"]).await;
    check(None, Some("nobody"), &[]).await;
    drop(a);
}

#[tokio::test(flavor = "multi_thread")]
async fn a_query_to_an_absent_daemon_ends_at_once() {
    let (a, _b) = pair().await;
    let start = Instant::now();
    assert_eq!(a.ask(Some("nowhere"), Resource::State, None).await, [""; 0]);
    assert!(start.elapsed() < DEADLINE / 4, "{:?}", start.elapsed());
}
