//! Synchronisation of a Domain Maintainer: passes messages and presence changes to the maintainer's
//! state machine in `capability`, and reports the changes of the domain to the agent that keeps it.
//!
//! - Models and heartbeats arrive as broadcast `inform`s. A model that was missed is requested.
//! - The module `domain_tracker` decides how the domain changes after a message, and after the
//!   absence of an agent.
//! - Changes of facts that agents requested from the central Domain Maintainer arrive with the
//!   announcements of that maintainer. Maintainers that otherwise receive heartbeats only need
//!   these announcements.
//!
//! The central Domain Maintainer uses these functions itself. The actuators of a daemon share one
//! maintainer in the daemon's [`SharedDomain`](crate::SharedDomain), which is updated in the same
//! way.

use std::collections::BTreeMap;
use std::time::Duration;

use acl::content::Inform;
use acl::{AgentId, Message};
use capability::{AdmitResult, Conflict, DomainChange, Maintainer, Timestamp};
use substrate::Presence;
use tokio::time::Instant;

use crate::base_agent::Agent;
use crate::context::{Context, TimerId, WorkHandle};
use crate::domain_tracker::{ANNOUNCED_WITHIN, DomainTracker, PresenceOutcome, answered_models};

/// Shortest time between two compositions of models. The models of a daemon that starts arrive
/// within this time and are composed together; a single model is composed at once. Composing a
/// thousand models takes some milliseconds.
const COMPOSING_APART: Duration = Duration::from_millis(20);

/// Resolution of a timestamp. A timer that is set for a timestamp waits this much longer, so that
/// it never fires too early.
const TIMESTAMP_STEP: Duration = Duration::from_millis(1);

/// First wait before an agent that gave no answer is asked for its model again. The wait doubles
/// each time, and `ASKED_AGAIN` is the number of repetitions. A query can be lost because Zenoh
/// announces the presence of an agent a moment before queries reach it; the routes are there after
/// a tenth of a second at most. An agent without a model never answers.
const ASK_AGAIN: Duration = Duration::from_millis(15);
const ASKED_AGAIN: u32 = 5;

/// A Domain Maintainer, and the data for keeping it up to date.
pub struct DomainSync {
    /// The state machine of the Domain Maintainer.
    pub maintainer: Maintainer,
    tracker: DomainTracker,
    began: Instant,
    /// Timer of the next time at which a fact expires, an agent counts as silent, or the objects
    /// and facts of an agent that has left are removed.
    due: Option<TimerId>,
    /// Time of the last composition of models.
    composed: Option<Instant>,
    composing: Option<TimerId>,
    fetching: BTreeMap<AgentId, WorkHandle>,
}

/// An agent that keeps a Domain Maintainer.
pub trait MaintainsDomain: Agent {
    /// Returns the maintainer and the data for keeping it up to date.
    fn domain_sync(&mut self) -> &mut DomainSync;

    /// Called when the composite domain or the known facts have changed.
    fn domain_changed(&mut self, _change: &DomainChange, _ctx: &mut Context<Self>) {}

    /// Called when a part of an agent's model cannot become part of the composite domain as it is
    /// written.
    fn conflicts_found(&mut self, _conflicts: &[Conflict], _ctx: &mut Context<Self>) {}
}

impl DomainSync {
    /// Creates the data for keeping a maintainer up to date. The maintainer may have content
    /// already.
    pub fn new(maintainer: Maintainer) -> DomainSync {
        let tracker = DomainTracker::default();
        let (due, composed, composing) = (None, None, None);
        let (began, fetching) = (Instant::now(), BTreeMap::new());
        DomainSync { maintainer, tracker, began, due, composed, composing, fetching }
    }

    /// Returns the present time on the maintainer's clock.
    pub fn timestamp(&self) -> Timestamp {
        Timestamp(u64::try_from(self.began.elapsed().as_millis()).unwrap_or(u64::MAX))
    }
}

/// Handles a broadcast `inform`: passes its content to the maintainer, and requests the sender's
/// model if that is missing.
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
    let DomainSync { maintainer, tracker, .. } = agent.domain_sync();
    let outcome = tracker.receive(maintainer, message, &inform, read, now);
    compose_soon(agent, ctx);
    for change in &outcome.changes {
        report(agent, change, ctx);
    }
    if outcome.lacks_model {
        fetch(agent, &message.sender, ASKED_AGAIN, ctx);
    }
    if let Some(why) = outcome.not_taken() {
        ctx.router().not_taken(message, why);
    }
    if let Some(mistake) = outcome.mistake {
        ctx.not_understood(message, mistake);
    }
}

/// Composes the models that have arrived, either at once or a little later together with models
/// that arrive soon.
fn compose_soon<A: MaintainsDomain>(agent: &mut A, ctx: &mut Context<A>) {
    let domain_sync = agent.domain_sync();
    if !domain_sync.maintainer.is_stale() || domain_sync.composing.is_some() {
        return;
    }
    let over = domain_sync.composed.map_or(COMPOSING_APART, |composed| composed.elapsed());
    let wait = COMPOSING_APART.saturating_sub(over);
    if wait.is_zero() {
        return compose(agent, ctx);
    }
    agent.domain_sync().composing = Some(ctx.after(wait, |agent: &mut A, ctx| compose(agent, ctx)));
}

/// Composes the models that have arrived, if there are any. Call this function before the domain is
/// sent to others.
pub fn compose<A: MaintainsDomain>(agent: &mut A, ctx: &mut Context<A>) {
    let domain_sync = agent.domain_sync();
    let timer = domain_sync.composing.take();
    let (is_stale, now) = (domain_sync.maintainer.is_stale(), domain_sync.timestamp());
    if is_stale {
        let AdmitResult { change, conflicts } = domain_sync.maintainer.compose_added(now);
        domain_sync.composed = Some(Instant::now());
        if !conflicts.is_empty() {
            agent.conflicts_found(&conflicts, ctx);
        }
        report_change(agent, &change, ctx);
    }
    timer.into_iter().for_each(|timer| ctx.cancel_timer(timer));
}

/// Handles the news that another agent has joined or left.
pub fn presence<A: MaintainsDomain>(agent: &mut A, presence: &Presence, ctx: &mut Context<A>) {
    let (name, incarnation) = (presence.resident().agent.clone(), presence.resident().incarnation);
    let now = agent.domain_sync().timestamp();
    let DomainSync { maintainer, tracker, fetching, .. } = agent.domain_sync();
    if let Presence::Left(_) = presence {
        fetching.remove(&name);
    }
    let PresenceOutcome { change, request_after } = tracker.presence(maintainer, presence, now);
    if let Some(wait) = request_after {
        if wait.is_zero() {
            fetch(agent, &name, ASKED_AGAIN, ctx);
        }
        ctx.after(ANNOUNCED_WITHIN, move |agent: &mut A, ctx| {
            if agent.domain_sync().maintainer.incarnation(&name) != Some(incarnation) {
                fetch(agent, &name, ASKED_AGAIN, ctx);
            }
        });
    }
    report(agent, &change, ctx);
}

/// Reports a change of the domain to the agent, and sets the timer of the next expiry or removal.
/// Call this function after any change that the agent itself makes in the maintainer.
pub fn report_change<A: MaintainsDomain>(
    agent: &mut A,
    change: &DomainChange,
    ctx: &mut Context<A>,
) {
    let now = agent.domain_sync().timestamp();
    let DomainSync { maintainer, tracker, .. } = agent.domain_sync();
    tracker.schedule_removals(maintainer, change, now);
    report(agent, change, ctx);
}

fn report<A: MaintainsDomain>(agent: &mut A, change: &DomainChange, ctx: &mut Context<A>) {
    schedule_due(agent, ctx);
    if !change.is_empty() {
        agent.domain_changed(change, ctx);
    }
}

/// Sets the timer to the next time at which a fact expires, an agent counts as silent, or the
/// objects and facts of an agent that has left are removed.
fn schedule_due<A: MaintainsDomain>(agent: &mut A, ctx: &mut Context<A>) {
    let sync = agent.domain_sync();
    let next = sync.tracker.next_due(&sync.maintainer, ctx.settings().removal);
    // One millisecond more, because a timestamp is a whole number of milliseconds.
    let wait = next.map(|next| next.since(sync.timestamp()) + TIMESTAMP_STEP);
    if let Some(earlier) = sync.due.take() {
        ctx.cancel_timer(earlier);
    }
    sync.due = wait.map(|wait| ctx.after(wait, advance));
}

/// Handles the facts that have expired, the agents that have become silent, and the removals that
/// are due. Reports the changes to the agent.
fn advance<A: MaintainsDomain>(agent: &mut A, ctx: &mut Context<A>) {
    let (now, removal) = (agent.domain_sync().timestamp(), ctx.settings().removal);
    let DomainSync { maintainer, tracker, .. } = agent.domain_sync();
    let changes = tracker.advance(maintainer, removal, now);
    schedule_due(agent, ctx);
    for change in changes {
        report(agent, &change, ctx);
    }
}

/// Requests the model of an agent. If no answer comes, asks again up to `again` times.
/// Reasoning agents have no model and do not answer.
fn fetch<A: MaintainsDomain>(agent: &mut A, owner: &AgentId, again: u32, ctx: &mut Context<A>) {
    if agent.domain_sync().fetching.contains_key(owner) {
        return;
    }
    let Some(resident) = ctx.find(owner) else { return };
    let asked = ctx.router().model_of(resident);
    let name = owner.clone();
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
        for message in answered_models(&name, answers) {
            receive_inform(agent, &message, ctx);
        }
    });
    agent.domain_sync().fetching.insert(owner.clone(), work);
}
