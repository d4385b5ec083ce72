//! A substrate within one process with bad links: messages may be lost, doubled, delayed or
//! overtaken by later ones; links break and are mended; processes die. The seed alone decides what
//! happens, as long as one thread does everything and time is simulated.
//!
//! - A broken link at once loses everything that is sent over it. The daemons at its ends see that
//!   the agents behind the link are gone after the lease, as on a real network, or at once if the
//!   connection was reset.
//! - Messages of a daemon to itself never leave the process and are never lost.
//! - A daemon that reads slowly receives everything late. At most [`UNDER_WAY_MAX`] messages wait
//!   for that daemon.

mod network_state;

use std::collections::BTreeSet;
use std::ops::Range;
use std::sync::{Arc, Mutex, PoisonError, Weak};
use std::time::Duration;

use acl::{AgentId, DaemonId, Incarnation, Performative};
use bytes::Bytes;
use tokio::sync::{Notify, mpsc};
use tokio::time::Instant;

use self::network_state::{ConnectedDaemon, ConnectionId, InFlight, IsolatedDaemons, NetworkState};
use crate::memory::{ANSWERS_MAX, collect_answers};
use crate::{
    AgentAddress, BoxFuture, Delivery, Destination, Inbound, OverhearCallback, OverhearToken,
    OverheardMessage, PresenceToken, ReceivedQuery, ResourceQuery, SendError, Subject, Substrate,
};

/// Maximum number of messages under way to one daemon. Further messages are lost, as on a network
/// that must not block.
pub const UNDER_WAY_MAX: usize = 20_000;

/// Quality of the links between daemons: losses, duplicates, order and delay.
#[derive(Clone, Debug, PartialEq)]
pub struct LinkConditions {
    /// Share of messages that are lost, from 0 to 1.
    pub loss: f64,
    /// Share of messages that arrive twice, from 0 to 1.
    pub doubled: f64,
    /// Share of messages that are overtaken by later ones, from 0 to 1.
    pub overtaken: f64,
    /// Range of the time that a message is under way, in microseconds.
    pub delay: Range<u64>,
}

/// The network of one ecosystem, with faults. Clones refer to the same network.
#[derive(Clone)]
pub struct Network(Arc<SharedNetwork>);

struct SharedNetwork {
    wire: Mutex<NetworkState>,
    /// Wakes the delivery task when a message or another event is due earlier than all events
    /// before.
    sooner: Notify,
}

/// Identifier of a cut: the breaking of the links between some daemons and all others.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct CutId(u64);

/// Observer that is called with everything that is sent, and with the daemon that sends it.
type SendObserver = Arc<dyn Fn(&DaemonId, &Destination, &Bytes) + Send + Sync>;

/// Numbers of messages so far, by what happened to them.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct MessageCounts {
    /// Messages that were sent.
    pub sent: u64,
    /// Messages lost because of the link quality, or because too many were under way.
    pub lost: u64,
    /// Messages lost because a cut had broken the link.
    pub cut: u64,
    /// Messages that arrived twice.
    pub doubled: u64,
    /// Messages that arrived after later ones.
    pub overtaken: u64,
    /// Messages that took longer than any message does on good links.
    pub delayed: u64,
    /// Messages that arrived late because their receiver reads slowly.
    pub slowed: u64,
}

/// Connection of one daemon to the network.
struct Port {
    target: ConnectionId,
    shared: Weak<SharedNetwork>,
}

// === impl LinkConditions ===

impl LinkConditions {
    /// Returns the quality of links in a building: nothing is lost, and a message takes 0.1 to 2
    /// milliseconds.
    pub fn good() -> LinkConditions {
        LinkConditions { loss: 0.0, doubled: 0.0, overtaken: 0.0, delay: 100..2_000 }
    }
}

// === impl Network ===

impl Network {
    /// Creates a network without daemons, with good links. A task of the present runtime delivers
    /// the messages.
    pub fn new(seed: u64) -> Network {
        let shared = Arc::new(SharedNetwork {
            wire: Mutex::new(NetworkState::new(seed)),
            sooner: Notify::new(),
        });
        tokio::spawn(run_deliveries(Arc::downgrade(&shared)));
        Network(shared)
    }

    /// Connects a daemon; `inbound` receives what is sent to it. Returns the sending side of the
    /// daemon.
    pub fn open(&self, daemon: DaemonId, inbound: Arc<dyn Inbound>) -> Arc<dyn Substrate> {
        let number = self.0.with(|wire| {
            wire.connections_count += 1;
            let number = wire.connections_count;
            let connected =
                ConnectedDaemon { inbound, number, sees: BTreeSet::new(), under_way: 0 };
            wire.daemons.insert(daemon.clone(), connected);
            wire.refresh_presence(&daemon);
            number
        });
        Arc::new(Port { target: ConnectionId { daemon, number }, shared: Arc::downgrade(&self.0) })
    }

    /// Disconnects a daemon as a SIGKILL of its process would: messages under way to the daemon are
    /// lost, and the other daemons see at once that its agents have left.
    pub fn kill(&self, daemon: &DaemonId) {
        self.0.with(|wire| {
            wire.daemons.remove(daemon);
            wire.residents.retain(|(_, host), _| host != daemon);
            wire.refresh_all();
        });
    }

    /// Breaks the links between these daemons and all others. The daemons at the ends of the links
    /// detect the break after the time `lease`.
    pub fn cut(&self, daemons: BTreeSet<DaemonId>, lease: Duration) -> CutId {
        self.0.with(|wire| {
            wire.cuts_count += 1;
            let cut = CutId(wire.cuts_count);
            let lease = Instant::now() + lease;
            wire.cuts.insert(cut, IsolatedDaemons { daemons, lease, stopped: 0 });
            let ends: Vec<_> = wire.daemons.keys().cloned().collect();
            ends.iter().for_each(|end| wire.schedule(lease, end, InFlight::RefreshPresence));
            cut
        })
    }

    /// Mends the links that a cut broke, except those that another cut broke too. Returns the
    /// number of messages that were lost because of the cut.
    pub fn heal(&self, cut: CutId) -> u64 {
        self.0.with(|wire| {
            let stopped = wire.cuts.remove(&cut).map_or(0, |island| island.stopped);
            wire.refresh_all();
            stopped
        })
    }

    /// Delays everything that a daemon receives by the time `by`; zero ends the delay.
    pub fn delay_receiver(&self, daemon: &DaemonId, by: Duration) {
        self.0.with(|wire| {
            if by.is_zero() {
                wire.slow.remove(daemon)
            } else {
                wire.slow.insert(daemon.clone(), by)
            }
        });
    }

    /// Sets the quality of all links.
    pub fn set_conditions(&self, weather: LinkConditions) {
        self.0.with(|wire| wire.conditions = weather);
    }

    /// Calls `tap` with everything that is sent from now on, including what is lost. Messages are
    /// delivered as before.
    pub fn tap(&self, tap: impl Fn(&DaemonId, &Destination, &Bytes) + Send + Sync + 'static) {
        self.0.with(|wire| wire.tap = Some(Arc::new(tap)));
    }

    /// Returns the numbers of messages so far, by what happened to them.
    pub fn counts(&self) -> MessageCounts {
        self.0.with(|wire| wire.counts)
    }
}

/// Interval at which a network without messages checks whether it is still in use.
const USE_CHECK_INTERVAL: Duration = Duration::from_secs(1);

/// Delivers each message or other event at the time at which it is due, as long as the network is
/// in use.
async fn run_deliveries(shared: Weak<SharedNetwork>) {
    loop {
        let Some(held) = shared.upgrade() else { return };
        let next = held.with(|wire| wire.due.keys().next().map(|(due, _)| *due));
        let sooner = held.sooner.notified();
        match next {
            Some(due) if due > Instant::now() => {
                // The wait is bounded, so that a network that is no longer in use is released.
                tokio::select! {
                    biased;
                    () = sooner => (),
                    () = tokio::time::sleep_until(due) => (),
                }
            }
            Some(_) => held.deliver_next(),
            None => {
                let _ = tokio::time::timeout(USE_CHECK_INTERVAL, sooner).await;
            }
        }
    }
}

// === impl SharedNetwork ===

impl SharedNetwork {
    fn with<T>(&self, act: impl FnOnce(&mut NetworkState) -> T) -> T {
        let mut wire = self.wire.lock().unwrap_or_else(PoisonError::into_inner);
        let first = wire.due.keys().next().copied();
        let acted = act(&mut wire);
        if wire.due.keys().next().copied() != first {
            self.sooner.notify_one();
        }
        acted
    }

    fn deliver_next(self: &Arc<Self>) {
        let (inbound, coming, listener) = {
            let mut wire = self.wire.lock().unwrap_or_else(PoisonError::into_inner);
            let Some((_, (target, coming))) = wire.due.pop_first() else { return };
            let Some(connected) = wire.daemons.get_mut(&target.daemon) else { return };
            if connected.number != target.number {
                return;
            }
            connected.under_way = connected.under_way.saturating_sub(1);
            if let InFlight::RefreshPresence = coming {
                return wire.refresh_presence(&target.daemon);
            }
            let inbound = Arc::clone(&connected.inbound);
            let listener = match &coming {
                InFlight::Overheard(number, _) => wire.listeners.get(number),
                _ => None,
            };
            let listener = listener.map(|(_, listener)| Arc::clone(listener));
            (inbound, coming, listener)
        };
        // The lock is not held here, because a receiver may answer at once.
        match coming {
            InFlight::Message(delivery) => inbound.deliver(delivery),
            InFlight::Overheard(_, message) => {
                if let Some(listener) = listener {
                    listener(message);
                }
            }
            InFlight::Presence(presence) => inbound.presence(presence),
            InFlight::Question(question) => inbound.receive_query(question),
            InFlight::Answer(answers, payload) => drop(answers.try_send(payload)),
            InFlight::LostReply(_) | InFlight::RefreshPresence => (),
        }
    }
}

// === impl Port ===

impl Port {
    /// Runs `act` on the network, if this connection of the daemon still exists; otherwise returns
    /// an error.
    fn with<T>(&self, act: impl FnOnce(&mut NetworkState) -> T) -> Result<T, SendError> {
        let shared = self.shared.upgrade().ok_or(SendError::Closed)?;
        shared.with(|wire| {
            let connected = wire.daemons.get(&self.target.daemon);
            match connected.is_some_and(|connected| connected.number == self.target.number) {
                true => Ok(act(wire)),
                false => Err(SendError::Closed),
            }
        })
    }

    fn submit(
        &self,
        addressed: Destination,
        payload: Bytes,
        to: Option<&DaemonId>,
    ) -> Result<(), SendError> {
        let from = &self.target.daemon;
        let tap = self.with(|wire| {
            let to: Vec<_> = match to {
                Some(to) => vec![to.clone()],
                None => wire.daemons.keys().cloned().collect(),
            };
            for to in to {
                let (addressed, payload) = (addressed.clone(), payload.clone());
                let delivery = Delivery { destination: addressed, payload, origin: None };
                let _ = wire.send(from, &to, InFlight::Message(delivery));
            }
            if !matches!(addressed, Destination::To(_, Subject::Receipt)) {
                let listeners: Vec<_> =
                    wire.listeners.iter().map(|(n, (at, _))| (*n, at.clone())).collect();
                for (number, at) in listeners {
                    let (destination, payload) = (addressed.clone(), payload.clone());
                    let message = OverheardMessage { destination, payload, origin: None };
                    let _ = wire.send(from, &at, InFlight::Overheard(number, message));
                }
            }
            wire.tap.clone()
        })?;
        if let Some(tap) = tap {
            tap(from, &addressed, &payload);
        }
        Ok(())
    }
}

impl Substrate for Port {
    fn send(&self, to: &AgentAddress, subject: Subject, payload: Bytes) -> Result<(), SendError> {
        self.submit(Destination::To(to.agent.clone(), subject), payload, Some(&to.daemon))
    }

    fn broadcast(
        &self,
        sender: &AgentId,
        performative: Performative,
        payload: Bytes,
    ) -> Result<(), SendError> {
        self.submit(Destination::All(sender.clone(), performative), payload, None)
    }

    fn broadcast_state(&self, sender: &AgentId, payload: Bytes) -> Result<(), SendError> {
        self.submit(Destination::AgentState(sender.clone()), payload, None)
    }

    fn announce(
        &self,
        agent: &AgentId,
        incarnation: Incarnation,
    ) -> Result<PresenceToken, SendError> {
        let key = (agent.clone(), self.target.daemon.clone());
        self.with(|wire| {
            wire.residents.insert(key.clone(), incarnation);
            wire.refresh_all();
        })?;
        let shared = Weak::clone(&self.shared);
        Ok(PresenceToken::new(move || {
            let Some(shared) = shared.upgrade() else { return };
            shared.with(|wire| {
                if wire.residents.get(&key) == Some(&incarnation) {
                    wire.residents.remove(&key);
                    wire.refresh_all();
                }
            });
        }))
    }

    fn ask(&self, ask: ResourceQuery, timeout: Duration) -> BoxFuture<Vec<Bytes>> {
        let (answers, heard) = mpsc::channel(ANSWERS_MAX);
        let asker = self.target.clone();
        let shared = Weak::clone(&self.shared);
        let _ = self.with(|wire| {
            let asked: Vec<_> = match &ask.daemon {
                Some(daemon) => vec![daemon.clone()],
                None => wire.daemons.keys().cloned().collect(),
            };
            for daemon in asked {
                if !wire.daemons.contains_key(&daemon) {
                    continue;
                }
                let (from, shared, asker) = (daemon.clone(), Weak::clone(&shared), asker.clone());
                let back = answers.clone();
                let answer = Arc::new(move |payload| {
                    return_answer(&shared, &from, &asker, back.clone(), payload, timeout);
                });
                let ResourceQuery { resource, ref agent, .. } = ask;
                let question = ReceivedQuery { resource, agent: agent.clone(), answer };
                if wire.send(&self.target.daemon, &daemon, InFlight::Question(question)).is_err() {
                    let nothing = InFlight::LostReply(answers.clone());
                    wire.schedule(Instant::now() + timeout, &self.target.daemon, nothing);
                }
            }
        });
        drop(answers);
        Box::pin(collect_answers(heard, timeout))
    }

    fn overhear(&self, listener: OverhearCallback) -> Result<OverhearToken, SendError> {
        let daemon = self.target.daemon.clone();
        let number = self.with(|wire| {
            wire.listeners_count += 1;
            wire.listeners.insert(wire.listeners_count, (daemon, listener));
            wire.listeners_count
        })?;
        let shared = Weak::clone(&self.shared);
        Ok(OverhearToken::new(move || {
            if let Some(shared) = shared.upgrade() {
                shared.with(|wire| wire.listeners.remove(&number));
            }
        }))
    }

    fn close(&self) -> BoxFuture<()> {
        if let Some(shared) = self.shared.upgrade()
            && self.with(|_| ()).is_ok()
        {
            Network(shared).kill(&self.target.daemon);
        }
        Box::pin(std::future::ready(()))
    }
}

/// Sends an answer to the daemon that asked. If the answer is lost, that daemon waits until
/// `timeout`.
fn return_answer(
    shared: &Weak<SharedNetwork>,
    from: &DaemonId,
    asker: &ConnectionId,
    answers: mpsc::Sender<Bytes>,
    payload: Bytes,
    timeout: Duration,
) {
    let Some(shared) = shared.upgrade() else { return };
    shared.with(|wire| {
        let answer = InFlight::Answer(answers, payload);
        if let Err(InFlight::Answer(answers, _)) = wire.send(from, &asker.daemon, answer) {
            wire.schedule(Instant::now() + timeout, &asker.daemon, InFlight::LostReply(answers));
        }
    });
}

#[cfg(test)]
mod tests;
