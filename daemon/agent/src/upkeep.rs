//! Upkeep of a Domain Maintainer: what an agent hears and sees, told to the state machine in
//! `capability`, and what changed, told to the agent.
//!
//! - Models and heartbeats come as `inform`s to all; a model that was missed is asked for.
//! - A lost token masks an agent's capabilities at once, and so do heartbeats that stop; when it
//!   stays away for [`Settings::removal`](crate::Settings), its objects and facts go too (design,
//!   “Presence”). Silence alone is enough, because a router can lose a token's end.
//! - What requests changed at the central maintainer comes with its announcements, for those who
//!   otherwise hear only heartbeats.
//!
//! The central Domain Maintainer and each actuator's own live by the same upkeep.

use std::collections::BTreeMap;
use std::time::Duration;

use acl::content::{EpochChange, Heartbeat, Inform, ModelAnnouncement};
use acl::{AgentId, Incarnation, Message};
use capability::{Announcement, Beat, Change, Conflict, Maintainer, Moment, Requests};
use substrate::{Ask, Presence, Resource};
use tokio::time::Instant;

use crate::base_agent::Agent;
use crate::context::{Context, TimerId, Work};

/// A maintainer, and what keeps it up to date.
pub struct Upkeep {
    /// The state machine.
    pub maintainer: Maintainer,
    began: Instant,
    expiry: Option<TimerId>,
    fetching: BTreeMap<AgentId, Work>,
}

/// An agent that keeps a maintainer.
pub trait Maintains: Agent {
    /// Its maintainer.
    fn upkeep(&mut self) -> &mut Upkeep;

    /// Something changed.
    fn changed(&mut self, _change: &Change, _ctx: &mut Context<Self>) {}

    /// Something of the model of `teller` cannot be composed as written.
    fn conflicted(&mut self, _conflicts: &[Conflict], _ctx: &mut Context<Self>) {}

    /// A model of another agent was taken.
    fn admitted(&mut self, _model: &pddl::ActionModel, _ctx: &mut Context<Self>) {}
}

impl Upkeep {
    /// Begins with what the maintainer knows already.
    pub fn new(maintainer: Maintainer) -> Upkeep {
        Upkeep { maintainer, began: Instant::now(), expiry: None, fetching: BTreeMap::new() }
    }

    /// Now, on the maintainer's clock.
    pub fn moment(&self) -> Moment {
        Moment(u64::try_from(self.began.elapsed().as_millis()).unwrap_or(u64::MAX))
    }
}

/// Takes an `inform` to all.
pub fn informed<A: Maintains>(agent: &mut A, message: &Message, ctx: &mut Context<A>) {
    match message.content_as::<Inform>() {
        Ok(Inform::Model(announcement)) => model(agent, message, &announcement, ctx),
        Ok(Inform::Heartbeat(beat)) => heartbeat(agent, message, &beat, ctx),
        Ok(Inform::Epoch(change)) => epoch(agent, message, &change, ctx),
        Ok(Inform::Answer(_)) => (),
        Err(error) => {
            tracing::info!(from = %message.sender, %error, "an inform that nobody understands");
        }
    }
}

/// Takes a change of presence.
pub fn presence<A: Maintains>(agent: &mut A, presence: &Presence, ctx: &mut Context<A>) {
    let (who, life) = (presence.resident().agent.clone(), presence.resident().incarnation);
    let now = agent.upkeep().moment();
    let change = match presence {
        Presence::Joined(_) => {
            if agent.upkeep().maintainer.needs_model(&who, "") {
                fetch(agent, &who, ctx);
            }
            agent.upkeep().maintainer.unmask(&who, life, now)
        }
        Presence::Left(_) => {
            agent.upkeep().fetching.remove(&who);
            agent.upkeep().maintainer.mask(&who, life, now)
        }
    };
    conclude(agent, &change, ctx);
}

/// Tells the agent what changed, and sees to it that what expires does so in time. To be called
/// after any change of the maintainer.
pub fn conclude<A: Maintains>(agent: &mut A, change: &Change, ctx: &mut Context<A>) {
    if let Some(earlier) = agent.upkeep().expiry.take() {
        ctx.forget(earlier);
    }
    if let Some(next) = agent.upkeep().maintainer.next_expiry() {
        // A millisecond more, because a moment is a whole number of them.
        let wait = next.since(agent.upkeep().moment()) + Duration::from_millis(1);
        agent.upkeep().expiry = Some(ctx.after(wait, expire));
    }
    for gone in &change.left {
        let Some(life) = agent.upkeep().maintainer.incarnation(gone) else { continue };
        let (gone, removal) = (gone.clone(), ctx.settings().removal);
        ctx.after(removal, move |agent: &mut A, ctx| remove(agent, &gone, life, ctx));
    }
    if !change.is_empty() {
        agent.changed(change, ctx);
    }
}

fn expire<A: Maintains>(agent: &mut A, ctx: &mut Context<A>) {
    let now = agent.upkeep().moment();
    let change = agent.upkeep().maintainer.expire(now);
    conclude(agent, &change, ctx);
}

fn remove<A: Maintains>(agent: &mut A, gone: &AgentId, life: Incarnation, ctx: &mut Context<A>) {
    if agent.upkeep().maintainer.is_present(gone) {
        return;
    }
    let now = agent.upkeep().moment();
    let change = agent.upkeep().maintainer.remove(gone, life, now);
    conclude(agent, &change, ctx);
}

fn model<A: Maintains>(
    agent: &mut A,
    message: &Message,
    announcement: &ModelAnnouncement,
    ctx: &mut Context<A>,
) {
    let sender = &message.sender;
    agent.upkeep().fetching.remove(sender);
    let model = match pddl::parse_action_model(&announcement.model).into_result() {
        Ok(model) => model,
        Err(diagnostics) => {
            let located = |diagnostic: &pddl::Diagnostic| diagnostic.located(&announcement.model);
            let lines: Vec<_> = diagnostics.iter().map(located).collect();
            tracing::warn!(from = %sender, "an unreadable action model: {}", lines.join("; "));
            ctx.not_understood(message, lines.join("; "));
            return;
        }
    };
    let digest = announcement.heartbeat.digest.clone();
    if agent.upkeep().maintainer.needs_model(sender, &digest) {
        agent.admitted(&model, ctx);
    }
    let announced = Announcement {
        agent: sender.clone(),
        incarnation: message.incarnation,
        model,
        methods: announcement.methods.clone(),
        digest,
    };
    let now = agent.upkeep().moment();
    match agent.upkeep().maintainer.admit(announced, now) {
        Ok(admission) => {
            if !admission.conflicts.is_empty() {
                agent.conflicted(&admission.conflicts, ctx);
            }
            conclude(agent, &admission.change, ctx);
            believe(agent, message, &announcement.heartbeat, ctx);
        }
        Err(declined) => {
            tracing::warn!(from = %sender, %declined, "an action model is declined");
            ctx.not_understood(message, declined.to_string());
        }
    }
}

fn heartbeat<A: Maintains>(
    agent: &mut A,
    message: &Message,
    heartbeat: &Heartbeat,
    ctx: &mut Context<A>,
) {
    if agent.upkeep().maintainer.needs_model(&message.sender, &heartbeat.digest) {
        fetch(agent, &message.sender, ctx);
    } else {
        believe(agent, message, heartbeat, ctx);
    }
}

fn believe<A: Maintains>(
    agent: &mut A,
    message: &Message,
    heartbeat: &Heartbeat,
    ctx: &mut Context<A>,
) {
    let now = agent.upkeep().moment();
    let (sender, life) = (message.sender.clone(), message.incarnation);
    let beat = match Beat::read(sender, life, heartbeat, now) {
        Ok(beat) => beat,
        Err(diagnostics) => {
            let lines: Vec<_> = diagnostics.iter().map(ToString::to_string).collect();
            return ctx.not_understood(message, lines.join("; "));
        }
    };
    match agent.upkeep().maintainer.believe_heartbeat(beat, now) {
        Ok(change) => conclude(agent, &change, ctx),
        Err(declined) => {
            tracing::debug!(from = %message.sender, %declined, "a heartbeat is not believed");
        }
    }
}

/// Takes what a central maintainer tells of requests; everything else in its announcement is
/// heard here from those whose word it is.
fn epoch<A: Maintains>(
    agent: &mut A,
    message: &Message,
    change: &EpochChange,
    ctx: &mut Context<A>,
) {
    let Some(requested) = &change.requested else { return };
    let (now, maintainer) = (agent.upkeep().moment(), &mut agent.upkeep().maintainer);
    // Who has an action model is no Domain Maintainer, whatever it says of others.
    if maintainer.incarnation(&message.sender).is_some() {
        return;
    }
    let requests = match Requests::read(requested, now) {
        Ok(requests) => requests,
        Err(diagnostics) => {
            let lines: Vec<_> = diagnostics.iter().map(ToString::to_string).collect();
            return ctx.not_understood(message, lines.join("; "));
        }
    };
    match maintainer.follow(&requests, now) {
        Ok(change) => conclude(agent, &change, ctx),
        Err(declined) => {
            tracing::warn!(from = %message.sender, %declined, "requests are not followed");
        }
    }
}

/// Asks an agent for its model. Reasoning agents have none and do not answer.
fn fetch<A: Maintains>(agent: &mut A, whose: &AgentId, ctx: &mut Context<A>) {
    if agent.upkeep().fetching.contains_key(whose) {
        return;
    }
    let Some(resident) = ctx.find(whose) else { return };
    let ask = Ask {
        daemon: Some(resident.daemon),
        resource: Resource::Model,
        agent: Some(whose.clone()),
    };
    let asked = ctx.switchboard().ask(ask, ctx.settings().answer_deadline);
    let name = whose.clone();
    let work = ctx.run(asked, move |agent: &mut A, answers, ctx| {
        agent.upkeep().fetching.remove(&name);
        for answer in answers {
            match acl::decode(&answer) {
                Ok(message) if message.sender == name => informed(agent, &message, ctx),
                _ => tracing::info!(from = %name, "an answer that is no model"),
            }
        }
    });
    agent.upkeep().fetching.insert(whose.clone(), work);
}
