//! The shared domain: a domain model that the actuators of one daemon share.
//!
//! Every actuator plans with the messages that it has received itself (the paper, “Decentralized
//! Planning”). The actuators of one daemon receive the same messages, so the daemon reads and
//! stores them once. Each actuator filters the shared model by what it may see itself
//! ([`Maintainer::snapshot_for`]). So memory grows with the number of agents, not with its square.
//! A Domain Maintainer of the same daemon reuses the models that were parsed here.
//!
//! - The shared domain receives broadcasts before the daemon's mailboxes do. An agent that gets a
//!   call for proposals then knows everything that was broadcast before the call.
//! - The substrate's threads call this module, so no function here blocks. Overdue expiries are
//!   applied on each access. A reader keeps the state that it took; later changes are written into
//!   a copy.
//! - Broadcasts from before the first actuator started are read when their sender sends again, or
//!   on the first access to the model. Reading a thousand models at once would delay that actuator
//!   by a tenth of a second, and all senders send again within a heartbeat period.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use acl::content::Inform;
use acl::{AgentId, Incarnation, Message};
use bytes::Bytes;
use capability::{Announcement, Maintainer, MaintainerScope, RepeatedHeartbeat, Timestamp};
use substrate::Presence;
use tokio::time::Instant;

use crate::broadcast_cache::{HeartbeatContent, HeartbeatRepetition, inform_of};
use crate::domain_tracker::{DomainTracker, InformOutcome};
use crate::host::Host;
use crate::stop_buttons::StopButtons;
use crate::stops::StopRegistry;

/// Beginning of a field that only heartbeats with stops have.
const STOPS_KEY: &[u8] = b"\"stops\":";

/// Composite domain that the actuators of one daemon share.
pub struct SharedDomain {
    began: Instant,
    /// How long the objects and facts of an agent stay in the model after the agent has left.
    removal: Duration,
    /// The stops of this daemon, to which those in received heartbeats are added.
    stops: Arc<StopRegistry>,
    /// The hardware stops of the ecosystem, which follow from received heartbeats.
    buttons: Option<Arc<StopButtons>>,
    state: Mutex<SharedDomainState>,
}

struct SharedDomainState {
    maintainer: Arc<Maintainer>,
    tracker: DomainTracker,
    /// Agents for which a request for the model is under way.
    requested: BTreeSet<AgentId>,
    /// Broadcasts that arrived before this value was created, by sender; not read yet.
    unread: BTreeMap<AgentId, Vec<Bytes>>,
}

impl SharedDomain {
    /// Creates a domain model without agents.
    pub(crate) fn new(host: &Host) -> SharedDomain {
        let (ontology, map) = (Arc::clone(&host.ontology), Arc::clone(&host.map));
        let maintainer = Maintainer::new(ontology, map, MaintainerScope::Public);
        let maintainer = Arc::new(maintainer.with_silence_limit(host.settings.silence_limit()));
        let (tracker, requested) = (DomainTracker::default(), BTreeSet::new());
        let state = SharedDomainState { maintainer, tracker, requested, unread: BTreeMap::new() };
        SharedDomain {
            began: Instant::now(),
            removal: host.settings.removal,
            stops: host.stops(),
            buttons: host.resources.get::<StopButtons>(),
            state: Mutex::new(state),
        }
    }

    /// Sets the broadcasts that arrived before this value was created, by sender: the newest one of
    /// each kind.
    pub(crate) fn set_earlier(&self, earlier: BTreeMap<AgentId, Vec<Bytes>>) {
        // A stop must not wait until its sender sends again. Only few broadcasts have one.
        let has_stops =
            |payload: &Bytes| payload.windows(STOPS_KEY.len()).any(|window| window == STOPS_KEY);
        let is_button = |sender: &AgentId| {
            self.buttons.as_ref().is_some_and(|buttons| buttons.must_read(sender))
        };
        for (sender, payloads) in &earlier {
            let is_button = is_button(sender);
            for payload in payloads.iter().filter(|payload| is_button || has_stops(payload)) {
                if let Ok(message) = acl::decode(payload)
                    && let Some(inform) = inform_of(&message)
                {
                    self.take_stops(&message, &inform);
                }
            }
        }
        self.state().0.unread = earlier;
    }

    /// Returns the present state of the shared model, and the time of that state.
    pub fn current(&self) -> (Arc<Maintainer>, Timestamp) {
        let (mut state, now) = self.state();
        while let Some((_, said)) = state.unread.pop_first() {
            self.read(&mut state, said, now);
        }
        (Arc::clone(&state.maintainer), now)
    }

    /// Returns the time until the actuators of this daemon next send their heartbeats. They all
    /// send at the same moments, which are `period` apart.
    pub fn until_next_heartbeat(&self, period: Duration) -> Duration {
        let over = self.began.elapsed().as_nanos() % period.as_nanos().max(1);
        period.saturating_sub(Duration::from_nanos(u64::try_from(over).unwrap_or(0)))
    }

    /// Returns the parsed announcement of an agent; `None` if the announcement was not received or
    /// not accepted.
    pub(crate) fn announcement(
        &self,
        agent: &AgentId,
        incarnation: Incarnation,
        digest: &str,
    ) -> Option<Announcement> {
        let (mut state, now) = self.state();
        self.read_of(&mut state, agent, now);
        state.maintainer.announcement(agent, incarnation, digest)
    }

    /// Handles a broadcast `inform`. The outcome states whether the sender's model must be
    /// requested first, and what was not accepted.
    pub(crate) fn receive(&self, message: &Message, inform: &Inform) -> InformOutcome {
        self.take_stops(message, inform);
        let (mut state, now) = self.state();
        self.read_of(&mut state, &message.sender, now);
        self.take(&mut state, message, inform, now)
    }

    /// Adds the stops that an actuator repeats in its heartbeat. Stops that were released here stay
    /// released. The heartbeat of a hardware stop also tells whether it is pressed.
    fn take_stops(&self, message: &Message, inform: &Inform) {
        let heartbeat = match inform {
            Inform::Heartbeat(heartbeat) => heartbeat,
            Inform::Model(announced) => &announced.heartbeat,
            Inform::Epoch(_) | Inform::Answer(_) => return,
        };
        for stop in &heartbeat.stops {
            if self.stops.add(stop) {
                tracing::warn!(stop = stop.id, by = %stop.by, "stopped, as another agent reports");
            }
        }
        if let Some(buttons) = &self.buttons {
            let (sender, now) = (&message.sender, Instant::now());
            let incarnation = message.incarnation;
            if buttons.hear_heartbeat(sender, incarnation, heartbeat, now) {
                buttons.apply(&self.stops, now);
            }
        }
    }

    /// Handles heartbeats that repeat the previous ones of their senders. Returns, for each, `false`
    /// if the heartbeat must be decoded.
    pub(crate) fn receive_repetitions<'r>(
        &self,
        repetitions: impl Iterator<Item = (&'r AgentId, &'r HeartbeatRepetition)>,
    ) -> Vec<bool> {
        let (mut state, now) = self.state();
        let SharedDomainState { maintainer, tracker, unread, .. } = &mut *state;
        let maintainer = Arc::make_mut(maintainer);
        let receive = |(sender, repetition): (&AgentId, &HeartbeatRepetition)| {
            if unread.contains_key(sender)
                || self.buttons.as_ref().is_some_and(|buttons| buttons.must_read(sender))
            {
                return false;
            }
            let HeartbeatContent { incarnation, digest, period } = &*repetition.said;
            let repeated = RepeatedHeartbeat {
                agent: sender,
                incarnation: *incarnation,
                digest,
                before: repetition.before,
                sequence: repetition.sequence,
                period: *period,
            };
            let change = maintainer.believe_repeated(&repeated, now);
            if let Some(change) = &change {
                tracker.schedule_removals(maintainer, change, now);
            }
            change.is_some()
        };
        repetitions.map(receive).collect()
    }

    /// Reads the broadcasts of an agent that arrived before this value was created, if they are not
    /// read yet.
    fn read_of(&self, state: &mut SharedDomainState, agent: &AgentId, now: Timestamp) {
        let said = state.unread.remove(agent);
        self.read(state, said.unwrap_or_default(), now);
    }

    /// Reads broadcasts that arrived before this value was created. A model that is missing then is
    /// requested when its agent sends again.
    fn read(&self, state: &mut SharedDomainState, said: Vec<Bytes>, now: Timestamp) {
        for message in said.iter().filter_map(|payload| acl::decode(payload).ok()) {
            if let Some(inform) = inform_of(&message) {
                self.take(state, &message, &inform, now);
            }
        }
    }

    fn take(
        &self,
        state: &mut SharedDomainState,
        message: &Message,
        inform: &Inform,
        now: Timestamp,
    ) -> InformOutcome {
        let SharedDomainState { maintainer, tracker, .. } = state;
        // Mistakes are not reported here, because the central Domain Maintainer reports them to the
        // sender.
        tracker.receive(Arc::make_mut(maintainer), message, inform, None, now)
    }

    /// Applies a presence change: an agent has joined or left. Returns the time after which the
    /// agent's model must be requested; `None` if the model need not be requested.
    pub(crate) fn presence(&self, presence: &Presence) -> Option<Duration> {
        let (mut state, now) = self.state();
        let agent = &presence.resident().agent;
        match presence {
            // The earlier announcement of the agent is read when the agent sends again.
            Presence::Joined(_) if state.unread.contains_key(agent) => return None,
            Presence::Joined(_) => (),
            Presence::Left(_) => self.read_of(&mut state, agent, now),
        }
        let SharedDomainState { maintainer, tracker, .. } = &mut *state;
        tracker.presence(Arc::make_mut(maintainer), presence, now).request_after
    }

    /// Whether this incarnation of `agent` has announced its model.
    pub(crate) fn has_model(&self, agent: &AgentId, incarnation: Incarnation) -> bool {
        let (mut state, now) = self.state();
        self.read_of(&mut state, agent, now);
        state.maintainer.incarnation(agent) == Some(incarnation)
    }

    /// Marks a request for the model of `agent` as under way; returns `false` if one is under way
    /// already.
    pub(crate) fn begin_request(&self, agent: &AgentId) -> bool {
        self.state().0.requested.insert(agent.clone())
    }

    /// Marks the request for the model of `agent` as finished.
    pub(crate) fn end_request(&self, agent: &AgentId) {
        self.state().0.requested.remove(agent);
    }

    /// Locks the state, after applying everything that was due by now. Returns the lock and the
    /// present time.
    fn state(&self) -> (MutexGuard<'_, SharedDomainState>, Timestamp) {
        let mut state = self.state.lock().unwrap_or_else(PoisonError::into_inner);
        let now = Timestamp(u64::try_from(self.began.elapsed().as_millis()).unwrap_or(u64::MAX));
        let SharedDomainState { maintainer, tracker, .. } = &mut *state;
        // Each due time is handled in turn, because this access may be much later than all of them.
        while let Some(due) = tracker.next_due(maintainer, self.removal).filter(|due| *due <= now) {
            tracker.advance(Arc::make_mut(maintainer), self.removal, due);
        }
        (state, now)
    }
}
