//! What this crate adds to Zenoh: request and reply between two routers on this machine, each
//! message handed to a Tokio task through a channel, against the same over plain Zenoh.
//!
//! ```text
//! cargo run --release -p substrate-zenoh --example round_trip [ROUNDS]
//! ```

use std::sync::Arc;
use std::time::{Duration, Instant};

use acl::{AgentId, DaemonId, EcosystemId, Incarnation, Performative};
use bytes::Bytes;
use substrate::{Address, Delivery, Inbound, Presence, Question, Subject, Substrate};
use substrate_zenoh::{Config, ZenohSubstrate};
use tokio::sync::mpsc::{self, UnboundedReceiver, UnboundedSender};
use zenoh::pubsub::Publisher;
use zenoh::qos::{CongestionControl, Priority};
use zenoh::{Session, Wait};

type Error = Box<dyn std::error::Error + Send + Sync>;

/// As long as a short request.
const PAYLOAD_BYTES: usize = 300;
/// Both are measured in turns, so that a busy moment of the machine meets both.
const ROUND_TRIPS_PER_TURN: usize = 200;

const SUBJECT: Subject = Subject::Message(Performative::Request);

/// Hands every message to a channel, and tells when somebody joins.
struct Ear {
    messages: UnboundedSender<Bytes>,
    joined: UnboundedSender<()>,
}

impl Inbound for Ear {
    fn deliver(&self, delivery: Delivery) {
        let _ = self.messages.send(delivery.payload);
    }

    fn presence(&self, _: Presence) {
        let _ = self.joined.send(());
    }

    fn question(&self, _: Question) {}
}

/// One end: how to send to the other, and what comes from it.
struct End<S> {
    send: S,
    heard: UnboundedReceiver<Bytes>,
}

#[tokio::main]
async fn main() -> Result<(), Error> {
    let rounds = std::env::args().nth(1).map_or(Ok(50), |text| text.parse())?;
    let (mut ours, _substrates) = ours().await?;
    let (mut plain, _sessions) = plain().await?;
    let (mut ours_taken, mut plain_taken) = (Vec::new(), Vec::new());
    for _ in 0..rounds {
        turn(&mut plain, &mut plain_taken).await?;
        turn(&mut ours, &mut ours_taken).await?;
    }
    let (ours, plain) = (Figures::of(ours_taken), Figures::of(plain_taken));
    println!("round trips {}, payload {PAYLOAD_BYTES} B", rounds * ROUND_TRIPS_PER_TURN);
    println!("plain Zenoh     p50 {:>9.1?}  p99 {:>9.1?}", plain.p50, plain.p99);
    println!("substrate-zenoh p50 {:>9.1?}  p99 {:>9.1?}", ours.p50, ours.p99);
    let ratio = |ours: Duration, plain: Duration| ours.as_secs_f64() / plain.as_secs_f64();
    let (p50, p99) = (ratio(ours.p50, plain.p50), ratio(ours.p99, plain.p99));
    println!("ratio           p50 {p50:>9.2}  p99 {p99:>9.2}");
    Ok(())
}

async fn turn<S>(end: &mut End<S>, taken: &mut Vec<Duration>) -> Result<(), Error>
where
    S: Fn(Bytes) -> Result<(), Error>,
{
    let payload = Bytes::from(vec![7; PAYLOAD_BYTES]);
    for _ in 0..ROUND_TRIPS_PER_TURN {
        let start = Instant::now();
        (end.send)(payload.clone())?;
        end.heard.recv().await.ok_or("the session closed")?;
        taken.push(start.elapsed());
    }
    Ok(())
}

struct Figures {
    p50: Duration,
    p99: Duration,
}

impl Figures {
    fn of(mut taken: Vec<Duration>) -> Figures {
        taken.sort_unstable();
        Figures { p50: taken[taken.len() / 2], p99: taken[taken.len() * 99 / 100] }
    }
}

// === ours ===

async fn ours()
-> Result<(End<impl Fn(Bytes) -> Result<(), Error>>, Vec<Arc<ZenohSubstrate>>), Error> {
    let (a, heard, mut joined_a) = open("a", &[]).await?;
    let (b, mut asked, mut joined_b) = open("b", &a.locators()).await?;
    let x = AgentId::new("x")?;
    for substrate in [&a, &b] {
        std::mem::forget(substrate.announce(&x, Incarnation(1))?);
    }
    for joined in [&mut joined_a, &mut joined_b] {
        // Each sees itself and the other.
        joined.recv().await;
        joined.recv().await;
    }
    let to = |daemon| Ok::<_, Error>(Address { daemon: DaemonId::new(daemon)?, agent: x.clone() });
    let (to_a, to_b) = (to("a")?, to("b")?);
    let echo = Arc::clone(&b);
    tokio::spawn(async move {
        while let Some(payload) = asked.recv().await {
            if let Err(error) = echo.send(&to_a, SUBJECT, payload) {
                eprintln!("{error}");
            }
        }
    });
    let asker = Arc::clone(&a);
    let send = move |payload| asker.send(&to_b, SUBJECT, payload).map_err(Error::from);
    Ok((End { send, heard }, vec![a, b]))
}

type Opened = (Arc<ZenohSubstrate>, UnboundedReceiver<Bytes>, UnboundedReceiver<()>);

async fn open(name: &str, connect: &[String]) -> Result<Opened, Error> {
    let (messages, heard) = mpsc::unbounded_channel();
    let (joined, joins) = mpsc::unbounded_channel();
    let mut config = Config::new(EcosystemId::new("office")?, DaemonId::new(name)?);
    config.listen = vec!["tcp/127.0.0.1:0".to_owned()];
    config.connect = connect.to_vec();
    Ok((config.open(Arc::new(Ear { messages, joined })).await?, heard, joins))
}

// === plain Zenoh ===

async fn plain() -> Result<(End<impl Fn(Bytes) -> Result<(), Error>>, Vec<Session>), Error> {
    let a = plain_session(&[]).await?;
    let locators: Vec<String> = a.info().locators().await.iter().map(ToString::to_string).collect();
    let b = plain_session(&locators).await?;
    let heard = plain_inbox(&a, "plain/a")?;
    let mut asked = plain_inbox(&b, "plain/b")?;
    let (to_b, to_a) = (plain_publisher(&a, "plain/b")?, plain_publisher(&b, "plain/a")?);
    while !(to_b.matching_status().await?.matching() && to_a.matching_status().await?.matching()) {
        tokio::task::yield_now().await;
    }
    // The route follows within 100 ms of the match; until then messages are lost.
    tokio::time::sleep(Duration::from_millis(300)).await;
    tokio::spawn(async move {
        while let Some(payload) = asked.recv().await {
            if let Err(error) = to_a.put(payload).wait() {
                eprintln!("{error}");
            }
        }
    });
    Ok((End { send: move |payload: Bytes| to_b.put(payload).wait(), heard }, vec![a, b]))
}

async fn plain_session(connect: &[String]) -> zenoh::Result<Session> {
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

fn plain_publisher(session: &Session, key: &'static str) -> zenoh::Result<Publisher<'static>> {
    let publisher = session.declare_publisher(key).congestion_control(CongestionControl::Drop);
    publisher.priority(Priority::DataHigh).express(true).wait()
}

fn plain_inbox(session: &Session, key: &str) -> zenoh::Result<UnboundedReceiver<Bytes>> {
    let (sender, heard) = mpsc::unbounded_channel();
    let deliver = move |sample: zenoh::sample::Sample| {
        let _ = sender.send(Bytes::from(sample.payload().to_bytes().into_owned()));
    };
    session.declare_subscriber(key).callback(deliver).background().wait()?;
    Ok(heard)
}
