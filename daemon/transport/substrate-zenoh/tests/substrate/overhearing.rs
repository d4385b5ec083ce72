//! Tests of overhearing: which messages of others a listener receives, and which it does not.

use std::time::Duration;

use acl::Performative;
use bytes::Bytes;
use substrate::{Destination, OverhearToken, OverheardMessage, Subject, Substrate as _};
use tokio::sync::mpsc;

use crate::daemon::{DEADLINE, Daemon, agent};

/// The messages that a daemon overhears, as text.
pub(crate) struct Listening {
    overheard: mpsc::UnboundedReceiver<String>,
    token: OverhearToken,
}

impl Listening {
    /// Listens at a daemon, and waits until the listener receives what `far`, another daemon, says
    /// to itself: the farthest message that there is.
    pub(crate) async fn at(daemon: &Daemon, far: &Daemon) -> Listening {
        let (tell, overheard) = mpsc::unbounded_channel();
        let hear = move |message| drop(tell.send(line(&message)));
        let token = daemon.substrate.overhear(std::sync::Arc::new(hear)).expect("open");
        let mut listening = Listening { overheard, token };
        let reached = async {
            loop {
                far.request(far.name, "probe", "probe");
                let next = tokio::time::timeout(Duration::from_millis(20), listening.next());
                if next.await.is_ok_and(|line| line.contains("probe")) {
                    return;
                }
            }
        };
        tokio::time::timeout(DEADLINE, reached).await.expect("the listener is reached");
        listening
    }

    async fn next(&mut self) -> String {
        self.overheard.recv().await.expect("the listener lives with its session")
    }

    /// Returns the next overheard message that is no probe.
    pub(crate) async fn hear(&mut self) -> String {
        let next = async {
            loop {
                let line = self.next().await;
                if !line.contains("probe") {
                    return line;
                }
            }
        };
        tokio::time::timeout(DEADLINE, next).await.expect("in time")
    }
}

fn line(message: &OverheardMessage) -> String {
    let text = String::from_utf8_lossy(&message.payload);
    let origin = message.origin.as_ref().map(|origin| format!(" <{}>", origin.daemon));
    let origin = origin.unwrap_or_default();
    match &message.destination {
        Destination::To(to, Subject::Message(act)) => format!("to {to} {act}: {text}{origin}"),
        Destination::To(to, Subject::Receipt) => format!("to {to} receipt: {text}{origin}"),
        Destination::All(sender, act) => format!("all {sender} {act}: {text}{origin}"),
        Destination::AgentState(sender) => format!("beat {sender}: {text}{origin}"),
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn a_listener_receives_what_any_daemon_sends_to_any_other() {
    let a = Daemon::listening("a").await;
    let b = Daemon::linked("b", &a).await;
    let c = Daemon::linked("c", &a).await;
    let mut listening = Listening::at(&c, &b).await;
    a.request("b", "y", "to another");
    assert_eq!(listening.hear().await, "to y request: to another");
    b.request("b", "y", "to itself");
    assert_eq!(listening.hear().await, "to y request: to itself");
    c.request("a", "x", "from the listener's daemon");
    assert_eq!(listening.hear().await, "to x request: from the listener's daemon");
    let all = Bytes::from_static(b"to all");
    b.substrate.broadcast(&agent("y"), Performative::Cfp, all).expect("open");
    assert_eq!(listening.hear().await, "all y cfp: to all");
    let beats = ["x", "z"].map(|who| (agent(who), format!(r#"{{"sender":"{who}"}}"#).into()));
    a.substrate.broadcast_heartbeats(beats.into()).expect("open");
    assert_eq!(listening.hear().await, r#"beat x: {"sender":"x"}"#);
    assert_eq!(listening.hear().await, r#"beat z: {"sender":"z"}"#);
    // A receipt is no message: the next one that is overheard is the request.
    a.send("b", "y", Subject::Receipt, "m1");
    a.request("b", "y", "after the receipt");
    assert_eq!(listening.hear().await, "to y request: after the receipt");
}

#[tokio::test(flavor = "multi_thread")]
async fn nothing_is_overheard_after_the_token_is_dropped() {
    let mut a = Daemon::listening("a").await;
    let b = Daemon::linked("b", &a).await;
    let Listening { mut overheard, token } = Listening::at(&a, &b).await;
    drop(token);
    while overheard.recv().await.is_some() {}
    // The daemon itself still receives its messages.
    b.request("a", "x", "go");
    a.hear("to x request: go").await;
}
