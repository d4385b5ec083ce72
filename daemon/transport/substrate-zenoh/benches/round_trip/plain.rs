//! The benchmark's baseline: an echo over plain Zenoh, with the key layout of Althing's messages.

use std::time::Duration;

use bytes::Bytes;
use tokio::sync::mpsc::{self, UnboundedReceiver};
use zenoh::pubsub::Publisher;
use zenoh::qos::{CongestionControl, Priority};
use zenoh::{Session, Wait};

use crate::{Asker, Error, Sizes};

/// Opens two sessions that have each other's subscriptions: one asks, one answers. Returns the
/// handle that makes round trips, and the sessions.
pub(crate) async fn start(sizes: Sizes) -> Result<(Asker, [Session; 2]), Error> {
    let a = session(&[]).await?;
    let locators: Vec<String> = a.info().locators().await.iter().map(ToString::to_string).collect();
    let b = session(&locators).await?;
    let (heard, asked) = (inbox(&a, "a")?, inbox(&b, "b")?);
    let to_b = publisher(&a, "althing/plain/in/b/echo/request")?;
    let to_a = publisher(&b, "althing/plain/in/a/asker/confirm")?;
    while !(to_b.matching_status().await?.matching() && to_a.matching_status().await?.matching()) {
        tokio::task::yield_now().await;
    }
    // The route follows within 100 ms of the match; until then messages are lost.
    tokio::time::sleep(Duration::from_millis(300)).await;
    crate::echo(move |payload| to_a.put(payload).wait(), asked, sizes.reply);
    let ask = move |payload: Bytes| to_b.put(payload).wait();
    Ok((Asker::of_bytes(ask, heard, sizes.request), [a, b]))
}

async fn session(connect: &[String]) -> Result<Session, Error> {
    let mut config = zenoh::Config::default();
    for (key, value) in [
        ("mode", "\"router\"".to_owned()),
        ("scouting/multicast/enabled", "false".to_owned()),
        ("scouting/gossip/enabled", "false".to_owned()),
        ("scouting/delay", "0".to_owned()),
        ("timestamping/enabled", "false".to_owned()),
        ("listen/endpoints", "[\"tcp/127.0.0.1:0\"]".to_owned()),
        ("connect/endpoints", serde_json::to_string(connect)?),
    ] {
        config.insert_json5(key, &value)?;
    }
    zenoh::open(config).await
}

fn publisher(session: &Session, key: &'static str) -> Result<Publisher<'static>, Error> {
    let publisher = session.declare_publisher(key).congestion_control(CongestionControl::Drop);
    publisher.priority(Priority::DataHigh).express(true).wait()
}

fn inbox(session: &Session, daemon: &str) -> Result<UnboundedReceiver<Bytes>, Error> {
    let (sender, heard) = mpsc::unbounded_channel();
    let deliver = move |sample: zenoh::sample::Sample| {
        let _ = sender.send(Bytes::from(sample.payload().to_bytes().into_owned()));
    };
    let key_expr = format!("althing/plain/in/{daemon}/**");
    session.declare_subscriber(key_expr).callback(deliver).background().wait()?;
    Ok(heard)
}
