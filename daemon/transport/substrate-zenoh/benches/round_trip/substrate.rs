//! The benchmark's echo over this crate alone, without agents.

use std::sync::Arc;

use acl::{AgentId, DaemonId, EcosystemId, Incarnation, Performative};
use bytes::Bytes;
use substrate::{AgentAddress, Delivery, Inbound, Presence, ReceivedQuery, Subject, Substrate};
use substrate_zenoh::{Config, ZenohSubstrate};
use tokio::sync::mpsc::{self, UnboundedReceiver, UnboundedSender};

use crate::{Asker, Error, Sizes};

/// Receiver that passes every message to a channel, and sends a notification when an agent joins.
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

    fn receive_query(&self, _: ReceivedQuery) {}
}

/// Opens two substrates that see each other: one asks, one answers. Returns the handle that makes
/// round trips, and the substrates.
pub(crate) async fn start(sizes: Sizes) -> Result<(Asker, [Arc<ZenohSubstrate>; 2]), Error> {
    let (a, heard, mut joined_a) = open("a", &[]).await?;
    let (b, asked, mut joined_b) = open("b", &a.locators()).await?;
    for (substrate, agent) in [(&a, "asker"), (&b, "echo")] {
        // Present until the process ends.
        std::mem::forget(substrate.announce(&AgentId::new(agent)?, Incarnation(1))?);
    }
    for joined in [&mut joined_a, &mut joined_b] {
        // Each sees itself and the other.
        joined.recv().await;
        joined.recv().await;
    }
    crate::echo(sender(&b, "a", "asker", Performative::Confirm)?, asked, sizes.reply);
    let ask = sender(&a, "b", "echo", Performative::Request)?;
    Ok((Asker::of_bytes(ask, heard, sizes.request), [a, b]))
}

fn sender(
    from: &Arc<ZenohSubstrate>,
    daemon: &str,
    agent: &str,
    performative: Performative,
) -> Result<impl Fn(Bytes) -> Result<(), Error> + Send + 'static, Error> {
    let to = AgentAddress { daemon: DaemonId::new(daemon)?, agent: AgentId::new(agent)? };
    let from = Arc::clone(from);
    let subject = Subject::Message(performative);
    Ok(move |payload| from.send(&to, subject, payload).map_err(Error::from))
}

type Opened = (Arc<ZenohSubstrate>, UnboundedReceiver<Bytes>, UnboundedReceiver<()>);

async fn open(name: &str, connect: &[String]) -> Result<Opened, Error> {
    let (messages, heard) = mpsc::unbounded_channel();
    let (joined, joins) = mpsc::unbounded_channel();
    let config = config("substrate", name, connect)?;
    Ok((config.open(Arc::new(Ear { messages, joined })).await?, heard, joins))
}

/// Returns the settings of a router that listens on this machine.
pub(crate) fn config(ecosystem: &str, daemon: &str, connect: &[String]) -> Result<Config, Error> {
    let mut config = Config::new(EcosystemId::new(ecosystem)?, DaemonId::new(daemon)?);
    config.listen = vec!["tcp/127.0.0.1:0".to_owned()];
    config.connect = connect.to_vec();
    Ok(config)
}
