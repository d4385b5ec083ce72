//! State of the faulty network: which links are broken, which items are on their way, and which
//! agents each daemon sees as present.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;
use std::time::Duration;

use acl::{AgentId, DaemonId, Incarnation};
use bytes::Bytes;
use fastrand::Rng;
use tokio::sync::mpsc;
use tokio::time::Instant;

use super::{CutId, LinkConditions, MessageCounts, SendObserver, UNDER_WAY_MAX};
use crate::{
    Delivery, Inbound, OverhearCallback, OverheardMessage, Presence, ReceivedQuery, Resident,
};

/// The state of all links and daemons.
pub(super) struct NetworkState {
    pub(super) rng: Rng,
    pub(super) conditions: LinkConditions,
    pub(super) daemons: BTreeMap<DaemonId, ConnectedDaemon>,
    pub(super) connections_count: u64,
    pub(super) residents: BTreeMap<(AgentId, DaemonId), Incarnation>,
    pub(super) cuts: BTreeMap<CutId, IsolatedDaemons>,
    pub(super) cuts_count: u64,
    pub(super) slow: BTreeMap<DaemonId, Duration>,
    /// Items on their way, with their destinations, by their time of arrival and a running number.
    pub(super) due: BTreeMap<(Instant, u64), (ConnectionId, InFlight)>,
    pub(super) due_count: u64,
    /// Time at which the last message of each link arrives; a link is a sending and a receiving
    /// daemon. Later messages of the link arrive later, unless they overtake it.
    pub(super) last: BTreeMap<(DaemonId, DaemonId), Instant>,
    pub(super) tap: Option<SendObserver>,
    /// Listeners of agents, each with the daemon that hosts the agent, by a running number.
    pub(super) listeners: BTreeMap<u64, (DaemonId, OverhearCallback)>,
    pub(super) listeners_count: u64,
    pub(super) counts: MessageCounts,
}

/// One connection of a daemon to the network.
pub(super) struct ConnectedDaemon {
    pub(super) inbound: Arc<dyn Inbound>,
    pub(super) number: u64,
    /// Agents that the daemon sees as present.
    pub(super) sees: BTreeSet<Resident>,
    pub(super) under_way: usize,
}

/// Daemons that a cut separates: their links to all other daemons are broken.
pub(super) struct IsolatedDaemons {
    pub(super) daemons: BTreeSet<DaemonId>,
    /// Time at which the daemons at the ends of the broken links detect the break.
    pub(super) lease: Instant,
    /// Number of messages lost because of the broken links.
    pub(super) stopped: u64,
}

/// Identifier of one connection of one daemon. A daemon that connects again gets a new number.
#[derive(Clone, PartialEq)]
pub(super) struct ConnectionId {
    pub(super) daemon: DaemonId,
    pub(super) number: u64,
}

/// Message or other event on its way to a daemon.
pub(super) enum InFlight {
    Message(Delivery),
    /// A message for the listener with this number.
    Overheard(u64, OverheardMessage),
    Presence(Presence),
    Question(ReceivedQuery),
    /// An answer, on its way to the daemon that asked.
    Answer(mpsc::Sender<Bytes>, Bytes),
    /// Stands for a question or answer that was lost. It holds the reply channel of the asking
    /// daemon open until the deadline of the question. The asking daemon then waits that long, as
    /// in a real network, instead of seeing a closed channel at once.
    LostReply(#[expect(dead_code, reason = "held, so that the asker waits")] mpsc::Sender<Bytes>),
    /// The lease of broken links has passed: the daemon must check which agents it still sees as
    /// present.
    RefreshPresence,
}

// === impl NetworkState ===

impl NetworkState {
    /// Creates a network without daemons, with good links.
    pub(super) fn new(seed: u64) -> NetworkState {
        NetworkState {
            rng: Rng::with_seed(seed),
            conditions: LinkConditions::good(),
            daemons: BTreeMap::new(),
            connections_count: 0,
            residents: BTreeMap::new(),
            cuts: BTreeMap::new(),
            cuts_count: 0,
            slow: BTreeMap::new(),
            due: BTreeMap::new(),
            due_count: 0,
            last: BTreeMap::new(),
            tap: None,
            listeners: BTreeMap::new(),
            listeners_count: 0,
            counts: MessageCounts::default(),
        }
    }

    /// Schedules a message or another event for a daemon at the time `at`, after all that are due
    /// at the same time.
    pub(super) fn schedule(&mut self, at: Instant, daemon: &DaemonId, coming: InFlight) {
        let Some(connected) = self.daemons.get_mut(daemon) else { return };
        if connected.under_way >= UNDER_WAY_MAX {
            self.counts.lost += 1;
            return;
        }
        connected.under_way += 1;
        self.due_count += 1;
        let target = ConnectionId { daemon: daemon.clone(), number: connected.number };
        self.due.insert((at, self.due_count), (target, coming));
    }

    /// Sends one item over a link. Depending on the quality of the link, the item may be lost,
    /// delayed, delivered twice or overtaken. If it is lost, returns it as the error.
    pub(super) fn send(
        &mut self,
        from: &DaemonId,
        to: &DaemonId,
        coming: InFlight,
    ) -> Result<(), InFlight> {
        self.counts.sent += 1;
        if from == to {
            self.schedule(Instant::now(), to, coming);
            return Ok(());
        }
        if self.is_cut(from, to) {
            self.counts.cut += 1;
            return Err(coming);
        }
        if self.once_in(self.conditions.loss) {
            self.counts.lost += 1;
            return Err(coming);
        }
        let at = self.arrival(from, to);
        if self.once_in(self.conditions.doubled)
            && let InFlight::Message(delivery) = &coming
        {
            self.counts.doubled += 1;
            let (again, copy) = (self.arrival(from, to), InFlight::Message(delivery.clone()));
            self.schedule(again, to, copy);
        }
        self.schedule(at, to, coming);
        Ok(())
    }

    /// Returns the time at which a message that is sent now arrives.
    fn arrival(&mut self, from: &DaemonId, to: &DaemonId) -> Instant {
        let (delay, slow) = self.sample_delay(to);
        if self.once_in(self.conditions.overtaken) {
            self.counts.overtaken += 1;
            return Instant::now() + delay + slow + delay * 4;
        }
        self.in_order(from, to, Instant::now() + delay + slow)
    }

    /// Returns how long the next item to a daemon is under way, and how much longer if the daemon
    /// reads slowly.
    fn sample_delay(&mut self, to: &DaemonId) -> (Duration, Duration) {
        let micros = self.rng.u64(self.conditions.delay.clone());
        let (delay, slow) = (Duration::from_micros(micros), self.slow.get(to).copied());
        self.counts.delayed += u64::from(micros >= LinkConditions::good().delay.end);
        self.counts.slowed += u64::from(slow.is_some());
        (delay, slow.unwrap_or_default())
    }

    /// Returns the time of arrival `at`, or that of the last message on the link if that is later,
    /// so that messages keep their order.
    fn in_order(&mut self, from: &DaemonId, to: &DaemonId, at: Instant) -> Instant {
        let last = self.last.entry((from.clone(), to.clone())).or_insert(at);
        *last = at.max(*last);
        *last
    }

    /// Whether a link is broken. If so, counts one stopped message for each cut that breaks the
    /// link.
    fn is_cut(&mut self, a: &DaemonId, b: &DaemonId) -> bool {
        let breaks =
            |cut: &&mut IsolatedDaemons| cut.daemons.contains(a) != cut.daemons.contains(b);
        let stopping = self.cuts.values_mut().filter(breaks);
        stopping.map(|cut| cut.stopped += 1).count() > 0
    }

    /// Returns the time at which the daemons at the ends of a link detect that it is broken; `None`
    /// if the link is not broken.
    fn broken_since(&self, a: &DaemonId, b: &DaemonId) -> Option<Instant> {
        let between =
            self.cuts.values().filter(|cut| cut.daemons.contains(a) != cut.daemons.contains(b));
        between.map(|cut| cut.lease).min()
    }

    fn once_in(&mut self, share: f64) -> bool {
        share > 0.0 && self.rng.f64() < share
    }

    pub(super) fn refresh_all(&mut self) {
        let daemons: Vec<_> = self.daemons.keys().cloned().collect();
        daemons.iter().for_each(|daemon| self.refresh_presence(daemon));
    }

    /// Notifies a daemon of the agents that it sees now and did not see before, and of the agents
    /// that it saw before and does not see now.
    pub(super) fn refresh_presence(&mut self, daemon: &DaemonId) {
        let now = Instant::now();
        let is_seen =
            |host: &DaemonId| self.broken_since(daemon, host).is_none_or(|lease| lease > now);
        let mut here = BTreeSet::new();
        for ((agent, host), incarnation) in &self.residents {
            if is_seen(host) {
                let (agent, daemon) = (agent.clone(), host.clone());
                here.insert(Resident { agent, daemon, incarnation: *incarnation });
            }
        }
        let Some(connected) = self.daemons.get_mut(daemon) else { return };
        let seen = std::mem::replace(&mut connected.sees, here.clone());
        let left = seen.difference(&here).cloned().map(Presence::Left);
        let joined = here.difference(&seen).cloned().map(Presence::Joined);
        for presence in left.chain(joined).collect::<Vec<_>>() {
            let host = presence.resident().daemon.clone();
            // Presence is never overtaken, because no later message would correct a `Left` that
            // arrived after a newer `Joined`.
            let (delay, slow) = self.sample_delay(daemon);
            let at = now + delay + slow;
            let at = if host == *daemon { now } else { self.in_order(&host, daemon, at) };
            self.schedule(at, daemon, InFlight::Presence(presence));
        }
    }
}
