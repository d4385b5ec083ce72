//! A substrate within one process: all daemons of the ecosystem are [`Inbound`]s in one map.
//!
//! Messages arrive on the sender's thread before `send` returns, in the order in which they were
//! sent. A test with paused time is therefore deterministic.

use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, PoisonError, Weak};
use std::time::Duration;

use acl::{AgentId, DaemonId, Incarnation, Performative};
use bytes::Bytes;
use tokio::sync::mpsc;

use crate::{
    AgentAddress, BoxFuture, Delivery, Destination, Inbound, OverhearCallback, OverhearToken,
    OverheardMessage, Presence, PresenceToken, ReceivedQuery, Resident, ResourceQuery, SendError,
    Subject, Substrate,
};

/// Maximum number of answers to one query that wait to be read; further answers are lost. A large
/// ecosystem has fewer agents, and each gives one answer.
pub const ANSWERS_MAX: usize = 4096;

/// The network of one ecosystem. Clones refer to the same network.
#[derive(Clone, Default)]
pub struct Network(Arc<Mutex<MemoryNetwork>>);

#[derive(Default)]
struct MemoryNetwork {
    daemons: BTreeMap<DaemonId, Arc<dyn Inbound>>,
    residents: BTreeMap<(AgentId, DaemonId), Incarnation>,
    /// Observers that are called with every message.
    taps: Vec<MessageObserver>,
    /// Listeners of agents, by a running number.
    listeners: BTreeMap<u64, OverhearCallback>,
    listeners_count: u64,
}

type MessageObserver = Arc<dyn Fn(&Destination, &Bytes) + Send + Sync>;

/// Connection of one daemon to the network.
struct Port {
    daemon: DaemonId,
    wire: Weak<Mutex<MemoryNetwork>>,
}

impl Network {
    /// Creates a network without daemons.
    pub fn new() -> Network {
        Network::default()
    }

    /// Connects a daemon; `inbound` is notified at once of all agents that are present. Returns the
    /// sending side of the daemon.
    pub fn open(&self, daemon: DaemonId, inbound: Arc<dyn Inbound>) -> Arc<dyn Substrate> {
        let here = self.with(|wire| {
            wire.daemons.insert(daemon.clone(), Arc::clone(&inbound));
            wire.residents()
        });
        for resident in here {
            inbound.presence(Presence::Joined(resident));
        }
        Arc::new(Port { daemon, wire: Arc::downgrade(&self.0) })
    }

    /// Disconnects a daemon as a SIGKILL of its process would: the daemon receives no more
    /// messages, and the other daemons see that all its agents have left.
    pub fn kill(&self, daemon: &DaemonId) {
        let gone = self.with(|wire| {
            wire.daemons.remove(daemon);
            let gone = wire.residents().into_iter().filter(|resident| resident.daemon == *daemon);
            gone.collect::<Vec<_>>()
        });
        for Resident { agent, daemon, incarnation } in gone {
            withdraw(&self.0, &agent, &daemon, incarnation);
        }
    }

    /// Calls `tap` with everything that is sent from now on, as a foreign tool on the network would
    /// receive it. Messages are delivered as before.
    pub fn tap(&self, tap: impl Fn(&Destination, &Bytes) + Send + Sync + 'static) {
        self.with(|wire| wire.taps.push(Arc::new(tap)));
    }

    fn with<T>(&self, act: impl FnOnce(&mut MemoryNetwork) -> T) -> T {
        act(&mut self.0.lock().unwrap_or_else(PoisonError::into_inner))
    }
}

// === impl MemoryNetwork ===

impl MemoryNetwork {
    fn residents(&self) -> Vec<Resident> {
        let resident = |((agent, daemon), incarnation): (&(AgentId, DaemonId), &Incarnation)| {
            Resident { agent: agent.clone(), daemon: daemon.clone(), incarnation: *incarnation }
        };
        self.residents.iter().map(resident).collect()
    }

    fn everyone(&self) -> Vec<Arc<dyn Inbound>> {
        self.daemons.values().cloned().collect()
    }
}

// === impl Port ===

impl Port {
    /// Runs `act` on the network, if this daemon is still connected; otherwise returns an error.
    fn with<T>(&self, act: impl FnOnce(&mut MemoryNetwork) -> T) -> Result<T, SendError> {
        let wire = self.wire.upgrade().ok_or(SendError::Closed)?;
        let mut wire = wire.lock().unwrap_or_else(PoisonError::into_inner);
        if !wire.daemons.contains_key(&self.daemon) {
            return Err(SendError::Closed);
        }
        Ok(act(&mut wire))
    }

    fn dispatch(
        &self,
        addressed: Destination,
        payload: Bytes,
        to: Option<&DaemonId>,
    ) -> Result<(), SendError> {
        let (receivers, taps, listeners) = self.with(|wire| {
            let receivers = match to {
                Some(daemon) => wire.daemons.get(daemon).cloned().into_iter().collect(),
                None => wire.everyone(),
            };
            let listeners: Vec<_> = wire.listeners.values().cloned().collect();
            (receivers, wire.taps.clone(), listeners)
        })?;
        // The lock is not held here, because a receiver may answer at once.
        for tap in taps {
            tap(&addressed, &payload);
        }
        if !matches!(addressed, Destination::To(_, Subject::Receipt)) {
            for listener in listeners {
                let (destination, payload) = (addressed.clone(), payload.clone());
                listener(OverheardMessage { destination, payload, origin: None });
            }
        }
        for receiver in receivers {
            let (addressed, payload) = (addressed.clone(), payload.clone());
            receiver.deliver(Delivery { destination: addressed, payload, origin: None });
        }
        Ok(())
    }
}

impl Substrate for Port {
    fn send(&self, to: &AgentAddress, subject: Subject, payload: Bytes) -> Result<(), SendError> {
        self.dispatch(Destination::To(to.agent.clone(), subject), payload, Some(&to.daemon))
    }

    fn broadcast(
        &self,
        sender: &AgentId,
        performative: Performative,
        payload: Bytes,
    ) -> Result<(), SendError> {
        self.dispatch(Destination::All(sender.clone(), performative), payload, None)
    }

    fn broadcast_state(&self, sender: &AgentId, payload: Bytes) -> Result<(), SendError> {
        self.dispatch(Destination::AgentState(sender.clone()), payload, None)
    }

    fn announce(
        &self,
        agent: &AgentId,
        incarnation: Incarnation,
    ) -> Result<PresenceToken, SendError> {
        let key = (agent.clone(), self.daemon.clone());
        let everyone = self.with(|wire| {
            wire.residents.insert(key.clone(), incarnation);
            wire.everyone()
        })?;
        let (agent, daemon) = key;
        let resident = Resident { agent: agent.clone(), daemon: daemon.clone(), incarnation };
        for inbound in everyone {
            inbound.presence(Presence::Joined(resident.clone()));
        }
        let wire = Weak::clone(&self.wire);
        Ok(PresenceToken::new(move || {
            if let Some(wire) = wire.upgrade() {
                withdraw(&wire, &agent, &daemon, incarnation);
            }
        }))
    }

    fn ask(&self, ask: ResourceQuery, timeout: Duration) -> BoxFuture<Vec<Bytes>> {
        let asked: Result<Vec<_>, _> = self.with(|wire| match &ask.daemon {
            Some(daemon) => wire.daemons.get(daemon).cloned().into_iter().collect(),
            None => wire.everyone(),
        });
        let (answers, heard) = mpsc::channel(ANSWERS_MAX);
        for inbound in asked.unwrap_or_default() {
            let answers = answers.clone();
            let answer = move |bytes| drop(answers.try_send(bytes));
            let ResourceQuery { resource, ref agent, .. } = ask;
            let answer = Arc::new(answer);
            inbound.receive_query(ReceivedQuery { resource, agent: agent.clone(), answer });
        }
        Box::pin(collect_answers(heard, timeout))
    }

    fn overhear(&self, listener: OverhearCallback) -> Result<OverhearToken, SendError> {
        let number = self.with(|wire| {
            wire.listeners_count += 1;
            wire.listeners.insert(wire.listeners_count, listener);
            wire.listeners_count
        })?;
        let wire = Weak::clone(&self.wire);
        Ok(OverhearToken::new(move || {
            if let Some(wire) = wire.upgrade() {
                Network(wire).with(|wire| wire.listeners.remove(&number));
            }
        }))
    }

    fn close(&self) -> BoxFuture<()> {
        if let Some(wire) = self.wire.upgrade() {
            Network(wire).kill(&self.daemon);
        }
        Box::pin(std::future::ready(()))
    }
}

/// Collects answers until every receiver of the question has dropped the question, or `timeout` has
/// passed.
pub async fn collect_answers(mut heard: mpsc::Receiver<Bytes>, timeout: Duration) -> Vec<Bytes> {
    let mut answers = Vec::new();
    let all = async {
        while let Some(answer) = heard.recv().await {
            answers.push(answer);
        }
    };
    // Late answers are lost; answers that came in time are kept.
    let _ = tokio::time::timeout(timeout, all).await;
    answers
}

fn withdraw(
    wire: &Mutex<MemoryNetwork>,
    agent: &AgentId,
    daemon: &DaemonId,
    incarnation: Incarnation,
) {
    let key = (agent.clone(), daemon.clone());
    let everyone = {
        let mut wire = wire.lock().unwrap_or_else(PoisonError::into_inner);
        if wire.residents.get(&key) != Some(&incarnation) {
            return;
        }
        wire.residents.remove(&key);
        wire.everyone()
    };
    let (agent, daemon) = key;
    for inbound in everyone {
        let (agent, daemon) = (agent.clone(), daemon.clone());
        inbound.presence(Presence::Left(Resident { agent, daemon, incarnation }));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Resource;
    use crate::recording_inbound::{RecordingInbound, agent, daemon};

    #[test]
    fn a_killed_daemon_receives_nothing_and_its_agents_leave() {
        let network = Network::new();
        let (a, b) = (RecordingInbound::new(), RecordingInbound::new());
        let port_a = network.open(daemon("a"), Arc::<RecordingInbound>::clone(&a) as _);
        let port_b = network.open(daemon("b"), Arc::<RecordingInbound>::clone(&b) as _);
        let _token = port_b.announce(&agent("robot"), Incarnation(1)).expect("open");
        assert_eq!(a.take_lines(), ["joined robot"]);

        network.kill(&daemon("b"));

        assert_eq!(a.take_lines(), ["left robot"]);
        assert_eq!(port_b.broadcast_state(&agent("robot"), Bytes::new()), Err(SendError::Closed));
        b.take_lines();
        port_a.broadcast(&agent("x"), Performative::Cfp, Bytes::new()).expect("open");
        assert_eq!(b.take_lines(), [""; 0]);
    }

    #[test]
    fn a_message_to_one_reaches_its_daemon_alone() {
        let network = Network::new();
        let (a, b) = (RecordingInbound::new(), RecordingInbound::new());
        let port = network.open(daemon("a"), Arc::<RecordingInbound>::clone(&a) as _);
        network.open(daemon("b"), Arc::<RecordingInbound>::clone(&b) as _);
        let to = AgentAddress { daemon: daemon("b"), agent: agent("robot") };
        port.send(&to, Subject::Receipt, Bytes::from_static(b"m1")).expect("open");
        assert_eq!(a.take_lines(), [""; 0]);
        assert_eq!(b.take_lines(), ["robot Receipt m1"]);
    }

    #[tokio::test]
    async fn every_queried_daemon_may_answer() {
        let network = Network::new();
        let port = network.open(daemon("a"), RecordingInbound::new());
        network.open(daemon("b"), RecordingInbound::new());
        let ask = ResourceQuery { daemon: None, resource: Resource::Domain, agent: None };
        let answers = port.ask(ask, Duration::from_secs(1)).await;
        assert_eq!(answers, [&b"domain"[..], b"domain"]);
    }

    #[test]
    fn a_listener_hears_the_messages_of_all_until_its_token_is_dropped() {
        let network = Network::new();
        let port_a = network.open(daemon("a"), RecordingInbound::new());
        let port_b = network.open(daemon("b"), RecordingInbound::new());
        let overheard = Arc::<Mutex<Vec<String>>>::default();
        let notes = Arc::clone(&overheard);
        let hear = move |message: OverheardMessage| {
            let text = String::from_utf8_lossy(&message.payload).into_owned();
            notes.lock().expect("no panic").push(text);
        };
        let token = port_b.overhear(Arc::new(hear)).expect("open");
        let to = AgentAddress { daemon: daemon("a"), agent: agent("robot") };
        let send = |subject, text: &str| {
            port_a.send(&to, subject, Bytes::from(text.to_owned())).expect("open");
        };
        send(Subject::Message(Performative::Request), "go");
        send(Subject::Receipt, "m1");
        port_b.broadcast_state(&agent("x"), Bytes::from_static(b"beat")).expect("open");
        drop(token);
        send(Subject::Message(Performative::Request), "later");
        assert_eq!(*overheard.lock().expect("no panic"), ["go", "beat"]);
    }
}
