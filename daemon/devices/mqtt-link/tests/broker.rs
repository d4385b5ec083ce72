//! Tests with a real broker: texts that are too long, filters that brokers reject, messages without
//! a connection to the broker.

#[path = "../../../../tests/support/broker.rs"]
#[allow(dead_code, reason = "what other tests need of a broker besides")]
mod broker;

use std::io::Write as _;
use std::sync::Arc;
use std::time::Duration;

use broker::Broker;
use mqtt_link::{BrokerConnection, TopicState};
use tokio::sync::watch;

const PATIENCE: Duration = Duration::from_secs(60);

async fn connected(broker: &Broker) -> Arc<BrokerConnection> {
    let broker = mqtt_link::Broker::new(Some(&broker.name()), None, None, None);
    let connection = BrokerConnection::shared(&broker.expect("it is right"), "test");
    await_connected(&connection).await;
    connection
}

async fn await_connected(connection: &BrokerConnection) {
    let mut trouble = connection.problem();
    let waited = tokio::time::timeout(PATIENCE, trouble.wait_for(Option::is_none)).await.map(drop);
    assert!(waited.is_ok(), "it is never connected");
}

async fn until(said: &mut watch::Receiver<TopicState>, is_so: impl Fn(&TopicState) -> bool) {
    let waited = tokio::time::timeout(PATIENCE, said.wait_for(is_so)).await.map(drop);
    assert!(waited.is_ok(), "{:?}", *said.borrow());
}

fn is_last(said: &TopicState, text: &str) -> bool {
    said.texts.front().is_some_and(|word| &*word.text == text)
}

/// Publishes a text of `bytes` bytes for the broker to retain.
fn retain_bytes(broker: &Broker, topic: &str, bytes: usize) {
    let mut file = tempfile::NamedTempFile::new().expect("a file");
    file.write_all(&vec![b'x'; bytes]).expect("written");
    broker.retain_file(topic, file.path());
}

#[tokio::test]
async fn a_long_text_is_received_and_one_beyond_the_limit_is_dropped() {
    let Some(broker) = Broker::start() else { return };
    let long = 17 << 20;
    retain_bytes(&broker, "bridge/devices", long);
    retain_bytes(&broker, "bridge/beyond", 70 << 20);
    retain_bytes(&broker, "device/long", 2 << 20);
    broker.retain("device/short", "1");
    let connection = connected(&broker).await;
    let trouble = connection.problem();
    let inbox = connection.listen_to_all("bridge/+");
    let (mut short, mut device) =
        (connection.listen("device/short"), connection.listen("device/long"));
    until(&mut short, |said| is_last(said, "1")).await;
    let taken = tokio::time::timeout(PATIENCE, inbox.take(9)).await.expect("it comes");
    let lengths: Vec<_> = taken.iter().map(|(topic, text)| (topic.as_str(), text.len())).collect();
    assert_eq!(lengths, [("bridge/devices", long)]);
    // The connection was not interrupted.
    broker.say("device/long", "2");
    until(&mut device, |said| is_last(said, "2")).await;
    assert_eq!(device.borrow().count, 1, "the long one was left out");
    assert!(!trouble.has_changed().expect("it is held"), "it was never lost");
}

#[tokio::test]
async fn an_invalid_filter_does_not_affect_the_others() {
    let Some(mut broker) = Broker::start() else { return };
    let connection = connected(&broker).await;
    let bad = ["lab/#/bad", "lab/a+", "", "a\0b", "$share/x/y"];
    let mut bad: Vec<_> = bad.iter().map(|topic| connection.listen(topic)).collect();
    let topics: Vec<_> = (0..30).map(|number| format!("lab/{number}/t")).collect();
    let mut good: Vec<_> = topics.iter().map(|topic| connection.listen(topic)).collect();
    let mut pattern = connection.listen("lab/+/u");
    for round in ["1", "2"] {
        for (topic, said) in topics.iter().zip(&mut good) {
            broker.retain(topic, round);
            until(said, |said| is_last(said, round)).await;
        }
        broker.retain("lab/7/u", round);
        until(&mut pattern, |said| is_last(said, round)).await;
        for said in &mut bad {
            assert!(said.borrow().rejection.is_some());
        }
        if round == "1" {
            let mut trouble = connection.problem();
            broker.kill();
            let lost = tokio::time::timeout(PATIENCE, trouble.wait_for(Option::is_some)).await;
            assert!(lost.is_ok(), "it is lost");
            drop(lost);
            broker.restart();
            await_connected(&connection).await;
        }
    }
}

#[tokio::test]
async fn a_text_published_without_a_connection_is_never_sent() {
    let Some(mut broker) = Broker::start() else { return };
    let connection = connected(&broker).await;
    let mut trouble = connection.problem();
    broker.kill();
    let lost = tokio::time::timeout(PATIENCE, trouble.wait_for(Option::is_some)).await.map(drop);
    assert!(lost.is_ok(), "it is lost");
    let problem = connection.publish_text("door/set", "UNLOCK").expect_err("it is away");
    assert!(problem.starts_with("reach the broker: "), "{problem}");
    broker.restart();
    let (tell, told) = std::sync::mpsc::channel();
    let _door = broker.device("door/set", move |text| drop(tell.send(text.to_owned())));
    await_connected(&connection).await;
    connection.publish_text("door/set", "LOCK").expect("it is back");
    // The broker is awaited on another thread, because waiting must not block the connection.
    let first = tokio::task::spawn_blocking(move || told.recv_timeout(PATIENCE)).await;
    let first = first.expect("no panic").expect("the door hears");
    assert_eq!(first, "LOCK");
    let problem = connection.publish_text("door/+/set", "LOCK").expect_err("it is no topic");
    assert!(problem.contains("only for subscriptions"), "{problem}");
}
