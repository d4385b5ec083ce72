//! Synchronisation of a Domain Maintainer: passes messages and presence changes to the maintainer's
//! state machine in `capability`, and reports the changes of the domain to the agent that keeps it.
//!
//! - Models and heartbeats arrive as broadcast `inform`s. A model that was missed is requested.
//! - When an agent's token is lost or its heartbeats stop, its capabilities are masked at once. If
//!   it stays away for [`AgentSettings::removal`](crate::AgentSettings), its objects and facts are removed
//!   too (docs/design.md, “Membership”). Silence alone is enough, because a router can lose the end
//!   of a token.
//! - Changes of facts that agents requested from the central Domain Maintainer arrive with the
//!   announcements of that maintainer. They are for maintainers that otherwise receive heartbeats only.
//!
//! The central Domain Maintainer uses these functions itself. The actuators of a daemon share one
//! maintainer in the daemon's [`SharedDomain`](crate::SharedDomain), which is updated in the same way.

use std::collections::BTreeMap;
use std::time::Duration;

use acl::content::{EpochChange, Heartbeat, Inform, ModelAnnouncement};
use acl::{AgentId, Incarnation, Message};
use capability::{
    AdmitResult, Announcement, Conflict, Declined, DomainChange, Maintainer, ParsedHeartbeat,
    RequestedChanges, RequestedChangesSince, Timestamp,
};
use pddl::Diagnostic;
use substrate::Presence;
use tokio::time::Instant;

use crate::base_agent::Agent;
use crate::context::{Context, TimerId, WorkHandle};

/// Shortest time between two compositions of models. The models of a daemon that starts arrive within
/// this time and are composed together; a single model is composed at once. Composing a thousand models
/// takes some milliseconds.
const COMPOSING_APART: Duration = Duration::from_millis(20);

/// How long to wait for the model that an agent announces by itself when it joins. The agent announces
/// it at once, so an earlier request would bring nothing new.
pub(crate) const TELLING: Duration = Duration::from_millis(20);

/// First wait before an agent that gave no answer is asked for its model again; the wait doubles each
/// time, and `ASKED_AGAIN` is the number of repetitions. Presence is known a moment before queries
/// reach the agent; Zenoh's routes are there after a tenth of a second at most. An agent without a
/// model never answers.
const ASK_AGAIN: Duration = Duration::from_millis(15);
const ASKED_AGAIN: u32 = 5;

/// How long a model that was not accepted is neither requested nor read again. Its agent states the
/// digest of the model in a heartbeat every second. The obstacle, such as too many other agents, may be
/// gone after a while.
const REFUSED_FOR: Duration = Duration::from_secs(10);

/// Resolution of a timestamp. A timer for a timestamp waits that much longer, so that it never fires
/// before it.
const TIMESTAMP_STEP: Duration = Duration::from_millis(1);

/// Most rejected models remembered at a time: as many as the number of agents that may have a model.
const REFUSED_MAX: usize = capability::limits::AGENTS_MAX;

/// A Domain Maintainer, and the data for keeping it up to date.
pub struct DomainSync {
    /// The state machine of the Domain Maintainer.
    pub maintainer: Maintainer,
    began: Instant,
    expiry: Option<TimerId>,
    /// Time of the last composition of models.
    composed: Option<Instant>,
    composing: Option<TimerId>,
    fetching: BTreeMap<AgentId, WorkHandle>,
    refused: RejectedModels,
}

/// Models that were not accepted lately: for each agent its incarnation, the digest of the model, and
/// the time of the rejection.
#[derive(Default)]
pub(crate) struct RejectedModels(BTreeMap<AgentId, (Incarnation, String, Timestamp)>);

/// Agent that keeps a Domain Maintainer.
pub trait MaintainsDomain: Agent {
    /// Returns the maintainer and the data for keeping it up to date.
    fn domain_sync(&mut self) -> &mut DomainSync;

    /// Called when the composite domain or the believed facts have changed.
    fn domain_changed(&mut self, _change: &DomainChange, _ctx: &mut Context<Self>) {}

    /// Called when a part of an agent's model cannot be composed as it is written.
    fn conflicts_found(&mut self, _conflicts: &[Conflict], _ctx: &mut Context<Self>) {}
}

impl DomainSync {
    /// Creates the data for keeping a maintainer up to date. The maintainer may have content already.
    pub fn new(maintainer: Maintainer) -> DomainSync {
        let (expiry, composed, composing) = (None, None, None);
        let (began, fetching) = (Instant::now(), BTreeMap::new());
        let refused = RejectedModels::default();
        DomainSync { maintainer, began, expiry, composed, composing, fetching, refused }
    }

    /// Returns the present time on the maintainer's clock.
    pub fn timestamp(&self) -> Timestamp {
        Timestamp(u64::try_from(self.began.elapsed().as_millis()).unwrap_or(u64::MAX))
    }
}

/// Handles a broadcast `inform`: passes its content to the maintainer, and requests the sender's model
/// if that is missing.
pub fn receive_inform<A: MaintainsDomain>(agent: &mut A, message: &Message, ctx: &mut Context<A>) {
    let inform = match message.content_as::<Inform>() {
        Ok(inform) => inform,
        Err(error) => {
            tracing::info!(from = %message.sender, %error, "an inform that cannot be read");
            return;
        }
    };
    let mut read = None;
    if let Inform::Model(announced) = &inform {
        agent.domain_sync().fetching.remove(&message.sender);
        let (sender, digest) = (&message.sender, &announced.heartbeat.digest);
        read = ctx.router().announcement(sender, message.incarnation, digest);
    }
    let now = agent.domain_sync().timestamp();
    let DomainSync { maintainer, refused, .. } = agent.domain_sync();
    let heard = hear((maintainer, refused), message, &inform, read, now);
    compose_soon(agent, ctx);
    for change in &heard.changes {
        report_change(agent, change, ctx);
    }
    if heard.lacks_model {
        fetch(agent, &message.sender, ASKED_AGAIN, ctx);
    }
    // If there is a shared domain, it has counted the mistake.
    if let Some(why) = heard.not_taken()
        && !ctx.router().has_commons()
    {
        ctx.router().not_taken(message, why);
    }
    if let Some(mistake) = heard.mistake {
        ctx.not_understood(message, mistake);
    }
}

/// Composes the models that have arrived, either at once or a little later together with models that
/// arrive soon.
fn compose_soon<A: MaintainsDomain>(agent: &mut A, ctx: &mut Context<A>) {
    let upkeep = agent.domain_sync();
    if !upkeep.maintainer.is_stale() || upkeep.composing.is_some() {
        return;
    }
    let over = upkeep.composed.map_or(COMPOSING_APART, |composed| composed.elapsed());
    let wait = COMPOSING_APART.saturating_sub(over);
    if wait.is_zero() {
        return compose(agent, ctx);
    }
    agent.domain_sync().composing = Some(ctx.after(wait, |agent: &mut A, ctx| compose(agent, ctx)));
}

/// Composes the models that have arrived, if there are any. Call this function before the domain is
/// shown to others.
pub fn compose<A: MaintainsDomain>(agent: &mut A, ctx: &mut Context<A>) {
    let upkeep = agent.domain_sync();
    let timer = upkeep.composing.take();
    let (is_stale, now) = (upkeep.maintainer.is_stale(), upkeep.timestamp());
    if is_stale {
        let AdmitResult { change, conflicts } = upkeep.maintainer.compose_added(now);
        upkeep.composed = Some(Instant::now());
        if !conflicts.is_empty() {
            agent.conflicts_found(&conflicts, ctx);
        }
        report_change(agent, &change, ctx);
    }
    timer.into_iter().for_each(|timer| ctx.cancel_timer(timer));
}

/// Outcome of handling a broadcast `inform`.
#[derive(Default)]
pub(crate) struct InformOutcome {
    /// Changes of the domain that the message caused.
    pub(crate) changes: Vec<DomainChange>,
    /// Whether the sender's model is missing, and must be requested before the heartbeats can be used.
    pub(crate) lacks_model: bool,
    /// Description of what is malformed in the message; `None` if the message is well-formed.
    pub(crate) mistake: Option<String>,
    /// Reason why a well-formed message is not believed. `None` if the message is believed, or merely
    /// came too late.
    declined: Option<String>,
}

/// Passes a broadcast `inform` to a maintainer. `read` is the parsed announcement in the message, if it
/// was parsed before.
pub(crate) fn hear(
    (maintainer, refused): (&mut Maintainer, &mut RejectedModels),
    message: &Message,
    inform: &Inform,
    read: Option<Announcement>,
    now: Timestamp,
) -> InformOutcome {
    let mut heard = InformOutcome::default();
    match inform {
        Inform::Model(announced) => {
            let digest = &announced.heartbeat.digest;
            if refused.has(message, digest, now) {
                return heard;
            }
            if heard.admit(maintainer, message, announced, read, now) {
                refused.0.remove(&message.sender);
                heard.believe(maintainer, message, &announced.heartbeat, now);
            } else {
                refused.note(message, digest, now);
            }
        }
        Inform::Heartbeat(beat) => {
            let needs_model = maintainer.needs_model(&message.sender, &beat.digest);
            heard.lacks_model = needs_model && !refused.has(message, &beat.digest, now);
            if !needs_model {
                heard.believe(maintainer, message, beat, now);
            }
        }
        Inform::Epoch(change) => heard.follow(maintainer, message, change, now),
        Inform::Answer(_) => (),
    }
    heard
}

/// Handles that another agent has joined or left.
pub fn presence<A: MaintainsDomain>(agent: &mut A, presence: &Presence, ctx: &mut Context<A>) {
    let (who, life) = (presence.resident().agent.clone(), presence.resident().incarnation);
    let now = agent.domain_sync().timestamp();
    let change = match presence {
        Presence::Joined(_) => {
            // The agent may have sent something while it was away.
            if agent.domain_sync().maintainer.is_masked(&who) {
                fetch(agent, &who, ASKED_AGAIN, ctx);
            }
            let whose = who.clone();
            ctx.after(TELLING, move |agent: &mut A, ctx| {
                if agent.domain_sync().maintainer.incarnation(&whose) != Some(life) {
                    fetch(agent, &whose, ASKED_AGAIN, ctx);
                }
            });
            agent.domain_sync().maintainer.unmask(&who, life, now)
        }
        Presence::Left(_) => {
            agent.domain_sync().fetching.remove(&who);
            agent.domain_sync().maintainer.mask(&who, life, now)
        }
    };
    report_change(agent, &change, ctx);
}

/// Reports a change of the domain to the agent, and schedules the next expiry of a fact or lease. Call
/// this function after any change of the maintainer.
pub fn report_change<A: MaintainsDomain>(
    agent: &mut A,
    change: &DomainChange,
    ctx: &mut Context<A>,
) {
    if let Some(earlier) = agent.domain_sync().expiry.take() {
        ctx.cancel_timer(earlier);
    }
    if let Some(next) = agent.domain_sync().maintainer.next_expiry() {
        let wait = next.since(agent.domain_sync().timestamp()) + TIMESTAMP_STEP;
        agent.domain_sync().expiry = Some(ctx.after(wait, expire));
    }
    for gone in &change.left {
        let Some(life) = agent.domain_sync().maintainer.incarnation(gone) else { continue };
        let (gone, removal) = (gone.clone(), ctx.settings().removal);
        ctx.after(removal, move |agent: &mut A, ctx| remove(agent, &gone, life, ctx));
    }
    if !change.is_empty() {
        agent.domain_changed(change, ctx);
    }
}

fn expire<A: MaintainsDomain>(agent: &mut A, ctx: &mut Context<A>) {
    let now = agent.domain_sync().timestamp();
    let change = agent.domain_sync().maintainer.expire(now);
    report_change(agent, &change, ctx);
}

fn remove<A: MaintainsDomain>(
    agent: &mut A,
    gone: &AgentId,
    life: Incarnation,
    ctx: &mut Context<A>,
) {
    if agent.domain_sync().maintainer.is_present(gone) {
        return;
    }
    let now = agent.domain_sync().timestamp();
    let change = agent.domain_sync().maintainer.remove(gone, life, now);
    report_change(agent, &change, ctx);
}

impl RejectedModels {
    fn has(&self, message: &Message, digest: &str, now: Timestamp) -> bool {
        self.0.get(&message.sender).is_some_and(|(life, refused, at)| {
            *life == message.incarnation && refused == digest && now.since(*at) < REFUSED_FOR
        })
    }

    fn note(&mut self, message: &Message, digest: &str, now: Timestamp) {
        if self.0.len() >= REFUSED_MAX {
            self.0.retain(|_, (.., at)| now.since(*at) < REFUSED_FOR);
        }
        if self.0.len() < REFUSED_MAX {
            let refused = (message.incarnation, digest.to_owned(), now);
            self.0.insert(message.sender.clone(), refused);
        }
    }
}

impl InformOutcome {
    /// Returns the reason why the announcement or heartbeat is not accepted; `None` if it is accepted.
    pub(crate) fn not_taken(&self) -> Option<&str> {
        self.mistake.as_deref().or(self.declined.as_deref())
    }

    /// Passes a model to the maintainer; returns `false` if it is not accepted.
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
        let (sender, life) = (message.sender.clone(), message.incarnation);
        match ParsedHeartbeat::read(sender, life, heartbeat, now) {
            Ok(beat) => match maintainer.apply_heartbeat(beat, now) {
                Ok(change) => self.changes.push(change),
                Err(declined) => {
                    tracing::debug!(from = %message.sender, %declined, "a heartbeat is not believed");
                    // After a restart, or if messages overtake each other, some come too late.
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

    /// Applies the changes of facts that agents requested from a central Domain Maintainer. The
    /// announcement of that maintainer is needed for nothing else: all other content comes here
    /// directly from the agents that own it.
    fn follow(
        &mut self,
        maintainer: &mut Maintainer,
        message: &Message,
        change: &EpochChange,
        now: Timestamp,
    ) {
        // An agent with an action model is no Domain Maintainer, whatever it announces about others.
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

/// Requests the model of the agent `whose`. If no answer comes, asks again up to `again` times.
/// Reasoning agents have no model and do not answer.
fn fetch<A: MaintainsDomain>(agent: &mut A, whose: &AgentId, again: u32, ctx: &mut Context<A>) {
    if agent.domain_sync().fetching.contains_key(whose) {
        return;
    }
    let Some(resident) = ctx.find(whose) else { return };
    let asked = ctx.router().model_of(resident);
    let name = whose.clone();
    let work = ctx.run(asked, move |agent: &mut A, answers, ctx| {
        agent.domain_sync().fetching.remove(&name);
        if answers.is_empty()
            && again > 0
            && agent.domain_sync().maintainer.incarnation(&name).is_none()
        {
            let wait = ASK_AGAIN * (1 << ASKED_AGAIN.saturating_sub(again));
            ctx.after(wait, move |agent: &mut A, ctx| fetch(agent, &name, again - 1, ctx));
            return;
        }
        for answer in answers {
            match acl::decode(&answer) {
                Ok(message) if message.sender == name => receive_inform(agent, &message, ctx),
                _ => tracing::info!(from = %name, "an answer that is no model"),
            }
        }
    });
    agent.domain_sync().fetching.insert(whose.clone(), work);
}
