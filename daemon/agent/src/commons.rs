//! The commons: what the actuators of one daemon have heard, kept once for all of them.
//!
//! Every actuator plans with what it has heard itself (the paper, “Decentralized Planning”). Those
//! of one daemon hear the same, so it is read and kept once, and each looks at it with its own
//! eyes ([`Maintainer::snapshot_for`]): memory grows with the agents, not with their square. A
//! model that was read here is not read again by a Domain Maintainer of the same daemon.
//!
//! - Hears before the daemon's mailboxes do: who is called for proposals knows all that was said
//!   before the call.
//! - Called on the substrate's threads: nothing here waits. Time is caught up with whenever
//!   something is heard or looked at. Who looks keeps what was known then; what comes meanwhile is
//!   written into a copy.
//! - What was said before the first actuator came is read when its sender speaks again, or when
//!   somebody looks: a thousand models at once would keep that actuator waiting for a tenth of a
//!   second, and their senders all speak within a heartbeat.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use acl::content::Inform;
use acl::{AgentId, Incarnation, Message};
use bytes::Bytes;
use capability::{Announcement, Change, Maintainer, Moment, Repeated, Scope};
use substrate::Presence;
use tokio::time::Instant;

use crate::hearsay::{Again, Repeatable, Said};
use crate::plugin::Host;
use crate::switchboard::inform_of;
use crate::upkeep::{self, Heard, Refused, TELLING};

/// What the actuators of one daemon have heard.
pub struct Commons {
    began: Instant,
    /// How long after an agent has left its objects and facts are still believed.
    removal: Duration,
    state: Mutex<State>,
}

struct State {
    maintainer: Arc<Maintainer>,
    /// Those who have left, and when they are forgotten.
    leaving: BTreeSet<(Moment, AgentId, Incarnation)>,
    /// Those who are being asked for their models.
    asked: BTreeSet<AgentId>,
    /// What was said before, by whom: not read yet.
    unread: BTreeMap<AgentId, Vec<Bytes>>,
    refused: Refused,
}

impl Commons {
    /// Has heard nothing yet.
    pub(crate) fn new(host: &Host) -> Commons {
        let (ontology, map) = (Arc::clone(&host.ontology), Arc::clone(&host.map));
        let maintainer = Arc::new(Maintainer::new(ontology, map, Scope::Public));
        let (leaving, asked) = (BTreeSet::new(), BTreeSet::new());
        let (unread, refused) = (BTreeMap::new(), Refused::default());
        let state = State { maintainer, leaving, asked, unread, refused };
        Commons { began: Instant::now(), removal: host.settings.removal, state: Mutex::new(state) }
    }

    /// Takes what was said before, by whom: the newest of each kind.
    pub(crate) fn was_said(&self, before: BTreeMap<AgentId, Vec<Bytes>>) {
        self.state().0.unread = before;
    }

    /// What is known now, and which moment this is.
    pub fn look(&self) -> (Arc<Maintainer>, Moment) {
        let (mut state, now) = self.state();
        while let Some((_, said)) = state.unread.pop_first() {
            self.read(&mut state, said, now);
        }
        (Arc::clone(&state.maintainer), now)
    }

    /// How long it is until the next of the moments, a period apart, that the actuators here have in
    /// common.
    pub fn until_next(&self, period: Duration) -> Duration {
        let over = self.began.elapsed().as_nanos() % period.as_nanos().max(1);
        period.saturating_sub(Duration::from_nanos(u64::try_from(over).unwrap_or(0)))
    }

    /// What an agent announced, if it was heard and taken.
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

    /// Hears an `inform` to all; yields whether its sender's model has to be asked for first, and what
    /// was not taken.
    pub(crate) fn hear(&self, message: &Message, inform: &Inform) -> Heard {
        let (mut state, now) = self.state();
        self.read_of(&mut state, &message.sender, now);
        self.take(&mut state, message, inform, now)
    }

    /// Hears a heartbeat that says what the one before said; `false` if it has to be read.
    pub(crate) fn hear_again(&self, sender: &AgentId, again: &Again) -> bool {
        let (mut state, now) = self.state();
        let Again { before, now: Repeatable { said, sequence, .. } } = again;
        let Said { incarnation, digest, period } = &**said;
        let repeated = Repeated {
            agent: sender,
            incarnation: *incarnation,
            digest,
            before: *before,
            sequence: *sequence,
            period: *period,
        };
        let State { maintainer, unread, .. } = &mut *state;
        if unread.contains_key(sender) {
            return false;
        }
        match Arc::make_mut(maintainer).believe_repeated(&repeated, now) {
            Some(change) => {
                self.note(&mut state, &change, now);
                true
            }
            None => false,
        }
    }

    /// Reads what an agent said before, if that is still to be done.
    fn read_of(&self, state: &mut State, agent: &AgentId, now: Moment) {
        let said = state.unread.remove(agent);
        self.read(state, said.unwrap_or_default(), now);
    }

    /// Who lacks a model then is asked for it when it speaks again.
    fn read(&self, state: &mut State, said: Vec<Bytes>, now: Moment) {
        for message in said.iter().filter_map(|payload| acl::decode(payload).ok()) {
            if let Some(inform) = inform_of(&message) {
                self.take(state, &message, &inform, now);
            }
        }
    }

    fn take(&self, state: &mut State, message: &Message, inform: &Inform, now: Moment) -> Heard {
        let State { maintainer, refused, .. } = &mut *state;
        let keeper = (Arc::make_mut(maintainer), refused);
        let heard = upkeep::hear(keeper, message, inform, None, now);
        for change in &heard.changes {
            self.note(state, change, now);
        }
        // The central Domain Maintainer tells the sender.
        heard
    }

    /// Takes a change of presence; after how long the agent's model has to be asked for, if so.
    pub(crate) fn presence(&self, presence: &Presence) -> Option<Duration> {
        let (mut state, now) = self.state();
        let (who, life) = (&presence.resident().agent, presence.resident().incarnation);
        if let Presence::Left(_) = presence {
            self.read_of(&mut state, who, now);
        }
        let is_unread = state.unread.contains_key(who);
        let maintainer = Arc::make_mut(&mut state.maintainer);
        let (change, asked_after) = match presence {
            // It has told its model, which is read when it speaks again.
            Presence::Joined(_) if is_unread => return None,
            Presence::Joined(_) => {
                let is_strange = maintainer.incarnation(who) != Some(life);
                // Who is back may have said something while it was away.
                let asked_after = match maintainer.is_masked(who) {
                    true => Some(Duration::ZERO),
                    false => is_strange.then_some(TELLING),
                };
                (maintainer.unmask(who, life, now), asked_after)
            }
            Presence::Left(_) => (maintainer.mask(who, life, now), None),
        };
        self.note(&mut state, &change, now);
        asked_after
    }

    /// Whether this life of `agent` has told its model.
    pub(crate) fn knows(&self, agent: &AgentId, life: Incarnation) -> bool {
        let (mut state, now) = self.state();
        self.read_of(&mut state, agent, now);
        state.maintainer.incarnation(agent) == Some(life)
    }

    /// Whether nobody else is asking `agent` for its model.
    pub(crate) fn begins_to_ask(&self, agent: &AgentId) -> bool {
        self.state().0.asked.insert(agent.clone())
    }

    /// `agent` has answered, or will not.
    pub(crate) fn has_asked(&self, agent: &AgentId) {
        self.state().0.asked.remove(agent);
    }

    fn note(&self, state: &mut State, change: &Change, now: Moment) {
        for gone in &change.left {
            if let Some(life) = state.maintainer.incarnation(gone) {
                state.leaving.insert((now.after(self.removal), gone.clone(), life));
            }
        }
    }

    /// The state, as if everything that was due had been done in its time.
    fn state(&self) -> (MutexGuard<'_, State>, Moment) {
        let mut state = self.state.lock().unwrap_or_else(PoisonError::into_inner);
        let now = Moment(u64::try_from(self.began.elapsed().as_millis()).unwrap_or(u64::MAX));
        while let Some(due) = state.maintainer.next_expiry().filter(|due| *due <= now) {
            let change = Arc::make_mut(&mut state.maintainer).expire(due);
            self.note(&mut state, &change, due);
        }
        while state.leaving.first().is_some_and(|(due, ..)| *due <= now)
            && let Some((_, gone, life)) = state.leaving.pop_first()
        {
            if !state.maintainer.is_present(&gone) {
                Arc::make_mut(&mut state.maintainer).remove(&gone, life, now);
            }
        }
        (state, now)
    }
}
