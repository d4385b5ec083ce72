//! Tracking of agents for a Domain Maintainer: the changes of the domain after an announcement, a
//! heartbeat, a change of presence, and the passing of time. Time is a parameter, and no function
//! here sends anything.
//!
//! - An announcement or heartbeat is passed to the maintainer. A model that was not accepted is
//!   neither read nor requested again for a while.
//! - When an agent's token is lost or its heartbeats stop, the maintainer masks its capabilities at
//!   once. If the agent stays away for the length of the removal, its objects and facts are removed
//!   too (docs/design.md, “Membership”). Silence alone is enough, because a router can lose the end
//!   of a token.
//! - The outcome of each step states whether the model of an agent is missing and must be
//!   requested.
//!
//! The modules `domain_sync` and `shared_domain` send the requests and own the clock: the former
//! for a Domain Maintainer with a mailbox, the latter for the maintainer that the actuators of a
//! daemon share.

use std::collections::{BTreeMap, BTreeSet};
use std::time::Duration;

use acl::content::{EpochChange, Heartbeat, Inform, ModelAnnouncement};
use acl::{AgentId, Incarnation, Message};
use bytes::Bytes;
use capability::{
    Announcement, Declined, DomainChange, Maintainer, ParsedHeartbeat, RequestedChanges,
    RequestedChangesSince, Timestamp,
};
use pddl::Diagnostic;
use substrate::Presence;

use crate::applied_heartbeats::AppliedHeartbeats;

/// How long to wait for the model that an agent announces by itself when it joins. An agent
/// announces its model at once, so an earlier request would bring nothing new.
pub(crate) const ANNOUNCED_WITHIN: Duration = Duration::from_millis(20);

/// How long a model that was not accepted is neither requested nor read again. Its agent repeats
/// the digest of the model in a heartbeat every second. The obstacle, such as too many other
/// agents, may be gone after a while.
const REJECTED_FOR: Duration = Duration::from_secs(10);

/// Maximum number of rejected models that are remembered: one per agent that may have a model.
/// Further rejected models are not remembered.
const REJECTED_MAX: usize = capability::limits::AGENTS_MAX;

/// Tracking state for one maintainer. The caller owns the maintainer.
#[derive(Default)]
pub(crate) struct DomainTracker {
    /// Agents that have left, each with the time at which it last left. The objects and facts of an
    /// agent are removed once it has been away for longer than the setting `removal`.
    leaving: BTreeSet<(Timestamp, AgentId)>,
    /// The time and the incarnation of each agent in `leaving`. An agent that returns and leaves
    /// again has one entry, that of its last departure.
    left_at: BTreeMap<AgentId, (Timestamp, Incarnation)>,
    rejected: RejectedModels,
    applied: AppliedHeartbeats,
}

/// Models that were not accepted lately: for each agent its incarnation, the digest of the model,
/// and the time of the rejection.
#[derive(Default)]
struct RejectedModels(BTreeMap<AgentId, (Incarnation, String, Timestamp)>);

/// Outcome of handling a broadcast `inform`.
#[derive(Default)]
pub(crate) struct InformOutcome {
    /// Changes of the domain that the message caused.
    pub(crate) changes: Vec<DomainChange>,
    /// Whether the sender's model is missing, and must be requested before the heartbeats can be
    /// used.
    pub(crate) lacks_model: bool,
    /// Description of what is malformed in the message; `None` if the message is well-formed.
    pub(crate) mistake: Option<String>,
    /// Reason why a well-formed message is not accepted; `None` if the message is accepted, or only
    /// came too late.
    declined: Option<String>,
}

/// Outcome of a change of presence.
#[derive(Debug)]
pub(crate) struct PresenceOutcome {
    /// Change of the domain.
    pub(crate) change: DomainChange,
    /// Time after which the agent's model must be requested, if the model of this incarnation is
    /// not known by then; `None` if the model is known.
    pub(crate) request_after: Option<Duration>,
}

impl DomainTracker {
    /// Passes a broadcast `inform` to the maintainer. `read` is the parsed announcement in the
    /// message, if it was parsed before.
    pub(crate) fn receive(
        &mut self,
        maintainer: &mut Maintainer,
        message: &Message,
        inform: &Inform,
        read: Option<Announcement>,
        now: Timestamp,
    ) -> InformOutcome {
        let rejected = &mut self.rejected;
        let mut outcome = InformOutcome::default();
        match inform {
            Inform::Model(announced) => {
                let digest = &announced.heartbeat.digest;
                if rejected.has(message, digest, now) {
                    return outcome;
                }
                if outcome.admit(maintainer, message, announced, read, now) {
                    rejected.0.remove(&message.sender);
                    outcome.believe(maintainer, message, &announced.heartbeat, now);
                } else {
                    rejected.note(message, digest, now);
                }
            }
            Inform::Heartbeat(beat) => {
                let needs_model = maintainer.needs_model(&message.sender, &beat.digest);
                outcome.lacks_model = needs_model && !rejected.has(message, &beat.digest, now);
                if let Some(change) = self.applied.repeat(maintainer, message, beat, now) {
                    outcome.changes.push(change);
                } else if !needs_model {
                    outcome.believe(maintainer, message, beat, now);
                    self.applied.note(message, beat, !outcome.changes.is_empty());
                }
            }
            Inform::Epoch(change) => outcome.follow(maintainer, message, change, now),
            Inform::Answer(_) => (),
        }
        for change in &outcome.changes {
            self.schedule_removals(maintainer, change, now);
        }
        outcome
    }

    /// Passes a change of presence to the maintainer.
    pub(crate) fn presence(
        &mut self,
        maintainer: &mut Maintainer,
        presence: &Presence,
        now: Timestamp,
    ) -> PresenceOutcome {
        let resident = presence.resident();
        let (agent, incarnation) = (&resident.agent, resident.incarnation);
        let (change, request_after) = match presence {
            Presence::Joined(_) => {
                let is_unknown = maintainer.incarnation(agent) != Some(incarnation);
                let request_after = match maintainer.is_masked(agent) {
                    // The agent may have sent something while it was away.
                    true => Some(Duration::ZERO),
                    false => is_unknown.then_some(ANNOUNCED_WITHIN),
                };
                (maintainer.unmask(agent, incarnation, now), request_after)
            }
            Presence::Left(_) => (maintainer.mask(agent, incarnation, now), None),
        };
        self.schedule_removals(maintainer, &change, now);
        PresenceOutcome { change, request_after }
    }

    /// Schedules the removal of the agents that `change` reports as left. Must be called for each
    /// change that the caller makes in the maintainer itself.
    pub(crate) fn schedule_removals(
        &mut self,
        maintainer: &Maintainer,
        change: &DomainChange,
        now: Timestamp,
    ) {
        for gone in &change.left {
            if let Some(incarnation) = maintainer.incarnation(gone) {
                if let Some((earlier, _)) = self.left_at.insert(gone.clone(), (now, incarnation)) {
                    self.leaving.remove(&(earlier, gone.clone()));
                }
                self.leaving.insert((now, gone.clone()));
            }
        }
    }

    /// Returns the next time at which [`advance`](DomainTracker::advance) has an effect if there is
    /// no other input before; `None` if there is no such time. `removal` is how long the objects
    /// and facts of an agent stay in the model after the agent has left.
    pub(crate) fn next_due(&self, maintainer: &Maintainer, removal: Duration) -> Option<Timestamp> {
        let removed_at = self.leaving.first().map(|(left_at, ..)| left_at.after(removal));
        maintainer.next_expiry().into_iter().chain(removed_at).min()
    }

    /// Applies what is due at the time `now`: the expiry of facts and leases, then the removal of
    /// what belongs to agents that have left. Returns the changes in their order.
    pub(crate) fn advance(
        &mut self,
        maintainer: &mut Maintainer,
        removal: Duration,
        now: Timestamp,
    ) -> Vec<DomainChange> {
        let mut changes = Vec::new();
        if maintainer.next_expiry().is_some_and(|due| due <= now) {
            let change = maintainer.expire(now);
            self.schedule_removals(maintainer, &change, now);
            changes.push(change);
        }
        while self.leaving.first().is_some_and(|(left_at, ..)| left_at.after(removal) <= now)
            && let Some((_, gone)) = self.leaving.pop_first()
            && let Some((_, incarnation)) = self.left_at.remove(&gone)
        {
            if !maintainer.is_present(&gone) {
                self.applied.forget(&gone);
                changes.push(maintainer.remove(&gone, incarnation, now));
            }
        }
        changes
    }
}

/// Returns the announcements of `agent` among the answers to a request for its model.
pub(crate) fn answered_models(agent: &AgentId, answers: Vec<Bytes>) -> Vec<Message> {
    let read = |answer: Bytes| match acl::decode(&answer) {
        Ok(message) if message.sender == *agent => Some(message),
        _ => {
            tracing::info!(from = %agent, "an answer that is no model");
            None
        }
    };
    answers.into_iter().filter_map(read).collect()
}

// === impl RejectedModels ===

impl RejectedModels {
    fn has(&self, message: &Message, digest: &str, now: Timestamp) -> bool {
        self.0.get(&message.sender).is_some_and(|(incarnation, rejected, at)| {
            *incarnation == message.incarnation
                && rejected == digest
                && now.since(*at) < REJECTED_FOR
        })
    }

    fn note(&mut self, message: &Message, digest: &str, now: Timestamp) {
        if self.0.len() >= REJECTED_MAX {
            self.0.retain(|_, (.., at)| now.since(*at) < REJECTED_FOR);
        }
        if self.0.len() < REJECTED_MAX {
            let rejected = (message.incarnation, digest.to_owned(), now);
            self.0.insert(message.sender.clone(), rejected);
        }
    }
}

// === impl InformOutcome ===

impl InformOutcome {
    /// Returns the reason why the announcement or heartbeat is not accepted; `None` if it is
    /// accepted.
    pub(crate) fn not_taken(&self) -> Option<&str> {
        self.mistake.as_deref().or(self.declined.as_deref())
    }

    /// Passes a model to the maintainer; returns `false` if the maintainer does not accept the
    /// model.
    fn admit(
        &mut self,
        maintainer: &mut Maintainer,
        message: &Message,
        announced: &ModelAnnouncement,
        read: Option<Announcement>,
        now: Timestamp,
    ) -> bool {
        let sender = &message.sender;
        let read_now = || Announcement::read(sender.clone(), message.incarnation, announced);
        let announcement = read.map_or_else(read_now, Ok);
        let admitted = announcement.map_err(|diagnostics| {
            let located = |diagnostic: &Diagnostic| diagnostic.located(&announced.model);
            diagnostics.iter().map(located).collect::<Vec<_>>().join("; ")
        });
        let admitted = admitted.and_then(|announcement| {
            maintainer.add_model(announcement, now).map_err(|declined| declined.to_string())
        });
        match admitted {
            Ok(()) => true,
            Err(mistake) => {
                tracing::debug!(from = %sender, mistake, "an action model is not taken");
                self.mistake = Some(mistake);
                false
            }
        }
    }

    fn believe(
        &mut self,
        maintainer: &mut Maintainer,
        message: &Message,
        heartbeat: &Heartbeat,
        now: Timestamp,
    ) {
        let (sender, incarnation) = (message.sender.clone(), message.incarnation);
        match ParsedHeartbeat::read(sender, incarnation, heartbeat, now) {
            Ok(beat) => match maintainer.apply_heartbeat(beat, now) {
                Ok(change) => self.changes.push(change),
                Err(declined) => {
                    tracing::debug!(from = %message.sender, %declined, "a heartbeat is not believed");
                    // After a restart, or if messages overtake each other, some heartbeats come too
                    // late.
                    let is_late = matches!(
                        declined,
                        Declined::OldSequence { .. }
                            | Declined::FormerIncarnation { .. }
                            | Declined::UnknownAgent { .. }
                    );
                    self.declined = (!is_late).then(|| declined.to_string());
                }
            },
            Err(diagnostics) => self.mistake = Some(joined(&diagnostics)),
        }
    }

    /// Applies the changes of facts that agents requested from a central Domain Maintainer, as the
    /// message of that maintainer lists them. The rest of the message is not needed: it comes here
    /// directly from the agents that own it.
    fn follow(
        &mut self,
        maintainer: &mut Maintainer,
        message: &Message,
        change: &EpochChange,
        now: Timestamp,
    ) {
        // An agent with an action model is no Domain Maintainer, whatever it announces about
        // others.
        if !maintainer.is_follower() || maintainer.incarnation(&message.sender).is_some() {
            return;
        }
        let EpochChange { requested, requested_since, .. } = change;
        if let Some(told) = requested {
            let read = RequestedChanges::read(told, now);
            self.followed(
                message,
                read.map(|requests| maintainer.apply_leader_requests(&requests, now)),
            );
        }
        if let Some(told) = requested_since {
            let read = RequestedChangesSince::read(told, now);
            self.followed(message, read.map(|since| maintainer.follow_since(&since, now)));
        }
    }

    fn followed(
        &mut self,
        message: &Message,
        followed: Result<Result<DomainChange, Declined>, Vec<Diagnostic>>,
    ) {
        match followed {
            Ok(Ok(change)) => self.changes.push(change),
            Ok(Err(declined)) => {
                tracing::warn!(from = %message.sender, %declined, "requests are not applied");
            }
            Err(diagnostics) => self.mistake = Some(joined(&diagnostics)),
        }
    }
}

fn joined(diagnostics: &[Diagnostic]) -> String {
    diagnostics.iter().map(ToString::to_string).collect::<Vec<_>>().join("; ")
}

#[cfg(test)]
mod tests {
    use acl::content::value;
    use acl::{ConversationId, DaemonId, MessageId, Performative, SCHEMA_VERSION};
    use capability::MaintainerScope;
    use substrate::Resident;

    use super::*;

    const ONTOLOGY: &str = "(define (domain test) (:requirements :typing)
        (:types room sensor) (:predicates (known ?r - room)))";
    const MAP: &str =
        "(define (problem map) (:domain test) (:objects hall - room) (:init) (:goal (and)))";
    const MODEL: &str = "(define (agent meter) (:domain test) (:objects meter - sensor)
        (:action measure :agent ?s - sensor :parameters (?r - room) :effect (known ?r)))";
    const REMOVAL: Duration = Duration::from_secs(1);

    /// Silence that is tolerated with the period of these heartbeats.
    const SILENCE_MS: u64 = 3_500;

    fn meter() -> AgentId {
        AgentId::new("meter").expect("a name")
    }

    fn maintainer() -> Maintainer {
        let (ontology, map) = (pddl::parse_domain(ONTOLOGY).value, pddl::parse_problem(MAP).value);
        let (ontology, map) = (ontology.expect("a domain"), map.expect("a problem"));
        Maintainer::new(ontology, map, MaintainerScope::Public)
    }

    fn message(inform: &Inform) -> Message {
        Message {
            version: SCHEMA_VERSION,
            id: MessageId::new("m"),
            performative: Performative::Inform,
            sender: meter(),
            incarnation: Incarnation(1),
            receiver: Vec::new(),
            content: value(inform),
            language: None,
            ontology: None,
            protocol: None,
            conversation_id: ConversationId::new("meter"),
            reply_with: None,
            in_reply_to: None,
            reply_within: None,
            via: Vec::new(),
            unknown: serde_json::Map::new(),
        }
    }

    fn heartbeat(digest: &str, sequence: u64) -> Heartbeat {
        Heartbeat {
            digest: digest.to_owned(),
            sequence,
            facts: "(known hall)".to_owned(),
            known_for: BTreeMap::new(),
            period: acl::Millis(Duration::from_secs(1)),
            stops: Vec::new(),
        }
    }

    fn announcement(model: &str) -> Inform {
        let methods = acl::content::Methods::new();
        let digest = capability::model_digest(model, &methods);
        let heartbeat = heartbeat(&digest, 1);
        Inform::Model(Box::new(ModelAnnouncement { model: model.to_owned(), methods, heartbeat }))
    }

    fn presence(incarnation: u64) -> (Presence, Presence) {
        let daemon = DaemonId::new("d").expect("a name");
        let resident = Resident { agent: meter(), daemon, incarnation: Incarnation(incarnation) };
        (Presence::Joined(resident.clone()), Presence::Left(resident))
    }

    fn receive(
        tracker: &mut DomainTracker,
        maintainer: &mut Maintainer,
        inform: &Inform,
        now: Timestamp,
    ) -> InformOutcome {
        tracker.receive(maintainer, &message(inform), inform, None, now)
    }

    #[test]
    fn a_silent_agent_leaves_and_is_removed_when_the_removal_has_passed() {
        let (mut tracker, mut maintainer) = (DomainTracker::default(), maintainer());
        receive(&mut tracker, &mut maintainer, &announcement(MODEL), Timestamp(0));
        let silent = Timestamp(SILENCE_MS);
        assert_eq!(tracker.next_due(&maintainer, REMOVAL), Some(silent));
        let before = Timestamp(SILENCE_MS - 1);
        assert!(tracker.advance(&mut maintainer, REMOVAL, before).is_empty());

        let changes = tracker.advance(&mut maintainer, REMOVAL, silent);

        assert_eq!(changes.iter().flat_map(|change| &change.left).collect::<Vec<_>>(), [&meter()]);
        let removed = silent.after(REMOVAL);
        assert_eq!(tracker.next_due(&maintainer, REMOVAL), Some(removed));
        assert_eq!(maintainer.incarnation(&meter()), Some(Incarnation(1)), "its facts stay");
        tracker.advance(&mut maintainer, REMOVAL, removed);
        assert_eq!(maintainer.incarnation(&meter()), None);
        assert_eq!(tracker.next_due(&maintainer, REMOVAL), None);
    }

    #[test]
    fn an_agent_that_returns_in_time_is_not_removed() {
        let (mut tracker, mut maintainer) = (DomainTracker::default(), maintainer());
        receive(&mut tracker, &mut maintainer, &announcement(MODEL), Timestamp(0));
        let (joined, left) = presence(1);
        let outcome = tracker.presence(&mut maintainer, &left, Timestamp(10));
        assert_eq!((outcome.change.left, outcome.request_after), (vec![meter()], None));

        let outcome = tracker.presence(&mut maintainer, &joined, Timestamp(20));

        assert_eq!(outcome.change.joined, [meter()]);
        assert_eq!(outcome.request_after, Some(Duration::ZERO), "it may have sent something");
        tracker.advance(&mut maintainer, REMOVAL, Timestamp(1_010));
        assert_eq!(maintainer.incarnation(&meter()), Some(Incarnation(1)));
    }

    #[test]
    fn the_removal_counts_from_the_last_departure() {
        let (mut tracker, mut maintainer) = (DomainTracker::default(), maintainer());
        receive(&mut tracker, &mut maintainer, &announcement(MODEL), Timestamp(0));
        let (joined, left) = presence(1);
        for (presence, at) in [(&left, 10), (&joined, 20), (&left, 900)] {
            tracker.presence(&mut maintainer, presence, Timestamp(at));
        }
        tracker.advance(&mut maintainer, REMOVAL, Timestamp(1_899));
        assert_eq!(maintainer.incarnation(&meter()), Some(Incarnation(1)), "away for 999 ms");
        assert_eq!(tracker.next_due(&maintainer, REMOVAL), Some(Timestamp(1_900)));
        tracker.advance(&mut maintainer, REMOVAL, Timestamp(1_900));
        assert_eq!(maintainer.incarnation(&meter()), None);
        assert_eq!(tracker.next_due(&maintainer, REMOVAL), None);
    }

    #[test]
    fn a_model_is_requested_if_that_of_the_incarnation_is_not_known() {
        let (mut tracker, mut maintainer) = (DomainTracker::default(), maintainer());
        let mut joins = |maintainer: &mut Maintainer, incarnation| {
            let (joined, _) = presence(incarnation);
            tracker.presence(maintainer, &joined, Timestamp(1)).request_after
        };
        assert_eq!(joins(&mut maintainer, 1), Some(ANNOUNCED_WITHIN));
        let mut other = DomainTracker::default();
        receive(&mut other, &mut maintainer, &announcement(MODEL), Timestamp(0));
        assert_eq!(joins(&mut maintainer, 1), None);
        assert_eq!(joins(&mut maintainer, 2), Some(ANNOUNCED_WITHIN), "it was restarted");
    }

    #[test]
    fn a_heartbeat_without_its_model_asks_for_the_model_unless_it_was_rejected() {
        let (mut tracker, mut maintainer) = (DomainTracker::default(), maintainer());
        let beat = |digest: &str| Inform::Heartbeat(heartbeat(digest, 2));
        let outcome = receive(&mut tracker, &mut maintainer, &beat("other"), Timestamp(0));
        assert!(outcome.lacks_model);
        let mistaken = announcement("(define (agent meter) (:domain elsewhere))");
        let Inform::Model(announced) = &mistaken else { panic!("it is a model") };
        let digest = announced.heartbeat.digest.clone();
        let outcome = receive(&mut tracker, &mut maintainer, &mistaken, Timestamp(0));
        assert!(outcome.not_taken().is_some());
        let later = Timestamp(0).after(REJECTED_FOR);
        for (now, is_requested) in [(Timestamp(1), false), (later, true)] {
            let outcome = receive(&mut tracker, &mut maintainer, &beat(&digest), now);
            assert_eq!(outcome.lacks_model, is_requested, "{now:?}");
        }
    }

    /// Both maintainers get the same heartbeats; one of them reads each anew.
    #[test]
    fn heartbeats_have_the_same_effect_whether_they_are_repeated_or_read_anew() {
        let beat = |sequence, facts: &str, known_for: &[(&str, u64)]| {
            let known = |(fact, ms): &(&str, u64)| {
                ((*fact).to_owned(), acl::Millis(Duration::from_millis(*ms)))
            };
            let Inform::Model(model) = announcement(MODEL) else { panic!("it is a model") };
            Inform::Heartbeat(Heartbeat {
                facts: facts.to_owned(),
                known_for: known_for.iter().map(known).collect(),
                ..heartbeat(&model.heartbeat.digest, sequence)
            })
        };
        let hall = "(known hall)";
        let beats = [
            beat(2, hall, &[]),
            beat(3, hall, &[]),
            beat(3, "", &[]),
            beat(4, "", &[]),
            beat(5, "", &[]),
            beat(6, hall, &[(hall, 2_000)]),
            beat(7, hall, &[(hall, 1_000)]),
            beat(8, hall, &[]),
            beat(9, hall, &[]),
            beat(11, "(unknown (known hall))", &[]),
            beat(12, "(unknown (known hall))", &[]),
        ];
        let (mut tracker, mut repeating) = (DomainTracker::default(), maintainer());
        let mut reading = maintainer();
        let model = announcement(MODEL);
        receive(&mut tracker, &mut repeating, &model, Timestamp(0));
        receive(&mut DomainTracker::default(), &mut reading, &model, Timestamp(0));
        let mut told = 0;
        for (number, beat) in beats.iter().enumerate() {
            let now = Timestamp(1_000 * (number as u64 + 1));
            let repeated = receive(&mut tracker, &mut repeating, beat, now);
            let read = receive(&mut DomainTracker::default(), &mut reading, beat, now);
            assert_eq!(repeated.changes, read.changes, "{beat:?}");
            assert_eq!(repeated.declined, read.declined, "{beat:?}");
            let state = |maintainer: &Maintainer| maintainer.snapshot(now).to_content();
            assert_eq!(state(&repeating), state(&reading), "{beat:?}");
            assert_eq!(
                tracker.next_due(&repeating, REMOVAL),
                DomainTracker::default().next_due(&reading, REMOVAL)
            );
            told += usize::from(!repeated.changes.is_empty());
        }
        assert_eq!(told, beats.len() - 1, "one came late");
    }

    #[test]
    fn only_announcements_of_the_agent_count_as_answers() {
        let own = acl::encode(&message(&announcement(MODEL)));
        let other = AgentId::new("lamp").expect("a name");
        let foreign = acl::encode(&Message { sender: other, ..message(&announcement(MODEL)) });
        let answers = vec![foreign, Bytes::from_static(b"garbage"), own];
        assert_eq!(answered_models(&meter(), answers).len(), 1);
    }
}
